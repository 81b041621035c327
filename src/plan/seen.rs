//! Target as the camera sees it: where the lit line crosses its long edges, and whether the map to the laser plane holds there.

use hydroline_calib::plane::PlaneMap;
use hydroline_rigs::Rig;
use hydroline_rigs::{Slab, SlabOutline, Target};

/// A target's extent in its own frame \[m\].
#[derive(Debug, Clone, Copy)]
pub(crate) struct Extent {
    pub x0_m: f64,
    pub x1_m: f64,
    /// Full width of its widest slab.
    pub width_m: f64,
    /// Height of that slab's top above the floor.
    pub top_m: f64,
}

impl Extent {
    pub fn of(target: &Target) -> Option<Extent> {
        let of = |slab: &Slab| match &slab.outline {
            SlabOutline::Rectangle {
                x0_m,
                x1_m,
                width_m,
            } => Extent {
                x0_m: *x0_m,
                x1_m: *x1_m,
                width_m: *width_m,
                top_m: slab.top_m,
            },
            // A regular hexagon with its joints across X is sqrt(3) sides long and two sides wide (theory/geometry.md, target).
            SlabOutline::HexagonChain {
                x0_m,
                side_m,
                count,
            } => Extent {
                x0_m: *x0_m,
                x1_m: x0_m + f64::from(*count) * 3f64.sqrt() * side_m,
                width_m: 2.0 * side_m,
                top_m: slab.top_m,
            },
            SlabOutline::Polygon { points_m } => Extent {
                x0_m: points_m.iter().map(|p| p[0]).fold(f64::INFINITY, f64::min),
                x1_m: points_m
                    .iter()
                    .map(|p| p[0])
                    .fold(f64::NEG_INFINITY, f64::max),
                width_m: 2.0 * points_m.iter().map(|p| p[1].abs()).fold(0.0, f64::max),
                top_m: slab.top_m,
            },
        };
        let all = target.slabs.iter().map(of);
        all.reduce(|a, b| Extent {
            x0_m: a.x0_m.min(b.x0_m),
            x1_m: a.x1_m.max(b.x1_m),
            width_m: a.width_m.max(b.width_m),
            top_m: if a.width_m >= b.width_m {
                a.top_m
            } else {
                b.top_m
            },
        })
    }
}

/// Floor and target beside an edge that have to be seen \[m\]: a step shows by what lies on both sides of it.
const BESIDE_M: f64 = 0.01;

/// Long edges of the target that the lit line crosses at a pose (x, y, z, phi, theta, psi) \[m, rad\] where the map holds
/// (fan, image, region that a board has calibrated): two show the centre line, one leaves an estimator with less than it
/// needs in motion.
pub(crate) fn edges(rig: &Rig, map: &dyn PlaneMap, extent: &Extent, eta: &[f64; 6]) -> u8 {
    let Some(target) = &rig.target else { return 0 };
    let (l_m, [x, y, z, phi, theta, psi]) = (rig.mounts.l_laser_m, *eta);
    let (sin_roll, cos_roll) = phi.sin_cos();
    let (sin_pitch, cos_pitch) = theta.sin_cos();
    let (sin_yaw, cos_yaw) = psi.sin_cos();
    let (sin_heading, cos_heading) = target.origin[2].sin_cos();
    // On the sheet (body x = l_laser), at body y, `above_m` over the floor: tank z = -above.
    let depth_m = |y_b: f64, above_m: f64| {
        -(above_m + z - sin_pitch * l_m + sin_roll * cos_pitch * y_b) / (cos_roll * cos_pitch)
    };
    // R = Rz(psi) Ry(theta) Rx(phi), Fossen 2011, Eq. 2.18.
    let in_target = |y_b: f64, above_m: f64| {
        let z_b = depth_m(y_b, above_m);
        let ahead = cos_pitch * l_m + sin_pitch * (sin_roll * y_b + cos_roll * z_b);
        let across = cos_roll * y_b - sin_roll * z_b;
        let x = x + cos_yaw * ahead - sin_yaw * across - target.origin[0];
        let y = y + sin_yaw * ahead + cos_yaw * across - target.origin[1];
        (
            x * cos_heading + y * sin_heading,
            y * cos_heading - x * sin_heading,
        )
    };
    let shows = |at_m: f64, above_m: f64| {
        // Both coordinates are linear in body y.
        let (at_0, at_1) = (in_target(0.0, above_m), in_target(1.0, above_m));
        let y_b = (at_m - at_0.1) / (at_1.1 - at_0.1);
        if !y_b.is_finite() {
            return false;
        }
        let along = at_0.0 + y_b * (at_1.0 - at_0.0);
        // The sheet's own coordinates: to port, and up from its origin.
        let (xi_m, eta_m) = (-y_b, rig.mounts.h_centre_m - depth_m(y_b, above_m));
        (extent.x0_m..=extent.x1_m).contains(&along) && map.to_image(xi_m, eta_m).is_some()
    };
    let half_m = 0.5 * extent.width_m;
    let crosses = |side: f64| {
        shows(side * (half_m + BESIDE_M), 0.0) && shows(side * (half_m - BESIDE_M), extent.top_m)
    };
    u8::from(crosses(1.0)) + u8::from(crosses(-1.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use hydroline_calib::analytic::IdealMap;

    fn seen(eta: [f64; 6]) -> u8 {
        let rig = Rig::builtin("lshpi").unwrap();
        let extent = Extent::of(rig.target.as_ref().unwrap()).unwrap();
        edges(&rig, &IdealMap::of(&rig), &extent, &eta)
    }

    #[test]
    fn both_edges_are_seen_over_the_middle_and_one_beside_it() {
        assert_eq!(seen([0.3, 0.0, -0.83, 0.0, 0.0, 0.0]), 2);
        assert_eq!(seen([0.3, 0.28, -0.83, 0.0, 0.0, 0.0]), 1);
        assert_eq!(seen([0.3, -0.28, -0.83, 0.0, 0.0, 0.0]), 1);
        assert_eq!(seen([0.3, 0.6, -0.83, 0.0, 0.0, 0.0]), 0);
        assert_eq!(seen([3.0, 0.0, -0.83, 0.0, 0.0, 0.0]), 0);
    }

    #[test]
    fn a_vehicle_too_high_or_too_low_has_the_line_out_of_its_image() {
        assert_eq!(seen([0.3, 0.0, -1.3, 0.0, 0.0, 0.0]), 0);
        assert_eq!(seen([0.3, 0.0, -0.4, 0.0, 0.0, 0.0]), 0);
    }

    #[test]
    fn roll_moves_the_line_to_the_side_and_pitch_along() {
        // At 0.83 m a roll of 0.25 rad moves the foot by 0.21 m, and one edge out of the fan.
        assert_eq!(seen([0.3, 0.0, -0.83, 0.25, 0.0, 0.0]), 1);
        assert_eq!(seen([0.3, 0.2, -0.83, 0.25, 0.0, 0.0]), 2);
        assert_eq!(seen([1.1, 0.0, -0.83, 0.0, 0.0, 0.0]), 0);
        // Nose up moves the sheet's foot forward.
        assert_eq!(seen([0.95, 0.0, -0.83, 0.0, 0.0, 0.0]), 2);
        assert_eq!(seen([0.95, 0.0, -0.83, 0.0, 0.15, 0.0]), 0);
    }
}
