//! The sum of squares: nodes where they are seen, the line where board and sheet meet, and what is known beforehand.
//!
//! Unknowns: the camera's numbers ([`CAMERA`]), the sheet's ([`SHEET`]), and six for each board, a turn about its origin
//! and a shift, in the camera's frame. A node leaves two residuals (pixels, whitened), a piece of the line one: the
//! distance of its ray's point on the board from the sheet, over how fast that changes across the line in the image
//! (Sampson's first-order distance, Hartley and Zisserman section 4.2.6).

use hydroline_numerics::least_squares::{LeastSquares, Normal};
use nalgebra::{DMatrix, DVector, Dyn, Matrix2, Matrix3, Rotation3, SMatrix, Vector2, Vector3};

use super::camera::{CAMERA, Lens, STEPS};
use super::sheet::{LaserSurface, SHEET};
use crate::map::lm::LmError;
use crate::map::refractive::Known;

/// Numbers that all views share.
pub(super) const SHARED: usize = CAMERA + SHEET;
const POSE: usize = 6;

/// Where a board is: board to camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Rotation.
    pub rotation: Matrix3<f64>,
    /// Its origin in the camera's frame \[m\].
    pub translation: Vector3<f64>,
}

impl Pose {
    /// A board's point in the camera's frame \[m\].
    pub fn at(&self, [x, y]: [f64; 2]) -> Vector3<f64> {
        self.rotation.column(0) * x + self.rotation.column(1) * y + self.translation
    }

    /// Where a ray meets the board's plane \[m\].
    pub fn meet(&self, from: &Vector3<f64>, along: &Vector3<f64>) -> Option<Vector3<f64>> {
        let normal = self.rotation.column(2);
        let far = normal.dot(&(self.translation - from)) / normal.dot(along);
        (far > 0.0 && far.is_finite()).then(|| from + along * far)
    }

    fn moved(&self, by: [f64; POSE]) -> Self {
        let turn = Rotation3::from_scaled_axis(Vector3::new(by[0], by[1], by[2]));
        Pose {
            rotation: turn.matrix() * self.rotation,
            translation: self.translation + Vector3::new(by[3], by[4], by[5]),
        }
    }
}

/// Values of all unknowns.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct State {
    pub lens: Lens,
    pub sheet: Option<LaserSurface>,
    pub poses: Vec<Pose>,
}

/// A node: where on the board \[m\], where seen \[px\], and what whitens that.
#[derive(Debug, Clone, Copy)]
pub(super) struct NodeTerm {
    pub board_m: [f64; 2],
    pub pixel: Vector2<f64>,
    pub whitener: Matrix2<f64>,
    /// Square root of its robust weight.
    pub weight: f64,
}

/// A piece of the line.
#[derive(Debug, Clone, Copy)]
pub(super) struct LineTerm {
    pub pixel: Vector2<f64>,
    pub across: Vector2<f64>,
    pub sd_px: f64,
    pub weight: f64,
}

/// What one view adds.
#[derive(Debug, Clone, Default)]
pub(super) struct ViewTerms {
    pub nodes: Vec<NodeTerm>,
    pub line: Vec<LineTerm>,
}

/// The whole sum.
pub(super) struct Bundle<'a> {
    pub views: &'a [ViewTerms],
    /// Of each shared number: what is known of it; an infinite sd: nothing.
    pub prior: &'a [Known; SHARED],
    /// Whether a shared number is fitted, else it stays.
    pub free: [bool; SHARED],
}

/// Residuals, whitened and weighted: of each view its nodes, then its line; and the priors' share.
#[derive(Debug, Clone, Default)]
pub(super) struct Residuals {
    pub values: Vec<f64>,
    pub penalty: f64,
}

/// Distance of a line's piece over its sd, and what its derivatives need.
struct Piece {
    point: Vector3<f64>,
    along: Vector3<f64>,
    /// One over (slope across the line × sd).
    scale: f64,
    residual: f64,
}

