//! Offset and tilt of the board against the sheet, from its gauge blocks.
//!
//! The sheet comes from above and grazes the face: on a flat board 1 mm more or less only
//! changes how bright it glows. The upper side of a raised block, though, stands across
//! the light: there the sheet draws a line at the height at which it passes over the face.
//! The camera looks down on that side, so the height shows as a displacement away from the
//! camera's foot by height × (η_c − η)/d, d the camera's distance from the face.
//!
//! The sheet is a Gaussian some 2 mm thick, cut off where the side begins (height 0) and
//! ends (the block's height): on a well-placed board half of it lies inside the plate. A
//! centroid would be off by up to 1.6 mm; so the cut Gaussian itself, blurred by the lens,
//! is fitted to the pixels of all sides together: offset, two tilts and the thickness for
//! all, amplitude and three backgrounds for each. With the sheet behind the face only a
//! tail is left, and the standard deviation says so.
//!
//! Height of the sheet over the face: h(ξ, η) = offset + tilt_ξ ξ + tilt_η η, positive
//! towards the camera.

use hydroline_rigs::Board;
use nalgebra::{DMatrix, DVector, Matrix2x3, Matrix3, Vector2};
use serde::{Deserialize, Serialize};

use super::lit_edge_m;
use crate::detect::Grey;
use crate::map::FittedMap;
use crate::map::geometry::rows;
use crate::map::lm::minimise;

/// An offset that is less certain than this \[m\] withdraws the claim of accuracy.
pub const WORST_OFFSET_SD_M: f64 = 0.15e-3;

/// Where the sheet stands over the face.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "state", rename_all = "lowercase", deny_unknown_fields)]
pub enum Coplanarity {
    /// Measured on gauge blocks.
    Measured(Gap),
    /// Nobody knows; the numbers are what careful hanging reaches.
    Unknown(Unknown),
}

/// A measured gap between face and sheet.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Gap {
    /// Sheet over the face at the board's middle, towards the camera \[m\].
    pub offset_m: f64,
    /// d height / dξ \[rad\].
    pub tilt_xi_rad: f64,
    /// d height / dη \[rad\].
    pub tilt_eta_rad: f64,
    /// Thickness of the sheet found (Gaussian σ) \[m\].
    pub sheet_sigma_m: f64,
    /// Blocks used.
    pub blocks: u32,
    /// Camera in the board's frame: ξ, η, distance from the face \[m\].
    pub camera_m: [f64; 3],
    /// Covariance of offset \[m²\] and tilts \[rad²\].
    #[serde(with = "rows")]
    pub covariance: DMatrix<f64>,
}

/// Gap assumed where nothing is measured: none, with these standard deviations.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Unknown {
    /// Reason why it is unknown.
    pub why: String,
    /// Standard deviation of the offset \[m\].
    pub offset_sd_m: f64,
    /// Standard deviation of the tilts \[rad\].
    pub tilt_sd_rad: f64,
    /// Camera in the board's frame: ξ, η, distance from the face \[m\].
    pub camera_m: [f64; 3],
}

impl Coplanarity {
    /// Unknown, with 1 mm and 0.1° assumed.
    pub fn unknown(why: impl Into<String>, camera_m: [f64; 3]) -> Self {
        Coplanarity::Unknown(Unknown {
            why: why.into(),
            offset_sd_m: 1e-3,
            tilt_sd_rad: 0.1f64.to_radians(),
            camera_m,
        })
    }

    fn camera_m(&self) -> [f64; 3] {
        match self {
            Coplanarity::Measured(gap) => gap.camera_m,
            Coplanarity::Unknown(unknown) => unknown.camera_m,
        }
    }

    /// The sheet point on the ray that meets the face at (ξ, η): what the map of the
    /// board's nodes must be corrected to. Unchanged when the gap is unknown.
    pub fn face_to_sheet(&self, xi_m: f64, eta_m: f64) -> [f64; 2] {
        let Coplanarity::Measured(gap) = self else {
            return [xi_m, eta_m];
        };
        let share = gap.height_m(xi_m, eta_m) / gap.camera_m[2];
        [
            xi_m + share * (gap.camera_m[0] - xi_m),
            eta_m + share * (gap.camera_m[1] - eta_m),
        ]
    }

    /// Inverse of [`Coplanarity::face_to_sheet`].
    pub fn sheet_to_face(&self, xi_m: f64, eta_m: f64) -> [f64; 2] {
        let mut face = [xi_m, eta_m];
        // The correction is some thousandths of the distance: a few rounds reach rounding.
        for _ in 0..8 {
            let sheet = self.face_to_sheet(face[0], face[1]);
            face = [face[0] + xi_m - sheet[0], face[1] + eta_m - sheet[1]];
        }
        face
    }

