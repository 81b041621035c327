//! Priors for a vehicle of another size than the library's.
//!
//! The library's plausible ranges (theory/physics.md) are those of an AUV of 30 kg under some newtons. A ship model of a tonne
//! that rolls freely, or a drive that pushes with 150 N, has the same physics at other sizes: a load is counted in what its
//! DOF is driven with or drags, over the speed to the power that its unit names; a stiffness also in the righting moment. A
//! hull that rings for minutes has a large one and little damping. Times, ratios and lengths stay.

use hydroline_core::run::Channel;
use hydroline_numerics::statistics::extent;
use hydroline_sim::effect::ParameterInfo;
use hydroline_sim::vehicle::Hydrodynamics;

use super::recording::Recording;

/// Loads that the library's sizes are meant for, SNAME order \[N, N m\]: the built-in plans' on the paper's vehicle.
const LOADS: [f64; 6] = [8.0, 10.0, 12.0, 0.6, 0.8, 0.7];
/// Speeds under them \[m/s, rad/s\].
const SPEED: f64 = 0.15;
/// Up to this many of these loads the sizes serve as they are. Small loads do not make a vehicle small.
const ALIKE: f64 = 5.0;

/// Size of a vehicle over the library's, per DOF.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Size {
    /// Factor of loads.
    load: [f64; 6],
    /// Factor of stiffnesses.
    stiffness: [f64; 6],
    /// Factor of speeds.
    speed: [f64; 6],
}

impl Size {
    /// The library's own.
    pub const USUAL: Size = Size {
        load: [1.0; 6],
        stiffness: [1.0; 6],
        speed: [1.0; 6],
    };

    /// Of a hull in a recording: by the loads commanded, where there are none by the drag at its fastest, and by the
    /// righting moment over its swing.
    ///
    /// `commanded` = largest load per DOF \[N, N m\]; `fastest` = largest rate \[m/s, rad/s\].
    pub fn of(
        recording: &Recording,
        h: &Hydrodynamics<f64>,
        commanded: &[f64; 6],
        fastest: &[f64; 6],
    ) -> Size {
        let mut made = Size::USUAL;
        for d in 0..6 {
            let swing = recording.runs.iter().map(|r| {
                let (low, high) = extent(r.seen(Channel::POSES[d]));
                (high - low).max(0.0)
            });
            let righting = 0.5 * h.stiffness(d).abs() * swing.fold(0.0, f64::max);
            let drag = (h.linear[d] + h.quadratic[d] * fastest[d]).abs() * fastest[d];
            let beyond =
                |load_n: f64| Some(load_n / LOADS[d]).filter(|f| *f > ALIKE && f.is_finite());
            let speed = fastest[d] / SPEED;
            // A rig's drag may be off by five; what was commanded is known.
            let driven = if commanded[d] > 0.0 {
                commanded[d]
            } else {
                drag
            };
            if let Some(load) = beyond(driven).filter(|_| speed > 0.0) {
                made.load[d] = load;
                made.speed[d] = speed;
            }
            made.stiffness[d] = beyond(righting).unwrap_or(1.0).max(made.load[d]);
        }
        made
    }

    /// A parameter with its plausible range, and what a search begins from, at the size of a DOF.
    pub fn sized(&self, p: &ParameterInfo, dof: usize) -> ParameterInfo {
        let (load, speed) = powers(p.unit).unwrap_or((0, 0));
        let factor = match (load, speed) {
            (1, 0) if p.unit.split(" (").next().is_some_and(|u| u.contains('/')) => {
                self.stiffness[dof]
            }
            _ => self.load[dof].powi(load) * self.speed[dof].powi(-speed),
        };
        let scaled = |v: f64| (v * factor).clamp(p.limits.0, p.limits.1);
        ParameterInfo {
            plausible: (scaled(p.plausible.0), scaled(p.plausible.1)),
            typical: scaled(p.typical),
            ..*p
        }
    }
}

