//! Which node is which: upright order, and the key where the board carries one.

use std::collections::HashMap;

use nalgebra::Matrix3;

use hydroline_rigs::{Board, BoardPattern};

use super::candidates::Candidate;
use super::image::Grey;
use super::lattice::{Index, Lattice};
use super::{NotFound, Orientation};
use crate::board::Key;
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
            let (a, b) = mean_steps(&turned(&nodes, turns));
            let score = -a[0] / a[0].hypot(a[1]).max(1e-9) - b[1] / b[0].hypot(b[1]).max(1e-9);
            if score > best.0 {
                best = (score, turns);
            }
        }
        let mut ordered = Ordered {
            nodes: turned(&nodes, best.1),
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

    /// Looks for the key. `contrast`: that of the pattern; discs are as dark as its marks.
    pub fn find_key(
        &self,
        image: &Grey<'_>,
        board: &Board,
        key: &Key,
        h: &Matrix3<f64>,
        contrast: f64,
    ) -> KeySearch {
        let radius = 0.5 * key.diameter_m / board.pitch_m;
        let chess = matches!(board.pattern, BoardPattern::Chessboard);
        let mut marks: HashMap<Index, f32> = HashMap::new();
        for &[i, j] in self.nodes.keys() {
            let corners = [[i, j], [i + 1, j], [i, j + 1], [i + 1, j + 1]];
            let known = corners
                .iter()
                .filter(|k| self.nodes.contains_key(*k))
                .count();
            if known < 3 {
                continue;
            }
            // One corner may be hidden: where the others' perspective puts it is good enough.
            let seen: Option<Vec<[f64; 2]>> = corners
                .iter()
                .map(|k| {
                    self.nodes
                        .get(k)
                        .copied()
                        .or_else(|| apply(h, k.map(f64::from)))
                })
                .collect();
            let Some(seen) = seen else { continue };
            let local: Vec<_> = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]
                .into_iter()
                .zip(seen)
                .collect();
            let Some(cell) = homography(&local) else {
                continue;
            };
            let samples = |distance: f64, from: f64| {
                let mut grey = [0.0f32; 8];
                for (k, grey) in grey.iter_mut().enumerate() {
                    let angle = (k as f64 + from) * std::f64::consts::FRAC_PI_4;
                    let at = [0.5 + distance * angle.cos(), 0.5 + distance * angle.sin()];
                    if let Some(p) = apply(&cell, at) {
                        *grey = image.sample(p[0], p[1]);
                    }
                }
                grey.sort_by(f32::total_cmp);
                grey
            };
            let disc = samples(0.5 * radius, 0.0);
            let around = samples(radius + 0.09, 0.5);
            // All of a disc differs from all around it, but for one place on either side that
            // a laser line may spoil. Means would also take the edge of a hand for a disc.
            let darker = (around[1] - disc[6]).max(0.0);
            let lighter = (disc[1] - around[6]).max(0.0);
            marks.insert([i, j], lighter - darker);
        }
        // Of what may differ from its surroundings in a cell only what is as strong as a key
        // counts: lit blocks do too. On a chessboard discs are light on dark and dark on light.
        let strength = |v: f32| f64::from(if chess { v.abs() } else { (-v).max(0.0) });
        let mut strengths: Vec<f64> = marks.values().map(|&v| strength(v)).collect();
        strengths.sort_by(|a, b| b.total_cmp(a));
        // Light falls off over the board: a third disc in the shade sets the threshold.
        let third = strengths.get(2).copied().unwrap_or(0.0);
        let threshold = (0.5 * third).max(0.2 * contrast).max(8.0);
        let marked = |k: Index| marks.get(&k).is_some_and(|&v| strength(v) >= threshold);
        let mut found = None;
        for &corner in marks.keys().filter(|&&k| marked(k)) {
            for turns in 0..4usize {
                // Direction of +ξ and +η of the board as seen in upright indices.
                let u = [[1, 0], [0, 1], [-1, 0], [0, -1]][turns];
                let v = [-u[1], u[0]];
                let right = [corner[0] + u[0], corner[1] + u[1]];
                let up = [corner[0] + v[0], corner[1] + v[1]];
                let diagonal = [right[0] + v[0], right[1] + v[1]];
                if !(marked(right) && marked(up) && !marked(diagonal)) {
                    continue;
                }
                // Bring the cell along by its middle: cells turn about their middles.
                let seen = turn_index([2 * corner[0] + 1, 2 * corner[1] + 1], turns);
                let wanted = key.cells[0].map(|v| 2 * v as i32 + 1);
                let shift = [(wanted[0] - seen[0]) / 2, (wanted[1] - seen[1]) / 2];
                // A key that puts nodes off the board is a shadow or a hand.
                let fits = self.nodes.keys().all(|&k| {
                    let [i, j] = turn_index(k, turns);
                    (0..board.columns as i32).contains(&(i + shift[0]))
                        && (0..board.rows as i32).contains(&(j + shift[1]))
                });
                if !fits {
                    continue;
                }
                if found.is_some() {
                    return KeySearch::Hidden; // two keys: neither is believed
                }
                found = Some((turns, shift));
            }
        }
        if let Some((turns, shift)) = found {
            return KeySearch::Seen(turns, shift);
        }
        // No key at all only where all of its places are in view and plain, whichever way the
        // board is turned; one dark place may be a stain.
        let [ni, nj] = self.extent().map(|n| n as i32);
        let absent = (0..4usize).all(|turns| {
            let turned = if turns % 2 == 0 { [ni, nj] } else { [nj, ni] };
            if turned != [board.columns as i32, board.rows as i32] {
                return true; // a board that does not lie so
            }
            let low = [[0, 0], [ni - 1, 0], [ni - 1, nj - 1], [0, nj - 1]]
                .map(|k| turn_index(k, turns))
                .into_iter()
                .reduce(|a, b| [a[0].min(b[0]), a[1].min(b[1])])
                .unwrap_or([0, 0]);
            let places = key.cells.map(|c| {
                let middle = [0, 1].map(|k| 2 * (c[k] as i32 + low[k]) + 1);
                let seen = turn_index(middle, (4 - turns) % 4);
                [0, 1].map(|k| (seen[k] - 1).div_euclid(2))
            });
            places.iter().all(|k| marks.contains_key(k))
                && places.iter().filter(|k| marked(**k)).count() <= 1
        });
        if absent {
            KeySearch::Absent
        } else {
            KeySearch::Hidden
        }
    }
}

