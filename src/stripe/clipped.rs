//! Fit of a column whose brightest pixels are clipped: from the flanks, with the exact model.
//!
//! A clipped pixel says "at least so bright", which the flanks already imply, so it is left
//! out. What is left lies far from the centre, where the table's linearisation is too coarse:
//! here the profile is evaluated at every step. Over one pixel, with u = d / s and the Hermite
//! polynomials He of `g = exp(-u^2 / 2)` (d/dd of He_n g is -He_(n+1) g / s),
//! `P = g (1 + He_2 / 24 s^2 + He_4 / 1920 s^4 + He_6 / 322560 s^6)`: the Taylor series of the
//! pixel's integral, good to 1e-4 of the height for s >= 0.6 px. A Gaussian obeys the equation of
//! heat, hence `dP/ds = P / s + s d2P/dd2`.

use super::fit::{Fit, Known, Window};
use super::kernel::{Kernel, LANES, Lanes, SIGMA_MAX_PX, SIGMA_MIN_PX, parted, widened};
use wide::{f32x4, i16x8};

const MAX_ITERATIONS: usize = 12;
/// Steps below these parts of the width end the iteration: of what is left after such a step the
/// square counts.
const ROW_STEP: f64 = 0.03;
const SIGMA_STEP: f64 = 0.05;
/// The same for a fit that is to be repeated: 2 % of the width at most is left, below what one
/// column shows of it.
const FIRST_ROW_STEP: f64 = 0.1;
const FIRST_SIGMA_STEP: f64 = 0.15;

/// Fits a clipped column from `start_px`, under the taps of `kernel`.
///
/// Not a case for the loop of `hydroline-numerics`: height and background are no unknowns that are stepped in, they are
/// solved for anew with every step in row and width (variable projection; Golub and Pereyra 1973).
pub(super) fn fit(
    window: &Window,
    kernel: &Kernel,
    start_px: f64,
    wander_px: f64,
    known: Known,
) -> Option<Fit> {
    let mut row_px = start_px;
    let mut sigma_px = known.width.map_or(kernel.sigma_px, |prior| prior.sigma_px);
    let (small_row, small_sigma) = if known.first {
        (FIRST_ROW_STEP, FIRST_SIGMA_STEP)
    } else {
        (ROW_STEP, SIGMA_STEP)
    };
    for _ in 0..MAX_ITERATIONS {
        let whole = (row_px + 0.5).max(0.0) as i64;
        let y = window.under(kernel, whole)?;
        let first = whole as f64 - kernel.half as f64 - row_px;
        let system = System::at(y, first, sigma_px, known);
        let (solution, row_variance) = system.solve()?;
        let [_, a, ads, adc] = solution;
        if a <= 0.0 {
            return None;
        }
        let row_step = (adc / a).clamp(-sigma_px, sigma_px);
        let sigma_step = (ads / a).clamp(-0.3 * sigma_px, 0.3 * sigma_px);
        row_px += row_step;
        sigma_px = (sigma_px + sigma_step).clamp(SIGMA_MIN_PX, SIGMA_MAX_PX);
        if (row_px - start_px).abs() > wander_px {
            return None;
        }
        if row_step.abs() < small_row * sigma_px && sigma_step.abs() < small_sigma * sigma_px {
            return Some(Fit {
                row_px,
                peak: a,
                background: solution[0] + system.offset,
                sigma_px,
                variance: system.residual(&solution),
                row_variance,
                saturated: true,
            });
        }
    }
    None
}

/// Normal equations for (b, A, A ds, A dc) over the pixels that are not clipped: the row last,
/// so that the last pivot is the inverse of its variance.
struct System {
    /// Lower triangle, with prior knowledge.
    normal: [[f64; 4]; 4],
    right: [f64; 4],
    square: f64,
    used: f64,
    /// Terms that the prior adds to (A, A), (A, A ds), (A ds, A ds).
    prior: [f64; 3],
    offset: f64,
}

/// `exp(-w / 2)` to 1e-5 of itself for w <= 20, to 1e-9 beyond.
#[inline(always)]
fn exp_minus_half(w: f32x4) -> f32x4 {
    // exp(-z)^32 with z = w / 64, by its series.
    let z = w.fast_min(f32x4::splat(40.0)) * f32x4::splat(1.0 / 64.0);
    let mut e = f32x4::splat(-1.0 / 120.0);
    for c in [1.0 / 24.0, -1.0 / 6.0, 0.5, -1.0, 1.0] {
        e = e * z + f32x4::splat(c);
    }
    for _ in 0..5 {
        e *= e;
    }
    e
}

