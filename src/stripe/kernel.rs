//! Matched kernels of a pixel-integrated Gaussian stripe: a Gauss-Newton step as four dot products.
//!
//! Model of one column, rows k: `y_k = b + A P(k - c; s)` with
//! `P(d; s) = integral over [d - 1/2, d + 1/2] of exp(-t^2 / 2 s^2) dt`
//! (the pixel integrates the light, so sampling the bare Gaussian would bias s).
//! Linearised at a row on a 1/8 px grid and a width on a geometric grid, the least-squares
//! solution for (b, A, A dc, A ds) is a fixed 4 x taps matrix. Its third line is the matched
//! derivative-of-Gaussian filter, made orthogonal to background, height and width; its zero
//! crossing reaches the Cramer-Rao bound (Blais and Rioux 1986).

use nalgebra::{Matrix4, Vector4};
use wide::{f32x4, i16x8, i32x4};

/// Sub-pixel positions per pixel at which kernels are tabulated: the linearisation error
/// of a Gaussian, dc^3 / 4 s^2, stays below 1e-4 px at dc = 1/16 px, s = 0.7 px.
pub(super) const PHASES: usize = 8;
/// Narrowest stripe a column can show and still hold sub-pixel information \[px\].
pub(super) const SIGMA_MIN_PX: f64 = 0.6;
/// Widest stripe looked for \[px\].
pub(super) const SIGMA_MAX_PX: f64 = 8.0;
/// Ratio of neighbouring widths: at most 3.5 % mismatch, which costs 0.1 % of the bound.
const SIGMA_RATIO: f64 = 1.07;
/// Half length of a kernel, about, in sigmas; at least 3.0: 99.9 % of the position information.
const HALF_SIGMAS: f64 = 3.2;
/// Largest weight as an integer. Rounding the weights then moves a row by 1e-5 px at most, and
/// `taps x 255 x` this fits 32 bits.
const FULL_SCALE: f64 = 16_383.0;
/// Kernels are padded to a multiple of this many taps (vector lanes).
pub(super) const LANES: usize = 8;

/// Kernels of one width at all phases.
#[derive(Debug, Clone)]
pub(super) struct Kernel {
    /// The width \[px\].
    pub sigma_px: f64,
    /// Taps on either side of the middle one.
    pub half: usize,
    /// Taps, padded with zeros to a multiple of [`LANES`].
    pub stride: usize,
    /// Farthest a row may lie from the phase it was fitted at \[px\]: the linearisation's error
    /// dc^3 / 4 s^2 is then 2.5e-4 px at most, a fortieth of the best bound there is.
    pub linear_px: f64,
    /// One set per phase.
    pub phases: Vec<Phase>,
}

/// Kernels of one width and one sub-pixel position.
#[derive(Debug, Clone)]
pub(super) struct Phase {
    /// Least-squares weights of (b, A, A dc, A ds) for each [`LANES`] taps, as integers:
    /// `pmaddwd` multiplies and adds eight of them at once.
    pub solve: Vec<[i16x8; 4]>,
    /// Value of one unit of each line's dot product.
    pub scale: f32x4,
    /// Design columns P, dP/dc, dP/ds for each [`LANES`] taps.
    pub design: Vec<[Lanes; 3]>,
    /// Variance of (A dc) for unit noise: sd(c) = noise / A * sqrt of this.
    pub row_variance: f64,
}

/// Eight numbers, those at even places and those at odd ones: as `pmaddwd` widens them.
pub(super) type Lanes = [f32x4; 2];

/// Parts eight numbers by even and odd place.
pub(super) fn parted(v: &[f32; LANES]) -> Lanes {
    [0, 1].map(|odd| f32x4::new([0, 2, 4, 6].map(|i| v[i + odd])))
}

/// The same for pixels.
#[inline(always)]
pub(super) fn widened(y: i16x8) -> Lanes {
    const EVEN: i16x8 = i16x8::new([1, 0, 1, 0, 1, 0, 1, 0]);
    const ODD: i16x8 = i16x8::new([0, 1, 0, 1, 0, 1, 0, 1]);
    [EVEN, ODD].map(|pick| f32x4::from_i32x4(y.dot(pick)))
}

