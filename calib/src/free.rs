//! Camera and laser sheet from boards held in the hand, with the line across them.
//!
//! A printed board is held so that the line crosses it, some fifteen times, near and far, tilted this way and that (Zhou
//! and Zhang 2005). One bundle adjustment then fits the camera, the port, every board's pose and the laser sheet.
//!
//! - [`camera`]: pinhole, Brown's lens, flat port; [`sheet`]: plane or weak cone;
//! - [`calibrate`]: views in, [`Fitted`] out, with what each view was worth;
//! - [`map`]: the map that the calibration file holds;

//!
//! Nodes and lines come from [`crate::detect`] (`detect_in_hand`, `find_line`).

mod adjust;
mod bundle;
pub mod camera;
mod checks;
mod fit;
pub mod intrinsics;
pub mod map;
mod residuals;
pub mod sheet;
mod start;
#[cfg(test)]
mod tests;

pub use bundle::Pose;
pub use checks::{FreeError, LeftOut, Reservation};
pub use fit::{Fitted, Held, ViewReport, calibrate};
pub use map::SheetMap;

use hydroline_rigs::Board;
use nalgebra::Matrix2;

use crate::detect::{InHand, LinePoint, NoLine};
use crate::map::refractive::Known;
use crate::plane::ImageSize;
use camera::{CAMERA, CENTRE, FOCAL, LENS, MEDIUM, PORT, Plate};

/// A node of a board: where it is and where it was seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SeenNode {
    /// On the board \[m\], from the node with index (0, 0).
    pub board_m: [f64; 2],
    /// Column and row \[px\].
    pub pixel: [f64; 2],
    /// Covariance of column and row \[px²\].
    pub covariance_px2: Matrix2<f64>,
}

/// One image of a board in the hand.
#[derive(Debug, Clone, PartialEq)]
pub struct Seen {
    /// Name of the image, for reports.
    pub name: String,
    /// Nodes found.
    pub nodes: Vec<SeenNode>,
    /// The line over the board; empty where none was found.
    pub line: Vec<LinePoint>,
    /// Why there is no line.
    pub no_line: Option<NoLine>,
    /// Point spread, standard deviation \[px\].
    pub blur_px: f64,
}

impl Seen {
    /// A board as it was detected, with the line looked for on it.
    pub fn new(
        name: String,
        board: &Board,
        found: &InHand,
        line: Result<Vec<LinePoint>, NoLine>,
    ) -> Self {
        let nodes = found.nodes.iter().map(|n| SeenNode {
            board_m: n.index.map(|k| f64::from(k) * board.pitch_m),
            pixel: n.pixel,
            covariance_px2: n.covariance_px2,
        });
        let (line, no_line) = match line {
            Ok(line) => (line, None),
            Err(why) => (Vec::new(), Some(why)),
        };
        Seen {
            name,
            nodes: nodes.collect(),
            line,
            no_line,
            blur_px: found.blur_px,
        }
    }
}

/// What is known of the camera before boards are seen; an infinite sd: nothing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraPrior {
    /// Of each number of [`camera`].
    pub numbers: [Known; CAMERA],
    /// Port; `None` = the camera looks straight into the medium.
    pub plate: Option<Plate>,
    /// Whether focal length and lens are known from elsewhere (`--intrinsics`).
    pub imported: bool,
}

/// Prior sds of a camera of which only the image's size is known.
///
/// Priors of a lens are those of lenses that Brown's polynomial describes: k₁ from −0.5 to 0.5, tangential numbers of a
/// hundredth. A principal point off by more than a tenth of the width is another crop, not another lens.
const UNKNOWN: [(usize, f64); 8] = [
    (camera::ASPECT, 0.1),
    (LENS, 0.3),
    (LENS + 1, 0.3),
    (LENS + 2, 0.005),
    (LENS + 3, 0.005),
    (LENS + 4, 0.3),
    (PORT + 1, 0.01),
    (PORT + 2, 0.01),
];
/// Sd of the principal point as a share of the width.
const CENTRE_SD: f64 = 0.05;

impl CameraPrior {
    /// Of a camera of which only its image's size is known, in a medium of that index.
    pub fn unknown(image: ImageSize, medium: Known) -> Self {
        let mut numbers = [Known::new(0.0, 0.0); CAMERA];
        let width = f64::from(image.width_px);
        numbers[FOCAL] = Known::new(width, f64::INFINITY);
        numbers[camera::ASPECT].value = 1.0;
        for (k, pixels) in [image.width_px, image.height_px].into_iter().enumerate() {
            numbers[CENTRE + k] = Known::new(0.5 * (f64::from(pixels) - 1.0), CENTRE_SD * width);
        }
        for (k, sd) in UNKNOWN {
            numbers[k].sd = sd;
        }
        numbers[MEDIUM] = medium;
        CameraPrior {
            numbers,
            plate: None,
            imported: false,
        }
    }

    /// The same behind a port at that distance.
    pub fn behind(mut self, plate: Plate, distance_m: Known) -> Self {
        self.plate = Some(plate);
        self.numbers[PORT] = distance_m;
        self
    }
}

/// Options of [`calibrate`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FreeOptions {
    /// Size of the images.
    pub image: ImageSize,
    /// What is known of the camera.
    pub camera: CameraPrior,
    /// Fewest boards. Default 5: three poses fix a camera (Zhang 2000), the others say whether it is true.
    pub fewest_boards: usize,
    /// Fewest boards with a line. Default 3: two fix a plane, the third says whether it is one.
    pub fewest_lines: usize,
    /// A board is left out where it leaves so many times what the others leave. Default 4.
    pub misfit: f64,
    /// Every so many boards one is predicted from the others. Default 4; 0 = none.
    pub hold_out_every: usize,
}

impl FreeOptions {
    /// Defaults.
    pub fn new(image: ImageSize, camera: CameraPrior) -> Self {
        FreeOptions {
            image,
            camera,
            fewest_boards: 5,
            fewest_lines: 3,
            misfit: 4.0,
            hold_out_every: 4,
        }
    }
}
