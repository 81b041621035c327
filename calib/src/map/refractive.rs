//! A camera behind a flat port: rays refracted twice by Snell's law on their way to the sheet.
//!
//! For the case that the water changes between calibration and use: the fit separates
//! what belongs to lens and port from the water's index, and the same map can then be
//! asked for another index. One view of one plane cannot separate all of them by itself
//! (distance against focal length against index), so the fit takes priors: what the
//! rig's builder knows. In one and the same water `homography` is simpler and as good.
//!
//! Camera frame: X right, Y down, Z along the axis. Port: plane at `distance` from the
//! entrance pupil along its normal n ∝ (tilt_x, tilt_y, 1), glass of known thickness.
//! Refraction as vectors: w = μ a + (√(1 − μ²(1 − c²)) − μ c) n, c = a·n, μ = n₁/n₂
//! (Glassner, An Introduction to Ray Tracing, 1989).

use nalgebra::{DMatrix, Matrix2, Matrix2xX, Matrix3, Rotation3, Vector2, Vector3};
use serde::{Deserialize, Serialize};

use super::geometry::{apply, homography, rows, whitener};
use super::homography::reweight;
use super::lm::minimise;
use super::{MapError, Node, PointAndSlopes, Region};
use crate::plane::PlanePoint;

/// rotation vector (3), translation \[m\] (3), f \[px\], k₁, k₂, port distance \[m\],
/// tilt x, tilt y, n_water, c_x, c_y \[px\].
const PARAMETERS: usize = 15;
const FOCAL: usize = 6;
const WATER: usize = 12;
const FEWEST: usize = 16;
/// Half widths of the differences, by parameter.
const STEPS: [f64; PARAMETERS] = [
    1e-6, 1e-6, 1e-6, 1e-6, 1e-6, 1e-6, 1e-3, 1e-5, 1e-5, 1e-6, 1e-6, 1e-6, 1e-6, 1e-3, 1e-3,
];

/// A value with its standard deviation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Known {
    /// Expected value.
    pub value: f64,
    /// Standard deviation.
    pub sd: f64,
}

impl Known {
    /// A value and its standard deviation.
    pub fn new(value: f64, sd: f64) -> Self {
        Known { value, sd }
    }
}

/// Prior knowledge of camera, port and water.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RefractivePrior {
    /// Focal length in air \[px\].
    pub focal_px: Known,
    /// Principal point, column \[px\].
    pub cx_px: Known,
    /// Principal point, row \[px\].
    pub cy_px: Known,
    /// Entrance pupil to the port's inner face \[m\].
    pub port_distance_m: Known,
    /// Tilt of the port's normal against the axis, both directions \[rad\].
    pub port_tilt_rad: Known,
    /// Thickness of the port \[m\].
    pub glass_m: f64,
    /// Index of the port (acrylic 1.49).
    pub n_glass: f64,
    /// Index of the water (fresh 1.333, sea 1.340).
    pub n_water: Known,
    /// Radial distortion k₁ (Brown, in air).
    pub k1: Known,
    /// Radial distortion k₂.
    pub k2: Known,
}

/// A flat-port camera fitted to nodes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RefractiveMap {
    parameters: [f64; PARAMETERS],
    glass_m: f64,
    n_glass: f64,
    /// √(χ²/dof), at least 1.
    pub noise_scale: f64,
    /// Sheet to image, without refraction: where the inverse starts to search.
    #[serde(rename = "rough")]
    sheet_to_image: [[f64; 3]; 3],
    region: Region,
    #[serde(with = "rows")]
    covariance: DMatrix<f64>,
}

