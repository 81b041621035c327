//! Poses of single frames under a refined geometry.

use super::{Geometry, Refined, rotated};
use crate::joint::{JointPose, Matrix7, PoseFitter};
use crate::photometric::State;
use hydroline_calib::Pose;
use nalgebra::Rotation3;
use std::sync::Arc;

/// Step by which the attitude's derivatives are taken \[rad\].
const STEP_RAD: f64 = 1e-6;

/// Sheet as a run has shown it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::joint) struct Sheet {
    /// Thickness with its sd \[m\].
    pub thickness_m: Option<[f64; 2]>,
    /// From the body to the frame in which the sheet stands upright.
    turn: Option<Rotation3<f64>>,
}

impl PoseFitter {
    /// The same fitter for a refined geometry: the sheet stands as it was found, and its thickness is
    /// known to its sd, which goes into each pose's covariance. What the tilt's own sd moves is
    /// not in there: it moves all poses of the run alike.
    pub fn refined(&self, refined: &Refined) -> PoseFitter {
        let Geometry { thickness_m, .. } = refined.geometry;
        let wanted = refined.wanted;
        let sheet = Sheet {
            thickness_m: wanted
                .thickness
                .then(|| [thickness_m, refined.covariance[(2, 2)].sqrt()]),
            turn: wanted.tilt.then(|| refined.geometry.turn()),
        };
        let model = if wanted.tilt {
            self.tilted(refined.geometry)
        } else {
            self.model.as_ref().clone()
        };
        PoseFitter {
            bare: Arc::new(model.bare()),
            model: Arc::new(model),
            thickness_m: if wanted.thickness {
                thickness_m
            } else {
                self.thickness_m
            },
            sheet,
            ..self.clone()
        }
    }

    /// The same with the thickness open again: for [`crate::smooth`], which binds it over the run itself.
    pub fn with_thickness_open(&self) -> PoseFitter {
        PoseFitter {
            sheet: Sheet {
                thickness_m: None,
                ..self.sheet
            },
            ..self.clone()
        }
    }
}

impl Sheet {
    /// As the rig says.
    pub const AS_THE_RIG: Sheet = Sheet {
        thickness_m: None,
        turn: None,
    };

    /// A start with the body's pose, as the frame sees it in which the sheet stands upright.
    pub fn upright(&self, state: State) -> State {
        match &self.turn {
            None => state,
            Some(turn) => State {
                pose: rotated(&state.pose, &turn.inverse()),
                ..state
            },
        }
    }

    /// The body's pose and covariance.
    pub fn of_body(&self, fit: JointPose) -> JointPose {
        let Some(turn) = &self.turn else { return fit };
        let pose = rotated(&fit.pose, turn);
        // The attitude changes its angles; the place stays.
        let mut slopes = Matrix7::identity();
        for k in 3..6 {
            let moved = |by: f64| {
                let mut p = fit.pose.to_array();
                p[k] += by;
                rotated(&Pose::from_array(p), turn).to_array()
            };
            let (on, back) = (moved(STEP_RAD), moved(-STEP_RAD));
            for i in 3..6 {
                slopes[(i, k)] = (on[i] - back[i]) / (2.0 * STEP_RAD);
            }
        }
        let covariance_with_thickness = slopes * fit.covariance_with_thickness * slopes.transpose();
        JointPose {
            pose,
            covariance: covariance_with_thickness.fixed_view::<6, 6>(0, 0).into(),
            covariance_with_thickness,
            loadings: slopes * fit.loadings,
            ..fit
        }
    }
}
