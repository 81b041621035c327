//! All nodes of a lattice refined with the blur they share, and which of them are kept.

use std::collections::{BTreeMap, HashMap};

use hydroline_rigs::Board;
use nalgebra::{SMatrix, SVector};

use super::identify::Ordered;
use super::image::Grey;
use super::lattice::Index;
use super::refine::{Refined, Refiner};
use crate::map::geometry::{apply, homography};

/// Moves coarse dots to their middles, so that the local steps become good to a per cent.
pub(super) fn centre_dots(image: &Grey<'_>, board: &Board, ordered: &mut Ordered) {
    let Some(refiner) = refiner(image, board, ordered) else {
        return;
    };
    let centred: HashMap<Index, [f64; 2]> = ordered
        .nodes
        .iter()
        .map(|(&k, &p)| {
            let steps = [[1.0, 0.0], [0.0, 1.0]].map(|d: [f64; 2]| {
                let at = |s: f64| {
                    apply(
                        &refiner.to_image,
                        [f64::from(k[0]) + s * d[0], f64::from(k[1]) + s * d[1]],
                    )
                    .unwrap_or(p)
                };
                let (a, b) = (at(0.5), at(-0.5));
                [a[0] - b[0], a[1] - b[1]]
            });
            (k, refiner.centroid(p, steps).unwrap_or(p))
        })
        .collect();
    ordered.nodes = centred;
}

/// A refiner for the lattice as it is known.
fn refiner<'a>(image: &'a Grey<'a>, board: &'a Board, ordered: &Ordered) -> Option<Refiner<'a>> {
    let to_image = ordered.homography()?;
    let mut to_index = to_image.try_inverse()?;
    // An inverse homography is one up to its sign.
    let any = *ordered.nodes.keys().min()?;
    if apply(&to_index, apply(&to_image, any.map(f64::from))?).is_none() {
        to_index = -to_index;
    }
    Some(Refiner {
        image,
        board,
        to_image,
        to_index,
        blur_px: 1.0,
    })
}

/// All nodes refined, with the blur that fits them best.
pub(super) fn fine(
    image: &Grey<'_>,
    board: &Board,
    ordered: &Ordered,
) -> Option<(Vec<(Index, Refined)>, f64)> {
    let mut refiner = refiner(image, board, ordered)?;
    let to_image = refiner.to_image;
    let mut indices: Vec<Index> = ordered.nodes.keys().copied().collect();
    indices.sort_unstable();
    let run = |refiner: &Refiner<'_>, index: Index, start: [f64; 2]| {
        refiner.refine(index, start, ordered.steps(index, &to_image)?)
    };
    // The blur from some nodes spread over the board.
    let stride = (indices.len() / 5).max(1);
    let sample: Vec<Index> = indices.iter().copied().step_by(stride).collect();
    let misfit = |refiner: &mut Refiner<'_>, blur_px: f64| {
        refiner.blur_px = blur_px;
        let mut left: Vec<f64> = sample
            .iter()
            .map(|&k| {
                run(refiner, k, ordered.nodes[&k])
                    .map_or(1.0, |r| (r.rms / r.contrast.abs().max(1.0)).min(1.0))
            })
            .collect();
        left.sort_by(f64::total_cmp);
        left[..=left.len() / 2].iter().sum::<f64>()
    };
    let trials = [0.5, 0.7, 0.95, 1.3, 1.8, 2.5, 3.5];
    let mut best = (f64::INFINITY, 1);
    let mut scores: Vec<f64> = Vec::new();
    for &blur_px in &trials {
        scores.push(misfit(&mut refiner, blur_px));
        // Past the minimum: the rest is worse.
        let n = scores.len();
        if n >= 3 && scores[n - 1] > scores[n - 2] && scores[n - 2] > scores[n - 3] {
            break;
        }
    }
    for (k, &score) in scores.iter().enumerate() {
        if score < best.0 {
            best = (score, k);
        }
    }
    let k = best.1;
    refiner.blur_px = trials[k];
    if k > 0 && k + 1 < scores.len() {
        // Vertex of the parabola over log blur.
        let (a, b, c) = (scores[k - 1], scores[k], scores[k + 1]);
        let bend = a - 2.0 * b + c;
        if bend > 0.0 {
            let t = (0.5 * (a - c) / bend).clamp(-0.5, 0.5);
            refiner.blur_px = trials[k] * 1.37f64.powf(t);
        }
    }
    let nodes: Vec<(Index, Refined)> = indices
        .into_iter()
        .filter_map(|index| Some((index, run(&refiner, index, ordered.nodes[&index])?)))
        .collect();
    let blur_px = refiner.blur_px;
    Some((nodes, blur_px))
}

/// Where the lattice is larger than the board, takes off outer rows and columns that hold
/// next to nothing: a corner of the plate happened to lie where a node would.
pub(super) fn drop_thin_borders(nodes: &mut Vec<(Index, Refined)>, wanted: [u32; 2]) {
    for (axis, &most) in wanted.iter().enumerate() {
        loop {
            let mut counts: BTreeMap<i32, usize> = Default::default();
            for n in nodes.iter() {
                *counts.entry(n.0[axis]).or_default() += 1;
            }
            let (Some((&low, &at_low)), Some((&high, &at_high))) =
                (counts.first_key_value(), counts.last_key_value())
            else {
                return;
            };
            let fullest = counts.values().copied().max().unwrap_or(0);
            let (end, count) = if at_low <= at_high {
                (low, at_low)
            } else {
                (high, at_high)
            };
            let larger = (high - low + 1) as u32 > most;
            if !larger || count * 4 > fullest {
                break;
            }
            nodes.retain(|n| n.0[axis] != end);
        }
    }
}

