//! Whether a rig can do what a plan asks.

use std::f64::consts::{FRAC_PI_2, TAU};

use nalgebra::{DMatrix, DVector, Vector6};
use toml::de::DeTable;

use super::{Plan, PlanStep, Shape, StepLoad, Wrench};
use crate::error::{Problem, ProblemKind, RigError, nearest};
use crate::{Rig, Thruster};

/// Share of a wrench that may be missing before it counts as out of reach: the search
/// for a distribution stops there.
const WRENCH_TOLERANCE: f64 = 1e-3;

/// Commands of one step whose change is looked at; a longer step is sampled.
const MOST_COMMANDS: u32 = 20_000;

impl Plan {
    /// Checks the plan against a rig: names of thrusters, thrust within each curve,
    /// wrenches within what the thrusters together can give, change of pulse within the
    /// slew limit, oscillations slow enough for the command rate.
    ///
    /// The slew of a `wrench` depends on how it is spread over the thrusters and is
    /// checked where that is done; here only that of `thrust_n` is.
    ///
    /// # Errors
    /// [`RigError::Invalid`] with everything this rig cannot do; where its thrusters give a wrench in no way, with the built-in
    /// plans that it can run.
    pub fn check_against(&self, rig: &Rig) -> Result<(), RigError> {
        let Check {
            mut problems,
            out_of_reach,
            ..
        } = self.checked(rig);
        if problems.is_empty() {
            return Ok(());
        }
        let fits = |name: &&str| {
            let plan = Plan::builtin(name);
            plan.is_ok_and(|plan| plan.checked(rig).problems.is_empty())
        };
        let fitting: Vec<&str> = match out_of_reach.is_empty() {
            true => Vec::new(),
            false => Plan::builtin_names().into_iter().filter(fits).collect(),
        };
        for place in out_of_reach {
            let problem = problems.get_mut(place).map(|p| &mut p.kind);
            if let (Some(ProblemKind::Rule { next, .. }), false) = (problem, fitting.is_empty()) {
                *next += &format!("; built-in plans that it can run: {}", fitting.join(", "));
            }
        }
        Err(RigError::Invalid { problems })
    }

    /// Everything that a rig cannot do of it.
    fn checked<'p>(&'p self, rig: &'p Rig) -> Check<'p> {
        let mut check = Check {
            plan: self,
            rig,
            lines: self.step_lines(),
            problems: Vec::new(),
            out_of_reach: Vec::new(),
        };
        for index in 0..self.steps.len() {
            check.rate(index);
            match &self.steps[index].load {
                StepLoad::Wrench(wrench) => check.wrench(index, wrench.to_array()),
                StepLoad::ThrustN(thrusts) => check.thrusts(index, thrusts),
            }
        }
        if check.problems.is_empty() {
            check.slew();
        }
        check
    }

    /// Line of every `[[step]]` in the text the plan came from.
    fn step_lines(&self) -> Vec<Option<usize>> {
        let text = &self.source_toml;
        let line = |offset: usize| 1 + text.bytes().take(offset).filter(|b| *b == b'\n').count();
        let root = DeTable::parse(text).ok();
        (0..self.steps.len())
            .map(|i| {
                let entries = root.as_ref()?.get_ref().get("step")?.get_ref().as_array()?;
                entries.get(i).map(|entry| line(entry.span().start))
            })
            .collect()
    }
}

struct Check<'p> {
    plan: &'p Plan,
    rig: &'p Rig,
    lines: Vec<Option<usize>>,
    problems: Vec<Problem>,
    /// Places of the problems whose wrench no distribution over the thrusters gives.
    out_of_reach: Vec<usize>,
}

