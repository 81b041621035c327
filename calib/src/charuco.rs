//! ChArUco boards: which light square carries which marker, and what its bits are.
//!
//! Layout and numbers are those of OpenCV's `CharucoBoard` (4.6 and later): seen from the front the square at the upper left
//! is dark, and the markers in the light squares are numbered from there row by row. Their dictionaries are OpenCV's as well
//! (`charuco/dictionaries.txt`, which names source and licence).

use std::sync::OnceLock;

use hydroline_rigs::{Board, BoardPattern, Dictionary};

use crate::board;

const TABLE: &str = include_str!("charuco/dictionaries.txt");

/// Bits of all markers of that side, by id: as printed, row by row from the upper left, highest first, 1 = light.
fn codes(side: u32) -> &'static [u64] {
    static CODES: OnceLock<Vec<(u32, Vec<u64>)>> = OnceLock::new();
    let all = CODES.get_or_init(|| {
        let mut all: Vec<(u32, Vec<u64>)> = Vec::new();
        for line in TABLE.lines().filter(|l| !l.starts_with('#')) {
            if let Some(side) = line.strip_prefix("side ") {
                all.extend(side.parse().ok().map(|side| (side, Vec::new())));
            } else if let Some((_, codes)) = all.last_mut() {
                let words = line.split_whitespace();
                codes.extend(words.filter_map(|w| u64::from_str_radix(w, 16).ok()));
            }
        }
        all
    });
    let of_side = all.iter().find(|(s, _)| *s == side);
    of_side.map_or(&[], |(_, codes)| codes)
}

/// Bits of a dictionary's markers, by id: as printed, row by row from the upper left, highest first, 1 = light.
pub fn markers(dictionary: Dictionary) -> &'static [u64] {
    let codes = codes(dictionary.side);
    &codes[..codes.len().min(dictionary.markers as usize)]
}

/// A board's markers.
#[derive(Debug, Clone, Copy)]
pub struct Markers {
    /// Their dictionary.
    pub dictionary: Dictionary,
    /// Their side over the pitch, border included.
    pub share: f64,
    columns: i32,
    rows: i32,
}

impl Markers {
    /// Of a board that has them.
    pub fn of(board: &Board) -> Option<Self> {
        let BoardPattern::Charuco {
            dictionary,
            marker_m,
        } = board.pattern
        else {
            return None;
        };
        Some(Markers {
            dictionary,
            share: marker_m / board.pitch_m,
            columns: board.columns as i32,
            rows: board.rows as i32,
        })
    }

    /// Distance of a marker's bits from its square's rims, in pitches: a gap, and a border of one bit.
    pub fn first_bit(&self) -> f64 {
        0.5 * (1.0 - self.share) + self.share / f64::from(self.dictionary.side + 2)
    }

    /// Squares from −1 along ξ and η: up to, and without.
    pub fn extent(&self) -> [i32; 2] {
        [self.columns, self.rows]
    }

    /// OpenCV's id of the node (i, j).
    pub fn corner_id(&self, [i, j]: [i32; 2]) -> Option<u32> {
        let on = (0..self.columns).contains(&i) && (0..self.rows).contains(&j);
        // ξ runs to the left of what the camera sees, η up.
        on.then(|| ((self.rows - 1 - j) * self.columns + self.columns - 1 - i) as u32)
    }

    /// Id of the marker in the square whose lowest node is (i, j), from −1; `None`: a dark square, or none of the board.
    pub fn id(&self, [i, j]: [i32; 2]) -> Option<u32> {
        let across = self.columns + 1;
        let (row, column) = (self.rows - 1 - j, self.columns - 1 - i);
        let on = (0..across).contains(&column) && (0..=self.rows).contains(&row);
        let light = (row + column) % 2 != 0;
        (on && light).then(|| {
            let before = row * across + column;
            // Every other square before it is light; of an odd number of them the first, a dark one, is left over.
            (before / 2) as u32
        })
    }

    /// Its bits.
    pub fn bits(&self, square: [i32; 2]) -> Option<u64> {
        let id = self.id(square)? as usize;
        markers(self.dictionary).get(id).copied()
    }

    /// All squares with a marker, by their lowest nodes.
    pub fn squares(&self) -> impl Iterator<Item = [i32; 2]> + '_ {
        let all = (-1..self.rows).flat_map(|j| (-1..self.columns).map(move |i| [i, j]));
        all.filter(|k| self.id(*k).is_some())
    }

    /// Whether a marker is light at (u, v) of its square, in pitches from the lowest node along ξ and η; `None` beside
    /// the marker.
    pub fn light(&self, square: [i32; 2], at: [f64; 2]) -> Option<bool> {
        let bits = self.bits(square)?;
        let cells = f64::from(self.dictionary.side + 2);
        let gap = 0.5 * (1.0 - self.share);
        let [column, row] = at.map(|v| ((1.0 - v - gap) / self.share * cells).floor() as i64);
        let side = i64::from(self.dictionary.side);
        if ![column, row].iter().all(|k| (0..side + 2).contains(k)) {
            return None;
        }
        let inside = [column, row].iter().all(|k| (1..=side).contains(k));
        let place = side * side - 1 - ((row - 1) * side + column - 1);
        Some(inside && bits >> place & 1 == 1)
    }
}

/// Whether a square of a chessboard is dark, by its lowest node, from −1.
pub fn square_is_dark(board: &Board, square: [i32; 2]) -> bool {
    match Markers::of(board) {
        None => (square[0] + square[1]).rem_euclid(2) == 0,
        Some(markers) => markers.id(square).is_none(),
    }
}

/// Whether the face of a chessboard is dark at a place from the nodes' middle \[m\]; blocks and key apart.
pub fn is_dark(board: &Board, [xi_m, eta_m]: [f64; 2]) -> bool {
    let [x, y] = board::node_m(board, 0, 0);
    let (u, v) = ((xi_m - x) / board.pitch_m, (eta_m - y) / board.pitch_m);
    let square = [u, v].map(|k| k.floor() as i32);
    let on = |k: i32, n: u32| (-1..n as i32).contains(&k);
    if !on(square[0], board.columns) || !on(square[1], board.rows) {
        return false;
    }
    square_is_dark(board, square)
        || Markers::of(board)
            .is_some_and(|m| m.light(square, [u - u.floor(), v - v.floor()]) == Some(false))
}

#[cfg(test)]
mod tests;
