//! The camera's response, found in the first frames of a run that show the target.

use super::joint::{CameraResponse, ResponseSeen};
use super::run::{PoseRun, RunPose};
use hydroline_core::frame::GreyImage;
use hydroline_stripe::Profile;

/// Length of an opening.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Options {
    /// Frames with a pose over the target that are put together. One determines ln γ to 0.05–0.25, eight to 0.02–0.1; more of
    /// them, all from the same place at rest, go below what the model itself leaves.
    pub frames: usize,
    /// Frames looked at, at most: where fewer than three of them show the target the response stays unknown.
    pub looked_at_max: usize,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            frames: 8,
            looked_at_max: 64,
        }
    }
}

/// A run's opening: its frames are fitted with the camera's response open.
#[derive(Clone)]
pub struct Opening {
    run: PoseRun,
    options: Options,
    seen: Vec<ResponseSeen>,
    looked_at: usize,
}

impl Opening {
    /// Of a run that has not seen a frame yet.
    pub fn new(run: &PoseRun, options: Options) -> Self {
        Opening {
            run: run.with_fitter(run.fitter().with_response_open()),
            options,
            seen: Vec::new(),
            looked_at: 0,
        }
    }

    /// Takes a command, as [`PoseRun::command`] does.
    pub fn command(&mut self, stamp_ns: u64, thruster: &str, thrust_n: f64) {
        self.run.command(stamp_ns, thruster, thrust_n);
    }

    /// Takes commands: stamp, thruster, thrust \[N\].
    pub fn commands<N: AsRef<str>>(&mut self, commands: &[(u64, N, f64)]) {
        self.run.commands(commands);
    }

    /// Looks at the next frame, true at `stamp_ns` (UNIX): its pose while nothing is known of the camera.
    pub fn look(&mut self, stamp_ns: u64, image: &GreyImage, profile: &Profile) -> RunPose {
        let pose = self.run.pose(stamp_ns, image, profile);
        self.looked_at += 1;
        if let RunPose::Good(fit) = &pose
            && fit.measured == [true; 6]
        {
            self.seen.extend(fit.response);
        }
        pose
    }

    /// Whether it is over.
    pub fn is_over(&self) -> bool {
        self.seen.len() >= self.options.frames || self.looked_at >= self.options.looked_at_max
    }

    /// Frames that give an estimate of the response.
    pub fn frames(&self) -> usize {
        self.seen.len()
    }

    /// Their pooled estimate under what the rig states; `None` where they are too few and it states nothing.
    pub fn response(&self) -> Option<CameraResponse> {
        let (response_prior, _) = self.run.fitter().response_prior();
        let found = CameraResponse::of_opening_with_prior(&self.seen, response_prior);
        found.or_else(|| {
            response_prior
                .is_stated()
                .then(|| response_prior.response())
        })
    }

    /// Where the rig states ln γ: its estimate from the frames alone, and its sd.
    pub fn alone(&self) -> Option<[f64; 2]> {
        let (response_prior, _) = self.run.fitter().response_prior();
        let stated = response_prior.is_stated();
        stated.then(|| CameraResponse::of_frames_alone(&self.seen, response_prior))?
    }

    /// Whether the rig states the camera's response.
    pub fn is_stated(&self) -> bool {
        self.run.fitter().response_prior().0.is_stated()
    }

    /// The run as it goes on from here.
    pub fn into_run(self) -> PoseRun {
        let response = self.response().unwrap_or(CameraResponse::UNKNOWN);
        let fitter = self.run.fitter().with_response(response);
        self.run.going_on_with(fitter)
    }
}
