//! Fit of one column: row, height, width and background of the stripe near a given row.

use super::clipped::{self, GaussTable};
use super::kernel::{Kernel, LANES, split};
use super::synthetic::haze_over_pixel;
use crate::frame::GreyImage;

/// Rows held per column: the widest kernel plus room to move.
pub(super) const WINDOW_ROWS: usize = 96;
/// Farthest a fit may wander from the coarse candidate \[px\].
const MAX_WANDER_PX: f64 = 6.0;
const MAX_ITERATIONS: usize = 6;
/// A step below this stays inside the linearisation of the phase it was taken at \[px\].
const SMALL_STEP_PX: f64 = 0.07;

/// What one column says.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Fit {
    /// Centre \[px\].
    pub row_px: f64,
    /// Height above the background \[grey levels\].
    pub peak: f64,
    /// Background \[grey levels\].
    pub background: f64,
    /// Width \[px\].
    pub sigma_px: f64,
    /// Residual variance \[grey levels²\].
    pub variance: f64,
    /// Variance of the row for unit noise and unit height.
    pub row_variance: f64,
    /// Pixels were clipped.
    pub saturated: bool,
}

/// One-sided haze in the units of one kernel: what it adds to (b, A, A dc, A ds) per unit of
/// haze at each phase, and its shape.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct HazeShape {
    /// Decay length \[px\], positive = above the stripe.
    pub length_px: f64,
    /// `shape[phase * stride + tap]`.
    pub shape: Vec<f32>,
    /// `kernel.solve * shape` per phase.
    pub solved: Vec<[f32; 4]>,
}

/// What is known of the width beforehand, for columns whose clipped pixels leave it open.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct WidthPrior {
    /// Expected width \[px\].
    pub sigma_px: f64,
    /// Noise variance over (height times the width's sd)², the weight of that knowledge.
    pub weight: f64,
}

/// What a fit starts from, beside the pixels.
#[derive(Debug, Clone, Copy)]
pub(super) struct Known<'a> {
    /// Level from which pixels are clipped \[grey levels\].
    pub saturation: u8,
    /// Shape of the haze and its level as a fraction of the peak.
    pub haze: Option<(&'a HazeShape, f32)>,
    /// Width of the neighbourhood; used for clipped columns only.
    pub width: Option<WidthPrior>,
}

impl Known<'_> {
    /// Nothing but the clipping level.
    pub fn clipping_at(saturation: u8) -> Self {
        Self {
            saturation,
            haze: None,
            width: None,
        }
    }
}

impl HazeShape {
    /// Haze per unit of level at a pixel `distance_px` below the stripe.
    pub fn at(&self, distance_px: f64) -> f64 {
        haze_over_pixel(distance_px, self.length_px)
    }
}

/// Rows `start..` of one column, as numbers.
#[derive(Debug, Clone)]
pub(super) struct Window {
    start: i64,
    rows: usize,
    brightest: i16,
    values: [i16; WINDOW_ROWS],
}

impl Window {
    /// Empty.
    pub fn new() -> Self {
        Self {
            start: 0,
            rows: 0,
            brightest: 0,
            values: [0; WINDOW_ROWS],
        }
    }

    /// Reads up to `rows` rows of `column` around `row_px`, cut at the image's borders.
    #[inline]
    pub fn load(&mut self, image: &GreyImage, column: usize, row_px: f64, rows: usize) {
        let rows = rows.min(WINDOW_ROWS).min(image.height_px);
        let last_start = image.height_px - rows;
        let start = ((row_px + 0.5).max(0.0) as usize)
            .saturating_sub(rows / 2)
            .min(last_start);
        let width = image.width_px;
        let lines = image.pixels[start * width..(start + rows) * width].chunks_exact(width.max(1));
        let mut brightest = 0;
        for (v, line) in self.values.iter_mut().zip(lines) {
            let pixel = line[column];
            *v = i16::from(pixel);
            brightest = brightest.max(pixel);
        }
        self.brightest = i16::from(brightest);
        self.start = start as i64;
        self.rows = rows;
    }

