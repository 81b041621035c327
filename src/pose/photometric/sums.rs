//! Sums over the pixels of a comparison, and the weight of a residual.

use super::across::{ACROSS, LineResiduals};
pub(super) use super::edge_model_error::EdgeLight;
use super::edge_model_error::{EdgeName, EdgeSums, EdgesSeen};
use super::lanes::Lanes;
use super::lighting::{Cell, Lower};
use super::picture::Uneven;
use super::plan::Strip;
use super::response::{Response, ToneTable};
use super::{
    BACKGROUND, BLACK, BRIGHTNESS, Column, LINE, LOCAL, OF_RUN, PARAMETERS, Square, State,
    THICKNESS, TONE,
};
use crate::normal::{SIXTH, Tables};

/// Beyond so many noise sds a residual counts less and less in what the noise is found from.
const OUTLYING: f64 = 4.0;
/// A pixel of which less than this share is not clipped is not used.
const CLIPPED: f64 = 0.1;
/// Light above this share of the line's brightness counts as lit.
const LIT: f64 = 0.15;

/// Parameters that move light which no edge cuts: x, y and ψ move edges only.
pub(super) const INTERIOR: [usize; 8 + ACROSS] = {
    let mut interior = [0; 8 + ACROSS];
    [interior[0], interior[1], interior[2]] = [2, 3, 4];
    [interior[3], interior[4], interior[5]] = [BRIGHTNESS, THICKNESS, BACKGROUND];
    [interior[6], interior[7]] = [TONE, BLACK];
    let mut k = 0;
    while k < ACROSS {
        interior[8 + k] = LINE + k;
        k += 1;
    }
    interior
};

/// How pixels fared.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Tally {
    /// Σ ρ(r / noise).
    cost: f64,
    pub pixels: usize,
    /// Squared residuals of lit pixels away from edges, robustly cut, and their number.
    pub bright_square: f64,
    pub bright_count: usize,
    /// Weights of lit and edge pixels, and what their weighted residuals change by per residual.
    pub weights: f64,
    pub slopes: f64,
    pub edge_count: usize,
    /// Pixels whose weight is below one half.
    pub rejected: usize,
}

/// Sums over the pixels.
#[derive(Debug, Clone, Default)]
pub(crate) struct Sums {
    /// Jᵀ W J.
    pub information: Square,
    /// Jᵀ W r.
    pub gradient: Column,
    /// Σ ρ(r / noise).
    pub cost: f64,
    pub tally: Tally,
    pub edges: EdgesSeen,
    /// Where the run's parameters are estimated: residuals across the line.
    pub line_residuals: LineResiduals,
}

/// Rule by which residuals are weighed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Weighting {
    /// Pixel noise \[grey levels\].
    pub noise_sd: f64,
    /// Beyond this many noise sds a residual counts less and less (Tukey) or linearly (Huber).
    pub cut: f64,
    pub redescending: bool,
    /// The camera's.
    pub response: Response,
    pub run_parameters: RunParameters,
    /// The coefficients of uneven light are held, at a state in which it is even.
    pub even: bool,
}

/// The cross information of considered parameters with all else is smooth along the line: it is taken from every so many
/// columns, of those that no edge cuts, and of those that one cuts.
const CONSIDERED_EVERY: [usize; 2] = [8, 2];

/// Treatment of the run's parameters, the camera's response and the line's transverse profile: derivatives by them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum RunParameters {
    /// Held: none.
    Known,
    /// As consider parameters: the products of its derivatives with others, none with each other.
    Considered,
    /// All of them are estimated.
    Estimated,
}

impl RunParameters {
    /// Number of a pixel's derivatives.
    fn used(&self) -> usize {
        match self {
            RunParameters::Known => TONE,
            RunParameters::Considered | RunParameters::Estimated => LOCAL,
        }
    }
}

impl Weighting {
    /// Takes the response of a state of a frame that is clipped from a level on; where its curve has not moved, what is
    /// known of it stays.
    pub fn respond(&mut self, state: &State, ceiling: u8) {
        if self.response.tone != state.tone || self.response.black != state.black {
            self.response = Response::new([state.tone, state.black], ceiling);
        }
    }

