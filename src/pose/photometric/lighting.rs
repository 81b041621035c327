//! Light that is uneven along the line, and a background that is uneven too.
//!
//! A lens darkens towards its corners, a line is dimmer at its ends, a lamp lights one side: all of it is smooth. So the
//! line's brightness and the background are low polynomials (Legendre's, of column and row), each frame's own, and
//! fitted with its pose:
//!
//! brightness(u, v) = A (1 + Σ gₖ Gₖ(u, v)),  background(u, v) = B + Σ hₖ Hₖ(u, v)
//!
//! with u from −1 to 1 across the image, and v the row from the middle of those looked at, in eighths of the image.
//!
//! Within a cell (some columns of one level of the target) both are taken at the cell's middle. There all pixels share the
//! derivatives by the coefficients, up to a factor: pixels add up nine parameters, and a cell's sums are transformed into those
//! of all once.

use super::{BACKGROUND, BRIGHTNESS, Column, LOCAL, PARAMETERS, State};

/// Coefficients of the brightness: P₁…P₄ of the column, the row, and the row times the column. A lens' cos⁴ and a line dimmer
/// at its ends need the fourth along the line; target and floor lie some tens of rows apart.
pub(super) const GAINS: usize = 6;
/// Of the background: P₁…P₃ of the column, and the row.
pub(super) const AMBIENTS: usize = 4;
/// All of them.
pub const UNEVEN: usize = GAINS + AMBIENTS;
/// Coefficients of uneven light: of the brightness, then of the background.
pub type Uneven = [f64; UNEVEN];

/// One of v, as a share of the image's height.
const ROWS_SHARE: f64 = 0.125;
/// Columns of a cell \[px\]: brightness that falls by a tenth towards the ends changes by half a hundredth within it.
pub(super) const CELL_PX: usize = 12;

/// Their prior: zero, with these standard deviations. A half of the line's brightness is more than
/// any lens takes; of thirty grey levels of background a frame determines to a hundredth.
pub(crate) const PRIOR_SD: [f64; UNEVEN] = {
    let mut sd = [0.5; UNEVEN];
    let mut k = GAINS;
    while k < UNEVEN {
        sd[k] = 30.0;
        k += 1;
    }
    sd
};

/// Least and greatest brightness, as shares of its middle, and background along the line.
pub(crate) fn line_range(state: &State) -> [[f64; 2]; 2] {
    const PLACES: usize = 33;
    let start = [f64::INFINITY, f64::NEG_INFINITY];
    (0..PLACES).fold([start; 2], |ranges, k| {
        // A row in the middle of those looked at, in an image of this many columns.
        let cell = Cell::at([k * CELL_PX, 0], 0.5, 0, (PLACES * CELL_PX, 1));
        let here = cell.of(state);
        let values = [here.brightness / state.brightness, here.background];
        let mut ranges = ranges;
        for (range, value) in ranges.iter_mut().zip(values) {
            *range = [range[0].min(value), range[1].max(value)];
        }
        ranges
    })
}

/// The lower triangle of the information by all parameters, by rows.
pub(super) type Lower = [[f64; PARAMETERS]; PARAMETERS];

/// Some columns of one level of the target.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Cell {
    /// Which columns, which level.
    key: (usize, usize),
    /// Its middle: column, row of its first strip \[px\].
    pub middle_px: [f64; 2],
    /// The polynomials in its middle.
    basis: [f64; UNEVEN],
}

impl Cell {
    /// All of the image, where nothing is uneven.
    pub const EVEN: Cell = Cell {
        key: (0, 0),
        middle_px: [0.0; 2],
        basis: [0.0; UNEVEN],
    };

    /// The cell about a pixel of a level, in an image of this size.
    pub fn at(
        [column, row]: [usize; 2],
        about_row: f64,
        level: usize,
        (width_px, height_px): (usize, usize),
    ) -> Self {
        let along = column / CELL_PX;
        let middle_px = (along as f64 + 0.5) * CELL_PX as f64;
        let u = (2.0 * middle_px / width_px.max(1) as f64 - 1.0).clamp(-1.0, 1.0);
        let v = (row as f64 + 0.5 - about_row) / (ROWS_SHARE * height_px.max(1) as f64);
        let u2 = 1.5 * u * u - 0.5;
        let u3 = (2.5 * u * u - 1.5) * u;
        let u4 = (4.375 * u * u - 3.75) * u * u + 0.375;
        Cell {
            key: (along, level),
            middle_px: [middle_px, row as f64],
            basis: [u, u2, u3, u4, v, u * v, u, u2, u3, v],
        }
    }