/// Power of load and of 1 / speed in a unit: `N s2/m2` is a load over a speed squared, and so is `kg`, which is `N s2/m`.
/// Lengths, angles, times and pure numbers stay. `None`: a unit that is not of these.
fn powers(unit: &str) -> Option<(i32, i32)> {
    // The first form only: what stands in brackets is the same for a moment.
    let first = unit.split(" (").next().unwrap_or(unit);
    // Powers of load, length or angle, and time.
    let (mut load, mut length, mut time) = (0, 0, 0);
    let (over, under) = first.split_once('/').unwrap_or((first, ""));
    for (side, sign) in [(over, 1), (under, -1)] {
        let words = side.split([' ', '(', ')']).filter(|w| !w.is_empty());
        for word in words {
            let name = word.trim_end_matches(|c: char| c.is_ascii_digit());
            let power = match &word[name.len()..] {
                "" => 1,
                digits if !name.is_empty() => digits.parse().ok()?,
                _ => 0,
            };
            let power = sign * power;
            match name {
                "N" => load += power,
                "kg" => (load, length, time) = (load + power, length - power, time + 2 * power),
                "m" | "rad" => length += power,
                "s" => time += power,
                // 1 and nothing else.
                "" if word == "1" => {}
                _ => return None,
            }
        }
    }
    match (load, length, time) {
        (0, l, t) if l == -t => Some((0, t)),
        (0, _, 0) | (0, 0, _) => Some((0, 0)),
        (1, _, t) => Some((1, t)),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use hydroline_core::run::{Channel, PerChannel, Run, Sample};
    use hydroline_rigs::Rig;
    use hydroline_sim::effect::ALL;

    use super::*;

    #[test]
    fn units_say_how_a_parameter_scales() {
        for (unit, expected) in [
            ("N (N m for a moment)", (1, 0)),
            ("N s/m (N m s/rad for a moment)", (1, 1)),
            ("N s2/m2 (N m s2/rad2 for a moment)", (1, 2)),
            ("N s2/(m2 rad) (N m s2/(m2 rad) for a moment)", (1, 2)),
            ("N s3/m3 (N m s3/rad3 for a moment)", (1, 3)),
            ("N m/rad3", (1, 0)),
            ("N/m", (1, 0)),
            ("N/m2 (N/m for a moment)", (1, 0)),
            ("N s/m (N s for a moment)", (1, 1)),
            ("N s2/rad2 (N m s2/rad2 for a moment)", (1, 2)),
            ("m/s", (0, -1)),
            ("s/m", (0, 1)),
            ("s", (0, 0)),
            ("1", (0, 0)),
            ("m", (0, 0)),
            ("rad", (0, 0)),
            ("1/m", (0, 0)),
            ("N m s2/(m rad)", (1, 2)),
            ("kg", (1, 2)),
            ("kg m", (1, 2)),
            ("kg m2", (1, 2)),
        ] {
            assert_eq!(powers(unit), Some(expected), "{unit}");
        }
        for unit in ["SI", "grey level", "Hz", "lbf", "m/s2", "N2"] {
            assert_eq!(powers(unit), None, "{unit}");
        }
    }

    /// An effect in `kg` kept a small vehicle's size in a large one, and nothing said so.
    #[test]
    fn every_unit_of_the_library_scales_or_is_said_to_stay() {
        // Of pictures and stamps; `SI` is another one for each choice of the effect's words, with a range that is wide for any.
        const STAY: [&str; 5] = ["grey level", "px", "Hz", "1e-6", "SI"];
        // A law written from data is searched within no range.
        for info in ALL.iter().filter(|i| !i.is_written()) {
            for p in info.parameters {
                assert!(
                    powers(p.unit).is_some() || STAY.contains(&p.unit),
                    "{}: `{}` is in \"{}\": write its unit in N, kg, m, rad and s (theory/priors.md, vehicles of another size), or \
                     list it here if its range is the same for every vehicle",
                    info.id,
                    p.name,
                    p.unit
                );
            }
        }
    }

    /// A ship model of a tonne rolled, and its restoring moment could not be other than linear.
    #[test]
    fn a_ship_has_its_own_sizes_and_a_tank_run_the_librarys() {
        let k3 = ALL.iter().find(|i| i.id == "nonlinear_restoring").unwrap();
        let k3 = k3.parameters[0];
        let h: Hydrodynamics<f64> = Hydrodynamics::new(&Rig::builtin("lshpi").unwrap().vehicle);
        let nothing = Recording {
            runs: Vec::new(),
            channels: PerChannel::splat(false),
        };
        let tank = Size::of(&nothing, &h, &[8.0, 0.0, 0.0, 0.5, 0.0, 0.0], &[0.1; 6]);
        assert_eq!(tank.sized(&k3, 3), k3);
        let rolled = |angle: f64| {
            let mut values = PerChannel::NAN;
            values[Channel::Phi] = angle;
            Sample {
                t_s: angle,
                values,
                covariance: None,
            }
        };
        let run = Run {
            samples: vec![rolled(-0.15), rolled(0.15)],
            ..Run::default()
        };
        let mut hull = h.clone();
        hull.restoring_nm = -820.0;
        let ship = Size::of(&Recording::new(&[run], 0.0), &hull, &[0.0; 6], &[0.0; 6]);
        let sized = ship.sized(&k3, 3);
        assert!(sized.plausible.0 < -1000.0 && sized.plausible.1 > 1000.0);
        assert_eq!(ship.sized(&k3, 4), k3);
        // It swings freely: nothing says that it has much damping.
        let d3 = ALL
            .iter()
            .find(|i| i.id == "cubic_damping")
            .unwrap()
            .parameters[0];
        assert_eq!(ship.sized(&d3, 3), d3);
    }
}
