//! One smooth map of the whole board: which nodes it does not explain, and where those must be that
//! are still missing.
//!
//! A homography and, for lens and port, a cubic on top (it leaves 0.1 px of a strong lens).

use hydroline_rigs::{Board, BoardPattern};
use nalgebra::{Matrix3, SMatrix, SVector};

use super::lattice::Index;
use super::refine::{Refined, Refiner};
use crate::map::geometry::{apply, homography};

const TERMS: usize = 10;

/// Index to image for a whole board.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Smooth {
    h: Matrix3<f64>,
    high: [f64; 2],
    cubic: SMatrix<f64, TERMS, 2>,
    /// Farther off than this \[px\] is a stray.
    limit_px: f64,
}

impl Smooth {
    /// Fitted to the nodes, and how far each lies off \[px\]; `None` when there is no such map.
    pub fn fit(nodes: &[(Index, Refined)]) -> Option<(Self, Vec<f64>)> {
        let pairs: Vec<_> = nodes
            .iter()
            .map(|(k, r)| (k.map(f64::from), r.position))
            .collect();
        let mut map = Smooth {
            h: homography(&pairs)?,
            high: [0, 1].map(|k| {
                let high = nodes.iter().map(|n| n.0[k]).max().unwrap_or(1);
                f64::from(high.max(1))
            }),
            cubic: SMatrix::zeros(),
            limit_px: f64::INFINITY,
        };
        let terms: Vec<(SVector<f64, TERMS>, [f64; 2])> = pairs
            .iter()
            .map(|(k, p)| {
                let q = apply(&map.h, *k)?;
                Some((map.terms(*k), [p[0] - q[0], p[1] - q[1]]))
            })
            .collect::<Option<_>>()?;
        let mut off = vec![0.0f64; terms.len()];
        for _ in 0..6 {
            let mut sorted = off.clone();
            sorted.sort_by(f64::total_cmp);
            let scale = sorted[sorted.len() / 2].max(0.05);
            let mut normal = SMatrix::<f64, TERMS, TERMS>::identity() * 1e-6;
            let mut right = SMatrix::<f64, TERMS, 2>::zeros();
            for ((row, e), off) in terms.iter().zip(&off) {
                // Cauchy: a stray of many pixels hardly pulls.
                let weight = 1.0 / (1.0 + (off / (2.0 * scale)).powi(2));
                normal += row * row.transpose() * weight;
                right += row * nalgebra::RowVector2::new(e[0], e[1]) * weight;
            }
            map.cubic = normal.cholesky()?.solve(&right);
            for ((row, e), off) in terms.iter().zip(&mut off) {
                let model = map.cubic.transpose() * row;
                *off = (e[0] - model[0]).hypot(e[1] - model[1]);
            }
        }
        Some((map, off))
    }

    fn terms(&self, k: [f64; 2]) -> SVector<f64, TERMS> {
        let x = 2.0 * k[0] / self.high[0] - 1.0;
        let y = 2.0 * k[1] / self.high[1] - 1.0;
        SVector::from([
            1.0,
            x,
            y,
            x * x,
            x * y,
            y * y,
            x * x * x,
            x * x * y,
            x * y * y,
            y * y * y,
        ])
    }

    /// Where the lattice point `k` is seen.
    pub fn at(&self, k: [f64; 2]) -> Option<[f64; 2]> {
        let q = apply(&self.h, k)?;
        let off = self.cubic.transpose() * self.terms(k);
        Some([q[0] + off[0], q[1] + off[1]])
    }

    /// The same map in an image so many times larger.
    pub fn enlarged(mut self, times: f64) -> Self {
        // Means of blocks: the middle of a block's first pixel lies half a pixel inside.
        let shift = 0.5 * (times - 1.0);
        let enlarge = Matrix3::new(times, 0.0, shift, 0.0, times, shift, 0.0, 0.0, 1.0);
        self.h = enlarge * self.h;
        self.cubic *= times;
        self.limit_px *= times;
        self
    }

    fn steps(&self, k: [f64; 2]) -> Option<[[f64; 2]; 2]> {
        let step = |axis: usize| {
            let (mut a, mut b) = (k, k);
            a[axis] += 0.5;
            b[axis] -= 0.5;
            let (a, b) = (self.at(a)?, self.at(b)?);
            Some([a[0] - b[0], a[1] - b[1]])
        };
        Some([step(0)?, step(1)?])
    }
}

