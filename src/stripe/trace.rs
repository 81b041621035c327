//! Following the stripe: path, first fit, pooled width, haze, second fit.

use super::extractor::{Extractor, Track};
use super::fit::{self, Fit, HazeShape, Known, WidthPrior, Window};
use super::haze::Haze;
use super::kernel::{SIGMA_MAX_PX, SIGMA_MIN_PX, profile};
use super::{ceiling, path, segments};
use hydroline_core::frame::GreyView;

/// Columns read ahead of their fits; [`predicted`] reaches back as far.
const COLUMNS_AHEAD: usize = 4;
/// Of so many groups of [`COLUMNS_AHEAD`] clipped columns one is fitted twice, the rest once.
const CLIPPED_GROUPS: usize = 3;
/// Columns from which the first idea of the stripe's width is taken.
const WIDTH_SAMPLES: usize = 25;
/// Rows loaded for it.
pub(super) const WIDTH_ROWS: usize = 64;
/// Mismatch of a kernel's width that is not worth a second fit: it costs 0.4 % of the bound.
const WIDTH_TOLERANCE: f64 = 0.05;
/// How well a column's width is known from its neighbours', relative.
const POOLED_WIDTH_SD: f64 = 0.03;
/// How well it is known from the first look, relative, and the height that stands for a clipped
/// stripe's before it is known \[grey levels\].
const FIRST_WIDTH_SD: f64 = 0.15;
const CLIPPED_PEAK: f64 = 400.0;

/// Distance from which another line leaves the surroundings of the stripe alone \[px\].
const FAR_PX: f64 = 80.0;
/// By how much of the ceiling, and by how many sds, the flanks must rise above it where the pile
/// alone proves nothing: a lens distorts a Gaussian's flanks by a hundredth.
const CEILING_EXCESS: f64 = 0.02;
const CEILING_SIGNIFICANCE: f64 = 4.0;

impl Extractor {
    /// Path, first fit, haze and second fit. Leaves the columns in `tracks`; says what haze there is
    /// and whether the light beside the stripe is restless.
    pub(super) fn follow(&mut self, image: GreyView<'_>, noise_sd: f64) -> (Option<Haze>, bool) {
        let step_cost = self.config.step_cost_columns as f32;
        self.rule_out_other_lines(image, noise_sd);
        self.tracks.clear();
        let mut chosen: Vec<(usize, usize)> = Vec::with_capacity(image.width_px);
        let path = path::choose(&self.spots, image.width_px, step_cost, &mut self.path);
        chosen.extend(
            path.enumerate()
                .filter_map(|(column, spot)| Some((column, spot?))),
        );
        let mut window = Window::new();
        let width = self.find_ceiling_and_width(image, &chosen, noise_sd, &mut window);
        let saturation = self.ceiling;
        let index = self.kernels.index(width);
        let kernel = self.kernels.get(index);
        let rows = fit::rows_needed(kernel);
        let first_sigma_px = kernel.sigma_px;
        let prior = width_prior(width, noise_sd, CLIPPED_PEAK, FIRST_WIDTH_SD);
        let known = Known {
            width: Some(prior),
            first: true,
            ..Known::clipping_at(saturation)
        };
        let mut ahead = [(); COLUMNS_AHEAD].map(|()| Window::new());
        let mut near = [None; COLUMNS_AHEAD];
        for (number, group) in chosen.chunks(COLUMNS_AHEAD).enumerate() {
            // Pixels first, fits after: a vector load right behind the byte-wise stores it
            // covers would wait for them.
            for (&(column, spot), near) in group.iter().zip(&mut near) {
                let row_px = f64::from(self.spots.column(column)[spot].row_px);
                *near = predicted(&self.tracks, column).filter(|p| (p - row_px).abs() < 2.0);
            }
            let near_rows = fit::rows_near(kernel);
            if !load_group(&mut ahead, image, group, near, near_rows) {
                for ((&(column, spot), window), near) in group.iter().zip(&mut ahead).zip(near) {
                    let row_px = f64::from(self.spots.column(column)[spot].row_px);
                    match near {
                        Some(row_px) => window.load(image, column, row_px, near_rows),
                        None => window.load(image, column, row_px, rows),
                    }
                }
            }
            for ((&(column, spot), window), near) in group.iter().zip(&mut ahead).zip(&near) {
                let row_px = f64::from(self.spots.column(column)[spot].row_px);
                let mut found = near
                    .filter(|_| number % CLIPPED_GROUPS != 0)
                    .and_then(|near| like_the_last(&self.tracks, near))
                    .filter(|_| window.clipped(saturation))
                    .or_else(|| near.and_then(|near| fit::fit(window, kernel, near, known)));
                if found.is_none() {
                    if near.is_some() {
                        window.load(image, column, row_px, rows);
                    }
                    // The coarse row of a clipped plateau may be off by pixels; its edges are not.
                    let start = if window.clipped(saturation) {
                        fit::edges(window, row_px, saturation).map_or(row_px, |(centre, _)| centre)
                    } else {
                        fit::brightest(window, row_px)
                    };
                    found = fit::fit(window, kernel, start, known);
                }
                if let Some(fit) = found
                    && fit.peak >= 0.5 * self.config.min_peak
                {
                    self.tracks.push(Track {
                        column,
                        spot,
                        fit,
                        near_step: false,
                    });
                }
            }
        }
        self.cut_into_stretches(image.width_px);
        self.pool_widths(width);
        let (haze, restless) = self.find_haze(image, noise_sd);
        self.refit(image, haze, &mut window, noise_sd, first_sigma_px);
        (haze, restless)
    }