    /// Covariance \[m²\] that the gap's uncertainty puts on a sheet point.
    pub fn covariance_m2(&self, xi_m: f64, eta_m: f64) -> nalgebra::Matrix2<f64> {
        let g = self.slopes(xi_m, eta_m);
        g * self.covariance() * g.transpose()
    }

    /// Motion of a sheet point \[m\] with the sheet's offset over the face and its two tilts.
    pub fn slopes(&self, xi_m: f64, eta_m: f64) -> Matrix2x3<f64> {
        let camera = self.camera_m();
        let lever = Vector2::new(camera[0] - xi_m, camera[1] - eta_m) / camera[2];
        lever * nalgebra::RowVector3::new(1.0, xi_m, eta_m)
    }

    /// Covariance of the offset \[m²\] and the tilts \[rad²\].
    pub fn covariance(&self) -> Matrix3<f64> {
        match self {
            Coplanarity::Measured(gap) => Matrix3::from_fn(|i, k| gap.covariance[(i, k)]),
            Coplanarity::Unknown(u) => Matrix3::from_diagonal(&nalgebra::Vector3::new(
                u.offset_sd_m.powi(2),
                u.tilt_sd_rad.powi(2),
                u.tilt_sd_rad.powi(2),
            )),
        }
    }

    /// Whether the numbers can be true; for files.
    pub(crate) fn is_sound(&self) -> bool {
        let camera = self.camera_m();
        let finite = camera.iter().all(|v| v.is_finite() && v.abs() < 100.0) && camera[2] > 1e-3;
        finite
            && match self {
                Coplanarity::Measured(g) => {
                    [g.offset_m, g.tilt_xi_rad, g.tilt_eta_rad, g.sheet_sigma_m]
                        .iter()
                        .all(|v| v.is_finite() && v.abs() < 1.0)
                        && g.covariance.nrows() == 3
                }
                Coplanarity::Unknown(u) => u.offset_sd_m.is_finite() && u.tilt_sd_rad.is_finite(),
            }
    }

    /// Whether an accuracy in tenths of a millimetre may be claimed.
    pub fn claims(&self) -> bool {
        matches!(self, Coplanarity::Measured(g) if g.offset_sd_m() <= WORST_OFFSET_SD_M)
    }

    /// In words.
    pub fn words(&self) -> String {
        match self {
            Coplanarity::Measured(g) => format!(
                "board {:.2} ± {:.2} mm {} the sheet, tilted {:.2} ± {:.2}° across and {:.2} ± {:.2}° upwards, by {} gauge blocks; the map is corrected for it{}",
                1e3 * g.offset_m.abs(),
                1e3 * g.offset_sd_m(),
                if g.offset_m >= 0.0 {
                    "behind"
                } else {
                    "in front of"
                },
                g.tilt_xi_rad.to_degrees(),
                g.covariance[(1, 1)].max(0.0).sqrt().to_degrees(),
                g.tilt_eta_rad.to_degrees(),
                g.covariance[(2, 2)].max(0.0).sqrt().to_degrees(),
                g.blocks,
                if g.offset_sd_m() > WORST_OFFSET_SD_M {
                    "; too uncertain: no accuracy better than that is claimed"
                } else {
                    ""
                }
            ),
            Coplanarity::Unknown(u) => format!(
                "coplanarity unknown ({}): {:.1} mm and {:.1}° assumed, no accuracy better than that is claimed",
                u.why,
                1e3 * u.offset_sd_m,
                u.tilt_sd_rad.to_degrees()
            ),
        }
    }
}

impl Gap {
    /// Height of the sheet over the face \[m\].
    pub fn height_m(&self, xi_m: f64, eta_m: f64) -> f64 {
        self.offset_m + self.tilt_xi_rad * xi_m + self.tilt_eta_rad * eta_m
    }

    /// Standard deviation of the offset \[m\].
    pub fn offset_sd_m(&self) -> f64 {
        self.covariance[(0, 0)].max(0.0).sqrt()
    }
}

/// Inputs of the measurement besides the image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GaugeOptions {
    /// Camera in the board's frame: ξ, η, distance from the face \[m\] (rig file: mounts).
    pub camera_m: [f64; 3],
    /// Thickness of the sheet, Gaussian σ, and its standard deviation \[m\].
    pub sheet_sigma_m: [f64; 2],
    /// Point spread of the image \[px\], from the detection.
    pub blur_px: f64,
}

/// A pixel of a lit side.
struct Sample {
    height_m: f64,
    xi_m: f64,
    grey: f64,
    /// Shares of face, side and top in this pixel, blurred.
    shares: [f64; 3],
}

struct Side {
    eta_m: f64,
    top_m: f64,
    spread_m: f64,
    samples: Vec<Sample>,
}

