//! Regime of a run: Reynolds, Froude and Keulegan-Carpenter numbers, of what it showed of each DOF.

use std::f64::consts::TAU;

use hydroline_rigs::Dof;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Particulars;

/// Kinematic viscosity of fresh water at 20 °C \[m2/s\] (ITTC 7.5-02-01-03).
pub const VISCOSITY_M2PS: f64 = 1.0034e-6;

/// Motion of one DOF that a run showed, as results carry it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Seen {
    /// Largest speed \[m/s, rad/s\].
    pub speed: f64,
    /// Half of the way between two turns, on average \[m, rad\]; absent of motion that does not go back and forth.
    #[serde(default)]
    pub amplitude: Option<f64>,
    /// Frequency of going back and forth \[Hz\].
    #[serde(default)]
    pub frequency_hz: Option<f64>,
}

/// Regime of a run in one DOF.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct Regime {
    /// Name of the run.
    pub run: String,
    /// Degree of freedom.
    pub dof: &'static str,
    /// Largest speed \[m/s, rad/s\].
    pub speed: f64,
    /// Amplitude of going back and forth \[m, rad\]; `None` = it does not.
    pub amplitude: Option<f64>,
    /// Its frequency \[Hz\].
    pub frequency_hz: Option<f64>,
    /// Re = U L / nu, at the largest speed; of a turn U = rate L / 2, at the hull's end.
    pub reynolds: f64,
    /// Fn = U / sqrt(g L), likewise.
    pub froude: f64,
    /// KC = 2 pi A / L with the amplitude A; of a turn A L / 2; `None` = no going back and forth.
    pub keulegan_carpenter: Option<f64>,
}

/// Regime of a run's motion in a DOF.
pub fn regime(run: &str, dof: Dof, seen: &Seen, hull: &Particulars, viscosity_m2ps: f64) -> Regime {
    // A turn moves the hull's ends.
    let arm = if dof.index() < 3 {
        1.0
    } else {
        0.5 * hull.length_m
    };
    let speed_mps = seen.speed * arm;
    Regime {
        run: run.to_owned(),
        dof: dof.name(),
        speed: seen.speed,
        amplitude: seen.amplitude,
        frequency_hz: seen.frequency_hz,
        reynolds: speed_mps * hull.length_m / viscosity_m2ps,
        froude: speed_mps / (hull.gravity_mps2 * hull.length_m).sqrt(),
        keulegan_carpenter: seen.amplitude.map(|a| TAU * a * arm / hull.length_m),
    }
}

/// Range of a DOF over all runs: speeds, amplitudes and frequencies in which its coefficients were seen.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct Range {
    /// Degree of freedom.
    pub dof: &'static str,
    /// Largest speed of the slowest and of the fastest run \[m/s, rad/s\].
    pub speed: [f64; 2],
    /// Smallest and largest amplitude \[m, rad\]; `None` = no run goes back and forth.
    pub amplitude: Option<[f64; 2]>,
    /// Lowest and highest frequency \[Hz\].
    pub frequency_hz: Option<[f64; 2]>,
}

/// Ranges by DOF, in SNAME order.
pub fn ranges(regimes: &[Regime]) -> Vec<Range> {
    let ends = |values: Vec<f64>| {
        let least = values.iter().copied().fold(f64::INFINITY, f64::min);
        let most = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        (!values.is_empty()).then_some([least, most])
    };
    let of = |dof: Dof| {
        let own: Vec<&Regime> = regimes.iter().filter(|r| r.dof == dof.name()).collect();
        Some(Range {
            dof: dof.name(),
            speed: ends(own.iter().map(|r| r.speed).collect())?,
            amplitude: ends(own.iter().filter_map(|r| r.amplitude).collect()),
            frequency_hz: ends(own.iter().filter_map(|r| r.frequency_hz).collect()),
        })
    };
    Dof::ALL.into_iter().filter_map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_a_run_are_those_of_its_speed_and_amplitude() {
        let hull = Particulars::of_length(0.5);
        let seen = Seen {
            speed: 0.4,
            amplitude: Some(0.1),
            frequency_hz: Some(0.2),
        };
        let surge = regime("a", Dof::Surge, &seen, &hull, VISCOSITY_M2PS);
        assert!((surge.reynolds - 0.4 * 0.5 / 1.0034e-6).abs() < 1e-6);
        assert!((surge.froude - 0.4 / (9.81f64 * 0.5).sqrt()).abs() < 1e-12);
        assert!((surge.keulegan_carpenter.unwrap() - TAU * 0.2).abs() < 1e-12);
        // A turn is that of the hull's end.
        let yaw = regime("a", Dof::Yaw, &seen, &hull, VISCOSITY_M2PS);
        assert!((yaw.reynolds - 0.25 * surge.reynolds).abs() < 1e-6);
        let steady = Seen {
            amplitude: None,
            frequency_hz: None,
            speed: 0.9,
        };
        let steady = regime("b", Dof::Surge, &steady, &hull, VISCOSITY_M2PS);
        assert_eq!(steady.keulegan_carpenter, None);
        let all = ranges(&[surge, yaw, steady]);
        assert_eq!(all.len(), 2);
        assert_eq!(all[0].speed, [0.4, 0.9]);
        assert_eq!(all[0].amplitude, Some([0.1, 0.1]));
    }
}