impl RefractiveMap {
    /// Fits camera pose, lens, port and water to the nodes under the priors.
    ///
    /// # Errors
    /// [`MapError::TooFewNodes`], [`MapError::Degenerate`] or [`MapError::Fit`].
    pub fn fit(nodes: &[Node], prior: &RefractivePrior) -> Result<Self, MapError> {
        if nodes.len() < FEWEST {
            return Err(MapError::TooFewNodes {
                method: "refractive",
                found: nodes.len(),
                needed: FEWEST,
            });
        }
        let pairs: Vec<_> = nodes
            .iter()
            .map(|n| ([n.xi_m, n.eta_m], [n.column_px, n.row_px]))
            .collect();
        let sheet_to_image = homography(&pairs).ok_or(MapError::Degenerate)?;
        let mut start = [0.0; PARAMETERS];
        start[..6]
            .copy_from_slice(&start_pose(&sheet_to_image, prior).ok_or(MapError::Degenerate)?);
        let known = [
            prior.focal_px,
            prior.k1,
            prior.k2,
            prior.port_distance_m,
            prior.port_tilt_rad,
            prior.port_tilt_rad,
            prior.n_water,
            prior.cx_px,
            prior.cy_px,
        ];
        for (k, prior) in known.iter().enumerate() {
            start[FOCAL + k] = prior.value;
        }
        let mut map = RefractiveMap {
            parameters: start,
            glass_m: prior.glass_m,
            n_glass: prior.n_glass,
            noise_scale: 1.0,
            sheet_to_image: std::array::from_fn(|i| {
                std::array::from_fn(|k| sheet_to_image[(i, k)])
            }),
            region: Region::hull(nodes.iter().map(|n| [n.xi_m, n.eta_m])),
            covariance: DMatrix::zeros(PARAMETERS, PARAMETERS),
        };
        let whiteners: Vec<Matrix2<f64>> =
            nodes.iter().map(|n| whitener(&n.covariance_px2)).collect();
        let mut weights = vec![1.0; nodes.len()];
        let count = 2 * nodes.len();
        for _round in 0..4 {
            let fit = minimise(
                &map.parameters.clone(),
                &STEPS,
                count + known.len(),
                |x, out| {
                    let ray = Rays::new(x, map.glass_m, map.n_glass);
                    for (i, node) in nodes.iter().enumerate() {
                        // The misfit on the sheet, seen back in pixels: one Newton step of
                        // the inverse, exact to first order and the misfit is small.
                        let Some(e) = ray.meet(node.column_px, node.row_px).and_then(|p| {
                            let j = ray.jacobian(node.column_px, node.row_px)?;
                            Some(
                                j.try_inverse()?
                                    * Vector2::new(p[0] - node.xi_m, p[1] - node.eta_m),
                            )
                        }) else {
                            return false;
                        };
                        let e = whiteners[i] * e;
                        out[2 * i] = weights[i] * e[0];
                        out[2 * i + 1] = weights[i] * e[1];
                    }
                    for (k, prior) in known.iter().enumerate() {
                        out[count + k] = (x[FOCAL + k] - prior.value) / prior.sd.max(1e-12);
                    }
                    true
                },
            )
            .map_err(|source| MapError::Fit {
                method: "refractive",
                source,
            })?;
            map.parameters.copy_from_slice(fit.parameters.as_slice());
            let data = &fit.residuals.as_slice()[..count];
            // The priors count as data for as many parameters as there are.
            let free = (count - 6) as f64;
            map.noise_scale = (fit.cost / free).sqrt().max(1.0);
            map.covariance = fit.covariance * map.noise_scale.powi(2);
            if !reweight(data, &mut weights) {
                break;
            }
        }
        Ok(map)
    }

    /// The same camera and port in other water. The uncertainty of the index is taken as
    /// that of the new value, and no longer tied to the other parameters.
    pub fn in_water(&self, n_water: Known) -> Self {
        let mut other = self.clone();
        other.parameters[WATER] = n_water.value;
        // Conditional on the fitted index the other parameters are better known than
        // marginally; keeping the marginal is the safe side.
        for k in 0..PARAMETERS {
            other.covariance[(k, WATER)] = 0.0;
            other.covariance[(WATER, k)] = 0.0;
        }
        other.covariance[(WATER, WATER)] = n_water.sd * n_water.sd;
        other
    }

    /// Fitted index of the water with its standard deviation.
    pub fn n_water(&self) -> Known {
        Known::new(
            self.parameters[WATER],
            self.covariance[(WATER, WATER)].max(0.0).sqrt(),
        )
    }

    /// Fitted focal length in air \[px\].
    pub fn focal_px(&self) -> Known {
        Known::new(
            self.parameters[FOCAL],
            self.covariance[(FOCAL, FOCAL)].max(0.0).sqrt(),
        )
    }

    /// The camera's entrance pupil in sheet coordinates (ξ, η, ζ) \[m\].
    pub fn camera_m(&self) -> [f64; 3] {
        let rays = Rays::new(&self.parameters, self.glass_m, self.n_glass);
        let c = rays.to_board * -rays.translation;
        [c[0], c[1], c[2]]
    }