    /// Whether this is the other one too.
    pub fn is(&self, other: &Cell) -> bool {
        self.key == other.key
    }

    /// Light and background in this cell.
    pub fn of(&self, state: &State) -> State {
        let sum = |from: usize, to: usize| -> f64 {
            let coefficients = &state.uneven[from..to];
            coefficients
                .iter()
                .zip(&self.basis[from..to])
                .map(|(c, b)| c * b)
                .sum()
        };
        State {
            brightness: state.brightness * (1.0 + sum(0, GAINS)),
            background: state.background + sum(GAINS, UNEVEN),
            ..*state
        }
    }

    /// Adds sums over pixels of this cell, by its own brightness and background, to those by all parameters; of the cell's the first `used`
    /// are there.
    pub fn spread(
        &self,
        state: &State,
        used: usize,
        (information, gradient): (&[[f64; LOCAL]; LOCAL], &[f64; LOCAL]),
        (all, right): (&mut Lower, &mut Column),
    ) {
        let of_gain = self.of_gain(state);
        let scaled = |k: usize| if k == BRIGHTNESS { of_gain } else { 1.0 };
        // Of brightness and background: their products with each of the pixels' own.
        let rows = [BRIGHTNESS, BACKGROUND].map(|of| {
            let mut row = [0.0; LOCAL];
            for (k, to) in row.iter_mut().enumerate().take(used) {
                *to = scaled(k) * information[k.max(of)][k.min(of)];
            }
            row
        });
        for (a, (own, to)) in information
            .iter()
            .zip(all.iter_mut())
            .enumerate()
            .take(used)
        {
            let by = scaled(a);
            for (sum, of) in to.iter_mut().zip(&own[..=a]) {
                *sum += by * of;
            }
            if a >= BRIGHTNESS {
                to[BRIGHTNESS] += by * (of_gain - 1.0) * own[BRIGHTNESS];
            }
        }
        self.spread_column(state, used, gradient, |k, by| right[k] += by);
        if *self == Cell::EVEN {
            return;
        }
        let moves = self.moves(state);
        for (n, &(of, by)) in moves.iter().enumerate() {
            let to = &mut all[LOCAL + n];
            for (sum, own) in to.iter_mut().zip(&rows[of]).take(used) {
                *sum += by * own;
            }
            let pixels = [BRIGHTNESS, BACKGROUND];
            for (sum, &(with, times)) in to[LOCAL..].iter_mut().zip(&moves[..=n]) {
                let (i, j) = (pixels[of], pixels[with]);
                *sum += by * times * information[i.max(j)][i.min(j)];
            }
        }
    }

    /// Adds a column of sums by this cell's own brightness and background to one by all parameters; of the cell's the first `used` are
    /// there.
    pub fn spread_column(
        &self,
        state: &State,
        used: usize,
        own: &[f64; LOCAL],
        mut add: impl FnMut(usize, f64),
    ) {
        let of_gain = self.of_gain(state);
        for (k, of) in own.iter().enumerate().take(used) {
            let by = if k == BRIGHTNESS { of_gain } else { 1.0 };
            add(k, by * of);
        }
        if *self == Cell::EVEN {
            return;
        }
        for (n, (of, by)) in self.moves(state).into_iter().enumerate() {
            add(LOCAL + n, by * own[[BRIGHTNESS, BACKGROUND][of]]);
        }
    }

    /// What each coefficient moves, brightness (0) or background (1), and by how much.
    fn moves(&self, state: &State) -> [(usize, f64); UNEVEN] {
        std::array::from_fn(|k| match k {
            _ if k < GAINS => (0, state.brightness * self.basis[k]),
            _ => (1, self.basis[k]),
        })
    }

    fn of_gain(&self, state: &State) -> f64 {
        1.0 + state.uneven[..GAINS]
            .iter()
            .zip(&self.basis)
            .map(|(c, b)| c * b)
            .sum::<f64>()
    }
}
