//! Light of the laser sheet at a point, and what one ray sees of it.

use super::rays::Sight;
use super::solid::{Line, Solid};
use crate::effect::Optics;

/// Beyond this many sigma from the sheet there is no light (of 200 grey levels 0.008 are left).
pub(super) const CUT_SIGMA: f64 = 4.5;

/// Code of a ray's end: a surface, lit or hidden, or nothing; pixels whose rays disagree are edges.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Code(pub u8);

impl Code {
    /// Not looked at.
    pub const NONE: Code = Code(255);
    /// Rays of one pixel disagree.
    pub const MIXED: Code = Code(254);
    /// Nothing there within the sheet's reach: the light has faded out, no edge.
    pub const FAR: Code = Code(252);

    /// Whether two neighbours with these codes have an edge of the light between them: two lit
    /// surfaces, or a lit one and the same one hidden. A surface hidden below another's fading
    /// light is no edge.
    pub fn differs(self, other: Code) -> bool {
        let silent = |c: Code| c == Code::NONE || c == Code::FAR;
        if self == other || silent(self) || silent(other) {
            return false;
        }
        let hidden = |c: Code| (c.0 & 0x80 != 0 && c != Code::MIXED).then_some(c.0 & 0x7f);
        match (hidden(self), hidden(other)) {
            (Some(_), Some(_)) => false,
            (Some(level), None) => other.0 == level || other == Code::MIXED,
            (None, Some(level)) => self.0 == level || self == Code::MIXED,
            (None, None) => true,
        }
    }

    /// Code of a pixel from those of two of its rays.
    pub fn joined(self, other: Code) -> Code {
        if self.differs(other) {
            Code::MIXED
        } else if self == Code::FAR || self == Code::NONE {
            other
        } else {
            self
        }
    }

    /// The top at this level lies within the sheet's reach but is dark: hidden, outside the fan, in shadow.
    fn hidden(level: usize) -> Self {
        Code(0x80 | level.min(super::solid::SLABS_MAX) as u8)
    }

    /// Lit top of the prism at this level.
    pub fn lit(level: usize) -> Self {
        Code(level.min(super::solid::SLABS_MAX) as u8)
    }
}

/// Sheet and scene of one pose.
pub(super) struct Light<'a, S> {
    pub view: &'a S,
    pub solid: &'a Solid,
    pub shadows: bool,
    /// -1 / (2 sigma^2).
    exponent: f64,
    reach_m: f64,
    /// Forward of the sheet, where haze may reach further.
    far_m: f64,
    tan_half_fan: f64,
    peak: f64,
    /// Haze at the sheet \[grey levels\] and -1/length \[1/m\].
    haze: (f64, f64),
    optics: Optics,
}

/// Laser light of this many grey levels and less is left away, as [`CUT_SIGMA`] does.
const CUT_GREY: f64 = 0.01;

/// Distance forward of the sheet up to which there is light \[m\].
pub(super) fn far_m(optics: &Optics) -> f64 {
    let fades = (optics.haze_fraction * optics.peak / CUT_GREY).ln() * optics.haze_length_m;
    // Without haze ln(0): `max` takes the sheet's own reach.
    fades.max(CUT_SIGMA * optics.sheet_sigma_m)
}

impl<'a, S: Sight> Light<'a, S> {
    pub fn new(view: &'a S, solid: &'a Solid, optics: &Optics, shadows: bool) -> Self {
        let sigma = optics.sheet_sigma_m;
        Light {
            view,
            solid,
            shadows,
            exponent: -0.5 / (sigma * sigma),
            reach_m: CUT_SIGMA * sigma,
            far_m: far_m(optics),
            haze: (
                optics.haze_fraction * optics.peak,
                -1.0 / optics.haze_length_m,
            ),
            optics: *optics,
            tan_half_fan: optics.half_fan_rad.tan(),
            peak: optics.peak,
        }
    }

    /// Whether the fan reaches a body point, and nothing stands in its way if shadows are cast.
    pub fn reaches(&self, fan_y: f64, fan_z: f64, point: [f64; 3]) -> bool {
        if fan_y.abs() > self.tan_half_fan * fan_z {
            return false;
        }
        if !self.shadows {
            return true;
        }
        let apex = self.view.apex();
        let line = Line {
            origin: apex,
            direction: std::array::from_fn(|i| point[i] - apex[i]),
        };
        // t = 1 is the point itself.
        self.solid
            .first_hit(&line)
            .is_none_or(|hit| hit.t >= 1.0 - 1e-9)
    }

    /// View along the ray of (column u, row v): the lit surface, or why it is dark, and the grey level of laser light.
    ///
    /// Only heights at which the ray meets the sheet can be lit; usually that is one or none, so visibility is
    /// asked for that one alone. Vertical faces occlude but are not lit (theory/geometry.md, laser).
    pub fn shade(&self, u: f64, v: f64) -> (Code, f64) {
        let ray = self.view.ray(u, v);
        let line = self.view.line(&ray);
        let [.., h0] = line.origin;
        let down = line.direction[2];
        if down >= -1e-9 {
            return (Code::FAR, 0.0);
        }
        let mut dark = Code::FAR;
        let per_height = 1.0 / down;
        for level in 0..=self.solid.prisms.len() {
            let prism = self.solid.prisms.get(level);
            let t = (prism.map_or(0.0, |p| p.top_m) - h0) * per_height;
            let off_m = self.view.off_m(&ray, t);
            // Written so that NaN is far.
            if !(off_m >= -self.reach_m && off_m <= self.far_m && t > 0.0) {
                continue;
            }
            dark = Code::hidden(level);
            if !self.solid.sees(&line, level, t) {
                continue;
            }
            let [fan_y, fan_z] = self.view.fan(&ray, t);
            let point = std::array::from_fn(|i| line.origin[i] + t * line.direction[i]);
            if !self.reaches(fan_y, fan_z, point) {
                return (Code::hidden(level), 0.0);
            }
            let albedo = prism.map_or(1.0, |p| p.albedo);
            let mut light = self.peak * albedo * (off_m * off_m * self.exponent).exp();
            if off_m > 0.0 && self.haze.0 > 0.0 {
                // Light of the water beside the sheet, not of the surface behind it: no albedo.
                light += self.haze.0 * (off_m * self.haze.1).exp();
            }
            light *= self.optics.line_profile(fan_y / fan_z);
            if self.optics.attenuation_pm > 0.0 {
                let way = distance(point, self.view.apex()) + distance(point, line.origin);
                light *= (-self.optics.attenuation_pm * way).exp();
            }
            return (Code::lit(level), light);
        }
        (dark, 0.0)
    }
}

/// Distance of two points in (x, y, height). On a slope the height's axis leans by it: second order in the slope.
pub(super) fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    let squares = a.iter().zip(b).map(|(a, b)| (a - b) * (a - b));
    squares.sum::<f64>().sqrt()
}
