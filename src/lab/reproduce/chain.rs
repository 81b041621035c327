//! One frame on its way, and the six formulas on it.

use super::{Motion, ReproduceError};
use hydroline_calib::IdealMap;
use hydroline_core::frame::GreyImage;
use hydroline_pose::Pose;
use hydroline_pose::estimators::{self, Chain, ChainFix, Crossing};
use hydroline_pose::joint::{Held, Hint, JointPose, PoseFitter};
use hydroline_pose::segments::{self, Levels, PlanePoint};
use hydroline_rigs::{Rig, Target};
use hydroline_sim::{Pose6, Renderer};
use hydroline_stripe::{Extractor, ExtractorConfig};
use rayon::prelude::*;
use std::sync::Arc;

/// Method of reading the stripe.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Reading {
    /// Central pixel, single points: the paper's.
    WholePixel,
    /// Sub-pixel, all points.
    SubPixel,
}

/// Readings of a frame that motions are estimated from.
#[derive(Debug, Clone)]
pub(super) struct Seen {
    pub levels: Option<Levels>,
    /// η at ξ = 0 and roll, as this reading measures them.
    pub line: Option<(f64, f64)>,
    pub crossing: Option<Crossing>,
    pub joint: Option<JointPose>,
}

/// Renders and reads frames of one rig.
pub(super) struct Bench {
    pub rig: Rig,
    pub fitter: PoseFitter,
    pub chain: Option<Chain>,
    renderer: Renderer,
    heights_m: Vec<f64>,
}

impl Bench {
    /// The rig of the paper for a motion: hexagons, the sway board, or a bare floor.
    pub fn of(motion: Motion) -> Result<Self, ReproduceError> {
        let mut rig = Rig::builtin("lshpi")?;
        match motion {
            Motion::Surge | Motion::Yaw => {}
            Motion::Sway => rig.target = Some(Target::load_or_builtin("sway-board")?),
            Motion::Heave | Motion::Roll | Motion::Pitch => rig.target = None,
        }
        Self::new(rig)
    }

    pub fn new(rig: Rig) -> Result<Self, ReproduceError> {
        let fitter = PoseFitter::new(&rig, Arc::new(IdealMap::of(&rig)));
        Ok(Bench {
            chain: rig.target.as_ref().and_then(Chain::new),
            renderer: Renderer::new(&rig)?,
            heights_m: fitter.surfaces().heights_m(),
            fitter,
            rig,
        })
    }

    /// Renders poses and reads their stripes, in parallel; the result does not depend on the number of threads.
    pub fn see(&self, poses: &[Pose], reading: Reading, joint: Option<Held>) -> Vec<Seen> {
        let config = ExtractorConfig {
            whole_pixel: reading == Reading::WholePixel,
            ..ExtractorConfig::default()
        };
        poses
            .par_iter()
            .enumerate()
            .map_init(
                || Extractor::new(config.clone()),
                |extractor, (index, pose)| {
                    self.see_one(extractor, pose, index as u64, reading, joint)
                },
            )
            .collect()
    }

    /// The paper's images, from OpenGL, hold no noise; nor do those that are read as in the paper.
    fn pixels(&self, pose: &Pose6, index: u64, reading: Reading) -> Vec<u8> {
        match reading {
            Reading::WholePixel => {
                let ambient = self.rig.camera.noise.ambient;
                let level = |light: f32| (f64::from(light) + ambient).round().clamp(0.0, 255.0);
                let light = self.renderer.render_clean(pose);
                light.into_iter().map(|v| level(v) as u8).collect()
            }
            Reading::SubPixel => self.renderer.render(pose, index).0,
        }
    }

