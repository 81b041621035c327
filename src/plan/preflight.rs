//! The plan, simulated before it runs: refused when it leaves the tank, the limits, the lit target,
//! or the range and slew of the pulses. `--dry-run` shows the same report.

use crate::seen::{Extent, edges};
use crate::setpoint::{SetpointError, setpoint};
use hydroline_calib::analytic::IdealMap;
use hydroline_calib::plane::PlaneMap;
use hydroline_rigs::channel::Channel;
use hydroline_rigs::{Plan, Rig};
use hydroline_sim::{SimError, World};
use serde::Serialize;

/// Grid of the check \[s\]: at 0.3 m/s the vehicle goes 6 mm from point to point.
const STEP_S: f64 = 0.02;
/// First words of the violation where the stripe leaves the target.
const OFF: &str = "stripe off the lit target";
/// Last words of the kinds of violations where the vehicle leaves what it must stay in.
const LEAVING: [&str; 2] = [" against the tank", " against [limits]"];
/// Coasting after the plan's last step that is still watched \[s\].
const COAST_S: f64 = 5.0;

/// Smallest and largest value of something over the plan.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct Range {
    /// Name of the quantity, with its unit.
    pub name: String,
    /// Smallest value.
    pub min: f64,
    /// Largest value.
    pub max: f64,
}

/// Something a plan does that it must not.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct Violation {
    /// When it first happens \[s\].
    pub at_s: f64,
    /// Violation in words, with value and allowed range.
    pub what: String,
}

impl Violation {
    /// Kind of the violation: its words up to the colon.
    pub fn kind(&self) -> &str {
        let parts = self.what.split_once(": ");
        parts.map_or(self.what.as_str(), |(kind, _)| kind)
    }

    /// Whether the vehicle leaves the tank or the rig's `[limits]`; else a pulse is not allowed or the target is lost.
    pub fn is_leaving(&self) -> bool {
        LEAVING.iter().any(|end| self.kind().ends_with(end))
    }
}

impl std::fmt::Display for Violation {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "at {:.2} s {}", self.at_s, self.what)
    }
}

/// Forecast of a plan, by the rig's model.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct Preflight {
    /// Length of the plan \[s\].
    pub duration_s: f64,
    /// Number of runs, one from where the one before has left the vehicle.
    pub runs: u32,
    /// From the start of one run to the start of the next \[s\]; 0 = one run only.
    pub cycle_s: f64,
    /// Where each run starts, (x, y, z, phi, theta, psi) \[m, rad\], and how fast the vehicle then still is \[m/s\].
    pub starts: Vec<RunStart>,
    /// Ranges of pose, rates, pulses.
    pub ranges: Vec<Range>,
    /// From when to when the stripe lies on the target \[s\]; `None` = no target, or never.
    pub on_target_s: Option<(f64, f64)>,
    /// Fewest of the target's two long edges that the lit line crosses in the image while the plan runs; `None` = no target.
    pub least_edges: Option<u8>,
    /// Violations of limits, tank or target.
    pub violations: Vec<Violation>,
}

/// The vehicle at the start of a run.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, schemars::JsonSchema)]
pub struct RunStart {
    /// Pose in the tank \[m, rad\].
    pub pose: [f64; 6],
    /// Speed, all axes together \[m/s\].
    pub speed_mps: f64,
}

/// A run that starts faster than this does not start from rest \[m/s\]: 1 % of the paper's 0.2 m/s.
const AT_REST_MPS: f64 = 0.002;

/// Runs of one plan, one after the other.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Repeats {
    /// Number of runs, from 1.
    pub runs: u32,
    /// From the start of one to the start of the next \[s\]: the plan, what is recorded behind it, and the pause.
    pub cycle_s: f64,
    /// Time of the plan that runs before the recording ends \[s\]; neutral from there.
    pub active_s: f64,
}

impl Repeats {
    /// One run.
    pub const ONCE: Self = Self {
        runs: 1,
        cycle_s: 0.0,
        active_s: f64::INFINITY,
    };
}