    fn rays(&self) -> Rays {
        Rays::new(&self.parameters, self.glass_m, self.n_glass)
    }

    /// See [`super::FittedMap::to_plane`].
    pub fn to_plane(&self, column_px: f64, row_px: f64) -> Option<PlanePoint> {
        let [xi_m, eta_m] = self.rays().meet(column_px, row_px)?;
        if !self.region.contains(xi_m, eta_m) {
            return None;
        }
        let g = self.moved(column_px, row_px)?;
        let covariance = &g * &self.covariance * g.transpose();
        Some(PlanePoint {
            xi_m,
            eta_m,
            covariance_m2: Matrix2::from_fn(|i, k| covariance[(i, k)]),
        })
    }

    /// How the point seen at a pixel moves with the parameters.
    fn moved(&self, column_px: f64, row_px: f64) -> Option<Matrix2xX<f64>> {
        let mut g = Matrix2xX::zeros(PARAMETERS);
        let mut x = self.parameters;
        for k in 0..PARAMETERS {
            let h = STEPS[k];
            x[k] = self.parameters[k] + h;
            let up = Rays::new(&x, self.glass_m, self.n_glass).meet(column_px, row_px)?;
            x[k] = self.parameters[k] - h;
            let down = Rays::new(&x, self.glass_m, self.n_glass).meet(column_px, row_px)?;
            x[k] = self.parameters[k];
            g[(0, k)] = (up[0] - down[0]) / (2.0 * h);
            g[(1, k)] = (up[1] - down[1]) / (2.0 * h);
        }
        Some(g)
    }

    /// See [`super::FittedMap::point_and_slopes`].
    pub fn point_and_slopes(&self, column_px: f64, row_px: f64) -> Option<PointAndSlopes> {
        let [xi_m, eta_m] = self.rays().meet(column_px, row_px)?;
        self.region.contains(xi_m, eta_m).then_some(())?;
        Some(([xi_m, eta_m], self.moved(column_px, row_px)?))
    }

    /// See [`crate::plane::PlaneMap::parameter_covariance`].
    pub fn parameter_covariance(&self) -> &DMatrix<f64> {
        &self.covariance
    }

    /// See [`super::FittedMap::to_image`].
    pub fn to_image(&self, xi_m: f64, eta_m: f64) -> Option<(f64, f64)> {
        let sheet_to_image = Matrix3::from_fn(|i, k| self.sheet_to_image[i][k]);
        let rays = self.rays();
        let mut p = apply(&sheet_to_image, [xi_m, eta_m])?;
        for _ in 0..20 {
            let at = rays.meet(p[0], p[1])?;
            let e = Vector2::new(at[0] - xi_m, at[1] - eta_m);
            let step = rays.jacobian(p[0], p[1])?.try_inverse()? * e;
            p = [p[0] - step[0], p[1] - step[1]];
            if step.norm() < 1e-9 {
                return Some((p[0], p[1]));
            }
        }
        None
    }

    /// See [`super::FittedMap::jacobian`].
    pub fn jacobian(&self, column_px: f64, row_px: f64) -> Option<Matrix2<f64>> {
        let rays = self.rays();
        let [xi, eta] = rays.meet(column_px, row_px)?;
        self.region.contains(xi, eta).then_some(())?;
        rays.jacobian(column_px, row_px)
    }

    /// Where the map holds.
    pub fn region(&self) -> &Region {
        &self.region
    }

    /// Numbers that a fit can have; for files.
    pub(crate) fn is_sound(&self) -> bool {
        self.covariance.nrows() == PARAMETERS
            && self.parameters.iter().all(|v| v.is_finite())
            && self.parameters[FOCAL] > 1.0
            && (0.9..3.0).contains(&self.parameters[WATER])
            && (0.9..3.0).contains(&self.n_glass)
            && (0.0..1.0).contains(&self.glass_m)
            && self.noise_scale.is_finite()
    }
}

