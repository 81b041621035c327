//! Which node is which: upright order, and the key where the board carries one.

use std::collections::HashMap;

use nalgebra::Matrix3;

use hydroline_rigs::Board;

use super::candidates::Candidate;
use super::ends::Ends;
use super::image::Grey;
use super::key::KeySearch;
use super::lattice::{Index, Lattice};
use super::{NotFound, Orientation};
use crate::map::geometry::{apply, homography};

/// Coarse nodes in the upright order: first index along ξ (image left), second along η (up).
pub(super) struct Ordered {
    pub nodes: HashMap<Index, [f64; 2]>,
}

impl Ordered {
    /// Turns a lattice until its first index runs to the image's left; a seen board is
    /// never mirrored, so its handedness is known. Indices start at 0.
    pub fn upright(lattice: &Lattice, candidates: &[Candidate]) -> Self {
        let mut nodes: HashMap<Index, [f64; 2]> = lattice
            .nodes
            .iter()
            .map(|(&index, &n)| (index, candidates[n].position))
            .collect();
        let (a, b) = mean_steps(&nodes);
        if a[0] * b[1] - a[1] * b[0] < 0.0 {
            nodes = nodes.into_iter().map(|([i, j], p)| ([j, i], p)).collect();
        }
        let mut best = (f64::NEG_INFINITY, 0);
        for turns in 0..4 {
            let (a, b) = mean_steps(&rotated(&nodes, turns));
            let score = -a[0] / a[0].hypot(a[1]).max(1e-9) - b[1] / b[0].hypot(b[1]).max(1e-9);
            if score > best.0 {
                best = (score, turns);
            }
        }
        let mut ordered = Ordered {
            nodes: rotated(&nodes, best.1),
        };
        ordered.rebase();
        ordered
    }

    /// Shifts indices to start at 0; returns the lowest before.
    pub fn rebase(&mut self) -> Index {
        let low = [0, 1].map(|k| self.nodes.keys().map(|i| i[k]).min().unwrap_or(0));
        self.shift([-low[0], -low[1]]);
        low
    }

    fn shift(&mut self, by: Index) {
        self.nodes = self
            .nodes
            .drain()
            .map(|([i, j], p)| ([i + by[0], j + by[1]], p))
            .collect();
    }

    pub fn extent(&self) -> [u32; 2] {
        [0, 1].map(|k| {
            let low = self.nodes.keys().map(|i| i[k]).min().unwrap_or(0);
            let high = self.nodes.keys().map(|i| i[k]).max().unwrap_or(-1);
            (high - low + 1) as u32
        })
    }

    /// Homography from index to image; `None` for a degenerate lattice.
    pub fn homography(&self) -> Option<Matrix3<f64>> {
        let mut keys: Vec<&Index> = self.nodes.keys().collect();
        keys.sort_unstable(); // sums in the same order every time
        let pairs: Vec<_> = keys
            .into_iter()
            .map(|k| ([f64::from(k[0]), f64::from(k[1])], self.nodes[k]))
            .collect();
        homography(&pairs)
    }

    /// Local steps (to i+1, to j+1) at a node \[px\], from neighbours where they are known.
    pub fn steps(&self, index: Index, h: &Matrix3<f64>) -> Option<[[f64; 2]; 2]> {
        let mut steps = [[0.0; 2]; 2];
        for (axis, step) in steps.iter_mut().enumerate() {
            let at = |d: i32| {
                let mut k = index;
                k[axis] += d;
                self.nodes.get(&k)
            };
            let ideal = |d: f64| {
                let mut k = index.map(f64::from);
                k[axis] += d;
                apply(h, k)
            };
            *step = if let (Some(p), Some(m)) = (at(1), at(-1)) {
                [0.5 * (p[0] - m[0]), 0.5 * (p[1] - m[1])]
            } else {
                let (p, m) = (ideal(0.5)?, ideal(-0.5)?);
                [p[0] - m[0], p[1] - m[1]]
            };
        }
        Some(steps)
    }
}

