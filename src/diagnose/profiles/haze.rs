//! Haze beside the stripe, from the grey levels across it.
//!
//! Haze does not move the geometry, it puts a skirt on one side of the stripe. The light of all
//! frames is laid over each other by the distance d from the sheet at which each pixel's ray meets
//! its surface, and fitted with
//!
//! level(d) = b + A [σ/S exp(−d²/2S²) + f h(±d)],  S² = σ² + s²,
//! h(d) = exp(s²/2L² − d/L) Φ(d/s − s/L),
//!
//! h: exp(−d/L) for d > 0 under the point spread s. A sensor gives nothing below zero, so what is
//! compared is E max(0, level + noise). Forward of the sheet f is haze; the same skirt astern is
//! the control: whatever both sides have alike (tails of the lens, a wrong width) is not haze.

use super::fit::{Fitted, Problem};
use super::geometry::Placed;
use super::model::{Rays, belongs};
use hydroline_calib::Pose;
use hydroline_core::frame::GreyImage;
use nalgebra::{DMatrix, DVector};

/// Width of a class of distance \[m\].
const CLASS_M: f64 = 0.25e-3;
/// Farthest distance on either side \[m\].
const REACH_M: f64 = 0.06;
/// Columns of a frame that are read.
const COLUMNS: usize = 12;
/// Lengths tried \[m\].
const LENGTHS_M: [f64; 8] = [0.003, 0.005, 0.007, 0.01, 0.014, 0.02, 0.03, 0.05];
/// Share of the line's light to which its shape is trusted, and grey levels beside it.
const TRUST: (f64, f64) = (0.004, 0.02);
/// Share to which fraction and length are known at best: classes average over ranges and slants.
const SHAPE: f64 = 0.03;
/// Least significance of f over the control.
const SIGNIFICANT: f64 = 6.0;
/// Least fraction worth a name.
const LEAST: f64 = 0.002;

/// One-sided haze.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Haze {
    /// Over the line's brightness.
    pub fraction: f64,
    /// Standard deviation.
    pub fraction_sd: f64,
    /// Distance over which it fades by e \[m\].
    pub length_m: f64,
    /// Standard deviation, from the lengths that do nearly as well \[m\].
    pub length_sd_m: f64,
    /// The same skirt on the near side, over the line's brightness.
    pub control: f64,
    /// Twice the gain in log likelihood over no haze.
    pub chi2_gain: f64,
    /// Rows by which it pulls a stripe finder of the stripe's own width \[px\].
    pub pull_px: f64,
    /// Established.
    pub found: bool,
}

/// Light over distance from the sheet.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Skirt {
    /// Distance, forward positive \[m\].
    pub d_m: Vec<f64>,
    /// Mean grey level.
    pub level: Vec<f64>,
    /// Pixels.
    pub count: Vec<f64>,
    /// Point spread in metres of distance.
    pub spread_m: f64,
    /// Distance per row \[m\].
    pub per_row_m: f64,
    /// Noise of a pixel \[grey levels\].
    pub noise_sd: f64,
}

