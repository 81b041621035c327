//! Candidates: every effect of the registry that moves the stripe in the image.
//!
//! Which ones these are is asked of their laws: an effect belongs here if at typical values it
//! changes what a ray meets. Nothing here knows an effect by name.

use hydroline_rigs::Rig;
use hydroline_sim::EffectStack;
use hydroline_sim::effect::{ALL, CheckedEffect, EffectError, EffectInfo, Optics, Stage, check};

/// An effect that may have been left out.
#[derive(Debug, Clone, PartialEq)]
pub struct Candidate {
    /// The effect.
    pub info: &'static EffectInfo,
    /// Values at which it does nothing.
    pub neutral: Vec<f64>,
    /// Standard deviation of the prior about `neutral`, per parameter.
    pub prior_sd: Vec<f64>,
}

/// Optics of the rig with some effects on top of those that it knows.
#[derive(Debug, Clone)]
pub struct Base {
    known: Vec<CheckedEffect>,
    plain: Optics,
}

impl Base {
    /// The rig's optics and known effects.
    ///
    /// # Errors
    /// [`EffectError`] for a bad `[[physics]]` entry.
    pub fn new(rig: &Rig) -> Result<Self, EffectError> {
        Ok(Base {
            known: check(&rig.physics)?,
            plain: Optics::new(rig),
        })
    }

    /// Optics with these effects too; `None` where their numbers make no law.
    pub fn optics(&self, more: &[(&'static EffectInfo, &[f64])]) -> Option<Optics> {
        let more: Vec<CheckedEffect> = (more.iter())
            .map(|(info, numbers)| CheckedEffect {
                numbers: numbers.to_vec(),
                ..CheckedEffect::typical(info)
            })
            .collect();
        self.optics_of(&more)
    }

    /// Optics with these effects too, words included; `None` where their numbers make no law.
    pub fn optics_of(&self, more: &[CheckedEffect]) -> Option<Optics> {
        let all: Vec<CheckedEffect> = self.known.iter().chain(more).cloned().collect();
        let stack = EffectStack::<f64>::assemble(&all, |_, _, v| v).ok()?;
        Some(stack.optics(self.plain))
    }

    /// Whether the rig holds the effect already.
    pub(super) fn knows(&self, info: &EffectInfo) -> bool {
        self.known.iter().any(|k| k.info.id == info.id)
    }
}

/// Optics that decide where a ray goes: those given, but for the numbers that only change brightness.
fn shape(optics: &Optics, plain: &Optics) -> Optics {
    Optics {
        sheet_sigma_m: plain.sheet_sigma_m,
        half_fan_rad: plain.half_fan_rad,
        peak: plain.peak,
        saturation: plain.saturation,
        haze_fraction: plain.haze_fraction,
        haze_length_m: plain.haze_length_m,
        speckle_contrast: plain.speckle_contrast,
        speckle_grain_px: plain.speckle_grain_px,
        attenuation_pm: plain.attenuation_pm,
        brightness: plain.brightness,
        // Counts only where there is a port or a curved sheet.
        port_m: if optics.n_water == 1.0 {
            plain.port_m
        } else {
            optics.port_m
        },
        cone_n_water: if optics.cone_sin == 0.0 {
            plain.cone_n_water
        } else {
            optics.cone_n_water
        },
        ..*optics
    }
}

/// Every effect that moves the stripe and that the rig does not know of.
pub fn library(base: &Base) -> Vec<Candidate> {
    ALL.iter()
        .copied()
        .filter(|info| info.stage == Stage::Measurement && !base.knows(info))
        .filter_map(|info| Candidate::new(info, base))
        .collect()
}

impl Candidate {
    fn new(info: &'static EffectInfo, base: &Base) -> Option<Candidate> {
        let plain = base.optics(&[])?;
        let typical = CheckedEffect::typical(info).numbers;
        let moves = |numbers: &[f64]| {
            let optics = base.optics(&[(info, numbers)])?;
            Some(shape(&optics, &plain) != shape(&plain, &plain))
        };
        if !moves(&typical)? {
            return None;
        }
        let neutral = neutral(info, &typical, &|n| moves(n) == Some(false))?;
        let prior_sd = info
            .parameters
            .iter()
            .zip(&neutral)
            .map(|(p, n)| {
                // Two thirds of the way to the far end of what a tank may show.
                ((p.plausible.0 - n).abs().max((p.plausible.1 - n).abs()) / 1.5).max(1e-9)
            })
            .collect();
        Some(Candidate {
            info,
            neutral,
            prior_sd,
        })
    }
}

/// Values at which the effect does nothing: each parameter absent, 0, 1 or typical.
fn neutral(info: &EffectInfo, typical: &[f64], idle: &dyn Fn(&[f64]) -> bool) -> Option<Vec<f64>> {
    let choices: Vec<Vec<f64>> = info
        .parameters
        .iter()
        .zip(typical)
        .map(|(p, t)| p.absent.into_iter().chain([*t, 0.0, 1.0]).collect())
        .collect();
    let count: usize = choices.iter().map(Vec::len).product();
    (0..count)
        .map(|mut k| {
            choices
                .iter()
                .map(|c| {
                    let v = c[k % c.len()];
                    k /= c.len();
                    v
                })
                .collect::<Vec<f64>>()
        })
        .find(|n| idle(n))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_registry_says_what_moves_the_stripe() {
        let rig = Rig::builtin("lshpi").unwrap();
        let all = library(&Base::new(&rig).unwrap());
        let ids: Vec<&str> = all.iter().map(|c| c.info.id).collect();
        assert_eq!(
            ids,
            [
                "refraction",
                "lens_distortion",
                "camera_shift",
                "laser_plane_tilt",
                "laser_cone",
                "board_offset",
                "target_scale",
                "floor_slope"
            ]
        );
        let refraction = &all[0];
        assert_eq!(refraction.neutral[0], 1.0, "{refraction:?}");
        assert_eq!(all[6].neutral, [1.0]);
    }
}
