//! The camera's curve, which the nodes of an image share beside its blur.
//!
//! Gauss–Newton in three numbers, the logarithms of γ, ε and blur, with each node's own six
//! eliminated (Schur's complement); between two steps the nodes are fitted anew. A straight
//! line is kept unless the board speaks against it: images of a linear camera are fitted as if
//! there were no curves.

use std::collections::HashMap;

use hydroline_rigs::BoardPattern;
use nalgebra::{Matrix3, SMatrix, Vector3};

use super::lattice::Index;
use super::marks::Local;
use super::refine::{ConvergedFit, Refined, Refiner};
use super::tone::{EPSILON_LOG_SD, Tone, USUAL_EPSILON};

/// Node, where it was seen and its local steps.
pub(super) type Place = (Index, [f64; 2], [[f64; 2]; 2]);

/// A curve is taken into account beyond this |ln γ|: below it moves no rim by more than its noise, and blur
/// that is not Gaussian, or an edge out of focus, looks like as much.
const LEAST_LOG_GAMMA: f64 = 0.15;
/// And beyond so many of its standard deviations.
const LEAST_SDS: f64 = 5.0;
/// No camera's curve is steeper: what asks for more is no board.
const MOST_LOG_GAMMA: f64 = 1.8;
/// Steps at most, and the longest step of each number.
const STEPS: usize = 8;
const LONGEST: f64 = 0.4;
/// A step of ln γ and of the blur's logarithm that ends it.
const NEGLIGIBLE: f64 = 0.02;
/// Half the step of derivatives by differences.
const H: f64 = 0.02;

/// Fits of some nodes, as they came out.
pub(super) type Known = HashMap<Index, Option<Refined>>;

/// Finds the curve that these nodes show and sets it, with the blur that goes with it: nothing is
/// changed where there is no curve that matters. Answers with the fits of these nodes.
pub(super) fn curve(refiner: &mut Refiner<'_>, places: &[Place]) -> Known {
    // A line thinner than its blur never shows its dark level: width, contrast, blur and curve look
    // alike there, and crossings are symmetric without any of them.
    if matches!(refiner.board.pattern, BoardPattern::Lines { .. }) {
        return known(places, &converge(refiner, places));
    }
    let blur_px = refiner.blur_px;
    let mut log = Vector3::new(0.0, USUAL_EPSILON.ln(), blur_px.ln());
    let mut straight_fits = None;
    for round in 0..STEPS {
        let converged = converge(refiner, places);
        let step = step(refiner, &converged, &log);
        let straight = |(step, sd): &(Vector3<f64>, f64)| {
            step[0].abs() < LEAST_LOG_GAMMA || step[0].abs() < LEAST_SDS * sd
        };
        if round == 0 {
            let fits = known(places, &converged);
            if step.as_ref().is_none_or(straight) {
                return fits;
            }
            straight_fits = Some((unexplained(&converged), fits));
        }
        let Some((step, _)) = step else { break };
        log += step.map(|s| s.clamp(-LONGEST, LONGEST));
        log[0] = log[0].clamp(-MOST_LOG_GAMMA, MOST_LOG_GAMMA);
        refiner.tone = Some(Tone::new(log[0].exp(), log[1].exp()));
        refiner.blur_px = log[2].exp();
        if step[0].abs().max(step[2].abs()) < NEGLIGIBLE {
            break;
        }
    }
    let converged = converge(refiner, places);
    let left = unexplained(&converged);
    let fits = known(places, &converged);
    match straight_fits {
        // Rims that no camera makes pull a curve as well, but none explains them.
        Some((before, straight)) if left >= before || log[0].abs() < LEAST_LOG_GAMMA => {
            drop(converged);
            refiner.tone = None;
            refiner.blur_px = blur_px;
            straight
        }
        _ => fits,
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

/// The next step, and the standard deviation of ln γ.
fn step(
    refiner: &Refiner<'_>,
    converged: &[Option<ConvergedFit<'_>>],
    log: &Vector3<f64>,
) -> Option<(Vector3<f64>, f64)> {
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
    let mut hessian = Matrix3::from_diagonal(&Vector3::new(1e-6, prior, 1e-6));
    let mut right = Vector3::new(0.0, prior * (USUAL_EPSILON.ln() - log[1]), 0.0);
    for node in sound {
        let (h, r) = reduced(refiner, node, log)?;
        hessian += h;
        right += r;
    }
    let covariance = hessian.try_inverse()?;
    Some((covariance * right, covariance[(0, 0)].max(0.0).sqrt()))
}

/// One node's normal equations in the three numbers, its own six eliminated.
fn reduced(
    refiner: &Refiner<'_>,
    node: &ConvergedFit<'_>,
    log: &Vector3<f64>,
) -> Option<(Matrix3<f64>, Vector3<f64>)> {
    let m = &node.patch.m;
    let contrast = node.theta[3];
    let light = contrast > 0.0;
    let [gamma, epsilon, blur_px] = [log[0], log[1], log[2]].map(f64::exp);
    let here = Tone::new(gamma, epsilon);
    let curves = [
        [-H, H].map(|h| Tone::new(gamma * h.exp(), epsilon)),
        [-H, H].map(|h| Tone::new(gamma, epsilon * h.exp())),
    ];
    let blurs = [-H, H].map(|h| Local::new(refiner.board, m, blur_px * h.exp()));
    let local = refiner.local(m);
    let range = local.range();
    let mut own = SMatrix::<f64, 6, 6>::identity() * 1e-9;
    let mut cross = SMatrix::<f64, 6, 3>::zeros();
    let mut shared = Matrix3::zeros();
    let mut right = Vector3::zeros();
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
        let value = local.pattern(u, v).0;
        let slopes = [0, 1, 2].map(|k| {
            let [a, b] = if k < 2 {
                [0, 1].map(|side| curves[k][side].shown(value, range, light).0)
            } else {
                [0, 1].map(|side| here.shown(blurs[side].pattern(u, v).0, range, light).0)
            };
            contrast * (b - a) / (2.0 * H)
        });
        let slopes = Vector3::from(slopes);
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
