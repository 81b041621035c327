//! The likelihood of all frames about a state, with its derivatives.

use super::super::evidence::Quadratic;
use super::super::geometry::{Geometry, Placed};
use super::super::model::{Belongs, Kind, Rays, Shared, belongs, kinds, residuals};
use super::super::observe::Seen;
use super::work::Work;
use super::{Free, Left, UNIT};
use hydroline_calib::Pose;
use nalgebra::{DMatrix, DVector};

/// Of a prior's sd: how far a shared number or one of an effect is moved for its derivative.
const STEP: f64 = 1e-4;
/// Step of a pose for its derivative, in [`UNIT`].
const POSE_STEP: f64 = 1e-3;
/// √2π.
const TAU_ROOT: f64 = 2.506_628_274_631_000_2;

/// The likelihood about a state.
pub(super) struct Linear {
    pub(super) quadratic: Quadratic,
    /// The state in the fit's units.
    pub(super) x: DVector<f64>,
    pub(super) belongs: Vec<Belongs>,
    pub(super) left: Vec<Left>,
    /// Responsibility of the proper model for each measurement, and its derivatives by frame.
    pub(super) weights: Vec<f64>,
    pub(super) rows: Vec<DVector<f64>>,
}

/// Geometries and shared numbers that a frame's derivatives are taken about.
struct About<'a> {
    geometry: &'a Geometry,
    /// Geometries with one of the effects' numbers moved, and by how much.
    moved: &'a [(Geometry, f64)],
    /// Shared numbers, and the same with one of them moved.
    values: &'a [f64],
    shifted: &'a [Vec<f64>],
}

impl Work<'_, '_> {
    pub(super) fn linear(&self) -> Option<Linear> {
        let g = self.problem.geometry(&self.chosen, &self.state.numbers)?;
        let mut all = Vec::with_capacity(self.frames());
        for (r, f, seen) in self.problem.frames() {
            let placed = Placed::from(&Pose::from_array(self.state.poses[r][f]));
            all.push(belongs(&g, &placed, &Rays::new(&g, seen), seen));
        }
        self.linear_about(&all)
    }

    /// One geometry per number of the effects, moved by a little; and by how much, in units of its prior.
    fn moved(&self) -> Option<Vec<(Geometry, f64)>> {
        let mut moved = Vec::new();
        if self.free == Free::Poses {
            return Some(moved);
        }
        for (e, c) in self.chosen.iter().enumerate() {
            for k in 0..c.neutral.len() {
                let mut numbers = self.state.numbers.clone();
                // Away from a limit of the law.
                let sign = if numbers[e][k] + STEP * c.prior_sd[k] > c.info.parameters[k].limits.1 {
                    -1.0
                } else {
                    1.0
                };
                numbers[e][k] += sign * STEP * c.prior_sd[k];
                let geometry = self.problem.geometry(&self.chosen, &numbers)?;
                moved.push((geometry, sign * STEP));
            }
        }
        Some(moved)
    }

    /// The shared numbers with one of them moved by [`STEP`] of its prior, for each.
    fn shifted(&self, values: &[f64]) -> Vec<Vec<f64>> {
        if self.free == Free::Poses {
            return Vec::new();
        }
        let one = |(k, s): (usize, &Shared)| {
            let mut v = values.to_vec();
            v[k] += STEP * s.prior_sd();
            v
        };
        self.problem.shared.iter().enumerate().map(one).collect()
    }