    /// Cost, weight and d(weight r)/dr of a residual, squared, in units of the noise.
    #[inline]
    fn weigh(&self, square: f64, of_cut2: f64) -> (f64, f64, f64) {
        let c2 = self.cut * self.cut;
        if self.redescending {
            // Tukey's biweight, scaled so that ρ = r²/2 near zero.
            let share = square * of_cut2;
            let rest = 1.0 - share;
            if rest <= 0.0 {
                (c2 * SIXTH, 0.0, 0.0)
            } else {
                let rest2 = rest * rest;
                (
                    c2 * SIXTH * (1.0 - rest2 * rest),
                    rest2,
                    rest2 - 4.0 * share * rest,
                )
            }
        } else if square <= c2 {
            (0.5 * square, 1.0, 1.0)
        } else {
            let a = square.sqrt();
            (self.cut * a - 0.5 * c2, self.cut / a, 0.0)
        }
    }
}

/// Light of a pixel that is not the laser's.
#[derive(Debug, Clone, Copy)]
pub(super) struct Background {
    level: f64,
    /// Shift, per unit of ln γ and b, of its part that was measured through the same curve.
    measured: [f64; 2],
}

pub(super) struct Judged {
    pub residual: f64,
    /// Weight over variance.
    pub weight: f64,
    /// d expected / d light: below one where the sensor cuts off at zero, other than one where the camera's response is
    /// not yet known.
    pub share: f64,
    /// d expected / d tone and black.
    pub by_camera: [f64; 2],
}

/// Adds pixels up.
pub(super) struct Counter<'a> {
    weighting: &'a Weighting,
    /// Number of a pixel's derivatives.
    used: usize,
    /// Derivatives taken in the columns at hand, and for how many columns these stand.
    run_parameters: RunParameters,
    stands_for: f64,
    /// Columns met, those that no edge cuts and others.
    met: [usize; 2],
    tables: &'static Tables,
    tone_table: ToneTable,
    bright: f64,
    /// Part of the camera's curve that is not yet in its response.
    tone: f64,
    black: f64,
    /// Light of grey level 0, below which all is cut off, and of the ceiling.
    floor: f64,
    clip_light: f64,
    /// Light nearer to either than this is cut off in part.
    near: f64,
    /// 1 / noise², and 1 / cut².
    of_variance: f64,
    of_cut2: f64,
    pub sums: Sums,
    /// By all parameters, the lower triangle.
    lower: Box<Lower>,
    waiting: Lanes<LOCAL>,
    state: &'a State,
    /// Where the pixels at hand are.
    cell: Option<Cell>,
    /// Of that cell, the lower triangle of the information.
    pub information: [[f64; LOCAL]; LOCAL],
    pub gradient: [f64; LOCAL],
    edges: Vec<EdgeSums>,
    /// Background beyond what is fitted of it.
    pub uneven: Option<Uneven>,
    /// Of that, in the strip at hand: its first row, what blocks have there, and what they gain per row.
    along: (usize, f64, f64),
    /// Sd of the cell's dark beyond all that.
    dark_sd: f64,
    /// Share of the blur that the light was taken to get on the pixel grid.
    pub grid_share: f64,
    /// The one of them whose pixels are at hand.
    edge: usize,
}

impl<'a> Counter<'a> {
    pub fn new(weighting: &'a Weighting, tables: &'static Tables, state: &'a State) -> Self {
        Counter {
            weighting,
            used: weighting.run_parameters.used(),
            run_parameters: weighting.run_parameters,
            stands_for: 1.0,
            met: [0; 2],
            tables,
            tone_table: ToneTable::get(),
            bright: LIT * state.brightness,
            tone: state.tone - weighting.response.tone,
            black: state.black - weighting.response.black,
            floor: weighting.response.light(0),
            clip_light: weighting.response.clip_light,
            near: 4.0 * weighting.noise_sd,
            of_variance: 1.0 / (weighting.noise_sd * weighting.noise_sd),
            of_cut2: 1.0 / (weighting.cut * weighting.cut),
            sums: Sums::default(),
            lower: Box::new([[0.0; PARAMETERS]; PARAMETERS]),
            waiting: Lanes::new(),
            state,
            cell: None,
            information: [[0.0; LOCAL]; LOCAL],
            gradient: [0.0; LOCAL],
            edges: Vec::new(),
            uneven: None,
            along: (0, 0.0, 0.0),
            dark_sd: 0.0,
            grid_share: 0.0,
            edge: 0,
        }
    }

    /// Derivatives by the run's parameters that are taken in the columns at hand.
    pub fn run_parameters(&self) -> RunParameters {
        self.run_parameters
    }

