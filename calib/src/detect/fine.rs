//! All nodes of a lattice refined with the blur they share, and which of them are kept.

use std::collections::{BTreeMap, HashMap};

use super::identify::Ordered;
use super::image::Grey;
use super::lattice::Index;
use super::refine::{Refined, Refiner};
use super::shared::{self, Place};
use crate::map::geometry::{apply, homography};
use hydroline_rigs::Board;

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
        blur_px: [1.0; 2],
        tone: None,
    })
}

/// Mean misfit over contrast of the better half of a sample that no other blur will mend; a fit that
/// does not converge counts 1.
const HOPELESS: f64 = 0.5;

/// All nodes refined, with the blur that fits them best.
pub(super) fn fine<'a>(
    image: &'a Grey<'a>,
    board: &'a Board,
    ordered: &Ordered,
) -> Option<(Vec<(Index, Refined)>, Refiner<'a>)> {
    let mut refiner = refiner(image, board, ordered)?;
    let to_image = refiner.to_image;
    let mut indices: Vec<Index> = ordered.nodes.keys().copied().collect();
    indices.sort_unstable();
    let run = |refiner: &Refiner<'_>, index: Index, start: [f64; 2]| {
        refiner.refine(index, start, ordered.steps(index, &to_image)?)
    };
    // The blur from some nodes spread over the board.
    let stride = (indices.len() / 6).max(1);
    let sample: Vec<Index> = indices.iter().copied().step_by(stride).collect();
    let misfit = |refiner: &mut Refiner<'_>, blur_px: f64| {
        refiner.blur_px = [blur_px; 2];
        let fits: Vec<Option<Refined>> = sample
            .iter()
            .map(|&k| run(refiner, k, ordered.nodes[&k]))
            .collect();
        let mut left: Vec<f64> = fits
            .iter()
            .map(|r| {
                r.as_ref()
                    .map_or(1.0, |r| (r.rms / r.contrast.abs().max(1.0)).min(1.0))
            })
            .collect();
        left.sort_by(f64::total_cmp);
        let sound = fits.iter().flatten().filter(|r| r.is_pattern()).count();
        let better = &left[..=left.len() / 2];
        (better.iter().sum::<f64>() / better.len() as f64, sound)
    };
    let trials = [0.5, 0.7, 0.95, 1.3, 1.8, 2.5, 3.5];
    let mut scores: Vec<Option<f64>> = vec![None; trials.len()];
    let mut most_sound = 0;
    // Downhill from the blur of a good lens: most images need three or four of the trials.
    let mut k = 2usize;
    // A lattice that three blurs leave unexplained, and a soft image's blur as well, is no such pattern, and not
    // worth the walk: of a board, fits at the next trial's blur leave a tenth of the contrast.
    let hopeless = [2, 1, 3, 5].into_iter().all(|near| {
        let (score, sound) = misfit(&mut refiner, trials[near]);
        scores[near] = Some(score);
        most_sound = most_sound.max(sound);
        score > HOPELESS
    });
    if hopeless {
        return None;
    }
    loop {
        for near in [k, k.saturating_sub(1), (k + 1).min(trials.len() - 1)] {
            if scores[near].is_none() {
                let (score, sound) = misfit(&mut refiner, trials[near]);
                scores[near] = Some(score);
                most_sound = most_sound.max(sound);
            }
        }
        let tried = |k: usize| scores.get(k).copied().flatten().unwrap_or(f64::INFINITY);
        let lower = if k > 0 { tried(k - 1) } else { f64::INFINITY };
        let upper = tried(k + 1);
        if lower < tried(k) && lower <= upper {
            k -= 1;
        } else if upper < tried(k) {
            k += 1;
        } else {
            break;
        }
    }
    let mut blur_px = trials[k];
    let tried = |k: usize| scores.get(k).copied().flatten();
    if k > 0
        && let (Some(a), Some(b), Some(c)) = (tried(k - 1), tried(k), tried(k + 1))
    {
        // Vertex of the parabola over log blur.
        let curvature = a - 2.0 * b + c;
        if curvature > 0.0 {
            let t = (0.5 * (a - c) / curvature).clamp(-0.5, 0.5);
            blur_px = trials[k] * 1.37f64.powf(t);
        }
    }
    refiner.blur_px = [blur_px; 2];
    let places: Vec<Place> = (sample.iter())
        .filter_map(|&k| Some((k, ordered.nodes[&k], ordered.steps(k, &to_image)?)))
        .collect();
    let known = shared::settle(&mut refiner, &places);
    let sound = known.values().flatten().filter(|r| r.is_pattern()).count();
    most_sound = most_sound.max(sound);
    // Half of a board's nodes must hold in the end: where hardly any of the sample does, the
    // rest of this lattice is not worth its time.
    if most_sound * 4 < sample.len() {
        return None;
    }
    // A quarter of the nodes first, spread over the lattice: half of a board's nodes must hold in
    // the end, and what is no board is not worth the rest of the time.
    let mut nodes: Vec<(Index, Refined)> = Vec::with_capacity(indices.len());
    for part in 0..4 {
        let some = indices.iter().skip(part).step_by(4);
        nodes.extend(some.filter_map(|&index| {
            let fit = match known.get(&index) {
                Some(fit) => *fit,
                None => run(&refiner, index, ordered.nodes[&index]),
            };
            Some((index, fit?))
        }));
        let sound = nodes.iter().filter(|n| n.1.is_pattern()).count();
        if part == 0 && sound * 10 < indices.len().div_ceil(4) * 4 {
            return None;
        }
    }
    nodes.sort_by_key(|n| n.0);
    Some((nodes, refiner))
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
/// must lie, to a quarter of a step: lens and port distort less, a wrong count is a whole one.
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