/// Measures the gap on the board's blocks, with the map of this image's own nodes.
///
/// Never fails: where the blocks say nothing the answer is [`Coplanarity::Unknown`] with
/// the reason.
pub fn measure(
    image: &Grey<'_>,
    board: &Board,
    map: &FittedMap,
    options: &GaugeOptions,
) -> Coplanarity {
    let unknown = |why: &str| Coplanarity::unknown(why, options.camera_m);
    if board.blocks.len() < 3 {
        return unknown("the board has fewer than 3 gauge blocks");
    }
    let sides: Vec<Side> = board
        .blocks
        .iter()
        .filter_map(|b| side(image, b, map, options))
        .collect();
    if sides.len() < 3 {
        return unknown("fewer than 3 gauge blocks in view");
    }
    let count: usize = sides.iter().map(|s| s.samples.len()).sum();
    let [sigma, sigma_sd] = options.sheet_sigma_m;
    let residuals = |x: &[f64], out: &mut [f64]| {
        let mut k = 0;
        for side in &sides {
            let Some(solved) = solve(side, x) else {
                return false;
            };
            for r in solved.1 {
                out[k] = r;
                k += 1;
            }
        }
        // Residuals are grey levels; the priors are given that unit below.
        out[k] = (x[3] - sigma) / sigma_sd.max(1e-6);
        // A board that leans by more than 2° would be seen to.
        out[k + 1] = x[1] / 0.035;
        out[k + 2] = x[2] / 0.035;
        true
    };
    // The misfit over the offset has more than one minimum: begin in the deepest.
    let mut left = vec![0.0; count + 3];
    let mut start = (f64::INFINITY, 0.0);
    for step in -4..=16 {
        let offset_m = 0.5e-3 * f64::from(step);
        if residuals(&[offset_m, 0.0, 0.0, sigma], &mut left) {
            let cost: f64 = left.iter().map(|r| r * r).sum();
            if cost < start.0 {
                start = (cost, offset_m);
            }
        }
    }
    let fit = minimise(
        &[start.1, 0.0, 0.0, sigma],
        &[1e-6, 1e-6, 1e-6, 1e-6],
        count + 3,
        residuals,
    );
    let Ok(fit) = fit else {
        return unknown("the light on the blocks fits no sheet");
    };
    let x = fit.parameters.as_slice();
    let rms = (fit.cost / (count as f64 - 16.0).max(1.0)).sqrt();
    // Amplitude on each side against noise: a side without light measures nothing.
    let lit = sides
        .iter()
        .filter(|s| {
            solve(s, x).is_some_and(|(c, _)| {
                let h = x[0] + x[1] * s.samples[0].xi_m + x[2] * s.eta_m;
                let shown = c[3] * (-0.5 * (h.min(0.0) / x[3]).powi(2)).exp();
                c[3] > 0.0 && shown > 6.0 * rms.max(0.5)
            })
        })
        .count();
    if lit < 3 {
        return unknown(
            "the sheet lights fewer than 3 gauge blocks: it runs behind the face, or over them",
        );
    }
    // Grey-level residuals to units of their deviation; what the model leaves (soft edges,
    // lens) is smooth over a few pixels, hence the factor 2 in sd.
    let covariance = fit.covariance.view((0, 0), (3, 3)) * (rms * 2.0).powi(2);
    let covariance = covariance.clone_owned()
        + DMatrix::from_diagonal(&DVector::from_vec(vec![
            // The camera's place is known to some per cent, and so is every height.
            (0.03 * x[0]).powi(2) + 5e-5f64.powi(2),
            (0.03 * x[1]).powi(2),
            (0.03 * x[2]).powi(2),
        ]));
    Coplanarity::Measured(Gap {
        offset_m: x[0],
        tilt_xi_rad: x[1],
        tilt_eta_rad: x[2],
        sheet_sigma_m: x[3],
        blocks: lit as u32,
        camera_m: options.camera_m,
        covariance,
    })
}

