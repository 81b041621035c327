//! What the nodes of an image share: its blur along the lattice's two directions, and the camera's curve.
//!
//! Gauss–Newton in four numbers, the logarithms of γ, ε and both blurs, with each node's own six
//! eliminated (Schur's complement); between two steps the nodes are fitted anew. One blur for both directions and a
//! straight line are kept unless the board speaks against them: images of a linear camera at rest are fitted as if
//! there were neither.
//!
//! The curve first, with both blurs free beside it: what a steep curve leaves would pass for motion, but motion for no
//! curve. A moved hand draws one family of rims out to ramps several pixels wide. Under one blur for both, a
//! robust fit takes either end of such a ramp for outliers, and the node lies half a ramp off without a sign of it.

use std::collections::HashMap;

use hydroline_rigs::BoardPattern;
use nalgebra::{Matrix4, SMatrix, Vector4};

use super::lattice::Index;
use super::marks::Local;
use super::refine::{ConvergedFit, Refined, Refiner};
use super::tone::{EPSILON_LOG_SD, Tone, USUAL_EPSILON};

/// Node, where it was seen and its local steps.
pub(super) type Place = (Index, [f64; 2], [[f64; 2]; 2]);

/// A curve is taken into account beyond this |ln γ|: below it moves no rim by more than its noise, and blur
/// that is not Gaussian, or an edge out of focus, looks like as much.
const LEAST_LOG_GAMMA: f64 = 0.15;
/// Two blurs are taken into account beyond this |ln| of their ratio: less widens no rim by more than a curve or an edge
/// out of focus does.
const LEAST_LOG_RATIO: f64 = 0.15;
/// And both beyond so many standard deviations.
const LEAST_SDS: f64 = 5.0;
/// No camera's curve is steeper: what asks for more is no board.
const MOST_LOG_GAMMA: f64 = 1.8;
/// Steps at most, and the longest step of each number.
const STEPS: usize = 8;
const LONGEST: f64 = 0.4;
/// A step of ln γ and of the blurs' logarithms that ends it.
const NEGLIGIBLE: f64 = 0.02;
/// Half the step of derivatives by differences.
const H: f64 = 0.02;

/// Fits of some nodes, as they came out.
pub(super) type Known = HashMap<Index, Option<Refined>>;

/// Finds blur and curve that these nodes show and sets them: nothing is changed where there is neither motion nor a
/// curve that matters. Answers with the fits of these nodes.
pub(super) fn settle(refiner: &mut Refiner<'_>, places: &[Place]) -> Known {
    // A line thinner than its blur never shows its dark level: width, contrast, blur and curve look
    // alike there, and crossings are symmetric without any of them.
    if matches!(refiner.board.pattern, BoardPattern::Lines { .. }) {
        return known(places, &converge(refiner, places));
    }
    let [along, across] = refiner.blur_px.map(f64::ln);
    let mut log = Vector4::new(0.0, USUAL_EPSILON.ln(), along, across);
    let round = look(refiner, places, &log);
    let round = descend(refiner, places, round, &mut log, &CURVE);
    descend(refiner, places, round, &mut log, &MOTION).fits
}

/// A question to the board: numbers that are free, the one combination of them that must matter, and from where on it
/// does.
struct Question {
    free: [bool; 4],
    combination: Vector4<f64>,
    least: f64,
}

const MOTION: Question = Question {
    free: [false, false, true, true],
    combination: Vector4::new(0.0, 0.0, 1.0, -1.0),
    least: LEAST_LOG_RATIO,
};

const CURVE: Question = Question {
    free: [true; 4],
    combination: Vector4::new(1.0, 0.0, 0.0, 0.0),
    least: LEAST_LOG_GAMMA,
};

/// Some nodes fitted with what they share as it is.
struct Round {
    fits: Known,
    /// Share of the contrast that they leave.
    left: f64,
    /// Of the four numbers: normal matrix and its right side.
    normal: Option<(Matrix4<f64>, Vector4<f64>)>,
}