impl Check<'_> {
    fn report(&mut self, index: usize, key: &str, what: String, next: String) {
        self.problems.push(Problem {
            file: format!("plan {} on rig {}", self.plan.name, self.rig.name),
            line: self.lines.get(index).copied().flatten(),
            key: format!("step[{index}].{key}"),
            kind: ProblemKind::Rule { what, next },
        });
    }

    fn rate(&mut self, index: usize) {
        let step = &self.plan.steps[index];
        let rate_hz = self.rig.thrusters.link.rate_hz;
        if step.for_s < 1.0 / rate_hz {
            self.report(
                index,
                "for_s",
                format!(
                    "{} s is shorter than the time between commands, {} s: the step may never be sent",
                    step.for_s,
                    1.0 / rate_hz
                ),
                "Lengthen the step or raise thrusters.link.rate_hz".to_owned(),
            );
        }
        let (key, fastest_hz) = match step.shape {
            Shape::Sine { period_s, .. } => ("period_s", 1.0 / period_s),
            Shape::Chirp { f0_hz, f1_hz } => ("f1_hz", f0_hz.max(f1_hz)),
            Shape::Hold | Shape::Ramp => return,
        };
        if fastest_hz > 0.5 * rate_hz {
            self.report(
                index,
                key,
                format!(
                    "{fastest_hz} Hz cannot be sent at {rate_hz} commands/s: at most half of that, {} Hz",
                    0.5 * rate_hz
                ),
                "Slow the oscillation down or raise thrusters.link.rate_hz".to_owned(),
            );
        }
    }

    fn thrusts(&mut self, index: usize, thrusts: &[(String, f64)]) {
        let set = &self.rig.thrusters;
        for (name, thrust_n) in thrusts {
            let Some(thruster) = set.thrusters.iter().find(|t| t.name == *name) else {
                let names = set.thrusters.iter().map(|t| t.name.as_str());
                let meant = nearest(name, names.clone())
                    .map(|word| format!(" (did you mean `{word}`?)"))
                    .unwrap_or_default();
                self.report(
                    index,
                    &format!("thrust_n.{name}"),
                    format!("the rig has no thruster {name}{meant}"),
                    format!("It has {}", names.collect::<Vec<_>>().join(", ")),
                );
                continue;
            };
            let (least_n, most_n) = thruster.curve.thrust_range_n(set.min_us, set.max_us);
            let (low, high) = factor_range(&self.plan.steps[index]);
            for value_n in [thrust_n * low, thrust_n * high] {
                if !(least_n..=most_n).contains(&value_n) {
                    self.report(
                        index,
                        &format!("thrust_n.{name}"),
                        format!(
                            "{value_n} N is beyond what {name} gives between {} and {} us: {least_n} to {most_n} N",
                            set.min_us, set.max_us
                        ),
                        "Ask for less, or correct the thruster's curve".to_owned(),
                    );
                    break;
                }
            }
        }
    }

    fn wrench(&mut self, index: usize, wrench: [f64; 6]) {
        let (low, high) = factor_range(&self.plan.steps[index]);
        for factor in [low, high] {
            let asked = Vector6::from(wrench) * factor;
            let share = reachable_share(self.rig, &asked);
            if share >= 1.0 {
                continue;
            }
            let (what, next) = if share <= 0.0 {
                self.out_of_reach.push(self.problems.len());
                let impossible = impossible(self.rig, &asked);
                let nothing = match impossible.is_empty() {
                    true => String::new(),
                    false => format!(": nothing makes {}", impossible.join(", ")),
                };
                (
                    format!("no combination of the rig's thrusters gives this wrench{nothing}"),
                    "Ask for the components they can give, or correct their positions and directions",
                )
            } else {
                (
                    format!(
                        "the thrusters within their curves reach {:.0} % of {:?} (surge_n, sway_n, heave_n, roll_nm, pitch_nm, yaw_nm)",
                        100.0 * share,
                        asked.as_slice()
                    ),
                    "Ask for less, or correct the thrusters' curves",
                )
            };
            self.report(index, "wrench", what, next.to_owned());
            break;
        }
    }

    /// Pulses of consecutive commands, wherever both are given per thruster.
    fn slew(&mut self) {
        let set = &self.rig.thrusters;
        let interval_s = 1.0 / set.link.rate_hz;
        let most_us = set.max_slew_us_per_s * interval_s;
        for (index, step) in self.plan.steps.iter().enumerate() {
            let commands = (step.for_s / interval_s).ceil();
            let samples = (commands as u32).clamp(1, MOST_COMMANDS);
            let stride = (commands / f64::from(samples)).max(1.0);
            let mut worst: Option<(f64, &Thruster, f64)> = None;
            for k in 0..samples {
                let t_s = (f64::from(k) * stride).floor() * interval_s;
                let (before, now) = (
                    self.load_before(index, t_s - interval_s),
                    self.plan.load_in(index, t_s),
                );
                for thruster in &set.thrusters {
                    let Some(change_us) = self.change_us(thruster, &before, &now) else {
                        continue;
                    };
                    if change_us > most_us && worst.is_none_or(|(w, ..)| change_us > w) {
                        worst = Some((change_us, thruster, t_s));
                    }
                }
            }
            if let Some((change_us, thruster, t_s)) = worst {
                let what = format!(
                    "{} would jump by {change_us:.0} us within one command interval, {t_s:.3} s into the step; max_slew_us_per_s = {} allows {most_us:.0} us",
                    thruster.name, set.max_slew_us_per_s
                );
                let next = "Lead into it with a step of shape = \"ramp\", or ask for less";
                self.report(index, "thrust_n", what, next.to_owned());
            }
        }
    }

    /// The load of the command before, at `t_s` into step `index` or in the step before it.
    fn load_before(&self, index: usize, t_s: f64) -> StepLoad {
        if t_s >= 0.0 {
            return self.plan.load_in(index, t_s);
        }
        match index.checked_sub(1) {
            None => self.plan.steps[index].load.zero(),
            Some(before) => {
                let end_s = self.plan.steps[before].for_s;
                self.plan.load_in(before, (end_s + t_s).max(0.0))
            }
        }
    }

    /// Change of one thruster's pulse between two commands \[us\]; `None` where a wrench
    /// decides over it.
    fn change_us(&self, thruster: &Thruster, before: &StepLoad, now: &StepLoad) -> Option<f64> {
        let neutral_us = self.rig.thrusters.neutral_us;
        let pulse_us = |load: &StepLoad| {
            let thrust_n = match load {
                StepLoad::ThrustN(thrusts) => thrusts
                    .iter()
                    .find(|(name, _)| *name == thruster.name)
                    .map_or(0.0, |(_, thrust_n)| *thrust_n),
                StepLoad::Wrench(wrench) if *wrench == Wrench::default() => 0.0,
                StepLoad::Wrench(_) => return None,
            };
            thruster.curve.pulse_us(thrust_n, neutral_us)
        };
        Some((pulse_us(now)? - pulse_us(before)?).abs())
    }
}