/// Pixels that look at a block's upper side, a little beyond both of its edges.
fn side(
    image: &Grey<'_>,
    block: &hydroline_rigs::GaugeBlock,
    map: &FittedMap,
    options: &GaugeOptions,
) -> Option<Side> {
    let (eta_m, [left, right]) = lit_edge_m(block);
    let [xc, yc, d] = options.camera_m;
    let inset = 0.15 * (right - left);
    let beyond = 2.5e-3;
    let face = |xi: f64, h: f64| {
        let s = d / (d - h);
        map.to_image(xc + s * (xi - xc), yc + s * (eta_m - yc))
    };
    let corners = [
        face(left, -beyond)?,
        face(right, -beyond)?,
        face(left, block.height_m + beyond)?,
        face(right, block.height_m + beyond)?,
    ];
    let middle = 0.5 * (left + right);
    let (a, b) = (face(middle, 0.0)?, face(middle, block.height_m)?);
    let gain = (a.0 - b.0).hypot(a.1 - b.1) / block.height_m;
    let spread_m = options.blur_px.max(0.4) / gain;
    let bound = |f: &dyn Fn(f64, f64) -> f64, from: f64, part: usize| {
        corners
            .iter()
            .map(|c| if part == 0 { c.0 } else { c.1 })
            .fold(from, f)
    };
    let mut samples = Vec::new();
    let (c0, c1) = (
        bound(&f64::min, f64::INFINITY, 0).floor() as i64,
        bound(&f64::max, f64::NEG_INFINITY, 0).ceil() as i64,
    );
    let (r0, r1) = (
        bound(&f64::min, f64::INFINITY, 1).floor() as i64,
        bound(&f64::max, f64::NEG_INFINITY, 1).ceil() as i64,
    );
    if c0 < 0 || r0 < 0 || c1 >= image.width() as i64 || r1 >= image.height() as i64 {
        return None;
    }
    for r in r0..=r1 {
        for c in c0..=c1 {
            let Some(seen) = map.to_plane(c as f64, r as f64) else {
                continue;
            };
            let s = (eta_m - yc) / (seen.eta_m - yc);
            let (height_m, xi_m) = (d * (1.0 - s), xc + s * (seen.xi_m - xc));
            let grey = f64::from(image.at(c, r));
            if (-beyond..block.height_m + beyond).contains(&height_m)
                && (left + inset..right - inset).contains(&xi_m)
                && grey < 252.0
            {
                let foot = phi(height_m / spread_m);
                let edge = phi((height_m - block.height_m) / spread_m);
                samples.push(Sample {
                    height_m,
                    xi_m,
                    grey,
                    shares: [1.0 - foot, foot - edge, edge],
                });
            }
        }
    }
    (samples.len() >= 30 && gain > 100.0).then_some(Side {
        eta_m,
        top_m: block.height_m,
        spread_m,
        samples,
    })
}

/// Backgrounds (face, side, top) and amplitude of one side for given x, and what is left.
fn solve(side: &Side, x: &[f64]) -> Option<(nalgebra::Vector4<f64>, Vec<f64>)> {
    let (sigma, s, top) = (x[3], side.spread_m, side.top_m);
    if !(2e-4..2e-2).contains(&sigma) {
        return None;
    }
    let columns: Vec<nalgebra::Vector4<f64>> = side
        .samples
        .iter()
        .map(|p| {
            let mean = x[0] + x[1] * p.xi_m + x[2] * side.eta_m;
            let h = p.height_m;
            let [face, side, above] = p.shares;
            nalgebra::Vector4::new(face, side, above, cut(h, mean, sigma, s, top))
        })
        .collect();
    // A prior, sd 3e4 grey levels: a side that the sheet does not reach has no amplitude, rather than any.
    let mut normal = nalgebra::Matrix4::identity() * 1e-9;
    let mut right = nalgebra::Vector4::zeros();
    for (c, p) in columns.iter().zip(&side.samples) {
        normal += c * c.transpose();
        right += c * p.grey;
    }
    let coefficients = normal.cholesky()?.solve(&right);
    let left = columns
        .iter()
        .zip(&side.samples)
        .map(|(c, p)| c.dot(&coefficients) - p.grey)
        .collect();
    Some((coefficients, left))
}

/// A Gaussian (mean m, σ, height 1) cut to \[0, top\] and blurred with s, at h: the product
/// of both Gaussians completed to a square.
fn cut(h: f64, m: f64, sigma: f64, s: f64, top: f64) -> f64 {
    let total = sigma * sigma + s * s;
    let narrow = sigma * s / total.sqrt();
    let centre = (m * s * s + h * sigma * sigma) / total;
    sigma / total.sqrt()
        * (-0.5 * (h - m).powi(2) / total).exp()
        * (phi((top - centre) / narrow) - phi(-centre / narrow))
}

/// Normal distribution function, to 1e-7 (Abramowitz and Stegun 26.2.17).
fn phi(x: f64) -> f64 {
    let t = 1.0 / (1.0 + 0.231_641_9 * x.abs());
    let poly = t
        * (0.319_381_530
            + t * (-0.356_563_782
                + t * (1.781_477_937 + t * (-1.821_255_978 + t * 1.330_274_429))));
    let tail = (-0.5 * x * x).exp() / (2.0 * std::f64::consts::PI).sqrt() * poly;
    if x >= 0.0 { 1.0 - tail } else { tail }
}

#[cfg(test)]
mod tests;
