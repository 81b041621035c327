//! The whole way from a grey frame to its profile.

use super::band::{Band, MIN_SHARE_FOUND, RIVAL_REACH_PX};
use super::clipped::GaussTable;
use super::coarse::{self, BLOCK_ROWS, CoarseScratch, Spots, Tile};
use super::fit::{self, Fit, HazeShape, Known, WidthPrior, Window};
use super::haze::{Haze, HazeTable};
use super::kernel::{KernelTable, SIGMA_MAX_PX, SIGMA_MIN_PX};
use super::path::{self, PathScratch};
use super::{ExtractorConfig, Profile, ProfileFault, StripePoint, noise, quality, segments};
use crate::frame::GreyImage;
use std::ops::Range;

/// Fewest rows in which a stripe and its background fit.
const MIN_ROWS: usize = 16;
/// Columns read ahead of their fits; [`predicted`] reaches back as far.
const COLUMNS_AHEAD: usize = 4;
/// Columns from which the first idea of the stripe's width is taken.
const WIDTH_SAMPLES: usize = 49;
/// Rows loaded for it.
const WIDTH_ROWS: usize = 64;
/// Mismatch of a kernel's width that is not worth a second fit: it costs 0.4 % of the bound.
const WIDTH_TOLERANCE: f64 = 0.05;
/// How well a column's width is known from its neighbours', relative.
const POOLED_WIDTH_SD: f64 = 0.03;
/// How well it is known from the first look, relative, and the height that stands for a clipped
/// stripe's before it is known \[grey levels\].
const FIRST_WIDTH_SD: f64 = 0.15;
const CLIPPED_PEAK: f64 = 400.0;

/// Extracts stripes, one frame at a time, on the caller's thread. Keeps scratch memory between
/// frames and nothing that changes a result.
#[derive(Debug, Clone)]
pub struct Extractor {
    config: ExtractorConfig,
    kernels: KernelTable,
    gauss: GaussTable,
    haze: HazeTable,
    coarse: CoarseScratch,
    spots: Spots,
    path: PathScratch,
    tracks: Vec<Track>,
    stretches: Vec<Range<usize>>,
    pooled_sigma: Vec<f64>,
    pooled_peak: Vec<f64>,
    pooled_variance: Vec<f64>,
    order: Vec<f64>,
}

/// One column on its way.
#[derive(Debug, Clone, Copy)]
struct Track {
    column: usize,
    spot: usize,
    fit: Fit,
    near_step: bool,
}

impl Extractor {
    /// An extractor with these settings.
    pub fn new(config: ExtractorConfig) -> Self {
        Self {
            config,
            kernels: KernelTable::new(),
            gauss: GaussTable::new(),
            haze: HazeTable::new(),
            coarse: CoarseScratch::default(),
            spots: Spots::default(),
            path: PathScratch::default(),
            tracks: Vec::new(),
            stretches: Vec::new(),
            pooled_sigma: Vec::new(),
            pooled_peak: Vec::new(),
            pooled_variance: Vec::new(),
            order: Vec::new(),
        }
    }

    /// The settings.
    pub fn config(&self) -> &ExtractorConfig {
        &self.config
    }

    /// Extracts the stripe of a frame about which nothing is known.
    pub fn extract(&mut self, image: &GreyImage) -> Profile {
        match self.check(image) {
            Some(fault) => faulty(image, fault),
            None => self.extract_tiles(image, None),
        }
    }

