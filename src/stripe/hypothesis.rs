//! Choice of the stripe among several lines in the picture.
//!
//! Where two lines share columns, one of them is a lamp, a window's edge or a reflection. A stripe
//! is thin, has the profile of a beam, and goes through. Every chain of candidates is looked at in
//! a few columns: what a beam's profile explains there, how wide it is, and what it leaves
//! unexplained. Chains alike in width that do not share columns make up one line (depth steps
//! and shadows part it), and lines are compared as wholes. Chains of the lines that lose are
//! ruled out before the path is sought, so that it does not jump to them where the stripe has a
//! gap. Without two lines in the same columns nothing is done.

use super::ceiling;
use super::chains::{self, Chain};
use super::extractor::Extractor;
use super::fit::{self, Known, Window};
use super::kernel::{SIGMA_MAX_PX, SIGMA_MIN_PX};
use super::trace::WIDTH_ROWS;
use hydroline_core::frame::GreyView;

/// Columns of a chain that are looked at.
const SAMPLES: usize = 15;
/// Columns that two chains may share before one of them has to go: rounding of ends.
const SHARED_COLUMNS: usize = 8;
/// Misfit of a beam's profile, as a fraction of its height, at which a line counts
/// half: speckle and a lens leave 0.02, an evenly lit bar 0.1.
const MISFIT: f64 = 0.04;
/// Width to which neighbours in one line agree: perspective over a frame makes 1.3 at most.
const WIDTH_RATIO: f64 = 1.5;
/// Height to which they do: albedo and the fan's fall-off.
const PEAK_RATIO: f64 = 4.0;
/// How much higher than the ceiling a clipped stripe is, at most: beyond, it is something else
/// with steep sides.
const MAX_OVER_CEILING: f64 = 6.0;
/// Lines that are built up, one from each of the best chains.
const MAX_LINES: usize = 8;

/// Width, height and evidence of a chain in the columns looked at.
#[derive(Debug, Clone, Copy)]
struct Look {
    sigma_px: f64,
    peak: f64,
    /// Evidence per column.
    weight: f64,
}

impl Extractor {
    /// Rules out the candidates of all lines but the best, where lines share columns.
    pub(super) fn rule_out_other_lines(&mut self, image: GreyView<'_>, noise_sd: f64) {
        let crowded = (0..image.width_px).filter(|c| self.spots.column(*c).len() > 1);
        if crowded.take(self.config.min_stretch_columns + 1).count()
            <= self.config.min_stretch_columns
        {
            return;
        }
        let shortest = self
            .config
            .min_stretch_columns
            .min(image.width_px / 2)
            .max(1);
        let chains = chains::link(&self.spots, image.width_px, shortest);
        let contested = chains.iter().enumerate().any(|(i, a)| {
            chains
                .iter()
                .skip(i + 1)
                .any(|b| shared(a, b) > SHARED_COLUMNS)
        });
        if !contested {
            return;
        }
        // A clipped stripe must not look like an evenly lit bar.
        let links = chains.iter().flat_map(|chain| &chain.links);
        let pile = ceiling::pile(image, links.map(|l| (l.0, l.2)), noise_sd);
        let highest = self.config.saturation_level;
        let ceiling = pile.map_or(highest, |pile| pile.level.min(highest));
        let looks: Vec<Option<Look>> = chains
            .iter()
            .map(|chain| self.look(image, chain, noise_sd, ceiling))
            .collect();
        let line = best_line(&chains, &looks, image.width_px);
        if line.is_empty() {
            return;
        }
        let of_line = |width: fn(&Look) -> f64| {
            let values = line.iter().filter_map(|i| looks[*i].as_ref().map(width));
            median(values.collect())
        };
        let (sigma_px, best) = (of_line(|l| l.sigma_px), of_line(|l| l.weight));
        for (index, chain) in chains.iter().enumerate() {
            if line.contains(&index) {
                continue;
            }
            let covered: usize = line.iter().map(|i| shared(&chains[*i], chain)).sum();
            // Alone in its columns it may be the stripe on darker ground: then it looks like it.
            let unlike = looks[index].is_none_or(|look| {
                ratio(look.sigma_px, sigma_px) > WIDTH_RATIO || look.weight < 0.25 * best
            });
            if unlike || 2 * covered > chain.links.len() {
                for (column, spot, _) in &chain.links {
                    self.spots.rule_out(*column, *spot);
                }
            }
        }
    }

