//! A quick floor line for watching limits while running: height and roll, nothing finer.
//!
//! Floor line in the laser plane at roll phi, theta = 0 (theory/geometry.md, laser plane; paper Eqs. 3 and 4):
//! eta = h_centre - H / cos phi - xi tan phi, H = height of the CG above the floor.
//! A target only raises the stripe, so the floor is the LOWEST line that many points agree on.
//! Pitch is taken as zero: at 5 deg it moves H by l_laser sin 5 deg = 24 mm, little against a limit.

use hydroline_log::messages::pb::StripeProfile;

/// One stripe point in the laser plane: xi to port, eta up \[m\].
pub type PlanePointM = (f64, f64);

/// Height and roll from the floor line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Floor {
    /// Height of the CG above the floor \[m\].
    pub height_m: f64,
    /// Roll \[rad\].
    pub phi_rad: f64,
    /// Share of the points that lie on it, 0..1.
    pub share: f64,
}

/// The points of a profile that have plane coordinates.
pub fn points(profile: &StripeProfile) -> Vec<PlanePointM> {
    let pairs = profile.xi_m.iter().zip(&profile.eta_m);
    pairs
        .map(|(xi, eta)| (f64::from(*xi), f64::from(*eta)))
        .filter(|(xi, eta)| xi.is_finite() && eta.is_finite())
        .collect()
}

/// Points within this distance of the line count as lying on it \[m\]: half the thinnest target step (20 mm) less noise.
const ON_LINE_M: f64 = 0.004;
/// A floor line needs this share of all points.
const MIN_SHARE: f64 = 0.15;
/// Fewer points than this say nothing.
const MIN_POINTS: usize = 20;

/// The lowest well-supported line through the points; `None` when there is none.
///
/// Deterministic: candidate lines run through pairs of points a fixed number of places apart.
pub fn floor(points: &[PlanePointM], h_centre_m: f64) -> Option<Floor> {
    if points.len() < MIN_POINTS {
        return None;
    }
    // 64 points spread over the stripe make 64*63/2 candidate pairs: enough that the floor, with at least
    // MIN_SHARE of the points, is hit by some 40 pairs, and cheap enough for every frame (0.2 ms).
    let stride = points.len().div_ceil(64);
    let sample: Vec<PlanePointM> = points.iter().step_by(stride).copied().collect();
    let far = |a: PlanePointM, b: PlanePointM| (a.0 - b.0).abs() > 0.05;
    let mut best: Option<(f64, f64, f64)> = None; // (eta at xi = 0, slope, support)
    for (i, &a) in sample.iter().enumerate() {
        for &b in &sample[i + 1..] {
            if !far(a, b) {
                continue;
            }
            let slope = (b.1 - a.1) / (b.0 - a.0);
            let eta0 = a.1 - slope * a.0;
            let on = sample
                .iter()
                .filter(|p| (p.1 - eta0 - slope * p.0).abs() < ON_LINE_M)
                .count();
            let support = on as f64 / sample.len() as f64;
            if support < MIN_SHARE {
                continue;
            }
            let better = match best {
                None => true,
                // Lower by more than the tolerance wins; at the same level the better supported wins.
                Some((eta, _, s)) => {
                    eta0 < eta - ON_LINE_M || ((eta0 - eta).abs() <= ON_LINE_M && support > s)
                }
            };
            if better {
                best = Some((eta0, slope, support));
            }
        }
    }
    let (eta0, slope, _) = best?;
    let on: Vec<PlanePointM> = points
        .iter()
        .copied()
        .filter(|p| (p.1 - eta0 - slope * p.0).abs() < ON_LINE_M)
        .collect();
    let (eta0, slope) = least_squares(&on)?;
    let phi_rad = -slope.atan(); // slope = -tan phi (Eq. 4)
    Some(Floor {
        height_m: (h_centre_m - eta0) * phi_rad.cos(),
        phi_rad,
        share: on.len() as f64 / points.len() as f64,
    })
}

/// Least-squares line eta = eta0 + slope xi; `None` when all xi are equal.
fn least_squares(points: &[PlanePointM]) -> Option<(f64, f64)> {
    let n = points.len() as f64;
    let mean_xi = points.iter().map(|p| p.0).sum::<f64>() / n;
    let mean_eta = points.iter().map(|p| p.1).sum::<f64>() / n;
    let sxx: f64 = points.iter().map(|p| (p.0 - mean_xi).powi(2)).sum();
    let sxy: f64 = points
        .iter()
        .map(|p| (p.0 - mean_xi) * (p.1 - mean_eta))
        .sum();
    (sxx > 0.0).then(|| {
        let slope = sxy / sxx;
        (mean_eta - slope * mean_xi, slope)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A stripe of 500 points over a floor with a 0.30 m wide slab of the given height.
    fn stripe(height_m: f64, phi_rad: f64, slab_m: f64, noise_m: f64) -> Vec<PlanePointM> {
        (0..500)
            .map(|i| {
                let xi = -0.28 + 0.56 * f64::from(i) / 499.0;
                let scatter = noise_m * f64::from((i * 7919) % 13 - 6) / 6.0;
                let raised = if xi.abs() < 0.15 { slab_m } else { 0.0 };
                (
                    xi,
                    0.68 - height_m / phi_rad.cos() - xi * phi_rad.tan() + raised + scatter,
                )
            })
            .collect()
    }

    proptest! {
        #[test]
        fn height_and_roll_come_out_with_and_without_a_target(
            height in 0.5f64..0.95, phi in -0.2f64..0.2, slab in prop_oneof![Just(0.0), Just(0.02), Just(0.04)],
        ) {
            let found = floor(&stripe(height, phi, slab, 0.0003), 0.68).unwrap();
            prop_assert!((found.height_m - height).abs() < 0.002, "{found:?}");
            prop_assert!((found.phi_rad - phi).abs() < 0.005, "{found:?}");
        }

        #[test]
        fn any_points_are_survived(points in prop::collection::vec((any::<f64>(), any::<f64>()), 0..200)) {
            let _ = floor(&points, 0.68);
        }
    }

    #[test]
    fn a_handful_of_particles_is_no_floor() {
        // A linear congruential generator's high bits: points without lines in them, the same on every run.
        let mut state = 1u64;
        let points: Vec<_> = (0..100)
            .map(|i| {
                state = state
                    .wrapping_mul(6364136223846793005)
                    .wrapping_add(1442695040888963407);
                (
                    f64::from(i) * 0.005,
                    (state >> 40) as f64 / (1u64 << 24) as f64,
                )
            })
            .collect();
        assert_eq!(floor(&points, 0.68), None);
        assert_eq!(floor(&points[..5], 0.68), None);
    }
}