impl Round {
    /// The next step, and its covariance; numbers that are held have none.
    fn step(&self, free: &[bool; 4]) -> Option<(Vector4<f64>, Matrix4<f64>)> {
        let (mut hessian, mut right) = self.normal?;
        for k in (0..4).filter(|k| !free[*k]) {
            hessian.fill_row(k, 0.0);
            hessian.fill_column(k, 0.0);
            hessian[(k, k)] = 1.0;
            right[k] = 0.0;
        }
        let covariance = hessian.try_inverse()?;
        Some((covariance * right, covariance))
    }
}

fn look(refiner: &Refiner<'_>, places: &[Place], log: &Vector4<f64>) -> Round {
    let converged = converge(refiner, places);
    Round {
        left: unexplained(&converged),
        normal: normal(refiner, &converged, log),
        fits: known(places, &converged),
    }
}

/// Steps until the numbers that are free rest; where what is asked does not matter, or does not explain the board better,
/// all is as it was.
fn descend(
    refiner: &mut Refiner<'_>,
    places: &[Place],
    first: Round,
    log: &mut Vector4<f64>,
    question: &Question,
) -> Round {
    let matters = |log: &Vector4<f64>| question.combination.dot(log).abs() >= question.least;
    let Some((mut step, covariance)) = first.step(&question.free) else {
        return first;
    };
    let sd = (question
        .combination
        .dot(&(covariance * question.combination)))
    .sqrt();
    let seen = question.combination.dot(&step).abs() >= LEAST_SDS * sd;
    if !matters(&(*log + step)) || !seen {
        return first;
    }
    let before = (*log, refiner.blur_px, refiner.tone.clone());
    let mut last = None;
    for _ in 0..STEPS {
        *log += step.map(|s| s.clamp(-LONGEST, LONGEST));
        log[0] = log[0].clamp(-MOST_LOG_GAMMA, MOST_LOG_GAMMA);
        if question.free[0] {
            refiner.tone = Some(Tone::new(log[0].exp(), log[1].exp()));
        }
        refiner.blur_px = [log[2].exp(), log[3].exp()];
        let rests = [0, 2, 3].iter().all(|k| step[*k].abs() < NEGLIGIBLE);
        let round = last.insert(look(refiner, places, log));
        match round.step(&question.free) {
            Some((next, _)) if !rests => step = next,
            _ => break,
        }
    }
    match last {
        // Rims that no camera makes pull at these numbers as well, but none explains them.
        Some(last) if last.left < first.left && matters(log) => last,
        _ => {
            (*log, refiner.blur_px, refiner.tone) = before;
            first
        }
    }
}