    /// Residuals of a frame and what its pose, the shared numbers and the effects' make of the prediction.
    fn slopes(
        &self,
        about: &About<'_>,
        seen: &Seen,
        belongs: &Belongs,
        pose: [f64; 6],
    ) -> (Vec<f64>, DMatrix<f64>) {
        let problem = self.problem;
        let (g, moved, values, shifted) =
            (about.geometry, about.moved, about.values, about.shifted);
        let (mut base, mut other) = (Vec::new(), Vec::new());
        let placed = Placed::from(&Pose::from_array(pose));
        let rays = Rays::new(g, seen);
        let off = |g: &Geometry, placed: &Placed, rays: &Rays, values: &[f64], out: &mut _| {
            let shared = (problem.shared.as_slice(), values);
            residuals(g, placed, rays, seen, belongs, &problem.widths, shared, out);
        };
        off(g, &placed, &rays, values, &mut base);
        let n = base.len();
        let mut j = DMatrix::zeros(n, 6 + shifted.len() + moved.len());
        let mut put = |column: usize, other: &[f64], h: f64| {
            for (k, (o, b)) in other.iter().zip(&base).enumerate() {
                let d = (o - b) / h;
                // Slope of the prediction: the residual falls as it grows.
                j[(k, column)] = if d.is_finite() { -d } else { 0.0 };
            }
        };
        for d in 0..6 {
            let mut p = pose;
            p[d] += POSE_STEP * UNIT;
            let placed = Placed::from(&Pose::from_array(p));
            off(g, &placed, &rays, values, &mut other);
            put(d, &other, POSE_STEP);
        }
        for (k, v) in shifted.iter().enumerate() {
            off(g, &placed, &rays, v, &mut other);
            put(6 + k, &other, STEP);
        }
        for (k, (g, h)) in moved.iter().enumerate() {
            off(g, &placed, &Rays::new(g, seen), values, &mut other);
            put(6 + shifted.len() + k, &other, *h);
        }
        (base, j)
    }

    /// Likelihood and derivatives, measurements belonging as given.
    pub(super) fn linear_about(&self, all: &[Belongs]) -> Option<Linear> {
        let problem = self.problem;
        let g = problem.geometry(&self.chosen, &self.state.numbers)?;
        let moved = self.moved()?;
        let values = problem.shared_values(&self.state.shared);
        let shifted = self.shifted(&values);
        let size = self.size();
        let mut a = DMatrix::zeros(size, size);
        let mut gradient = DVector::zeros(size);
        let (mut value, mut left, mut weights, mut rows) =
            (0.0, Vec::new(), Vec::new(), Vec::new());
        let tail = 6 * self.frames();
        let about = About {
            geometry: &g,
            moved: &moved,
            values: &values,
            shifted: &shifted,
        };
        for (i, ((r, f, seen), belongs)) in problem.frames().zip(all).enumerate() {
            let pose = self.state.poses[r][f];
            let (base, j) = self.slopes(&about, seen, belongs, pose);
            let place = |k: usize| if k < 6 { 6 * i + k } else { tail + k - 6 };
            let ats = seen
                .bins
                .iter()
                .chain(&seen.bins)
                .map(|b| [b.column_px, b.row_px])
                .chain(seen.edges.iter().map(|e| [e.column_px, e.row_px]));
            for (k, ((kind, own_sd), at_px)) in
                kinds(seen, belongs).into_iter().zip(ats).enumerate()
            {
                let sd = own_sd.hypot(self.state.floors[kind as usize]);
                let off = base[k];
                let (log, w) = mixture(kind, off, sd);
                value += log;
                let row = j.row(k).transpose();
                if w > 1e-6 {
                    let scale = w / (sd * sd);
                    for p in 0..row.len() {
                        let at = place(p);
                        gradient[at] += scale * row[p] * off;
                        for q in 0..=p {
                            a[(at, place(q))] += scale * row[p] * row[q];
                        }
                    }
                }
                left.push(Left {
                    run: r,
                    frame: f,
                    kind,
                    at_px,
                    off_px: off,
                    sd_px: sd,
                });
                weights.push(w);
                rows.push(row);
            }
        }
        for p in 0..size {
            for q in 0..p {
                a[(q, p)] = a[(p, q)];
            }
        }
        let x = self.x();
        let ax = &a * &x;
        let c = value - gradient.dot(&x) - 0.5 * x.dot(&ax);
        Some(Linear {
            quadratic: Quadratic {
                b: &gradient + &ax,
                a,
                c,
            },
            x,
            belongs: all.to_vec(),
            left,
            weights,
            rows,
        })
    }
}

/// Log density of a residual that may be a stray, and the probability that it is none.
fn mixture(kind: Kind, off: f64, sd: f64) -> (f64, f64) {
    let (stray, range) = kind.stray();
    let outside = (stray / range).ln();
    let inside = if off.is_finite() {
        (1.0 - stray).ln() - 0.5 * (off / sd).powi(2) - (sd * TAU_ROOT).ln()
    } else {
        f64::NEG_INFINITY
    };
    let top = inside.max(outside);
    let log = top + ((inside - top).exp() + (outside - top).exp()).ln();
    (log, (inside - log).exp())
}
