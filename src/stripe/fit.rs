//! Fit of one column: row, height, width and background of the stripe near a given row.

use super::kernel::{Kernel, Phase, dots, split};
use crate::frame::GreyImage;
use nalgebra::{Matrix4, Vector4};

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
    /// `shape[phase * stride + tap]`.
    pub shape: Vec<f32>,
    /// `kernel.solve * shape` per phase.
    pub solved: Vec<[f32; 4]>,
}

/// Rows `start..` of one column, as numbers.
#[derive(Debug, Clone)]
pub(super) struct Window {
    start: i64,
    rows: usize,
    values: [f32; WINDOW_ROWS],
}

impl Window {
    /// Empty.
    pub fn new() -> Self {
        Self {
            start: 0,
            rows: 0,
            values: [0.0; WINDOW_ROWS],
        }
    }

    /// Reads up to `rows` rows of `column` around `row_px`, cut at the image's borders.
    pub fn load(&mut self, image: &GreyImage, column: usize, row_px: f64, rows: usize) {
        let rows = rows.min(WINDOW_ROWS).min(image.height_px);
        let last_start = (image.height_px - rows) as f64;
        let start = (row_px + 0.5 - 0.5 * rows as f64)
            .floor()
            .clamp(0.0, last_start) as usize;
        let line = image.pixels[start * image.width_px + column..]
            .iter()
            .step_by(image.width_px.max(1));
        for (v, p) in self.values.iter_mut().zip(line.take(rows)) {
            *v = f32::from(*p);
        }
        self.start = start as i64;
        self.rows = rows;
    }

    /// The pixels read.
    pub fn values(&self) -> &[f32] {
        &self.values[..self.rows]
    }

    /// Row of the first pixel.
    pub fn start(&self) -> i64 {
        self.start
    }

    /// The pixels under a kernel centred on `row`, with the kernel's padding; `None` where the
    /// kernel would leave the window, which at the image's border means: too close to it.
    fn under(&self, kernel: &Kernel, row: i64) -> Option<&[f32]> {
        let first = usize::try_from(row - kernel.half as i64 - self.start).ok()?;
        if first + kernel.taps() > self.rows {
            return None;
        }
        // Padding taps have weight zero; their pixels only have to exist.
        self.values.get(first..first + kernel.stride)
    }
}

/// Rows to load for a kernel so that a fit can move as far as it may.
pub(super) fn rows_needed(kernel: &Kernel) -> usize {
    kernel.taps() + 2 * MAX_WANDER_PX as usize + 2
}

/// Fits one column from `start_px`. `haze` is its shape and its level as a fraction of the peak.
pub(super) fn fit(
    window: &Window,
    kernel: &Kernel,
    start_px: f64,
    saturation: f32,
    haze: Option<(&HazeShape, f32)>,
) -> Option<Fit> {
    let mut row_px = start_px;
    for _ in 0..MAX_ITERATIONS {
        let (whole, phase, at) = split(row_px);
        let y = window.under(kernel, whole)?;
        let weights = &kernel.phases[phase];
        let clipped = y[..kernel.taps()].iter().fold(0.0f32, |m, v| m.max(*v)) >= saturation;
        let solution = if clipped {
            solve_clipped(y, kernel, phase, saturation, haze)
        } else {
            let lines = &weights.solve[kernel.stride..3 * kernel.stride];
            let [mut a, mut adc] = dots::<2>(y, lines, kernel.stride);
            if let Some((shape, level)) = haze {
                let of_peak = level * a;
                a -= of_peak * shape.solved[phase][1];
                adc -= of_peak * shape.solved[phase][2];
            }
            Solution {
                a: f64::from(a),
                adc: f64::from(adc),
                row_variance: weights.row_variance,
                ..Solution::default()
            }
        };
        if solution.a <= 0.0 {
            return None;
        }
        let step = (solution.adc / solution.a).clamp(-kernel.sigma_px, kernel.sigma_px);
        row_px = at + step;
        if (row_px - start_px).abs() > MAX_WANDER_PX {
            return None;
        }
        if step.abs() <= SMALL_STEP_PX {
            let mut solution = solution;
            if !clipped {
                solution = solve_all(y, kernel, weights, phase, haze, solution);
            }
            let fitted = finish(y, kernel, phase, saturation, haze, &solution);
            return Some(Fit {
                row_px,
                saturated: clipped,
                ..fitted
            });
        }
    }
    None
}

