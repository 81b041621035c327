//! A disturbance that no law has and no run repeats: what a real tank adds beneath an instrument that is better than the model.
//!
//! Two kinds, alone or together: a force in time, of eight lines with a falling or a flat spectrum and other phases in every
//! run (turbulence, a tether, ripple of a supply); a force along the way with a short wave (cogging, joints of a rail).

use rand::rngs::StdRng;

use super::external_law::Here;
use super::magnitudes::between;

/// Lines of the force in time.
const LINES: usize = 8;
/// Range of their frequencies \[Hz\].
const FREQUENCY_HZ: (f64, f64) = (0.05, 2.0);
/// Exponents of the amplitude over frequency: flat, as white noise's, and falling, as turbulence's.
const SLOPES: [f64; 2] = [0.0, -0.8];
/// Range of the wave along the way \[m\].
const WAVE_M: (f64, f64) = (0.02, 0.1);
/// Phase between one run and the next: the golden angle, so that no two runs are alike \[rad\].
const BETWEEN_RUNS_RAD: f64 = 2.399_963;

/// A disturbance of unit rms or so, times a size.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, schemars::JsonSchema)]
pub struct Unsteady {
    /// Factor on the force \[N\].
    pub size_n: f64,
    /// Frequency \[Hz\], amplitude and phase \[rad\] of each line in time.
    pub lines: [[f64; 3]; LINES],
    /// Length \[m\], amplitude and phase \[rad\] of the wave along the way.
    pub wave: [f64; 3],
}

impl Unsteady {
    /// The n-th: in time, along the way, both.
    pub fn draw(index: usize, rng: &mut StdRng) -> Unsteady {
        let (in_time, along) = match index % 3 {
            0 => (1.0, 0.0),
            1 => (0.0, 1.0),
            _ => (0.7, 0.7),
        };
        let slope = SLOPES[index / 3 % SLOPES.len()];
        let turn = std::f64::consts::TAU;
        let mut lines = [[0.0; 3]; LINES];
        for line in &mut lines {
            let (low, high) = FREQUENCY_HZ;
            let hz = low * (high / low).powf(between(rng, 0.0, 1.0));
            *line = [hz, hz.powf(slope), between(rng, 0.0, turn)];
        }
        let power: f64 = lines.iter().map(|l| 0.5 * l[1] * l[1]).sum();
        for line in &mut lines {
            line[1] *= in_time / power.sqrt();
        }
        Unsteady {
            size_n: 1.0,
            lines,
            wave: [
                between(rng, WAVE_M.0, WAVE_M.1),
                along * std::f64::consts::SQRT_2,
                between(rng, 0.0, turn),
            ],
        }
    }

    /// Force on the hull \[N\].
    pub fn force(&self, here: &Here) -> f64 {
        let turn = std::f64::consts::TAU;
        let lines = self.lines.iter().zip(1..);
        let in_time: f64 = lines
            .map(|([hz, amplitude, phase], nth)| {
                let off = BETWEEN_RUNS_RAD * f64::from(nth) * here.run as f64;
                amplitude * (turn * hz * here.t_s + phase + off).sin()
            })
            .sum();
        let [length_m, amplitude, phase] = self.wave;
        let along = amplitude * (turn * here.x_m / length_m + phase).sin();
        self.size_n * (in_time + along)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    #[test]
    fn a_disturbance_has_its_size_and_no_run_repeats_another() {
        let mut rng = StdRng::seed_from_u64(2);
        for index in 0..6 {
            let made = Unsteady {
                size_n: 3.0,
                ..Unsteady::draw(index, &mut rng)
            };
            let along = |run: usize| -> Vec<f64> {
                let of = |k: i32| Here {
                    t_s: 0.01 * f64::from(k),
                    x_m: 0.001 * f64::from(k),
                    u_mps: 0.1,
                    drag: [0.0; 2],
                    run,
                    load_n: 0.0,
                };
                (0..20_000).map(|k| made.force(&of(k))).collect()
            };
            let first = along(0);
            let rms = (first.iter().map(|v| v * v).sum::<f64>() / 2e4).sqrt();
            assert!((0.7 * 3.0..1.3 * 3.0).contains(&rms), "{index}: {rms}");
            assert_eq!(along(1) == first, index % 3 == 1, "{index}");
        }
    }
}
