//! The least covariance of a pose from one frame: the Cramér–Rao bound.

use super::super::photometric::{ACROSS, Choice, LOCAL, PARAMETERS, State, Sums, TONE, UNEVEN};
use super::solve::covariances;
use super::{Matrix7, PoseFitter, THICKNESS};
use hydroline_calib::Pose;

/// Light of a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Light {
    /// Grey levels of the line before the point spread.
    pub brightness: f64,
    /// Sheet's standard deviation \[m\].
    pub thickness_m: f64,
    /// Grey level without laser light.
    pub background: f64,
    /// Pixel noise, standard deviation \[grey levels\]; rounding to whole levels is added.
    pub noise_sd: f64,
}

impl PoseFitter {
    /// Bound on the covariance of (x, y, z, φ, θ, ψ, thickness) from one frame at a pose, with
    /// brightness, background and (unless held) thickness unknown: the inverse of Fisher's
    /// information of all pixels. The model's derivatives are exact, so that nothing of it is
    /// information of a sampling lattice; light past upright corners has no information. All blur is taken to be the lens's:
    /// formed on the pixel grid it leaves edges along the columns up to 5 % sharper.
    /// `None` where the frame leaves something wholly open.
    pub fn bound(&self, pose: &Pose, light: &Light, thickness_known: bool) -> Option<Matrix7> {
        let state = State {
            pose: *pose,
            brightness: light.brightness,
            thickness_m: light.thickness_m,
            background: light.background,
            tone: 0.0,
            black: 0.0,
            across: [0.0; ACROSS],
            uneven: [0.0; UNEVEN],
        };
        let plan = self.model.plan(&state, Choice::ALL);
        // Rounding: a uniform error of one level, variance 1/12.
        let noise_sd = (light.noise_sd * light.noise_sd + 1.0 / 12.0).sqrt();
        let information = self.model.information(&plan, &state, noise_sd);
        let mut free = [true; PARAMETERS];
        free[THICKNESS] = !thickness_known;
        free[TONE..LOCAL].fill(false);
        let mut sums = Sums {
            information,
            ..Sums::default()
        };
        self.add_priors(&mut sums, &state);
        covariances(&sums, &free, None).map(|[alone, _]| alone)
    }
}
