//! Sub-pixel nodes: the pattern itself, blurred, is fitted to the pixels around each node.
//!
//! Model: I = o + g_x x + g_y y + c P(x − δ), P the line crossing, dot or chessboard corner
//! in the local perspective, with a Gaussian blur. δ and its covariance come from one
//! Gauss–Newton fit of six numbers with Tukey's weights: pixels that a laser line or a
//! block's edge spoils drop out, and a node that loses too many of them is discarded.

use std::convert::Infallible;

use hydroline_numerics::least_squares::{Ended, LeastSquares, Normal, Options, Scaling, minimise};
use hydroline_rigs::{Board, BoardPattern};
use nalgebra::{Const, Matrix2, Matrix3, SMatrix, SVector};

use super::image::Grey;
use super::marks::Local;
use super::tone::Tone;
use crate::map::geometry::{apply, homography_jacobian};

#[derive(Debug, Clone, Copy)]
pub(super) struct Refined {
    pub position: [f64; 2],
    pub covariance: Matrix2<f64>,
    pub contrast: f64,
    /// rms of what the model leaves \[grey levels\].
    pub rms: f64,
    /// The part of it that is alike in neighbouring pixels: what no noise explains \[grey levels\].
    pub misfit: f64,
}

/// More noise than this share of the contrast, and whatever is fitted is noise.
const NOISIEST: f64 = 0.3;

impl Refined {
    /// Whether the pattern explains its pixels; a crossing of which only one line is there
    /// leaves a fifth of its contrast.
    pub fn is_pattern(&self) -> bool {
        let contrast = self.contrast.abs();
        self.rms < 0.1 * contrast
            || (self.misfit < 0.1 * contrast && self.rms < NOISIEST * contrast)
    }
}

/// Image, board, lattice's map, blur and curve that all nodes of an image share.
pub(super) struct Refiner<'a> {
    pub image: &'a Grey<'a>,
    pub board: &'a Board,
    /// Index to image, and back.
    pub to_image: Matrix3<f64>,
    pub to_index: Matrix3<f64>,
    /// Point spread including the pixel's own size, across the rims along η and across those along ξ \[px\]: a hand that
    /// moves blurs one of them more than the other.
    pub blur_px: [f64; 2],
    /// The camera's curve, where the board shows that it has one.
    pub tone: Option<Tone>,
}

/// Rounds of a node's fit.
const ROUNDS: usize = 11;
/// A fit that still moves by more in a round will hardly converge in those that are left \[px\]: where
/// there is no node it wanders to the last round, and such fits were half of the time of a
/// frame without a board.
const FARTHEST_STEP_PX: [f64; ROUNDS] = {
    let free = f64::INFINITY;
    [
        free, free, free, free, free, 0.5, 0.3, 0.18, 0.11, free, free,
    ]
};

/// Half the patch in node pitches: clear of blocks in the cells, and of key discs.
pub(super) const PATCH_PITCH: f64 = 0.3;
/// Half the patch at most \[px\]; dots need all of their rim.
const PATCH_PX: f64 = 7.0;

/// o, g_x, g_y, c, δ_x, δ_y.
pub(super) type Unknowns = SVector<f64, 6>;

/// Steps without damping: weights and blur change from round to round, so that costs are not comparable. Levels and
/// pixels have sizes of their own.
const SEARCH: Options = Options {
    damping: None,
    iterations_max: ROUNDS - 1,
    scaling: Scaling::AsGiven,
    jitter: 0.0,
    ..Options::DEFAULT
};

/// The fit of one node.
pub(super) struct Patch<'a> {
    refiner: &'a Refiner<'a>,
    /// Image to lattice.
    pub m: Matrix2<f64>,
    /// Local steps along ξ and η \[px\].
    steps: [[f64; 2]; 2],
    /// Offset from the start \[px\], lattice coordinates at δ = 0, grey level.
    pub pixels: Vec<[f64; 5]>,
    residuals: Vec<f64>,
    /// Robust sd of the residuals \[grey levels\].
    scale: f64,
    /// Linearisations made.
    rounds: usize,
    /// Of the last one.
    weight_sum: f64,
    square_sum: f64,
}

