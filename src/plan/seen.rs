//! What the camera sees of a target: where the lit line crosses its long edges, in the fan and in the image.

use hydroline_rigs::Rig;
use hydroline_rigs::{SlabOutline, Target};

/// A target's extent in its own frame \[m\].
#[derive(Debug, Clone, Copy)]
pub(crate) struct Extent {
    pub x0_m: f64,
    pub x1_m: f64,
    /// Full width of its widest slab.
    pub width_m: f64,
}

impl Extent {
    pub fn of(target: &Target) -> Option<Extent> {
        let of = |outline: &SlabOutline| match outline {
            SlabOutline::Rectangle {
                x0_m,
                x1_m,
                width_m,
            } => Extent {
                x0_m: *x0_m,
                x1_m: *x1_m,
                width_m: *width_m,
            },
            // A regular hexagon with its joints across X is sqrt(3) sides long and two sides wide (geometry.md).
            SlabOutline::HexagonChain {
                x0_m,
                side_m,
                count,
            } => Extent {
                x0_m: *x0_m,
                x1_m: x0_m + f64::from(*count) * 3f64.sqrt() * side_m,
                width_m: 2.0 * side_m,
            },
            SlabOutline::Polygon { points_m } => Extent {
                x0_m: points_m.iter().map(|p| p[0]).fold(f64::INFINITY, f64::min),
                x1_m: points_m
                    .iter()
                    .map(|p| p[0])
                    .fold(f64::NEG_INFINITY, f64::max),
                width_m: 2.0 * points_m.iter().map(|p| p[1].abs()).fold(0.0, f64::max),
            },
        };
        let all = target.slabs.iter().map(|s| of(&s.outline));
        all.reduce(|a, b| Extent {
            x0_m: a.x0_m.min(b.x0_m),
            x1_m: a.x1_m.max(b.x1_m),
            width_m: a.width_m.max(b.width_m),
        })
    }
}

/// Long edges of the target that the lit line crosses at a pose (x, y, z, phi, theta, psi) \[m, rad\], inside the fan and
/// the image: two show the centre line, one leaves an estimator with less than it needs in motion.
pub(crate) fn edges(rig: &Rig, extent: &Extent, eta: &[f64; 6]) -> u8 {
    let Some(target) = &rig.target else { return 0 };
    let (l_m, [x, y, z, phi, theta, psi]) = (rig.mounts.l_laser_m, *eta);
    // On the sheet (body x = l_laser), at body y, where the floor is: tank z = 0.
    let (sin_roll, cos_roll) = phi.sin_cos();
    let (sin_pitch, cos_pitch) = theta.sin_cos();
    let (sin_yaw, cos_yaw) = psi.sin_cos();
    let depth_m =
        |y_b: f64| -(z - sin_pitch * l_m + sin_roll * cos_pitch * y_b) / (cos_roll * cos_pitch);
    // R = Rz(psi) Ry(theta) Rx(phi), Fossen 2011, Eq. 2.18.
    let on_floor = |y_b: f64| {
        let z_b = depth_m(y_b);
        let ahead = cos_pitch * l_m + sin_pitch * (sin_roll * y_b + cos_roll * z_b);
        let across = cos_roll * y_b - sin_roll * z_b;
        (
            x + cos_yaw * ahead - sin_yaw * across,
            y + sin_yaw * ahead + cos_yaw * across,
        )
    };
    let [origin_x, origin_y, heading] = target.origin;
    let in_target = |y_b: f64| {
        let (x, y) = on_floor(y_b);
        let (x, y) = (x - origin_x, y - origin_y);
        (
            x * heading.cos() + y * heading.sin(),
            y * heading.cos() - x * heading.sin(),
        )
    };
    // Both coordinates are linear in body y.
    let (at_0, at_1) = (in_target(0.0), in_target(1.0));
    let crosses = |edge_m: f64| {
        let slope = at_1.1 - at_0.1;
        let y_b = (edge_m - at_0.1) / slope;
        if !y_b.is_finite() {
            return false;
        }
        let along = at_0.0 + y_b * (at_1.0 - at_0.0);
        let z_b = depth_m(y_b);
        (extent.x0_m..=extent.x1_m).contains(&along)
            && y_b.abs() <= z_b * (0.5 * rig.laser.fan_rad).tan()
            && in_image(rig, y_b, z_b)
    };
    let half_m = 0.5 * extent.width_m;
    u8::from(crosses(half_m)) + u8::from(crosses(-half_m))
}

/// Whether a point of the sheet is in the image of the rig's ideal camera.
fn in_image(rig: &Rig, y_b: f64, z_b: f64) -> bool {
    pixel(rig, y_b, z_b).is_some_and(|(column, row)| {
        let (width, height) = (rig.camera.width_px, rig.camera.height_px);
        (0.0..=f64::from(width) - 1.0).contains(&column)
            && (0.0..=f64::from(height) - 1.0).contains(&row)
    })
}

/// (column, row) of a point of the sheet \[px\]; `None` behind the camera.
fn pixel(rig: &Rig, y_b: f64, z_b: f64) -> Option<(f64, f64)> {
    let m = &rig.mounts;
    let (sin, cos) = m.camera_tilt_rad.sin_cos();
    let (ahead, down) = (m.l_laser_m + m.l_camera_m, z_b - m.h_camera_m);
    let depth = sin * ahead + cos * down;
    let up = cos * ahead - sin * down;
    let i = &rig.camera;
    (depth > 0.0).then(|| {
        (
            i.cx_px + i.fx_px * y_b / depth,
            i.cy_px - i.fy_px * up / depth,
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen(eta: [f64; 6]) -> u8 {
        let rig = Rig::builtin("lshpi").unwrap();
        let extent = Extent::of(rig.target.as_ref().unwrap()).unwrap();
        edges(&rig, &extent, &eta)
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

    #[test]
    fn the_image_agrees_with_the_maps() {
        let rig = Rig::builtin("lshpi").unwrap();
        let map = hydroline_calib::analytic::IdealMap::of(&rig);
        for (y_b, z_b) in [(0.0, 0.83), (0.15, 0.8), (-0.2, 0.95)] {
            let (column, row) = pixel(&rig, y_b, z_b).unwrap();
            let (xi, eta) = map.unlimited(column, row).unwrap();
            // The sheet's own coordinate points to port.
            assert!((xi + y_b).abs() < 1e-9, "{xi} {y_b}");
            let down = eta + rig.mounts.h_centre_m;
            assert!(
                (down - z_b).abs() < 1e-9 || (rig.mounts.h_centre_m - eta - z_b).abs() < 1e-9,
                "{eta} {z_b}"
            );
        }
    }
}
