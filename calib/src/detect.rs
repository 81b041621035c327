//! A board's nodes in a grey image, sub-pixel, each with its covariance.
//!
//! Candidates from one filter ([`candidates`]), a lattice grown from a seed ([`lattice`]),
//! its order in the world ([`identify`]), and the pattern fitted to the pixels of every
//! node ([`refine`]). What is uncertain is left out; what is not a board gets a reason.
//! Boards are dark marks on a light face.

mod candidates;
mod identify;
mod image;
mod lattice;
mod reason;
mod refine;
pub mod synthetic;

pub use image::Grey;
pub use reason::NotFound;

use std::collections::HashMap;

use hydroline_rigs::{Board, BoardPattern};
use nalgebra::{SMatrix, SVector};

use crate::board;
use crate::map::Node;
use crate::map::geometry::{apply, homography};
use candidates::Candidate;
use identify::Ordered;
use image::Plane;
use lattice::{Field, Index, Lattice};
use refine::{Refined, Refiner};

/// How the origin of the nodes was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Orientation {
    /// The key was seen: origin and rotation are certain.
    KeySeen,
    /// No key: the board is assumed to stand upright (η within 45° of the image's up), and
    /// all its columns and rows are in view.
    UprightAssumed,
}

/// A node found: its index on the board and where it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoardNode {
    /// Along ξ, from 0.
    pub i: u32,
    /// Along η, from 0.
    pub j: u32,
    /// Place on the board and in the image.
    pub node: Node,
}

/// A board found.
#[derive(Debug, Clone, PartialEq)]
pub struct Detection {
    /// Nodes, by row and column.
    pub nodes: Vec<BoardNode>,
    /// How the origin was found.
    pub orientation: Orientation,
    /// Nodes of the board that were hidden, or seen but too uncertain.
    pub left_out: usize,
    /// Point spread, standard deviation \[px\], pixel size included.
    pub blur_px: f64,
    /// Median of what the fits left \[grey levels\]: noise, and what is not modelled.
    pub noise: f64,
    /// Median contrast of the pattern \[grey levels\].
    pub contrast: f64,
}

impl Detection {
    /// The nodes for a map.
    pub fn nodes(&self) -> Vec<Node> {
        self.nodes.iter().map(|n| n.node).collect()
    }
}

/// Largest standard deviation \[px\] of a node that is kept.
pub const WORST_SD_PX: f64 = 0.15;
/// More blur than this \[px\] and lines 2 mm wide are gone.
pub const WORST_BLUR_PX: f64 = 3.0;

/// Finds the board.
///
/// # Errors
/// [`NotFound`] says why there is none; looking for the reason takes several times as long
/// as looking for the board.
pub fn detect(image: &Grey<'_>, board: &Board) -> Result<Detection, NotFound> {
    match detect_quick(image, board) {
        Err(NotFound::NoBoard { .. }) => Err(reason::explain(image, board)),
        answer => answer,
    }
}

/// Finds the board as [`detect`] does, without looking further where there is none: for
/// every frame of a running camera, `detect` then being asked once a second.
///
/// # Errors
/// [`NotFound`]; [`NotFound::NoBoard`] stands for all reasons that need a second look.
pub fn detect_quick(image: &Grey<'_>, board: &Board) -> Result<Detection, NotFound> {
    reason::refuse_empty(image)?;
    let Some(seen) = see(image, board) else {
        return Err(NotFound::NoBoard { seen: 0 });
    };
    if seen.blur_px >= WORST_BLUR_PX {
        return Err(NotFound::Blurred {
            blur_px: seen.blur_px,
        });
    }
    let wanted = (board.columns * board.rows) as usize;
    if let Some(second) = seen.rest.grow(board, wanted) {
        return Err(NotFound::TwoBoards {
            first: seen.nodes.len(),
            second,
        });
    }
    let (orientation, turns, shift) = place(image, board, &seen.ordered)?;
    let mut kept: Vec<BoardNode> = Vec::with_capacity(wanted);
    for (index, r) in &seen.nodes {
        let [i, j] = identify::turn_index(*index, turns);
        let (i, j) = (i + shift[0], j + shift[1]);
        if !(0..board.columns as i32).contains(&i) || !(0..board.rows as i32).contains(&j) {
            continue;
        }
        let (i, j) = (i as u32, j as u32);
        let [xi_m, eta_m] = board::node_m(board, i, j);
        kept.push(BoardNode {
            i,
            j,
            node: Node {
                xi_m,
                eta_m,
                column_px: r.position[0],
                row_px: r.position[1],
                covariance_px2: r.covariance,
            },
        });
    }
    kept.sort_by_key(|n| (n.j, n.i));
    Ok(Detection {
        left_out: wanted - kept.len(),
        nodes: kept,
        orientation,
        blur_px: seen.blur_px,
        noise: seen.noise,
        contrast: seen.contrast,
    })
}

