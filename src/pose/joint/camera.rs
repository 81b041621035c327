//! What is known of a camera's response, and how much a frame says of it.
//!
//! A frame alone tells it badly, and where it is free x, z and θ are known half as well again. It is the camera's and not the
//! frame's: some frames at the start of a run are fitted with it open, what they say is put together
//! ([`CameraResponse::of_opening`]), and from then on it is fixed. What of it is not known goes into each pose's covariance
//! as a consider parameter (Schmidt 1966; Tapley, Schutz and Born 2004, chapter 6).

use super::super::photometric::{
    ACROSS, BLACK, DOUBTS, LINE, Left, OF_RUN, RunDoubts, State, TONE,
};
use nalgebra::{SMatrix, SVector};

const _: () = assert!(TONE + 1 == BLACK && BLACK + 1 == LINE && OF_RUN == 2 + ACROSS);

/// ln γ, b \[grey levels\], and the line's c₃…c₆.
pub type OfRun = SVector<f64, OF_RUN>;
/// Of these, squared.
pub type OfRun2 = SMatrix<f64, OF_RUN, OF_RUN>;

/// What is thought of them beforehand where the response is not one that leaves light as it is: cameras for people have
/// γ = 0.42–0.5, which is ln γ = −0.8; black is 16 in video, and sRGB's and BT.709's are a power with black levels of −14
/// and −25 \[1, grey levels\]. A line with a flat top has c₄ of −0.03, one with wings of a tenth to a fifth of its light up to
/// 0.05, one with a side lobe c₃ of as much; the rest are smaller.
pub(super) const PRIOR_SD: [f64; OF_RUN] =
    [0.6, 16.0, 0.05, 0.05, 0.02, 0.02, 0.002, 0.001, 2e-4, 1e-4];
/// Probability beforehand that a camera leaves light as it is: machine vision does, cameras for people do not.
const LINEAR_PROBABILITY: f64 = 0.5;
/// Where it does not, ln γ is one of these beforehand: shares and sds. Half are cameras for people, half leave light nearly as
/// it is: sensors that bend a little, and pictures that a curve was taken off.
const CURVES: [[f64; 2]; 2] = [[0.5, 0.6], [0.5, 0.1]];

/// A camera's response g = b + 255 (L/255)^γ and what the line has across it, known to their covariance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraResponse {
    /// What is held.
    pub mean: OfRun,
    /// Of that.
    pub covariance: OfRun2,
}

/// Those of a state.
pub(super) fn of_run(state: &State) -> OfRun {
    OfRun::from_fn(|k, _| match k {
        0 => state.tone,
        1 => state.black,
        _ => state.across[k - 2],
    })
}

impl CameraResponse {
    /// Fewer frames cannot contradict each other: they are not believed.
    pub const FRAMES_LEAST: usize = 3;
    /// Light as it is and a Gaussian line, known for certain.
    pub const LINEAR: CameraResponse = CameraResponse {
        mean: of_constants([0.0; OF_RUN]),
        covariance: diagonal([0.0; OF_RUN]),
    };
    /// Nothing but what is thought beforehand: the weak direction of each pose is as wide as that makes it.
    pub const UNKNOWN: CameraResponse = {
        let curve = 1.0 - LINEAR_PROBABILITY;
        let mut variances = [0.0; OF_RUN];
        let mut k = 0;
        while k < OF_RUN {
            let sd = PRIOR_SD[k];
            variances[k] = if k < 2 { curve * sd * sd } else { sd * sd };
            k += 1;
        }
        CameraResponse {
            mean: of_constants([0.0; OF_RUN]),
            covariance: diagonal(variances),
        }
    };

    /// What the line has across it.
    pub(super) fn across(&self) -> [f64; ACROSS] {
        std::array::from_fn(|k| self.mean[2 + k])
    }
}

const fn of_constants(values: [f64; OF_RUN]) -> OfRun {
    OfRun::from_array_storage(nalgebra::ArrayStorage([values]))
}

const fn diagonal(values: [f64; OF_RUN]) -> OfRun2 {
    let mut rows = [[0.0; OF_RUN]; OF_RUN];
    let mut k = 0;
    while k < OF_RUN {
        rows[k][k] = values[k];
        k += 1;
    }
    OfRun2::from_array_storage(nalgebra::ArrayStorage(rows))
}