    /// The pixels read.
    pub fn values(&self) -> &[i16] {
        &self.values[..self.rows]
    }

    /// Row of the first pixel.
    pub fn start(&self) -> i64 {
        self.start
    }

    /// Whether a pixel is clipped.
    pub fn clipped(&self, saturation: u8) -> bool {
        self.brightest >= i16::from(saturation)
    }

    /// The pixels under a kernel centred on `row`, with the kernel's padding; `None` where the
    /// kernel would leave the window, which at the image's border means: too close to it.
    #[inline]
    pub fn under(&self, kernel: &Kernel, row: i64) -> Option<&[i16]> {
        let first = usize::try_from(row - kernel.half as i64 - self.start).ok()?;
        if first + kernel.taps() > self.rows {
            return None;
        }
        // Padding taps have weight zero; their pixels only have to exist.
        self.values.get(first..first + kernel.stride)
    }
}

/// Rows to load where the row is known to a pixel.
pub(super) fn rows_near(kernel: &Kernel) -> usize {
    kernel.stride + 4
}

/// Rows to load for a kernel so that a fit can move as far as it may.
pub(super) fn rows_needed(kernel: &Kernel) -> usize {
    kernel.taps() + 2 * MAX_WANDER_PX as usize + 2
}

/// Fits one column from `start_px`.
pub(super) fn fit(
    window: &Window,
    kernel: &Kernel,
    gauss: &GaussTable,
    start_px: f64,
    known: Known,
) -> Option<Fit> {
    if window.clipped(known.saturation) {
        return clipped::fit(window, kernel, gauss, start_px, MAX_WANDER_PX, known);
    }
    let mut row_px = start_px;
    for iteration in 0..MAX_ITERATIONS {
        let (whole, phase, at) = split(row_px);
        let y = window.under(kernel, whole)?;
        let weights = &kernel.phases[phase];
        let (mut a, mut adc) = (weights.solve_line(1, y), weights.solve_line(2, y));
        if let Some((shape, level)) = known.haze {
            let of_peak = level * a;
            a -= of_peak * shape.solved[phase][1];
            adc -= of_peak * shape.solved[phase][2];
        }
        if a <= 0.0 {
            return None;
        }
        let step = f64::from(adc / a).clamp(-kernel.sigma_px, kernel.sigma_px);
        row_px = at + step;
        if (row_px - start_px).abs() > MAX_WANDER_PX {
            return None;
        }
        // Between two phases a noisy column may step to and fro: after three steps allow more,
        // at 0.28 px still linear to 0.005 px for the narrowest stripe.
        let small = SMALL_STEP_PX * iteration.saturating_sub(1).max(1) as f64;
        if step.abs() <= small {
            return Some(Fit {
                row_px,
                ..finish(y, kernel, phase, known.haze, a, adc)
            });
        }
    }
    None
}

/// Height, width, background and residual once the row is found.
fn finish(
    y: &[i16],
    kernel: &Kernel,
    phase: usize,
    haze: Option<(&HazeShape, f32)>,
    a: f32,
    adc: f32,
) -> Fit {
    let stride = kernel.stride;
    let weights = &kernel.phases[phase];
    let (mut b, mut ads) = (weights.solve_line(0, y), weights.solve_line(3, y));
    let mut left = [0.0f32; WINDOW_ROWS];
    let left = &mut left[..stride];
    for (l, y) in left.iter_mut().zip(y) {
        *l = f32::from(*y);
    }
    if let Some((shape, level)) = haze {
        let of_peak = level * a;
        b -= of_peak * shape.solved[phase][0];
        ads -= of_peak * shape.solved[phase][3];
        for (l, h) in left.iter_mut().zip(&shape.shape[phase * stride..]) {
            *l -= of_peak * h;
        }
    }
    let (p, rest) = weights.design.split_at(stride);
    let (pc, ps) = rest.split_at(stride);
    let mut square = [0.0f32; LANES];
    let design = p
        .chunks_exact(LANES)
        .zip(pc.chunks_exact(LANES))
        .zip(ps.chunks_exact(LANES));
    for (l, ((p, pc), ps)) in left.chunks_exact(LANES).zip(design) {
        for i in 0..LANES {
            let r = l[i] - (b + a * p[i] + adc * pc[i] + ads * ps[i]);
            square[i] += r * r;
        }
    }
    // The one tap of padding, last in its vector, is no pixel of this fit.
    let padding = left[stride - 1] - b;
    let sum: f32 = square.iter().sum::<f32>() - padding * padding;
    Fit {
        row_px: 0.0,
        peak: f64::from(a),
        background: f64::from(b),
        sigma_px: kernel.sigma_px + f64::from(ads) / f64::from(a),
        variance: f64::from(sum.max(0.0)) / (kernel.taps() as f64 - 4.0),
        row_variance: weights.row_variance,
        saturated: false,
    }
}