    /// The level at which this frame clips, left in `ceiling`, and the first idea of the width \[px\].
    fn find_ceiling_and_width(
        &mut self,
        image: GreyView<'_>,
        chosen: &[(usize, usize)],
        noise_sd: f64,
        window: &mut Window,
    ) -> f64 {
        self.ceiling = self.config.saturation_level;
        let places: Vec<(usize, f32)> = chosen
            .iter()
            .map(|&(column, spot)| (column, self.spots.column(column)[spot].row_px))
            .collect();
        let pile = ceiling::pile(image, places.iter().copied(), noise_sd);
        let Some(pile) = pile.filter(|pile| pile.level < self.ceiling) else {
            return self.first_width(image, chosen, window);
        };
        self.ceiling = pile.level;
        let width = self.first_width(image, chosen, window);
        if pile.certain || self.flanks_rise_above(image, &places, width, noise_sd, window) {
            return width;
        }
        self.ceiling = self.config.saturation_level;
        self.first_width(image, chosen, window)
    }

    /// Whether the flanks of columns that reach the ceiling imply light above it.
    fn flanks_rise_above(
        &mut self,
        image: GreyView<'_>,
        places: &[(usize, f32)],
        width_px: f64,
        noise_sd: f64,
        window: &mut Window,
    ) -> bool {
        let ceiling = self.ceiling;
        let index = self.kernels.index(width_px);
        let kernel = self.kernels.get(index);
        let known = Known {
            width: Some(width_prior(
                width_px,
                noise_sd,
                f64::from(ceiling),
                FIRST_WIDTH_SD,
            )),
            ..Known::clipping_at(ceiling)
        };
        let reach = |place: &&(usize, f32)| ceiling::brightest(image, place.0, place.1) >= ceiling;
        let every = places
            .iter()
            .filter(reach)
            .count()
            .div_ceil(WIDTH_SAMPLES)
            .max(1);
        let mut excess = (0.0, 0.0, 0.0);
        for &(column, row_px) in places.iter().filter(reach).step_by(every) {
            let row_px = f64::from(row_px);
            window.load(image, column, row_px, fit::rows_needed(kernel));
            let start = fit::edges(window, row_px, ceiling).map_or(row_px, |(centre, _)| centre);
            if let Some(fit) = fit::fit(window, kernel, start, known) {
                // Extrapolated from the flanks to the pixel nearest to the centre.
                let nearest = fit.row_px.round() - fit.row_px;
                let light = fit.background + fit.peak * profile(nearest, fit.sigma_px)[0];
                let above = light - f64::from(ceiling);
                excess = (excess.0 + 1.0, excess.1 + above, excess.2 + above * above);
            }
        }
        let (count, sum, square) = excess;
        if count < 4.0 {
            return false;
        }
        let mean = sum / count;
        let error = ((square / count - mean * mean).max(0.0) / count).sqrt();
        mean > CEILING_EXCESS * f64::from(ceiling) && mean > CEILING_SIGNIFICANCE * error
    }

