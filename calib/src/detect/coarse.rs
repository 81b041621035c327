//! The best lattice in one size of the image, and what it leaves for a second board.

use hydroline_rigs::{Board, BoardPattern};

use super::candidates::Candidate;
use super::fine::fine;
use super::identify::{self, Ordered};
use super::image::{Grey, Plane};
use super::lattice::{Field, Lattice};
use super::{Seen, fewest};

/// Lattice in one size of the image, all candidates there, and those that it did not use.
pub(super) type Coarse = (Lattice, Vec<Candidate>, Rest);

/// Candidates that the lattice did not use, for the search of a second board.
pub(super) struct Rest {
    pub plane: Plane,
    candidates: Vec<Candidate>,
    used: Vec<bool>,
    weakest: f32,
}

impl Rest {
    /// Nodes of a second board, if there is one: a lattice of what the first did not use that holds under
    /// the pattern's fit, and that is no part of the first behind something that divides it.
    pub fn second(&self, image: &Grey<'_>, board: &Board, first: &Seen) -> Option<usize> {
        let field = Field::new(&self.candidates, &self.plane, board.pattern, |n| {
            !self.used[n] && self.candidates[n].strength > self.weakest
        });
        let wanted = (board.columns * board.rows) as usize;
        let second = field.grow_best([board.columns, board.rows], wanted);
        let [ni, nj] = second.extent();
        let fewest = fewest(board).max(16);
        if second.nodes.len() < fewest || ni.min(nj) < 4 {
            return None;
        }
        let (nodes, _) = fine(image, board, &Ordered::upright(&second, &self.candidates))?;
        let first_h = first.ordered.homography()?;
        let contrast = 0.5 * first.contrast;
        let sound = nodes
            .iter()
            .filter(|(_, r)| r.is_pattern() && r.contrast.abs() > contrast);
        let sound: Vec<[f64; 2]> = sound.map(|(_, r)| r.position).collect();
        let same = sound
            .iter()
            .filter(|p| identify::on_lattice(&first_h, **p))
            .count();
        (sound.len() >= fewest && same * 2 < sound.len()).then_some(sound.len())
    }
}

/// The best lattice at one reduction of the image.
pub(super) fn coarse(
    image: &Grey<'_>,
    board: &Board,
    reduction: usize,
    fewest: usize,
) -> Option<Coarse> {
    let wanted = (board.columns * board.rows) as usize;
    let mut plane = Plane::smoothed(image, reduction);
    let most = 4 * wanted + 200;
    let limits = if let BoardPattern::Charuco { .. } = board.pattern {
        plane = plane.softer();
        // Markers have corners as well, but what is left of them after the smoothing is weaker than the squares'.
        vec![(3 * wanted / 2 + 20).min(most), most]
    } else {
        vec![most]
    };
    let candidates = super::candidates::find(&plane, board.pattern, most);
    let mut lattice = Lattice::default();
    for limit in limits {
        let field = Field::new(&candidates, &plane, board.pattern, |n| n < limit);
        // Two rows and columns more than the board has: a larger board shows as such.
        let grown = field.grow_best([board.columns + 2, board.rows + 2], wanted * 95 / 100);
        if grown.nodes.len() > lattice.nodes.len() {
            lattice = grown;
        }
        if lattice.nodes.len() * 2 >= wanted {
            break;
        }
    }
    let [ni, nj] = lattice.extent();
    if lattice.nodes.len() < fewest || ni.min(nj) < 3 {
        return None;
    }
    // Candidates inside the lattice (key discs, squares) are part of it.
    let hull = crate::map::Region::hull(lattice.nodes.values().map(|&n| candidates[n].position));
    let mut used: Vec<bool> = candidates
        .iter()
        .map(|c| hull.contains(c.position[0], c.position[1]))
        .collect();
    let mut weakest = f32::INFINITY;
    for &n in lattice.nodes.values() {
        used[n] = true;
        weakest = weakest.min(candidates[n].strength);
    }
    let rest = Rest {
        plane,
        candidates: candidates.clone(),
        used,
        weakest: 0.5 * weakest,
    };
    Some((lattice, candidates, rest))
}
