//! The key: three discs that determine which node is which, and whether the image is mirrored.

use std::collections::HashMap;

use hydroline_rigs::{Board, BoardPattern};
use nalgebra::Matrix3;

use super::identify::{Ordered, turn_index};
use super::image::Grey;
use super::lattice::Index;
use crate::board::Key;
use crate::map::geometry::{apply, homography};

/// Result of the search for a key.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum KeySearch {
    /// These quarter turns and this shift bring the nodes into the board's order.
    Seen(usize, Index),
    /// It is there, the wrong way round.
    Mirrored,
    /// It lies as that of an upright board in a mirror, and as that of a board on its side: this board
    /// and its key look the same both ways.
    MirroredOrAside,
    /// Its places are in view, and there is none.
    Absent,
    /// Not determined.
    Hidden,
}

impl Ordered {
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
        let (mut found, mut mirrored) = (None, 0);
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
                // An L looks the same in a mirror, its arms in exchange: where on the board it then
                // lies says which it is, unless the board is as symmetric as the L.
                let [proper, flipped] = [false, true].map(|flip| {
                    let order = |k: Index| {
                        let [i, j] = turn_index(k, turns);
                        if flip { [j, i] } else { [i, j] }
                    };
                    // Bring the cell along by its middle: cells turn about their middles.
                    let seen = order([2 * corner[0] + 1, 2 * corner[1] + 1]);
                    let wanted = key.cells[0].map(|v| 2 * v as i32 + 1);
                    let shift = [(wanted[0] - seen[0]) / 2, (wanted[1] - seen[1]) / 2];
                    // A key that puts nodes off the board is a shadow or a hand.
                    let fits = self.nodes.keys().all(|&k| {
                        let [i, j] = order(k);
                        (0..board.columns as i32).contains(&(i + shift[0]))
                            && (0..board.rows as i32).contains(&(j + shift[1]))
                    });
                    fits.then_some(shift)
                });
                let Some(shift) = proper else {
                    mirrored += usize::from(flipped.is_some());
                    continue;
                };
                if found.is_some() {
                    return KeySearch::Hidden; // two keys: neither is believed
                }
                found = Some((turns, shift, flipped.is_some()));
            }
        }
        match (found, mirrored) {
            (Some((turns, _, true)), _) if turns % 2 != 0 => return KeySearch::MirroredOrAside,
            (Some((turns, shift, _)), _) => return KeySearch::Seen(turns, shift),
            (None, 1) => return KeySearch::Mirrored,
            _ => {}
        }
        // No key at all only where all of its places are in view and plain, whichever way the
        // board is rotated; one dark place may be a stain.
        let [ni, nj] = self.extent().map(|n| n as i32);
        let absent = (0..4usize).all(|turns| {
            let rotated = if turns % 2 == 0 { [ni, nj] } else { [nj, ni] };
            if rotated != [board.columns as i32, board.rows as i32] {
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
