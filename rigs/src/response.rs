//! What is known of a camera's response before a run.

/// A camera's response as the rig states it: g = b + 255 (L/255)^γ, and the level at which it is cut off.
///
/// Shading is not among it: along the line it looks like a laser whose fan is uneven, which no flat frame shows, so a
/// pose leaves both free together whatever is known of the one.
#[derive(Debug, Clone, PartialEq)]
pub struct StatedResponse {
    /// γ; 1 = the camera leaves light as it is.
    pub gamma: f64,
    /// Its standard deviation; 0 = for certain.
    pub gamma_sd: f64,
    /// Black level b and its standard deviation \[grey levels\]; `None` = not stated.
    pub black_levels: Option<[f64; 2]>,
    /// Correlation of γ and b: an exposure series knows one by the other.
    pub gamma_black_correlation: f64,
    /// Level from which on light is clipped \[grey levels\]; `None` = frames show it themselves.
    pub ceiling_levels: Option<u8>,
    /// Where it comes from, in words.
    pub source: String,
}

impl StatedResponse {
    /// The table of a rig file that states it.
    pub fn to_toml(&self) -> String {
        crate::effective::response_table(self)
    }
}
