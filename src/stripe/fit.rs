//! Fit of one column: row, height, width and background of the stripe near a given row.

use super::clipped;
use super::haze::haze_over_pixel;
use super::kernel::{Kernel, LANES, Lanes, split, widened};
use hydroline_core::frame::GreyView;
use wide::{f32x4, i16x8, i32x8};

/// Rows held per column: the widest kernel plus room to move.
pub(super) const WINDOW_ROWS: usize = 96;
/// Farthest a fit may wander from the coarse candidate \[px\].
const MAX_WANDER_PX: f64 = 6.0;
const MAX_ITERATIONS: usize = 6;
/// Farthest apart that rows of neighbouring columns are read together \[px\].
const MAX_SPREAD_PX: f64 = 8.0;

/// One column's estimate.
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
    /// The haze at the taps of each phase, one phase after another.
    pub shape: Vec<Lanes>,
    /// `kernel.solve * shape` per phase.
    pub solved: Vec<f32x4>,
}

/// Prior of the width, for columns whose clipped pixels leave it open.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct WidthPrior {
    /// Expected width \[px\].
    pub sigma_px: f64,
    /// Noise variance over (height times the width's sd)², the weight of that knowledge.
    pub weight: f64,
}

/// Inputs of a fit beside the pixels.
#[derive(Debug, Clone, Copy)]
pub(super) struct Known<'a> {
    /// Level from which pixels are clipped \[grey levels\].
    pub saturation: u8,
    /// Shape of the haze and its level as a fraction of the peak.
    pub haze: Option<(&'a HazeShape, f32)>,
    /// Width of the neighbourhood; used for clipped columns only.
    pub width: Option<WidthPrior>,
    /// The fit is to be repeated: a coarse one will do where columns are clipped.
    pub first: bool,
}

