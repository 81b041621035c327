//! Settings of the extractor; the defaults suit the paper's rig and most cameras.

/// Which way the stripe runs through the image.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Orientation {
    /// Along the rows: one point per column, its row at sub-pixel.
    #[default]
    Horizontal,
    /// Along the columns: one point per row, its column at sub-pixel.
    Vertical,
}

/// Settings of the extractor.
#[derive(Debug, Clone, PartialEq)]
pub struct ExtractorConfig {
    /// Which way the stripe runs. Where it is vertical, every "column" below is a row and every
    /// "row" a column.
    pub orientation: Orientation,
    /// Grey level from which a pixel counts as saturated (clipped) \[grey levels\]. A camera's lower
    /// ceiling (limited range: 235) is found from each frame.
    pub saturation_level: u8,
    /// Points below this height are not reported \[grey levels above background\].
    pub min_peak: f64,
    /// Columns a stripe must be found in; fewer are no stripe.
    pub min_columns: usize,
    /// Shortest unbroken stretch that counts \[columns\]; particles make shorter ones.
    pub min_stretch_columns: usize,
    /// Price of a depth step or of a gap, in columns: shorter side tracks are not followed.
    pub step_cost_columns: f64,
    /// Columns on either side of a step or an end of the stripe that carry
    /// [`quality::NEAR_STEP`](super::quality::NEAR_STEP).
    pub step_reach_columns: usize,
    /// Half width of the stretch of stripe over which width and noise are pooled \[columns\].
    pub pool_reach_columns: usize,
    /// Estimate and take out the one-sided haze of the sheet in the water.
    pub correct_haze: bool,
    /// The paper's way: the central pixel of the stripe, no sub-pixel row.
    pub whole_pixel: bool,
}

impl Default for ExtractorConfig {
    fn default() -> Self {
        Self {
            orientation: Orientation::Horizontal,
            saturation_level: 254,
            min_peak: 10.0,
            min_columns: 16,
            min_stretch_columns: 12,
            step_cost_columns: 4.0,
            step_reach_columns: 6,
            pool_reach_columns: 16,
            correct_haze: true,
            whole_pixel: false,
        }
    }
}
