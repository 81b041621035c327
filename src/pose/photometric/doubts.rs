//! How far the edges of the target can be trusted.
//!
//! No edge is machined, nor any image formed, to a hundredth of a pixel. How well an edge is, is
//! seen in what its pixels leave over: that is its doubt, the standard deviation of a pixel cut
//! in half beyond its noise, as a share of its light. Each edge has its own: one that lies along
//! the pixels' columns shows every step of a sampled image, one aslant to them averages over them.

/// Pixels with this much light torn by an edge say how good the edge is \[grey levels\].
const TORN: f64 = 20.0;
/// Residuals beyond this share of the torn light are particles, not edges.
const EXCESS_MOST: f64 = 0.15;
/// Least and greatest doubt: what is found from some hundred pixels is uncertain itself. The least
/// is that of an edge that lies off by a fiftieth of a pixel.
const DOUBT_RANGE: [f64; 2] = [0.01, 0.1];

/// One edge of one top.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct EdgeName {
    pub top: u16,
    pub edge: u16,
}

/// Doubts of a frame's edges, and of its pixels.
#[derive(Debug, Clone, Default)]
pub(in crate::pose) struct Doubts {
    /// `None`: not looked for yet.
    edges: Option<Vec<(EdgeName, f64)>>,
    /// Of each pixel that an edge may cut, in their order \[grey levels\]: found at the first
    /// state looked at and held fixed after that, or the fit would flee into doubtful pixels.
    pub(super) of_pixels: Vec<f32>,
}

impl Doubts {
    /// Of the edges as their pixels have shown them: none better than all of them together are,
    /// since a few pixels may look good by chance.
    pub fn found(sums: &EdgesSeen, noise_sd: f64) -> Doubts {
        let all = sums.doubt(noise_sd);
        let edges = sums.0.iter();
        Doubts {
            edges: Some(
                edges
                    .map(|e| (e.name, e.doubt(noise_sd).max(all)))
                    .collect(),
            ),
            of_pixels: Vec::new(),
        }
    }

    /// All edges alike.
    #[cfg(test)]
    pub fn alike(sums: &EdgesSeen, doubt: f64) -> Doubts {
        Doubts {
            edges: Some(sums.0.iter().map(|e| (e.name, doubt)).collect()),
            of_pixels: Vec::new(),
        }
    }

    pub(super) fn known(&self) -> bool {
        self.edges.is_some()
    }

    /// Of one edge; of one that no pixel has shown yet the least, until the next look finds it.
    pub(super) fn of(&self, name: EdgeName) -> Option<f64> {
        let edges = self.edges.as_ref()?;
        let found = edges.iter().find(|(n, _)| *n == name);
        Some(found.map_or(DOUBT_RANGE[0], |(_, q)| *q))
    }
}

/// The edges that a comparison has met.
#[derive(Debug, Clone, Default)]
pub(in crate::pose) struct EdgesSeen(pub(super) Vec<EdgeSums>);

impl EdgesSeen {
    /// Doubt of all edges taken together.
    pub fn doubt(&self, noise_sd: f64) -> f64 {
        let mut all = EdgeSums::default();
        for e in &self.0 {
            all.square += e.square;
            all.light2 += e.light2;
            all.count += e.count;
        }
        all.doubt(noise_sd)
    }
}

/// What the pixels of an edge add up to.
#[derive(Debug, Clone, Default)]
pub(super) struct EdgeSums {
    pub name: EdgeName,
    /// Squared residuals, torn light squared, number of pixels.
    square: f64,
    light2: f64,
    count: usize,
}

impl EdgeSums {
    pub fn new(name: EdgeName) -> Self {
        EdgeSums {
            name,
            ..EdgeSums::default()
        }
    }

    /// Counts a pixel of which so much light is torn.
    #[inline]
    pub fn see(&mut self, torn: f64, residual: f64, noise_sd: f64) {
        if torn > TORN && residual.abs() < EXCESS_MOST * torn + 4.0 * noise_sd {
            self.square += residual * residual;
            self.light2 += torn * torn;
            self.count += 1;
        }
    }

    /// Standard deviation of pixels beyond their noise, as a share of the light of a pixel cut in half.
    fn doubt(&self, noise_sd: f64) -> f64 {
        let excess = self.square - self.count as f64 * noise_sd * noise_sd;
        let found = if self.light2 > 0.0 {
            (excess / self.light2).max(0.0).sqrt()
        } else {
            0.0
        };
        found.clamp(DOUBT_RANGE[0], DOUBT_RANGE[1])
    }
}