impl CameraResponse {
    /// The moves in which it is doubted, an sd each: first that of ln γ, which all else follows, then what is left of the black
    /// level, and so on (Cholesky). `None` where it is known for certain.
    pub(super) fn doubts(&self) -> Option<RunDoubts> {
        let mut rest = self.covariance;
        let mut moves = RunDoubts::zeros();
        for k in 0..DOUBTS {
            let variance = rest[(k, k)];
            if variance > 0.0 {
                let column = rest.column(k) / variance.sqrt();
                moves.set_column(k, &column);
                rest -= column * column.transpose();
            }
        }
        (moves != RunDoubts::zeros()).then_some(moves)
    }
}

/// Information of what is thought beforehand.
pub(super) fn prior() -> OfRun2 {
    OfRun2::from_diagonal(&OfRun::from(PRIOR_SD.map(|sd| 1.0 / (sd * sd))))
}

/// What a frame with the response open says of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ResponseSeen {
    /// Where it lies.
    pub mean: OfRun,
    /// Information of the frame alone, all else free.
    pub information: OfRun2,
    /// What it leaves across the line.
    pub left: Left,
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
        // Frames that differ by more than they say know less than they say (Birge 1932), and so does a line that the series
        // does not hold: what it leaves looks like a curve.
        let at_first = pooled(seen, 1.0)?.0;
        let left = seen
            .iter()
            .fold(Left::default(), |left, frame| left.and(&frame.left));
        let times = scatter(seen, at_first).max(left.in_noise());
        let (mean, covariance) = pooled(seen, times)?;
        // Evidence of a curve over that of none, where the black level is one with the background and tells nothing: how likely
        // ln γ is to be found where it is.
        let tone2 = covariance[(0, 0)];
        let density = |sd2: f64| (-0.5 * mean[0] * mean[0] / sd2).exp() / sd2.sqrt();
        let of_none = density(tone2).max(f64::MIN_POSITIVE);
        let of_curve = CURVES
            .iter()
            .map(|[share, sd]| share * density(tone2 + sd * sd))
            .sum::<f64>();
        let beforehand = (1.0 - LINEAR_PROBABILITY) / LINEAR_PROBABILITY;
        let odds = beforehand * of_curve / of_none;
        let curve = odds.min(1e9) / (1.0 + odds.min(1e9));
        // Where there is none, the line is what goes with that: what is known given ln γ = 0. The black level is none then.
        let with_tone = covariance.column(0) / tone2;
        let mut straight = mean - with_tone * mean[0];
        let mut of_straight = covariance - with_tone * covariance.row(0);
        straight[1] = 0.0;
        of_straight.row_mut(1).fill(0.0);
        of_straight.column_mut(1).fill(0.0);
        let apart = mean - straight;
        Some(CameraResponse {
            mean: straight + apart * curve,
            covariance: covariance * curve
                + of_straight * (1.0 - curve)
                + apart * apart.transpose() * (curve * (1.0 - curve)),
        })
    }
}

/// Mean and covariance of what frames say, their covariances times a factor.
fn pooled(seen: &[ResponseSeen], times: f64) -> Option<(OfRun, OfRun2)> {
    let prior = prior();
    let (mut information, mut right) = (prior, OfRun::zeros());
    for frame in seen {
        information += frame.information / times;
        // The frame's own fit knew the prior too.
        right += (frame.information + prior) * frame.mean / times;
    }
    let covariance = information.cholesky()?.inverse();
    Some((covariance * right, covariance))
}

/// By how much ln γ of the frames differs from their mean, squared, over what they say of that; at least one (Birge 1932).
fn scatter(seen: &[ResponseSeen], mean: OfRun) -> f64 {
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
        let of = |tone: f64, black: f64| {
            let mut all = OfRun::zeros();
            [all[0], all[1]] = [tone, black];
            all
        };
        let seen = |tone: &f64| ResponseSeen {
            mean: of(*tone, black),
            information: OfRun2::from_diagonal(&of(1.0 / (sd * sd), 1.0)),
            left: Left::default(),
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
            (found.covariance[(0, 0)].sqrt() - 0.005).abs() < 1e-4,
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