impl Bundle<'_> {
    fn shared(state: &State) -> [f64; SHARED] {
        std::array::from_fn(|k| match k.checked_sub(CAMERA) {
            None => state.lens.numbers[k],
            Some(s) => state.sheet.map_or(0.0, |sheet| sheet.numbers[s]),
        })
    }

    fn penalty(&self, state: &State) -> f64 {
        let x = Self::shared(state);
        let known = self.prior.iter().zip(x).zip(self.free);
        known
            .filter(|((p, _), free)| *free && p.sd.is_finite())
            .map(|((p, x), _)| ((x - p.value) / p.sd).powi(2))
            .sum()
    }

    fn node(state: &State, pose: &Pose, node: &NodeTerm) -> Option<Vector2<f64>> {
        let seen = state.lens.project(&pose.at(node.board_m))?;
        Some(node.whitener * (seen - node.pixel) * node.weight)
    }

    fn piece(state: &State, sheet: &LaserSurface, pose: &Pose, term: &LineTerm) -> Option<Piece> {
        let distance = |pixel: Vector2<f64>| {
            let (from, along) = state.lens.ray(&pixel)?;
            let point = pose.meet(&from, &along)?;
            Some((sheet.distance_m(&point), point, along))
        };
        const H: f64 = 0.05;
        let (off, point, along) = distance(term.pixel)?;
        let slope = (distance(term.pixel + term.across * H)?.0
            - distance(term.pixel - term.across * H)?.0)
            / (2.0 * H);
        let scale = term.weight / (slope.abs().max(1e-9) * term.sd_px);
        Some(Piece {
            point,
            along,
            scale,
            residual: off * scale,
        })
    }

    /// Derivatives of a piece by the shared numbers and its pose.
    fn line_row(
        &self,
        state: &State,
        sheet: &LaserSurface,
        pose: &Pose,
        term: &LineTerm,
    ) -> Option<(f64, SMatrix<f64, 1, SHARED>, SMatrix<f64, 1, POSE>)> {
        let piece = Self::piece(state, sheet, pose, term)?;
        let gradient = sheet.gradient(&piece.point) * piece.scale;
        let mut shared = SMatrix::<f64, 1, SHARED>::zeros();
        for k in (0..CAMERA).filter(|k| self.free[*k]) {
            let point = |by: f64| {
                let (from, along) = state.lens.moved(k, by).ray(&term.pixel)?;
                pose.meet(&from, &along)
            };
            let moved = (point(STEPS[k])? - point(-STEPS[k])?) / (2.0 * STEPS[k]);
            shared[k] = gradient.dot(&moved);
        }
        let by = sheet.by_numbers(&piece.point) * piece.scale;
        for k in 0..SHEET {
            shared[CAMERA + k] = by[k];
        }
        // The board's plane moves, and the point along its ray: ∂far = (N·∂T + ω·(N × (X − T))·(−1)) / (N·a).
        let normal: Vector3<f64> = pose.rotation.column(2).into();
        let share = gradient.dot(&piece.along) / normal.dot(&piece.along);
        let arm = normal.cross(&(piece.point - pose.translation)) * -share;
        let shift = normal * share;
        let own = SMatrix::<f64, 1, POSE>::from([
            [arm[0]],
            [arm[1]],
            [arm[2]],
            [shift[0]],
            [shift[1]],
            [shift[2]],
        ]);
        Some((piece.residual, shared, own))
    }

    fn node_rows(
        &self,
        state: &State,
        pose: &Pose,
        node: &NodeTerm,
    ) -> Option<(SMatrix<f64, 2, SHARED>, SMatrix<f64, 2, POSE>)> {
        let point = pose.at(node.board_m);
        let w = node.whitener * node.weight;
        let mut shared = SMatrix::<f64, 2, SHARED>::zeros();
        for k in (0..CAMERA).filter(|k| self.free[*k]) {
            let seen = |by: f64| state.lens.moved(k, by).project(&point);
            let by = (seen(STEPS[k])? - seen(-STEPS[k])?) / (2.0 * STEPS[k]);
            shared.set_column(k, &(w * by));
        }
        let h = 1e-6 * point[2].abs().max(0.01);
        let arm = point - pose.translation;
        let mut own = SMatrix::<f64, 2, POSE>::zeros();
        let mut by_point = SMatrix::<f64, 2, 3>::zeros();
        for k in 0..3 {
            let mut d = Vector3::zeros();
            d[k] = h;
            let by =
                (state.lens.project(&(point + d))? - state.lens.project(&(point - d))?) / (2.0 * h);
            by_point.set_column(k, &(w * by));
        }
        // A turn ω moves the point by ω × arm.
        own.fixed_columns_mut::<3>(0)
            .copy_from(&(-by_point * arm.cross_matrix()));
        own.fixed_columns_mut::<3>(3).copy_from(&by_point);
        Some((shared, own))
    }
}

