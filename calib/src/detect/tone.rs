//! The camera's tone curve as a board shows it: between its dark and its light level.
//!
//! Marks are blurred as light, before the camera presses or lifts it: a rim's middle then lies nearer
//! to one of the two levels. Level = black + gain · (light + ε)^γ, so that between dark (s = 0) and
//! light (s = 1) it runs as t(s) = ((s + ε)^γ − ε^γ) / ((1 + ε)^γ − ε^γ), whatever black, gain and
//! shading are: of a power law the shape is the same in the shade. ε is the light of the marks over
//! the step to the face. A camera's other curves (sRGB's toe, a shoulder) are near to one of these.

/// Steps of the table.
const STEPS: usize = 256;
/// Least slope: at the end of a curve that is flat there a fit would see no rim at all.
const FLATTEST: f64 = 1e-3;

/// Light of the marks as a share of the step from them to the face, as boards are printed: 4 to 40 %.
pub(super) const USUAL_EPSILON: f64 = 0.13;
/// Standard deviation of its logarithm.
pub(super) const EPSILON_LOG_SD: f64 = 0.6;

#[derive(Debug, Clone)]
pub(super) struct Tone {
    pub gamma: f64,
    /// t and dt/ds at k / STEPS.
    table: Vec<(f64, f64)>,
}

impl Tone {
    pub fn new(gamma: f64, epsilon: f64) -> Self {
        let table = (0..=STEPS + 1)
            .map(|k| exact(k as f64 / STEPS as f64, gamma, epsilon))
            .collect();
        Tone { gamma, table }
    }

    /// t(s) and its slope.
    #[inline(always)]
    fn at(&self, s: f64) -> (f64, f64) {
        let at = s.clamp(0.0, 1.0) * STEPS as f64;
        let k = (at as usize).min(STEPS);
        let f = at - k as f64;
        let (a, b) = (self.table[k], self.table[k + 1]);
        (a.0 + f * (b.0 - a.0), a.1 + f * (b.1 - a.1))
    }

    /// A pattern's value between `low` and `low + range`, of which the larger one is light or dark, as
    /// the camera shows it, and the factor on its gradient.
    #[inline(always)]
    pub fn shown(&self, value: f64, [low, range]: [f64; 2], light: bool) -> (f64, f64) {
        let s = (value - low) / range;
        if light {
            let (t, slope) = self.at(s);
            (low + range * t, slope)
        } else {
            let (t, slope) = self.at(1.0 - s);
            (low + range * (1.0 - t), slope)
        }
    }
}

fn exact(s: f64, gamma: f64, epsilon: f64) -> (f64, f64) {
    let dark = epsilon.powf(gamma);
    let step = (1.0 + epsilon).powf(gamma) - dark;
    (
        ((s + epsilon).powf(gamma) - dark) / step,
        (gamma * (s + epsilon).powf(gamma - 1.0) / step).max(FLATTEST),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_curve_keeps_its_ends_and_no_curve_is_a_straight_line() {
        for (gamma, epsilon) in [(0.4, 0.05), (1.0, 0.2), (2.5, 0.1)] {
            let tone = Tone::new(gamma, epsilon);
            for light in [true, false] {
                let ends = [-1.0, 1.0].map(|v| tone.shown(v, [-1.0, 2.0], light).0);
                assert!((ends[0] + 1.0).abs() < 1e-12 && (ends[1] - 1.0).abs() < 1e-12);
            }
            let (middle, slope) = tone.shown(0.5, [0.0, 1.0], true);
            let expected = exact(0.5, gamma, epsilon);
            assert!((middle - expected.0).abs() < 1e-9 && (slope - expected.1).abs() < 1e-9);
            assert!((gamma != 1.0) == ((middle - 0.5).abs() > 0.01));
            // Light marks on a dark face are the same curve read from the other end.
            let dark = tone.shown(0.5, [0.0, 1.0], false).0;
            assert!((dark - (1.0 - middle)).abs() < 1e-12);
        }
    }
}
