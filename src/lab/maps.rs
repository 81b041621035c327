//! The comparison of all maps on one synthetic rig, whose truth no map knows.

pub mod spread;
pub mod truth;

use nalgebra::Matrix2;
use rand::{RngExt, SeedableRng, rngs::StdRng};
use rand_distr::{Distribution, Normal};

use hydroline_calib::map::{FitOptions, MapError, Method, Node, fit};
use truth::{Rig, prior};

/// One line of the table.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Row {
    /// Method of the map.
    pub method: Method,
    /// Port or air before the camera, and noise of the nodes.
    pub case: Case,
    /// Root mean square in ξ \[mm\].
    pub rms_xi_mm: f64,
    /// Root mean square in η \[mm\].
    pub rms_eta_mm: f64,
    /// Largest distance in ξ or η \[mm\].
    pub max_mm: f64,
    /// Mean in η \[mm\]: the scallop of the literal maps has one sign.
    pub mean_eta_mm: f64,
    /// Test points answered.
    pub answered: usize,
    /// Test points asked.
    pub asked: usize,
    /// Share of answers whose 95 % intervals (ξ and η apart) hold the truth.
    pub covered: f64,
}

/// Conditions of a row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Case {
    /// Flat port, exact nodes.
    PortExact,
    /// Flat port, nodes ±0.2 px.
    PortNoisy,
    /// Pinhole in air, exact nodes.
    AirExact,
    /// Pinhole in air, nodes ±0.2 px.
    AirNoisy,
}

impl Case {
    /// All four, in the table's order.
    pub const ALL: [Case; 4] = [
        Case::PortExact,
        Case::PortNoisy,
        Case::AirExact,
        Case::AirNoisy,
    ];

    /// Words for people.
    pub fn name(self) -> &'static str {
        match self {
            Case::PortExact => "flat port, exact nodes",
            Case::PortNoisy => "flat port, nodes ±0.2 px",
            Case::AirExact => "air, exact nodes",
            Case::AirNoisy => "air, nodes ±0.2 px",
        }
    }

    fn rig(self) -> Rig {
        match self {
            Case::PortExact | Case::PortNoisy => Rig::behind_port(),
            Case::AirExact | Case::AirNoisy => Rig::in_air(),
        }
    }

    fn noise_px(self) -> f64 {
        match self {
            Case::PortExact | Case::AirExact => 0.0,
            Case::PortNoisy | Case::AirNoisy => 0.2,
        }
    }
}

/// Findings of the table, in words to print beside it.
pub const EXPLANATION: &str = "\
The literal Wang-Cheng maps (affine, bilinear, graticule) err by about 0.5 mm rms and 0.9 mm at most in eta, \
behind the port as in air: neither lens nor water does it. At 45 degrees the image of equally spaced latitudes is not \
equally spaced, and a linear step over one 50 mm cell ignores that. The error is zero on the grid lines and of one \
sign between them: a 50 mm scallop, growing with the square of the pitch. rectified-graticule removes the perspective \
first and homography also fits the lens; neither has the scallop.";

/// Lowest latitude \[m\]: the board stands 0.25 to 0.75 m below the camera (η_c = 0.46 m).
const LOW_ETA_M: f64 = -0.29;

/// Standard deviation \[px\] given to nodes that are exact, so that a fit can weigh them.
const EXACT_SD_PX: f64 = 0.01;

/// Nodes of the board as the rig sees them, `noise_px` added to both coordinates.
pub fn nodes(rig: &Rig, noise_px: f64, rng: &mut StdRng) -> Vec<Node> {
    let sd = if noise_px > 0.0 {
        noise_px
    } else {
        EXACT_SD_PX
    };
    let mut nodes = Vec::with_capacity(121);
    for j in 0..11 {
        for i in 0..11 {
            let (xi_m, eta_m) = (-0.25 + 0.05 * f64::from(i), LOW_ETA_M + 0.05 * f64::from(j));
            if let Some([column, row]) = rig.project(xi_m, eta_m, 0.0) {
                let mut noise = || Normal::new(0.0, noise_px).map_or(0.0, |n| n.sample(rng));
                nodes.push(Node {
                    xi_m,
                    eta_m,
                    column_px: column + noise(),
                    row_px: row + noise(),
                    covariance_px2: Matrix2::identity() * sd * sd,
                });
            }
        }
    }
    nodes
}

/// The table: every map in every case, 4000 test points each.
///
/// The board's upper corners lie outside the 720 × 576 image at this magnification; the
/// comparison is of geometry and keeps them, as the project's notes do.
///
/// # Errors
/// [`MapError`] when a map cannot be fitted.
pub fn table(seed: u64) -> Result<Vec<Row>, MapError> {
    let mut table = Vec::new();
    for case in Case::ALL {
        for &method in Method::ALL {
            table.push(row(method, case, seed, 4000)?);
        }
    }
    Ok(table)
}

/// One line of the table.
///
/// # Errors
/// [`MapError`] when the map cannot be fitted.
pub fn row(method: Method, case: Case, seed: u64, points: usize) -> Result<Row, MapError> {
    let rig = case.rig();
    let mut rng = StdRng::seed_from_u64(seed);
    let nodes = nodes(&rig, case.noise_px(), &mut rng);
    let options = FitOptions {
        image: Some(rig.image()),
        refractive: Some(prior(&rig)),
    };
    let map = fit(method, &nodes, &options)?;
    let (mut sum_xi, mut sum_eta, mut mean_eta, mut max) = (0.0, 0.0, 0.0, 0.0f64);
    let (mut answered, mut covered) = (0, 0);
    for _ in 0..points {
        let (xi, eta) = (
            rng.random_range(-0.25..0.25),
            rng.random_range(LOW_ETA_M..LOW_ETA_M + 0.5),
        );
        let Some(at) = rig
            .project(xi, eta, 0.0)
            .and_then(|p| map.to_plane(p[0], p[1]))
        else {
            continue;
        };
        let (dx, de) = (1e3 * (at.xi_m - xi), 1e3 * (at.eta_m - eta));
        answered += 1;
        sum_xi += dx * dx;
        sum_eta += de * de;
        mean_eta += de;
        max = max.max(dx.abs()).max(de.abs());
        for (k, d) in [dx, de].into_iter().enumerate() {
            let sd_mm = 1e3 * at.covariance_m2[(k, k)].max(0.0).sqrt();
            covered += usize::from(d.abs() <= 1.959_964 * sd_mm);
        }
    }
    let n = (answered as f64).max(1.0);
    Ok(Row {
        method,
        case,
        rms_xi_mm: (sum_xi / n).sqrt(),
        rms_eta_mm: (sum_eta / n).sqrt(),
        max_mm: max,
        mean_eta_mm: mean_eta / n,
        answered,
        asked: points,
        covered: covered as f64 / (2.0 * n),
    })
}

#[cfg(test)]
mod tests;
