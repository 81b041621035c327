//! Estimate of a camera's response, and how well a frame determines it.
//!
//! A frame alone determines it badly, and where it is free x, z and θ are known half as well again. It is the camera's and not the
//! frame's: some frames at the start of a run are fitted with it open, their estimates are pooled
//! ([`CameraResponse::of_opening`]), and from then on it is fixed. What of it is not known goes into each pose's covariance
//! as a consider parameter (Schmidt 1966; Tapley, Schutz and Born 2004, chapter 6).

use super::super::photometric::{ACROSS, BLACK, LINE, LineResiduals, OF_RUN, State, TONE};
use nalgebra::{DMatrix, DVector, SMatrix, SVector};

mod response_prior;

pub use response_prior::ResponsePrior;

const _: () = assert!(TONE + 1 == BLACK && BLACK + 1 == LINE && OF_RUN == 2 + ACROSS);

/// ln γ, b \[grey levels\], and the line's c₃…c₁₀.
pub type OfRun = SVector<f64, OF_RUN>;
/// Of these, squared.
pub type OfRun2 = SMatrix<f64, OF_RUN, OF_RUN>;

/// Their prior sds where the response is not one that leaves light as it is: cameras for people have
/// γ = 0.42–0.5, which is ln γ = −0.8; black is 16 in video, and sRGB's and BT.709's are a power with black levels of −14
/// and −25 \[1, grey levels\]. A line with a flat top has c₄ of −0.03, one with wings of a tenth to a fifth of its light up to
/// 0.05, one with a side lobe c₃ of as much; the rest are smaller.
pub(super) const PRIOR_SD: [f64; OF_RUN] =
    [0.6, 16.0, 0.05, 0.05, 0.02, 0.02, 0.002, 0.001, 2e-4, 1e-4];
/// Prior probability that a camera leaves light as it is: machine vision does, cameras for people do not.
const LINEAR_PROBABILITY: f64 = 0.5;
/// Where it does not, the prior of ln γ is a mixture of these: shares and sds. Half are cameras for people, half leave light nearly as
/// it is: slightly nonlinear sensors, and images that were linearised.
const CURVES: [[f64; 2]; 2] = [[0.5, 0.6], [0.5, 0.1]];
/// Squared distance of an estimate from the prior's mean, in the prior's sds, beyond which it is of no camera and no line: exceeded
/// with a probability of 1e-4 (χ², ten degrees of freedom). Frames that a wrong sheet or target explains badly move the
/// response to where they fit.
const OF_NO_CAMERA: f64 = 35.56;

/// A camera's response g = b + 255 (L/255)^γ and the line's transverse profile, known to their covariance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraResponse {
    /// Mean of ln γ, b and the coefficients across the line.
    pub mean: OfRun,
    /// Of that.
    pub covariance: OfRun2,
}

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
    /// The prior alone: the weak direction of each pose is as wide as that makes it.
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

    /// The line's transverse profile.
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
    /// Covariance to be considered; `None` where the response is known for certain.
    pub(super) fn considered(&self) -> Option<&OfRun2> {
        (self.covariance != OfRun2::zeros()).then_some(&self.covariance)
    }
}

/// Estimate of the response from a frame fitted with it open.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ResponseSeen {
    /// Where it lies.
    pub mean: OfRun,
    /// Information of the frame alone, all else free.
    pub information: OfRun2,
    /// Residuals across the line that it leaves.
    pub line_residuals: LineResiduals,
}

impl CameraResponse {
    /// Pooled estimate from some frames of a camera of which the rig states nothing; `None` where they are fewer than three.
    pub fn of_opening(seen: &[ResponseSeen]) -> Option<CameraResponse> {
        Self::of_opening_with_prior(seen, &ResponsePrior::OF_CAMERAS)
    }