/// Start pose from the sheet-to-image homography and an effective focal length: in water a camera
/// looks as if its focal length were n times longer.
fn start_pose(sheet_to_image: &Matrix3<f64>, prior: &RefractivePrior) -> Option<[f64; 6]> {
    let f = prior.focal_px.value * prior.n_water.value;
    let k = Matrix3::new(
        f,
        0.0,
        prior.cx_px.value,
        0.0,
        f,
        prior.cy_px.value,
        0.0,
        0.0,
        1.0,
    );
    let m = k.try_inverse()? * sheet_to_image;
    let (a, b, t) = (m.column(0), m.column(1), m.column(2));
    let mut scale = 2.0 / (a.norm() + b.norm());
    if t[2] < 0.0 {
        scale = -scale;
    }
    let (a, b, t) = (a * scale, b * scale, t * scale);
    let guess = Matrix3::from_columns(&[a, b, a.cross(&b)]);
    let svd = guess.svd(true, true);
    let r = svd.u? * svd.v_t?;
    let rotation = Rotation3::from_matrix_unchecked(r).scaled_axis();
    let pose = [rotation[0], rotation[1], rotation[2], t[0], t[1], t[2]];
    pose.iter().all(|v| v.is_finite()).then_some(pose)
}

/// The rays of one set of parameters, in the board's frame.
struct Rays {
    to_board: Matrix3<f64>,
    translation: Vector3<f64>,
    focal: f64,
    k1: f64,
    k2: f64,
    centre: [f64; 2],
    port_m: f64,
    glass_m: f64,
    normal: Vector3<f64>,
    n_glass: f64,
    n_water: f64,
}

impl Rays {
    fn new(x: &[f64], glass_m: f64, n_glass: f64) -> Self {
        let rotation = Rotation3::from_scaled_axis(Vector3::new(x[0], x[1], x[2]));
        Rays {
            to_board: rotation.matrix().transpose(),
            translation: Vector3::new(x[3], x[4], x[5]),
            focal: x[6],
            k1: x[7],
            k2: x[8],
            centre: [x[13], x[14]],
            port_m: x[9],
            glass_m,
            normal: Vector3::new(x[10], x[11], 1.0).normalize(),
            n_glass,
            n_water: x[12],
        }
    }

    /// Where the ray of a pixel meets the board's plane (ξ, η) \[m\].
    #[inline]
    fn meet(&self, column_px: f64, row_px: f64) -> Option<[f64; 2]> {
        let d = [
            (column_px - self.centre[0]) / self.focal,
            (row_px - self.centre[1]) / self.focal,
        ];
        let rd = d[0].hypot(d[1]);
        // r (1 + k₁r² + k₂r⁴) = r_d, by Newton.
        let mut r = rd;
        for _ in 0..10 {
            let r2 = r * r;
            let f = r * (1.0 + r2 * (self.k1 + r2 * self.k2)) - rd;
            let slope = 1.0 + r2 * (3.0 * self.k1 + 5.0 * r2 * self.k2);
            if slope < 0.05 {
                return None;
            }
            let step = f / slope;
            r -= step;
            if step.abs() < 1e-14 {
                break;
            }
        }
        let stretch = if rd > 1e-12 { r / rd } else { 1.0 };
        let air = Vector3::new(d[0] * stretch, d[1] * stretch, 1.0).normalize();
        let cos = air.dot(&self.normal);
        if cos < 0.1 {
            return None;
        }
        let mut point = air * (self.port_m / cos);
        let glass = refract(&air, &self.normal, 1.0 / self.n_glass)?;
        point += glass * (self.glass_m / glass.dot(&self.normal));
        let water = refract(&glass, &self.normal, self.n_glass / self.n_water)?;
        let from = self.to_board * (point - self.translation);
        let along = self.to_board * water;
        let s = -from[2] / along[2];
        (s > 0.0 && s.is_finite()).then(|| [from[0] + s * along[0], from[1] + s * along[1]])
    }

    /// d(ξ, η)/d(column, row).
    fn jacobian(&self, column_px: f64, row_px: f64) -> Option<Matrix2<f64>> {
        let h = 1e-3;
        let (e, w) = (
            self.meet(column_px + h, row_px)?,
            self.meet(column_px - h, row_px)?,
        );
        let (s, n) = (
            self.meet(column_px, row_px + h)?,
            self.meet(column_px, row_px - h)?,
        );
        Some(Matrix2::new(e[0] - w[0], s[0] - n[0], e[1] - w[1], s[1] - n[1]) / (2.0 * h))
    }
}

#[inline]
fn refract(a: &Vector3<f64>, n: &Vector3<f64>, mu: f64) -> Option<Vector3<f64>> {
    let c = a.dot(n);
    let inside = 1.0 - mu * mu * (1.0 - c * c);
    (inside > 0.0).then(|| a * mu + n * (inside.sqrt() - mu * c))
}