    /// Derivatives by the run's parameters, from those by camera and line.
    #[inline]
    pub fn by_run(&self, by_camera: [f64; 2], by_line: &[f64; ACROSS]) -> [f64; OF_RUN] {
        let mut by = [0.0; OF_RUN];
        let (camera, line) = by.split_at_mut(2);
        for (by, of) in camera.iter_mut().zip(by_camera) {
            *by = self.stands_for * of;
        }
        for (by, of) in line.iter_mut().zip(by_line) {
            *by = self.stands_for * of;
        }
        by
    }

    /// Puts them into a pixel's derivatives, in which those by the line are.
    #[inline]
    pub fn put_run(&self, j: &mut [f64; LOCAL], by_camera: [f64; 2]) {
        let by_line = std::array::from_fn(|k| j[LINE + k]);
        j[TONE..].copy_from_slice(&self.by_run(by_camera, &by_line));
    }

    /// Begins the pixels of these strips, which an edge cuts or none.
    pub fn strips(&mut self, strips: &[Strip], cut: bool) {
        if self.weighting.run_parameters == RunParameters::Considered {
            let (met, every) = (
                &mut self.met[usize::from(cut)],
                CONSIDERED_EVERY[usize::from(cut)],
            );
            let run_parameters = if *met % every == every / 2 {
                RunParameters::Considered
            } else {
                RunParameters::Known
            };
            *met += 1;
            if run_parameters != self.run_parameters {
                self.empty();
            }
            (self.run_parameters, self.stands_for) = (run_parameters, every as f64);
        }
        if let (Some(uneven), Some(strip)) = (&self.uneven, strips.first()) {
            let (first, last) = (strip.first_row, strip.end_row);
            let (by, per_row) = uneven.along(strip.column, first, last);
            self.along = (first, by, per_row);
            self.dark_sd = uneven.sd((first + last) / 2);
        }
    }

    /// Background of a row of the strips at hand, of which so much is fitted.
    ///
    /// Its uneven part is known in grey levels of the dark, and is light of the curve that these were seen through.
    /// Where that is considered or estimated, another curve makes other light of them: with it held, a light that flickers would
    /// look like a curve.
    #[inline]
    pub fn background(&self, fitted: f64, row: usize) -> Background {
        let beyond = self.of_row(row);
        Background {
            level: fitted + beyond,
            measured: if beyond == 0.0 || self.run_parameters == RunParameters::Known {
                [0.0; 2]
            } else {
                self.measured(beyond)
            },
        }
    }

    /// By how much ln γ and b move light that lies so far beyond the dark.
    #[inline(never)]
    fn measured(&self, beyond: f64) -> [f64; 2] {
        let dark = self.uneven.as_ref().map_or(0.0, |uneven| uneven.dark);
        let moved = |light: f64| {
            let (by_tone, slope) = self.tone_table.at(light);
            [by_tone, self.weighting.response.by_black(slope - 1.0)]
        };
        let (there, here) = (moved(dark + beyond), moved(dark));
        [there[0] - here[0], there[1] - here[1]]
    }

    /// Light of a row of the strips at hand beyond the background.
    #[inline]
    fn of_row(&self, row: usize) -> f64 {
        let Some(uneven) = &self.uneven else {
            return 0.0;
        };
        let (first, by, per_row) = self.along;
        let rows = uneven.rows.level.get(row).copied().unwrap_or(0.0);
        rows + by + per_row * (row as f64 - first as f64)
    }

    /// Begins the pixels of this cell.
    pub fn enter(&mut self, cell: &Cell) {
        if self.cell.as_ref().is_some_and(|c| c.is(cell)) {
            return;
        }
        self.leave();
        self.cell = Some(*cell);
    }

    /// Adds the cell's sums to those by all parameters.
    fn leave(&mut self) {
        self.empty();
        if let Some(cell) = self.cell.take() {
            self.leave_dark_open();
            let all = (&mut *self.lower, &mut self.sums.gradient);
            cell.spread(
                self.state,
                self.used,
                (&self.information, &self.gradient),
                all,
            );
            for row in &mut self.information[..self.used] {
                row[..self.used].fill(0.0);
            }
            self.gradient[..self.used].fill(0.0);
        }
    }

