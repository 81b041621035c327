//! Load that a plan asks for at a time.

use std::f64::consts::TAU;

use super::{Plan, PlanStep, Shape, StepLoad, Wrench};

impl PlanStep {
    /// Factor on this step's own load at `t_s` after its start, for every shape but
    /// the ramp (which mixes two loads).
    fn factor(&self, t_s: f64) -> f64 {
        match self.shape {
            Shape::Hold | Shape::Ramp => 1.0,
            Shape::Sine {
                period_s,
                phase_rad,
            } => (TAU * t_s / period_s + phase_rad).sin(),
            // Linear sweep: the phase is the integral of 2 pi (f0 + (f1 - f0) t / T).
            Shape::Chirp { f0_hz, f1_hz } => {
                (TAU * (f0_hz * t_s + 0.5 * (f1_hz - f0_hz) * t_s * t_s / self.for_s)).sin()
            }
        }
    }
}

impl StepLoad {
    /// No load of the same kind (a thrust load keeps its thrusters' names).
    pub fn zero(&self) -> StepLoad {
        self.scaled(0.0)
    }

    /// The load times `factor`.
    pub fn scaled(&self, factor: f64) -> StepLoad {
        // 0 * -4 is -0: no load has no sign.
        let scale = |value: f64| value * factor + 0.0;
        match self {
            StepLoad::Wrench(wrench) => {
                StepLoad::Wrench(Wrench::from_array(wrench.to_array().map(scale)))
            }
            StepLoad::ThrustN(thrusts) => StepLoad::ThrustN(
                thrusts
                    .iter()
                    .map(|(name, thrust_n)| (name.clone(), scale(*thrust_n)))
                    .collect(),
            ),
        }
    }

    /// `self + (to - self) * share`, kind of `to`; a load of the other kind counts as zero
    /// (files in which that could matter are refused).
    fn towards(&self, to: &StepLoad, share: f64) -> StepLoad {
        let mix = |from: f64, to: f64| from + (to - from) * share;
        match (self, to) {
            (StepLoad::Wrench(from), StepLoad::Wrench(to)) => {
                let (from, mut mixed) = (from.to_array(), to.to_array());
                for (value, start) in mixed.iter_mut().zip(from) {
                    *value = mix(start, *value);
                }
                StepLoad::Wrench(Wrench::from_array(mixed))
            }
            (StepLoad::ThrustN(from), StepLoad::ThrustN(to)) => {
                let start = |name: &str| {
                    from.iter()
                        .find(|(n, _)| n == name)
                        .map_or(0.0, |(_, thrust_n)| *thrust_n)
                };
                let mut mixed: Vec<(String, f64)> = to
                    .iter()
                    .map(|(name, thrust_n)| (name.clone(), mix(start(name), *thrust_n)))
                    .collect();
                // Thrusters that only the step before named run down to zero.
                for (name, thrust_n) in from {
                    if !to.iter().any(|(n, _)| n == name) {
                        mixed.push((name.clone(), mix(*thrust_n, 0.0)));
                    }
                }
                StepLoad::ThrustN(mixed)
            }
            (_, to) => to.scaled(share),
        }
    }
}

impl Plan {
    /// The load asked for at `t_s` after the plan's start, and the index of the step it
    /// belongs to. A step covers its start and not its end. Before the plan (and for a
    /// time that is not a number) the load is zero and the index 0; after it the load is
    /// zero and the index is the number of steps.
    pub fn load_at(&self, t_s: f64) -> (usize, StepLoad) {
        let nothing = StepLoad::Wrench(Wrench::default());
        if t_s.is_nan() || t_s < 0.0 {
            return (0, nothing);
        }
        let mut start_s = 0.0;
        for (index, step) in self.steps.iter().enumerate() {
            let end_s = start_s + step.for_s;
            if t_s < end_s {
                return (index, self.load_in(index, t_s - start_s));
            }
            start_s = end_s;
        }
        (self.steps.len(), nothing)
    }

    /// The load of step `index` at `t_s` after that step's start.
    pub(super) fn load_in(&self, index: usize, t_s: f64) -> StepLoad {
        let step = &self.steps[index];
        if step.shape == Shape::Ramp {
            return self
                .start_of_ramp(index)
                .towards(&step.load, t_s / step.for_s);
        }
        step.load.scaled(step.factor(t_s))
    }

