//! The laser line across a board in the hand.
//!
//! On a board a line crosses light and dark marks, and every rim of a mark looks like a line. But the lattice says where
//! rims are: only plain parts of cells are looked at. There a ridge is sought that is straight on the board (a plane cuts
//! a plane, whatever the lens), and a Gaussian ridge is fitted to the pixels of short pieces of it.

mod ridge;

use hydroline_rigs::{Board, BoardPattern};
use nalgebra::Matrix2;

use super::Grey;
use super::in_hand::InHand;
use super::smooth::Smooth;

/// A piece of the line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinePoint {
    /// Its middle: column and row \[px\].
    pub pixel: [f64; 2],
    /// Unit vector across the line.
    pub across: [f64; 2],
    /// Standard deviation across the line \[px\].
    pub sd_px: f64,
}

/// Why a board has no line.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum NoLine {
    #[error(
        "no laser line lies on the board; hold the board so that the line crosses it, and darken the room until the line is the brightest thing on a square"
    )]
    NotOnBoard,
    #[error(
        "only {pieces} pieces of the laser line can be measured on plain parts of the board, {needed} are needed; let it cross more squares, or use larger ones"
    )]
    TooShort { pieces: usize, needed: usize },
}

/// Fewest pieces of a line: two say where it is, the others that it is one.
const FEWEST: usize = 8;

/// Cells around the nodes and which part of them is plain.
pub(super) struct Chart<'a> {
    map: &'a Smooth,
    board: &'a Board,
    /// Whether the squares with an even sum of indices are light; of a chessboard.
    light_even: bool,
    /// Lowest and highest lattice coordinate looked at.
    pub low: [f64; 2],
    pub high: [f64; 2],
    /// Rims spoil this much of a cell beside them.
    margin: [f64; 2],
    /// Size of a cell in the board's middle, the smaller way \[px\].
    pitch_px: f64,
}

impl Chart<'_> {
    /// Pixel of a lattice coordinate.
    pub fn at(&self, k: [f64; 2]) -> Option<[f64; 2]> {
        self.map.at(k)
    }

    /// d pixel / d lattice.
    pub fn jacobian(&self, k: [f64; 2]) -> Option<Matrix2<f64>> {
        let h = 0.05;
        let (e, w) = (self.at([k[0] + h, k[1]])?, self.at([k[0] - h, k[1]])?);
        let (n, s) = (self.at([k[0], k[1] + h])?, self.at([k[0], k[1] - h])?);
        Some(Matrix2::new(e[0] - w[0], n[0] - s[0], e[1] - w[1], n[1] - s[1]) / (2.0 * h))
    }

    /// Whether a lattice coordinate lies on a plain part of the board.
    pub fn plain(&self, k: [f64; 2]) -> bool {
        let inside = (0..2).all(|a| k[a] > self.low[a] && k[a] < self.high[a]);
        if !inside {
            return false;
        }
        let off = k.map(|v| (v - v.round()).abs());
        match self.board.pattern {
            BoardPattern::Dots { diameter_m } => {
                let radius = 0.5 * diameter_m / self.board.pitch_m;
                off[0].hypot(off[1]) > radius + self.margin[0].max(self.margin[1])
            }
            BoardPattern::Lines { line_m } => {
                let half = 0.5 * line_m / self.board.pitch_m;
                (0..2).all(|a| off[a] > half + self.margin[a])
            }
            BoardPattern::Chessboard => (0..2).all(|a| off[a] > self.margin[a]),
            // Markers fill the light squares.
            BoardPattern::Charuco { .. } => {
                let even = k
                    .map(|v| v.floor() as i64)
                    .iter()
                    .sum::<i64>()
                    .rem_euclid(2)
                    == 0;
                even != self.light_even && (0..2).all(|a| off[a] > self.margin[a])
            }
        }
    }
}

/// The line over the board's plain parts.
///
/// # Errors
/// [`NoLine`].
pub fn find_line(
    image: &Grey<'_>,
    board: &Board,
    found: &InHand,
) -> Result<Vec<LinePoint>, NoLine> {
    let chart = chart(board, found).ok_or(NoLine::NotOnBoard)?;
    let bright = outliers(image, &chart, found.noise);
    let line = straight(image, &chart, &bright, found.noise).ok_or(NoLine::NotOnBoard)?;
    let pieces = ridge::pieces(image, &chart, &line, found.noise);
    if pieces.len() < FEWEST {
        return Err(NoLine::TooShort {
            pieces: pieces.len(),
            needed: FEWEST,
        });
    }
    Ok(pieces)
}

