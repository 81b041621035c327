//! Where the board stood in the sheet's coordinates.
//!
//! A board says where things are on the board. Where it hangs in the sheet someone measures
//! (`--at`), or the rig's mounts and camera numbers say: every node's pixel goes through Eqs. 11-12,
//! and the rigid motion that brings the board's nodes nearest to these points is the placement.
//! It shifts and turns all coordinates alike and changes no length.

use super::Setup;
use hydroline_calib::board::coplanarity::Coplanarity;
use hydroline_calib::calibration::board_map::Placement;
use hydroline_calib::map::Node;
use hydroline_calib::{IdealMap, Medium};
use hydroline_rigs::Rig;
use nalgebra::{Rotation2, Vector2};

/// Source of the board's place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PlacedBy {
    /// Measured by a person.
    Given,
    /// The rig's mounts and camera numbers; what they leave at the nodes \[m\], rms.
    Rig {
        /// rms distance of the nodes from where the rig's numbers put them \[m\].
        rms_m: f64,
        /// Factor by which the board looks larger than its file says, by the rig's numbers.
        scale: f64,
    },
    /// Nobody: coordinates count from the board's middle.
    Nobody,
}

/// Pitch against the file's by the rig's numbers: more apart than this share is another board. The
/// rig's focal length and mounts are as good as that, or they could not plan a run.
const ANOTHER_BOARD: f64 = 0.1;

/// More than this \[m\] and the rig's numbers describe another camera.
const MISFIT_M: f64 = 5e-3;

impl PlacedBy {
    /// In words.
    pub fn words(&self) -> String {
        match self {
            PlacedBy::Given => "as measured (--at)".to_owned(),
            PlacedBy::Rig { rms_m, .. } if *rms_m > MISFIT_M => format!(
                "from the rig's mounts and camera numbers, which miss the board's nodes by {:.1} mm rms: too much, measure it and give --at",
                1e3 * rms_m
            ),
            PlacedBy::Rig { rms_m, .. } => format!(
                "from the rig's mounts and camera numbers ({:.2} mm rms at the nodes)",
                1e3 * rms_m
            ),
            PlacedBy::Nobody => {
                "nobody said: coordinates count from the board's middle; give --rig or --at"
                    .to_owned()
            }
        }
    }
}

impl PlacedBy {
    /// In words, where the rig's numbers and the board file cannot both be right.
    pub fn wrong_scale(&self, pitch_m: f64) -> Option<String> {
        match self {
            PlacedBy::Rig { scale, .. } if (scale - 1.0).abs() > ANOTHER_BOARD => Some(format!(
                "by the rig's camera the board's pitch is {:.1} mm, its file says {:.1}: give the file of the board in the tank (--board), correct [camera] fx_px, [mounts] and [tank] n_water of the rig (with n_water of water, fx_px is that in air), or say where it stands (--at)",
                1e3 * pitch_m * scale,
                1e3 * pitch_m
            )),
            _ => None,
        }
    }
}

/// Camera in the board's frame: ξ, η, distance from the face \[m\].
pub(super) fn camera_m(rig: &Rig, placement: &Placement) -> [f64; 3] {
    let m = &rig.mounts;
    let in_sheet = Vector2::new(0.0, m.h_centre_m - m.h_camera_m);
    let from_middle = in_sheet - Vector2::new(placement.xi_m, placement.eta_m);
    let at = Rotation2::new(-placement.turn_rad) * from_middle;
    [at[0], at[1], m.l_laser_m + m.l_camera_m]
}

/// The rig's ideal camera as it sees in that medium. Eqs. 11-12 know no port: behind one, in water, a
/// camera sees as with a longer lens.
pub(super) fn ideal(rig: &Rig, medium: Medium) -> IdealMap {
    let mut seen = rig.clone();
    if rig.tank.n_water > 1.1 && medium != Medium::Air {
        seen.camera.fx_px *= rig.tank.n_water;
        seen.camera.fy_px *= rig.tank.n_water;
    }
    IdealMap::of(&seen)
}

/// Where the board stands. `gap`: the nodes lie on the face; the rays through them meet the sheet elsewhere.
pub(super) fn place(
    setup: &Setup,
    nodes: &[Node],
    gap: Option<&Coplanarity>,
) -> (Placement, PlacedBy) {
    if let Some(at) = setup.at {
        return (at, PlacedBy::Given);
    }
    let nobody = (Placement::default(), PlacedBy::Nobody);
    let Some(rig) = &setup.rig else { return nobody };
    let ideal = ideal(rig, setup.medium);
    let pairs: Vec<(Vector2<f64>, Vector2<f64>)> = nodes
        .iter()
        .filter_map(|n| {
            let (xi, eta) = ideal.unlimited(n.column_px, n.row_px)?;
            let on_board = match gap {
                Some(gap) => gap.face_to_sheet(n.xi_m, n.eta_m),
                None => [n.xi_m, n.eta_m],
            };
            Some((Vector2::from(on_board), Vector2::new(xi, eta)))
        })
        .collect();
    if pairs.len() < 3 {
        return nobody;
    }
    let count = pairs.len() as f64;
    let mean = pairs
        .iter()
        .fold((Vector2::zeros(), Vector2::zeros()), |s, p| {
            (s.0 + p.0 / count, s.1 + p.1 / count)
        });
    // Closest rigid motion in the plane: angle of the summed cross and dot products.
    let (mut cross, mut dot, mut size) = (0.0, 0.0, 0.0);
    for (p, q) in &pairs {
        let (p, q) = (p - mean.0, q - mean.1);
        cross += p[0] * q[1] - p[1] * q[0];
        dot += p.dot(&q);
        size += p.norm_squared();
    }
    let turn = Rotation2::new(cross.atan2(dot));
    let shift = mean.1 - turn * mean.0;
    let square: f64 = pairs
        .iter()
        .map(|(p, q)| (turn * p + shift - q).norm_squared())
        .sum();
    (
        Placement {
            xi_m: shift[0],
            eta_m: shift[1],
            turn_rad: turn.angle(),
            is_by_rig: true,
        },
        PlacedBy::Rig {
            rms_m: (square / count).sqrt(),
            // Of the closest similar motion.
            scale: dot.hypot(cross) / size.max(f64::MIN_POSITIVE),
        },
    )
}
