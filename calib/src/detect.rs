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

use crate::board;
use crate::map::Node;
use crate::map::geometry::apply;
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
/// [`NotFound`] says why there is none.
pub fn detect(image: &Grey<'_>, board: &Board) -> Result<Detection, NotFound> {
    reason::refuse_empty(image)?;
    let Some((lattice, candidates, rest)) = coarse(image, board) else {
        return Err(reason::explain(image, board));
    };
    let wanted = (board.columns * board.rows) as usize;
    let other = rest.grow(image, board, wanted);
    if let Some(second) = other {
        return Err(NotFound::TwoBoards {
            first: lattice.nodes.len(),
            second,
        });
    }
    let mut ordered = Ordered::upright(&lattice, &candidates);
    let orientation = place(image, board, &mut ordered)?;
    let (nodes, blur_px) = fine(image, board, &ordered).ok_or(NotFound::NoBoard {
        seen: lattice.nodes.len(),
    })?;
    if blur_px >= WORST_BLUR_PX {
        return Err(NotFound::Blurred { blur_px });
    }
    let median = |values: &mut Vec<f64>| -> f64 {
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or(0.0)
    };
    if std::env::var("DBG").is_ok() { eprintln!("coarse {} refined {}", ordered.nodes.len(), nodes.len()); for n in &nodes { eprintln!("{:?} c {:.1} rms {:.1} sd {:.3}", n.0, n.1.contrast, n.1.rms, n.1.covariance[(0,0)].sqrt()); } }
    let contrast = median(&mut nodes.iter().map(|n| n.1.contrast.abs()).collect());
    let noise = median(&mut nodes.iter().map(|n| n.1.rms).collect());
    let mut kept: Vec<BoardNode> = nodes
        .iter()
        .filter(|(_, r)| {
            let sd = r.covariance[(0, 0)].max(r.covariance[(1, 1)]).sqrt();
            sd <= WORST_SD_PX
                && r.contrast.abs() > 0.2 * contrast
                && r.rms < (3.0 * noise).max(0.06 * r.contrast.abs())
        })
        .filter(|(index, _)| {
            (0..board.columns as i32).contains(&index[0])
                && (0..board.rows as i32).contains(&index[1])
        })
        .map(|(index, r)| {
            let (i, j) = (index[0] as u32, index[1] as u32);
            let [xi_m, eta_m] = board::node_m(board, i, j);
            BoardNode {
                i,
                j,
                node: Node {
                    xi_m,
                    eta_m,
                    column_px: r.position[0],
                    row_px: r.position[1],
                    covariance_px2: r.covariance,
                },
            }
        })
        .collect();
    drop_strays(&mut kept);
    kept.sort_by_key(|n| (n.j, n.i));
    if kept.len() < fewest(board) {
        return Err(reason::explain(image, board));
    }
    Ok(Detection {
        left_out: wanted - kept.len(),
        nodes: kept,
        orientation,
        blur_px,
        noise,
        contrast,
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
    fn grow(&self, _image: &Grey<'_>, board: &Board, wanted: usize) -> Option<usize> {
        let field = Field::new(&self.candidates, &self.plane, board.pattern, |n| {
            !self.used[n] && self.candidates[n].strength > self.weakest
        });
        let second = field.grow_best([board.columns, board.rows], wanted);
        let [ni, nj] = second.extent();
        (second.nodes.len() >= fewest(board).max(16) && ni.min(nj) >= 4)
            .then_some(second.nodes.len())
    }
}

/// The best lattice over the reductions of the image.
fn coarse(image: &Grey<'_>, board: &Board) -> Option<(Lattice, Vec<Candidate>, Rest)> {
    let wanted = (board.columns * board.rows) as usize;
    let mut best: Option<(Lattice, Vec<Candidate>, Plane)> = None;
    for reduction in [2, 1, 4] {
        let plane = Plane::smoothed(image, reduction);
        let candidates = candidates::find(&plane, board.pattern, 4 * wanted + 200);
        let field = Field::new(&candidates, &plane, board.pattern, |_| true);
        // One row and column more than the board has: a larger board shows as such.
        let lattice = field.grow_best([board.columns + 2, board.rows + 2], wanted * 95 / 100);
        if best
            .as_ref()
            .is_none_or(|b| lattice.nodes.len() > b.0.nodes.len())
        {
            let done = lattice.nodes.len() * 10 >= wanted * 8;
            best = Some((lattice, candidates, plane));
            if done {
                break;
            }
        }
    }
    let (lattice, candidates, plane) = best?;
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

/// Gives the nodes their indices on the board.
fn place(image: &Grey<'_>, board: &Board, ordered: &mut Ordered) -> Result<Orientation, NotFound> {
    let seen = ordered.extent();
    let wanted = [board.columns, board.rows];
    let h = ordered.homography().ok_or(NotFound::NoBoard {
        seen: ordered.nodes.len(),
    })?;
    let key = board::key(board);
    if let Some((turns, shift)) = key.and_then(|k| ordered.find_key(image, board, &k, &h)) {
        ordered.turn(turns);
        ordered.shift(shift);
        let outside = ordered.nodes.keys().any(|k| {
            !(0..wanted[0] as i32).contains(&k[0]) || !(0..wanted[1] as i32).contains(&k[1])
        });
        return if outside {
            Err(NotFound::WrongBoard {
                seen,
                wanted,
                pattern: None,
            })
        } else {
            Ok(Orientation::KeySeen)
        };
    }
    if seen == wanted {
        return Ok(Orientation::UprightAssumed);
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

/// All nodes refined, with the blur that fits them best.
fn fine(
    image: &Grey<'_>,
    board: &Board,
    ordered: &Ordered,
) -> Option<(Vec<(Index, Refined)>, f64)> {
    let to_image = ordered.homography()?;
    let mut refiner = Refiner {
        image,
        board,
        to_image,
        to_index: to_image.try_inverse()?,
        blur_px: 1.0,
    };
    // An inverse homography is one up to its sign.
    let any = *ordered.nodes.keys().min()?;
    if apply(&refiner.to_index, apply(&to_image, any.map(f64::from))?).is_none() {
        refiner.to_index = -refiner.to_index;
    }
    let mut indices: Vec<Index> = ordered.nodes.keys().copied().collect();
    indices.sort_unstable();
    let run = |refiner: &Refiner<'_>, index: Index, start: [f64; 2]| {
        refiner.refine(index, start, ordered.steps(index, &to_image)?)
    };
    // The blur from some nodes spread over the board.
    let stride = (indices.len() / 8).max(1);
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
    let scores: Vec<f64> = trials.iter().map(|&b| misfit(&mut refiner, b)).collect();
    for (k, &score) in scores.iter().enumerate() {
        if score < best.0 {
            best = (score, k);
        }
    }
    let k = best.1;
    refiner.blur_px = trials[k];
    if k > 0 && k + 1 < trials.len() {
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

/// Drops nodes that do not lie where their neighbours on both sides put them: lines are
/// smooth, whatever lens and water do to them.
fn drop_strays(nodes: &mut Vec<BoardNode>) {
    let at: HashMap<[i64; 2], [f64; 2]> = nodes
        .iter()
        .map(|n| {
            (
                [i64::from(n.i), i64::from(n.j)],
                [n.node.column_px, n.node.row_px],
            )
        })
        .collect();
    nodes.retain(|n| {
        let (i, j) = (i64::from(n.i), i64::from(n.j));
        let mut off = Vec::new();
        for (di, dj) in [(1, 0), (0, 1)] {
            let p = |k: i64| at.get(&[i + k * di, j + k * dj]);
            // Fourth difference: zero for a cubic.
            if let (Some(a), Some(b), Some(c), Some(d)) = (p(-2), p(-1), p(1), p(2)) {
                let e = [0, 1].map(|k| (4.0 * (b[k] + c[k]) - a[k] - d[k]) / 6.0);
                off.push((e[0] - n.node.column_px).hypot(e[1] - n.node.row_px));
            }
        }
        // A stray spoils its neighbours' differences too, by two thirds at most: only a
        // node that is off in every direction it can be checked in is one.
        off.is_empty() || off.iter().any(|&d| d < 0.6)
    });
}

/// Whether a coarse lattice of another pattern is seen; for the reasons only.
pub(super) fn seen_as(image: &Grey<'_>, board: &Board, pattern: BoardPattern) -> Option<[u32; 2]> {
    let other = Board {
        pattern,
        ..board.clone()
    };
    coarse(image, &other).map(|(lattice, ..)| lattice.extent())
}

#[cfg(test)]
mod tests;
