//! From optics and what is uncertain about the rig to the mean grey level of a sample.
//!
//! light = A (1 + gain field) [s/S e^(−z²/2) (1 + k₃ He₃(z) + k₄ He₄(z)) + haze] profile(fan) e^(−c way) + B + background's field,
//! z = d in rows of the stripe's middle / S, S² = s² + point spread; haze = f h(d), d ahead of the sheet,
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

/// Uncertain numbers of the rig, in natural units.
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
    /// Slope of surfaces ahead in the body's frame: the tangent of the pitch, of the floor's slope.
    pub rise: f64,
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
}

/// Basis functions of the two fields at a pixel.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fields {
    /// Of the laser's brightness.
    pub gains: [f64; GAINS],
    /// Of the background.
    pub ambients: [f64; AMBIENTS],
}

impl Fields {
    /// At a pixel of an image of this size.
    pub fn at(column_px: f64, row_px: f64, size_px: [f64; 2]) -> Self {
        // (u, v), −1…1 over the image.
        let place = |x: f64, n: f64| 2.0 * (x + 0.5) / n - 1.0;
        let (u, v) = (place(column_px, size_px[0]), place(row_px, size_px[1]));
        let (pu, pv) = (legendre(u), legendre(v));
        let mut ambients = [0.0; AMBIENTS];
        let all = (1..=DEGREE).flat_map(|n| (0..=n).map(move |k| (n - k, k)));
        for (to, (i, k)) in ambients.iter_mut().zip(all) {
            *to = pu[i] * pv[k];
        }
        Fields {
            gains: [pu[1], pu[2], pu[3], pu[4], v, u * v],
            ambients,
        }
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
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
            optics,
            exposure,
            response,
            uncertain,
        }
    }

    /// Field of the laser's brightness at a sample.
    pub fn gain(&self, s: &Sample) -> f64 {
        dot(&s.fields.gains, &self.uncertain.gain)
    }

    /// Field of the background at a sample \[grey levels\].
    fn ambient(&self, s: &Sample) -> f64 {
        dot(&s.fields.ambients, &self.uncertain.ambient)
    }

    /// Metres ahead of the sheet over what they are on a surface that does not rise ahead.
    fn shorter(run: f64, own: &Own) -> f64 {
        (1.0 + own.rise * run).max(SHORTEST).recip()
    }

    /// Distance ahead of the sheet that one row more adds at the stripe's middle \[m\].
    fn per_row_m(s: &Sample, own: &Own) -> f64 {
        let (per_row_m, run) = s.middle;
        per_row_m * Self::shorter(run, own)
    }

    /// Distance ahead of the sheet, `down_px` rows below a sample's middle \[m\].
    fn ahead_m(s: &Sample, own: &Own, down_px: f64) -> f64 {
        s.off_m * Self::shorter(s.run, own) + down_px * Self::per_row_m(s, own)
    }

    /// Width of the stripe in rows: sheet alone, and with the point spread \[px\].
    fn widths(&self, s: &Sample, own: &Own) -> (f64, f64) {
        let sheet = self.sheet_m / Self::per_row_m(s, own).abs();
        // The point spread acts across a stripe aslant.
        let spread = self.spread_px2 * (1.0 + s.slope * s.slope);
        (sheet, (sheet * sheet + spread).sqrt())
    }

    /// Light of the laser over its brightness, `down_px` rows below a sample's middle.
    fn share(&self, s: &Sample, own: &Own, down_px: f64) -> f64 {
        let mut light = 0.0;
        if s.below_px.is_some() {
            let (sheet, all) = self.widths(s, own);
            let z = Self::ahead_m(s, own, down_px) / (Self::per_row_m(s, own) * all);
            if z.abs() < FAR_SDS {
                let [k3, k4] = self.uncertain.shape;
                let z2 = z * z;
                let shape = 1.0 + k3 * (z2 - 3.0) * z + k4 * ((z2 - 6.0) * z2 + 3.0);
                light += sheet / all * (-0.5 * z2).exp() * shape;
            }
        }
        light + self.haze(&self.optics, s, own, down_px)
    }

    /// Brightness at a sample of light that is 1 on a floor straight below \[grey levels\].
    pub fn brightness(&self, s: &Sample, own: &Own) -> f64 {
        let water = (-self.optics.attenuation_pm * s.way_m).exp();
        let field = 1.0 + self.gain(s);
        let brightness = self.optics.peak * own.brightness.exp();
        brightness * water * field * self.optics.line_profile(s.fan_tan)
    }

    /// Haze of these optics over the stripe's brightness, `down_px` rows below a sample's middle.
    pub fn haze(&self, optics: &Optics, s: &Sample, own: &Own, down_px: f64) -> f64 {
        if optics.haze_fraction <= 0.0 {
            return 0.0;
        }
        let spread_m = self.spread_px2.sqrt() * Self::per_row_m(s, own).abs();
        let ahead_m = Self::ahead_m(s, own, down_px);
        optics.haze_fraction * fading(ahead_m, optics.haze_length_m, spread_m)
    }

    /// Its optics.
    pub fn optics(&self) -> Optics {
        self.optics
    }

    /// Light on the sensor of a pixel `down_px` rows below a sample's middle, by the laser's brightness and the room there.
    fn sensed(&self, s: &Sample, own: &Own, [laser, room]: [f64; 2], down_px: f64) -> f64 {
        let share = self.share(s, own, down_px);
        let lamps = self.exposure.row_at(own.lamp_s, s.row_px + down_px);
        let all = laser * share + room;
        self.exposure.light(&lamps, s.column_px, all)
    }

    /// The laser's brightness and the room's light at a sample: fields are even over its rows.
    fn sources(&self, s: &Sample, own: &Own) -> [f64; 2] {
        let lit = s.below_px.is_some() || self.optics.haze_fraction > 0.0;
        let laser = if lit { self.brightness(s, own) } else { 0.0 };
        [laser, own.background + self.ambient(s)]
    }

    /// Light on the sensor \[grey levels\].
    pub fn light(&self, s: &Sample, own: &Own) -> f64 {
        self.sensed(s, own, self.sources(s, own), 0.0)
    }

    /// Mean grey level of a sample whose stripe lies `down_px` rows lower than measured.
    pub fn grey(&self, s: &Sample, own: &Own, down_px: f64) -> f64 {
        let sources = self.sources(s, own);
        let at = |rows: f64| {
            let light = self.sensed(s, own, sources, rows - down_px);
            self.response.grey(light)
        };
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

/// Least share of its length on level ground that the sheet's light has where the surface rises ahead: no vehicle pitches so far.
const SHORTEST: f64 = 0.2;
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