    /// Fits a chain in some of its columns; `None` where it has no profile of a beam.
    fn look(
        &mut self,
        image: GreyView<'_>,
        chain: &Chain,
        noise_sd: f64,
        ceiling: u8,
    ) -> Option<Look> {
        let every = chain.links.len().div_ceil(SAMPLES).max(1);
        let mut window = Window::new();
        let mut widths = Vec::with_capacity(SAMPLES);
        let middle = every / 2;
        let samples = || chain.links.iter().skip(middle).step_by(every);
        for &(column, _, row_px) in samples() {
            window.load(image, column, f64::from(row_px), WIDTH_ROWS);
            if let Some((_, sigma)) = fit::edges(&window, f64::from(row_px), ceiling) {
                widths.push(sigma);
            }
        }
        let tried = samples().count();
        let mut width = median(widths);
        let (mut peaks, mut misfits) = (Vec::new(), Vec::new());
        // Twice: with the width from the edges, then with the width fitted.
        for _ in 0..2 {
            if !(SIGMA_MIN_PX..SIGMA_MAX_PX).contains(&width) {
                return None;
            }
            peaks.clear();
            misfits.clear();
            let mut fitted = Vec::with_capacity(SAMPLES);
            let index = self.kernels.index(width);
            let kernel = self.kernels.get(index);
            let known = Known::clipping_at(ceiling);
            for &(column, _, row_px) in samples() {
                let row_px = f64::from(row_px);
                window.load(image, column, row_px, fit::rows_needed(kernel));
                let clipped = window.clipped(ceiling);
                let start = match clipped
                    .then(|| fit::edges(&window, row_px, ceiling))
                    .flatten()
                {
                    Some((centre, _)) => centre,
                    None => fit::brightest(&window, row_px),
                };
                if let Some(fit) = fit::fit(&window, kernel, start, known) {
                    let ceiling_level = f64::from(ceiling).max(1.0);
                    let over = (fit.peak / (MAX_OVER_CEILING * ceiling_level)).max(1.0);
                    let unexplained = (fit.variance - noise_sd * noise_sd).max(0.0).sqrt();
                    fitted.push(fit.sigma_px * over);
                    peaks.push(fit.peak.min(ceiling_level));
                    misfits.push(unexplained / fit.peak.min(ceiling_level) * over);
                }
            }
            width = median(fitted);
        }
        let peak = median(peaks.clone());
        if peak.is_nan()
            || peak < self.config.min_peak
            || !(SIGMA_MIN_PX * 0.5..SIGMA_MAX_PX).contains(&width)
        {
            return None;
        }
        let share = peaks.len() as f64 / tried.max(1) as f64;
        let off = median(misfits) / MISFIT;
        Some(Look {
            sigma_px: width,
            peak,
            weight: share * peak.sqrt() / (width.max(SIGMA_MIN_PX) * (1.0 + off * off)),
        })
    }
}

/// Chains that make up the line with the most evidence.
fn best_line(chains: &[Chain], looks: &[Option<Look>], columns: usize) -> Vec<usize> {
    let worth = |i: &usize| {
        let look = looks.get(*i).copied().flatten();
        look.map_or(0.0, |l| l.weight * chains[*i].links.len() as f64)
    };
    let mut order: Vec<usize> = (0..chains.len()).filter(|i| worth(i) > 0.0).collect();
    order.sort_by(|a, b| worth(b).total_cmp(&worth(a)));
    let mut best = (0.0, Vec::new());
    for &first in order.iter().take(MAX_LINES) {
        let Some(like) = looks[first] else { continue };
        let mut line = vec![first];
        for &other in &order {
            let alike = looks[other].is_some_and(|look| {
                ratio(look.sigma_px, like.sigma_px) < WIDTH_RATIO
                    && ratio(look.peak, like.peak) < PEAK_RATIO
            });
            let free = |i: &usize| shared(&chains[*i], &chains[other]) <= SHARED_COLUMNS;
            if alike && other != first && line.iter().all(free) {
                line.push(other);
            }
        }
        let covered: usize = line.iter().map(|i| chains[*i].links.len()).sum();
        // Covered columns count twice: a line that goes through is preferred.
        let value = line.iter().map(worth).sum::<f64>() * covered as f64 / columns.max(1) as f64;
        if value > best.0 {
            best = (value, line);
        }
    }
    best.1
}

/// Columns that both chains span.
fn shared(a: &Chain, b: &Chain) -> usize {
    (a.last().min(b.last()) + 1).saturating_sub(a.first().max(b.first()))
}

fn ratio(a: f64, b: f64) -> f64 {
    (a / b).max(b / a)
}

/// Middle value; NaN of none.
fn median(mut values: Vec<f64>) -> f64 {
    if values.is_empty() {
        return f64::NAN;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}
