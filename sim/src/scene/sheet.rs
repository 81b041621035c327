//! Light of the laser sheet at a point, and what one ray sees of it.

use super::rays::View;
use super::solid::{Line, Solid, Surface};
use crate::effect::Optics;

/// Beyond this many sigma from the sheet there is no light (200 grey levels: 0.0007 left).
pub(super) const CUT_SIGMA: f64 = 5.0;

/// What kind of thing a ray ended at; pixels whose rays disagree are edges.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Code(pub u8);

impl Code {
    /// Not looked at.
    pub const NONE: Code = Code(255);
    /// Above the horizon.
    const SKY: Code = Code(254);
    /// Rays of one pixel disagree.
    pub const MIXED: Code = Code(253);
    const UNLIT: u8 = 0x80;
    const FACE: u8 = 101;

    fn of(surface: Surface) -> Self {
        match surface {
            Surface::Floor => Code(0),
            Surface::Slab(i) => Code(1 + i.min(super::solid::SLABS_MAX - 1) as u8),
        }
    }
}

/// Sheet and scene of one pose.
pub(super) struct Light<'a> {
    pub view: &'a View,
    pub solid: &'a Solid,
    pub shadows: bool,
    /// -1 / (2 sigma^2).
    exponent: f64,
    reach_m: f64,
    tan_half_fan: f64,
    peak: f64,
}

impl<'a> Light<'a> {
    pub fn new(view: &'a View, solid: &'a Solid, optics: &Optics, shadows: bool) -> Self {
        let sigma = optics.sheet_sigma_m;
        Light {
            view,
            solid,
            shadows,
            exponent: -0.5 / (sigma * sigma),
            reach_m: CUT_SIGMA * sigma,
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
        let apex = self.view.apex;
        let line = Line {
            origin: apex,
            direction: std::array::from_fn(|i| point[i] - apex[i]),
        };
        // t = 1 is the point itself.
        self.solid
            .first_hit(&line)
            .is_none_or(|hit| hit.t >= 1.0 - 1e-9)
    }

    /// What the ray of (column u, row v) sees: its kind and the grey level of laser light.
    pub fn shade(&self, u: f64, v: f64) -> (Code, f64) {
        let line = self.view.line(u, v);
        let Some(hit) = self.solid.first_hit(&line) else {
            return (Code::SKY, 0.0);
        };
        if hit.face {
            // Vertical faces occlude but are not lit (geometry.md).
            return (Code(Code::FACE), 0.0);
        }
        let code = Code::of(hit.surface);
        let at = |form: &super::rays::Form| form.at_eye + hit.t * form.rate(u, v);
        let off_m = at(&self.view.sheet);
        if off_m.abs() > self.reach_m {
            return (code, 0.0);
        }
        let point = std::array::from_fn(|i| line.origin[i] + hit.t * line.direction[i]);
        if !self.reaches(at(&self.view.fan_y), at(&self.view.fan_z), point) {
            return (Code(code.0 | Code::UNLIT), 0.0);
        }
        let albedo = self.solid.albedo(hit.surface);
        (
            code,
            self.peak * albedo * (off_m * off_m * self.exponent).exp(),
        )
    }
}