impl Patch<'_> {
    /// Two rounds to come near with every other pixel, then all.
    fn stride(round: usize) -> usize {
        if round < 2 { 2 } else { 1 }
    }

    /// The scale for the next round from the residuals of the last, at a new point.
    fn rescale(&mut self, theta: &Unknowns) {
        let Some(round) = self.rounds.checked_sub(1).filter(|r| *r >= 1) else {
            return;
        };
        let stride = Self::stride(round);
        let mut sizes: Vec<f64> = (self.residuals.iter().step_by(stride))
            .map(|e| e.abs())
            .collect();
        let k = sizes.len() / 2;
        let (_, median, _) = sizes.select_nth_unstable_by(k, f64::total_cmp);
        // Most of a patch is plain: its median is insensitive to the marks' rims, which
        // a start 2 px off makes large. Tolerance goes down as the fit closes in.
        let annealed = 0.2 * theta[3].abs() * 0.4f64.powi(round as i32);
        self.scale = (1.4826 * *median)
            .max(annealed)
            .max(0.04 * theta[3].abs())
            .max(0.7);
    }

    /// Part that neighbouring residuals have in common, as an rms: noise is each pixel's own, a wrong model is
    /// not. Half the mean square of their differences is the noise.
    fn misfit(&self) -> f64 {
        let sound = |e: f64| e.abs() <= 5.0 * self.scale;
        let (mut product, mut count) = (0.0, 0.0);
        for (p, e) in self.pixels.windows(2).zip(self.residuals.windows(2)) {
            let beside = p[0][1] == p[1][1] && p[1][0] - p[0][0] < 2.5;
            if beside && sound(e[0]) && sound(e[1]) {
                product += e[0] * e[1];
                count += 1.0;
            }
        }
        (product / f64::max(count, 1.0)).max(0.0).sqrt()
    }

    /// Share of pixels that the model does not explain.
    fn lost(&self) -> f64 {
        let far = |e: &&f64| e.abs() > 5.0 * self.scale;
        self.residuals.iter().filter(far).count() as f64 / self.pixels.len() as f64
    }
}

impl LeastSquares<Const<6>> for Patch<'_> {
    type Point = Unknowns;
    type Evaluated = ();
    type Error = Infallible;

    fn begin(&mut self, _: &Unknowns, (): &mut ()) -> Result<(), Infallible> {
        Ok(())
    }

    fn linearise(&mut self, theta: &Unknowns, (): &()) -> Result<Normal<Const<6>>, Infallible> {
        self.rescale(theta);
        let round = self.rounds;
        self.rounds += 1;
        let shift = self.m * nalgebra::Vector2::new(theta[4], theta[5]);
        // Plain arrays: their loops unroll, and this is where the frame's time goes.
        let mut products = [[0.0f64; 6]; 6];
        let mut sums = [0.0f64; 6];
        // A start 2 px off a sharp rim would see no slope at all: begin with a soft one.
        let soft = [1.5, 0.6].get(round).copied().unwrap_or(0.0);
        let local = Local::new(
            self.refiner.board,
            &self.m,
            self.refiner.blur_px.map(|s| s.hypot(soft)),
        );
        // Before the levels are known it is not known which of them is light.
        let levels = round > 0;
        let (mut weight_sum, mut square_sum) = (0.0, 0.0);
        let reach = 1.0 / (5.0 * self.scale);
        let pixels = self.pixels.iter().zip(&mut self.residuals);
        for (p, residual) in pixels.step_by(Self::stride(round)) {
            let at = [p[2] - shift[0], p[3] - shift[1]];
            let (value, gradient) = if levels {
                self.refiner.shown(&local, at, theta[3])
            } else {
                local.pattern(at[0], at[1])
            };
            let model = theta[0] + theta[1] * p[0] + theta[2] * p[1] + theta[3] * value;
            let e = p[4] - model;
            *residual = e;
            let t = e * reach;
            let left = (1.0 - t * t).max(0.0);
            let weight = left * left;
            // δ moves the pattern: ∂I/∂δ = −c ∇P.
            let row = [
                1.0,
                p[0],
                p[1],
                value,
                -theta[3] * gradient[0],
                -theta[3] * gradient[1],
            ];
            for i in 0..6 {
                let weighted = weight * row[i];
                for k in 0..=i {
                    products[i][k] += weighted * row[k];
                }
                sums[i] += weighted * e;
            }
            weight_sum += weight;
            square_sum += weight * e * e;
        }
        (self.weight_sum, self.square_sum) = (weight_sum, square_sum);
        Ok(Normal {
            cost: 0.5 * square_sum,
            // Residuals are measured minus model, `row` is of the model.
            gradient: -Unknowns::from(sums),
            hessian: SMatrix::from_fn(|i, k| products[i.max(k)][i.min(k)]),
        })
    }

    fn moves(&self, _: &Unknowns, _: &Unknowns, k: usize) -> bool {
        // The first round finds levels and contrast; δ stays.
        k < 4 || self.rounds > 1
    }

    fn moved(&self, theta: &Unknowns, step: &Unknowns) -> Option<Unknowns> {
        let next = theta + step;
        let far = step[4].hypot(step[5]) > FARTHEST_STEP_PX[self.rounds - 1];
        let moved = next[4].hypot(next[5]);
        let room = 0.3 * self.steps[0][0].hypot(self.steps[0][1]).max(8.0);
        (!far && moved <= room).then_some(next)
    }

    fn negligible(&self, _: &Unknowns, _: &Unknowns, step: &Unknowns) -> bool {
        // Weights that flicker keep the last hundredths of a pixel moving.
        let round = self.rounds - 1;
        let still = [0.004, 0.02, 0.01, 0.01, 0.01, 0.02, 0.03][round.clamp(2, 8) - 2];
        round >= 2 && step[4].hypot(step[5]) < still
    }
}

