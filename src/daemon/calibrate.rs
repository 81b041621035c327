//! From images of a board to a calibration: offline over images and logs, and live in the daemon.
//!
//! The crate `calib` detects, fits and judges; this module adds what the rig knows (where the camera
//! stands, how thick the sheet is, what size of misfit matters) and sorts frames into poses of the board.
//! No I/O and no clock: images in, words and messages out.
//!
//! - [`Setup`]: what is looked for and under which conditions;
//! - [`see`]: one image; [`Pose`], [`Poses`]: what many images of a standing board say together;
//! - [`live`]: the same frame by frame while recording; [`message`]: as the log holds it;
//! - [`medium`]: air, fresh or salt water, and what may be used where.

pub mod live;
pub mod medium;
pub mod message;
mod place;
mod sheet;

pub use place::PlacedBy;
pub use sheet::Sheet;

use hydroline_calib::board::coplanarity::{Coplanarity, GaugeOptions, measure};
use hydroline_calib::calibration::board_map::{Placement, Provenance};
use hydroline_calib::detect::{Detection, Grey, NotFound, detect, detect_quick};
use hydroline_calib::map::refractive::Known;
use hydroline_calib::map::{FitOptions, Method, Node, RefractivePrior, fit};
use hydroline_calib::online::{OnlineCalibration, OnlineOptions, Status};
use hydroline_calib::{Calibration, ImageSize, Medium};
use hydroline_core::frame::GreyImage;
use hydroline_rigs::{Board, FlatPort, Rig};

/// The map may spend a quarter of what the rig tolerates: pose and stripe need the rest.
const SHARE_OF_TOLERANCE: f64 = 0.25;
/// Tolerance of a map without a rig \[m\]: a quarter of the rig file's default of 2 mm.
const TOLERANCE_M: f64 = 0.5e-3;
/// Prior sd of the sheet's thickness, as a share of it.
const SHEET_SIGMA_SD: f64 = 0.1;

/// A port where rig and arguments name none: a usual one.
const PORT: FlatPort = FlatPort {
    distance_m: 0.03,
    glass_m: 0.01,
};

/// Board to look for, and the conditions.
#[derive(Debug, Clone, PartialEq)]
pub struct Setup {
    /// The board in the sheet.
    pub board: Board,
    /// Map to fit.
    pub method: Method,
    /// Medium that the light goes through.
    pub medium: Medium,
    /// The rig, if known: without one nothing is said about the board's distance from the sheet.
    pub rig: Option<Rig>,
    /// Where the board's middle stands, if someone measured it.
    pub at: Option<Placement>,
    /// Port of a `refractive` map.
    pub port: FlatPort,
    /// Frames at least before a calibration is accepted.
    pub frames: u32,
    /// A gap between board and sheet that nobody measured is accepted (a board without blocks).
    pub accept_unknown_gap: bool,
}

impl Setup {
    /// A setup with a homography map, accepted after 5 frames.
    pub fn new(board: Board, medium: Medium, rig: Option<Rig>) -> Self {
        Setup {
            board,
            method: Method::Homography,
            medium,
            at: None,
            port: rig.as_ref().and_then(|r| r.port).unwrap_or(PORT),
            rig,
            frames: 5,
            accept_unknown_gap: false,
        }
    }

    /// Largest standard deviation of the map that is accepted \[m\].
    pub fn tolerance_m(&self) -> f64 {
        self.rig.as_ref().map_or(TOLERANCE_M, |rig| {
            SHARE_OF_TOLERANCE * rig.tolerance.position_m
        })
    }

    fn fit_options(&self) -> FitOptions {
        FitOptions {
            image: self.rig.as_ref().map(|rig| ImageSize::of(&rig.camera)),
            refractive: self.rig.as_ref().map(|rig| self.prior(rig)),
        }
    }

