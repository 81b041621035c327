//! Which node is which, carried over from frames that showed the key to one that does not.

use hydroline_rigs::Board;

use crate::board::node_m;
use crate::detect::{BoardNode, Detection, Orientation, turn_index};
use crate::map::Node;

/// A node this near to a known one \[px\] is the same: the board stands still.
const SAME_PX: f64 = 1.5;

/// The detection under the indices of the known nodes; `None` where fewer than half of its nodes
/// lie on known ones, or those do not agree on one turn and shift.
pub(super) fn over(board: &Board, known: &[Node], detection: &Detection) -> Option<Detection> {
    let index = |n: &Node| {
        let [x0, y0] = node_m(board, 0, 0);
        [
            ((n.xi_m - x0) / board.pitch_m).round() as i32,
            ((n.eta_m - y0) / board.pitch_m).round() as i32,
        ]
    };
    let pairs: Vec<([i32; 2], [i32; 2])> = detection
        .nodes
        .iter()
        .filter_map(|n| {
            let same = known.iter().find(|k| {
                (k.column_px - n.node.column_px).hypot(k.row_px - n.node.row_px) < SAME_PX
            })?;
            Some(([n.i as i32, n.j as i32], index(same)))
        })
        .collect();
    if pairs.len() * 2 < detection.nodes.len() || pairs.len() < 4 {
        return None;
    }
    let shift = |turns: usize| {
        let by = |(seen, known): &([i32; 2], [i32; 2])| {
            let rotated = turn_index(*seen, turns);
            [known[0] - rotated[0], known[1] - rotated[1]]
        };
        let first = by(pairs.first()?);
        pairs.iter().all(|p| by(p) == first).then_some(first)
    };
    let (turns, shift) = (0..4).find_map(|turns| Some((turns, shift(turns)?)))?;
    let mut nodes: Vec<BoardNode> = detection
        .nodes
        .iter()
        .filter_map(|n| {
            let [i, j] = turn_index([n.i as i32, n.j as i32], turns);
            let (i, j) = (
                u32::try_from(i + shift[0]).ok()?,
                u32::try_from(j + shift[1]).ok()?,
            );
            let [xi_m, eta_m] = node_m(board, i, j);
            (i < board.columns && j < board.rows).then_some(BoardNode {
                i,
                j,
                node: Node {
                    xi_m,
                    eta_m,
                    ..n.node
                },
            })
        })
        .collect();
    nodes.sort_by_key(|n| (n.j, n.i));
    Some(Detection {
        left_out: (board.columns * board.rows) as usize - nodes.len(),
        nodes,
        orientation: Orientation::KeySeen,
        ..detection.clone()
    })
}