/// A node's fit, converged.
pub(super) struct ConvergedFit<'a> {
    pub theta: Unknowns,
    hessian: SMatrix<f64, 6, 6>,
    pub patch: Patch<'a>,
}

impl ConvergedFit<'_> {
    /// The refined node, if it is one: by its own measure only, others may know more.
    pub fn refined(&self, start: [f64; 2]) -> Option<Refined> {
        let ConvergedFit { theta, patch, .. } = self;
        let rms = (patch.square_sum / patch.weight_sum).sqrt();
        let inverse = self.hessian.try_inverse()?;
        let covariance = if patch.refiner.tone.is_some() {
            self.sandwich(&inverse)
        } else {
            // Quantisation alone leaves 0.29 grey levels.
            let variance = (patch.square_sum / (patch.weight_sum - 6.0).max(1.0)).max(0.3 * 0.3);
            inverse.fixed_view::<2, 2>(4, 4) * variance
        };
        let whole = || (patch.refiner).both_lines(&patch.pixels, theta, &patch.m);
        if patch.lost() > 0.3 || rms == 0.0 || !whole() {
            return None;
        }
        let covariance = covariance + Matrix2::identity() * 1e-4; // 0.01 px: what no blur model gets right
        (covariance.iter().all(|v| v.is_finite()) && covariance.determinant() > 0.0).then_some(
            Refined {
                position: [start[0] + theta[4], start[1] + theta[5]],
                covariance,
                contrast: theta[3],
                rms,
                misfit: patch.misfit(),
            },
        )
    }

    /// Rms that the fit leaves, as a share of the contrast.
    pub fn relative(&self) -> f64 {
        let rms = (self.patch.square_sum / self.patch.weight_sum).sqrt();
        rms / self.theta[3].abs().max(1.0)
    }

    /// H⁻¹ (Σ w² e² J Jᵀ) H⁻¹: a curve that is steep near dark makes noise larger there, and what the
    /// position hangs on are the rims.
    fn sandwich(&self, inverse: &SMatrix<f64, 6, 6>) -> Matrix2<f64> {
        let mut meat = SMatrix::<f64, 6, 6>::zeros();
        self.each(
            &self.patch.refiner.local(&self.patch.m),
            |row, e, weight| {
                let square = (weight * e).powi(2).max((0.3 * weight).powi(2));
                meat += row * row.transpose() * square;
            },
        );
        let freed = self.patch.weight_sum / (self.patch.weight_sum - 6.0).max(1.0);
        (inverse * meat * inverse).fixed_view::<2, 2>(4, 4) * freed
    }

    /// Row of derivatives, residual and Tukey's weight of every pixel.
    pub fn each(&self, local: &Local, mut take: impl FnMut(&Unknowns, f64, f64)) {
        let (theta, patch) = (&self.theta, &self.patch);
        let shift = patch.m * nalgebra::Vector2::new(theta[4], theta[5]);
        for p in &patch.pixels {
            let (value, gradient) =
                (patch.refiner).shown(local, [p[2] - shift[0], p[3] - shift[1]], theta[3]);
            let e = p[4] - theta[0] - theta[1] * p[0] - theta[2] * p[1] - theta[3] * value;
            let left = (1.0 - (e / (5.0 * patch.scale)).powi(2)).max(0.0);
            let (gx, gy) = (-theta[3] * gradient[0], -theta[3] * gradient[1]);
            take(
                &Unknowns::from([1.0, p[0], p[1], value, gx, gy]),
                e,
                left * left,
            );
        }
    }
}