fn chart<'a>(board: &'a Board, found: &'a InHand) -> Option<Chart<'a>> {
    let map = found.smooth.as_ref()?;
    let beyond = (board.margin_m / board.pitch_m).clamp(0.0, 1.0);
    let top = found.lattice.map(|n| f64::from(n) - 1.0);
    let mut chart = Chart {
        map,
        light_even: found.light_even,
        board,
        low: [-beyond; 2],
        high: top.map(|t| t + beyond),
        margin: [0.0; 2],
        pitch_px: 0.0,
    };
    let j = chart.jacobian(top.map(|t| 0.5 * t))?;
    // Size of a cell across each of its rims: area over the rim's length.
    let area = j.determinant().abs();
    let widths = [area / j.column(1).norm(), area / j.column(0).norm()];
    chart.pitch_px = widths[0].min(widths[1]);
    // Three blurs and a pixel from a rim its flank is gone.
    chart.margin = widths.map(|w| ((1.0 + 2.5 * found.blur_px) / w).clamp(0.06, 0.3));
    (chart.pitch_px > 5.0).then_some(chart)
}

/// Lattice coordinates brighter than their cell, with by how much \[grey levels\].
fn outliers(image: &Grey<'_>, chart: &Chart<'_>, noise: f64) -> Vec<([f64; 2], f64)> {
    let n = (chart.pitch_px.round() as usize).clamp(6, 40);
    let mut bright = Vec::new();
    let cells = |a: usize| (chart.low[a].floor() as i32)..(chart.high[a].ceil() as i32);
    for j in cells(1) {
        for i in cells(0) {
            let mut seen: Vec<([f64; 2], f64)> = Vec::with_capacity(n * n);
            for y in 0..n {
                for x in 0..n {
                    let k =
                        [(i, x), (j, y)].map(|(c, v)| f64::from(c) + (v as f64 + 0.5) / n as f64);
                    if chart.plain(k)
                        && let Some(p) = chart.at(k)
                        && inside(image, p)
                    {
                        seen.push((k, f64::from(image.sample(p[0], p[1]))));
                    }
                }
            }
            if seen.len() < 12 {
                continue;
            }
            let mut levels: Vec<f64> = seen.iter().map(|s| s.1).collect();
            levels.sort_by(f64::total_cmp);
            let middle = levels[levels.len() / 2];
            // The darker half says how much a plain square scatters, line or not.
            let scatter = middle - levels[levels.len() / 4];
            let least = (4.0 * scatter).max(4.0 * noise).max(LEAST_LEVELS);
            bright.extend(
                seen.iter()
                    .filter(|s| s.1 - middle > least)
                    .map(|s| (s.0, s.1 - middle)),
            );
        }
    }
    bright
}

/// A line less bright than this over its background is lost in compression and uneven print \[grey levels\].
const LEAST_LEVELS: f64 = 6.0;

pub(super) fn inside(image: &Grey<'_>, p: [f64; 2]) -> bool {
    p[0] >= 1.0
        && p[1] >= 1.0
        && p[0] < image.width() as f64 - 2.0
        && p[1] < image.height() as f64 - 2.0
}

/// A straight piece on the board: a point, a unit direction, and from where to where along it, lattice units.
#[derive(Debug, Clone, Copy)]
pub(super) struct Straight {
    pub from: [f64; 2],
    pub along: [f64; 2],
    pub reach: [f64; 2],
}

impl Straight {
    pub fn at(&self, t: f64) -> [f64; 2] {
        [0, 1].map(|a| self.from[a] + t * self.along[a])
    }
}

/// Step along a candidate, in cells.
const STEP: f64 = 0.125;
/// Candidates tried: with a fifth of the bright places on the line 1 in 25 pairs is of it.
const TRIALS: usize = 600;

/// Ridges that a line must have more than gaps: some three cells. Of 26 photographs of boards without a laser two reach 8 by chance.
const FEWEST_RIDGES: f64 = 14.0;

/// The straight line along which most plain places carry a ridge.
fn straight(
    image: &Grey<'_>,
    chart: &Chart<'_>,
    bright: &[([f64; 2], f64)],
    noise: f64,
) -> Option<Straight> {
    if bright.len() < 6 {
        return None;
    }
    let mut state = 0x9e37_79b9_7f4a_7c15_u64;
    let mut next = |n: usize| {
        // Marsaglia's xorshift: the same line in every run.
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state % n as u64) as usize
    };
    let mut best: Option<(f64, Straight)> = None;
    for _ in 0..TRIALS {
        let (a, b) = (bright[next(bright.len())].0, bright[next(bright.len())].0);
        if let Some(found) = score(image, chart, a, b, noise)
            && best.as_ref().is_none_or(|(s, _)| found.0 > *s)
        {
            best = Some(found);
        }
    }
    let (mut held, mut line) = best?;
    // Total least squares over the bright places near it, and once more with what that changed.
    for _ in 0..3 {
        let near: Vec<[f64; 2]> = (bright.iter().map(|b| b.0))
            .filter(|p| {
                let d = [p[0] - line.from[0], p[1] - line.from[1]];
                let t = d[0] * line.along[0] + d[1] * line.along[1];
                (d[0] * line.along[1] - d[1] * line.along[0]).abs() < 0.15
                    && t > line.reach[0] - 0.3
                    && t < line.reach[1] + 0.3
            })
            .collect();
        let Some([a, b]) = principal(&near) else {
            break;
        };
        match score(image, chart, a, b, noise) {
            Some((s, better)) if s >= held => (held, line) = (s, better),
            _ => break,
        }
    }
    (held >= FEWEST_RIDGES).then_some(line)
}