    /// Prior of camera, port and water, from the rig file and a ruler.
    fn prior(&self, rig: &Rig) -> RefractivePrior {
        let n_water = medium::index(self.medium);
        // A rig without water of its own states the focal length as it works in the tank.
        let in_air = if rig.tank.n_water > 1.1 {
            rig.camera.fx_px
        } else {
            rig.camera.fx_px / n_water.value
        };
        RefractivePrior {
            focal_px: Known::new(in_air, 0.05 * in_air),
            cx_px: Known::new(rig.camera.cx_px, 0.02 * f64::from(rig.camera.width_px)),
            cy_px: Known::new(rig.camera.cy_px, 0.02 * f64::from(rig.camera.width_px)),
            port_distance_m: Known::new(self.port.distance_m, 0.3 * self.port.distance_m),
            port_tilt_rad: Known::new(0.0, 0.01),
            glass_m: self.port.glass_m,
            n_glass: 1.49, // acrylic
            n_water,
            k1: Known::new(0.0, 0.3),
            k2: Known::new(0.0, 0.3),
        }
    }

    fn online(&self) -> OnlineCalibration {
        let options = OnlineOptions {
            method: self.method,
            fit: self.fit_options(),
            tolerance_m: self.tolerance_m(),
            frames: self.frames,
            accept_unknown_gap: self.accept_unknown_gap,
            ..OnlineOptions::default()
        };
        OnlineCalibration::new(self.board.clone(), options)
    }

    /// The gap where nobody could measure it.
    fn unknown_gap(&self, placement: &Placement) -> Coplanarity {
        match &self.rig {
            Some(rig) => Coplanarity::unknown("not looked at", place::camera_m(rig, placement)),
            None => {
                // As far away as the board is large: the usual proportion.
                let far = 0.5 * f64::from(self.board.rows) * self.board.pitch_m + 0.1;
                Coplanarity::unknown("no rig says where the camera stands", [0.0, far, far])
            }
        }
    }
}

/// A board seen in one image.
#[derive(Debug, Clone, PartialEq)]
pub struct Sighting {
    /// Its nodes.
    pub detection: Detection,
    /// Board against sheet, as far as this image shows it.
    pub gap: Option<Coplanarity>,
    /// Size of the image.
    pub image: ImageSize,
}

/// Looks for the board in one image; `reason` = also find out why there is none (several times as long).
///
/// # Errors
/// [`NotFound`]: the reason, or just that there is none.
pub fn see(setup: &Setup, image: &GreyImage, reason: bool) -> Result<Sighting, NotFound> {
    let Some(grey) = Grey::new(image.width_px, image.height_px, &image.pixels) else {
        return Err(NotFound::Empty {
            width: image.width_px,
            height: image.height_px,
            range: 0.0,
        });
    };
    let found = if reason {
        detect(&grey, &setup.board)
    } else {
        detect_quick(&grey, &setup.board)
    };
    let detection = found?;
    // Blocks are where the board's own order of nodes puts them.
    let known = setup
        .rig
        .as_ref()
        .filter(|_| detection.orientation.is_usable());
    let gap = known.and_then(|rig| {
        let nodes = detection.nodes();
        let options = FitOptions {
            image: Some(ImageSize::of(&rig.camera)),
            refractive: None,
        };
        let map = fit(Method::Homography, &nodes, &options).ok()?;
        let (placement, _) = place::place(setup, &nodes, None);
        let options = GaugeOptions {
            camera_m: place::camera_m(rig, &placement),
            sheet_sigma_m: [rig.laser.sigma_m, SHEET_SIGMA_SD * rig.laser.sigma_m],
            blur_px: detection.blur_px,
        };
        Some(measure(&grey, &setup.board, &map, &options))
    });
    Ok(Sighting {
        detection,
        gap,
        image: ImageSize {
            width_px: image.width_px as u32,
            height_px: image.height_px as u32,
        },
    })
}

/// One pose of the board: what all images of it say together.
#[derive(Debug, Clone)]
pub struct Pose {
    online: OnlineCalibration,
    status: Option<Status>,
    last: Option<Detection>,
    image: Option<ImageSize>,
}

