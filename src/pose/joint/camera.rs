//! What is known of a camera's response, and how much a frame says of it.
//!
//! A frame alone tells it badly, and where it is free x, z and θ are known half as well again. It is the camera's and not the
//! frame's: some frames at the start of a run are fitted with it open, what they say is put together
//! ([`CameraResponse::of_opening`]), and from then on it is fixed. What of it is not known goes into each pose's covariance
//! as a consider parameter (Schmidt 1966; Tapley, Schutz and Born 2004, chapter 6).

use super::super::photometric::{BLACK, LOCAL, TONE};
use nalgebra::{Matrix2, Vector2};

const _: () = assert!(TONE + 1 == BLACK && BLACK + 1 == LOCAL);

/// What is thought of (ln γ, b) beforehand where the response is not one that leaves light as it is: cameras for people have
/// γ = 0.42–0.5, which is ln γ = −0.8; black is 16 in video, and sRGB's and BT.709's are a power with black levels of −14
/// and −25 \[1, grey levels\].
pub(super) const PRIOR_SD: [f64; 2] = [0.6, 16.0];
/// Probability beforehand that a camera leaves light as it is: machine vision does, cameras for people do not.
const LINEAR_PROBABILITY: f64 = 0.5;

/// A camera's response g = b + 255 (L/255)^γ, known to its covariance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraResponse {
    /// ln γ, and b \[grey levels\].
    pub mean: Vector2<f64>,
    /// Of these.
    pub covariance: Matrix2<f64>,
}

impl CameraResponse {
    /// Fewer frames cannot contradict each other: they are not believed.
    pub const FRAMES_LEAST: usize = 3;
    /// Light as it is, known for certain.
    pub const LINEAR: CameraResponse = CameraResponse {
        mean: Vector2::new(0.0, 0.0),
        covariance: Matrix2::new(0.0, 0.0, 0.0, 0.0),
    };
    /// Nothing but what is thought beforehand: the weak direction of each pose is as wide as that makes it.
    pub const UNKNOWN: CameraResponse = {
        let curve = 1.0 - LINEAR_PROBABILITY;
        let [tone, black] = PRIOR_SD;
        CameraResponse {
            mean: Vector2::new(0.0, 0.0),
            covariance: Matrix2::new(curve * tone * tone, 0.0, 0.0, curve * black * black),
        }
    };
}

/// Known better than this ln γ moves nothing: a frame alone tells it to 0.01, and it adds half a hundredth to the sds that it
/// moves most.
const NEGLIGIBLE_SD: f64 = 1e-3;

impl CameraResponse {
    /// Whether what is not known of it counts.
    pub(super) fn doubted(&self) -> bool {
        self.covariance[(0, 0)] > NEGLIGIBLE_SD * NEGLIGIBLE_SD
    }
}

/// What the stripe's model leaves of ln γ, in all frames of a rest alike: runs with a curve scatter by 1.2 of what their frames'
/// noise says.
const MODEL_SD: f64 = 0.003;
/// Information of what is thought beforehand.
pub(super) fn prior() -> Matrix2<f64> {
    Matrix2::from_diagonal(&Vector2::from(PRIOR_SD.map(|sd| 1.0 / (sd * sd))))
}

/// What a frame with the response open says of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ResponseSeen {
    /// ln γ, and b \[grey levels\].
    pub mean: Vector2<f64>,
    /// Information of the frame alone, all else free.
    pub information: Matrix2<f64>,
}

