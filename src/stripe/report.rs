//! Points and rivals of a followed stripe, with their standard deviations and remarks.

use super::extractor::{Extractor, Track};
use super::fit::{self, Fit, Known, Window};
use super::haze::Haze;
use super::trace::WIDTH_ROWS;
use super::{Profile, StripePoint, noise, quality, segments};
use hydroline_core::frame::GreyView;

/// Reach within which a second candidate is a rival \[px\].
const RIVAL_REACH_PX: f64 = 24.0;

impl Extractor {
    /// Points and rivals from the tracks.
    pub(super) fn report(
        &mut self,
        image: GreyView<'_>,
        haze: Option<Haze>,
        profile: &mut Profile,
    ) {
        let places = |t: &Track| (t.column, t.fit.row_px);
        segments::split(self.tracks.iter().map(places), &mut self.stretches);
        // Again: fits that did not stand have left new ends.
        self.mark_ends(image.width_px);
        let reach = self.config.pool_reach_columns;
        let floor = noise::ROUNDING_SD * noise::ROUNDING_SD;
        let row_levels = self.row_level_sd * self.row_level_sd;
        let tracks = &self.tracks;
        segments::pooled(
            &self.stretches,
            reach,
            [floor],
            |i| Some([tracks[i].fit.variance]),
            &mut self.variance_sums,
            &mut self.first_variance,
        );
        // Once more without columns that are far noisier than their neighbours (particles).
        let first = &self.first_variance;
        segments::pooled(
            &self.stretches,
            reach,
            [floor],
            |i| Some([tracks[i].fit.variance]).filter(|[v]| *v <= 3.0 * first[i][0]),
            &mut self.variance_sums,
            &mut self.pooled_variance,
        );
        let mut window = Window::new();
        profile.points.reserve(self.tracks.len());
        let mut next = 0;
        for column in 0..image.width_px {
            let own = self
                .tracks
                .get(next)
                .filter(|t| t.column == column)
                .map(|t| (t.spot, t.fit.row_px));
            let index = next.min(self.tracks.len().saturating_sub(1));
            let pooled = self.pooled_variance.get(index).map_or(floor, |v| v[0]);
            let sigma = self.pooled_shape.get(index).map_or(2.0, |s| s[0]);
            let on_path = usize::from(own.is_some());
            let rival = self.spots.column(column).len() > on_path && {
                self.report_rivals(image, column, own, sigma, pooled, &mut profile.candidates)
            };
            if own.is_some()
                && let Some(track) = self.tracks.get(next)
            {
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
                let mut found = point(
                    column,
                    &track.fit,
                    variance.max(floor) + row_levels,
                    haze,
                    bits,
                );
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
        image: GreyView<'_>,
        column: usize,
        own: Option<(usize, f64)>,
        sigma_px: f64,
        variance: f64,
        out: &mut Vec<StripePoint>,
    ) -> bool {
        let known = Known::clipping_at(self.ceiling);
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
            let Some(other) = fit::fit(&window, kernel, start, known) else {
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

fn point(column: usize, fit: &Fit, variance: f64, haze: Option<Haze>, quality: u32) -> StripePoint {
    // A haze level wrong by df shifts the row by about 1.7 df s / 2 (theory/noise.md, rows of the stripe).
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
