//! Luck of the seed in a noisy row: the largest error over many boards.

use rand::{RngExt, SeedableRng, rngs::StdRng};

use super::{Case, LOW_ETA_M, nodes, row};
use hydroline_calib::map::geometry::{apply, homography};
use hydroline_calib::map::{MapError, Method};

/// The limit asked of nodes good to 0.2 px \[mm\].
pub const LIMIT_MM: f64 = 0.2;

/// Largest errors in ξ or η over the sheet, one per seed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spread {
    /// Seeds, from 0.
    pub seeds: u32,
    /// Half of the seeds do better \[mm\].
    pub median_mm: f64,
    /// 95 % of the seeds do better \[mm\].
    pub p95_mm: f64,
    /// Share of seeds within [`LIMIT_MM`].
    pub within: f64,
}

impl Spread {
    fn of(mut max_mm: Vec<f64>) -> Self {
        max_mm.sort_by(f64::total_cmp);
        let at = |share: f64| {
            let k = (share * max_mm.len() as f64) as usize;
            max_mm.get(k).copied().unwrap_or(f64::NAN)
        };
        let within = max_mm.iter().filter(|m| **m <= LIMIT_MM).count();
        Spread {
            seeds: max_mm.len() as u32,
            median_mm: at(0.5),
            p95_mm: at(0.95),
            within: within as f64 / (max_mm.len() as f64).max(1.0),
        }
    }
}

/// The largest of `points` errors of a map, seed by seed.
///
/// # Errors
/// [`MapError`] when a map cannot be fitted.
pub fn over_seeds(
    method: Method,
    case: Case,
    seeds: u32,
    points: usize,
) -> Result<Spread, MapError> {
    let max_mm = (0..u64::from(seeds))
        .map(|seed| Ok(row(method, case, seed, points)?.max_mm))
        .collect::<Result<_, MapError>>()?;
    Ok(Spread::of(max_mm))
}

/// The same for perspective alone, 8 numbers fitted (linearly) to the same noise through a camera
/// that has no lens: with fewer nobody maps a plane. What a map with a lens may be measured by.
///
/// # Errors
/// [`MapError::Degenerate`] when the nodes span nothing.
pub fn perspective_alone(seeds: u32, points: usize) -> Result<Spread, MapError> {
    let rig = Case::AirNoisy.rig();
    let mut max_mm = Vec::new();
    for seed in 0..u64::from(seeds) {
        let mut rng = StdRng::seed_from_u64(seed);
        let pairs: Vec<_> = nodes(&rig, Case::AirNoisy.noise_px(), &mut rng)
            .iter()
            .map(|n| ([n.column_px, n.row_px], [n.xi_m, n.eta_m]))
            .collect();
        let swapped: Vec<_> = pairs.iter().map(|(p, x)| (*x, *p)).collect();
        // Fitted from sheet to image, where the noise is alike everywhere, and used the other way.
        let inverse = homography(&swapped)
            .and_then(|h| h.try_inverse())
            .ok_or(MapError::Degenerate)?;
        let mut max = 0.0f64;
        for _ in 0..points {
            let (xi, eta) = (
                rng.random_range(-0.25..0.25),
                rng.random_range(LOW_ETA_M..LOW_ETA_M + 0.5),
            );
            let Some(p) = rig.project(xi, eta, 0.0) else {
                continue;
            };
            let at = apply(&inverse, p).or_else(|| apply(&-inverse, p));
            let [x, y] = at.ok_or(MapError::Degenerate)?;
            max = max.max(1e3 * (x - xi).abs()).max(1e3 * (y - eta).abs());
        }
        max_mm.push(max);
    }
    Ok(Spread::of(max_mm))
}