/// Why a plan could not even be simulated.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum PreflightError {
    #[error(transparent)]
    Sim(#[from] SimError),
    /// A load that cannot be commanded.
    #[error(transparent)]
    Setpoint(#[from] SetpointError),
}

/// Runs the plan through the rig's model from the rig's start pose, seen by the rig's ideal camera.
///
/// # Errors
/// [`PreflightError`]; what the plan does wrong is in [`Preflight::violations`].
pub fn preflight(rig: &Rig, plan: &Plan) -> Result<Preflight, PreflightError> {
    preflight_runs(rig, plan, Repeats::ONCE, None)
}

/// Runs the plan `repeats.runs` times, each run from where the one before has left the vehicle.
///
/// `map` = the map from image to laser plane that poses will come from; `None` = the rig's ideal camera.
///
/// # Errors
/// As [`preflight`].
pub fn preflight_runs(
    rig: &Rig,
    plan: &Plan,
    repeats: Repeats,
    map: Option<&dyn PlaneMap>,
) -> Result<Preflight, PreflightError> {
    checked(rig, plan, repeats, map, &|_| true)
}

/// Whether a rig runs a plan and sees so many of its target's long edges all the while: the simulation ends where it does not.
///
/// # Errors
/// As [`preflight`].
pub fn passes(
    rig: &Rig,
    plan: &Plan,
    map: Option<&dyn PlaneMap>,
    least_edges: u8,
) -> Result<bool, PreflightError> {
    let goes_on = |check: &Check<'_>| {
        check.violations.is_empty() && (check.target.is_none() || check.least_edges >= least_edges)
    };
    let report = checked(rig, plan, Repeats::ONCE, map, &goes_on)?;
    let seen = report.least_edges.is_none_or(|edges| edges >= least_edges);
    Ok(report.violations.is_empty() && seen)
}

/// The simulation, as long as `goes_on` says so.
fn checked(
    rig: &Rig,
    plan: &Plan,
    repeats: Repeats,
    map: Option<&dyn PlaneMap>,
    goes_on: &dyn Fn(&Check<'_>) -> bool,
) -> Result<Preflight, PreflightError> {
    let mut world = World::new(rig, rig.tank.start_pose)?;
    let ideal = IdealMap::of(rig);
    let mut check = Check::new(rig, plan, repeats, map.unwrap_or(&ideal));
    let period_s = 1.0 / rig.thrusters.link.rate_hz;
    let mut next_command = 0u64;
    let last_start_s = repeats.cycle_s * f64::from(repeats.runs.saturating_sub(1));
    let steps = ((last_start_s + plan.duration_s() + COAST_S) / STEP_S).ceil() as u64;
    for k in 0..=steps {
        let t_s = k as f64 * STEP_S;
        while next_command as f64 * period_s <= t_s {
            let command_s = next_command as f64 * period_s;
            let in_plan_s = check.in_plan_s(command_s);
            let set = setpoint(rig, world.allocation(), plan, in_plan_s)?;
            if in_plan_s.is_finite() {
                check.pulses(command_s, period_s, &set.pulses_us);
            } else {
                // The end of a recording puts the thrusters to neutral whatever the slew.
                check.last_pulses_us.copy_from_slice(&set.pulses_us);
            }
            world.command_pulses(command_s, &set.pulses_us)?;
            next_command += 1;
        }
        let state = world.state_at(t_s)?;
        check.state(t_s, &state.eta, &state.nu);
        if !goes_on(&check) {
            break;
        }
    }
    Ok(check.done())
}

struct Check<'a> {
    rig: &'a Rig,
    map: &'a dyn PlaneMap,
    plan: &'a Plan,
    repeats: Repeats,
    starts: Vec<RunStart>,
    ranges: Vec<Range>,
    violations: Vec<Violation>,
    last_pulses_us: Vec<f64>,
    target: Option<Extent>,
    on_target_s: Option<(f64, f64)>,
    least_edges: u8,
}