/// Row of the brightest place within 4 px of `row_px`, smoothed over three \[px\].
pub(super) fn brightest(window: &Window, row_px: f64) -> f64 {
    let y = window.values();
    let near = (row_px - window.start as f64 + 0.5).max(0.0) as usize;
    let (from, to) = (
        near.saturating_sub(4).max(1),
        (near + 5).min(y.len().saturating_sub(1)),
    );
    let mut best = (i16::MIN, near);
    for k in from..to {
        let smooth = y[k - 1] + 2 * y[k] + y[k + 1];
        if smooth > best.0 {
            best = (smooth, k);
        }
    }
    (window.start + best.1 as i64) as f64
}

/// Centre and width of the stripe near `row_px` from its edges at set levels \[px\]: crude, but
/// needs no idea of the width, and holds for clipped stripes.
pub(super) fn edges(window: &Window, row_px: f64, saturation: u8) -> Option<(f64, f64)> {
    let mut values = [0.0f32; WINDOW_ROWS];
    for (to, from) in values.iter_mut().zip(window.values()) {
        *to = f32::from(*from);
    }
    let y = &values[..window.values().len()];
    let saturation = f32::from(saturation);
    let near = row_px - window.start() as f64;
    let (from, to) = (
        (near - 4.0).max(1.0) as usize,
        ((near + 5.0).max(2.0) as usize).min(y.len().checked_sub(1)?),
    );
    let smooth = |k: usize| y[k - 1] + 2.0 * y[k] + y[k + 1];
    let top = (from..to).max_by(|a, b| smooth(*a).total_cmp(&smooth(*b)))?;
    let outer = (y.len() / 8).max(1);
    let ends = |s: &[f32]| s.iter().sum::<f32>() / s.len().max(1) as f32;
    let floor = ends(&y[..outer]).min(ends(&y[y.len() - outer..]));
    let clipped = y[top] >= saturation;
    let height = if clipped { y[top] } else { 0.25 * smooth(top) } - floor;
    let half_width = |fraction: f32| -> Option<(f64, f64)> {
        let level = floor + fraction * height;
        let up = crossing(y[..=top].iter().rev(), level)?;
        let down = crossing(y[top..].iter(), level)?;
        Some((
            0.5 * (up + down),
            0.5 * (down - up) + top as f64 + window.start() as f64,
        ))
    };
    // A Gaussian is at half height at 1.1774 sigma; a clipped one has no height to halve, so
    // its width comes from two levels: x_i^2 = 2 s^2 ln(A / L_i).
    let (low, centre) = half_width(if clipped { 0.3 } else { 0.5 })?;
    let sigma = if clipped {
        let (high, _) = half_width(0.85)?;
        ((low * low - high * high) / (2.0 * (0.85f64 / 0.3).ln()))
            .max(0.0)
            .sqrt()
    } else {
        low / 1.1774
    };
    Some((centre, sigma))
}

/// Distance from the first value to where the values first fall below `level`, interpolated.
fn crossing<'a>(values: impl Iterator<Item = &'a f32>, level: f32) -> Option<f64> {
    let mut last = f32::INFINITY;
    for (k, &v) in values.enumerate() {
        if v < level {
            let part = if last.is_finite() {
                (last - level) / (last - v)
            } else {
                1.0
            };
            return Some(k as f64 - 1.0 + f64::from(part));
        }
        last = v;
    }
    None
}