/// Lays the frames' light over each other.
pub fn skirt(
    problem: &Problem<'_>,
    candidates: &[super::candidate::Candidate],
    fit: &Fitted,
) -> Option<Skirt> {
    let chosen: Vec<_> = fit.effects.iter().map(|k| &candidates[*k]).collect();
    let g = problem.geometry(&chosen, &fit.state.numbers)?;
    let half = (REACH_M / CLASS_M) as i64;
    let classes = (2 * half + 1) as usize;
    let (mut sums, mut counts) = (vec![0.0; classes], vec![0.0; classes]);
    let (mut per_row, mut noise, mut bins, mut frames) = (0.0, 0.0, 0.0, 0.0);
    for (run, poses) in problem.runs.iter().zip(&fit.state.poses) {
        for (seen, pose) in run.frames.iter().zip(poses) {
            let placed = Placed::from(&Pose::from_array(*pose));
            let levels = belongs(&g, &placed, &Rays::new(&g, seen), seen);
            noise += seen.profile.noise_sd;
            frames += 1.0;
            for (bin, level) in seen.bins.iter().zip(&levels.bins) {
                let height_m = *g.heights_m.get(*level)?;
                let off = |row: f64| {
                    g.meet(&placed, &g.ray(bin.column_px, row), height_m)
                        .map(|m| m.off_m)
                };
                let (Some(a), Some(b)) = (off(bin.row_px - 0.5), off(bin.row_px + 0.5)) else {
                    continue;
                };
                let slope = (a - b).abs();
                per_row += slope;
                bins += 1.0;
                let rows = (REACH_M / slope) as i64 + 1;
                let middle = bin.row_px.round() as i64;
                let from = bin.column_px.round() as i64 - COLUMNS as i64 / 2;
                for column in from..from + COLUMNS as i64 {
                    for row in middle - rows..=middle + rows {
                        let Some(grey) = pixel(&seen.image, column, row) else {
                            continue;
                        };
                        let ray = g.ray(column as f64, row as f64);
                        let Some(m) = g.meet(&placed, &ray, height_m) else {
                            continue;
                        };
                        // Where another surface is seen, its light lies elsewhere.
                        let class = (m.off_m / CLASS_M).round() as i64 + half;
                        let same = (g.surfaces.height_at_m(m.at_m) - height_m).abs() < 1e-9;
                        if let (Ok(class), true) = (usize::try_from(class), same)
                            && class < classes
                        {
                            sums[class] += grey;
                            counts[class] += 1.0;
                        }
                    }
                }
            }
        }
    }
    if bins < 10.0 {
        return None;
    }
    let spread = &problem.rig.camera.noise.blur_px;
    let per_row_m = per_row / bins;
    let kept: Vec<usize> = (0..classes).filter(|k| counts[*k] > 50.0).collect();
    Some(Skirt {
        d_m: kept
            .iter()
            .map(|k| (*k as i64 - half) as f64 * CLASS_M)
            .collect(),
        level: kept.iter().map(|k| sums[*k] / counts[*k]).collect(),
        count: kept.iter().map(|k| counts[*k]).collect(),
        spread_m: (spread * spread + 1.0 / 12.0).sqrt() * per_row_m,
        per_row_m,
        noise_sd: (noise / f64::max(frames, 1.0)).max(0.5),
    })
}

fn pixel(image: &GreyImage, column: i64, row: i64) -> Option<f64> {
    let column = usize::try_from(column)
        .ok()
        .filter(|c| *c < image.width_px)?;
    let row = usize::try_from(row).ok().filter(|r| *r < image.height_px)?;
    image
        .pixels
        .get(row * image.width_px + column)
        .map(|v| f64::from(*v))
}

fn cumulative(x: f64) -> f64 {
    0.5 * libm::erfc(-x * std::f64::consts::FRAC_1_SQRT_2)
}

/// exp(−d/L) for d > 0 under a point spread s.
fn fading(d: f64, length: f64, s: f64) -> f64 {
    // Far on the dark side the exponent would overflow before Φ makes it nothing.
    let x = d / s - s / length;
    if x < -30.0 {
        0.0
    } else {
        (0.5 * (s / length).powi(2) - d / length).exp() * cumulative(x)
    }
}

/// Mean of what a sensor shows that gives nothing below zero.
fn shown(level: f64, noise: f64) -> f64 {
    let x = level / noise;
    let density = (-0.5 * x * x).exp() / std::f64::consts::TAU.sqrt();
    level * cumulative(x) + noise * density
}

/// Inverse of an information matrix whose numbers differ by many powers of ten.
fn scaled_inverse(a: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let scale = a.diagonal().map(|v| 1.0 / v.max(1e-300).sqrt());
    let unit = DMatrix::from_fn(a.nrows(), a.ncols(), |i, j| a[(i, j)] * scale[i] * scale[j]);
    let inverse = nalgebra::Cholesky::new(unit)?.inverse();
    Some(DMatrix::from_fn(a.nrows(), a.ncols(), |i, j| {
        inverse[(i, j)] * scale[i] * scale[j]
    }))
}