/// Cubic with these coefficients, lowest first.
#[inline(always)]
fn cubic(c: &[f32x4; 4], w: f32x4) -> f32x4 {
    ((c[3] * w + c[2]) * w + c[1]) * w + c[0]
}

/// P, dP/dc, dP/ds of one width.
struct Shape {
    per_sigma: f32x4,
    value: [f32x4; 4],
    slope: [f32x4; 4],
    curvature: [f32x4; 4],
}

impl Shape {
    fn new(sigma_px: f64) -> Self {
        let q = 1.0 / (sigma_px * sigma_px);
        let (p, r, t) = (q / 24.0, q * q / 1920.0, q * q * q / 322_560.0);
        let lanes = |c: [f64; 4]| c.map(|v| f32x4::splat(v as f32));
        Self {
            per_sigma: f32x4::splat((1.0 / sigma_px) as f32),
            // 1 + p He_2 + r He_4 + t He_6, in powers of u^2.
            value: lanes([
                1.0 - p + 3.0 * r - 15.0 * t,
                p - 6.0 * r + 45.0 * t,
                r - 15.0 * t,
                t,
            ]),
            // (He_1 + p He_3 + r He_5 + t He_7) / u.
            slope: lanes([
                1.0 - 3.0 * p + 15.0 * r - 105.0 * t,
                p - 10.0 * r + 105.0 * t,
                r - 21.0 * t,
                t,
            ]),
            // He_2 + p He_4 + r He_6; what follows is below 3e-3 of it.
            curvature: lanes([
                -1.0 + 3.0 * p - 15.0 * r,
                1.0 - 6.0 * p + 45.0 * r,
                p - 15.0 * r,
                r,
            ]),
        }
    }

    /// At these distances from the stripe's centre.
    #[inline(always)]
    fn at(&self, d: f32x4) -> [f32x4; 3] {
        let u = d * self.per_sigma;
        let w = u * u;
        let g = exp_minus_half(w);
        let p = g * cubic(&self.value, w);
        let pc = g * u * self.per_sigma * cubic(&self.slope, w);
        let ps = (p + g * cubic(&self.curvature, w)) * self.per_sigma;
        [p, pc, ps]
    }
}

impl System {
    /// Of the pixels `y` with one tap of padding, the first at `first` from the centre.
    fn at(y: &[i16], first: f64, sigma_px: f64, known: Known) -> Self {
        const PLACES: Lanes = [
            f32x4::new([0.0, 2.0, 4.0, 6.0]),
            f32x4::new([1.0, 3.0, 5.0, 7.0]),
        ];
        let shape = Shape::new(sigma_px);
        // Numbers near zero lose no digits in the residual.
        let offset = f32::from(y.first().copied().unwrap_or(0));
        let offset_lanes = f32x4::splat(offset);
        let saturation = f32x4::splat(f32::from(known.saturation));
        let end = f32x4::splat(y.len() as f32 - 1.5);
        // Sums of the weight and of the products of 1, P, dP/ds, dP/dc and the pixel.
        let mut sums = [f32x4::ZERO; 16];
        for (chunk, y) in y.as_chunks::<LANES>().0.iter().enumerate() {
            let start = (chunk * LANES) as f32;
            let haze = known.haze.map(|(shape, level)| {
                let at = |k: usize| level * shape.at(first + f64::from(start) + k as f64) as f32;
                parted(&std::array::from_fn(at))
            });
            for (half, light) in widened(i16x8::new(*y)).into_iter().enumerate() {
                let place = PLACES[half] + f32x4::splat(start);
                // All bits or none: a clipped pixel and the padding add zeros.
                let used = light.simd_lt(saturation) & place.simd_lt(end);
                let [p, pc, ps] = shape.at(place + f32x4::splat(first as f32));
                let p = haze.map_or(p, |h| p + h[half]);
                let (p, pc, ps) = (p & used, pc & used, ps & used);
                let v = (light - offset_lanes) & used;
                let one = f32x4::ONE & used;
                let terms = [
                    one,
                    p,
                    ps,
                    pc,
                    v,
                    v * p,
                    v * ps,
                    v * pc,
                    p * p,
                    p * ps,
                    ps * ps,
                    p * pc,
                    ps * pc,
                    pc * pc,
                    v * v,
                ];
                for (sum, term) in sums.iter_mut().zip(terms) {
                    *sum += term;
                }
            }
        }
        let mut totals = [0.0; 16];
        for (four, of) in totals
            .as_chunks_mut::<4>()
            .0
            .iter_mut()
            .zip(sums.as_chunks().0)
        {
            let [a, b, c, d] = f32x4::transpose(*of);
            *four = ((a + b) + (c + d)).to_array().map(f64::from);
        }
        let [n, p, s, c, v, vp, vs, vc, pp, ps, ss, pc, sc, cc, square, _] = totals;
        // (A ds) - A (expected - current width) = 0, with the prior's weight.
        let prior = known.width.map_or([0.0; 3], |prior| {
            let off = sigma_px - prior.sigma_px;
            [off * off, off, 1.0].map(|x| x * prior.weight)
        });
        Self {
            normal: [
                [n, 0.0, 0.0, 0.0],
                [p, pp + prior[0], 0.0, 0.0],
                [s, ps + prior[1], ss + prior[2], 0.0],
                [c, pc, sc, cc],
            ],
            right: [v, vp, vs, vc],
            square,
            used: n,
            prior,
            offset: f64::from(offset),
        }
    }

