//! Priors for a vehicle of another size than the library's.
//!
//! The library's plausible ranges (theory/physics.md) are those of an AUV of 30 kg under some newtons. A ship model of a tonne
//! that rolls freely, or a drive that pushes with 150 N, has the same physics at other sizes: a load is counted in the mass with
//! the water that it moves, so that a vehicle whose masses and forces are all in proportion has its effects in proportion; where
//! it is driven, drags or is righted with far more than such a mass, in that, over the speed to the power that its unit names.
//! A hull that rings for minutes has a large righting moment and little damping. What couples two rates is counted in the
//! mass. Times, ratios and lengths stay.
//!
//! A load over a speed is never taken smaller than the library's on a vehicle of its mass: it goes by pressure times area, and a hull that is fast
//! for what drives it has no smaller fins for that. By its thrust of 41 N at 1.2 m/s a ship model of 3.3 t had a twelfth of
//! the library's, and its rudder four times as much as was plausible.

use hydroline_core::run::Channel;
use hydroline_numerics::statistics::extent;
use hydroline_sim::effect::ParameterInfo;
use hydroline_sim::vehicle::Hydrodynamics;

use super::recording::Recording;

/// Loads that the library's sizes are meant for, SNAME order \[N, N m\]: the built-in plans' on the paper's vehicle.
const LOADS: [f64; 6] = [8.0, 10.0, 12.0, 0.6, 0.8, 0.7];
/// Speeds under them \[m/s, rad/s\].
const SPEED: f64 = 0.15;
/// Masses with the water that they move, SNAME order \[kg, kg m2\]: the paper's vehicle.
const MASSES: [f64; 6] = [279.777, 349.777, 389.777, 4.73, 14.352, 12.144];
/// Swing to one side \[rad, m\].
const SWING: f64 = 0.4;
/// Unit of the coefficient of a product of two rates: another one for each choice of its words.
const COUPLING: &str = "SI";
/// Up to this many of these loads, on a vehicle of its mass, the sizes serve as they are. Small loads do not make a vehicle small.
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
    /// Factor of masses.
    mass: [f64; 6],
    /// Load that drives it over that of a vehicle of its mass in the library.
    driven: [f64; 6],
    /// Speed over the library's.
    fastest: [f64; 6],
    /// Factor of what a stiffness is over a swing: the library's swing over the vehicle's.
    over_swing: [f64; 6],
    /// Whether the loads of a DOF are known.
    is_known: [bool; 6],
}

/// Swing to one side in each DOF \[rad, m\].
fn swings(recording: &Recording) -> [f64; 6] {
    std::array::from_fn(|d| {
        let both = recording.runs.iter().map(|r| {
            let (low, high) = extent(r.seen(Channel::POSES[d]));
            (high - low).max(0.0)
        });
        0.5 * both.fold(0.0, f64::max)
    })
}

/// Load that drives a DOF: what is commanded, and else the drag at its fastest.
fn driven(h: &Hydrodynamics<f64>, dof: usize, commanded: f64, fastest: f64) -> f64 {
    match commanded > 0.0 {
        true => commanded,
        false => drag(h, dof, fastest),
    }
}

/// Drag of a hull at its fastest \[N, N m\].
fn drag(h: &Hydrodynamics<f64>, dof: usize, fastest: f64) -> f64 {
    (h.linear[dof] + h.quadratic[dof] * fastest).abs() * fastest
}

impl Size {
    /// The library's own.
    pub const USUAL: Size = Size {
        load: [1.0; 6],
        stiffness: [1.0; 6],
        speed: [1.0; 6],
        mass: [1.0; 6],
        driven: [1.0; 6],
        fastest: [1.0; 6],
        over_swing: [1.0; 6],
        is_known: [true; 6],
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
        let (swings, mass) = (swings(recording), h.mass());
        for d in 0..6 {
            let righting = h.stiffness(d).abs() * swings[d];
            let alike = mass[d] / MASSES[d];
            let beyond = |load_n: f64| {
                let factor = load_n / (alike * LOADS[d]);
                Some(alike * factor).filter(|_| factor > ALIKE && factor.is_finite())
            };
            let speed = fastest[d] / SPEED;
            // A rig's drag may be off by five; what was commanded is known.
            let driven = driven(h, d, commanded[d], fastest[d]);
            made.load[d] = alike;
            if let Some(load) = beyond(driven).filter(|_| speed > 0.0) {
                made.load[d] = load;
                made.speed[d] = speed;
            }
            made.stiffness[d] = beyond(righting).unwrap_or(alike).max(made.load[d]);
            made.mass[d] = alike;
            made.driven[d] = driven / (alike * LOADS[d]);
            made.fastest[d] = speed;
        }
        made
    }