    /// Pooled estimate from some frames fitted under a prior; `None` where they are fewer than three, or where it is that
    /// of no camera.
    ///
    /// That the camera leaves light as it is is one hypothesis, that the line is a Gaussian another, each with a
    /// prior probability of one half. The four that they make up have their evidence (Savage and Dickey: prior over posterior density at the values of the
    /// simpler one), and what comes out is the mean of the likeliest and the
    /// spread of all about it. Where the rig states the camera's curve, only the line's hypotheses are compared.
    pub fn of_opening_with_prior(
        seen: &[ResponseSeen],
        response_prior: &ResponsePrior,
    ) -> Option<CameraResponse> {
        if seen.len() < Self::FRAMES_LEAST {
            return None;
        }
        // Frames that scatter by more than their sds have larger sds (Birge 1932), and so does a line that the series
        // does not hold: what it leaves looks like a curve.
        let prior = &response_prior.information;
        let seen = &about(seen, &response_prior.mean);
        let at_first = pooled(seen, prior, 1.0)?.0;
        let line_residuals = seen
            .iter()
            .fold(LineResiduals::default(), |line_residuals, frame| {
                line_residuals.and(&frame.line_residuals)
            });
        let times = scatter(seen, prior, at_first).max(line_residuals.in_noise());
        let all = pooled(seen, prior, times)?;
        if (all.0.transpose() * prior * all.0)[0] > OF_NO_CAMERA {
            return None;
        }
        let found: Vec<Hypothesis> = [[false, false], [true, false], [false, true], [true, true]]
            .into_iter()
            .filter(|[straight, _]| !(*straight && response_prior.is_stated()))
            .filter_map(|[straight, gaussian]| Hypothesis::of(&all, straight, gaussian))
            .collect();
        let best = found
            .iter()
            .map(|h| h.ln_evidence)
            .fold(f64::NEG_INFINITY, f64::max);
        let weight = |h: &Hypothesis| (h.ln_evidence - best).exp();
        let sum: f64 = found.iter().map(weight).sum();
        // Held at the likeliest of them: where a camera leaves light as it is and nothing speaks against it, its poses are those
        // of one that is known to. The spread of the others is in the covariance, which is about there.
        let likeliest = found
            .iter()
            .max_by(|a, b| a.ln_evidence.total_cmp(&b.ln_evidence))?;
        let mean = likeliest.mean;
        let covariance = found.iter().fold(OfRun2::zeros(), |covariance, h| {
            let apart = h.mean - mean;
            covariance + (h.covariance + apart * apart.transpose()) * (weight(h) / sum)
        });
        // Its lower triangle is what a log keeps: replays are to have the same bits.
        let covariance = OfRun2::from_fn(|i, j| covariance[(i.max(j), i.min(j))]);
        Some(response_prior.as_stated(mean + response_prior.mean, covariance))
    }

    /// ln γ and its sd from frames alone that were fitted under what the rig states, at the black level that goes with
    /// it: what the statement is compared with. `None` where they do not determine it.
    pub fn of_frames_alone(
        seen: &[ResponseSeen],
        response_prior: &ResponsePrior,
    ) -> Option<[f64; 2]> {
        if seen.len() < Self::FRAMES_LEAST {
            return None;
        }
        let seen = &about(seen, &response_prior.mean);
        let known = &response_prior.information;
        let prior = &ResponsePrior::OF_CAMERAS.information;
        let (mut information, mut right) = (*prior, OfRun::zeros());
        let mut line_residuals = LineResiduals::default();
        for frame in seen {
            information += frame.information;
            // The prior's part of the estimate is not the frame's.
            right += (frame.information + known) * frame.mean;
            line_residuals = line_residuals.and(&frame.line_residuals);
        }
        let covariance = information.cholesky()?.inverse();
        let times = line_residuals.in_noise().max(1.0);
        let ln_gamma = (covariance * right)[0] + response_prior.mean[0];
        Some([ln_gamma, (times * covariance[(0, 0)]).sqrt()])
    }
}