impl<'a> Check<'a> {
    fn new(rig: &'a Rig, plan: &'a Plan, repeats: Repeats, map: &'a dyn PlaneMap) -> Self {
        let empty = |name: String| Range {
            name,
            min: f64::INFINITY,
            max: f64::NEG_INFINITY,
        };
        let pulses = rig
            .thrusters
            .thrusters
            .iter()
            .map(|t| format!("{}.pulse_us", t.name));
        Self {
            rig,
            map,
            plan,
            repeats,
            starts: Vec::new(),
            ranges: Channel::ALL
                .into_iter()
                .map(|c| c.name().to_owned())
                .chain(pulses)
                .map(empty)
                .collect(),
            violations: Vec::new(),
            last_pulses_us: vec![rig.thrusters.neutral_us; rig.thrusters.thrusters.len()],
            target: rig.target.as_ref().and_then(Extent::of),
            on_target_s: None,
            least_edges: 2,
        }
    }

    /// The run that is on at `t_s`, from 0.
    fn run(&self, t_s: f64) -> u32 {
        if self.repeats.cycle_s <= 0.0 {
            return 0;
        }
        // A hair later, so that a grid point at the very start of a run belongs to it.
        let run = ((t_s + 1e-9) / self.repeats.cycle_s).floor();
        (run as u32).min(self.repeats.runs.saturating_sub(1))
    }

    /// Time in the plan of the run that is on \[s\]; infinite once its recording is over.
    fn in_plan_s(&self, t_s: f64) -> f64 {
        let since_s = (t_s - f64::from(self.run(t_s)) * self.repeats.cycle_s).max(0.0);
        if since_s <= self.repeats.active_s {
            since_s
        } else {
            f64::INFINITY
        }
    }

    fn widen(&mut self, index: usize, value: f64) {
        if let Some(range) = self.ranges.get_mut(index) {
            range.min = range.min.min(value);
            range.max = range.max.max(value);
        }
    }

    /// The first time of each kind of violation is enough to act on.
    fn violate(&mut self, at_s: f64, kind: &str, what: impl FnOnce() -> String) {
        if !self.violations.iter().any(|v| v.what.starts_with(kind)) {
            let run = match self.repeats.runs {
                0 | 1 => String::new(),
                runs => format!(" (run {} of {runs})", self.run(at_s) + 1),
            };
            self.violations.push(Violation {
                at_s,
                what: format!("{kind}: {}{run}", what()),
            });
        }
    }

    fn pulses(&mut self, t_s: f64, period_s: f64, pulses_us: &[f64]) {
        let set = &self.rig.thrusters;
        for (i, &pulse_us) in pulses_us.iter().enumerate() {
            self.widen(Channel::ALL.len() + i, pulse_us);
            let name = set.thrusters.get(i).map_or("?", |t| t.name.as_str());
            if !(set.min_us..=set.max_us).contains(&pulse_us) {
                self.violate(t_s, &format!("pulse of {name}"), || {
                    format!(
                        "{pulse_us:.1} us, allowed {} .. {} us",
                        set.min_us, set.max_us
                    )
                });
            }
            let slew = (pulse_us - self.last_pulses_us[i]).abs() / period_s;
            if slew > set.max_slew_us_per_s {
                self.violate(t_s, &format!("slew of {name}"), || {
                    format!(
                        "{slew:.0} us/s, allowed {} us/s: use shape = \"ramp\"",
                        set.max_slew_us_per_s
                    )
                });
            }
        }
        self.last_pulses_us.copy_from_slice(pulses_us);
    }