    /// The same by which a size is held for possible or not: in proportion from the library's own on, and never smaller; a
    /// righting moment is a load like any other, and what a stiffness gains by the angle may be as large as it at any swing.
    pub fn bearable(
        recording: &Recording,
        h: &Hydrodynamics<f64>,
        commanded: &[f64; 6],
        fastest: &[f64; 6],
    ) -> Size {
        let mut made = Size::USUAL;
        let (swings, mass) = (swings(recording), h.mass());
        for d in 0..6 {
            let righting = h.stiffness(d).abs() * swings[d];
            let driven = driven(h, d, commanded[d], fastest[d]);
            made.is_known[d] = commanded[d] > 0.0 || righting > 0.0;
            made.mass[d] = mass[d] / MASSES[d];
            made.load[d] = (driven.max(righting) / LOADS[d]).max(made.mass[d]);
            made.stiffness[d] = made.load[d];
            made.speed[d] = (fastest[d] / SPEED).max(1.0);
            made.driven[d] = driven / (made.mass[d] * LOADS[d]);
            made.fastest[d] = fastest[d] / SPEED;
            if swings[d] > 0.0 {
                made.over_swing[d] = (SWING / swings[d]).max(1.0);
            }
        }
        made
    }

    /// Plausible range of a parameter; `None` where it is a load and no load of its DOF is known.
    pub fn plausible(&self, p: &ParameterInfo, dof: usize) -> Option<(f64, f64)> {
        let is_load = powers(p.unit).is_some_and(|(load, _)| load != 0);
        (!is_load || self.is_known[dof]).then(|| self.sized(p, dof).plausible)
    }

    /// Factor of a load over a speed to a power. By mass alone a large hull that hardly anything drives would have fins that
    /// stop it.
    fn over_speed(&self, dof: usize, power: i32) -> f64 {
        let alike = self.mass[dof];
        let mut least = alike;
        if alike > 1.0 {
            let share = self.driven[dof] / self.fastest[dof].powi(power);
            let share = if share > 0.0 { share.min(1.0) } else { 1.0 };
            least = (alike * share).max(1.0);
        }
        let is_beyond = self.load[dof] != alike;
        let proportion = self.load[dof] * self.speed[dof].powi(-power);
        if is_beyond {
            proportion.max(least)
        } else {
            least
        }
    }

    /// A parameter with its plausible range, and what a search begins from, at the size of a DOF.
    pub fn sized(&self, p: &ParameterInfo, dof: usize) -> ParameterInfo {
        let (load, speed) = powers(p.unit).unwrap_or((0, 0));
        let proportion = self.load[dof].powi(load) * self.speed[dof].powi(-speed);
        let factor = match (load, speed) {
            _ if p.unit == COUPLING => self.mass[dof],
            (1, 0) => over_length(p.unit).map_or(proportion, |power| {
                self.stiffness[dof] * self.over_swing[dof].powi(power)
            }),
            (1, _) if p.unit.starts_with("kg") => proportion.max(self.mass[dof]),
            (1, _) => self.over_speed(dof, speed),
            _ => proportion,
        };
        let scaled = |v: f64| (v * factor).clamp(p.limits.0, p.limits.1);
        ParameterInfo {
            plausible: (scaled(p.plausible.0), scaled(p.plausible.1)),
            typical: scaled(p.typical),
            ..*p
        }
    }
}

