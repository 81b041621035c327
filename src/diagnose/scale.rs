//! Priors for a vehicle of another size than the vocabulary's.
//!
//! The vocabulary's sizes (physics.md) are those of an AUV of 30 kg under some newtons. A ship model
//! of a tonne that rolls freely, or a drive that pushes with 150 N, has the same physics at other
//! sizes. Where loads differ by more than a factor of five, every load-like parameter is scaled: by
//! the load, over the speed to the power that its unit names. Times, ratios and lengths stay.

use hydroline_rigs::{Dof, Vehicle};

use super::candidate::Candidate;
use super::setting::Track;

/// Loads that the vocabulary's sizes are meant for, SNAME order \[N, N m\]: the built-in plans' on the paper's vehicle.
const LOADS: [f64; 6] = [8.0, 10.0, 12.0, 0.6, 0.8, 0.7];
/// Speeds under them \[m/s, rad/s\].
const SPEEDS: [f64; 6] = [0.15, 0.15, 0.15, 0.15, 0.15, 0.15];
/// Within this factor the sizes serve as they are.
const ALIKE: f64 = 5.0;

/// Load and speed of the runs, over those of the vocabulary; `None` where the vocabulary's sizes serve.
pub fn factors(dof: Dof, vehicle: &Vehicle, tracks: &[Track]) -> Option<(f64, f64)> {
    let i = dof.index();
    // Roll and pitch are also loaded by their own righting moment: all there is in a free decay.
    let stiffness = if matches!(dof, Dof::Roll | Dof::Pitch) {
        vehicle.mass_kg * vehicle.gravity_mps2 * vehicle.r_bz_m.abs()
    } else {
        0.0
    };
    let (mut load, mut speed) = (0.0_f64, 0.0_f64);
    for track in tracks {
        let (low, high) = track
            .measured
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| {
                (l.min(*v), h.max(*v))
            });
        let commanded = track.edges.iter().map(|e| e.1.abs()).fold(0.0, f64::max);
        load = load.max(commanded).max(0.5 * stiffness * (high - low));
        // Over 0.3 s, so that the noise of a sample does not count as speed.
        let apart = track
            .times_s
            .partition_point(|t| *t < track.times_s.first().copied().unwrap_or(0.0) + 0.3)
            .max(1);
        for (a, b) in track
            .measured
            .iter()
            .zip(&track.times_s)
            .zip(track.measured.iter().zip(&track.times_s).skip(apart))
        {
            let s = b.1 - a.1;
            if s > 0.0 && s < 1.0 {
                speed = speed.max((b.0 - a.0).abs() / s);
            }
        }
    }
    let (load, speed) = (load / LOADS[i], speed / SPEEDS[i]);
    let alike = (1.0 / ALIKE..=ALIKE).contains(&load);
    (!alike && load > 0.0 && speed > 0.0).then_some((load, speed))
}

/// Power of load and of 1 / speed in a unit: `N s2/m2` is a load over a speed squared.
fn powers(unit: &str) -> (i32, i32) {
    // The first form only: what stands in brackets is the same for a moment.
    let first = unit.split(" (").next().unwrap_or(unit);
    let load = i32::from(first.split([' ', '/']).any(|w| w == "N"));
    let seconds = first.split([' ', '/', '(']).find_map(|w| match w {
        "s" => Some(1),
        "s2" => Some(2),
        "s3" => Some(3),
        _ => None,
    });
    let per_speed = if load == 1 { seconds.unwrap_or(0) } else { 0 };
    let per_speed = match first {
        "m/s" | "rad/s" => -1,
        "s/m" | "s/rad" => 1,
        _ => per_speed,
    };
    (load, per_speed)
}

/// Scales starts, bounds and widths of what has the dimension of a load or a speed.
pub fn rescale(vocabulary: &mut [Candidate], load: f64, speed: f64) {
    for candidate in vocabulary {
        for (i, p) in candidate.info.parameters.iter().enumerate() {
            let (l, u) = powers(p.unit);
            let factor = load.powi(l) * speed.powi(-u);
            if factor == 1.0 {
                continue;
            }
            let (low, high) = (p.plausible.0 * factor, p.plausible.1 * factor);
            let span = high - low;
            let bounds = (
                (low - 2.0 * span).max(p.limits.0),
                (high + 2.0 * span).min(p.limits.1),
            );
            candidate.bounds[i] = bounds;
            candidate.widths[i] *= factor;
            candidate.flat[i].0 *= factor;
            candidate.flat[i].1 *= factor;
            if let Some(size) = candidate.size.as_mut().filter(|_| i == 0) {
                size.nothing *= factor;
                size.largest *= factor;
            }
            for start in &mut candidate.starts {
                start[i] = (start[i] * factor).clamp(bounds.0, bounds.1);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::candidate::vocabulary;

    #[test]
    fn units_say_how_a_parameter_scales() {
        for (unit, expected) in [
            ("N (N m for a moment)", (1, 0)),
            ("N s/m (N m s/rad for a moment)", (1, 1)),
            ("N s2/m2 (N m s2/rad2 for a moment)", (1, 2)),
            ("N s3/m3 (N m s3/rad3 for a moment)", (1, 3)),
            ("N m/rad3", (1, 0)),
            ("N/m", (1, 0)),
            ("m/s", (0, -1)),
            ("s/m", (0, 1)),
            ("s", (0, 0)),
            ("1", (0, 0)),
            ("m", (0, 0)),
            ("rad", (0, 0)),
        ] {
            assert_eq!(powers(unit), expected, "{unit}");
        }
    }

    #[test]
    fn a_tank_run_keeps_the_vocabularys_sizes_and_a_ship_does_not() {
        let rig = hydroline_rigs::Rig::builtin("lshpi").unwrap();
        let times_s: Vec<f64> = (0..100).map(|k| 0.1 * f64::from(k)).collect();
        let rolling = |amplitude: f64| Track {
            name: String::new(),
            measured: times_s
                .iter()
                .map(|t| amplitude * (2.5 * t).cos())
                .collect(),
            times_s: times_s.clone(),
            edges: Vec::new(),
            start_s: 0.0,
            line: hydroline_sim::single::Line {
                dof: 3,
                rest: [0.0; 6],
            },
        };
        assert_eq!(factors(Dof::Roll, &rig.vehicle, &[rolling(0.1)]), None);
        let mut ship = rig.vehicle.clone();
        (ship.mass_kg, ship.r_bz_m) = (993.4, -0.0843);
        let (load, speed) = factors(Dof::Roll, &ship, &[rolling(0.17)]).unwrap();
        assert!((load - 821.5 * 0.17 / 0.6).abs() < 5.0, "{load}");
        assert!((1.0..4.0).contains(&speed), "{speed}");
        let mut all = vocabulary(Dof::Roll, &[]);
        rescale(&mut all, load, speed);
        let k3 = all
            .iter()
            .find(|c| c.info.id == "nonlinear_restoring")
            .unwrap();
        assert!(k3.bounds[0].0 < -500.0 && k3.bounds[0].1 > 500.0);
        for c in &all {
            for start in &c.starts {
                for (v, (low, high)) in start.iter().zip(&c.bounds) {
                    assert!((*low..=*high).contains(v), "{}", c.info.id);
                }
            }
        }
    }
}