/// Integer row and phase nearest to `row_px` (beyond +-1e8: any), and that phase's exact position.
#[inline(always)]
pub(super) fn split(row_px: f64) -> (i64, usize, f64) {
    // Adding this leaves the rounded number in the low bits of the mantissa: `floor` and the
    // checked casts cost more than the dot products.
    const ROUND: f64 = 6_755_399_441_055_744.0;
    const STEPS: f64 = PHASES as f64;
    let rounded = row_px * STEPS + (0.5 * STEPS - 0.5) + ROUND;
    let steps = rounded.to_bits() as i32;
    let at = (rounded - ROUND + 0.5) / STEPS - 0.5;
    let whole = steps.div_euclid(PHASES as i32);
    (
        i64::from(whole),
        steps.rem_euclid(PHASES as i32) as usize,
        at,
    )
}

/// Sub-pixel offset of a phase from its pixel's centre \[px\].
pub(super) fn phase_offset(phase: usize) -> f64 {
    (phase as f64 + 0.5) / PHASES as f64 - 0.5
}

/// 5-point Gauss-Legendre over one pixel: exact to 1e-9 for s >= 0.6 px.
pub(super) fn over_pixel(distance_px: f64, f: impl Fn(f64) -> f64) -> f64 {
    const NODES: [(f64, f64); 5] = [
        (-0.906_179_845_938_664, 0.236_926_885_056_189),
        (-0.538_469_310_105_683, 0.478_628_670_499_366),
        (0.0, 0.568_888_888_888_889),
        (0.538_469_310_105_683, 0.478_628_670_499_366),
        (0.906_179_845_938_664, 0.236_926_885_056_189),
    ];
    NODES
        .iter()
        .map(|(x, w)| 0.5 * w * f(distance_px + 0.5 * x))
        .sum()
}

/// P, dP/dc and dP/ds at pixel distance `d` from the stripe's centre.
pub(super) fn profile(d: f64, s: f64) -> [f64; 3] {
    let gauss = |t: f64| (-0.5 * t * t / (s * s)).exp();
    [
        over_pixel(d, gauss),
        over_pixel(d, |t| t / (s * s) * gauss(t)),
        over_pixel(d, |t| t * t / (s * s * s) * gauss(t)),
    ]
}

impl Kernel {
    fn new(sigma_px: f64) -> Self {
        // At least 15 taps: the width of a narrow stripe is not known without its background.
        let least = (2 * (HALF_SIGMAS * sigma_px + 0.5) as usize + 1).max(LANES + 1);
        // The rest of the vector is used for background: an odd number of taps, one of padding.
        let stride = least.div_ceil(LANES) * LANES;
        let half = stride / 2 - 1;
        let phases = (0..PHASES)
            .map(|p| Phase::new(sigma_px, half, stride, phase_offset(p)))
            .collect();
        Self {
            sigma_px,
            half,
            stride,
            linear_px: 0.1 * sigma_px.powf(2.0 / 3.0),
            phases,
        }
    }

    /// Number of taps that are not padding.
    pub fn taps(&self) -> usize {
        2 * self.half + 1
    }
}

impl Phase {
    fn new(s: f64, half: usize, stride: usize, offset: f64) -> Self {
        let rows: Vec<Vector4<f64>> = (0..=2 * half)
            .map(|k| {
                let [p, pc, ps] = profile(k as f64 - half as f64 - offset, s);
                Vector4::new(1.0, p, pc, ps)
            })
            .collect();
        let normal: Matrix4<f64> = rows.iter().map(|x| x * x.transpose()).sum();
        // Full rank for every width on the grid; zeros (height 0, hence no point) otherwise.
        let covariance = normal.try_inverse().unwrap_or_else(Matrix4::zeros);
        let weights: Vec<Vector4<f64>> = rows.iter().map(|x| covariance * x).collect();
        let mut solve = vec![[i16x8::ZERO; 4]; stride / LANES];
        let mut scale = [0.0; 4];
        for i in 0..4 {
            let largest = weights.iter().fold(0.0f64, |m, w| m.max(w[i].abs()));
            let unit = (largest / FULL_SCALE).max(f64::MIN_POSITIVE);
            let mut line = vec![0i16; stride];
            for (to, w) in line.iter_mut().zip(&weights) {
                *to = (w[i] / unit).round() as i16;
            }
            if i > 0 {
                // Blind to a constant background, exactly: rounding errors go to the middle tap.
                let sum: i32 = line.iter().map(|w| i32::from(*w)).sum();
                line[half] = (i32::from(line[half]) - sum) as i16;
            }
            for (to, from) in solve.iter_mut().zip(line.as_chunks().0) {
                to[i] = i16x8::new(*from);
            }
            scale[i] = unit as f32;
        }
        let mut design = vec![[[f32x4::ZERO; 2]; 3]; stride / LANES];
        for (to, from) in design.iter_mut().zip(rows.chunks(LANES)) {
            for (i, to) in to.iter_mut().enumerate() {
                let column = |k: usize| from.get(k).map_or(0.0, |x| x[i + 1] as f32);
                *to = parted(&std::array::from_fn(column));
            }
        }
        Self {
            solve,
            scale: f32x4::new(scale),
            design,
            row_variance: covariance[(2, 2)],
        }
    }