/// Power of the length or angle that a load's unit is over; `None` = over none.
fn over_length(unit: &str) -> Option<i32> {
    let first = unit.split(" (").next().unwrap_or(unit);
    let (_, under) = first.split_once('/')?;
    let power = under.chars().find_map(|c| c.to_digit(10)).unwrap_or(1);
    i32::try_from(power).ok()
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
        // Of pictures and stamps.
        const STAY: [&str; 4] = ["grey level", "px", "Hz", "1e-6"];
        // A law written from data is searched within no range.
        for info in ALL.iter().filter(|i| !i.is_written()) {
            for p in info.parameters {
                assert!(
                    powers(p.unit).is_some() || p.unit == COUPLING || STAY.contains(&p.unit),
                    "{}: `{}` is in \"{}\": write its unit in N, kg, m, rad and s (theory/priors.md, vehicles of another size), or \
                     list it here if its range is the same for every vehicle",
                    info.id,
                    p.name,
                    p.unit
                );
            }
        }
    }

    fn parameter(effect: &str, name: &str) -> ParameterInfo {
        let info = ALL.iter().find(|i| i.id == effect).unwrap();
        *info.parameters.iter().find(|p| p.name == name).unwrap()
    }

    /// No motion, which loads and rates stand beside.
    fn nothing() -> Recording {
        Recording {
            runs: Vec::new(),
            channels: PerChannel::splat(false),
            logged_sd: [f64::NAN; 6],
        }
    }

    /// Its rudder, 45 to 50 N s2/(m2 rad2), lay three times beyond the range.
    #[test]
    fn the_rudder_of_a_ship_model_of_three_tonnes_is_plausible() {
        let mut rig = Rig::builtin("lshpi").unwrap();
        rig.vehicle.mass_kg = 3300.0;
        rig.vehicle.inertia_kgm2 = [400.0, 10_000.0, 10_000.0];
        for (own, share) in rig.vehicle.coefficients.iter_mut().zip([0.05, 0.9, 1.0]) {
            own.added = -share * 3300.0;
        }
        let surge = &mut rig.vehicle.coefficients[0];
        (surge.linear, surge.quadratic) = (-1.0, -20.0);
        let h: Hydrodynamics<f64> = Hydrodynamics::new(&rig.vehicle);
        let (lift, drag) = (parameter("fin_force", "c1"), parameter("fin_force", "c2"));
        // Its thrust through the zigzags; just too small to be beyond what the library's sizes serve for, and well beyond.
        for thrust_n in [51.0, 39.0, 120.0] {
            let commanded = [thrust_n, 0.0, 0.0, 0.0, 0.0, 0.0];
            let fastest = [1.18, 0.3, 0.0, 0.0, 0.0, 0.03];
            let ship = Size::of(&nothing(), &h, &commanded, &fastest);
            let bearable = Size::bearable(&nothing(), &h, &commanded, &fastest);
            for c in [lift, drag] {
                let (low, high) = ship.sized(&c, 0).plausible;
                assert!(low < -50.0 && high > 50.0, "{thrust_n} N: {low} .. {high}");
                // At 20 degrees of rudder no more than some of what drives it.
                assert!(high * 1.18_f64.powi(2) * 0.349_f64.powi(2) < 2.0 * thrust_n);
                assert!(bearable.plausible(&c, 0).unwrap().1 >= high);
            }
            // What couples sway and turn goes by the mass.
            let coupling = parameter("cross_flow_coupling", "c");
            assert!(ship.sized(&coupling, 0).plausible.1 > 500.0);
            // Of sway no load is known.
            assert_eq!(bearable.plausible(&lift, 1), None);
            let lag = parameter("thruster_lag", "lag_s");
            assert_eq!(bearable.plausible(&lag, 1), Some(lag.plausible));
        }
    }

    #[test]
    fn what_is_possible_goes_by_the_loads_from_the_librarys_own_on() {
        let h: Hydrodynamics<f64> = Hydrodynamics::new(&Rig::builtin("lshpi").unwrap().vehicle);
        let friction = parameter("coulomb_friction", "f_n");
        let far_end = |commanded_n: f64| {
            let commanded = [commanded_n, 0.0, 0.0, 0.0, 0.0, 0.0];
            let size = Size::bearable(&nothing(), &h, &commanded, &[0.1; 6]);
            size.plausible(&friction, 0).unwrap().1
        };
        assert_eq!(far_end(2.0), friction.plausible.1);
        assert_eq!(far_end(8.0), friction.plausible.1);
        // A cart that 30 N push: nothing of it is scaled in the prior.
        assert!((far_end(30.0) / friction.plausible.1 - 3.75).abs() < 1e-9);
    }

    /// A vehicle of 15 g had the plausible sizes of one of 30 kg.
    #[test]
    fn a_vehicle_in_proportion_has_its_effects_in_proportion() {
        let rig = Rig::builtin("lshpi").unwrap();
        let sized = |scale: f64| {
            let mut vehicle = rig.vehicle.clone();
            vehicle.mass_kg *= scale;
            vehicle.inertia_kgm2.iter_mut().for_each(|v| *v *= scale);
            for c in &mut vehicle.coefficients {
                for v in [&mut c.added, &mut c.linear, &mut c.quadratic] {
                    *v *= scale;
                }
            }
            let h: Hydrodynamics<f64> = Hydrodynamics::new(&vehicle);
            let commanded = [6.0 * scale, 0.0, 0.0, 0.0, 0.0, 0.0];
            let size = Size::of(&nothing(), &h, &commanded, &[0.1; 6]);
            let bearable = Size::bearable(&nothing(), &h, &commanded, &[0.1; 6]);
            [
                ("coulomb_friction", "f_n"),
                ("cubic_damping", "d3"),
                ("cross_flow_coupling", "c"),
                ("fin_force", "c2"),
            ]
            .map(|(effect, name)| {
                let p = parameter(effect, name);
                let most = bearable.plausible(&p, 0).map_or(f64::NAN, |r| r.1);
                [
                    size.sized(&p, 0).typical,
                    size.sized(&p, 0).plausible.1,
                    most,
                ]
            })
        };
        let own = sized(1.0);
        for scale in [1.0 / 2000.0, 20.0] {
            for (a, b) in own.iter().flatten().zip(sized(scale).iter().flatten()) {
                assert!((b / a / scale - 1.0).abs() < 1e-9, "{scale}: {a} {b}");
            }
        }
    }

    /// A ship model of a tonne rolled, and its restoring moment could not be other than linear.
    #[test]
    fn a_ship_has_its_own_sizes_and_a_tank_run_the_librarys() {
        let k3 = parameter("nonlinear_restoring", "k3_nmprad3");
        let h: Hydrodynamics<f64> = Hydrodynamics::new(&Rig::builtin("lshpi").unwrap().vehicle);
        let tank = Size::of(&nothing(), &h, &[8.0, 0.0, 0.0, 0.5, 0.0, 0.0], &[0.1; 6]);
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
        let d3 = parameter("cubic_damping", "d3");
        assert_eq!(ship.sized(&d3, 3), d3);
    }
}
