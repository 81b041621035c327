//! A board's nodes in a grey image, sub-pixel, each with its covariance.
//!
//! Candidates from one filter ([`candidates`]), a lattice grown from a seed ([`lattice`]),
//! its order in the world ([`identify`]), and the pattern fitted to the pixels of every
//! node ([`refine`]). What is uncertain is discarded; what is not a board gets a reason.
//! Boards are dark marks on a light face.

mod candidates;
mod coarse;
mod ends;
mod fine;
mod identify;
mod image;
mod in_hand;
mod key;
mod lattice;
mod line;
mod markers;
mod marks;
mod reason;
mod refine;
mod shared;
mod smooth;
mod surroundings;
mod tone;

pub(crate) use ends::part;
pub(crate) use identify::turn_index;
pub use image::Grey;
pub use in_hand::{InHand, LatticeNode, detect_in_hand};
pub use line::{LinePoint, NoLine, find_line};
pub use reason::NotFound;

use hydroline_rigs::{Board, BoardPattern};

use crate::board;
use crate::charuco::Markers;
use crate::map::Node;
use coarse::{Coarse, Rest, coarse};
use fine::{centre_dots, drop_miscounted, drop_thin_borders, fine};
use identify::{Ordered, place};
use image::Plane;
use key::KeySearch;
use lattice::{Field, Index};
use refine::Refined;
use smooth::{drop_strays, fill};

/// How the origin of the nodes was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Orientation {
    /// The key was seen: origin and rotation are certain.
    KeySeen,
    /// The board carries no key: it is assumed to stand upright (η within 45° of the image's up);
    /// all its columns and rows are in view, and so is that nothing follows them.
    UprightAssumed,
    /// Whether there is a key cannot be seen (a hand, a laser line, poor light): the indices are
    /// those of a board that stands upright, but nothing may rest on them.
    KeyHidden,
}

impl Orientation {
    /// Whether nodes may be used under their indices.
    pub fn is_usable(self) -> bool {
        self != Orientation::KeyHidden
    }
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
    /// γ of the camera's tone curve, where the board shows one; `None`: levels are as good as light.
    pub gamma: Option<f64>,
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
        Err(NotFound::NoBoard) => Err(reason::explain(image, board)),
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
    let Some(seen) = see(image, board, fewest(board)) else {
        return Err(NotFound::NoBoard);
    };
    if seen.blur_px >= WORST_BLUR_PX {
        return Err(NotFound::Blurred {
            blur_px: seen.blur_px,
        });
    }
    let wanted = (board.columns * board.rows) as usize;
    if let Some(second) = seen.rest.second(image, board, &seen) {
        return Err(NotFound::TwoBoards {
            first: seen.nodes.len(),
            second,
        });
    }
    let key = seen.key(image, board)?;
    let (orientation, turns, shift) = place(image, board, &seen.ordered, seen.contrast, key)?;
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
        gamma: seen.gamma,
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
    /// Whether the squares with an even sum of indices are light; of a chessboard.
    light_even: bool,
    gamma: Option<f64>,
}

impl Seen {
    /// What the board's key or its markers say; `None` of a board that has neither.
    fn key(&self, image: &Grey<'_>, board: &Board) -> Result<Option<KeySearch>, NotFound> {
        if let Some(markers) = Markers::of(board) {
            let (map, _) = smooth::Smooth::fit(&self.nodes).ok_or(NotFound::NoBoard)?;
            let asked = markers::Asked {
                image,
                map: &map,
                nodes: &self.nodes.iter().map(|n| n.0).collect(),
                light_even: self.light_even,
                contrast: self.contrast,
                blur_px: self.blur_px,
            };
            return asked.search(&markers).map(Some);
        }
        let h = self.ordered.homography().ok_or(NotFound::NoBoard)?;
        let key = board::key(board);
        Ok(key.map(|key| (self.ordered).find_key(image, board, &key, &h, self.contrast)))
    }
}

