//! Which parts of the board's area have nodes, in words.

use hydroline_rigs::Board;

use crate::board::half_size_m;

/// Nodes needed in a part, as a share of those it holds.
const ENOUGH: f64 = 0.5;

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