    /// Median width over a sample of columns, from the stripe's edges \[px\].
    fn first_width(
        &mut self,
        image: GreyView<'_>,
        chosen: &[(usize, usize)],
        window: &mut Window,
    ) -> f64 {
        let saturation = self.ceiling;
        let every = chosen.len().div_ceil(WIDTH_SAMPLES).max(1);
        self.order.clear();
        for &(column, spot) in chosen.iter().step_by(every) {
            let row_px = f64::from(self.spots.column(column)[spot].row_px);
            window.load(image, column, row_px, WIDTH_ROWS);
            if let Some((_, sigma)) = fit::edges(window, row_px, saturation) {
                self.order.push(sigma);
            }
        }
        // Edges give the width to a tenth; the same columns, fitted, give it to a hundredth.
        let width = self.median_width(2.0);
        let index = self.kernels.index(width);
        let kernel = self.kernels.get(index);
        self.order.clear();
        for &(column, spot) in chosen.iter().step_by(every) {
            let row_px = f64::from(self.spots.column(column)[spot].row_px);
            window.load(image, column, row_px, fit::rows_needed(kernel));
            if !window.clipped(saturation)
                && let Some(fit) = fit::fit(
                    window,
                    kernel,
                    fit::brightest(window, row_px),
                    Known::clipping_at(saturation),
                )
            {
                self.order.push(fit.sigma_px);
            }
        }
        self.median_width(width)
    }

    /// Median of `order`, within what kernels there are \[px\].
    fn median_width(&mut self, fallback: f64) -> f64 {
        if self.order.is_empty() {
            return fallback;
        }
        let middle = self.order.len() / 2;
        let (_, median, _) = self.order.select_nth_unstable_by(middle, f64::total_cmp);
        median.clamp(SIGMA_MIN_PX, SIGMA_MAX_PX)
    }

    /// Drops stretches too short to be a stripe and marks columns near a step or an end.
    fn cut_into_stretches(&mut self, columns: usize) {
        let places = |t: &Track| (t.column, t.fit.row_px);
        segments::split(self.tracks.iter().map(places), &mut self.stretches);
        let shortest = self.config.min_stretch_columns.min(columns / 2);
        if self.stretches.iter().any(|s| s.len() < shortest) {
            let mut kept = self
                .stretches
                .iter()
                .flat_map(|s| s.clone().map(|_| s.len() >= shortest));
            self.tracks.retain(|_| kept.next().unwrap_or(false));
            segments::split(self.tracks.iter().map(places), &mut self.stretches);
        }
        self.mark_ends(columns);
    }

    /// Marks the columns near the ends of each stretch.
    pub(super) fn mark_ends(&mut self, columns: usize) {
        let reach = self.config.step_reach_columns;
        for stretch in &self.stretches {
            let tracks = &mut self.tracks[stretch.clone()];
            let (Some(first), Some(last)) = (tracks.first(), tracks.last()) else {
                continue;
            };
            let (first, last) = (first.column, last.column);
            for t in tracks {
                // The frame's own edge cuts no profile.
                t.near_step |= (first > 0 && t.column < first + reach)
                    || (last + 1 < columns && t.column + reach > last);
            }
        }
    }

    fn pool_widths(&mut self, fallback: f64) {
        let tracks = &self.tracks;
        let plausible = |i: usize| {
            let Track { fit, near_step, .. } = &tracks[i];
            (!near_step && fit.sigma_px > 0.4 * fallback && fit.sigma_px < 2.5 * fallback)
                .then_some([fit.sigma_px, fit.peak])
        };
        segments::pooled(
            &self.stretches,
            self.config.pool_reach_columns,
            [fallback, 0.0],
            plausible,
            &mut self.shape_sums,
            &mut self.pooled_shape,
        );
    }

