//! Markers of a ChArUco board: what the light squares of a lattice show, and which place on the board that is.
//!
//! A place is a turn and a shift (and a mirror) of the whole lattice. Every place predicts the bits of every square, and all
//! of them are asked at once: a square shows its marker, each bit wrong with some probability, or something that is in
//! front of it. The place with the posterior probability is the answer, or that there is none. So a marker half under a
//! hand still speaks with the bits that are seen, and two readings by accident do not outvote thirty.

use std::collections::HashSet;

use hydroline_rigs::{Board, BoardPattern, Dictionary};

use super::NotFound;
use super::identify::turn_index;
use super::image::Grey;
use super::key::KeySearch;
use super::lattice::Index;
use super::smooth::Smooth;
use crate::charuco::{self, Markers};

/// Probabilities that a bit of a marker in view is read wrongly, one of them of all bits in an image, each as likely as the
/// others: noise and a line over it, or a blur as wide as a bit.
const WRONG_BIT: [f64; 4] = [0.01, 0.05, 0.12, 0.25];
/// Probability that a square shows something else than its marker, although light and dark are seen in it.
const HIDDEN: f64 = 0.1;
/// Posterior probability that a place may lack of certainty.
const LACKING: f64 = 1e-6;
/// A square of less than this share of the pattern's contrast is not read: shade, glare, a hand.
const LEAST_CONTRAST: f64 = 0.3;
/// A bit so many blurs wide is read rightly whatever its neighbours are; what narrower ones seem to say accuses no board.
const NARROWEST_BIT: f64 = 2.5;
/// So many squares that are read and fit no place are another board's.
const ANOTHER: usize = 4;

/// Lattice that is asked.
pub(super) struct Asked<'a> {
    pub image: &'a Grey<'a>,
    pub map: &'a Smooth,
    /// Nodes found, from 0.
    pub nodes: &'a HashSet<Index>,
    /// Whether the squares with an even sum of indices are the light ones.
    pub light_even: bool,
    /// Of the pattern, half of light less dark \[grey levels\].
    pub contrast: f64,
    /// Point spread, standard deviation \[px\].
    pub blur_px: f64,
}

/// Bits of a square: those of its marker for each turn of the lattice, upright and mirrored.
struct Square {
    /// Twice its middle in lattice coordinates.
    middle: Index,
    words: [u64; 8],
}

/// Index after a turn and, if so, a mirror.
fn ordered(k: Index, turns: usize, flip: bool) -> Index {
    let [i, j] = turn_index(k, turns);
    if flip { [j, i] } else { [i, j] }
}

