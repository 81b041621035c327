//! What lies on the floor (target) and what stands in the sheet (calibration board).

/// Outline of a flat slab seen from above, in the target frame (X along the centre line, Y to starboard).
#[derive(Debug, Clone, PartialEq)]
pub enum SlabOutline {
    /// Rectangle X in \[x0, x1\], |Y| <= width/2.
    Rectangle {
        /// Start \[m\].
        x0_m: f64,
        /// End \[m\].
        x1_m: f64,
        /// Full width \[m\].
        width_m: f64,
    },
    /// Regular hexagons end to end along X: joints (width = side) at x0 + k*sqrt(3)*side, widest (2*side) half way.
    HexagonChain {
        /// Start of the first hexagon \[m\].
        x0_m: f64,
        /// Side \[m\].
        side_m: f64,
        /// Number of hexagons.
        count: u32,
    },
    /// Any simple polygon, vertices (X, Y) in order.
    Polygon {
        /// Vertices \[m\].
        points_m: Vec<[f64; 2]>,
    },
}

/// One flat layer: everything inside `outline` has its top at `top_m` above the floor.
#[derive(Debug, Clone, PartialEq)]
pub struct Slab {
    /// Name, e.g. `board`, `hexagons`.
    pub name: String,
    /// Outline seen from above.
    pub outline: SlabOutline,
    /// Height of its top above the floor \[m\].
    pub top_m: f64,
    /// Diffuse reflectance relative to the floor (1 = the same).
    pub albedo: f64,
}

/// A target: slabs on the floor; where several overlap the highest counts.
#[derive(Debug, Clone, PartialEq)]
pub struct Target {
    /// Short name.
    pub name: String,
    /// Layers.
    pub slabs: Vec<Slab>,
    /// Position of the target's origin in the tank frame: X, Y \[m\] and its heading \[rad\].
    pub origin: [f64; 3],
}

/// Pattern of a calibration board.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum BoardPattern {
    /// Grid lines, line width \[m\].
    Lines {
        /// Line width \[m\].
        line_m: f64,
    },
    /// Dots, diameter \[m\].
    Dots {
        /// Diameter \[m\].
        diameter_m: f64,
    },
    /// Chessboard squares of the pitch's size.
    Chessboard,
}

/// A raised gauge block of known height on a board (issue: coplanarity).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GaugeBlock {
    /// Centre on the board \[m\].
    pub centre_m: [f64; 2],
    /// Size on the board \[m\].
    pub size_m: [f64; 2],
    /// Height above the board's face \[m\].
    pub height_m: f64,
}

/// A calibration board: `columns` x `rows` nodes, `pitch_m` apart.
#[derive(Debug, Clone, PartialEq)]
pub struct Board {
    /// Short name.
    pub name: String,
    /// Pattern.
    pub pattern: BoardPattern,
    /// Nodes along xi.
    pub columns: u32,
    /// Nodes along eta.
    pub rows: u32,
    /// Node pitch \[m\] (Wang-Cheng: 0.050).
    pub pitch_m: f64,
    /// Margin around the outer nodes \[m\].
    pub margin_m: f64,
    /// Thickness \[m\].
    pub thickness_m: f64,
    /// Gauge blocks.
    pub blocks: Vec<GaugeBlock>,
}