/// Adds one residual's squares to the normal equations.
fn add(
    normal: &mut Normal<Dyn>,
    at: usize,
    shared: &[f64; SHARED],
    own: &[f64; POSE],
    residual: f64,
) {
    normal.cost += 0.5 * residual * residual;
    for i in 0..SHARED {
        if shared[i] == 0.0 {
            continue;
        }
        normal.gradient[i] += shared[i] * residual;
        for k in 0..=i {
            normal.hessian[(i, k)] += shared[i] * shared[k];
        }
        for (k, o) in own.iter().enumerate() {
            normal.hessian[(at + k, i)] += o * shared[i];
        }
    }
    for i in 0..POSE {
        normal.gradient[at + i] += own[i] * residual;
        for k in 0..=i {
            normal.hessian[(at + i, at + k)] += own[i] * own[k];
        }
    }
}

impl LeastSquares<Dyn> for Bundle<'_> {
    type Point = State;
    type Evaluated = Residuals;
    type Error = LmError;

    fn cost(&mut self, at: &State, out: &mut Residuals) -> Option<f64> {
        out.values.clear();
        for (view, pose) in self.views.iter().zip(&at.poses) {
            for node in &view.nodes {
                out.values.extend(Self::node(at, pose, node)?.iter());
            }
            if let Some(sheet) = &at.sheet {
                for term in &view.line {
                    out.values
                        .push(Self::piece(at, sheet, pose, term)?.residual);
                }
            }
        }
        out.penalty = self.penalty(at);
        let cost = 0.5 * (out.values.iter().map(|r| r * r).sum::<f64>() + out.penalty);
        cost.is_finite().then_some(cost)
    }

    fn begin(&mut self, at: &State, out: &mut Residuals) -> Result<(), LmError> {
        self.cost(at, out).map(drop).ok_or(LmError::NotFinite)
    }

    fn linearise(&mut self, at: &State, seen: &Residuals) -> Result<Normal<Dyn>, LmError> {
        let n = SHARED + POSE * at.poses.len();
        let mut normal = Normal {
            cost: 0.5 * seen.penalty,
            gradient: DVector::zeros(n),
            hessian: DMatrix::zeros(n, n),
        };
        let mut values = seen.values.iter();
        for (v, (view, pose)) in self.views.iter().zip(&at.poses).enumerate() {
            let place = SHARED + POSE * v;
            for node in &view.nodes {
                let (shared, own) = self.node_rows(at, pose, node).ok_or(LmError::NotFinite)?;
                for row in 0..2 {
                    let residual = values.next().copied().unwrap_or(0.0);
                    let shared = std::array::from_fn(|k| shared[(row, k)]);
                    let own = std::array::from_fn(|k| own[(row, k)]);
                    add(&mut normal, place, &shared, &own, residual);
                }
            }
            if let Some(sheet) = &at.sheet {
                for term in &view.line {
                    let (residual, shared, own) =
                        (self.line_row(at, sheet, pose, term)).ok_or(LmError::NotFinite)?;
                    values.next();
                    let shared =
                        std::array::from_fn(|k| if self.free[k] { shared[k] } else { 0.0 });
                    let own = std::array::from_fn(|k| own[k]);
                    add(&mut normal, place, &shared, &own, residual);
                }
            }
        }
        let x = Self::shared(at);
        for (k, (x, known)) in x.iter().zip(self.prior).enumerate() {
            if !self.free[k] {
                normal.hessian[(k, k)] = 1.0;
            } else if known.sd.is_finite() {
                normal.hessian[(k, k)] += known.sd.powi(-2);
                normal.gradient[k] += (x - known.value) / (known.sd * known.sd);
            }
        }
        for i in 0..n {
            for k in 0..i {
                normal.hessian[(k, i)] = normal.hessian[(i, k)];
            }
        }
        Ok(normal)
    }

    fn moved(&self, at: &State, step: &DVector<f64>) -> Option<State> {
        let mut next = at.clone();
        for k in (0..SHARED).filter(|k| self.free[*k]) {
            match (k.checked_sub(CAMERA), &mut next.sheet) {
                (None, _) => next.lens.numbers[k] += step[k],
                (Some(s), Some(sheet)) => sheet.numbers[s] += step[k],
                _ => {}
            }
        }
        for (v, pose) in next.poses.iter_mut().enumerate() {
            *pose = pose.moved(std::array::from_fn(|k| step[SHARED + POSE * v + k]));
        }
        let n = &next.lens.numbers;
        let sound =
            n[0] > 10.0 && (0.2..5.0).contains(&n[1]) && (0.9..2.0).contains(&n[12]) && n[9] >= 0.0;
        sound.then_some(next)
    }
}