    fn state(&mut self, t_s: f64, eta: &[f64; 6], nu: &[f64; 6]) {
        if self.starts.len() as u32 <= self.run(t_s) {
            self.starts.push(RunStart {
                pose: *eta,
                speed_mps: nu[0].hypot(nu[1]).hypot(nu[2]),
            });
        }
        for (i, value) in eta.iter().chain(nu).enumerate() {
            self.widen(i, *value);
        }
        let (tank, limits) = (self.rig.tank, self.rig.limits);
        let inside = |value: f64, [low, high]: [f64; 2]| (low..=high).contains(&value);
        let boxes = [
            ("x against the tank", eta[0], tank.x_m),
            ("y against the tank", eta[1], tank.y_m),
            ("z against the tank", eta[2], [-tank.depth_m, 0.0]),
            ("x against [limits]", eta[0], limits.x_m),
            ("y against [limits]", eta[1], limits.y_m),
            ("z against [limits]", eta[2], limits.z_m),
        ];
        for (kind, value, range) in boxes {
            if !inside(value, range) {
                self.violate(t_s, kind, || {
                    format!("{value:.3} m, allowed {} .. {} m", range[0], range[1])
                });
            }
        }
        for (kind, value) in [
            ("roll against [limits]", eta[3]),
            ("pitch against [limits]", eta[4]),
        ] {
            if value.abs() > limits.attitude_rad {
                self.violate(t_s, kind, || {
                    format!(
                        "{:.1} deg, allowed +-{:.1} deg",
                        value.to_degrees(),
                        limits.attitude_rad.to_degrees()
                    )
                });
            }
        }
        self.on_target(t_s, eta);
    }

    /// Whether the lit line reaches the target: its foot between the target's ends, and at least one of the
    /// target's long edges inside the fan (an estimator needs an edge to see sway and yaw).
    fn on_target(&mut self, t_s: f64, eta: &[f64; 6]) {
        let (Some(extent), Some(target)) = (self.target, self.rig.target.as_ref()) else {
            return;
        };
        let [origin_x, origin_y, heading] = target.origin;
        let l_laser_m = self.rig.mounts.l_laser_m;
        let (x, y) = (
            eta[0] + l_laser_m * eta[5].cos() - origin_x,
            eta[1] + l_laser_m * eta[5].sin() - origin_y,
        );
        let along = x * heading.cos() + y * heading.sin();
        let across = y * heading.cos() - x * heading.sin();
        let yaw = eta[5] - heading;
        // The line runs across the heading; at distance s from its foot it is s cos(yaw) further across.
        let half_fan_m = -eta[2] * (0.5 * self.rig.laser.fan_rad).tan();
        let lit = |edge_m: f64| ((edge_m - across) / yaw.cos()).abs() <= half_fan_m;
        let ends = (extent.x0_m..=extent.x1_m).contains(&along);
        let sides = lit(0.5 * extent.width_m) || lit(-0.5 * extent.width_m);
        if self.in_plan_s(t_s) <= self.plan.duration_s() {
            let seen = edges(self.rig, self.map, &extent, eta);
            self.least_edges = self.least_edges.min(seen);
            if seen == 0 && ends && sides {
                self.violate(t_s, "target's long edges out of sight", || {
                    let [x, y, z, phi, theta, psi] = *eta;
                    let [phi, theta, psi] = [phi, theta, psi].map(f64::to_degrees);
                    format!("at x {x:.3} m, y {y:.3} m, z {z:.3} m, roll {phi:.1}, pitch {theta:.1}, heading {psi:.1} deg none is inside image, fan and calibrated region, a pose needs one")
                });
            }
        }
        if ends && sides {
            self.on_target_s = Some(self.on_target_s.map_or((t_s, t_s), |(from, _)| (from, t_s)));
        } else if self.in_plan_s(t_s) <= self.plan.duration_s() {
            let kind = if ends {
                "stripe off the lit target sideways"
            } else {
                OFF
            };
            self.violate(t_s, kind, || {
                if ends {
                    let half_m = 0.5 * extent.width_m;
                    format!("foot {across:.3} m across, fan +-{half_fan_m:.3} m, target's edges at +-{half_m:.3} m")
                } else {
                    let (x0, x1) = (extent.x0_m, extent.x1_m);
                    format!("at {along:.3} m along it, it reaches from {x0:.3} to {x1:.3} m")
                }
            });
        }
    }

