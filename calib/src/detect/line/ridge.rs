//! A Gaussian ridge fitted to the pixels of short pieces of the line.

use nalgebra::{SMatrix, SVector, Vector2};

use super::super::Grey;
use super::{Chart, LinePoint, Straight, inside};

/// Length of a piece \[px\]: long enough that noise averages out, short enough that it is straight.
const PIECE_PX: f64 = 7.0;
/// Levels from here on may be clipped.
const CLIPPED: f64 = 250.0;
/// Widths tried, standard deviation \[px\].
const WIDTHS: [f64; 5] = [1.0, 1.6, 2.6, 4.2, 6.8];

/// A fitted piece.
struct Piece {
    point: LinePoint,
    /// Along the line, lattice units.
    t: f64,
    /// From the straight line, across \[px\].
    off: f64,
    sigma_px: f64,
}

/// Pieces along the line that are ridges and lie on one smooth curve.
pub(super) fn pieces(
    image: &Grey<'_>,
    chart: &Chart<'_>,
    line: &Straight,
    noise: f64,
) -> Vec<LinePoint> {
    let places = places(chart, line);
    // One laser, one width: the median of what a sample of pieces shows.
    let stride = (places.len() / 24).max(1);
    let mut widths: Vec<f64> = (places.iter().step_by(stride))
        .filter_map(|&t| {
            let fits = WIDTHS
                .iter()
                .filter_map(|&w| fit(image, chart, line, t, w, noise));
            fits.min_by(|a, b| a.point.sd_px.total_cmp(&b.point.sd_px))
        })
        .map(|p| p.sigma_px)
        .collect();
    if widths.is_empty() {
        return Vec::new();
    }
    widths.sort_by(f64::total_cmp);
    let width = widths[widths.len() / 2];
    let mut found: Vec<Piece> = (places.iter())
        .filter_map(|&t| fit(image, chart, line, t, width, noise))
        .filter(|p| p.sigma_px > 0.5 * width && p.sigma_px < 2.0 * width)
        .collect();
    let scatter = settle(&mut found);
    let sound = found.iter().map(|p| LinePoint {
        sd_px: p.point.sd_px.max(scatter),
        ..p.point
    });
    sound.collect()
}

/// Places along the line a piece apart.
fn places(chart: &Chart<'_>, line: &Straight) -> Vec<f64> {
    let mut places = Vec::new();
    let mut t = line.reach[0];
    while t <= line.reach[1] {
        places.push(t);
        let step = chart
            .jacobian(line.at(t))
            .map_or(0.0, |j| (j * Vector2::from(line.along)).norm());
        if step < 1.0 {
            break;
        }
        t += PIECE_PX / step;
    }
    places
}

/// Drops what lies off a smooth curve (a parabola: lens and homography left little) and says how the rest scatters \[px\].
fn settle(found: &mut Vec<Piece>) -> f64 {
    let mut scatter = 0.0;
    for _ in 0..6 {
        let n = found.len();
        if n < 6 {
            return scatter;
        }
        let middle = found.iter().map(|p| p.t).sum::<f64>() / n as f64;
        let span = found
            .iter()
            .map(|p| (p.t - middle).abs())
            .fold(1e-9, f64::max);
        let row = |p: &Piece| {
            let x = (p.t - middle) / span;
            SVector::<f64, 3>::new(1.0, x, x * x)
        };
        let mut weights = vec![1.0; n];
        let mut left = vec![0.0; n];
        for _ in 0..8 {
            let mut normal = SMatrix::<f64, 3, 3>::identity() * 1e-9;
            let mut right = SVector::<f64, 3>::zeros();
            for (p, w) in found.iter().zip(&weights) {
                let r = row(p);
                normal += r * r.transpose() * *w;
                right += r * (p.off * w);
            }
            let Some(curve) = normal.cholesky().map(|c| c.solve(&right)) else {
                return scatter;
            };
            for (e, p) in left.iter_mut().zip(found.iter()) {
                *e = p.off - curve.dot(&row(p));
            }
            let mut sizes: Vec<f64> = left.iter().map(|e| e.abs()).collect();
            sizes.sort_by(f64::total_cmp);
            scatter = 1.4826 * sizes[n / 2];
            for (w, e) in weights.iter_mut().zip(&left) {
                *w = 1.0 / (1.0 + (e / (2.0 * scatter.max(0.02))).powi(2));
            }
        }
        let mut k = 0;
        found.retain(|_| {
            k += 1;
            left[k - 1].abs() < 4.0 * scatter.max(0.02)
        });
        if found.len() == n {
            break;
        }
    }
    scatter
}