    /// The solution (b, A, A dc, A ds) for `C` times [`LANES`] pixels; `None` for another length.
    #[inline(always)]
    pub fn solution<const C: usize>(&self, y: &[i16x8; C]) -> Option<f32x4> {
        let weights = self.solve.first_chunk::<C>()?;
        let mut sums = [i32x4::ZERO; 4];
        for (y, lines) in y.iter().zip(weights) {
            for (sum, line) in sums.iter_mut().zip(lines) {
                *sum += y.dot(*line);
            }
        }
        let [p, q, r, s] = f32x4::transpose(sums.map(f32x4::from_i32x4));
        Some(self.scale * ((p + q) + (r + s)))
    }
}

/// All widths, each built when first asked for. A cache: no result depends on what it holds.
#[derive(Debug, Clone)]
pub(super) struct KernelTable {
    kernels: Vec<Option<Box<Kernel>>>,
}

impl KernelTable {
    pub fn new() -> Self {
        let count = ((SIGMA_MAX_PX / SIGMA_MIN_PX).ln() / SIGMA_RATIO.ln()).ceil() as usize + 1;
        Self {
            kernels: vec![None; count],
        }
    }

    /// Index of the width nearest to `sigma_px` (clamped to the grid).
    pub fn index(&self, sigma_px: f64) -> usize {
        let i = ((sigma_px.max(SIGMA_MIN_PX) / SIGMA_MIN_PX).ln() / SIGMA_RATIO.ln()).round();
        (i as usize).min(self.kernels.len() - 1)
    }

    pub fn get(&mut self, index: usize) -> &Kernel {
        let index = index.min(self.kernels.len() - 1);
        self.kernels[index].get_or_insert_with(|| {
            Box::new(Kernel::new(SIGMA_MIN_PX * SIGMA_RATIO.powi(index as i32)))
        })
    }
}

impl Phase {
    /// Line `i` of the solution for any numbers under the taps.
    pub fn solve_line(&self, i: usize, y: &[f32]) -> f32 {
        let lines = self.solve.iter().flat_map(|lines| lines[i].to_array());
        let sum: f32 = lines.zip(y).map(|(w, y)| f32::from(w) * y).sum();
        self.scale.to_array()[i] * sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_step_recovers_row_height_width_and_background() {
        let mut table = KernelTable::new();
        for true_sigma in [0.7, 1.0, 2.0, 3.0, 6.0] {
            let index = table.index(true_sigma);
            let kernel = table.get(index).clone();
            for phase in 0..PHASES {
                let centre = phase_offset(phase) + 0.03;
                let y: Vec<i16> = (0..kernel.stride)
                    .map(|k| {
                        let d = k as f64 - kernel.half as f64 - centre;
                        // In tenths of a grey level: rounding must not hide the kernel's error.
                        (200.0 + 1000.0 * profile(d, true_sigma)[0]).round() as i16
                    })
                    .collect();
                let fine: Vec<f32> = y.iter().map(|v| f32::from(*v)).collect();
                let [b, a, adc, ads] =
                    [0, 1, 2, 3].map(|i| kernel.phases[phase].solve_line(i, &fine) / 10.0);
                assert!(
                    (f64::from(adc / a) - 0.03).abs() < 0.003,
                    "{true_sigma} {phase}"
                );
                assert!((f64::from(a) - 100.0).abs() < 0.5);
                assert!((f64::from(b) - 20.0).abs() < 0.5);
                assert!(
                    (kernel.sigma_px + f64::from(ads / a) - true_sigma).abs() < 0.01 * true_sigma
                );
            }
        }
    }

    #[test]
    fn row_variance_is_the_textbook_bound() {
        // (n/A) sqrt(2 s / sqrt(pi)) for s >= 1 px, slightly more for the pixel's own width.
        let mut table = KernelTable::new();
        for s in [1.5, 2.0, 3.0] {
            let index = table.index(s);
            let kernel = table.get(index);
            let textbook = 2.0 * kernel.sigma_px / std::f64::consts::PI.sqrt();
            for p in &kernel.phases {
                let ratio = p.row_variance / textbook;
                assert!((0.99..1.12).contains(&ratio), "{s}: {ratio}");
            }
        }
    }
}