    /// The haze, and whether the light beside the stripe is more restless than noise and haze.
    fn find_haze(&self, image: GreyView<'_>, noise_sd: f64) -> (Option<Haze>, bool) {
        let alone = |t: &&Track| {
            // Spots that are ruled out and far away leave the stripe's surroundings alone.
            let spots = self.spots.column(t.column);
            let others = spots
                .iter()
                .filter(|s| s.contrast > 0 || (f64::from(s.row_px) - t.fit.row_px).abs() < FAR_PX);
            spots.len() == 1 || others.count() <= 1
        };
        let clean: Vec<(usize, &Fit)> = self
            .tracks
            .iter()
            .filter(|t| !t.near_step)
            .filter(alone)
            .map(|t| (t.column, &t.fit))
            .collect();
        let (haze, restless) = self.haze.estimate(image, &clean, noise_sd);
        (haze.filter(|_| self.config.correct_haze), restless)
    }

    /// Second fit with each region's own width and the haze taken out.
    fn refit(
        &mut self,
        image: GreyView<'_>,
        haze: Option<Haze>,
        window: &mut Window,
        noise_sd: f64,
        first_sigma_px: f64,
    ) {
        let saturation = self.ceiling;
        let mut shapes: Vec<(usize, HazeShape)> = Vec::new();
        let mut windows = [(); COLUMNS_AHEAD].map(|()| Window::new());
        let mut kept = 0;
        let tolerance_px = WIDTH_TOLERANCE * first_sigma_px;
        // With nothing new known, a second fit would only repeat the first.
        let again = |track: &Track, pooled: &[f64; 2]| {
            haze.is_some()
                || track.fit.saturated
                || (pooled[0] - first_sigma_px).abs() >= tolerance_px
        };
        // Neighbours share their pooled width, and with it the kernel.
        let mut known_index = (f64::NAN, 0);
        for start in (0..self.tracks.len()).step_by(COLUMNS_AHEAD) {
            let group = start..(start + COLUMNS_AHEAD).min(self.tracks.len());
            let mut news = self.tracks[group.clone()]
                .iter()
                .zip(&self.pooled_shape[group.clone()]);
            if !news.any(|(track, pooled)| again(track, pooled)) {
                for i in group {
                    let fit = self.tracks[i].fit;
                    kept = self.keep(kept, i, fit, noise_sd);
                }
                continue;
            }
            let mut places = [(0, 0); COLUMNS_AHEAD];
            let mut near = [None; COLUMNS_AHEAD];
            let mut widest = 0.0f64;
            for (k, i) in group.clone().enumerate() {
                let (track, pooled) = (&self.tracks[i], &self.pooled_shape[i]);
                places[k] = (track.column, 0);
                near[k] = again(track, pooled).then_some(track.fit.row_px);
                widest = widest.max(pooled[0]);
            }
            let together = near[0].is_some() && {
                if known_index.0 != widest {
                    known_index = (widest, self.kernels.index(widest));
                }
                let rows = fit::rows_near(self.kernels.get(known_index.1));
                load_group(&mut windows, image, &places[..group.len()], near, rows)
            };
            for (k, i) in group.enumerate() {
                let track = self.tracks[i];
                if near[k].is_none() {
                    kept = self.keep(kept, i, track.fit, noise_sd);
                    continue;
                }
                let width_px = self.pooled_shape[i][0];
                if known_index.0 != width_px {
                    known_index = (width_px, self.kernels.index(width_px));
                }
                let index = known_index.1;
                let kernel = self.kernels.get(index);
                let shape = haze.map(|h| match shapes.iter().position(|s| s.0 == index) {
                    Some(found) => found,
                    None => {
                        shapes.push((index, h.shape(kernel)));
                        shapes.len() - 1
                    }
                });
                let shape = shape
                    .zip(haze)
                    .map(|(s, h)| (&shapes[s].1, h.fraction as f32));
                let known = Known {
                    saturation,
                    haze: shape,
                    width: Some(width_prior(
                        width_px,
                        noise_sd,
                        track.fit.peak,
                        POOLED_WIDTH_SD,
                    )),
                    first: false,
                };
                let (column, row_px) = (track.column, track.fit.row_px);
                let mut found = None;
                if together {
                    found = fit::fit(&windows[k], kernel, row_px, known);
                }
                if found.is_none() {
                    window.load(image, column, row_px, fit::rows_needed(kernel));
                    found = fit::fit(window, kernel, row_px, known);
                }
                if let Some(fit) = found {
                    kept = self.keep(kept, i, fit, noise_sd);
                }
            }
        }
        self.tracks.truncate(kept);
        self.pooled_shape.truncate(kept);
    }

