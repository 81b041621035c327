//! Whether the nodes lie where the map puts them as well as their own noise lets them.

use hydroline_rigs::Board;
use nalgebra::Vector2;

use crate::map::{FittedMap, Node};

/// Numbers of a homography with lens, which the nodes have paid for.
const PARAMETERS: f64 = 12.0;
/// Residuals beyond so many times what the nodes' noise explains are out of the ordinary: single views
/// under all light that was tried stay below.
pub const UNUSUAL_RATIO: f64 = 1.6;
/// So is a node off by so many of its standard deviations: of 121 nodes 3.5 is usual.
pub const UNUSUAL_SDS: f64 = 5.0;

/// Residuals against the nodes' covariances.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Misfit {
    /// rms of residuals over their standard deviations; 1 where noise explains them.
    pub ratio: f64,
    /// The largest.
    pub worst_sds: f64,
    /// Where: (ξ, η) of the node \[m\].
    pub worst_m: [f64; 2],
    /// It lies beside or below a gauge block, whose side and shadow fall on the face there.
    pub beside_block: bool,
}

impl Misfit {
    /// Of a map at its nodes; `None` for too few of them.
    pub fn of(board: &Board, map: &FittedMap, nodes: &[Node]) -> Option<Self> {
        let (mut sum, mut count) = (0.0, 0.0);
        let mut worst = (0.0f64, [0.0; 2]);
        for n in nodes {
            let Some((column, row)) = map.to_image(n.xi_m, n.eta_m) else {
                continue;
            };
            let off = Vector2::new(n.column_px - column, n.row_px - row);
            let square = off.dot(&(n.covariance_px2.try_inverse()? * off));
            sum += square;
            count += 2.0;
            if square > worst.0 {
                worst = (square, [n.xi_m, n.eta_m]);
            }
        }
        if count < 2.0 * PARAMETERS {
            return None;
        }
        let [xi, eta] = worst.1;
        let beside_block = board.blocks.iter().any(|b| {
            let reach = 0.5 * board.pitch_m;
            let below = b.centre_m[1] - eta;
            (xi - b.centre_m[0]).abs() < 0.5 * b.size_m[0] + reach
                && (-(0.5 * b.size_m[1] + reach)..2.0 * board.pitch_m).contains(&below)
        });
        Some(Misfit {
            ratio: (sum / (count - PARAMETERS)).sqrt(),
            worst_sds: worst.0.sqrt(),
            worst_m: worst.1,
            beside_block,
        })
    }

    /// Whether there is more than noise.
    pub fn unusual(&self) -> bool {
        self.ratio > UNUSUAL_RATIO || self.worst_sds > UNUSUAL_SDS
    }

    /// In words, with what may be the cause where there is more than noise.
    pub fn words(&self) -> String {
        let size = format!("{:.1} times what the nodes' noise explains", self.ratio);
        if !self.unusual() {
            return size;
        }
        let [xi, eta] = self.worst_m;
        let cause = if self.ratio <= UNUSUAL_RATIO && self.beside_block {
            "; that node lies at a gauge block, whose side or shadow falls on it: light the board from more than one side"
        } else if self.ratio <= UNUSUAL_RATIO {
            "; something lies across that node: look at it with --annotate"
        } else {
            ": OUT OF THE ORDINARY; a board that is warped or not made to its file, a lens beyond the map, or light that the fit of a node does not know (clipping, reflections): look with --annotate, try --method refractive, measure the board"
        };
        format!(
            "{size}, the worst node (xi {xi:+.3}, eta {eta:+.3} m) by {:.1} of its sd{cause}",
            self.worst_sds
        )
    }
}