    /// Factors L (below the diagonal) and D (on it); `None` where not positive definite.
    #[inline(always)]
    fn factor(&self) -> Option<[[f64; 4]; 4]> {
        let mut f = self.normal;
        for j in 0..4 {
            for k in 0..j {
                f[j][j] -= f[j][k] * f[j][k] * f[k][k];
            }
            // Rounding of the 32-bit sums, not information.
            if f[j][j] <= 1e-6 * self.normal[j][j] {
                return None;
            }
            for i in j + 1..4 {
                for k in 0..j {
                    f[i][j] -= f[i][k] * f[j][k] * f[k][k];
                }
                f[i][j] /= f[j][j];
            }
        }
        Some(f)
    }

    /// (b, A, A ds, A dc), the background above the offset, and the variance of (A dc) for unit
    /// noise.
    fn solve(&self) -> Option<([f64; 4], f64)> {
        let f = self.factor()?;
        let mut x = self.right;
        for i in 0..4 {
            for k in 0..i {
                x[i] -= f[i][k] * x[k];
            }
        }
        for i in (0..4).rev() {
            x[i] /= f[i][i];
            for k in i + 1..4 {
                x[i] -= f[k][i] * x[k];
            }
        }
        Some((x, 1.0 / f[3][3]))
    }

    /// Residual variance of the pixels used.
    fn residual(&self, x: &[f64; 4]) -> f64 {
        let mut sum = self.square;
        for i in 0..4 {
            sum += x[i] * (self.normal[i][i] * x[i] - 2.0 * self.right[i]);
            for k in 0..i {
                sum += 2.0 * self.normal[i][k] * x[i] * x[k];
            }
        }
        // Of the pixels alone, without prior knowledge.
        let [aa, a_ads, ads] = self.prior;
        sum -= aa * x[1] * x[1] + 2.0 * a_ads * x[1] * x[2] + ads * x[2] * x[2];
        sum.max(0.0) / (self.used - 4.0).max(1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::profile;

    #[test]
    fn the_series_gives_the_profile() {
        for (d, s) in [
            (0.3f64, 0.6f64),
            (0.0, 0.7),
            (1.4, 0.8),
            (2.0, 1.1),
            (-5.0, 3.0),
            (20.0, 2.0),
        ] {
            let found = Shape::new(s).at(f32x4::splat(d as f32));
            let exact = profile(d, s);
            for (i, (found, exact)) in found.iter().zip(exact).enumerate() {
                let off = f64::from(found.to_array()[0]) - exact;
                // The third is a derivative only: it steers a step, it moves no result.
                let limit = [2e-4, 1e-3, 1e-2][i];
                assert!(off.abs() < limit, "d {d}, s {s}, {i}: off by {off}");
            }
        }
    }

    #[test]
    fn one_step_solves_what_is_linear() {
        let (s, centre) = (1.5, 0.2);
        let y: Vec<i16> = (0..16)
            .map(|k| (20.0 + 900.0 * profile(k as f64 - 7.0 - centre, s)[0]).round() as i16)
            .map(|v| v.min(255))
            .collect();
        let system = System::at(&y, -7.0 - centre, s, Known::clipping_at(255));
        let ([b, a, ads, adc], _) = system.solve().unwrap();
        assert!((b + system.offset - 20.0).abs() < 0.5, "{b}");
        assert!((a - 900.0).abs() < 20.0, "{a}");
        assert!((ads / a).abs() < 0.01 && (adc / a).abs() < 0.002);
        assert!(system.residual(&[b, a, ads, adc]) < 0.3);
    }
}
