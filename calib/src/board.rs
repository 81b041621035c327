//! Boards as geometry: where nodes, blocks and the key lie on the face.
//!
//! Board frame: the sheet's (ξ to port, η up) with the origin in the middle of the nodes;
//! height counts from the face towards the camera (−ζ).
//!
//! **Which node is which.** A grid looks the same after a quarter turn. Boards drawn by
//! hydroline carry a *key*: three discs in the middle of three cells, a corner cell and
//! its neighbours towards +ξ and +η, near the middle of the board. The key fixes origin
//! and rotation, also when only part of the board is seen. A board without it (Wang and
//! Cheng's own) is read by the *upright assumption*: η within 45° of up in the image, and
//! all columns and rows in view with more than half a step around. Which of the two applied is
//! reported with each detection, and so is a key that a hand or a laser line hides: nothing may then
//! rest on the order, unless another frame of the same pose showed it.

pub mod coplanarity;

use hydroline_rigs::{Board, BoardPattern, GaugeBlock};

/// The key of a board.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Key {
    /// Lower-left nodes (i, j) of the three cells: corner, towards +ξ, towards +η.
    pub cells: [[u32; 2]; 3],
    /// Diameter of the discs \[m\].
    pub diameter_m: f64,
}

/// Coordinates (ξ, η) \[m\] of node (i, j), i along ξ and j along η.
pub fn node_m(board: &Board, i: u32, j: u32) -> [f64; 2] {
    [
        (f64::from(i) - 0.5 * (f64::from(board.columns) - 1.0)) * board.pitch_m,
        (f64::from(j) - 0.5 * (f64::from(board.rows) - 1.0)) * board.pitch_m,
    ]
}

/// Middle (ξ, η) \[m\] of the cell whose lowest node is (i, j).
pub fn cell_m(board: &Board, cell: [u32; 2]) -> [f64; 2] {
    let [x, y] = node_m(board, cell[0], cell[1]);
    [x + 0.5 * board.pitch_m, y + 0.5 * board.pitch_m]
}

/// Half width and half height of the board \[m\].
pub fn half_size_m(board: &Board) -> [f64; 2] {
    [
        0.5 * (f64::from(board.columns) - 1.0) * board.pitch_m + board.margin_m,
        0.5 * (f64::from(board.rows) - 1.0) * board.pitch_m + board.margin_m,
    ]
}

/// The key's place: the three cells nearest the middle that no block touches or hides
/// (a block as seen at 45° covers as much below it as it is high, and a bit). `None` on
/// a board too small to carry one.
pub fn key(board: &Board) -> Option<Key> {
    let diameter_m = match board.pattern {
        BoardPattern::Lines { .. } | BoardPattern::Chessboard => 0.4 * board.pitch_m,
        // Clear of the four dots around the cell, and larger than they are.
        // Its markers say more than a key.
        BoardPattern::Charuco { .. } => return None,
        BoardPattern::Dots { diameter_m } => (1.3 * board.pitch_m * 0.5_f64.sqrt() - diameter_m)
            .min(0.4 * board.pitch_m)
            .max(0.2 * board.pitch_m),
    };
    let free = |cell: [u32; 2]| {
        let at = cell_m(board, cell);
        board.blocks.iter().all(|b| {
            let clear = 0.5 * diameter_m + 2.0 * b.height_m;
            (at[0] - b.centre_m[0]).abs() > 0.5 * b.size_m[0] + clear
                || (at[1] - b.centre_m[1]).abs() > 0.5 * b.size_m[1] + clear
        })
    };
    let (columns, rows) = (board.columns.checked_sub(2)?, board.rows.checked_sub(2)?);
    let middle = [
        0.5 * (f64::from(columns) - 1.0),
        0.5 * (f64::from(rows) - 1.0),
    ];
    let mut best: Option<(f64, Key)> = None;
    for j in 0..rows {
        for i in 0..columns {
            let cells = [[i, j], [i + 1, j], [i, j + 1]];
            let away = (f64::from(i) - middle[0]).hypot(f64::from(j) - middle[1]);
            if cells.iter().all(|&c| free(c)) && best.is_none_or(|(d, _)| away < d - 1e-9) {
                best = Some((away, Key { cells, diameter_m }));
            }
        }
    }
    best.map(|(_, key)| key)
}

/// The side of a block that faces the laser: its upper edge η and the ends of the edge in ξ \[m\].
pub fn lit_edge_m(block: &GaugeBlock) -> (f64, [f64; 2]) {
    (
        block.centre_m[1] + 0.5 * block.size_m[1],
        [
            block.centre_m[0] - 0.5 * block.size_m[0],
            block.centre_m[0] + 0.5 * block.size_m[0],
        ],
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn board(pattern: BoardPattern, blocks: Vec<GaugeBlock>) -> Board {
        Board {
            name: "test".into(),
            pattern,
            columns: 11,
            rows: 11,
            pitch_m: 0.05,
            margin_m: 0.025,
            thickness_m: 0.006,
            blocks,
        }
    }

    #[test]
    fn nodes_are_centred() {
        let b = board(BoardPattern::Chessboard, Vec::new());
        assert_eq!(node_m(&b, 5, 5), [0.0, 0.0]);
        assert!((node_m(&b, 10, 0)[0] - 0.25).abs() < 1e-12);
        assert_eq!(half_size_m(&b), [0.275, 0.275]);
    }

    #[test]
    fn key_avoids_blocks() {
        let plain = key(&board(BoardPattern::Chessboard, Vec::new())).unwrap();
        let block = GaugeBlock {
            centre_m: cell_m(&board(BoardPattern::Chessboard, Vec::new()), plain.cells[0]),
            size_m: [0.03, 0.03],
            height_m: 0.01,
        };
        let moved = key(&board(BoardPattern::Chessboard, vec![block])).unwrap();
        for cell in moved.cells {
            assert_ne!(cell, plain.cells[0]);
        }
        let mut tiny = board(BoardPattern::Chessboard, Vec::new());
        tiny.columns = 2;
        assert_eq!(key(&tiny), None);
    }
}