    /// Where the dark is uneven each cell's own is known to its sd, and follows: its part of the sums is eliminated.
    fn leave_dark_open(&mut self) {
        if self.dark_sd == 0.0 {
            return;
        }
        let own = self.information[BACKGROUND][BACKGROUND] + 1.0 / (self.dark_sd * self.dark_sd);
        let by: [f64; LOCAL] =
            std::array::from_fn(|k| self.information[k.max(BACKGROUND)][k.min(BACKGROUND)]);
        let pull = self.gradient[BACKGROUND];
        for a in 0..self.used {
            self.gradient[a] -= by[a] * pull / own;
            for b in 0..=a {
                self.information[a][b] -= by[a] * by[b] / own;
            }
        }
        self.sums.cost -= 0.5 * pull * pull / own;
    }

    /// Begins the pixels of a column that this edge cuts.
    pub fn at_edge(&mut self, name: EdgeName) {
        self.edge = self
            .edges
            .iter()
            .position(|e| e.name == name)
            .unwrap_or_else(|| {
                self.edges.push(EdgeSums::new(name));
                self.edges.len() - 1
            });
        if let Some(edge) = self.edges.get_mut(self.edge) {
            edge.next_column();
        }
    }

    /// The next pixel of the edge is not used.
    pub fn skip(&mut self) {
        if let Some(edge) = self.edges.get_mut(self.edge) {
            edge.skip();
        }
    }

    /// Judges a pixel that no edge cuts; `None` where it is clipped. RUN: derivatives by the run's parameters may be wanted.
    #[inline(always)]
    pub fn interior<const RUN: bool>(
        &self,
        grey: u8,
        light: f64,
        background: Background,
        tally: &mut Tally,
    ) -> Option<Judged> {
        let (residual, share, by_camera) = self.residual::<RUN>(grey, light, background)?;
        let (cost, weight, slope) = self
            .weighting
            .weigh(residual * residual * self.of_variance, self.of_cut2);
        tally.cost += cost;
        tally.pixels += 1;
        if light > self.bright {
            let square = residual * residual;
            let most = OUTLYING * self.weighting.noise_sd;
            tally.bright_square += if square <= most * most {
                square
            } else {
                most * residual.abs()
            };
            tally.bright_count += 1;
            tally.weights += weight;
            tally.slopes += slope;
            tally.rejected += usize::from(weight < 0.5);
        }
        Some(Judged {
            residual,
            weight: weight * self.of_variance,
            share,
            by_camera,
        })
    }

    /// Judges a pixel that an edge may cut: `edge_light` is sensitive to where exactly, which is the model error
    /// (`model_error_sd`) beyond the noise.
    #[inline]
    pub fn edge<const RUN: bool>(
        &mut self,
        grey: u8,
        light: f64,
        background: Background,
        edge_light: Option<EdgeLight>,
        model_error_sd: f64,
    ) -> Option<Judged> {
        let Some((residual, share, by_camera)) = self.residual::<RUN>(grey, light, background)
        else {
            self.skip();
            return None;
        };
        let noise_sd = self.weighting.noise_sd;
        let of_variance = if model_error_sd == 0.0 {
            self.of_variance
        } else {
            1.0 / (noise_sd * noise_sd + model_error_sd * model_error_sd)
        };
        let (cost, weight, slope) = self
            .weighting
            .weigh(residual * residual * of_variance, self.of_cut2);
        let tally = &mut self.sums.tally;
        tally.cost += cost;
        tally.pixels += 1;
        tally.edge_count += 1;
        tally.weights += weight;
        tally.slopes += slope;
        tally.rejected += usize::from(weight < 0.5);
        match (edge_light, self.edges.get_mut(self.edge)) {
            (Some(edge_light), Some(edge)) => {
                // Where the sensor cuts off at zero, less of it shows.
                let by_grid = edge_light.by_grid * share;
                edge.see(
                    EdgeLight {
                        by_grid,
                        ..edge_light
                    },
                    residual,
                    noise_sd,
                    weight * of_variance,
                );
            }
            _ => self.skip(),
        }
        Some(Judged {
            residual,
            weight: weight * of_variance,
            share,
            by_camera,
        })
    }