/// b, A, centre, ln σ, f, control.
const NUMBERS: usize = 6;

impl Skirt {
    fn predicted(&self, p: &DVector<f64>, length_m: f64, d: f64) -> f64 {
        let sigma = p[3].exp();
        let total2 = sigma * sigma + self.spread_m * self.spread_m;
        let d = d - p[2];
        let line = sigma / total2.sqrt() * (-0.5 * d * d / total2).exp();
        let haze =
            p[4] * fading(d, length_m, self.spread_m) + p[5] * fading(-d, length_m, self.spread_m);
        shown(p[0] + p[1] * (line + haze), self.noise_sd)
    }

    /// Gauss–Newton; `free` of the numbers. Numbers, their covariance, χ².
    fn fitted(
        &self,
        start: DVector<f64>,
        length_m: f64,
        free: &[usize],
    ) -> Option<(DVector<f64>, DMatrix<f64>, f64)> {
        let mut p = start;
        let steps = [1e-3, 1e-3, 1e-8, 1e-5, 1e-6, 1e-6];
        let n = self.d_m.len();
        let peak = self.level.iter().copied().fold(0.0, f64::max);
        let weight: Vec<f64> = (0..n)
            .map(|k| {
                let trust = (TRUST.0 * self.level[k]).hypot(TRUST.1);
                1.0 / (self.noise_sd.powi(2) / self.count[k] + trust * trust)
            })
            .collect();
        let cost = |p: &DVector<f64>| -> f64 {
            (0..n)
                .map(|k| {
                    weight[k] * (self.level[k] - self.predicted(p, length_m, self.d_m[k])).powi(2)
                })
                .sum()
        };
        let mut now = cost(&p);
        let mut damping = 1e-3;
        let mut covariance = DMatrix::zeros(free.len(), free.len());
        for _ in 0..60 {
            let mut a = DMatrix::zeros(free.len(), free.len());
            let mut g = DVector::zeros(free.len());
            for (k, w) in weight.iter().enumerate() {
                let base = self.predicted(&p, length_m, self.d_m[k]);
                let j = DVector::from_iterator(
                    free.len(),
                    free.iter().map(|i| {
                        let mut q = p.clone();
                        q[*i] += steps[*i];
                        (self.predicted(&q, length_m, self.d_m[k]) - base) / steps[*i]
                    }),
                );
                g += &j * (w * (self.level[k] - base));
                a.ger(*w, &j, &j, 1.0);
            }
            covariance = scaled_inverse(&a)?;
            let mut moved = false;
            for _ in 0..12 {
                let mut damped = a.clone();
                for i in 0..free.len() {
                    damped[(i, i)] *= 1.0 + damping;
                }
                let step = scaled_inverse(&damped)? * &g;
                let mut q = p.clone();
                for (i, s) in free.iter().zip(step.iter()) {
                    q[*i] += s;
                }
                let next = cost(&q);
                if next <= now {
                    moved = now - next > 1e-4 * now.min(1.0);
                    (p, now) = (q, next);
                    damping = (damping * 0.1).max(1e-9);
                    break;
                }
                damping = (damping * 10.0).max(1e-6);
            }
            if !moved {
                break;
            }
        }
        (p[1] > 0.2 * peak && now.is_finite()).then_some((p, covariance, now))
    }

