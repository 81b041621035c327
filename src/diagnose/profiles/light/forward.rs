//! From optics and what is uncertain about the rig to the mean grey level of a sample.
//!
//! light = A (1 + gain field) [s/S e^(−z²/2) (1 + k₃ He₃(z) + k₄ He₄(z)) + haze] profile(fan) e^(−c way) + B + background's field,
//! z = rows below the stripe / S, S² = s² + point spread; haze = f h(d), d ahead of the sheet,
//! h(d) = exp(p²/2L² − d/L) Φ(d/p − p/L), exp(−d/L) for d > 0 under the point spread p \[m\]. Lens, lamps and the rise of the
//! background are the renderer's own [`Exposure`]; camera: [`Response`].

use super::camera::Response;
use super::samples::Sample;
use hydroline_rigs::Rig;
use hydroline_sim::effect::Optics;
use hydroline_sim::scene::Exposure;
use std::sync::Arc;

/// Coefficients of the gain field: P₁…P₄ of the column, row, row times column.
pub(super) const GAINS: usize = 6;
/// Highest degree of the background's products of P of the column and P of the row: a lamp that lights a third of the image
/// is followed to some hundredths.
const DEGREE: usize = 7;
/// Coefficients of the background's field: all products up to that degree but for the constant.
pub(super) const AMBIENTS: usize = (DEGREE + 1) * (DEGREE + 2) / 2 - 1;

/// What is uncertain about the rig, in natural units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Uncertain {
    /// ln of the sheet's thickness over the rig's.
    pub thickness: f64,
    /// ln of the point spread's variance over the rig's.
    pub spread: f64,
    /// ln of the read noise over the rig's.
    pub noise: f64,
    /// k₃, k₄.
    pub shape: [f64; 2],
    /// Field of the laser's brightness.
    pub gain: [f64; GAINS],
    /// Field of the background \[grey levels\].
    pub ambient: [f64; AMBIENTS],
}

impl Default for Uncertain {
    /// The rig as its file has it.
    fn default() -> Self {
        Uncertain {
            thickness: 0.0,
            spread: 0.0,
            noise: 0.0,
            shape: [0.0; 2],
            gain: [0.0; GAINS],
            ambient: [0.0; AMBIENTS],
        }
    }
}

/// The same of one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Own {
    /// ln of the laser's brightness over the rig's.
    pub brightness: f64,
    /// Background \[grey levels\].
    pub background: f64,
    /// ln of the stripe's width over that of a level surface.
    pub width: f64,
    /// When its first row is, on the clock of the lamps \[s\].
    pub lamp_s: f64,
}

/// A model's prediction.
#[derive(Debug, Clone)]
pub(super) struct Forward {
    optics: Optics,
    exposure: Exposure,
    response: Arc<Response>,
    sheet_m: f64,
    spread_px2: f64,
    uncertain: Uncertain,
    size_px: [f64; 2],
}

fn cumulative(x: f64) -> f64 {
    0.5 * libm::erfc(-x * std::f64::consts::FRAC_1_SQRT_2)
}

/// exp(−d/L) for d > 0 under a point spread p.
fn fading(d: f64, length: f64, p: f64) -> f64 {
    // Far on the dark side the exponent would overflow before Φ makes it nothing.
    let x = d / p - p / length;
    if x < -30.0 {
        0.0
    } else {
        (0.5 * (p / length).powi(2) - d / length).exp() * cumulative(x)
    }
}

impl Forward {
    /// Of a rig under these optics; `near`: a model whose response may be the same.
    pub fn new(rig: &Rig, optics: Optics, uncertain: Uncertain, near: Option<&Forward>) -> Self {
        let mut camera = rig.camera.clone();
        // A frame's background is its own.
        camera.noise.ambient = 0.0;
        let exposure = Exposure::of(&optics, &camera);
        let read_sd = camera.noise.read_sd.max(READ_LEAST) * uncertain.noise.exp();
        let response = near
            .map(|n| Arc::clone(&n.response))
            .filter(|r| r.is_of(&optics, read_sd))
            .unwrap_or_else(|| Arc::new(Response::new(&optics, &exposure, &camera.noise, read_sd)));
        let blur_px = camera.noise.blur_px;
        Forward {
            sheet_m: optics.sheet_sigma_m * uncertain.thickness.exp(),
            // The pixel's box: 1/12.
            spread_px2: (blur_px * blur_px + 1.0 / 12.0) * uncertain.spread.exp(),
            size_px: [camera.width_px, camera.height_px].map(f64::from),
            optics,
            exposure,
            response,
            uncertain,
        }
    }

    /// (u, v), −1…1 over the image.
    fn place(&self, column_px: f64, row_px: f64) -> [f64; 2] {
        let at = |x: f64, n: f64| 2.0 * (x + 0.5) / n - 1.0;
        [at(column_px, self.size_px[0]), at(row_px, self.size_px[1])]
    }

    /// What makes up the two fields at a pixel.
    pub fn basis(&self, column_px: f64, row_px: f64) -> ([f64; GAINS], [f64; AMBIENTS]) {
        let [u, v] = self.place(column_px, row_px);
        let (pu, pv) = (legendre(u), legendre(v));
        let mut products = [0.0; AMBIENTS];
        let all = (1..=DEGREE).flat_map(|n| (0..=n).map(move |k| (n - k, k)));
        for (to, (i, k)) in products.iter_mut().zip(all) {
            *to = pu[i] * pv[k];
        }
        ([pu[1], pu[2], pu[3], pu[4], v, u * v], products)
    }

