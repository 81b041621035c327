//! How much of the sheet that the camera sees a calibration covers.
//!
//! A board may be covered whole and be half as large as the run: stripe points beyond it get no
//! coordinates, for no map extrapolates.

use super::{Setup, place};
use hydroline_calib::Calibration;
use hydroline_calib::plane::PlaneMap;

/// Places asked, along columns and along rows of a part of the image.
const PLACES: usize = 8;

/// The lit sheet in the image, in 3 × 3 parts, `parts[row][column]` as the image shows them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sheet {
    /// Share of each part's lit places that get coordinates; 1 where none is lit.
    pub parts: [[f64; 3]; 3],
    /// Share of all.
    pub share: f64,
}

impl Sheet {
    /// By the rig's camera and fan; `None` without a rig.
    pub fn of(setup: &Setup, calibration: &Calibration) -> Option<Self> {
        let rig = setup.rig.as_ref()?;
        let ideal = place::ideal(rig, setup.medium);
        let map = calibration.to_map();
        let size = [rig.camera.width_px, rig.camera.height_px].map(f64::from);
        let mut lit = [[0.0f64; 3]; 3];
        let mut covered = [[0.0f64; 3]; 3];
        for j in 0..3 * PLACES {
            for i in 0..3 * PLACES {
                let at = |k: usize, size: f64| (k as f64 + 0.5) / (3 * PLACES) as f64 * size - 0.5;
                let (column_px, row_px) = (at(i, size[0]), at(j, size[1]));
                if ideal.to_plane(column_px, row_px).is_none() {
                    continue;
                }
                lit[j / PLACES][i / PLACES] += 1.0;
                if map.to_plane(column_px, row_px).is_some() {
                    covered[j / PLACES][i / PLACES] += 1.0;
                }
            }
        }
        let sum = |parts: &[[f64; 3]; 3]| parts.iter().flatten().sum::<f64>();
        Some(Sheet {
            parts: std::array::from_fn(|j| {
                std::array::from_fn(|i| {
                    if lit[j][i] > 0.0 {
                        covered[j][i] / lit[j][i]
                    } else {
                        1.0
                    }
                })
            }),
            share: sum(&covered) / sum(&lit).max(1.0),
        })
    }

    /// Parts of which less than half is covered.
    pub fn missing(&self) -> Vec<&'static str> {
        const NAMES: [[&str; 3]; 3] = [
            ["upper left", "top", "upper right"],
            ["left", "middle", "right"],
            ["lower left", "bottom", "lower right"],
        ];
        let parts = self.parts.iter().flatten();
        parts
            .zip(NAMES.as_flattened())
            .filter(|(share, _)| **share < 0.5)
            .map(|(_, name)| *name)
            .collect()
    }

    /// In words.
    pub fn words(&self) -> String {
        let missing = self.missing();
        let beyond = if missing.is_empty() {
            String::new()
        } else {
            format!(
                "; uncovered, a stripe there gets no coordinates: {}",
                missing.join(", ")
            )
        };
        format!("{:.0} % of the sheet in view{beyond}", 100.0 * self.share)
    }
}