impl CameraResponse {
    /// What some frames say together; `None` where they are fewer than three.
    ///
    /// That the camera leaves light as it is is one hypothesis, with half of the probability beforehand; that it has a power
    /// and a black level is the other. Each has its evidence, and what comes out is the mean and covariance of the two.
    pub fn of_opening(seen: &[ResponseSeen]) -> Option<CameraResponse> {
        if seen.len() < Self::FRAMES_LEAST {
            return None;
        }
        // Frames that differ by more than they say know less than they say.
        let at_first = pooled(seen, 1.0)?.0;
        let (mean, mut covariance) = pooled(seen, scatter(seen, at_first))?;
        covariance[(0, 0)] += MODEL_SD * MODEL_SD;
        // Evidence of a curve over that of none (Savage and Dickey): what is thought of ln γ = 0 beforehand over afterwards,
        // where the black level is one with the background and tells nothing.
        let density = |off: f64, sd: f64| (-0.5 * (off / sd).powi(2)).exp() / sd;
        let of_none = density(mean[0], covariance[(0, 0)].sqrt());
        let beforehand = (1.0 - LINEAR_PROBABILITY) / LINEAR_PROBABILITY;
        let odds = beforehand * density(0.0, PRIOR_SD[0]) / of_none.max(f64::MIN_POSITIVE);
        let curve = odds.min(1e9) / (1.0 + odds.min(1e9));
        let spread = mean * mean.transpose() * (curve * (1.0 - curve));
        Some(CameraResponse {
            mean: mean * curve,
            covariance: covariance * curve + spread,
        })
    }
}

/// Mean and covariance of what frames say, their covariances times a factor.
fn pooled(seen: &[ResponseSeen], times: f64) -> Option<(Vector2<f64>, Matrix2<f64>)> {
    let prior = prior();
    let (mut information, mut right) = (prior, Vector2::zeros());
    for frame in seen {
        information += frame.information / times;
        // The frame's own fit knew the prior too.
        right += (frame.information + prior) * frame.mean / times;
    }
    let covariance = information.cholesky()?.inverse();
    Some((covariance * right, covariance))
}

/// By how much ln γ of the frames differs from their mean, squared, over what they say of that; at least one (Birge 1932).
fn scatter(seen: &[ResponseSeen], mean: Vector2<f64>) -> f64 {
    let prior = prior();
    let off = |frame: &ResponseSeen| {
        let variance = (frame.information + prior).try_inverse()?[(0, 0)];
        Some((frame.mean[0] - mean[0]).powi(2) / variance)
    };
    let sum: f64 = seen.iter().filter_map(off).sum();
    (sum / (seen.len() as f64 - 1.0).max(1.0)).max(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frames(tones: &[f64], sd: f64, black: f64) -> Vec<ResponseSeen> {
        let seen = |tone: &f64| ResponseSeen {
            mean: Vector2::new(*tone, black),
            information: Matrix2::new(1.0 / (sd * sd), 0.0, 0.0, 1.0),
        };
        tones.iter().map(seen).collect()
    }

    #[test]
    fn frames_that_show_no_curve_leave_light_as_it_is() {
        let seen = frames(&[0.01, -0.008, 0.004, -0.01], 0.01, 3.0);
        let found = CameraResponse::of_opening(&seen).unwrap();
        assert!(found.mean[0].abs() < 1e-4, "{found:?}");
        assert!(found.covariance[(0, 0)].sqrt() < 1e-3, "{found:?}");
        assert_eq!(CameraResponse::of_opening(&[]), None);
    }

    #[test]
    fn frames_that_show_a_curve_pool_it() {
        let seen = frames(&[-0.79, -0.81, -0.80, -0.80], 0.01, 3.0);
        let found = CameraResponse::of_opening(&seen).unwrap();
        assert!((found.mean[0] + 0.8).abs() < 0.002, "{found:?}");
        assert!(
            (found.covariance[(0, 0)].sqrt() - 0.005f64.hypot(MODEL_SD)).abs() < 1e-4,
            "{found:?}"
        );
    }

    #[test]
    fn frames_that_contradict_each_other_know_less() {
        let apart = frames(&[-0.33, -0.292, -0.307, -0.32, -0.33], 0.006, 3.0);
        let found = CameraResponse::of_opening(&apart).unwrap();
        let alike = CameraResponse::of_opening(&frames(&[-0.316; 5], 0.006, 3.0)).unwrap();
        let sd = |c: &CameraResponse| c.covariance[(0, 0)].sqrt();
        assert!(sd(&found) > 1.5 * sd(&alike), "{found:?} {alike:?}");
        // So near to none they are not believed to show a curve at all.
        let near = frames(&[-0.03, 0.008, -0.007, -0.018, -0.03], 0.006, 3.0);
        let found = CameraResponse::of_opening(&near).unwrap();
        assert!(found.mean[0].abs() < 0.2 * 0.0154, "{found:?}");
    }
}