    /// Residual against what a sensor that gives no negative level would show of `level`:
    /// E max(0, m + n) = m Φ(m/σ) + σ φ(m/σ), derivative Φ(m/σ), with m counted from the light of grey level 0.
    #[inline(always)]
    fn residual<const RUN: bool>(
        &self,
        grey: u8,
        light: f64,
        background: Background,
    ) -> Option<(f64, f64, [f64; 2])> {
        let Background { level, measured } = background;
        let level = light + level;
        let response = &self.weighting.response;
        let seen = response.light(grey);
        match self.run_parameters {
            run_parameters if !RUN || run_parameters == RunParameters::Known => {
                let (residual, share) = self.cut_off(seen, level)?;
                Some((residual, share, [0.0; 2]))
            }
            RunParameters::Considered => {
                let (residual, share) = self.cut_off(seen, level)?;
                let moved = response.moved_by(level);
                Some((
                    residual,
                    share,
                    [moved[0] - measured[0], moved[1] - measured[1]].map(|by| share * by),
                ))
            }
            _ => self.residual_and_curve(seen, level, measured),
        }
    }

    /// The same with what is left of the camera's curve.
    #[inline(never)]
    fn residual_and_curve(
        &self,
        seen: f64,
        level: f64,
        measured: [f64; 2],
    ) -> Option<(f64, f64, [f64; 2])> {
        let (by_tone, slope) = self.tone_table.at(level);
        let by_black = self.weighting.response.by_black(slope - 1.0) - measured[1];
        let by_tone = by_tone - measured[0];
        let straight = 1.0 + self.tone * slope;
        let level = level + self.tone * by_tone + self.black * by_black;
        let (residual, share) = self.cut_off(seen, level)?;
        Some((
            residual,
            share * straight,
            [share * by_tone, share * by_black],
        ))
    }

    /// Residual of light against what a sensor shows of it that is cut off at both ends, and the share of it that is not.
    #[inline(always)]
    fn cut_off(&self, seen: f64, level: f64) -> Option<(f64, f64)> {
        let (above, room) = (level - self.floor, self.clip_light - level);
        if above >= self.near && room >= self.near {
            return Some((seen - level, 1.0));
        }
        let noise_sd = self.weighting.noise_sd;
        if room < self.near {
            // E min(ceiling, m + n), the same seen from above.
            let (share, density) = self.tables.normal(room / noise_sd);
            let expected = self.clip_light - room * share - noise_sd * density;
            return (share >= CLIPPED).then_some((seen - expected, share));
        }
        let (share, density) = self.tables.normal(above / noise_sd);
        let expected = self.floor + above * share + noise_sd * density;
        Some((seen - expected, share))
    }

    /// Adds one pixel to the normal equations.
    #[inline]
    pub fn add(&mut self, j: &[f64; LOCAL], weight: f64, residual: f64) {
        let full = match self.run_parameters {
            RunParameters::Known => self.waiting.push_first::<TONE>(j, weight, residual),
            RunParameters::Considered | RunParameters::Estimated => {
                self.waiting.push(j, weight, residual)
            }
        };
        if full {
            self.empty();
        }
    }

    fn empty(&mut self) {
        let (information, gradient) = (&mut self.information, &mut self.gradient);
        match self.run_parameters {
            RunParameters::Known => self
                .waiting
                .empty_first_into::<TONE, TONE>(information, gradient),
            RunParameters::Considered => self
                .waiting
                .empty_first_into::<LOCAL, TONE>(information, gradient),
            RunParameters::Estimated => self.waiting.empty_into(information, gradient),
        }
    }

    /// Adds one pixel that no laser light reaches: it has information of the background alone.
    #[inline]
    pub fn add_dark(&mut self, judged: &Judged) {
        let weighted = judged.weight * judged.share;
        self.information[BACKGROUND][BACKGROUND] += weighted * judged.share;
        self.gradient[BACKGROUND] += weighted * judged.residual;
        if self.run_parameters == RunParameters::Known {
            return;
        }
        let of_camera = judged.by_camera.map(|by| self.stands_for * by);
        for (k, by) in of_camera.iter().enumerate() {
            let weighted = judged.weight * by;
            let row = &mut self.information[TONE + k];
            row[BACKGROUND] += weighted * judged.share;
            if self.run_parameters == RunParameters::Estimated {
                for (sum, with) in row[TONE..].iter_mut().zip(&of_camera[..=k]) {
                    *sum += weighted * with;
                }
            }
            self.gradient[TONE + k] += weighted * judged.residual;
        }
    }

    pub fn done(mut self) -> Sums {
        self.leave();
        let lower = &self.lower;
        self.sums.cost += self.sums.tally.cost;
        Sums {
            information: Square::from_fn(|a, b| lower[a.max(b)][a.min(b)]),
            edges: EdgesSeen {
                edges: self.edges,
                grid_share: self.grid_share,
            },
            ..self.sums
        }
    }
}