    /// The load a ramp at `index` starts from: the one at the end of the step before.
    fn start_of_ramp(&self, index: usize) -> StepLoad {
        match index.checked_sub(1) {
            None => self.steps[index].load.zero(),
            Some(before) => {
                let step = &self.steps[before];
                // A ramp ends at its own load, whatever it came from.
                step.load.scaled(step.factor(step.for_s))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan(steps: &str) -> Plan {
        Plan::from_toml(steps, "test.toml").unwrap_or_else(|e| panic!("{e}"))
    }

    fn surge_n(load: &StepLoad) -> f64 {
        match load {
            StepLoad::Wrench(wrench) => wrench.surge_n,
            StepLoad::ThrustN(_) => panic!("a wrench was asked for"),
        }
    }

    #[test]
    fn hold_is_constant_and_zero_follows_the_end() {
        let p = plan("[[step]]\nfor_s = 2.0\nwrench = { surge_n = 4.0 }");
        for (t_s, index, load_n) in [
            (-1.0, 0, 0.0),
            (0.0, 0, 4.0),
            (1.999, 0, 4.0),
            (2.0, 1, 0.0),
            (1e9, 1, 0.0),
        ] {
            let (i, load) = p.load_at(t_s);
            assert_eq!((i, surge_n(&load)), (index, load_n), "at {t_s}");
        }
        assert_eq!(surge_n(&p.load_at(f64::NAN).1), 0.0);
        assert_eq!(surge_n(&p.load_at(f64::INFINITY).1), 0.0);
    }

    #[test]
    fn ramp_runs_from_the_end_of_the_step_before() {
        let p = plan(
            "[[step]]\nfor_s = 2.0\nshape = 'ramp'\nwrench = { surge_n = 4.0 }\n\
             [[step]]\nfor_s = 3.0\nshape = 'sine'\nperiod_s = 4.0\nwrench = { surge_n = 2.0 }\n\
             [[step]]\nfor_s = 4.0\nshape = 'ramp'\nwrench = { surge_n = 6.0, yaw_nm = 1.0 }",
        );
        assert_eq!(surge_n(&p.load_at(0.5).1), 1.0);
        // sin(2 pi 3/4) = -1: the second ramp starts at -2.
        for (t_s, want) in [(5.0, -2.0), (7.0, 2.0), (8.0, 4.0)] {
            let (index, load) = p.load_at(t_s);
            assert_eq!(index, 2);
            assert!((surge_n(&load) - want).abs() < 1e-12, "{t_s}: {load:?}");
        }
        let StepLoad::Wrench(w) = p.load_at(7.0).1 else {
            panic!()
        };
        assert!((w.yaw_nm - 0.5).abs() < 1e-12);
    }

    #[test]
    fn ramp_of_thrusts_also_runs_down_what_is_no_longer_named() {
        let p = plan(
            "[[step]]\nfor_s = 1.0\nthrust_n = { a = 4.0, b = 2.0 }\n\
             [[step]]\nfor_s = 2.0\nshape = 'ramp'\nthrust_n = { b = 4.0, c = 8.0 }",
        );
        let (_, StepLoad::ThrustN(mut thrusts)) = p.load_at(2.0) else {
            panic!()
        };
        thrusts.sort_by(|a, b| a.0.cmp(&b.0));
        assert_eq!(
            thrusts,
            [("a".into(), 2.0), ("b".into(), 3.0), ("c".into(), 4.0)]
        );
    }

    #[test]
    fn sine_and_chirp_follow_their_closed_forms() {
        let p = plan(
            "[[step]]\nfor_s = 5.0\nshape = 'sine'\nperiod_s = 2.5\nphase_deg = 30\nwrench = { surge_n = 3.0 }\n\
             [[step]]\nfor_s = 8.0\nshape = 'chirp'\nf0_hz = 0.2\nf1_hz = 1.0\nwrench = { surge_n = 2.0 }",
        );
        for k in 0..=100 {
            let t_s = 0.05 * f64::from(k) * 0.999;
            let want = 3.0 * (TAU * t_s / 2.5 + 30_f64.to_radians()).sin();
            assert!((surge_n(&p.load_at(t_s).1) - want).abs() < 1e-12);
        }
        // Zero crossings of the chirp: f0 t + (f1 - f0) t^2 / (2 T) = n / 2.
        let a = (1.0 - 0.2) / (2.0 * 8.0);
        for n in 0..9 {
            let t_s = (-0.2 + (0.04_f64 + 4.0 * a * 0.5 * f64::from(n)).sqrt()) / (2.0 * a);
            assert!(
                surge_n(&p.load_at(5.0 + t_s).1).abs() < 1e-9,
                "crossing {n} at {t_s}"
            );
        }
        // Instantaneous frequency at the end is f1: the load falls by 2 pi f1 per second there.
        let (h, end_s) = (1e-6, 13.0 - 1e-5);
        let slope = (surge_n(&p.load_at(end_s).1) - surge_n(&p.load_at(end_s - h).1)) / h;
        let phase: f64 = TAU * (0.2 * 8.0 + 0.5 * 0.8 * 8.0);
        assert!((slope - 2.0 * TAU * phase.cos()).abs() < 1e-2, "{slope}");
    }
}
