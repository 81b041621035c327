//! The prior of what the frames of a run share: typical cameras and lines, or what the rig states of this camera.

use super::{CameraResponse, OF_RUN, OfRun, OfRun2, PRIOR_SD, diagonal, of_constants};
use hydroline_rigs::StatedResponse;

/// Least sd of stated values, that of certain ones: such an error moves no grey level by a tenth \[1, grey levels\].
const CERTAIN_SD: [f64; 2] = [1e-4, 0.01];

/// Mean and covariance before any frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ResponsePrior {
    /// Mean before a frame is looked at.
    pub(in super::super) mean: OfRun,
    /// Inverse of the covariance.
    pub(in super::super) information: OfRun2,
    covariance: OfRun2,
    /// Whether the rig states γ and b, and if so, whether γ for certain.
    stated: Option<bool>,
}

impl ResponsePrior {
    /// The prior of typical cameras and lines.
    pub const OF_CAMERAS: ResponsePrior = {
        let (mut variances, mut weights) = ([0.0; OF_RUN], [0.0; OF_RUN]);
        let mut k = 0;
        while k < OF_RUN {
            variances[k] = PRIOR_SD[k] * PRIOR_SD[k];
            weights[k] = 1.0 / variances[k];
            k += 1;
        }
        ResponsePrior {
            mean: of_constants([0.0; OF_RUN]),
            information: diagonal(weights),
            covariance: diagonal(variances),
            stated: None,
        }
    };

    /// Prior of a camera as the rig states it; for the rest that of typical cameras and lines.
    pub fn of_rig(stated: Option<&StatedResponse>) -> ResponsePrior {
        let mut of = ResponsePrior::OF_CAMERAS;
        let Some(stated) = stated else {
            return of;
        };
        let [black, black_sd] = stated.black_levels.unwrap_or([0.0, PRIOR_SD[1]]);
        (of.mean[0], of.mean[1]) = (stated.gamma.ln(), black);
        let sds = [stated.gamma_sd / stated.gamma, black_sd];
        let sds = [0, 1].map(|k| f64::max(sds[k], CERTAIN_SD[k]));
        let r = stated.gamma_black_correlation;
        for i in 0..2 {
            for j in 0..2 {
                let (with, against) = if i == j { (1.0, 1.0) } else { (r, -r) };
                of.covariance[(i, j)] = with * sds[i] * sds[j];
                of.information[(i, j)] = against / (sds[i] * sds[j] * (1.0 - r * r));
            }
        }
        of.stated = Some(stated.gamma_sd == 0.0);
        of
    }

    /// Whether the rig states it.
    pub fn is_stated(&self) -> bool {
        self.stated.is_some()
    }

    /// Whether γ is known for certain.
    pub(super) fn is_certain(&self) -> bool {
        self.stated == Some(true)
    }

    /// ln γ and b to begin with.
    pub(in super::super) fn curve(&self) -> [f64; 2] {
        [self.mean[0], self.mean[1]]
    }

    /// The response where no frame determines it.
    pub fn response(&self) -> CameraResponse {
        if self.stated.is_none() {
            return CameraResponse::UNKNOWN;
        }
        self.as_stated(self.mean, self.covariance)
    }

    /// The same with a line that is known to be a Gaussian.
    pub(in super::super) fn of_gaussian_line(&self) -> CameraResponse {
        if self.stated.is_none() {
            return CameraResponse::LINEAR;
        }
        let mut response = self.response();
        for k in 2..OF_RUN {
            response.covariance[(k, k)] = 0.0;
        }
        response
    }

    /// A response in which what is known for certain is as it was stated.
    pub(super) fn as_stated(&self, mean: OfRun, covariance: OfRun2) -> CameraResponse {
        let mut response = CameraResponse { mean, covariance };
        let mut fix = |k: usize, value: f64| {
            response.mean[k] = value;
            response.covariance.row_mut(k).fill(0.0);
            response.covariance.column_mut(k).fill(0.0);
        };
        if self.is_certain() {
            fix(0, self.mean[0]);
            if self.mean[0] == 0.0 {
                // Without a curve the black level is one with the background.
                fix(1, 0.0);
            }
        }
        response
    }
}