    /// Extracts the stripe where it lay in an earlier frame: the points of [`Self::extract`],
    /// sooner. Where that cannot be promised — the band is of another image size, fewer than
    /// 90 % of its points are found again, or a point lies within 24 px of its border — the
    /// whole frame is searched. `candidates` lists those inside the band only; a second stripe
    /// that lies outside the band as a whole and would win over the one inside is not seen.
    pub fn extract_in_band(&mut self, image: &GreyImage, band: &Band) -> Profile {
        if let Some(fault) = self.check(image) {
            return faulty(image, fault);
        }
        if band.size_px() == (image.width_px, image.height_px) {
            let profile = self.extract_tiles(image, Some(band));
            let enough = profile.points.len() as f64 >= MIN_SHARE_FOUND * band.points() as f64;
            if enough
                && profile
                    .points
                    .iter()
                    .all(|p| band.holds(p.column_px as usize, p.row_px))
            {
                return profile;
            }
        }
        self.extract_tiles(image, None)
    }

    fn check(&self, image: &GreyImage) -> Option<ProfileFault> {
        let (width_px, height_px) = (image.width_px, image.height_px);
        let needed = width_px.saturating_mul(height_px);
        let got = image.pixels.len();
        if needed != got {
            return Some(ProfileFault::Malformed {
                width_px,
                height_px,
                needed,
                got,
            });
        }
        let min_columns = self.config.min_columns.max(1);
        (width_px < min_columns || height_px < MIN_ROWS).then_some(ProfileFault::TooSmall {
            width_px,
            height_px,
            min_columns,
            min_rows: MIN_ROWS,
        })
    }

    fn extract_tiles(&mut self, image: &GreyImage, band: Option<&Band>) -> Profile {
        let noise_sd = noise::noise_sd(image);
        let spotted = self.find_spots(image, band, noise_sd);
        if spotted == 0 {
            let sum: u64 = image.pixels.iter().map(|p| u64::from(*p)).sum();
            let mean_level = sum as f64 / image.pixels.len().max(1) as f64;
            return Profile {
                noise_sd,
                ..faulty(
                    image,
                    ProfileFault::Dark {
                        noise_sd,
                        mean_level,
                    },
                )
            };
        }
        let haze = self.follow(image, noise_sd);
        let mut profile = Profile {
            noise_sd,
            size_px: (image.width_px, image.height_px),
            ..Default::default()
        };
        if let Some(haze) = haze {
            profile.haze_level = haze.fraction;
            profile.haze_length_px = haze.length_px;
        }
        self.report(image, haze, &mut profile);
        let found = profile.points.len();
        if found < self.config.min_columns.max(1) {
            profile.points.clear();
            profile.fault = Some(ProfileFault::TooFewColumns {
                spotted,
                found,
                needed: self.config.min_columns,
            });
        }
        profile
    }

    /// Candidates of all columns; returns the number of columns that have one.
    fn find_spots(&mut self, image: &GreyImage, band: Option<&Band>, noise_sd: f64) -> usize {
        let threshold = coarse::threshold(noise_sd);
        self.spots.clear(image.width_px);
        match band {
            None => {
                let last = image.height_px / BLOCK_ROWS - 1;
                let tile = Tile {
                    from: 0,
                    to: image.width_px,
                    first: 0,
                    last,
                };
                coarse::search(image, tile, threshold, &mut self.coarse, &mut self.spots);
            }
            Some(band) => {
                for tile in band.tiles() {
                    coarse::search(image, tile, threshold, &mut self.coarse, &mut self.spots);
                }
            }
        }
        (0..image.width_px)
            .filter(|c| !self.spots.column(*c).is_empty())
            .count()
    }

