//! From the camera's grey levels to light.
//!
//! Cameras that make pictures for people raise light to a power (sRGB about 0.45), machine vision leaves it as it is. What
//! a camera does is found in a run's opening and held after that:
//!
//! g = b + 255 (L/255)^γ,  with ln γ among the fitted, and with it the black level b, which is 16 in video (without a
//! curve it is one with the background). Noise comes before the curve, so that frames are compared in light:
//! L₀(g) = 255 ((g − b₀)/255)^(1/γ₀) with the γ₀ and b₀ known so far, and what is left of the curve, δ = ln γ − ln γ₀ and
//! β = b − b₀, is straight:
//! L₀ = L + δ L ln(L/255) + β dL/dg.
//!
//! A Gaussian to a power is a Gaussian: along the line it is the thickness that γ trades with, and only what lies on the
//! background and what edges cut in half distinguishes the two.

use std::sync::LazyLock;

/// Light of each grey level; of what is clipped, that of the ceiling.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Response {
    /// ln γ₀.
    pub tone: f64,
    /// b₀ \[grey levels\].
    pub black: f64,
    light: [f32; 256],
    /// Shift of each level of light per unit of ln γ and b.
    moved_by: [[f32; 2]; 256],
    /// 1 − γ₀.
    one_minus_gamma: f64,
    /// Light from which on it is clipped.
    pub clip_light: f64,
}

/// Grey level of the brightest light.
const FULL: f64 = 255.0;
/// A curve is steep without end at no light: below this share of the brightest it counts as a line.
const SHARE_LEAST: f64 = 0.01;
/// ln of that.
const LN_SHARE_LEAST: f64 = -4.605_170_185_988_091;

impl Response {
    /// Of a camera that leaves light as it is, and whose levels from `ceiling` on are clipped.
    pub fn linear(ceiling: u8) -> Response {
        Response::new([0.0, 0.0], ceiling)
    }

    /// For ln γ₀ and b₀, of a camera whose levels from `ceiling` on are clipped.
    pub fn new([tone, black]: [f64; 2], ceiling: u8) -> Response {
        let power = (-tone).exp();
        // Exact where there is no curve.
        let of = |grey: u8| match tone {
            0.0 => f64::from(grey) - black,
            _ => FULL * ((f64::from(grey) - black).max(0.0) / FULL).powf(power),
        };
        let mut light = [0.0; 256];
        for (grey, light) in (0..=u8::MAX).zip(&mut light) {
            *light = of(grey.min(ceiling)) as f32;
        }
        let mut response = Response {
            tone,
            black,
            light,
            moved_by: [[0.0; 2]; 256],
            one_minus_gamma: 1.0 - tone.exp(),
            clip_light: of(ceiling),
        };
        let tone_table = ToneTable::get();
        response.moved_by = std::array::from_fn(|level| {
            let (by_tone, slope) = tone_table.at(level as f64);
            [by_tone as f32, response.by_black(slope - 1.0) as f32]
        });
        response
    }

    /// Shift of a level of light per unit of ln γ and b, to the nearest whole level: enough for considered parameters.
    #[inline]
    pub fn moved_by(&self, light: f64) -> [f64; 2] {
        // Casts saturate: what is darker than none counts as none.
        let level = (light + 0.5) as u8;
        self.moved_by[usize::from(level)].map(f64::from)
    }

    #[inline]
    pub fn light(&self, grey: u8) -> f64 {
        f64::from(self.light[usize::from(grey)])
    }

    /// The light of a level between two, as a line.
    pub fn between(&self, grey: f64) -> f64 {
        let below = grey.clamp(0.0, 254.0).floor();
        let at = |level: f64| self.light(level as u8);
        at(below) + (grey - below) * (at(below + 1.0) - at(below))
    }

    /// Light per grey level, about a level of light.
    pub fn light_per_grey(&self, light: f64) -> f64 {
        light_per_grey(self.tone, light)
    }

    /// Light that a black level one grey level higher takes from a level of light, given its ln(L/255).
    #[inline]
    pub fn by_black(&self, ln_share: f64) -> f64 {
        if self.tone == 0.0 {
            1.0
        } else {
            // [`light_per_grey`]
            (self.one_minus_gamma * ln_share.max(LN_SHARE_LEAST) - self.tone).exp()
        }
    }
}

/// Light per grey level under a curve of this ln γ, about a level of light.
pub(crate) fn light_per_grey(tone: f64, light: f64) -> f64 {
    let share = (light / FULL).clamp(SHARE_LEAST, 4.0);
    ((-tone).exp()) * share.powf(1.0 - tone.exp())
}

/// Levels of light of the table below, and so many per level.
const TABLE_END: f64 = 1024.0;
const TABLE_PER_LEVEL: f64 = 2.0;

/// L ln(L/255) and its slope: a logarithm for each pixel took a tenth of a fit.
static TONE_TABLE: LazyLock<Vec<[f64; 2]>> = LazyLock::new(|| {
    (0..=(TABLE_END * TABLE_PER_LEVEL) as usize + 1)
        .map(|k| {
            let level = k as f64 / TABLE_PER_LEVEL;
            let ln = (level.max(0.05) / FULL).ln();
            [level * ln, 1.0 + ln]
        })
        .collect()
});

/// Table of the rest of the curve.
#[derive(Clone, Copy)]
pub(super) struct ToneTable(&'static [[f64; 2]]);

impl ToneTable {
    pub fn get() -> ToneTable {
        ToneTable(&TONE_TABLE)
    }

    /// At a level of light, L ln(L/255), and its slope.
    #[inline]
    pub fn at(self, level: f64) -> (f64, f64) {
        let at = (level * TABLE_PER_LEVEL).clamp(0.0, TABLE_END * TABLE_PER_LEVEL);
        let k = at as usize;
        let t = at - k as f64;
        match (self.0.get(k), self.0.get(k + 1)) {
            (Some([a, da]), Some([b, db])) => (a + t * (b - a), da + t * (db - da)),
            _ => (0.0, 0.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_to_grey_and_back() {
        let camera = Response::new([0.6f64.ln(), 10.0], 250);
        for grey in [11u8, 22, 100, 249] {
            let light = camera.light(grey);
            let back = 10.0 + FULL * (light / FULL).powf(0.6);
            assert!((back - f64::from(grey)).abs() < 1e-4, "{grey}: {back}");
        }
        assert_eq!(camera.light(255), camera.light(250));
        let h = camera.light(101) - camera.light(99);
        assert!((0.5 * h - camera.light_per_grey(camera.light(100))).abs() < 1e-3);
    }

    #[test]
    fn what_is_left_of_the_curve_is_straight() {
        // Seen with 0.98 of the power that it has.
        let (at, seen) = (0.7f64.ln() - 0.02, Response::new([0.7f64.ln(), 0.0], 255));
        for light in [5.0, 30.0, 120.0, 220.0f64] {
            let grey = FULL * (light / FULL).powf(at.exp());
            let light_seen = FULL * (grey / FULL).powf((-seen.tone).exp());
            let (by_tone, _) = ToneTable::get().at(light);
            assert!(
                (light_seen - light - -0.02 * by_tone).abs() < 0.05,
                "{light}"
            );
        }
    }
}
