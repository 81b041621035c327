//! The camera that the maps are judged by: lens, flat port and water, by Snell's law.
//!
//! Shares no code with [`hydroline_calib::map`]: the maps trace rays as vectors from the pixel
//! outwards, this one solves the scalar refraction equation from the point inwards, by
//! bisection, to the last bit.

use hydroline_calib::map::{RefractivePrior, refractive::Known};
use hydroline_calib::plane::ImageSize;

/// A camera at (ξ, η, ζ) = (0, height, −distance), looking at the sheet's origin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rig {
    /// Camera above the sheet's origin \[m\].
    pub height_m: f64,
    /// Camera behind the sheet \[m\].
    pub distance_m: f64,
    /// Focal length in air \[px\].
    pub focal_px: f64,
    /// Principal point \[px\].
    pub centre_px: [f64; 2],
    /// Brown's k₁, k₂ in air.
    pub k: [f64; 2],
    /// Pupil to port \[m\].
    pub port_m: f64,
    /// Port's thickness \[m\].
    pub glass_m: f64,
    /// Port's index.
    pub n_glass: f64,
    /// Water's index.
    pub n_water: f64,
}

impl Rig {
    /// A rig behind a flat port: 0.46 m above and behind, ±20° in water, port 30 mm ahead of
    /// the pupil, 10 mm acrylic, fresh water, k₁ = −0.15, k₂ = 0.03.
    pub fn behind_port() -> Self {
        // 288 rows at 20° in water: sin t_a = 1.333 sin 20°.
        let half = (1.333 * 20f64.to_radians().sin()).asin();
        Rig {
            height_m: 0.46,
            distance_m: 0.46,
            focal_px: 288.0 / half.tan(),
            centre_px: [359.5, 287.5],
            k: [-0.15, 0.03],
            port_m: 0.030,
            glass_m: 0.010,
            n_glass: 1.49,
            n_water: 1.333,
        }
    }

    /// The same place and field of view, a pinhole in air.
    pub fn in_air() -> Self {
        Rig {
            focal_px: 288.0 / 20f64.to_radians().tan(),
            k: [0.0, 0.0],
            glass_m: 0.0,
            n_glass: 1.0,
            n_water: 1.0,
            ..Self::behind_port()
        }
    }

    /// The paper's image.
    pub fn image(&self) -> ImageSize {
        ImageSize {
            width_px: 720,
            height_px: 576,
        }
    }

    /// Pixel (column, row) of the point (ξ, η, ζ) \[m\]; `None` behind the port.
    pub fn project(&self, xi_m: f64, eta_m: f64, zeta_m: f64) -> Option<[f64; 2]> {
        // Camera axes: right = −ξ, the axis from the camera to the sheet's origin.
        let norm = self.height_m.hypot(self.distance_m);
        let (down, forward) = (self.height_m / norm, self.distance_m / norm);
        let (de, dz) = (eta_m - self.height_m, zeta_m + self.distance_m);
        let x = -xi_m;
        let y = -de * forward - dz * down;
        let z = -de * down + dz * forward;
        let beyond = z - self.port_m - self.glass_m;
        if beyond <= 0.0 {
            return None;
        }
        let radius = x.hypot(y);
        // r = d tan t_a + t_g tan t_g + (z − d − t_g) tan t_w grows with sin t_a.
        let reach = |sin: f64| {
            let tan = |s: f64| s / (1.0 - s * s).sqrt();
            self.port_m * tan(sin)
                + self.glass_m * tan(sin / self.n_glass)
                + beyond * tan(sin / self.n_water)
        };
        let (mut low, mut high) = (0.0f64, 1.0 - 1e-12);
        if reach(high) < radius {
            return None;
        }
        loop {
            let middle = 0.5 * (low + high);
            if middle <= low || middle >= high {
                break;
            }
            if reach(middle) < radius {
                low = middle;
            } else {
                high = middle;
            }
        }
        let r = low / (1.0 - low * low).sqrt();
        let r2 = r * r;
        let seen = r * (1.0 + self.k[0] * r2 + self.k[1] * r2 * r2);
        let scale = if radius > 0.0 {
            self.focal_px * seen / radius
        } else {
            0.0
        };
        Some([self.centre_px[0] + scale * x, self.centre_px[1] + scale * y])
    }
}

/// Knowledge that a builder would have of the study's rig: sizes to a few per cent, not the truth.
pub fn prior(rig: &Rig) -> RefractivePrior {
    RefractivePrior {
        focal_px: Known::new(rig.focal_px * 1.01, 0.02 * rig.focal_px),
        cx_px: Known::new(rig.centre_px[0] + 1.0, 3.0),
        cy_px: Known::new(rig.centre_px[1] - 1.0, 3.0),
        port_distance_m: Known::new(0.9 * rig.port_m, 0.005),
        port_tilt_rad: Known::new(0.0, 0.01),
        glass_m: rig.glass_m,
        n_glass: rig.n_glass,
        n_water: Known::new(rig.n_water, 0.002),
        k1: Known::new(0.0, 0.3),
        k2: Known::new(0.0, 0.3),
    }
}