/// Mean share of the contrast that the better half of fits leaves; one that does not converge counts 1.
fn unexplained(converged: &[Option<ConvergedFit<'_>>]) -> f64 {
    let relative = |s: &Option<ConvergedFit<'_>>| s.as_ref().map_or(1.0, |s| s.relative().min(1.0));
    let mut left: Vec<f64> = converged.iter().map(relative).collect();
    left.sort_by(f64::total_cmp);
    let better = &left[..left.len().div_ceil(2)];
    better.iter().sum::<f64>() / better.len().max(1) as f64
}

fn converge<'a>(refiner: &'a Refiner<'a>, places: &[Place]) -> Vec<Option<ConvergedFit<'a>>> {
    let fit = |&(index, start, steps): &Place| refiner.converge(index, start, steps);
    places.iter().map(fit).collect()
}

fn known(places: &[Place], converged: &[Option<ConvergedFit<'_>>]) -> Known {
    let pairs = places.iter().zip(converged);
    pairs
        .map(|(p, s)| (p.0, s.as_ref().and_then(|s| s.refined(p.1))))
        .collect()
}

/// Normal equations of the four numbers.
fn normal(
    refiner: &Refiner<'_>,
    converged: &[Option<ConvergedFit<'_>>],
    log: &Vector4<f64>,
) -> Option<(Matrix4<f64>, Vector4<f64>)> {
    let converged: Vec<&ConvergedFit<'_>> = converged.iter().flatten().collect();
    // A hand or a block's edge beside a node is not the camera's curve.
    let mut left: Vec<f64> = converged.iter().map(|s| s.relative()).collect();
    left.sort_by(f64::total_cmp);
    let most = 2.0 * left.get(left.len() / 2)?;
    let sound: Vec<_> = converged.iter().filter(|s| s.relative() <= most).collect();
    if sound.len() < 3 {
        return None;
    }
    let prior = 1.0 / EPSILON_LOG_SD.powi(2);
    let mut hessian = Matrix4::from_diagonal(&Vector4::new(1e-6, prior, 1e-6, 1e-6));
    let mut right = Vector4::new(0.0, prior * (USUAL_EPSILON.ln() - log[1]), 0.0, 0.0);
    for node in sound {
        let (h, r) = reduced(refiner, node, log)?;
        hessian += h;
        right += r;
    }
    Some((hessian, right))
}

/// One node's normal equations in the four numbers, its own six eliminated.
fn reduced(
    refiner: &Refiner<'_>,
    node: &ConvergedFit<'_>,
    log: &Vector4<f64>,
) -> Option<(Matrix4<f64>, Vector4<f64>)> {
    let m = &node.patch.m;
    let contrast = node.theta[3];
    let light = contrast > 0.0;
    let [gamma, epsilon, along, across] = [0, 1, 2, 3].map(|k| log[k].exp());
    let here = Tone::new(gamma, epsilon);
    let curves = [
        [-H, H].map(|h| Tone::new(gamma * h.exp(), epsilon)),
        [-H, H].map(|h| Tone::new(gamma, epsilon * h.exp())),
    ];
    let blurred = |blur_px| Local::new(refiner.board, m, blur_px);
    let blurs = [
        [-H, H].map(|h| blurred([along * h.exp(), across])),
        [-H, H].map(|h| blurred([along, across * h.exp()])),
    ];
    let local = refiner.local(m);
    let range = local.range();
    let mut own = SMatrix::<f64, 6, 6>::identity() * 1e-9;
    let mut cross = SMatrix::<f64, 6, 4>::zeros();
    let mut shared = Matrix4::zeros();
    let mut right = Vector4::zeros();
    let mut own_right = SMatrix::<f64, 6, 1>::zeros();
    let (mut weights, mut squares) = (0.0, 0.0);
    let shift = m * nalgebra::Vector2::new(node.theta[4], node.theta[5]);
    let mut pixels = node.patch.pixels.iter();
    node.each(&local, |row, e, weight| {
        let Some(p) = pixels.next() else { return };
        if weight == 0.0 {
            return;
        }
        let (u, v) = (p[2] - shift[0], p[3] - shift[1]);
        let value = local.pattern_of(u, v, light).0;
        let slopes = [0, 1, 2, 3].map(|k| {
            let [a, b] = if k < 2 {
                [0, 1].map(|side| curves[k][side].shown(value, range, light).0)
            } else {
                [0, 1].map(|side| {
                    here.shown(blurs[k - 2][side].pattern_of(u, v, light).0, range, light)
                        .0
                })
            };
            contrast * (b - a) / (2.0 * H)
        });
        let slopes = Vector4::from(slopes);
        own += row * row.transpose() * weight;
        cross += row * slopes.transpose() * weight;
        shared += slopes * slopes.transpose() * weight;
        right += slopes * (weight * e);
        own_right += row * (weight * e);
        weights += weight;
        squares += weight * e * e;
    });
    let variance = (squares / f64::max(weights, 1.0)).max(0.3 * 0.3);
    let eliminated = cross.transpose() * own.try_inverse()?;
    Some((
        (shared - eliminated * cross) / variance,
        (right - eliminated * own_right) / variance,
    ))
}