/// A lattice that really is the pattern, node by node.
struct Seen {
    ordered: Ordered,
    nodes: Vec<(Index, Refined)>,
    rest: Rest,
    blur_px: f64,
    noise: f64,
    contrast: f64,
}

/// The board's pattern in upright order; `None` where no lattice holds what it promises.
///
/// Half size first: most boards are found there, four times faster; then full size for
/// thin lines, then a quarter for large marks. Dots are large: a quarter first.
fn see(image: &Grey<'_>, board: &Board) -> Option<Seen> {
    let mut best: Option<Seen> = None;
    let reductions = match board.pattern {
        BoardPattern::Dots { .. } => [4, 2, 1],
        _ => [2, 1, 4],
    };
    for reduction in reductions {
        if let Some(seen) = see_at(image, board, reduction)
            && best
                .as_ref()
                .is_none_or(|b| seen.nodes.len() > b.nodes.len())
        {
            let enough = (board.columns * board.rows) as usize * 7 / 10;
            let done = seen.nodes.len() >= enough;
            best = Some(seen);
            if done {
                break;
            }
        }
    }
    best
}

fn see_at(image: &Grey<'_>, board: &Board, reduction: usize) -> Option<Seen> {
    let (lattice, candidates, rest) = coarse(image, board, reduction)?;
    let mut ordered = Ordered::upright(&lattice, &candidates);
    if matches!(board.pattern, BoardPattern::Dots { .. }) {
        centre_dots(image, board, &mut ordered);
    }
    let (mut nodes, blur_px) = fine(image, board, &ordered)?;
    let median = |mut values: Vec<f64>| -> f64 {
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or(0.0)
    };
    // Corners of a chessboard alternate; lines and dots are dark. What differs is none.
    let signed = |(index, r): &(Index, Refined)| match board.pattern {
        BoardPattern::Chessboard if (index[0] + index[1]) % 2 != 0 => -r.contrast,
        _ => r.contrast,
    };
    let contrast = median(nodes.iter().map(signed).collect());
    let noise = median(nodes.iter().map(|n| n.1.rms).collect());
    nodes.retain(|n| {
        let sd = n.1.covariance[(0, 0)].max(n.1.covariance[(1, 1)]).sqrt();
        sd <= WORST_SD_PX
            && signed(n) * contrast.signum() > 0.2 * contrast.abs()
            // A crossing of which only one line is there leaves a fifth of its contrast; the
            // median of what others leave is no measure when all of them are wrong.
            && n.1.rms < (0.1 * n.1.contrast.abs()).max(4.0)
            && n.1.rms < (3.0 * noise).max(0.06 * n.1.contrast.abs())
    });
    let before = nodes.len();
    drop_strays(&mut nodes)?;
    let sound = nodes.len() >= fewest(board)
        && nodes.len() * 10 >= ordered.nodes.len() * 5
        && nodes.len() * 10 >= before * 8
        && contrast.abs() > 8.0;
    drop_thin_borders(&mut nodes, [board.columns, board.rows]);
    // Only what held under the pattern's fit says how far the lattice reaches.
    let found: std::collections::HashSet<Index> = nodes.iter().map(|n| n.0).collect();
    ordered.nodes.retain(|k, _| found.contains(k));
    let low = ordered.rebase();
    for n in &mut nodes {
        n.0 = [n.0[0] - low[0], n.0[1] - low[1]];
    }
    sound.then_some(Seen {
        ordered,
        nodes,
        rest,
        blur_px,
        noise,
        contrast: contrast.abs(),
    })
}

/// Fewest nodes that count as a board: three in ten, and enough to be no accident.
pub(super) fn fewest(board: &Board) -> usize {
    ((board.columns * board.rows) as usize * 3 / 10).max(12)
}

/// Candidates that the lattice did not use, for the search of a second board.
struct Rest {
    plane: Plane,
    candidates: Vec<Candidate>,
    used: Vec<bool>,
    weakest: f32,
}

impl Rest {
    /// Nodes of a second board, if there is one.
    fn grow(&self, board: &Board, wanted: usize) -> Option<usize> {
        let field = Field::new(&self.candidates, &self.plane, board.pattern, |n| {
            !self.used[n] && self.candidates[n].strength > self.weakest
        });
        let second = field.grow_best([board.columns, board.rows], wanted);
        let [ni, nj] = second.extent();
        (second.nodes.len() >= fewest(board).max(16) && ni.min(nj) >= 4)
            .then_some(second.nodes.len())
    }
}