    fn see_one(
        &self,
        extractor: &mut Extractor,
        pose: &Pose,
        index: u64,
        reading: Reading,
        joint: Option<Held>,
    ) -> Seen {
        let image = GreyImage {
            width_px: self.renderer.width_px(),
            height_px: self.renderer.height_px(),
            pixels: self.pixels(&Pose6::from(pose.to_array()), index, reading),
        };
        let profile = extractor.extract(&image);
        let points = segments::plane_points(&profile, self.fitter.map());
        let mut levels =
            segments::sort(&points, &self.heights_m, Some(&image), self.fitter.map()).ok();
        if reading == Reading::WholePixel {
            // The paper's discontinuity points: the last whole column that is still lit by half.
            for step in levels.iter_mut().flat_map(|l| &mut l.steps) {
                step.column_px = step.column_px.round();
                if let Some(row) = self
                    .fitter
                    .map()
                    .to_image(step.xi_m, step.eta_m)
                    .map(|(_, row)| row.round())
                    && let Some(p) = self.fitter.map().to_plane(step.column_px, row)
                {
                    (step.xi_m, step.eta_m) = (p.xi_m, p.eta_m);
                }
            }
        }
        let line = match reading {
            Reading::SubPixel => levels
                .as_ref()
                .map(|l| (l.eta0_m, estimators::roll_rad(l).value)),
            Reading::WholePixel => single_points(&points),
        };
        let joint = joint.and_then(|held| {
            self.fitter
                .fit(
                    &image,
                    &profile,
                    &Hint {
                        x_m: Some(pose.x_m),
                        held,
                    },
                )
                .ok()
        });
        Seen {
            crossing: levels.as_ref().map(|l| Crossing::new(l, &self.heights_m)),
            levels,
            line,
            joint,
        }
    }

    /// Answer of the paper's formula for `seen` against `first`, SI; `None` where it has none.
    /// `actual` is used for continuity (which hexagon) alone; `psi_s_rad` = yaw of the path.
    pub fn formula(
        &self,
        motion: Motion,
        seen: &Seen,
        first: &Seen,
        actual: &Pose,
        start: &Pose,
        psi_s_rad: f64,
    ) -> Option<f64> {
        let mounts = &self.rig.mounts;
        match motion {
            Motion::Heave => Some(seen.line?.0 - first.line?.0),
            Motion::Roll => Some(seen.line?.1 - first.line?.1),
            Motion::Pitch => {
                let mut levels = seen.levels.clone()?;
                levels.eta0_m = seen.line?.0;
                let level_m = start.level_in_plane(mounts, 0.0)?.eta_at_zero_m;
                Some(estimators::pitch_rad(&levels, level_m, mounts).ok()?.value)
            }
            Motion::Sway => Some(
                estimators::sway_m(&seen.crossing?, &first.crossing?)
                    .ok()?
                    .value,
            ),
            Motion::Surge => {
                let chain = self.chain.as_ref()?;
                let place = |s: &Seen, p: &Pose| {
                    chain.place_at_yaw(
                        &s.crossing?,
                        psi_s_rad,
                        p.x_m + mounts.l_laser_m * p.psi_rad.cos(),
                    )
                };
                Some((place(seen, actual)? - place(first, start)?) * psi_s_rad.cos())
            }
            Motion::Yaw => {
                Some(self.fix(seen, actual)?.psi_s_rad - self.fix(first, start)?.psi_s_rad)
            }
        }
    }

    /// ψ_S and X_S, on the hexagon where continuity puts the vehicle.
    pub fn fix(&self, seen: &Seen, near: &Pose) -> Option<ChainFix> {
        let l = self.rig.mounts.l_laser_m;
        let (sin, cos) = near.psi_rad.sin_cos();
        let x_s_m = near.x_m + l * cos + (near.y_m + l * sin) * near.psi_rad.tan();
        self.chain
            .as_ref()?
            .fix(&seen.crossing?, (x_s_m, near.psi_rad))
            .ok()
    }
}

/// The paper's reading of a bare floor line: η at the column nearest ξ = 0, roll from its two ends (Eq. 4).
fn single_points(points: &[PlanePoint]) -> Option<(f64, f64)> {
    let middle = points
        .iter()
        .min_by(|a, b| a.xi_m.abs().total_cmp(&b.xi_m.abs()))?;
    let sound: Vec<&PlanePoint> = points.iter().filter(|p| p.sound).collect();
    let (a, b) = (sound.first()?, sound.last()?);
    // (η_B − η_A) / (ξ_A − ξ_B), A to port.
    Some((
        middle.eta_m,
        ((b.eta_m - a.eta_m) / (a.xi_m - b.xi_m)).atan(),
    ))
}
