//! A board held in the hand: anywhere, at any turn, any part of it.
//!
//! A bundle adjustment has a free pose for every image, so it does not matter which node of a plain board is which:
//! an index that is off by a column, or turned by a quarter, is the same board in another pose. Neither a key nor an
//! upright board is needed, and part of the lattice is as good as the whole. What matters is that neighbours are
//! neighbours (the lattice's business) and that the image is not mirrored, which only a key shows.

use hydroline_rigs::Board;
use nalgebra::Matrix2;

use super::identify::turn_index;
use super::key::KeySearch;
use super::lattice::Index;
use super::smooth::Smooth;
use super::{Grey, NotFound, WORST_BLUR_PX, reason, see};

/// A node of a lattice whose origin is arbitrary.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LatticeNode {
    /// Along ξ and along η: of the board where its key or its markers were seen, else from any node.
    pub index: [i32; 2],
    /// Column and row \[px\].
    pub pixel: [f64; 2],
    /// Covariance of column and row \[px²\].
    pub covariance_px2: Matrix2<f64>,
}

/// A board in the hand.
#[derive(Debug, Clone, PartialEq)]
pub struct InHand {
    /// Nodes, by index.
    pub nodes: Vec<LatticeNode>,
    /// Whether key or markers say which node is which, and that the image is not mirrored.
    pub identified: bool,
    /// Point spread, standard deviation \[px\], pixel size included; of a moved board the root mean square of both directions'.
    pub blur_px: f64,
    /// Median of what the fits left \[grey levels\].
    pub noise: f64,
    /// Median contrast of the pattern \[grey levels\].
    pub contrast: f64,
    /// Whether the squares with an even sum of the lattice's own indices are light.
    pub(super) light_even: bool,
    /// Nodes along the lattice's own two directions.
    pub(super) lattice: [u32; 2],
    /// The lattice's own coordinates, from 0, to the image.
    pub(super) smooth: Option<Smooth>,
}

/// Fewest nodes that count as a board in the hand: fewer leave a pose (6 numbers) without a check.
const FEWEST: usize = 12;
/// And this share of the board: a smaller lattice among the texture of a room is an accident.
const FEWEST_SHARE: f64 = 0.12;

/// Smallest side of an image that is still halved \[px\]: a board of 12 nodes fills 100.
const SMALLEST_PX: usize = 200;

/// Finds a board in the hand, or the part of it that is seen.
///
/// Where the full image shows none, or a blurred one, it is halved and looked at again: blur and squares that are too
/// large for the one are what the other is made for. Covariances say what that costs.
///
/// # Errors
/// [`NotFound`] says why there is none; a second look for the reason takes several times as long.
pub fn detect_in_hand(image: &Grey<'_>, board: &Board) -> Result<InHand, NotFound> {
    reason::refuse_empty(image)?;
    let first = match in_size(image, board) {
        Err(why @ (NotFound::NoBoard | NotFound::Blurred { .. })) => why,
        answer => return answer,
    };
    let mut halved = image.halved();
    let mut times = 2.0;
    while halved.width.min(halved.height) >= SMALLEST_PX {
        match in_size(&halved.grey(), board) {
            Err(NotFound::NoBoard | NotFound::Blurred { .. }) => {}
            answer => return answer.map(|found| found.enlarged(times)),
        }
        halved = halved.grey().halved();
        times *= 2.0;
    }
    Err(match first {
        NotFound::NoBoard => reason::explain(image, board),
        why => why,
    })
}

impl InHand {
    /// The same in an image so many times larger.
    fn enlarged(mut self, times: f64) -> Self {
        for node in &mut self.nodes {
            node.pixel = node.pixel.map(|p| (p + 0.5) * times - 0.5);
            node.covariance_px2 *= times * times;
        }
        self.blur_px *= times;
        // A mean over pixels scatters less than they do.
        self.noise *= times;
        self.smooth = self.smooth.map(|s| s.enlarged(times));
        self
    }
}

/// Finds the board in an image as it is.
fn in_size(image: &Grey<'_>, board: &Board) -> Result<InHand, NotFound> {
    let share = FEWEST_SHARE * f64::from(board.columns * board.rows);
    let Some(seen) = see(image, board, FEWEST.max(share as usize)) else {
        return Err(NotFound::NoBoard);
    };
    if seen.blur_px >= WORST_BLUR_PX {
        return Err(NotFound::Blurred {
            blur_px: seen.blur_px,
        });
    }
    let extent = seen.ordered.extent();
    let wanted = [board.columns, board.rows];
    let fits = |e: [u32; 2]| e[0] <= wanted[0] && e[1] <= wanted[1];
    if !fits(extent) && !fits([extent[1], extent[0]]) {
        return Err(NotFound::WrongBoard {
            seen: extent,
            wanted,
            pattern: None,
        });
    }
    let (identified, turns, shift) = match seen.key(image, board)? {
        Some(KeySearch::Seen(turns, shift)) => (true, turns, shift),
        Some(KeySearch::Mirrored) => return Err(NotFound::Mirrored { aside: false }),
        // On its side is no fault of a board in the hand.
        Some(KeySearch::MirroredOrAside | KeySearch::Absent | KeySearch::Hidden) | None => {
            (false, 0, [0, 0])
        }
    };
    let place = |index: Index| {
        let [i, j] = turn_index(index, turns);
        [i + shift[0], j + shift[1]]
    };
    let on_board = |k: Index| {
        [0, 1]
            .iter()
            .all(|&a| (0..wanted[a] as i32).contains(&k[a]))
            || !identified
    };
    let mut nodes: Vec<LatticeNode> = (seen.nodes.iter())
        .filter(|(index, _)| on_board(place(*index)))
        .map(|(index, r)| LatticeNode {
            index: place(*index),
            pixel: r.position,
            covariance_px2: r.covariance,
        })
        .collect();
    nodes.sort_by_key(|n| (n.index[1], n.index[0]));
    Ok(InHand {
        nodes,
        identified,
        blur_px: seen.blur_px,
        noise: seen.noise,
        contrast: seen.contrast,
        lattice: extent,
        light_even: seen.light_even,
        smooth: Smooth::fit(&seen.nodes).map(|(map, _)| map),
    })
}