/// The board's pattern in upright order; `None` where no lattice is consistent.
///
/// Half size first: most boards are found there, four times faster; then full size for
/// thin lines, then a quarter for large marks. Dots are large: a quarter first. Lattices are
/// cheap beside the fit of their nodes, so one that is not the whole board waits for what
/// the next size shows. `fewest`: nodes that count as a board.
fn see(image: &Grey<'_>, board: &Board, fewest: usize) -> Option<Seen> {
    let wanted = [board.columns, board.rows];
    let enough = (board.columns * board.rows) as usize * 7 / 10;
    let reductions: &[usize] = match board.pattern {
        BoardPattern::Dots { .. } => &[4, 2, 1],
        // Markers' bits are a tenth of a square's size and full of corners: in one of these they have vanished, and the
        // squares have not.
        BoardPattern::Charuco { .. } => &[4, 2, 8, 3, 6, 1, 12],
        _ => &[2, 1, 4],
    };
    let mut lattices: Vec<(bool, Coarse)> = Vec::new();
    let mut best: Option<Seen> = None;
    for (tried, reduction) in reductions.iter().enumerate() {
        if let Some(found) = coarse(image, board, *reduction, fewest) {
            let [ni, nj] = found.0.extent();
            let whole = [ni, nj] == wanted || [nj, ni] == wanted;
            lattices.push((whole && found.0.nodes.len() >= enough, found));
        }
        let last = tried + 1 == reductions.len();
        let promising = lattices
            .iter()
            .any(|(whole, l)| *whole || (tried > 0 && l.0.nodes.len() >= enough));
        if !promising && !last {
            continue;
        }
        lattices.sort_by_key(|(whole, l)| std::cmp::Reverse((*whole, l.0.nodes.len())));
        for (_, found) in lattices.drain(..) {
            if let Some(seen) = see_in(image, board, found, fewest)
                && best
                    .as_ref()
                    .is_none_or(|b| seen.nodes.len() > b.nodes.len())
            {
                best = Some(seen);
            }
            if best.as_ref().is_some_and(|b| b.nodes.len() >= enough) {
                return best;
            }
        }
    }
    best
}

fn see_in(
    image: &Grey<'_>,
    board: &Board,
    (lattice, candidates, rest): Coarse,
    fewest: usize,
) -> Option<Seen> {
    let mut ordered = Ordered::upright(&lattice, &candidates);
    if matches!(board.pattern, BoardPattern::Dots { .. }) {
        centre_dots(image, board, &mut ordered);
    }
    markers::sharpen(image, board, rest.plane.reduction, &mut ordered);
    let (mut nodes, refiner) = fine(image, board, &ordered)?;
    let median = |mut values: Vec<f64>| -> f64 {
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or(0.0)
    };
    // Corners of a chessboard alternate; lines and dots are dark. What differs is none.
    let signed = |(index, r): &(Index, Refined)| match board.pattern {
        pattern if pattern.is_chess() && (index[0] + index[1]) % 2 != 0 => -r.contrast,
        _ => r.contrast,
    };
    let contrast = median(nodes.iter().map(signed).collect());
    let noise = median(nodes.iter().map(|n| n.1.rms).collect());
    let holds = |index: Index, r: &Refined| {
        let sd = r.covariance[(0, 0)].max(r.covariance[(1, 1)]).sqrt();
        sd <= WORST_SD_PX
            && signed(&(index, *r)) * contrast.signum() > 0.2 * contrast.abs()
            // The median of what others leave is no measure when all of them are wrong.
            && r.is_pattern()
            && r.rms < (3.0 * noise).max(0.06 * r.contrast.abs())
    };
    nodes.retain(|(index, r)| holds(*index, r));
    drop_miscounted(&mut nodes);
    let before = nodes.len();
    let map = drop_strays(&mut nodes)?;
    // Markers' corners get into a lattice on their side of the board; the markers say later whether the rest is one.
    let least_share = match board.pattern {
        BoardPattern::Charuco { .. } => 3,
        _ => 5,
    };
    let sound = nodes.len() >= fewest
        && nodes.len() * 10 >= ordered.nodes.len() * least_share
        && nodes.len() * 10 >= before * 8
        && contrast.abs() > 8.0;
    if !sound {
        return None;
    }
    fill(&refiner, board, &map, contrast.abs(), &mut nodes, holds);
    drop_thin_borders(&mut nodes, [board.columns, board.rows]);
    // Only what held under the pattern's fit says how far the lattice reaches.
    ordered.nodes = nodes.iter().map(|(k, r)| (*k, r.position)).collect();
    let low = ordered.rebase();
    for n in &mut nodes {
        n.0 = [n.0[0] - low[0], n.0[1] - low[1]];
    }
    Some(Seen {
        ordered,
        nodes,
        rest,
        blur_px: refiner.blur_px[0].hypot(refiner.blur_px[1]) / std::f64::consts::SQRT_2,
        noise,
        contrast: contrast.abs(),
        light_even: (contrast > 0.0) == ((low[0] + low[1]) % 2 == 0),
        gamma: refiner.tone.as_ref().map(|t| t.gamma),
    })
}

/// Fewest nodes that count as a board: three in ten, and enough to be no accident.
pub(super) fn fewest(board: &Board) -> usize {
    ((board.columns * board.rows) as usize * 3 / 10).max(12)
}

/// Columns and rows of another pattern, if that is seen; for the reasons only.
pub(super) fn seen_as(image: &Grey<'_>, board: &Board, pattern: BoardPattern) -> Option<[u32; 2]> {
    let other = Board {
        pattern,
        ..board.clone()
    };
    see(image, &other, fewest(board)).map(|seen| seen.ordered.extent())
}

#[cfg(test)]
mod tests;