/// Smallest and largest factor on a step's load while it runs.
fn factor_range(step: &PlanStep) -> (f64, f64) {
    let sine_over = |from: f64, to: f64| {
        let holds = |peak: f64| ((from - peak) / TAU).ceil() * TAU + peak <= to;
        let (a, b) = (from.sin(), to.sin());
        (
            if holds(-FRAC_PI_2) { -1.0 } else { a.min(b) },
            if holds(FRAC_PI_2) { 1.0 } else { a.max(b) },
        )
    };
    match step.shape {
        // A ramp runs between two loads that are checked where they stand.
        Shape::Hold | Shape::Ramp => (1.0, 1.0),
        Shape::Sine {
            period_s,
            phase_rad,
        } => sine_over(phase_rad, phase_rad + TAU * step.for_s / period_s),
        // Frequencies are not negative, so the phase only grows.
        Shape::Chirp { f0_hz, f1_hz } => sine_over(0.0, TAU * 0.5 * (f0_hz + f1_hz) * step.for_s),
    }
}

/// Loads by the names of plans, in the order of a wrench.
const LOADS: [&str; 6] = [
    "surge_n", "sway_n", "heave_n", "roll_nm", "pitch_nm", "yaw_nm",
];

/// Components of a wrench that no distribution over the thrusters gives by itself.
fn impossible(rig: &Rig, wrench: &Vector6<f64>) -> Vec<&'static str> {
    let cannot = |d: &usize| {
        let mut alone = Vector6::zeros();
        alone[*d] = wrench[*d];
        reachable_share(rig, &alone) <= 0.0
    };
    (0..LOADS.len())
        .filter(cannot)
        .filter_map(|d| LOADS.get(d).copied())
        .collect()
}

/// The largest share, up to 1, of `wrench` \[N, N m\] that some distribution over the
/// thrusters within their curves gives; 0 when none gives any of it.
fn reachable_share(rig: &Rig, wrench: &Vector6<f64>) -> f64 {
    if wrench.norm() == 0.0 {
        return 1.0;
    }
    let set = &rig.thrusters;
    let columns: Vec<Vector6<f64>> = set.thrusters.iter().map(wrench_per_newton).collect();
    let effect = DMatrix::from_fn(6, columns.len(), |row, k| columns[k][row]);
    let limits: Vec<(f64, f64)> = set
        .thrusters
        .iter()
        .map(|t| t.curve.thrust_range_n(set.min_us, set.max_us))
        .collect();
    let reached = |share: f64| {
        let asked = DVector::from_iterator(6, (wrench * share).iter().copied());
        missing(&effect, &limits, &asked) <= WRENCH_TOLERANCE * asked.norm()
    };
    if reached(1.0) {
        return 1.0;
    }
    // The set of wrenches within reach is convex and holds zero: bisection is exact.
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..10 {
        let middle = 0.5 * (low + high);
        if reached(middle) {
            low = middle
        } else {
            high = middle
        }
    }
    low
}

/// Wrench of one newton of a thruster: (d, r × d).
fn wrench_per_newton(thruster: &Thruster) -> Vector6<f64> {
    let [dx, dy, dz] = thruster.direction;
    let [x, y, z] = thruster.position_m;
    Vector6::new(
        dx,
        dy,
        dz,
        y * dz - z * dy,
        z * dx - x * dz,
        x * dy - y * dx,
    )
}

/// Smallest |B t − w| with every t within its limits: coordinate descent, which for
/// least squares with box bounds ends at the minimum.
fn missing(effect: &DMatrix<f64>, limits: &[(f64, f64)], asked: &DVector<f64>) -> f64 {
    let mut residual = -asked;
    let mut thrust_n = vec![0.0; limits.len()];
    let sizes: Vec<f64> = effect.column_iter().map(|c| c.norm_squared()).collect();
    for _ in 0..3000 {
        let mut moved = 0.0_f64;
        for (k, &(least, most)) in limits.iter().enumerate() {
            let column = effect.column(k);
            let wanted = thrust_n[k] - column.dot(&residual) / sizes[k];
            let step = wanted.clamp(least.min(0.0), most.max(0.0)) - thrust_n[k];
            if step != 0.0 {
                thrust_n[k] += step;
                residual.axpy(step, &column, 1.0);
                moved = moved.max(step.abs());
            }
        }
        if moved < 1e-9 * (1.0 + asked.norm()) {
            break;
        }
    }
    residual.norm()
}

#[cfg(test)]
mod tests;