    /// Field of the laser's brightness at a pixel.
    pub fn gain(&self, column_px: f64, row_px: f64) -> f64 {
        let (basis, _) = self.basis(column_px, row_px);
        basis
            .iter()
            .zip(&self.uncertain.gain)
            .map(|(b, c)| b * c)
            .sum()
    }

    /// Field of the background at a pixel \[grey levels\].
    fn ambient(&self, column_px: f64, row_px: f64) -> f64 {
        let (_, basis) = self.basis(column_px, row_px);
        let sum = basis.iter().zip(&self.uncertain.ambient);
        sum.map(|(b, c)| b * c).sum()
    }

    /// Width of the stripe in rows: sheet alone, and with the point spread \[px\].
    fn widths(&self, s: &Sample, own: &Own) -> (f64, f64) {
        let sheet = self.sheet_m / s.off_per_row_m.abs() * own.width.exp();
        // The point spread acts across a stripe aslant.
        let spread = self.spread_px2 * (1.0 + s.slope * s.slope);
        (sheet, (sheet * sheet + spread).sqrt())
    }

    /// Light of the laser, `down_px` rows below a sample's middle, on a linear camera without a lens \[grey levels\].
    pub fn laser(&self, s: &Sample, own: &Own, down_px: f64) -> f64 {
        let mut light = 0.0;
        if let Some(below) = s.below_px {
            let (sheet, all) = self.widths(s, own);
            let z = (below + down_px) / all;
            if z.abs() < FAR_SDS {
                let [k3, k4] = self.uncertain.shape;
                let z2 = z * z;
                let shape = 1.0 + k3 * (z2 - 3.0) * z + k4 * ((z2 - 6.0) * z2 + 3.0);
                light += sheet / all * (-0.5 * z2).exp() * shape;
            }
        }
        light += self.haze(&self.optics, s, down_px);
        if light == 0.0 {
            return 0.0;
        }
        light * self.brightness(s, own, down_px)
    }

    /// What light of 1 on a floor straight below is at a sample \[grey levels\].
    pub fn brightness(&self, s: &Sample, own: &Own, down_px: f64) -> f64 {
        let water = (-self.optics.attenuation_pm * s.way_m).exp();
        let field = 1.0 + self.gain(s.column_px, s.row_px + down_px);
        let brightness = self.optics.peak * own.brightness.exp();
        brightness * water * field * self.optics.line_profile(s.fan_tan)
    }

    /// Haze of these optics over the stripe's brightness, `down_px` rows below a sample's middle.
    pub fn haze(&self, optics: &Optics, s: &Sample, down_px: f64) -> f64 {
        if optics.haze_fraction <= 0.0 {
            return 0.0;
        }
        let spread_m = self.spread_px2.sqrt() * s.off_per_row_m.abs();
        let ahead = s.off_m + down_px * s.off_per_row_m;
        optics.haze_fraction * fading(ahead, optics.haze_length_m, spread_m)
    }

    /// Its optics.
    pub fn optics(&self) -> Optics {
        self.optics
    }

    /// Light on the sensor \[grey levels\].
    pub fn light(&self, s: &Sample, own: &Own, down_px: f64) -> f64 {
        let row = s.row_px + down_px;
        let laser = self.laser(s, own, down_px);
        let room = own.background + self.ambient(s.column_px, row);
        let lamps = self.exposure.row_at(own.lamp_s, row);
        self.exposure.light(&lamps, s.column_px, laser + room)
    }

    /// Mean grey level of a sample whose stripe lies `down_px` rows lower than measured.
    pub fn grey(&self, s: &Sample, own: &Own, down_px: f64) -> f64 {
        let at = |rows: f64| self.response.grey(self.light(s, own, rows - down_px));
        // Two points stand for rows of this spread, to second order.
        if s.half_px < 1e-3 {
            at(0.0)
        } else {
            0.5 * (at(-s.half_px) + at(s.half_px))
        }
    }

    /// Share of the stripe's brightness near a sample: where its shape is uncertain.
    pub fn on_stripe(&self, s: &Sample, own: &Own) -> f64 {
        s.below_px.map_or(0.0, |below| {
            let z = below / self.widths(s, own).1;
            // Twice as broad as the stripe itself.
            self.optics.peak * own.brightness.exp() * (-0.125 * z * z).exp()
        })
    }
}

/// Read noise below which a response is as good as without \[grey levels\].
const READ_LEAST: f64 = 0.3;
/// Sds of the stripe beyond which it has no light: that of 200 grey levels is 2e-6 there.
const FAR_SDS: f64 = 6.0;

/// Legendre's polynomials, by their recurrence.
fn legendre(x: f64) -> [f64; DEGREE + 1] {
    let mut p = [1.0; DEGREE + 1];
    p[1] = x;
    for n in 1..DEGREE {
        let k = n as f64;
        p[n + 1] = ((2.0 * k + 1.0) * x * p[n] - k * p[n - 1]) / (k + 1.0);
    }
    p
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_fields_polynomials_are_legendres() {
        let p = legendre(0.3);
        assert!((p[4] - (4.375 * 0.09 * 0.09 - 3.75 * 0.09 + 0.375)).abs() < 1e-12);
        assert!(
            legendre(-1.0)
                .iter()
                .enumerate()
                .all(|(n, v)| *v == [1.0, -1.0][n % 2])
        );
    }

    /// Behind the sheet there is no haze, before it what is left after so many lengths.
    #[test]
    fn haze_fades_ahead_of_the_sheet_only() {
        assert!(fading(-0.02, 0.01, 1e-3) < 1e-12);
        let ratio = fading(0.03, 0.01, 1e-3) / fading(0.02, 0.01, 1e-3);
        assert!((ratio - (-1.0f64).exp()).abs() < 1e-9, "{ratio}");
    }
}