/// The best lattice at one reduction of the image.
fn coarse(
    image: &Grey<'_>,
    board: &Board,
    reduction: usize,
) -> Option<(Lattice, Vec<Candidate>, Rest)> {
    let wanted = (board.columns * board.rows) as usize;
    let plane = Plane::smoothed(image, reduction);
    let candidates = candidates::find(&plane, board.pattern, 4 * wanted + 200);
    let field = Field::new(&candidates, &plane, board.pattern, |_| true);
    // Two rows and columns more than the board has: a larger board shows as such.
    let lattice = field.grow_best([board.columns + 2, board.rows + 2], wanted * 95 / 100);
    let [ni, nj] = lattice.extent();
    if lattice.nodes.len() < fewest(board) || ni.min(nj) < 3 {
        return None;
    }
    // What lies inside the lattice (key discs, squares) is part of it.
    let hull = crate::map::Region::hull(lattice.nodes.values().map(|&n| candidates[n].position));
    let mut used: Vec<bool> = candidates
        .iter()
        .map(|c| hull.contains(c.position[0], c.position[1]))
        .collect();
    let mut weakest = f32::INFINITY;
    for &n in lattice.nodes.values() {
        used[n] = true;
        weakest = weakest.min(candidates[n].strength);
    }
    let rest = Rest {
        plane,
        candidates: candidates.clone(),
        used,
        weakest: 0.5 * weakest,
    };
    Some((lattice, candidates, rest))
}

/// Quarter turns and shift that bring upright indices to those on the board.
fn place(
    image: &Grey<'_>,
    board: &Board,
    ordered: &Ordered,
) -> Result<(Orientation, usize, Index), NotFound> {
    let seen = ordered.extent();
    let wanted = [board.columns, board.rows];
    let h = ordered.homography().ok_or(NotFound::NoBoard {
        seen: ordered.nodes.len(),
    })?;
    let key = board::key(board);
    if let Some((turns, shift)) = key.and_then(|k| ordered.find_key(image, board, &k, &h)) {
        return Ok((Orientation::KeySeen, turns, shift));
    }
    if seen == wanted {
        return Ok((Orientation::UprightAssumed, 0, [0, 0]));
    }
    if seen == [wanted[1], wanted[0]] {
        return Err(NotFound::NotUpright { seen, wanted });
    }
    if seen[0] > wanted[0] || seen[1] > wanted[1] {
        return Err(NotFound::WrongBoard {
            seen,
            wanted,
            pattern: None,
        });
    }
    // Fewer than the board has: cut by the image's border, or another board.
    let (w, height) = (image.width() as f64, image.height() as f64);
    let inside = |p: [f64; 2]| p[0] > 8.0 && p[1] > 8.0 && p[0] < w - 9.0 && p[1] < height - 9.0;
    let complete = [0usize, 1].into_iter().all(|axis| {
        if seen[axis] == wanted[axis] {
            return true;
        }
        [-1.0, f64::from(seen[axis])].into_iter().all(|beyond| {
            let across = seen[1 - axis];
            (0..across)
                .filter(|&k| {
                    let mut at = [f64::from(k); 2];
                    at[axis] = beyond;
                    apply(&h, at).is_some_and(inside)
                })
                .count()
                * 2
                > across as usize
        })
    });
    Err(if complete {
        NotFound::WrongBoard {
            seen,
            wanted,
            pattern: None,
        }
    } else {
        NotFound::PartlySeen { seen, wanted }
    })
}

/// Moves coarse dots to their middles, so that the local steps become good to a per cent.
fn centre_dots(image: &Grey<'_>, board: &Board, ordered: &mut Ordered) {
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
fn fine(
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
fn drop_thin_borders(nodes: &mut Vec<(Index, Refined)>, wanted: [u32; 2]) {
    for (axis, &most) in wanted.iter().enumerate() {
        loop {
            let mut counts: std::collections::BTreeMap<i32, usize> = Default::default();
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

/// Drops nodes that one smooth map of the whole board does not explain: a homography and,
/// for lens and port, a cubic on top (it leaves 0.1 px of a strong lens). `None` when there
/// is no such map.
fn drop_strays(nodes: &mut Vec<(Index, Refined)>) -> Option<()> {
    const STRAY_PX: f64 = 0.15;
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
    let limit = (6.0 * sorted[sorted.len() / 2]).max(STRAY_PX);
    let mut k = 0;
    nodes.retain(|_| {
        k += 1;
        off[k - 1] < limit
    });
    Some(())
}

/// Columns and rows of another pattern, if that is seen; for the reasons only.
pub(super) fn seen_as(image: &Grey<'_>, board: &Board, pattern: BoardPattern) -> Option<[u32; 2]> {
    let other = Board {
        pattern,
        ..board.clone()
    };
    see(image, &other).map(|seen| seen.ordered.extent())
}

#[cfg(test)]
mod tests;