impl Asked<'_> {
    /// Light squares with at least two of their corners.
    fn squares(&self) -> Vec<Index> {
        let mut around: Vec<Index> = (self.nodes.iter())
            .flat_map(|&[i, j]| [[i, j], [i - 1, j], [i, j - 1], [i - 1, j - 1]])
            .collect();
        around.sort_unstable();
        let mut squares = Vec::new();
        for same in around.chunk_by(|a, b| a == b) {
            let even = (same[0][0] + same[0][1]).rem_euclid(2) == 0;
            if same.len() >= 2 && even == self.light_even {
                squares.push(same[0]);
            }
        }
        squares
    }

    /// Grey level at a place of a square; `None` beside the image.
    fn grey(&self, square: Index, [u, v]: [f64; 2]) -> Option<f64> {
        let p = (self.map).at([f64::from(square[0]) + u, f64::from(square[1]) + v])?;
        let [w, h] = [self.image.width(), self.image.height()].map(|n| n as f64 - 1.0);
        let inside = p[0] >= 0.0 && p[1] >= 0.0 && p[0] <= w && p[1] <= h;
        inside.then(|| f64::from(self.image.sample(p[0], p[1])))
    }

    /// Mean over the middle half of a marker's cell.
    fn cell(&self, square: Index, share: f64, cells: u32, place: [u32; 2]) -> Option<f64> {
        let gap = 0.5 * (1.0 - share);
        let mut sum = 0.0;
        for y in [0.3, 0.5, 0.7] {
            for x in [0.3, 0.5, 0.7] {
                let at =
                    |k: u32, within: f64| gap + share * (f64::from(k) + within) / f64::from(cells);
                sum += self.grey(square, [at(place[0], x), at(place[1], y)])?;
            }
        }
        Some(sum / 9.0)
    }

    /// Bits of a square with markers of that side; `None` where it is not seen or has not the contrast.
    fn read(&self, square: Index, share: f64, side: u32) -> Option<Square> {
        let cells = side + 2;
        let median = |mut v: Vec<f64>| {
            v.sort_by(f64::total_cmp);
            v.get(v.len() / 2).copied()
        };
        let last = cells - 1;
        let rim = (0..last).flat_map(|k| [[k, 0], [last, k], [last - k, last], [0, last - k]]);
        let rim: Option<Vec<f64>> = rim.map(|k| self.cell(square, share, cells, k)).collect();
        // Half way between the marker and its square's rim.
        let aside = 0.25 * (1.0 - share);
        let beside = (1..8).flat_map(|k| {
            let t = f64::from(k) / 8.0;
            [[t, aside], [1.0 - aside, t], [t, 1.0 - aside], [aside, t]]
        });
        let beside: Option<Vec<f64>> = beside.map(|at| self.grey(square, at)).collect();
        let (dark, light) = (median(rim?)?, median(beside?)?);
        if light - dark < 2.0 * LEAST_CONTRAST * self.contrast {
            return None;
        }
        let threshold = 0.5 * (dark + light);
        let mut bits = Vec::with_capacity((side * side) as usize);
        for b in 0..side {
            for a in 0..side {
                bits.push(self.cell(square, share, cells, [a + 1, b + 1])? > threshold);
            }
        }
        let n = side as i32;
        let mut words = [0u64; 8];
        for (k, word) in words.iter_mut().enumerate() {
            for row in 0..n {
                for column in 0..n {
                    // Against ξ and η, twice from the marker's middle.
                    let on_board = [n - 1 - 2 * column, n - 1 - 2 * row];
                    let [x, y] = on_board;
                    let back = if k >= 4 { [y, x] } else { on_board };
                    let [a, b] = turn_index(back, 4 - k % 4).map(|v| (v + n - 1) / 2);
                    *word = *word << 1 | u64::from(bits[(b * n + a) as usize]);
                }
            }
        }
        Some(Square {
            middle: square.map(|v| 2 * v + 1),
            words,
        })
    }

    fn read_all(&self, share: f64, side: u32) -> Vec<Square> {
        let squares = self.squares().into_iter();
        squares.filter_map(|k| self.read(k, share, side)).collect()
    }

    /// Looks for the place of the lattice on a board with markers.
    ///
    /// # Errors
    /// [`NotFound::OtherMarkers`]: markers are read, and they are not this board's.
    pub fn search(&self, markers: &Markers) -> Result<KeySearch, NotFound> {
        let side = markers.dictionary.side;
        let squares = self.read_all(markers.share, side);
        let places = Places {
            markers,
            squares: &squares,
        };
        match places.best() {
            Best::Place {
                turns,
                shift,
                flip: false,
            } => Ok(KeySearch::Seen(turns, shift)),
            Best::Place { .. } => Ok(KeySearch::Mirrored),
            Best::Nowhere if squares.len() >= ANOTHER && self.legible(markers) => {
                Err(NotFound::OtherMarkers {
                    squares: squares.len(),
                    dictionary: markers.dictionary.name(),
                    seen: self.seen_as(markers.share),
                })
            }
            Best::Nowhere | Best::Open => Ok(KeySearch::Hidden),
        }
    }

    /// Whether bits of these markers are wide enough to be read.
    fn legible(&self, markers: &Markers) -> bool {
        let steps = |&[i, j]: &Index| {
            let at = |di: f64, dj: f64| self.map.at([f64::from(i) + di, f64::from(j) + dj]);
            let (p, a, b) = (at(0.0, 0.0)?, at(1.0, 0.0)?, at(0.0, 1.0)?);
            let pitch = |q: [f64; 2]| (q[0] - p[0]).hypot(q[1] - p[1]);
            Some(pitch(a).min(pitch(b)))
        };
        let narrowest = (self.nodes.iter().filter_map(steps)).fold(f64::INFINITY, f64::min);
        let bit_px = markers.share * narrowest / f64::from(markers.dictionary.side + 2);
        bit_px > NARROWEST_BIT * self.blur_px
    }

    /// The side of the dictionary of which most squares show a marker, whatever its id.
    fn seen_as(&self, share: f64) -> Option<u32> {
        [4, 5, 6, 7].into_iter().find(|&side| {
            let squares = self.read_all(share, side);
            let all = Dictionary {
                side,
                markers: u32::MAX,
            };
            let known: HashSet<u64> = charuco::markers(all).iter().copied().collect();
            let read = |s: &&Square| s.words[..4].iter().any(|w| known.contains(w));
            let count = squares.iter().filter(read).count();
            squares.len() >= ANOTHER && 2 * count > squares.len()
        })
    }
}

/// All places that a lattice may have on a board.
struct Places<'a> {
    markers: &'a Markers,
    squares: &'a [Square],
}

enum Best {
    Place {
        turns: usize,
        shift: Index,
        flip: bool,
    },
    /// That the squares show no such board is more likely than all places.
    Nowhere,
    Open,
}

/// Logarithms of likelihoods against a square that shows anything, for each probability of a wrong bit.
type Gains = [f64; WRONG_BIT.len()];