    fn done(self) -> Preflight {
        Preflight {
            duration_s: self.plan.duration_s(),
            runs: self.repeats.runs,
            cycle_s: self.repeats.cycle_s,
            starts: self.starts,
            ranges: self.ranges,
            on_target_s: self.on_target_s,
            least_edges: self.target.map(|_| self.least_edges),
            violations: self.violations,
        }
    }
}

impl std::fmt::Display for Preflight {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        writeln!(
            f,
            "plan of {:.2} s, simulated with the rig's model (and {COAST_S} s of coasting):",
            self.duration_s
        )?;
        if self.runs > 1 {
            writeln!(
                f,
                "{} runs, one every {:.1} s, each from where the one before has left the vehicle:",
                self.runs, self.cycle_s
            )?;
            for (k, start) in self.starts.iter().enumerate() {
                let [x, y, z, _, _, psi] = start.pose;
                let moving = if start.speed_mps > AT_REST_MPS {
                    "; still moving: a longer --settle lets it come to rest"
                } else {
                    ""
                };
                writeln!(
                    f,
                    "  run {:<3} starts at x {x:.3} m, y {y:.3} m, z {z:.3} m, heading {:.2} deg, {:.4} m/s{moving}",
                    k + 1,
                    psi.to_degrees(),
                    start.speed_mps
                )?;
            }
        }
        for range in &self.ranges {
            // People think of angles in degrees; `--json` stays with SI.
            let (name, unit) = match range.name.strip_suffix("_radps") {
                Some(name) => (format!("{name}_degps"), 1f64.to_degrees()),
                None => match range.name.strip_suffix("_rad") {
                    Some(name) => (format!("{name}_deg"), 1f64.to_degrees()),
                    None => (range.name.clone(), 1.0),
                },
            };
            writeln!(
                f,
                "  {name:<24} {:>10.4} .. {:>10.4}",
                range.min * unit,
                range.max * unit
            )?;
        }
        if let Some((from, to)) = self.on_target_s {
            let off = self.violations.iter().find(|v| v.what.starts_with(OFF));
            let to = off.map_or(to, |v| v.at_s);
            writeln!(f, "  stripe on the target from {from:.2} to {to:.2} s")?;
        }
        if let Some(edges) = self.least_edges {
            writeln!(
                f,
                "  at least {edges} of the target's two long edges in sight (image, fan, calibrated region) while the plan runs"
            )?;
        }
        for violation in &self.violations {
            writeln!(
                f,
                "  REFUSED at {:.2} s: {}",
                violation.at_s, violation.what
            )?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rig() -> Rig {
        Rig::builtin("lshpi").unwrap()
    }

    fn plan(text: &str) -> Plan {
        Plan::from_toml(text, "test.toml").unwrap()
    }

    #[test]
    fn the_papers_surge_run_passes_and_goes_one_metre() {
        let report = preflight(&rig(), &Plan::builtin("surge-4n").unwrap()).unwrap();
        assert_eq!(report.violations, Vec::new());
        let x = &report.ranges[0];
        assert!(x.max - x.min > 1.0, "{x:?}");
    }

    /// Built-in vehicles have a plan of all their degrees of freedom that may be recorded as it is, both edges in sight.
    #[test]
    fn each_bluerov2_has_a_plan_that_stays_over_the_target() {
        for name in ["bluerov2", "bluerov2-heavy"] {
            let rig = Rig::builtin(name).unwrap();
            let plan = Plan::builtin(&format!("{name}-mixed")).unwrap();
            let report = preflight(&rig, &plan).unwrap();
            assert_eq!(report.violations, Vec::new(), "{name}");
            assert_eq!(report.least_edges, Some(2), "{name}");
        }
    }

    #[test]
    fn a_plan_that_leaves_the_target_is_refused_with_time_and_place() {
        let report = preflight(
            &rig(),
            &plan("[[step]]\nfor_s = 60\nwrench = { surge_n = 8 }\n"),
        )
        .unwrap();
        let words: Vec<_> = report.violations.iter().map(|v| v.what.as_str()).collect();
        assert!(
            words
                .iter()
                .any(|w| w.starts_with("stripe off the lit target")),
            "{words:?}"
        );
        assert!(
            words.iter().any(|w| w.starts_with("x against")),
            "{words:?}"
        );
        for violation in &report.violations {
            let of_place = ["x against the tank", "x against [limits]"];
            let is_of_place = of_place.contains(&violation.kind());
            assert_eq!(violation.is_leaving(), is_of_place, "{violation}");
        }
    }

    #[test]
    fn leaving_the_target_sideways_is_refused() {
        let mut rig = rig();
        rig.limits.y_m = [-10.0, 10.0];
        rig.tank.y_m = [-10.0, 10.0];
        let text = "[[step]]\nfor_s = 25\nwrench = { sway_n = 8 }\n";
        let report = preflight(&rig, &plan(text)).unwrap();
        let words: Vec<_> = report.violations.iter().map(|v| v.what.as_str()).collect();
        assert!(
            words
                .iter()
                .any(|w| w.starts_with("stripe off the lit target sideways")),
            "{words:?}"
        );
        // 0.28 m of sway, the paper's range, still shows an edge.
        let text = "[[step]]\nfor_s = 6\nwrench = { sway_n = 4 }\n";
        assert_eq!(preflight(&rig, &plan(text)).unwrap().violations, Vec::new());
    }

    #[test]
    fn a_second_run_starts_where_the_first_has_left_the_vehicle() {
        let twice = |settle_s: f64| {
            let plan = Plan::builtin("surge-4n").unwrap();
            let repeats = Repeats {
                runs: 2,
                cycle_s: plan.duration_s() + 1.5 + settle_s,
                active_s: plan.duration_s() + 1.0,
            };
            preflight_runs(&rig(), &plan, repeats, None).unwrap()
        };
        let report = twice(60.0);
        let [first, second] = report.starts[..] else {
            panic!("{:?}", report.starts)
        };
        assert_eq!(first.pose, rig().tank.start_pose);
        // The paper's run is a metre, so that a second one behind it has no target left to run over.
        assert!(second.pose[0] - first.pose[0] > 1.0, "{second:?}");
        let off = report.violations.first().map(|v| v.what.as_str());
        assert!(off.is_some_and(|w| w.contains("run ")), "{off:?}");
        assert!(
            report.to_string().contains("run 2   starts at x"),
            "{report}"
        );
        // Without a pause it starts in full motion, and that is said.
        let hasty = twice(0.0);
        assert!(hasty.starts[1].speed_mps > 10.0 * second.speed_mps);
        assert!(hasty.to_string().contains("--settle"), "{hasty}");
    }

    #[test]
    fn angles_are_shown_in_degrees_and_stated_in_radians() {
        let report = preflight(&rig(), &Plan::builtin("surge-4n").unwrap()).unwrap();
        let shown = report.to_string();
        assert!(
            shown.contains("psi_deg") && shown.contains("r_degps"),
            "{shown}"
        );
        assert!(!shown.contains("_rad"), "{shown}");
        assert!(report.ranges.iter().any(|r| r.name == "theta_rad"));
    }

    #[test]
    fn diving_to_the_floor_is_refused() {
        let report = preflight(
            &rig(),
            &plan("[[step]]\nfor_s = 20\nwrench = { heave_n = 8 }\n"),
        )
        .unwrap();
        assert!(
            report
                .violations
                .iter()
                .any(|v| v.what.starts_with("z against")),
            "{:?}",
            report.violations
        );
    }

    #[test]
    fn slamming_the_thrusters_is_refused_with_the_cure() {
        let mut rig = rig();
        rig.thrusters.max_slew_us_per_s = 300.0;
        let report = preflight(&rig, &Plan::builtin("surge-4n").unwrap()).unwrap();
        assert!(
            report
                .violations
                .iter()
                .any(|v| v.what.contains("slew of h_") && v.what.contains("ramp")),
            "{report}"
        );
    }
}