/// Quarter turns and shift that bring upright indices to those on the board; `key`: what its key or its markers say.
pub(super) fn place(
    image: &Grey<'_>,
    board: &Board,
    ordered: &Ordered,
    contrast: f64,
    key: Option<KeySearch>,
) -> Result<(Orientation, usize, Index), NotFound> {
    let seen = ordered.extent();
    let wanted = [board.columns, board.rows];
    let h = ordered.homography().ok_or(NotFound::NoBoard)?;
    let ends = Ends {
        image,
        board,
        seen,
        to_image: &h,
        contrast,
    };
    let another = NotFound::WrongBoard {
        seen,
        wanted,
        pattern: None,
    };
    let without = match key {
        Some(KeySearch::Seen(turns, shift)) => {
            // A hand may hide a row or two, or half of the board; a board that ends three early both ways,
            // with its edges, is smaller.
            let rotated = if turns % 2 == 0 {
                wanted
            } else {
                [wanted[1], wanted[0]]
            };
            let smaller = (0..2).all(|axis| {
                seen[axis] + 3 <= rotated[axis] && ends.in_view(axis) && ends.both_edges(axis)
            });
            return if smaller {
                Err(another)
            } else {
                Ok((Orientation::KeySeen, turns, shift))
            };
        }
        Some(KeySearch::Mirrored) => return Err(NotFound::Mirrored { aside: false }),
        Some(KeySearch::MirroredOrAside) => return Err(NotFound::Mirrored { aside: true }),
        Some(KeySearch::Hidden) => Orientation::KeyHidden,
        Some(KeySearch::Absent) | None => Orientation::UprightAssumed,
    };
    if seen == wanted {
        return if ends.in_view(0) && ends.in_view(1) {
            Ok((without, 0, [0, 0]))
        } else {
            Err(NotFound::EndNotSeen { seen })
        };
    }
    if seen == [wanted[1], wanted[0]] {
        return Err(NotFound::NotUpright { seen, wanted });
    }
    if seen[0] > wanted[0] || seen[1] > wanted[1] {
        return Err(another);
    }
    // Fewer than the board has: cut by the image's border, hidden, or another board.
    let short = |axis: &usize| seen[*axis] < wanted[*axis];
    if !(0..2).filter(short).all(|axis| ends.in_view(axis)) {
        return Err(NotFound::PartlySeen { seen, wanted });
    }
    if (0..2).filter(short).all(|axis| ends.both_edges(axis)) {
        return Err(another);
    }
    Err(NotFound::Covered {
        nodes: ordered.nodes.len(),
        of: (wanted[0] * wanted[1]) as usize,
        missing: ends.missing(wanted),
    })
}

/// Whether a place lies on the lattice of that homography, to a quarter of a step.
pub(super) fn on_lattice(to_image: &Matrix3<f64>, place: [f64; 2]) -> bool {
    const NEAR: f64 = 0.25;
    let Some(inverse) = to_image.try_inverse() else {
        return false;
    };
    // An inverse homography is one up to its sign.
    let at = apply(&inverse, place).or_else(|| apply(&-inverse, place));
    at.is_some_and(|k| k.iter().all(|v| (v - v.round()).abs() < NEAR))
}

/// Index after the frame has rotated by `turns` quarter turns: what lay along +η of the old
/// frame lies along +ξ of the new one.
pub(crate) fn turn_index([i, j]: Index, turns: usize) -> Index {
    match turns % 4 {
        0 => [i, j],
        1 => [j, -i],
        2 => [-i, -j],
        _ => [-j, i],
    }
}

fn rotated(nodes: &HashMap<Index, [f64; 2]>, turns: usize) -> HashMap<Index, [f64; 2]> {
    nodes
        .iter()
        .map(|(&k, &p)| (turn_index(k, turns), p))
        .collect()
}

/// Mean steps along the first and the second index \[px\].
fn mean_steps(nodes: &HashMap<Index, [f64; 2]>) -> ([f64; 2], [f64; 2]) {
    let mut sums = [[0.0f64; 2]; 2];
    for (&[i, j], p) in nodes {
        for (axis, next) in [[i + 1, j], [i, j + 1]].into_iter().enumerate() {
            if let Some(q) = nodes.get(&next) {
                sums[axis][0] += q[0] - p[0];
                sums[axis][1] += q[1] - p[1];
            }
        }
    }
    (sums[0], sums[1])
}