    /// Moves track `i` with its final fit to place `kept` if it looks like a stripe; returns the
    /// next place.
    fn keep(&mut self, kept: usize, i: usize, fit: Fit, noise_sd: f64) -> usize {
        if !self.is_stripe(&fit, self.pooled_shape[i][0]) {
            return kept;
        }
        // A profile cut by a step, or two on top of each other: too low, or of another width
        // (whose sd is about that of the row).
        let off = (fit.sigma_px - self.pooled_shape[i][0]).abs();
        let cut = !fit.saturated
            && (fit.peak < 0.75 * self.pooled_shape[i][1]
                || off > 0.06 * fit.sigma_px && {
                    let noise = fit.variance.sqrt().min(2.0 * noise_sd);
                    off > 4.5 * noise * fit.row_variance.sqrt() / fit.peak
                });
        if kept != i {
            self.tracks[kept] = self.tracks[i];
            self.pooled_shape[kept] = self.pooled_shape[i];
        }
        let track = &mut self.tracks[kept];
        track.fit = fit;
        track.near_step |= cut;
        kept + 1
    }

    /// Whether a fit looks like a stripe: high enough, about as wide as its neighbours, and
    /// explained by the model to a sixth of its height.
    fn is_stripe(&self, fit: &Fit, sigma_px: f64) -> bool {
        let misfit = (0.15 * fit.peak.min(255.0)).max(0.3 * self.config.min_peak);
        fit.peak >= self.config.min_peak
            && fit.sigma_px > 0.4 * sigma_px
            && fit.sigma_px < 2.5 * sigma_px
            && fit.variance < misfit * misfit
    }
}

/// Row of the stripe in `column` from its course four to twelve columns before: not nearer, so
/// that columns do not wait for each other. `None` where the course is not unbroken.
fn predicted(tracks: &[Track], column: usize) -> Option<f64> {
    let last = tracks.last()?.column;
    let at = |back: usize| {
        // Without gaps the track `back` columns before stands this far from the end.
        let place = tracks
            .len()
            .checked_sub((last + back + 1).checked_sub(column)?)?;
        tracks
            .get(place)
            .filter(|t| t.column + back == column)
            .map(|t| t.fit.row_px)
    };
    let (near, far) = (at(COLUMNS_AHEAD)?, at(3 * COLUMNS_AHEAD)?);
    let course = near - far;
    (course.abs() < 16.0).then_some(near + 0.5 * course)
}

/// Stands in for the first fit of a clipped column, which only finds a region's width and is
/// costly: what was found four columns before, at this row, if that was clipped too.
fn like_the_last(tracks: &[Track], row_px: f64) -> Option<Fit> {
    let place = tracks.len().checked_sub(COLUMNS_AHEAD)?;
    let fit = tracks.get(place)?.fit;
    fit.saturated.then_some(Fit { row_px, ..fit })
}

/// Loads a whole group of neighbouring columns at once, if it is one and every row is known.
#[inline]
fn load_group(
    windows: &mut [Window; COLUMNS_AHEAD],
    image: GreyView<'_>,
    group: &[(usize, usize)],
    near: [Option<f64>; COLUMNS_AHEAD],
    rows: usize,
) -> bool {
    let (Some(&(first, _)), Some(&(last, _))) = (group.first(), group.last()) else {
        return false;
    };
    if group.len() != COLUMNS_AHEAD || last - first + 1 != COLUMNS_AHEAD {
        return false;
    }
    let [Some(a), Some(b), Some(c), Some(d)] = near else {
        return false;
    };
    Window::load_together(windows, image, first, [a, b, c, d], rows)
}

fn width_prior(sigma_px: f64, noise_sd: f64, peak: f64, relative_sd: f64) -> WidthPrior {
    WidthPrior {
        sigma_px,
        weight: (noise_sd / (peak * relative_sd * sigma_px)).powi(2),
    }
}