/// Background, slope across, height, place across and log of the width of one piece.
fn fit(
    image: &Grey<'_>,
    chart: &Chart<'_>,
    line: &Straight,
    t: f64,
    width: f64,
    noise: f64,
) -> Option<Piece> {
    let k = line.at(t);
    let p = chart.at(k).filter(|p| inside(image, *p))?;
    let j = chart.jacobian(k)?;
    let along = (j * Vector2::from(line.along)).normalize();
    let across = Vector2::new(-along[1], along[0]);
    let pixels = gather(image, chart, k, p, &along, &across, width)?;
    let mut x = SVector::<f64, 5>::new(0.0, 0.0, 0.0, 0.0, width.ln());
    let mut sorted: Vec<f64> = pixels.iter().map(|q| q[1]).collect();
    sorted.sort_by(f64::total_cmp);
    x[0] = sorted[sorted.len() / 4];
    x[2] = sorted[sorted.len() - 1 - sorted.len() / 10] - x[0];
    let mut information = SMatrix::<f64, 5, 5>::zeros();
    let mut squares = 0.0;
    for round in 0..12 {
        information.fill(0.0);
        let mut right = SVector::<f64, 5>::zeros();
        squares = 0.0;
        let sigma = x[4].exp();
        for &[off, level] in &pixels {
            let z = (off - x[3]) / sigma;
            let bell = (-0.5 * z * z).exp();
            let e = level - x[0] - x[1] * off - x[2] * bell;
            let row = SVector::from([1.0, off, bell, x[2] * bell * z / sigma, x[2] * bell * z * z]);
            information += row * row.transpose();
            right += row * e;
            squares += e * e;
        }
        // The width is the laser's: a piece may change it by a third.
        information[(4, 4)] += squares / pixels.len() as f64 * 9.0;
        right[4] -= squares / pixels.len() as f64 * 9.0 * (x[4] - width.ln());
        let mut damped = information;
        for d in 0..5 {
            damped[(d, d)] *= if round < 3 { 1.1 } else { 1.0 + 1e-9 };
        }
        let step = damped.cholesky()?.solve(&right);
        x += step;
        if x[3].abs() > 2.0 * width + 2.0 || (x[4] - width.ln()).abs() > 1.2 {
            return None;
        }
        if step[3].abs() < 1e-4 && round > 3 {
            break;
        }
    }
    let free = pixels.len().checked_sub(5)?.max(1) as f64;
    let left = (squares / free).sqrt();
    let variance = (left.max(0.5 * noise).max(0.3)).powi(2) * information.try_inverse()?[(3, 3)];
    let sd_px = variance.sqrt();
    // Of both sides something must be there, and the ridge must stand out of what it leaves.
    let sigma_px = x[4].exp();
    let sides = [-1.0, 1.0].map(|s| {
        pixels
            .iter()
            .filter(|q| s * (q[0] - x[3]) > 0.7 * sigma_px)
            .count()
    });
    let sound = x[2] > 4.0 && x[2] > 3.0 * left && sd_px < 0.5 && sides.iter().all(|n| *n >= 6);
    sound.then(|| Piece {
        point: LinePoint {
            pixel: [p[0] + x[3] * across[0], p[1] + x[3] * across[1]],
            across: across.into(),
            sd_px,
        },
        t,
        off: x[3],
        sigma_px,
    })
}

/// Plain, unclipped pixels of the cell around a piece: how far across \[px\], and the level.
fn gather(
    image: &Grey<'_>,
    chart: &Chart<'_>,
    k: [f64; 2],
    p: [f64; 2],
    along: &Vector2<f64>,
    across: &Vector2<f64>,
    width: f64,
) -> Option<Vec<[f64; 2]>> {
    let inverse = chart.jacobian(k)?.try_inverse()?;
    let half = 4.0 * width + 3.0;
    let reach = half.max(0.5 * PIECE_PX).ceil() as i64 + 1;
    let cell = k.map(f64::floor);
    let mut pixels = Vec::new();
    let (c0, r0) = (p[0].round() as i64, p[1].round() as i64);
    for r in r0 - reach..=r0 + reach {
        for c in c0 - reach..=c0 + reach {
            let d = Vector2::new(c as f64 - p[0], r as f64 - p[1]);
            let off = d.dot(across);
            if d.dot(along).abs() > 0.5 * PIECE_PX || off.abs() > half {
                continue;
            }
            let dk = inverse * d;
            let at = [k[0] + dk[0], k[1] + dk[1]];
            let level = f64::from(image.at(c, r));
            let same = (0..2).all(|a| at[a].floor() == cell[a]);
            if same && level < CLIPPED && chart.plain(at) && inside(image, [c as f64, r as f64]) {
                pixels.push([off, level]);
            }
        }
    }
    (pixels.len() >= 20).then_some(pixels)
}
