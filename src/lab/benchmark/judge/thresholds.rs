//! Weight from which an effect counts, and log evidence from which two effects are apart.

/// Weight below which an effect is not scored by itself \[m\].
pub const SCORED_M: f64 = 0.5e-3;
/// Log evidence (a factor of 20) below which the data at their true noise cannot part two effects.
pub const SPLIT: f64 = 3.0;
/// The same where the diagnosis says that it cannot: its noise is estimated, and what it says must not excuse
/// everything.
pub const SAID: f64 = 6.0;