/// Parameters of the linearised model.
#[derive(Debug, Clone, Copy, Default)]
struct Solution {
    b: f64,
    a: f64,
    adc: f64,
    ads: f64,
    row_variance: f64,
}

fn solve_all(
    y: &[f32],
    kernel: &Kernel,
    weights: &Phase,
    phase: usize,
    haze: Option<(&HazeShape, f32)>,
    known: Solution,
) -> Solution {
    let [mut b, _, _, mut ads] = dots::<4>(y, &weights.solve, kernel.stride);
    if let Some((shape, level)) = haze {
        let of_peak = level * known.a as f32;
        b -= of_peak * shape.solved[phase][0];
        ads -= of_peak * shape.solved[phase][3];
    }
    Solution {
        b: f64::from(b),
        ads: f64::from(ads),
        ..known
    }
}

/// Least squares over the pixels that are not clipped: a clipped pixel only says "at least so
/// bright", which the flanks already imply, so it carries (almost) no information on the row.
fn solve_clipped(
    y: &[f32],
    kernel: &Kernel,
    phase: usize,
    saturation: f32,
    haze: Option<(&HazeShape, f32)>,
) -> Solution {
    let stride = kernel.stride;
    let design = &kernel.phases[phase].design;
    let (p, rest) = design.split_at(stride);
    let (pc, ps) = rest.split_at(stride);
    let level = haze.map(|(shape, level)| (&shape.shape[phase * stride..], f64::from(level)));
    let mut n = Matrix4::<f64>::zeros();
    let mut r = Vector4::<f64>::zeros();
    for k in 0..kernel.taps() {
        if y[k] >= saturation {
            continue;
        }
        // Haze is a fraction of the height: it adds to the height's own column of the design.
        let hazed = level.map_or(0.0, |(shape, level)| level * f64::from(shape[k]));
        let x = Vector4::new(
            1.0,
            f64::from(p[k]) + hazed,
            f64::from(pc[k]),
            f64::from(ps[k]),
        );
        n.ger(1.0, &x, &x, 1.0);
        r.axpy(f64::from(y[k]), &x, 1.0);
    }
    let Some(factor) = n.cholesky() else {
        return Solution::default();
    };
    let s = factor.solve(&r);
    let covariance = factor.solve(&Vector4::new(0.0, 0.0, 1.0, 0.0));
    Solution {
        b: s[0],
        a: s[1],
        adc: s[2],
        ads: s[3],
        row_variance: covariance[2],
    }
}

/// Residual and width at the solution.
fn finish(
    y: &[f32],
    kernel: &Kernel,
    phase: usize,
    saturation: f32,
    haze: Option<(&HazeShape, f32)>,
    s: &Solution,
) -> Fit {
    let stride = kernel.stride;
    let taps = kernel.taps();
    let design = &kernel.phases[phase].design;
    let (p, rest) = design.split_at(stride);
    let (pc, ps) = rest.split_at(stride);
    let (b, a, adc, ads) = (s.b as f32, s.a as f32, s.adc as f32, s.ads as f32);
    let mut model = [0.0f32; WINDOW_ROWS];
    let model = &mut model[..taps];
    for (((m, p), pc), ps) in model.iter_mut().zip(p).zip(pc).zip(ps) {
        *m = b + a * p + adc * pc + ads * ps;
    }
    if let Some((shape, level)) = haze {
        for (m, h) in model.iter_mut().zip(&shape.shape[phase * stride..]) {
            *m += level * a * h;
        }
    }
    let (mut square, mut used) = (0.0f32, 0.0f32);
    for (m, y) in model.iter().zip(y) {
        let kept = f32::from(u8::from(*y < saturation));
        square += kept * (y - m) * (y - m);
        used += kept;
    }
    Fit {
        row_px: 0.0,
        peak: s.a,
        background: s.b,
        sigma_px: kernel.sigma_px + s.ads / s.a,
        variance: f64::from(square) / f64::from(used - 4.0).max(1.0),
        row_variance: s.row_variance,
        saturated: false,
    }
}

/// Centre and width of the stripe near `row_px` from its edges at set levels \[px\]: crude, but
/// needs no idea of the width, and holds for clipped stripes.
pub(super) fn edges(window: &Window, row_px: f64, saturation: f32) -> Option<(f64, f64)> {
    let y = window.values();
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