/// Drops groups of nodes that were counted wrongly: where a laser line hides a row, growth may
/// have stepped over it by way of a false candidate and numbered what lies behind one too far.
///
/// Nodes that are neighbours are one group; the largest says by its homography where others
/// must lie, to a quarter of a step: lens and port bend less, a wrong count is a whole one.
pub(super) fn drop_miscounted(nodes: &mut Vec<(Index, Refined)>) {
    let at: BTreeMap<Index, usize> = nodes.iter().enumerate().map(|(n, k)| (k.0, n)).collect();
    let mut group = vec![usize::MAX; nodes.len()];
    let mut sizes = Vec::new();
    for seed in 0..nodes.len() {
        if group[seed] != usize::MAX {
            continue;
        }
        let mut open = vec![seed];
        group[seed] = sizes.len();
        sizes.push(0usize);
        while let Some(n) = open.pop() {
            sizes[group[seed]] += 1;
            let [i, j] = nodes[n].0;
            for next in [[i + 1, j], [i - 1, j], [i, j + 1], [i, j - 1]] {
                if let Some(&m) = at.get(&next)
                    && group[m] == usize::MAX
                {
                    group[m] = group[seed];
                    open.push(m);
                }
            }
        }
    }
    let Some(base) = (0..sizes.len()).max_by_key(|&g| sizes[g]) else {
        return;
    };
    let pairs: Vec<_> = nodes
        .iter()
        .zip(&group)
        .filter(|(_, g)| **g == base)
        .map(|((k, r), _)| (k.map(f64::from), r.position))
        .collect();
    let Some(h) = homography(&pairs) else {
        return;
    };
    let near = |k: Index, position: [f64; 2]| {
        let at = |di: f64, dj: f64| apply(&h, [f64::from(k[0]) + di, f64::from(k[1]) + dj]);
        let (Some(p), Some(a), Some(b)) = (at(0.0, 0.0), at(0.5, 0.0), at(0.0, 0.5)) else {
            return false;
        };
        let half = (a[0] - p[0])
            .hypot(a[1] - p[1])
            .min((b[0] - p[0]).hypot(b[1] - p[1]));
        (position[0] - p[0]).hypot(position[1] - p[1]) < 0.5 * half
    };
    let mut votes = vec![0usize; sizes.len()];
    for ((k, r), &g) in nodes.iter().zip(&group) {
        votes[g] += usize::from(near(*k, r.position));
    }
    let mut n = 0;
    nodes.retain(|_| {
        n += 1;
        let g = group[n - 1];
        g == base || votes[g] * 2 > sizes[g]
    });
}

/// Drops nodes that one smooth map of the whole board does not explain: a homography and,
/// for lens and port, a cubic on top (it leaves 0.1 px of a strong lens). `None` when there
/// is no such map.
pub(super) fn drop_strays(nodes: &mut Vec<(Index, Refined)>) -> Option<()> {
    const STRAY_PX: f64 = 0.15;
    // No lens leaves this much after a cubic: a map that does is bent by false nodes.
    const WORST_STRAY_PX: f64 = 1.0;
    let pairs: Vec<_> = nodes
        .iter()
        .map(|(k, r)| (k.map(f64::from), r.position))
        .collect();
    let h = homography(&pairs)?;
    let high = [0, 1].map(|k| nodes.iter().map(|n| n.0[k]).max().unwrap_or(1).max(1));
    let terms: Vec<([f64; 10], [f64; 2])> = pairs
        .iter()
        .map(|(k, p)| {
            let q = apply(&h, *k)?;
            let x = 2.0 * k[0] / f64::from(high[0]) - 1.0;
            let y = 2.0 * k[1] / f64::from(high[1]) - 1.0;
            Some((
                [
                    1.0,
                    x,
                    y,
                    x * x,
                    x * y,
                    y * y,
                    x * x * x,
                    x * x * y,
                    x * y * y,
                    y * y * y,
                ],
                [p[0] - q[0], p[1] - q[1]],
            ))
        })
        .collect::<Option<_>>()?;
    let mut off = vec![0.0f64; terms.len()];
    for _ in 0..6 {
        let mut sorted = off.clone();
        sorted.sort_by(f64::total_cmp);
        let scale = sorted[sorted.len() / 2].max(0.05);
        let mut normal = SMatrix::<f64, 10, 10>::identity() * 1e-6;
        let mut right = SMatrix::<f64, 10, 2>::zeros();
        for ((t, e), off) in terms.iter().zip(&off) {
            let row = SVector::<f64, 10>::from_column_slice(t);
            // Cauchy: a stray of many pixels hardly pulls.
            let weight = 1.0 / (1.0 + (off / (2.0 * scale)).powi(2));
            normal += row * row.transpose() * weight;
            right += row * nalgebra::RowVector2::new(e[0], e[1]) * weight;
        }
        let solved = normal.cholesky()?.solve(&right);
        for ((t, e), off) in terms.iter().zip(&mut off) {
            let model = solved.transpose() * SVector::<f64, 10>::from_column_slice(t);
            *off = (e[0] - model[0]).hypot(e[1] - model[1]);
        }
    }
    let mut sorted = off.clone();
    sorted.sort_by(f64::total_cmp);
    let limit = (6.0 * sorted[sorted.len() / 2]).clamp(STRAY_PX, WORST_STRAY_PX);
    let mut k = 0;
    nodes.retain(|_| {
        k += 1;
        off[k - 1] < limit
    });
    Some(())
}