impl Places<'_> {
    /// By number of wrong bits: each bit of something else is light or dark alike.
    fn gains(&self) -> Vec<Gains> {
        let bits = self.markers.dictionary.side * self.markers.dictionary.side;
        let gain = |wrong: u32| {
            WRONG_BIT.map(|each| {
                let right = f64::from(bits - wrong) * (2.0 * (1.0 - each)).ln();
                let marker = (right + f64::from(wrong) * (2.0 * each).ln()).exp();
                ((1.0 - HIDDEN) * marker + HIDDEN).ln()
            })
        };
        (0..=bits).map(gain).collect()
    }

    /// Of every square, at a place.
    fn each(
        &self,
        gains: &[Gains],
        orientation: usize,
        shift: Index,
    ) -> impl Iterator<Item = Gains> {
        self.squares.iter().map(move |square| {
            let middle = ordered(square.middle, orientation % 4, orientation >= 4);
            let on_board = [0, 1].map(|a| (middle[a] - 1).div_euclid(2) + shift[a]);
            match self.markers.bits(on_board) {
                Some(word) => gains[(word ^ square.words[orientation]).count_ones() as usize],
                None => [HIDDEN.ln(); WRONG_BIT.len()],
            }
        })
    }

    fn sums(&self, gains: &[Gains], orientation: usize, shift: Index) -> Gains {
        let all = self.each(gains, orientation, shift);
        all.fold([0.0; WRONG_BIT.len()], |sums, gain| {
            std::array::from_fn(|k| sums[k] + gain[k])
        })
    }

    fn best(&self) -> Best {
        let gains = self.gains();
        let mut likelihoods = vec![(0.0, None)];
        for orientation in 0..8 {
            for shift in self.shifts(orientation) {
                let sums = self.sums(&gains, orientation, shift);
                let most = sums.iter().copied().fold(f64::NEG_INFINITY, f64::max);
                let mean = sums.iter().map(|s| (s - most).exp()).sum::<f64>() / sums.len() as f64;
                likelihoods.push((most + mean.ln(), Some((orientation, shift))));
            }
        }
        let most = likelihoods.iter().map(|l| l.0).fold(0.0, f64::max);
        let total: f64 = likelihoods.iter().map(|l| (l.0 - most).exp()).sum();
        let certain = |l: &&(f64, _)| (l.0 - most).exp() > (1.0 - LACKING) * total;
        match likelihoods.iter().find(certain) {
            Some((_, Some((orientation, shift))))
                if self.most_show(&gains, *orientation, *shift) =>
            {
                Best::Place {
                    turns: orientation % 4,
                    shift: *shift,
                    flip: *orientation >= 4,
                }
            }
            Some(_) => Best::Nowhere,
            None => Best::Open,
        }
    }

    /// Whether most squares show their markers: a board of the same dictionary and another width agrees in two rows.
    fn most_show(&self, gains: &[Gains], orientation: usize, shift: Index) -> bool {
        let sums = self.sums(gains, orientation, shift);
        let likeliest = (0..sums.len()).max_by(|a, b| sums[*a].total_cmp(&sums[*b]));
        let shown = |gain: &Gains| likeliest.is_some_and(|k| gain[k] > 0.0);
        let count = self.each(gains, orientation, shift).filter(shown).count();
        2 * count > self.squares.len()
    }

    /// Shifts under which any of the squares lies on the board.
    fn shifts(&self, orientation: usize) -> impl Iterator<Item = Index> {
        let board = self.markers.extent();
        let middles: Vec<Index> = (self.squares.iter())
            .map(|s| ordered(s.middle, orientation % 4, orientation >= 4))
            .collect();
        let ranges = [0, 1].map(|a| {
            let of = middles.iter().map(|m| (m[a] - 1).div_euclid(2));
            let (low, high) = (of.clone().min().unwrap_or(0), of.max().unwrap_or(-1));
            -1 - high..board[a] - low
        });
        let [across, up] = ranges;
        up.flat_map(move |j| across.clone().map(move |i| [i, j]))
    }
}

/// Moves coarse nodes to those of finer planes. Markers vanish in the plane that shows the lattice, whose nodes are then
/// uncertain by more than a fit can mend; in a finer one the corner nearest to a node is the node: a marker's own corners
/// are a third of a pitch away.
pub(super) fn sharpen(
    image: &Grey<'_>,
    board: &Board,
    reduction: usize,
    ordered: &mut super::Ordered,
) {
    const NEAR: f64 = 0.2;
    let BoardPattern::Charuco { .. } = board.pattern else {
        return;
    };
    let mut reduction = reduction;
    while reduction > 2 {
        reduction /= 2;
        let plane = super::Plane::smoothed(image, reduction);
        let limit = 40 * (board.columns * board.rows) as usize;
        let found = super::candidates::find(&plane, board.pattern, limit);
        let field = super::Field::new(&found, &plane, board.pattern, |_| true);
        let Some(h) = ordered.homography() else {
            return;
        };
        let moved: Vec<(Index, [f64; 2])> = (ordered.nodes.iter())
            .filter_map(|(&k, &p)| {
                let steps = ordered.steps(k, &h)?;
                let pitch = steps.map(|s| s[0].hypot(s[1]));
                let n = field.nearest(p, NEAR * pitch[0].min(pitch[1]))?;
                Some((k, found[n].position))
            })
            .collect();
        ordered.nodes.extend(moved);
    }
}
