//! The paper's six estimators (LSHPI, section 2.2): one degree of freedom each from stripe points in
//! the laser plane, the other five taken as still.
//!
//! | estimator | uses | assumes |
//! |---|---|---|
//! | [`surge_positions`] | A, B, C, D; flank widths | θ = φ = 0, yaw constant |
//! | [`sway_m`] (Eq. 2) | ξ of A or B | φ, ψ, surge constant |
//! | [`heave_m`] (Eq. 3) | η of the floor line | θ = 0, φ constant |
//! | [`roll_rad`] (Eq. 4) | slope of the floor line | θ = 0 |
//! | [`pitch_rad`] (Eq. 5) | η of the floor line | H constant, φ = 0 |
//! | [`yaw_rad`] (Eq. 6) | ψ_S from the hexagon's flanks | θ = φ = 0 |
//!
//! Heights enter, which the paper's figures neglect: a point on an upper face of height h lies at
//! range h_centre − η below the CG, whatever the floor does.

mod chain;

pub use chain::{Chain, ChainFix, Crossing};

use super::segments::Levels;
use hydroline_rigs::Mounts;

/// A frame that breaks an estimator's assumption, or lacks what it needs.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum EstimatorFault {
    #[error("edge point {point} is not in the frame: {what} needs it")]
    NoEdge {
        what: &'static str,
        /// A, B, C or D.
        point: char,
    },
    #[error(
        "the stripe is rotated by {roll_deg:.2}°, but {what} takes roll as zero (within {allowed_deg}°)"
    )]
    Rolled {
        what: &'static str,
        roll_deg: f64,
        allowed_deg: f64,
    },
    /// Widths that no place on the chain has.
    #[error(
        "half widths {l_mm:.1} mm and {r_mm:.1} mm fit no place of the hexagons near {near_m:.3} m"
    )]
    NoPlace {
        /// To port \[mm\].
        l_mm: f64,
        /// To starboard \[mm\].
        r_mm: f64,
        /// Where it was looked for, sheet X \[m\].
        near_m: f64,
    },
    /// η at which Eq. 5 has no solution.
    #[error(
        "the floor line at η = {eta_m:.4} m is nearer than any pitch can bring it (distance from the floor {height_m:.3} m)"
    )]
    NoPitch { eta_m: f64, height_m: f64 },
}

/// Roll beyond which the estimators that take it as zero report a fault \[rad\].
const ROLL_ALLOWED_RAD: f64 = 0.5 * std::f64::consts::PI / 180.0;

/// A value and its standard deviation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// \[m\] or \[rad\].
    pub value: f64,
    /// Standard deviation from the stripe's own noise, the assumption taken as true.
    pub sd: f64,
}

/// Whether roll, taken as zero by `what`, is so.
pub fn upright(levels: &Levels, what: &'static str) -> Result<(), EstimatorFault> {
    let roll_rad = -levels.slope.atan();
    if roll_rad.abs() <= ROLL_ALLOWED_RAD {
        return Ok(());
    }
    Err(EstimatorFault::Rolled {
        what,
        roll_deg: roll_rad.to_degrees(),
        allowed_deg: ROLL_ALLOWED_RAD.to_degrees(),
    })
}

/// Heave, Eq. 3: z − z₁ = η − η₁ (down positive: the line rises in the sheet as the vehicle sinks).
/// `first` = the floor line of the first frame. Assumes θ = 0 and roll as at the start.
pub fn heave_m(levels: &Levels, first: &Levels) -> Estimate {
    Estimate {
        value: levels.eta0_m - first.eta0_m,
        sd: levels.eta0_sd_m.hypot(first.eta0_sd_m),
    }
}

/// Roll, Eq. 4: tan φ = (η_B − η_A) / (ξ_A − ξ_B), by the slope of the whole floor line. Assumes θ = 0.
pub fn roll_rad(levels: &Levels) -> Estimate {
    Estimate {
        value: (-levels.slope).atan(),
        sd: levels.slope_sd / (1.0 + levels.slope * levels.slope),
    }
}