/// The frames' estimates relative to the prior's mean: the prior then has its mean at zero.
fn about(seen: &[ResponseSeen], mean: &OfRun) -> Vec<ResponseSeen> {
    let about = |frame: &ResponseSeen| ResponseSeen {
        mean: frame.mean - mean,
        ..*frame
    };
    seen.iter().map(about).collect()
}

/// The estimate under a hypothesis by which some of it is zero.
struct Hypothesis {
    mean: OfRun,
    covariance: OfRun2,
    /// Of its probability, over that of the one by which nothing is.
    ln_evidence: f64,
}

impl Hypothesis {
    fn of(
        (mean, covariance): &(OfRun, OfRun2),
        straight: bool,
        gaussian: bool,
    ) -> Option<Hypothesis> {
        let zero: Vec<usize> = (0..OF_RUN)
            .filter(|k| {
                if *k < 2 {
                    *k == 0 && straight
                } else {
                    gaussian
                }
            })
            .collect();
        let among = |of: &dyn Fn(usize, usize) -> f64| {
            DMatrix::from_fn(zero.len(), zero.len(), |i, j| of(zero[i], zero[j]))
        };
        let own = among(&|i, j| covariance[(i, j)]).cholesky()?;
        let off = DVector::from_fn(zero.len(), |i, _| mean[zero[i]]);
        let with = DMatrix::from_fn(OF_RUN, zero.len(), |i, j| covariance[(i, zero[j])]);
        let inverse = own.inverse();
        let gains = &with * &inverse;
        let mut found = Hypothesis {
            mean: mean - OfRun::from_iterator((&gains * &off).iter().copied()),
            covariance: covariance
                - OfRun2::from_iterator((&gains * with.transpose()).iter().copied()),
            ln_evidence: -0.5 * (off.transpose() * &inverse * &off)[0]
                - own.l().diagonal().iter().map(|l| l.ln()).sum::<f64>(),
        };
        for &k in &zero {
            // How wide the prior is, where a normal one of an sd has 1/sd at zero.
            found.ln_evidence -= match k {
                0 => CURVES
                    .iter()
                    .map(|[share, sd]| share / sd)
                    .sum::<f64>()
                    .ln(),
                _ => -PRIOR_SD[k].ln(),
            };
            found.put_to_zero(k);
        }
        if straight {
            // The black level is one with the background.
            found.put_to_zero(1);
        }
        Some(found)
    }

    fn put_to_zero(&mut self, k: usize) {
        self.mean[k] = 0.0;
        self.covariance.row_mut(k).fill(0.0);
        self.covariance.column_mut(k).fill(0.0);
    }
}

/// Mean and covariance of the frames' estimates together, their covariances times a factor.
fn pooled(seen: &[ResponseSeen], prior: &OfRun2, times: f64) -> Option<(OfRun, OfRun2)> {
    let (mut information, mut right) = (*prior, OfRun::zeros());
    for frame in seen {
        information += frame.information / times;
        // The frame's own fit knew the prior too.
        right += (frame.information + prior) * frame.mean / times;
    }
    let covariance = information.cholesky()?.inverse();
    Some((covariance * right, covariance))
}

/// By how much ln γ of the frames differs from their mean, squared, over the variance that they claim; at least one (Birge 1932).
fn scatter(seen: &[ResponseSeen], prior: &OfRun2, mean: OfRun) -> f64 {
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
            line_residuals: LineResiduals::default(),
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
    fn a_response_of_no_camera_is_not_believed() {
        let mut seen = frames(&[0.1; 5], 0.01, 3.0);
        for (c3, is_believed) in [(0.15, true), (0.35, false)] {
            for frame in &mut seen {
                frame.mean[2] = -c3;
                frame.information[(2, 2)] = 1e6;
            }
            let found = CameraResponse::of_opening(&seen);
            assert_eq!(found.is_some(), is_believed, "c3 {c3}: {found:?}");
        }
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
        assert!(found.mean[0].abs() < 0.5 * 0.0154, "{found:?}");
    }
}
