//! Offset and tilt of the board against the sheet, from its gauge blocks.