impl Known<'_> {
    /// Nothing but the clipping level.
    pub fn clipping_at(saturation: u8) -> Self {
        Self {
            saturation,
            haze: None,
            width: None,
            first: false,
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
    values: [i16; WINDOW_ROWS],
}

impl Window {
    pub fn new() -> Self {
        Self {
            start: 0,
            rows: 0,
            values: [0; WINDOW_ROWS],
        }
    }

    /// Reads up to `rows` rows of `column` around `row_px`, cut at the image's borders.
    #[inline]
    pub fn load(&mut self, image: GreyView<'_>, column: usize, row_px: f64, rows: usize) {
        let rows = rows.min(WINDOW_ROWS).min(image.height_px);
        let last_start = image.height_px - rows;
        let start = ((row_px + 0.5).max(0.0) as usize)
            .saturating_sub(rows / 2)
            .min(last_start);
        let width = image.width_px.max(1);
        let mut place = start * width + column;
        for v in &mut self.values[..rows] {
            // One comparison a row: an iterator over rows makes three of it.
            *v = image.pixels.get(place).map_or(0, |pixel| i16::from(*pixel));
            place += width;
        }
        self.start = start as i64;
        self.rows = rows;
    }

    /// Reads `rows` rows around `rows_px[i]` of column `column + i` into window `i`, and the few
    /// more that lie between those rows: side by side, so that a line of the image is found once
    /// for all. `false`, and nothing read, where the rows are too far apart or near a border.
    #[inline]
    pub fn load_together(
        windows: &mut [Self; 4],
        image: GreyView<'_>,
        column: usize,
        rows_px: [f64; 4],
        rows: usize,
    ) -> bool {
        let [a, b, c, d] = rows_px;
        let (low, high) = (a.min(b).min(c.min(d)), a.max(b).max(c.max(d)));
        let start = ((low + 0.5).max(0.0) as usize).wrapping_sub(rows / 2);
        let rows = rows + (high - low + 1.0) as usize;
        let whole = rows.next_multiple_of(LANES);
        let fits = whole <= WINDOW_ROWS
            && high - low < MAX_SPREAD_PX
            && start < image.height_px
            && whole <= image.height_px - start
            && column + 4 <= image.width_px;
        if !fits {
            return false;
        }
        let mut place = start * image.width_px + column;
        for chunk in 0..whole / LANES {
            // Four pixels a row, then parted by column: byte k of each row goes to window k.
            let line = |k: usize| {
                let from = place + k * image.width_px;
                let pixels = image.pixels.get(from..).and_then(|rest| rest.first_chunk());
                i32::from_le_bytes(pixels.copied().unwrap_or_default())
            };
            let lines = i32x8::new([
                line(0),
                line(1),
                line(2),
                line(3),
                line(4),
                line(5),
                line(6),
                line(7),
            ]);
            place += LANES * image.width_px;
            let byte = i32x8::splat(0xff);
            let columns = [
                lines & byte,
                (lines >> 8) & byte,
                (lines >> 16) & byte,
                (lines >> 24) & byte,
            ];
            for (window, column) in windows.iter_mut().zip(columns) {
                if let Some(to) = window.values.as_chunks_mut::<LANES>().0.get_mut(chunk) {
                    *to = i16x8::from_i32x8_saturate(column).to_array();
                }
            }
        }
        for window in windows {
            window.start = start as i64;
            window.rows = rows;
        }
        true
    }

    /// The pixels read.
    pub fn values(&self) -> &[i16] {
        &self.values[..self.rows]
    }

    /// Row of the first pixel.
    pub fn start(&self) -> i64 {
        self.start
    }

    #[inline]
    pub fn clipped(&self, saturation: u8) -> bool {
        let (chunks, rest) = self.values().as_chunks::<LANES>();
        let brightest = chunks
            .iter()
            .fold(i16x8::ZERO, |m, v| m.max(i16x8::new(*v)));
        let level = i16::from(saturation) - 1;
        brightest.simd_gt(i16x8::splat(level)).any() || rest.iter().any(|v| *v > level)
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
    kernel.stride + 1
}

/// Rows to load for a kernel so that a fit can move as far as it may.
pub(super) fn rows_needed(kernel: &Kernel) -> usize {
    kernel.taps() + 2 * MAX_WANDER_PX as usize + 2
}

pub(super) fn fit(window: &Window, kernel: &Kernel, start_px: f64, known: Known) -> Option<Fit> {
    if window.clipped(known.saturation) {
        return clipped::fit(window, kernel, start_px, MAX_WANDER_PX, known);
    }
    // Lengths known to the compiler leave straight lines of vector instructions.
    match kernel.stride / LANES {
        2 => fit_taps::<2>(window, kernel, start_px, known.haze),
        3 => fit_taps::<3>(window, kernel, start_px, known.haze),
        4 => fit_taps::<4>(window, kernel, start_px, known.haze),
        5 => fit_taps::<5>(window, kernel, start_px, known.haze),
        6 => fit_taps::<6>(window, kernel, start_px, known.haze),
        _ => fit_taps::<7>(window, kernel, start_px, known.haze),
    }
}

/// The fit with a kernel of `C` times [`LANES`] taps; `None` also where it has another length.
///
/// Not a case for the loop of `hydroline-numerics`: no normal equations are formed, each step is one product with the
/// pseudo-inverse that is tabulated for the row's phase.
fn fit_taps<const C: usize>(
    window: &Window,
    kernel: &Kernel,
    start_px: f64,
    haze: Option<(&HazeShape, f32)>,
) -> Option<Fit> {
    let mut row_px = start_px;
    for iteration in 0..MAX_ITERATIONS {
        let (whole, phase, at) = split(row_px);
        let y = window.under(kernel, whole)?.as_chunks::<LANES>().0;
        let y = y.first_chunk::<C>()?.map(i16x8::new);
        let weights = kernel.phases.get(phase)?;
        let mut solution = weights.solution(&y)?;
        let mut hazed = None;
        if let Some((shape, level)) = haze {
            let of_peak = f32x4::splat(level * solution.to_array()[1]);
            solution -= of_peak * *shape.solved.get(phase)?;
            hazed = Some((of_peak, shape.shape.as_chunks::<C>().0.get(phase)?));
        }
        let [b, a, adc, ads] = solution.to_array();
        if a <= 0.0 {
            return None;
        }
        let step = f64::from(adc / a).clamp(-kernel.sigma_px, kernel.sigma_px);
        row_px = at + step;
        if (row_px - start_px).abs() > MAX_WANDER_PX {
            return None;
        }
        // Between two phases a noisy column may step to and fro: after three steps allow more.
        if step.abs() > kernel.linear_px * iteration.saturating_sub(1).max(1) as f64 {
            continue;
        }
        let [of_b, of_a, of_adc, of_ads] = [b, a, adc, ads].map(f32x4::splat);
        let design = weights.design.first_chunk::<C>()?;
        let mut square = [f32x4::ZERO; 2];
        let mut last = f32x4::ZERO;
        for (k, (y, [p, pc, ps])) in y.iter().zip(design).enumerate() {
            for (half, y) in widened(*y).into_iter().enumerate() {
                let model = (of_b + of_a * p[half]) + (of_adc * pc[half] + of_ads * ps[half]);
                let mut r = y - model;
                if let Some((of_peak, shape)) = hazed {
                    r -= of_peak * shape[k][half];
                }
                square[half] += r * r;
                last = r;
            }
        }
        // The one tap of padding, last in its vector, is no pixel of this fit.
        let padding = last.to_array()[3];
        let sum = (square[0] + square[1]).reduce_add() - padding * padding;
        return Some(Fit {
            row_px,
            peak: f64::from(a),
            background: f64::from(b),
            sigma_px: kernel.sigma_px + f64::from(ads / a),
            variance: f64::from(sum.max(0.0)) / (kernel.taps() as f64 - 4.0),
            row_variance: weights.row_variance,
            saturated: false,
        });
    }
    None
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
    let peak_index = (from..to).max_by(|a, b| smooth(*a).total_cmp(&smooth(*b)))?;
    let outer = (y.len() / 8).max(1);
    let ends = |s: &[f32]| s.iter().sum::<f32>() / s.len().max(1) as f32;
    let floor = ends(&y[..outer]).min(ends(&y[y.len() - outer..]));
    let clipped = y[peak_index] >= saturation;
    let height = if clipped {
        y[peak_index]
    } else {
        0.25 * smooth(peak_index)
    } - floor;
    let half_width = |fraction: f32| -> Option<(f64, f64)> {
        let level = floor + fraction * height;
        let up = crossing(y[..=peak_index].iter().rev(), level)?;
        let down = crossing(y[peak_index..].iter(), level)?;
        Some((
            0.5 * (up + down),
            0.5 * (down - up) + peak_index as f64 + window.start() as f64,
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