    /// Path, first fit, haze and second fit. Leaves the columns in `tracks`.
    fn follow(&mut self, image: &GreyImage, noise_sd: f64) -> Option<Haze> {
        let saturation = self.config.saturation_level;
        let step_cost = self.config.step_cost_columns as f32;
        self.tracks.clear();
        let mut chosen: Vec<(usize, usize)> = Vec::with_capacity(image.width_px);
        let path = path::choose(&self.spots, image.width_px, step_cost, &mut self.path);
        chosen.extend(
            path.enumerate()
                .filter_map(|(column, spot)| Some((column, spot?))),
        );
        let mut window = Window::new();
        let width = self.first_width(image, &chosen, &mut window);
        let index = self.kernels.index(width);
        let kernel = self.kernels.get(index);
        let rows = fit::rows_needed(kernel);
        let first_sigma_px = kernel.sigma_px;
        let prior = width_prior(width, noise_sd, CLIPPED_PEAK, FIRST_WIDTH_SD);
        let known = Known {
            width: Some(prior),
            ..Known::clipping_at(saturation)
        };
        let mut ahead = [(); COLUMNS_AHEAD].map(|()| Window::new());
        let mut near = [None; COLUMNS_AHEAD];
        for group in chosen.chunks(COLUMNS_AHEAD) {
            // Pixels first, fits after: a vector load right behind the byte-wise stores it
            // covers would wait for them.
            for ((&(column, spot), window), near) in group.iter().zip(&mut ahead).zip(&mut near) {
                let row_px = f64::from(self.spots.column(column)[spot].row_px);
                *near = predicted(&self.tracks, column).filter(|p| (p - row_px).abs() < 2.0);
                match *near {
                    Some(row_px) => window.load(image, column, row_px, fit::rows_near(kernel)),
                    None => window.load(image, column, row_px, rows),
                }
            }
            for ((&(column, spot), window), near) in group.iter().zip(&mut ahead).zip(&near) {
                let row_px = f64::from(self.spots.column(column)[spot].row_px);
                let mut found = None;
                if let Some(near) = near
                    && !window.clipped(saturation)
                {
                    found = fit::fit(window, kernel, &self.gauss, *near, known);
                }
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
                    found = fit::fit(window, kernel, &self.gauss, start, known);
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
        let haze = self.find_haze(image, noise_sd);
        self.refit(image, haze, &mut window, noise_sd, first_sigma_px);
        haze
    }

    /// Median width over a sample of columns, from the stripe's edges \[px\].
    fn first_width(
        &mut self,
        image: &GreyImage,
        chosen: &[(usize, usize)],
        window: &mut Window,
    ) -> f64 {
        let saturation = self.config.saturation_level;
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
                    &self.gauss,
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
    fn mark_ends(&mut self, columns: usize) {
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
            let fit = tracks[i].fit;
            (!tracks[i].near_step && fit.sigma_px > 0.4 * fallback && fit.sigma_px < 2.5 * fallback)
                .then_some(fit)
        };
        let reach = self.config.pool_reach_columns;
        let sigma = |i: usize| plausible(i).map(|f| f.sigma_px);
        segments::pooled(
            &self.stretches,
            reach,
            fallback,
            sigma,
            &mut self.pooled_sigma,
        );
        segments::pooled(
            &self.stretches,
            reach,
            0.0,
            |i| plausible(i).map(|f| f.peak),
            &mut self.pooled_peak,
        );
    }

    fn find_haze(&self, image: &GreyImage, noise_sd: f64) -> Option<Haze> {
        if !self.config.correct_haze {
            return None;
        }
        let clean: Vec<(usize, &Fit)> = self
            .tracks
            .iter()
            .filter(|t| !t.near_step && self.spots.column(t.column).len() == 1)
            .map(|t| (t.column, &t.fit))
            .collect();
        self.haze.estimate(image, &clean, noise_sd)
    }

    /// Second fit with each region's own width and the haze taken out.
    fn refit(
        &mut self,
        image: &GreyImage,
        haze: Option<Haze>,
        window: &mut Window,
        noise_sd: f64,
        first_sigma_px: f64,
    ) {
        let saturation = self.config.saturation_level;
        let mut shapes: Vec<(usize, HazeShape)> = Vec::new();
        let mut kept = 0;
        for i in 0..self.tracks.len() {
            let track = self.tracks[i];
            let mismatch = (self.pooled_sigma[i] / first_sigma_px - 1.0).abs();
            // With nothing new to tell it, a second fit would only repeat the first.
            if haze.is_none() && !track.fit.saturated && mismatch < WIDTH_TOLERANCE {
                kept = self.keep(kept, i, track.fit, noise_sd);
                continue;
            }
            let index = self.kernels.index(self.pooled_sigma[i]);
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
            window.load(
                image,
                track.column,
                track.fit.row_px,
                fit::rows_needed(kernel),
            );
            let width = width_prior(
                self.pooled_sigma[i],
                noise_sd,
                track.fit.peak,
                POOLED_WIDTH_SD,
            );
            let known = Known {
                saturation,
                haze: shape,
                width: Some(width),
            };
            if let Some(fit) = fit::fit(window, kernel, &self.gauss, track.fit.row_px, known) {
                kept = self.keep(kept, i, fit, noise_sd);
            }
        }
        self.tracks.truncate(kept);
        self.pooled_sigma.truncate(kept);
    }

    /// Moves track `i` with its final fit to place `kept` if it looks like a stripe; returns the
    /// next place.
    fn keep(&mut self, kept: usize, i: usize, fit: Fit, noise_sd: f64) -> usize {
        if !self.is_stripe(&fit, self.pooled_sigma[i]) {
            return kept;
        }
        // A profile cut by a step, or two on top of each other: too low, or of another width
        // (whose sd is about that of the row).
        let off = (fit.sigma_px - self.pooled_sigma[i]).abs();
        let cut = !fit.saturated
            && (fit.peak < 0.75 * self.pooled_peak[i]
                || off > 0.06 * fit.sigma_px && {
                    let noise = fit.variance.sqrt().min(2.0 * noise_sd);
                    off > 4.5 * noise * fit.row_variance.sqrt() / fit.peak
                });
        if kept != i {
            self.tracks[kept] = self.tracks[i];
            self.pooled_sigma[kept] = self.pooled_sigma[i];
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

    /// Points and rivals from the tracks.
    fn report(&mut self, image: &GreyImage, haze: Option<Haze>, profile: &mut Profile) {
        let places = |t: &Track| (t.column, t.fit.row_px);
        segments::split(self.tracks.iter().map(places), &mut self.stretches);
        // Again: fits that did not stand have left new ends.
        self.mark_ends(image.width_px);
        let reach = self.config.pool_reach_columns;
        let floor = noise::ROUNDING_SD * noise::ROUNDING_SD;
        let tracks = &self.tracks;
        let variance = |i: usize| Some(tracks[i].fit.variance);
        segments::pooled(&self.stretches, reach, floor, variance, &mut self.order);
        // Once more without columns that are far noisier than their neighbours (particles).
        let first = &self.order;
        let sound = |i: usize| Some(tracks[i].fit.variance).filter(|v| *v <= 3.0 * first[i]);
        segments::pooled(
            &self.stretches,
            reach,
            floor,
            sound,
            &mut self.pooled_variance,
        );
        let mut window = Window::new();
        profile.points.reserve(self.tracks.len());
        let mut next = 0;
        for column in 0..image.width_px {
            let track = self
                .tracks
                .get(next)
                .filter(|t| t.column == column)
                .copied();
            let index = next.min(self.tracks.len().saturating_sub(1));
            let pooled = self.pooled_variance.get(index).copied().unwrap_or(floor);
            let sigma = self.pooled_sigma.get(index).copied().unwrap_or(2.0);
            let on_path = usize::from(track.is_some());
            let rival = self.spots.column(column).len() > on_path && {
                let own = track.map(|t| (t.spot, t.fit.row_px));
                self.report_rivals(image, column, own, sigma, pooled, &mut profile.candidates)
            };
            if let Some(track) = track {
                let mut bits = 0;
                bits |= if track.fit.saturated {
                    quality::SATURATED
                } else {
                    0
                };
                bits |= if haze.is_some() {
                    quality::HAZE_CORRECTED
                } else {
                    0
                };
                bits |= if rival { quality::RIVAL } else { 0 };
                bits |= if track.near_step {
                    quality::NEAR_STEP
                } else {
                    0
                };
                let own = track.fit.variance;
                let variance = if own > 3.0 * pooled { own } else { pooled };
                let mut found = point(column, &track.fit, variance.max(floor), haze, bits);
                if self.config.whole_pixel {
                    window.load(image, column, track.fit.row_px, WIDTH_ROWS);
                    found.row_px = central_pixel(&window, &track.fit);
                    found.sd_px = noise::ROUNDING_SD;
                }
                profile.points.push(found);
                next += 1;
            }
        }
    }

    /// Adds a column's other candidates; returns whether one is near its point (spot, row).
    #[cold]
    fn report_rivals(
        &mut self,
        image: &GreyImage,
        column: usize,
        own: Option<(usize, f64)>,
        sigma_px: f64,
        variance: f64,
        out: &mut Vec<StripePoint>,
    ) -> bool {
        let known = Known::clipping_at(self.config.saturation_level);
        let index = self.kernels.index(sigma_px);
        let kernel = self.kernels.get(index);
        let mut window = Window::new();
        let mut rival = false;
        for (k, spot) in self.spots.column(column).iter().enumerate() {
            if own.is_some_and(|(spot, _)| spot == k) {
                continue;
            }
            let row_px = f64::from(spot.row_px);
            window.load(image, column, row_px, fit::rows_needed(kernel));
            let start = fit::brightest(&window, row_px);
            let Some(other) = fit::fit(&window, kernel, &self.gauss, start, known) else {
                continue;
            };
            let apart = own.map_or(f64::INFINITY, |(_, row)| (row - other.row_px).abs());
            if other.peak >= self.config.min_peak && apart >= 2.0 * sigma_px {
                rival |= apart <= RIVAL_REACH_PX;
                out.push(point(column, &other, variance.max(other.variance), None, 0));
            }
        }
        rival
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

fn width_prior(sigma_px: f64, noise_sd: f64, peak: f64, relative_sd: f64) -> WidthPrior {
    WidthPrior {
        sigma_px,
        weight: (noise_sd / (peak * relative_sd * sigma_px)).powi(2),
    }
}

fn faulty(image: &GreyImage, fault: ProfileFault) -> Profile {
    Profile {
        size_px: (image.width_px, image.height_px),
        fault: Some(fault),
        ..Default::default()
    }
}

fn point(column: usize, fit: &Fit, variance: f64, haze: Option<Haze>, quality: u32) -> StripePoint {
    // A haze level wrong by df shifts the row by about 1.7 df s / 2 (notes 2.4).
    let haze_sd = haze.map_or(0.0, |h| 0.85 * fit.sigma_px * h.fraction_sd);
    let sd_px = (variance * fit.row_variance / (fit.peak * fit.peak) + haze_sd * haze_sd).sqrt();
    StripePoint {
        column_px: column as f64,
        row_px: fit.row_px,
        peak: fit.peak,
        sd_px,
        sigma_px: fit.sigma_px,
        quality,
    }
}

/// The paper's choice: the central pixel of the stripe, here of its run at half height or more.
fn central_pixel(window: &Window, fit: &Fit) -> f64 {
    let y = window.values();
    let level = (fit.background + 0.5 * fit.peak.min(255.0 - fit.background)) as i16;
    let middle = (fit.row_px.round() as i64 - window.start()).clamp(0, y.len() as i64 - 1) as usize;
    let up = y[..=middle]
        .iter()
        .rev()
        .take_while(|v| **v >= level)
        .count()
        .max(1);
    let down = y[middle..]
        .iter()
        .take_while(|v| **v >= level)
        .count()
        .max(1);
    let (first, last) = (middle + 1 - up, middle + down - 1);
    (window.start() + ((first + last) / 2) as i64) as f64
}