    /// The haze that explains this light best.
    pub fn haze(&self, sheet_m: f64) -> Option<Haze> {
        let peak = self.level.iter().copied().fold(0.0, f64::max);
        let low = self.level.iter().copied().fold(f64::INFINITY, f64::min);
        let start = DVector::from_vec(vec![
            low - 0.4 * self.noise_sd,
            1.1 * peak,
            0.0,
            sheet_m.ln(),
            0.0,
            0.0,
        ]);
        let all: Vec<usize> = (0..NUMBERS).collect();
        let (haze, near) = (4, 5);
        let (plain, _, without) = self.fitted(start, 0.01, &all[..4])?;
        type Tried = (f64, DVector<f64>, DMatrix<f64>, f64);
        let tried = |l: f64| -> Option<Tried> {
            let (p, c, chi2) = self.fitted(plain.clone(), l, &all)?;
            Some((l, p, c, chi2))
        };
        let mut fits: Vec<Tried> = LENGTHS_M.iter().filter_map(|l| tried(*l)).collect();
        fits.sort_by(|a, b| a.3.total_cmp(&b.3));
        let coarse = fits.first()?.0;
        fits.extend(
            [0.8, 0.87, 0.93, 1.07, 1.15, 1.25]
                .iter()
                .filter_map(|s| tried(coarse * s)),
        );
        fits.sort_by(|a, b| a.3.total_cmp(&b.3));
        let (length_m, p, c, chi2) = fits.first()?;
        // χ² over freedom beyond one: the line's shape is less well known than trusted.
        let unit = (chi2 / (self.d_m.len() as f64 - NUMBERS as f64).max(1.0)).max(1.0);
        let weights: Vec<(f64, f64)> = fits
            .iter()
            .map(|f| (f.0.ln(), (-0.5 * (f.3 - chi2) / unit).exp()))
            .collect();
        let sum: f64 = weights.iter().map(|w| w.1).sum();
        let mean = weights.iter().map(|w| w.0 * w.1).sum::<f64>() / sum;
        // Between two lengths of the grid nothing was tried.
        let grid = 0.07 / 12f64.sqrt();
        let spread = (weights
            .iter()
            .map(|w| (w.0 - mean).powi(2) * w.1)
            .sum::<f64>()
            / sum)
            .sqrt()
            .hypot(grid);
        let sd = |i: usize| (unit * c[(i, i)]).sqrt();
        let over = p[haze] - p[near].max(0.0);
        let over_sd =
            (unit * (c[(haze, haze)] + c[(near, near)] - 2.0 * c[(haze, near)]).max(0.0)).sqrt();
        let gain = (without - chi2) / unit;
        // What a matched stripe finder makes of the skirt: its slope against its own profile's.
        let total2 = p[3].exp().powi(2) + self.spread_m.powi(2);
        let (mut pull, mut norm) = (0.0, 0.0);
        for k in -60..=60 {
            let d = f64::from(k) * 0.1 * total2.sqrt();
            let slope = -d / total2 * (-0.5 * d * d / total2).exp();
            pull += -slope * p[haze] * fading(d, *length_m, self.spread_m);
            norm += slope * slope * p[3].exp() / total2.sqrt();
        }
        Some(Haze {
            fraction: p[haze],
            fraction_sd: sd(haze).hypot(p[haze] * (0.3 * spread).hypot(SHAPE)),
            length_m: *length_m,
            length_sd_m: length_m * spread.hypot(SHAPE),
            control: p[near],
            chi2_gain: gain,
            pull_px: pull / norm / self.per_row_m,
            found: over > SIGNIFICANT * over_sd
                && over > LEAST
                && gain > 30.0
                && p[haze] > 2.0 * p[near].abs(),
        })
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn light(fraction: f64, length_m: f64) -> Skirt {
        let mut s = Skirt {
            spread_m: 0.8e-3,
            per_row_m: 1e-3,
            noise_sd: 2.0,
            ..Skirt::default()
        };
        for k in -160..=160 {
            let d = f64::from(k) * CLASS_M;
            s.d_m.push(d);
            s.count.push(1e4);
            s.level.push(0.0);
        }
        let p = DVector::from_vec(vec![0.0, 200.0, 0.0, 0.002f64.ln(), fraction, 0.0]);
        s.level = s
            .d_m
            .iter()
            .map(|d| s.predicted(&p, length_m, *d))
            .collect();
        s
    }

    #[test]
    fn a_skirt_on_one_side_is_haze_and_none_is_none() {
        let found = light(0.03, 0.012).haze(0.0021).unwrap();
        assert!(found.found, "{found:?}");
        assert!((found.fraction - 0.03).abs() < 0.004, "{found:?}");
        let none = light(0.0, 0.01).haze(0.0021).unwrap();
        assert!(!none.found, "{none:?}");
    }
}