/// Pitch, Eq. 5: (h_centre − η) cos θ = l_laser sin θ + H, H = h_centre − η_level.
///
/// With h_centre − η = R cos β, l_laser = R sin β: R cos(θ + β) = H. Assumes H constant and φ = 0.
///
/// # Errors
/// [`EstimatorFault::NoPitch`] for a line that no pitch gives.
pub fn pitch_rad(
    levels: &Levels,
    eta_level_m: f64,
    mounts: &Mounts,
) -> Result<Estimate, EstimatorFault> {
    let below_m = mounts.h_centre_m - levels.eta0_m;
    let height_m = mounts.h_centre_m - eta_level_m;
    let r = below_m.hypot(mounts.l_laser_m);
    let cos = height_m / r;
    if !(cos > 0.0 && cos <= 1.0) {
        return Err(EstimatorFault::NoPitch {
            eta_m: levels.eta0_m,
            height_m,
        });
    }
    let theta = cos.acos() - mounts.l_laser_m.atan2(below_m);
    // Differentiating Eq. 5: cos θ dη = −((h_centre − η) sin θ + l_laser cos θ) dθ. Nose down, the
    // bracket goes to zero: there heave and pitch are not identifiable (paper, Figs 12 and 13).
    let gain = below_m * theta.sin() + mounts.l_laser_m * theta.cos();
    Ok(Estimate {
        value: theta,
        sd: levels.eta0_sd_m * theta.cos() / gain.abs().max(1e-9),
    })
}

/// Sway, Eq. 2: y − y₁ = ξ − ξ₁ of the same edge, A (port) or B (starboard); of both where both are there.
/// Assumes roll, yaw and (where the board is not square to the path) surge as at the start.
///
/// # Errors
/// [`EstimatorFault::NoEdge`] when no edge is in both frames.
pub fn sway_m(crossing: &Crossing, first: &Crossing) -> Result<Estimate, EstimatorFault> {
    let pairs = [(crossing.a, first.a), (crossing.d, first.d)];
    let both: Vec<(f64, f64)> = pairs
        .iter()
        .filter_map(|(now, then)| now.zip(*then))
        .map(|(now, then)| (now.xi_m - then.xi_m, now.sd_m.hypot(then.sd_m)))
        .collect();
    match both.as_slice() {
        [] => Err(EstimatorFault::NoEdge {
            what: "sway",
            point: 'A',
        }),
        [(value, sd)] => Ok(Estimate {
            value: *value,
            sd: *sd,
        }),
        many => {
            let n = many.len() as f64;
            let value = many.iter().map(|m| m.0).sum::<f64>() / n;
            Ok(Estimate {
                value,
                sd: many.iter().map(|m| m.1 * m.1).sum::<f64>().sqrt() / n,
            })
        }
    }
}

/// Yaw, Eq. 6: ψ_i = ψ_S,i − ψ_S,1.
pub fn yaw_rad(fix: &ChainFix, first: &ChainFix) -> f64 {
    fix.psi_s_rad - first.psi_s_rad
}

/// Surge along the path: x_i = (X_S,i − X_S,1) cos ψ_S, with ψ_S = the mean of the run's ψ_S,i; X_S,i
/// anew from l_i and r_i at that mean yaw, as the paper does. `None` where a frame has no place.
pub fn surge_positions(
    chain: &Chain,
    crossings: &[Option<Crossing>],
    fixes: &[Option<ChainFix>],
) -> (f64, Vec<Option<f64>>) {
    let psis: Vec<f64> = fixes.iter().flatten().map(|f| f.psi_s_rad).collect();
    let psi_s_rad = psis.iter().sum::<f64>() / (psis.len().max(1)) as f64;
    let places: Vec<Option<f64>> = crossings
        .iter()
        .zip(fixes)
        .map(|(crossing, fix)| chain.place_at_yaw(&(*crossing)?, psi_s_rad, (*fix)?.x_s_m))
        .collect();
    let first = places.iter().flatten().next().copied().unwrap_or(0.0);
    (
        psi_s_rad,
        places
            .into_iter()
            .map(|p| p.map(|x| (x - first) * psi_s_rad.cos()))
            .collect(),
    )
}

#[cfg(test)]
mod tests;
