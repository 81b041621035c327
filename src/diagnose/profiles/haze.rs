//! Haze beside the stripe (filled in below).