/// Drops nodes that one smooth map of the whole board does not explain; `None` when there is
/// no such map.
pub(super) fn drop_strays(nodes: &mut Vec<(Index, Refined)>) -> Option<Smooth> {
    const STRAY_PX: f64 = 0.15;
    // No lens leaves this much after a cubic: a map that does is distorted by false nodes.
    const WORST_STRAY_PX: f64 = 1.0;
    let (mut map, off) = Smooth::fit(nodes)?;
    let mut sorted = off.clone();
    sorted.sort_by(f64::total_cmp);
    map.limit_px = (6.0 * sorted[sorted.len() / 2]).clamp(STRAY_PX, WORST_STRAY_PX);
    let mut k = 0;
    nodes.retain(|_| {
        k += 1;
        off[k - 1] < map.limit_px
    });
    Some(map)
}

/// Looks once more where nodes are missing. Growth may have stepped aside at a key disc or a block,
/// or missed a row in the shade; the map of the others says where to look to a fraction of a pixel.
/// Inside the lattice every place; beside it a whole row or column at a time, of which half must be
/// there, and one more than the board has: what goes on beyond it is another board, or a floor.
pub(super) fn fill(
    refiner: &Refiner<'_>,
    board: &Board,
    map: &Smooth,
    contrast: f64,
    nodes: &mut Vec<(Index, Refined)>,
    holds: impl Fn(Index, &Refined) -> bool,
) {
    let look = |k: Index| {
        let place = k.map(f64::from);
        if !stands_out(refiner, map, place, 0.25 * contrast) {
            return None;
        }
        let start = map.at(place)?;
        let found = refiner.refine(k, start, map.steps(place)?)?;
        let [c, r] = found.position;
        let near = (c - start[0]).hypot(r - start[1]) < map.limit_px;
        (near && holds(k, &found)).then_some((k, found))
    };
    let bounds = |nodes: &[(Index, Refined)]| {
        [0, 1].map(|axis| {
            let of = nodes.iter().map(|n| n.0[axis]);
            (of.clone().min().unwrap_or(0), of.max().unwrap_or(-1))
        })
    };
    let [(i0, i1), (j0, j1)] = bounds(nodes);
    let known: std::collections::HashSet<Index> = nodes.iter().map(|n| n.0).collect();
    let inside = (j0..=j1).flat_map(|j| (i0..=i1).map(move |i| [i, j]));
    nodes.extend(inside.filter(|k| !known.contains(k)).filter_map(look));
    let wanted = [board.columns, board.rows];
    for axis in [0, 1] {
        for far in [false, true] {
            let b = bounds(nodes);
            let extent = b.map(|(low, high)| high - low + 1);
            // Which way round the board lies: only one direction can hold the larger number.
            let most = if extent[1 - axis] > wanted[0].min(wanted[1]) as i32 {
                wanted[0].min(wanted[1])
            } else {
                wanted[0].max(wanted[1])
            };
            if extent[axis] > most as i32 {
                continue;
            }
            let at = if far { b[axis].1 + 1 } else { b[axis].0 - 1 };
            let across = b[1 - axis];
            let row: Vec<(Index, Refined)> = (across.0..=across.1)
                .filter_map(|k| look(if axis == 0 { [at, k] } else { [k, at] }))
                .collect();
            if row.len() as i32 * 2 > across.1 - across.0 {
                nodes.extend(row);
            }
        }
    }
    nodes.sort_by_key(|n| n.0);
}

/// Whether anything like a node stands out at a place: asked before the fit, which takes longest
/// where there is nothing to fit.
fn stands_out(refiner: &Refiner<'_>, map: &Smooth, [i, j]: [f64; 2], least: f64) -> bool {
    let grey = |di: f64, dj: f64| {
        let [c, r] = map.at([i + di, j + dj])?;
        Some(f64::from(refiner.image.sample(c, r)))
    };
    let four = |d: f64| Some([grey(d, d)?, grey(-d, -d)?, grey(d, -d)?, grey(-d, d)?]);
    let difference = || match refiner.board.pattern {
        // The light squares are half dark with markers.
        BoardPattern::Charuco { .. } => Some(f64::INFINITY),
        BoardPattern::Chessboard => {
            let [a, b, c, d] = four(0.2)?;
            Some((0.25 * (a + b - c - d)).abs())
        }
        // Discs and blocks are in the middle of cells, and only in some of them.
        _ => {
            let mut around = four(0.3)?;
            around.sort_by(f64::total_cmp);
            Some(0.5 * (around[1] + around[2]) - grey(0.0, 0.0)?)
        }
    };
    difference().is_some_and(|d| d > least)
}
