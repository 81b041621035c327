//! Which parts of the board's area have nodes, in words.

use hydroline_rigs::Board;

use crate::board::half_size_m;
use crate::detect::part;

/// Nodes needed in a part, as a share of those it holds.
const ENOUGH: f64 = 0.5;

/// A column or row with less than this share of its nodes is missing.
const HARDLY_ANY: f64 = 0.25;

/// Which sides of the board have no nodes among those known, as the camera sees it: "left half", or
/// "lower third and the right edge"; `None` where all outer columns and rows have some.
pub fn missing_part(board: &Board, nodes: impl Iterator<Item = [u32; 2]>) -> Option<String> {
    let counts = [board.columns, board.rows];
    let mut seen = counts.map(|n| vec![0u32; n as usize]);
    for index in nodes {
        for (axis, seen) in seen.iter_mut().enumerate() {
            if let Some(count) = seen.get_mut(index[axis] as usize) {
                *count += 1;
            }
        }
    }
    // ξ runs to the image's left, η up.
    const SIDES: [[&str; 2]; 2] = [["right", "left"], ["lower", "upper"]];
    let mut words = Vec::new();
    for axis in 0..2 {
        // Of what is seen at all: a missing half would make every row look half empty.
        let fullest = seen[axis].iter().copied().max().unwrap_or(0);
        let missing = |n: &&u32| f64::from(**n) < HARDLY_ANY * f64::from(fullest.max(1));
        let ends = [
            seen[axis].iter().take_while(missing).count(),
            seen[axis].iter().rev().take_while(missing).count(),
        ];
        for (end, side) in ends.into_iter().zip(SIDES[axis]) {
            if end > 0 {
                words.push(format!("{side} {}", part(end as u32, counts[axis])));
            }
        }
    }
    (!words.is_empty()).then(|| words.join(" and the "))
}

/// The board in 3 × 3 parts, `parts[row][column]`: from below, and from ξ negative.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coverage {
    /// Share of each part's nodes seen.
    pub parts: [[f64; 3]; 3],
}

impl Coverage {
    /// Coverage of nodes at (ξ, η) \[m\].
    pub fn of(board: &Board, nodes: impl Iterator<Item = [f64; 2]>) -> Self {
        let half = half_size_m(board).map(|v| (v - board.margin_m).max(1e-9));
        let part = |v: f64, half: f64| (((v / half + 1.0) * 1.5) as usize).min(2);
        let mut seen = [[0.0; 3]; 3];
        for [xi, eta] in nodes {
            seen[part(eta, half[1])][part(xi, half[0])] += 1.0;
        }
        let mut held = [[0.0f64; 3]; 3];
        for j in 0..board.rows {
            for i in 0..board.columns {
                let [xi, eta] = crate::board::node_m(board, i, j);
                held[part(eta, half[1])][part(xi, half[0])] += 1.0;
            }
        }
        Coverage {
            parts: std::array::from_fn(|j| {
                std::array::from_fn(|i| seen[j][i] / held[j][i].max(1.0))
            }),
        }
    }

    /// Share of the parts that are covered.
    pub fn share(&self) -> f64 {
        let covered = self
            .parts
            .iter()
            .flatten()
            .filter(|&&p| p >= ENOUGH)
            .count();
        covered as f64 / 9.0
    }

    /// "lower left corner uncovered" and the like; left as the camera sees it (ξ to port).
    pub fn missing(&self) -> Vec<String> {
        const NAMES: [[&str; 3]; 3] = [
            ["lower right corner", "lower edge", "lower left corner"],
            ["right edge", "middle", "left edge"],
            ["upper right corner", "upper edge", "upper left corner"],
        ];
        let mut words = Vec::new();
        for (row, names) in self.parts.iter().zip(NAMES) {
            for (&share, name) in row.iter().zip(names) {
                if share < ENOUGH {
                    words.push(if share == 0.0 {
                        format!("{name} uncovered")
                    } else {
                        format!("{name} covered to {:.0} % only", 100.0 * share)
                    });
                }
            }
        }
        words
    }
}