impl Refiner<'_> {
    /// Appearance of the marks at a node under the blur.
    pub fn local(&self, m: &Matrix2<f64>) -> Local {
        Local::new(self.board, m, self.blur_px)
    }

    /// The pattern as the camera shows it, and its gradient.
    #[inline(always)]
    pub fn shown(&self, local: &Local, [u, v]: [f64; 2], contrast: f64) -> (f64, [f64; 2]) {
        let (value, gradient) = local.pattern_of(u, v, contrast > 0.0);
        match &self.tone {
            None => (value, gradient),
            Some(tone) => {
                let (value, slope) = tone.shown(value, local.range(), contrast > 0.0);
                (value, gradient.map(|g| g * slope))
            }
        }
    }

    /// Fits the node `index` near `start`; `steps` are the local steps along ξ and η \[px\].
    pub fn refine(
        &self,
        index: [i32; 2],
        start: [f64; 2],
        steps: [[f64; 2]; 2],
    ) -> Option<Refined> {
        self.converge(index, start, steps)?.refined(start)
    }

    /// The fit of one node, if it comes to rest.
    pub fn converge(
        &self,
        index: [i32; 2],
        start: [f64; 2],
        steps: [[f64; 2]; 2],
    ) -> Option<ConvergedFit<'_>> {
        let ideal = index.map(f64::from);
        let (c, s) = (
            Matrix2::new(steps[0][0], steps[1][0], steps[0][1], steps[1][1]),
            self.blur_px[0].max(self.blur_px[1]),
        );
        let m = c.try_inverse()?;
        // Second order from the global homography, first order from the neighbours.
        let local_jacobian = m * homography_jacobian(&self.to_image, ideal)?;
        let anchor = apply(&self.to_image, ideal)?;
        let dot_radius = match self.board.pattern {
            BoardPattern::Dots { diameter_m } => 0.5 * diameter_m / self.board.pitch_m,
            _ => 0.0,
        };
        let dots = dot_radius > 0.0;
        // A soft rim is wide: seen through a narrow ring, more blur and more contrast look alike.
        let rim_px = (2.5 * s).max(3.5);
        let reach = if dots { 22.0 } else { PATCH_PX };
        let clear = self.clear_of_marker(&m);
        let half = |k: usize| {
            (PATCH_PITCH * (steps[0][k].abs() + steps[1][k].abs()))
                .min(reach)
                .ceil() as i64
        };
        let (hc, hr) = (half(0), half(1));
        let middle = [start[0].round() as i64, start[1].round() as i64];
        let (w, h) = (self.image.width() as i64, self.image.height() as i64);
        if middle[0] - hc < 0 || middle[0] + hc >= w || middle[1] - hr < 0 || middle[1] + hr >= h {
            return None;
        }
        // Pixels of the patch with their lattice coordinates at δ = 0.
        let mut pixels: Vec<[f64; 5]> = Vec::with_capacity(324);
        // A large dot has more rim than its middle needs: every other pixel, as on a chessboard.
        let sparse = dots && hc + hr > 20;
        for r in middle[1] - hr..=middle[1] + hr {
            for q in middle[0] - hc..=middle[0] + hc {
                if sparse && (q + r) % 2 != 0 {
                    continue;
                }
                let (x, y) = (q as f64 - start[0], r as f64 - start[1]);
                let seen = apply(&self.to_index, [anchor[0] + x, anchor[1] + y])?;
                let (ds, dt) = (seen[0] - ideal[0], seen[1] - ideal[1]);
                let u = local_jacobian[(0, 0)] * ds + local_jacobian[(0, 1)] * dt;
                let v = local_jacobian[(1, 0)] * ds + local_jacobian[(1, 1)] * dt;
                // Of a dot and its surroundings only what lies near the rim has information.
                let far = dots && {
                    let rho = (u * u + v * v).sqrt().max(1e-9);
                    let size = (u * m.row(0) + v * m.row(1)).norm() / rho;
                    ((rho - dot_radius) / size).abs() > rim_px
                };
                // Where a marker's bits are, or their blur.
                let far = far || (u.abs().min(v.abs()) > clear);
                if !far && u.abs() <= PATCH_PITCH + 0.05 && v.abs() <= PATCH_PITCH + 0.05 {
                    pixels.push([x, y, u, v, f64::from(self.image.at(q, r))]);
                }
            }
        }
        if pixels.len() < 20 {
            return None;
        }
        let mut patch = Patch {
            refiner: self,
            m,
            steps,
            residuals: vec![0.0; pixels.len()],
            pixels,
            scale: f64::INFINITY,
            rounds: 0,
            weight_sum: 0.0,
            square_sum: 0.0,
        };
        let found = minimise(&mut patch, SVector::zeros(), &SEARCH).ok()?;
        if found.ended != Ended::Step {
            return None;
        }
        Some(ConvergedFit {
            theta: found.at,
            hessian: found.normal.hessian,
            patch,
        })
    }
}