/// Two points of the principal axis of points.
fn principal(points: &[[f64; 2]]) -> Option<[[f64; 2]; 2]> {
    let n = points.len() as f64;
    if n < 4.0 {
        return None;
    }
    let mean = [0, 1].map(|a| points.iter().map(|p| p[a]).sum::<f64>() / n);
    let moment = |a: usize, b: usize| -> f64 {
        points
            .iter()
            .map(|p| (p[a] - mean[a]) * (p[b] - mean[b]))
            .sum()
    };
    let angle = 0.5 * (2.0 * moment(0, 1)).atan2(moment(0, 0) - moment(1, 1));
    let (s, c) = angle.sin_cos();
    Some([
        [mean[0] - 2.0 * c, mean[1] - 2.0 * s],
        [mean[0] + 2.0 * c, mean[1] + 2.0 * s],
    ])
}

/// Ridges minus plain places without one over the best stretch of the line through two points.
fn score(
    image: &Grey<'_>,
    chart: &Chart<'_>,
    a: [f64; 2],
    b: [f64; 2],
    noise: f64,
) -> Option<(f64, Straight)> {
    let d = [b[0] - a[0], b[1] - a[1]];
    let length = d[0].hypot(d[1]);
    if length < 1.5 {
        return None;
    }
    let line = Straight {
        from: a,
        along: d.map(|v| v / length),
        reach: [0.0; 2],
    };
    let span = (chart.high[0] - chart.low[0]).hypot(chart.high[1] - chart.low[1]);
    let count = (span / STEP) as i32;
    // The stretch with the largest sum (Kadane).
    let (mut sum, mut start) = (0.0, -count);
    let (mut best, mut reach) = (0.0, [0.0; 2]);
    for k in -count..=count {
        let t = f64::from(k) * STEP;
        let Some(ridge) = ridge_at(image, chart, &line, t, noise) else {
            continue;
        };
        if sum <= 0.0 {
            (sum, start) = (0.0, k);
        }
        sum += if ridge { 1.0 } else { -1.0 };
        if sum > best {
            best = sum;
            reach = [f64::from(start) * STEP, t];
        }
    }
    (reach[1] - reach[0] > 1.5).then_some((best, Straight { reach, ..line }))
}

/// Whether the line's place `t` is a ridge; `None` where it is not on a plain part with its sides.
fn ridge_at(
    image: &Grey<'_>,
    chart: &Chart<'_>,
    line: &Straight,
    t: f64,
    noise: f64,
) -> Option<bool> {
    let k = line.at(t);
    if !chart.plain(k) {
        return None;
    }
    let p = chart.at(k).filter(|p| inside(image, *p))?;
    let j = chart.jacobian(k)?;
    let along = j * nalgebra::Vector2::from(line.along);
    let across = nalgebra::Vector2::new(-along[1], along[0]).normalize();
    let inverse = j.try_inverse()?;
    let level = |off: f64| -> Option<f64> {
        let q = [p[0] + off * across[0], p[1] + off * across[1]];
        let dk = inverse * (across * off);
        let at = [k[0] + dk[0], k[1] + dk[1]];
        // The same cell, else the other side is another grey.
        let same = (0..2).all(|a| at[a].floor() == k[a].floor());
        (same && chart.plain(at) && inside(image, q)).then(|| f64::from(image.sample(q[0], q[1])))
    };
    let top = [-1.0, 0.0, 1.0]
        .into_iter()
        .filter_map(level)
        .fold(f64::NEG_INFINITY, f64::max);
    let mut judged = None;
    for side in [4.0, 7.0, 11.0] {
        if let (Some(left), Some(right)) = (level(-side), level(side)) {
            let least = (3.0 * noise).max(LEAST_LEVELS);
            let ridge = top - left.max(right) > least;
            judged = Some(judged.unwrap_or(false) || ridge);
        }
    }
    judged
}