impl Pose {
    /// Nothing seen yet.
    pub fn new(setup: &Setup) -> Self {
        Pose {
            online: setup.online(),
            status: None,
            last: None,
            image: None,
        }
    }

    /// Takes one image's board; a board that moved starts the average anew. What the rig's camera
    /// cannot have seen of this board is not accepted, however well its nodes fit.
    pub fn push(&mut self, setup: &Setup, sighting: Sighting) -> &Status {
        let mut status = self.online.push(&sighting.detection, sighting.gap);
        let (_, by) = place::place(setup, &self.nodes(), None);
        if let Some(words) = by.wrong_scale(setup.board.pitch_m) {
            status.accepted = false;
            status.missing.insert(0, words);
        }
        self.image = Some(sighting.image);
        self.last = Some(sighting.detection);
        self.status.insert(status)
    }

    /// Where it stands; `None` before the first image.
    pub fn status(&self) -> Option<&Status> {
        self.status.as_ref()
    }

    /// The newest detection.
    pub fn last(&self) -> Option<&Detection> {
        self.last.as_ref()
    }

    /// Averaged nodes.
    pub fn nodes(&self) -> Vec<Node> {
        self.online.nodes()
    }

    /// The calibration as it stands and what places it; `None` before a map fits.
    /// `date`: RFC 3339.
    pub fn calibration(&self, setup: &Setup, date: String) -> Option<(Calibration, PlacedBy)> {
        let made = |placement: Placement| {
            self.online.calibration(Provenance {
                medium: setup.medium,
                date: Some(date.clone()),
                board: setup.board.name.clone(),
                coplanarity: setup.unknown_gap(&placement),
                placement,
                image: self.image,
                missing: self
                    .status
                    .as_ref()
                    .map_or_else(Vec::new, |s| s.missing.clone()),
            })
        };
        // The gap moves the nodes a little: placed once more with what was measured.
        let (placement, _) = place::place(setup, &self.nodes(), None);
        let gap = made(placement)?.coplanarity;
        let (placement, by) = place::place(setup, &self.nodes(), gap.as_ref());
        Some((made(placement)?, by))
    }
}

/// Images sorted by the pose of the board.
#[derive(Debug, Clone, Default)]
pub struct Poses {
    /// In order of first appearance.
    pub poses: Vec<Pose>,
}

impl Poses {
    /// Takes one image's board to the pose it shows; answers with that pose's index. `None` for an
    /// image in which the key is hidden and that shows no pose whose nodes are known: it is not known
    /// which node is which, and nothing is guessed.
    pub fn push(&mut self, setup: &Setup, sighting: Sighting) -> Option<usize> {
        let recognised = (0..self.poses.len()).find_map(|k| {
            let detection = self.poses[k].online.recognise(&sighting.detection)?;
            Some((k, detection))
        });
        let index = match recognised {
            Some((index, detection)) => {
                let sighting = Sighting {
                    detection,
                    ..sighting
                };
                self.poses[index].push(setup, sighting);
                index
            }
            None if !sighting.detection.orientation.is_usable() => return None,
            None => {
                self.poses.push(Pose::new(setup));
                let index = self.poses.len() - 1;
                self.poses[index].push(setup, sighting);
                index
            }
        };
        Some(index)
    }

    /// The pose with the most nodes times images: the one to calibrate with.
    pub fn best(&self) -> Option<usize> {
        let worth = |pose: &Pose| {
            pose.status()
                .map_or((0, 0), |s| (s.nodes, s.frames as usize))
        };
        (0..self.poses.len()).max_by_key(|&k| {
            let (nodes, frames) = worth(&self.poses[k]);
            // Of equals the first.
            (nodes * frames.min(25), usize::MAX - k)
        })
    }
}

/// UNIX nanoseconds as RFC 3339, whole seconds, UTC.
pub fn rfc3339(unix_ns: u64) -> String {
    let at = std::time::UNIX_EPOCH + std::time::Duration::from_nanos(unix_ns);
    humantime::format_rfc3339_seconds(at).to_string()
}

#[cfg(test)]
mod tests;