/// What was seen of a key.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum KeySearch {
    /// These quarter turns and this shift bring the nodes into the board's order.
    Seen(usize, Index),
    /// Its places are in view, and there is none.
    Absent,
    /// Nobody can tell.
    Hidden,
}

/// Quarter turns and shift that bring upright indices to those on the board.
pub(super) fn place(
    image: &Grey<'_>,
    board: &Board,
    ordered: &Ordered,
    contrast: f64,
) -> Result<(Orientation, usize, Index), NotFound> {
    let seen = ordered.extent();
    let wanted = [board.columns, board.rows];
    let h = ordered.homography().ok_or(NotFound::NoBoard)?;
    // Whether the image shows that the pattern ends: places more than half a step beyond are in view
    // (and hold none, or the lattice would be larger).
    const NEXT: f64 = 0.6;
    let (w, height) = (image.width() as f64, image.height() as f64);
    let inside = |p: [f64; 2]| p[0] > 0.0 && p[1] > 0.0 && p[0] < w - 1.0 && p[1] < height - 1.0;
    let ends = |axis: usize| {
        let last = f64::from(seen[axis]) - 1.0;
        [-NEXT, last + NEXT].into_iter().all(|beyond| {
            let across = seen[1 - axis];
            let in_view = (0..across).filter(|&k| {
                let mut at = [f64::from(k); 2];
                at[axis] = beyond;
                apply(&h, at).is_some_and(inside)
            });
            in_view.count() * 2 > across as usize
        })
    };
    let key = crate::board::key(board);
    let without = match key.map(|k| ordered.find_key(image, board, &k, &h, contrast)) {
        Some(KeySearch::Seen(turns, shift)) => {
            // A hand may hide a row or two; a board that ends three early both ways is smaller.
            let turned = if turns % 2 == 0 {
                wanted
            } else {
                [wanted[1], wanted[0]]
            };
            let smaller = (0..2).all(|axis| seen[axis] + 3 <= turned[axis] && ends(axis));
            return if smaller {
                Err(NotFound::WrongBoard {
                    seen,
                    wanted,
                    pattern: None,
                })
            } else {
                Ok((Orientation::KeySeen, turns, shift))
            };
        }
        Some(KeySearch::Hidden) => Orientation::KeyHidden,
        Some(KeySearch::Absent) | None => Orientation::UprightAssumed,
    };
    if seen == wanted {
        return if ends(0) && ends(1) {
            Ok((without, 0, [0, 0]))
        } else {
            Err(NotFound::EndNotSeen { seen })
        };
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
    Err(
        if (0..2).all(|axis| seen[axis] == wanted[axis] || ends(axis)) {
            NotFound::WrongBoard {
                seen,
                wanted,
                pattern: None,
            }
        } else {
            NotFound::PartlySeen { seen, wanted }
        },
    )
}

/// Index after the frame has turned `turns` quarter turns: what lay along +η of the old
/// frame lies along +ξ of the new one.
pub(crate) fn turn_index([i, j]: Index, turns: usize) -> Index {
    match turns % 4 {
        0 => [i, j],
        1 => [j, -i],
        2 => [-i, -j],
        _ => [-j, i],
    }
}

fn turned(nodes: &HashMap<Index, [f64; 2]>, turns: usize) -> HashMap<Index, [f64; 2]> {
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
