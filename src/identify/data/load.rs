//! From a log, ours or anyone's, to a [`Run`].

use std::path::Path;

use hydroline_rigs::{Dof, Rig};
use hydroline_sim::thrust::{Commanded, Target};
use hydroline_sim::{Allocation, ThrustError};

use hydroline_core::run::{
    Channel, Command, Joined, Loadings, Run, Sample, SharedErrors, StillNoise, instrument_sd,
};

use super::{NOISE_KEY, autopilot};
use hydroline_log::messages::{pb, timestamp, unix_ns};
use hydroline_log::{LogError, LogReader, Record};

/// Failure to make a run of a log.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum LoadError {
    #[error(transparent)]
    Log(#[from] LogError),
    #[error(transparent)]
    Thrust(#[from] ThrustError),
    #[error(
        "{log}: no /vehicle/motion in it ({frames} images); {}",
        if *frames > 0 { "first measure the pose: hydroline replay LOG --rig RIG --out NEW.mcap" } else { "record, replay or import motion first" }
    )]
    NoMotion { log: String, frames: usize },
    #[error(
        "{log}: no motion between {from_s} s and {to_s} s; it ends at {end_s:.2} s: choose another LOG@FROM..TO"
    )]
    EmptyWindow {
        log: String,
        from_s: f64,
        to_s: f64,
        end_s: f64,
    },
    #[error(
        "{log}: {commands} commands to '{thruster}', which is neither a thruster of the rig ({known}) nor surge, sway, heave, roll, pitch, yaw; use the rig this log was made with"
    )]
    UnknownThruster {
        log: String,
        thruster: String,
        commands: usize,
        known: String,
    },
    #[error(
        "{log}: another vehicle than the rig's by the rig it carries: {differences}; give the rig of this vehicle, or --other-rig if they are one"
    )]
    OtherVehicle { log: String, differences: String },
    #[error("{log}: the command to '{thruster}' at {t_s:.3} s is {value}; it must be finite")]
    CommandNotFinite {
        log: String,
        thruster: String,
        t_s: f64,
        value: f64,
    },
}

/// Reads a log.
///
/// # Errors
/// [`LoadError`].
pub fn load(path: &Path, rig: &Rig) -> Result<Run, LoadError> {
    let name = path.file_stem().map_or_else(
        || path.display().to_string(),
        |s| s.to_string_lossy().into_owned(),
    );
    let (mut commands, mut motion, mut frames) = (Vec::new(), Vec::new(), 0);
    let mut beside = Vec::new();
    let mut reader = LogReader::open(path)?;
    for message in reader.by_ref() {
        match message?.record {
            Record::Command(command) => commands.push(command),
            Record::Motion(sample) => motion.push(sample),
            Record::AutopilotMotion(sample) => beside.push(sample),
            Record::Frame(_) => frames += 1,
            _ => {}
        }
    }
    autopilot::beside(&mut motion, beside);
    if motion.is_empty() {
        return Err(LoadError::NoMotion {
            log: path.display().to_string(),
            frames,
        });
    }
    let mut run = load_messages(&name, &commands, &motion, rig)?;
    if let Some(session) = reader.metadata().get("session") {
        run.joined = Joined::of(session);
        run.instrument_sd = instrument_sd::of_session(session);
    }
    // Runs through one calibration share its errors.
    let calibration = reader.metadata().get("calibration");
    let toml = calibration.and_then(|m| m.get("toml"));
    if let (Some(shared), Some(toml)) = (&mut run.shared_errors, toml) {
        shared.owner.clone_from(toml);
    }
    // Metadata at the log's end is known only now.
    let stored = reader
        .metadata()
        .get("summary")
        .and_then(|m| m.get(NOISE_KEY));
    if let Some(json) = stored {
        match serde_json::from_str::<StillNoise>(json) {
            Ok(noise) => run.noise_at_rest = Some(noise),
            Err(error) => run.notes.push(format!(
                "the noise stored in this log cannot be read ({error})"
            )),
        }
    }
    Ok(run)
}

/// The same from messages already in memory.
///
/// Pulses go through the curves of `rig` (so a curve measured later counts), thrusts where no
/// pulse was sent are taken as logged; components "surge" .. "yaw" act directly.
///
/// # Errors
/// [`LoadError`] except for reading.
pub fn load_messages(
    name: &str,
    commands: &[pb::ThrusterCommand],
    motion: &[pb::VehicleMotion],
    rig: &Rig,
) -> Result<Run, LoadError> {
    let stamp = |t: &Option<prost_types::Timestamp>| unix_ns(t.as_ref().unwrap_or(&timestamp(0)));
    let first = commands
        .iter()
        .map(|c| stamp(&c.timestamp))
        .chain(motion.iter().map(|m| stamp(&m.timestamp)))
        .min();
    let start_ns = first.unwrap_or(0);
    // Differences of u64 ns, not of f64 s: UNIX time in f64 resolves only 0.2 us.
    let since_s = |ns: u64| ns.saturating_sub(start_ns) as f64 * 1e-9;
    let mut run = Run {
        name: name.to_owned(),
        start_ns,
        ..Run::default()
    };
    run.from_pulses = !commands.is_empty() && commands.iter().all(|c| c.pulse_us > 0.0);
    run.commands = wrenches(
        name,
        commands,
        rig,
        |c| since_s(stamp(&c.timestamp)),
        &mut run.notes,
    )?;
    let (mut repeated, mut not_finite) = (0usize, 0usize);
    let mut ordered: Vec<(u64, &pb::VehicleMotion)> =
        motion.iter().map(|m| (stamp(&m.timestamp), m)).collect();
    let backwards = ordered.windows(2).filter(|w| w[1].0 < w[0].0).count();
    ordered.sort_by_key(|(ns, _)| *ns);
    let mut last_ns = None;
    let mut poses = Vec::new();
    for (ns, message) in ordered {
        if last_ns == Some(ns) {
            repeated += 1;
            continue;
        }
        last_ns = Some(ns);
        run.companions
            .push(since_s(ns), finite(message.companions(), &mut not_finite));
        let sample = sample(message, since_s(ns), &mut not_finite);
        poses.extend(loadings(message, since_s(ns)));
        if sample.values.iter().any(|v| v.is_finite()) {
            run.samples.push(sample);
        }
    }
    run.shared_errors = (!poses.is_empty()).then(|| SharedErrors {
        owner: name.to_owned(),
        poses,
    });
    let wraps = unwrap_angles(&mut run.samples);
    note_absurd(&mut run, rig);
    let mut note = |count: usize, words: &str| {
        if count > 0 {
            run.notes.push(format!("{count} {words}"));
        }
    };
    note(backwards, "motion stamps go backwards; sorted by stamp");
    note(
        repeated,
        "motion samples repeat a stamp; only the first of each was used",
    );
    note(not_finite, "motion values are not finite; left out");
    note(
        wraps,
        "jumps of a whole turn in an angle; continued without the jump",
    );
    Ok(run)
}

/// Continues angles over +-pi; returns the number of jumps taken out.
fn unwrap_angles(samples: &mut [Sample]) -> usize {
    [Channel::Phi, Channel::Theta, Channel::Psi]
        .into_iter()
        .map(|channel| unwrap_turns(samples.iter_mut().map(|s| &mut s.values[channel])))
        .sum()
}

/// Continues an angle \[rad\] over +-pi; returns the number of jumps taken out. NaN stays.
pub fn unwrap_turns<'a>(angle: impl Iterator<Item = &'a mut f64>) -> usize {
    use std::f64::consts::{PI, TAU};
    let (mut turns, mut last, mut jumps) = (0.0, f64::NAN, 0);
    for value in angle.filter(|v| v.is_finite()) {
        if (*value - last).abs() > PI {
            turns -= ((*value - last) / TAU).round() * TAU;
            jumps += 1;
        }
        last = *value;
        *value += turns;
    }
    jumps
}

/// The most a rig can make of a command: a thruster's thrust \[N\], or of a component `surge` .. `yaw`
/// \[N, N m\] what all thrusters make together; `None` = neither of the two.
pub fn capacity(rig: &Rig, name: &str) -> Option<f64> {
    let set = &rig.thrusters.thrusters;
    let most = |points: &[(f64, f64)]| points.iter().fold(0.0_f64, |m, p| m.max(p.1.abs()));
    if let Some(thruster) = set.iter().find(|t| t.name == name) {
        return Some(most(&thruster.curve.points));
    }
    let dof = Dof::ALL.iter().find(|d| d.name() == name)?;
    let allocation = Allocation::new(&rig.thrusters).ok()?;
    let share = |i: usize| -> Option<f64> {
        let mut thrust_n = vec![0.0; set.len()];
        thrust_n[i] = most(&set[i].curve.points);
        let wrench = allocation.wrench(&thrust_n).ok()?.to_array();
        Some(wrench[dof.index()].abs())
    };
    (0..set.len()).map(share).sum()
}

/// A load this many times what all thrusters make together is another unit, not a strong rig.
const ABSURD: f64 = 5.0;

/// Loads that the rig cannot have made.
fn note_absurd(run: &mut Run, rig: &Rig) {
    let largest = run.largest_wrench();
    for dof in Dof::ALL {
        let (load, limit) = (largest[dof.index()], capacity(rig, dof.name()));
        if let Some(limit) = limit.filter(|l| *l > 0.0 && load >= ABSURD * l) {
            run.notes.push(format!(
                "{} was commanded {load:.4}, {:.0} times the most the rig can make ({limit:.4}): another unit than N and N m? Mass and damping scale along",
                dof.name(),
                load / limit
            ));
        }
    }
}

fn sample(m: &pb::VehicleMotion, t_s: f64, not_finite: &mut usize) -> Sample {
    Sample {
        t_s,
        values: finite(m.channels().into_array(), not_finite).into(),
        covariance: covariance(m),
    }
}

/// NaN for what was not measured; counts what is no number.
fn finite<const N: usize>(given: [Option<f64>; N], not_finite: &mut usize) -> [f64; N] {
    *not_finite += given.iter().flatten().filter(|v| !v.is_finite()).count();
    given.map(|v| v.filter(|v| v.is_finite()).unwrap_or(f64::NAN))
}

/// Covariance of the pose's own error; `None` = none, or no matrix of numbers.
pub(super) fn covariance(m: &pb::VehicleMotion) -> Option<Box<[f64; 36]>> {
    m.own_covariance().map(Box::new)
}

/// What shared errors do to a pose; `None` = nothing is stated.
fn loadings(m: &pb::VehicleMotion, t_s: f64) -> Option<Loadings> {
    let by = SharedErrors::of_rows(&m.shared_loadings)?;
    Some(Loadings { t_s, by })
}

fn wrenches(
    log: &str,
    commands: &[pb::ThrusterCommand],
    rig: &Rig,
    time_s: impl Fn(&pb::ThrusterCommand) -> f64,
    notes: &mut Vec<String>,
) -> Result<Vec<Command>, LoadError> {
    let mut commanded = Commanded::new(rig)?;
    let mut out: Vec<Command> = Vec::new();
    let mut ordered: Vec<&pb::ThrusterCommand> = commands.iter().collect();
    ordered.sort_by(|a, b| time_s(a).total_cmp(&time_s(b)));
    let mut largest_change_n = 0.0_f64;
    for command in ordered {
        let t_s = time_s(command);
        let target = commanded.target(&command.thruster);
        let mut value = command.thrust_n;
        if let (Some(Target::Thruster(i)), true) = (target, command.pulse_us > 0.0) {
            value = rig.thrusters.thrusters[i].curve.thrust_n(command.pulse_us);
            largest_change_n = largest_change_n.max((value - command.thrust_n).abs());
        }
        if !value.is_finite() {
            return Err(LoadError::CommandNotFinite {
                log: log.to_owned(),
                thruster: command.thruster.clone(),
                t_s,
                value,
            });
        }
        let Some(target) = target else {
            let known = rig.thrusters.thrusters.iter().map(|t| t.name.as_str());
            let same = |c: &&pb::ThrusterCommand| c.thruster == command.thruster;
            return Err(LoadError::UnknownThruster {
                log: log.to_owned(),
                thruster: command.thruster.clone(),
                commands: commands.iter().filter(same).count(),
                known: known.collect::<Vec<&str>>().join(", "),
            });
        };
        commanded.set(target, value);
        let wrench = commanded.wrench()?;
        match out.last_mut() {
            // One set: the eight commands of one stamp.
            Some(last) if last.t_s == t_s => last.wrench = wrench,
            Some(last) if last.wrench == wrench => {}
            _ => out.push(Command { t_s, wrench }),
        }
    }
    if largest_change_n > 0.01 {
        notes.push(format!(
            "the rig's thrust curve differs from the one this log was recorded with by up to {largest_change_n:.2} N; the rig's was used"
        ));
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn motion(ns: u64, x_m: f64) -> pb::VehicleMotion {
        pb::VehicleMotion {
            timestamp: Some(timestamp(ns)),
            x_m: Some(x_m),
            ..Default::default()
        }
    }

    fn command(ns: u64, thruster: &str, thrust_n: f64, pulse_us: f64) -> pb::ThrusterCommand {
        pb::ThrusterCommand {
            timestamp: Some(timestamp(ns)),
            thruster: thruster.into(),
            thrust_n,
            pulse_us,
            ..Default::default()
        }
    }

    const T0: u64 = 1_760_000_000_000_000_000;

    #[test]
    fn components_and_thrusters_make_one_wrench_and_time_starts_at_the_first_stamp() {
        let rig = Rig::builtin("lshpi").unwrap();
        let commands = [
            command(T0 + 500_000_000, "surge", 4.0, 0.0),
            command(T0 + 500_000_000, "yaw", 0.5, 0.0),
            command(T0 + 900_000_000, "surge", 4.0, 0.0),
            command(T0 + 1_500_000_000, "v_fore_stbd", 2.0, 0.0),
        ];
        let run = load_messages(
            "a",
            &commands,
            &[motion(T0, 0.0), motion(T0 + 40_000_000, 1.0)],
            &rig,
        )
        .unwrap();
        assert_eq!(
            run.commands.len(),
            2,
            "a repeated command is no edge: {:?}",
            run.commands
        );
        assert_eq!(
            run.commands[0],
            Command {
                t_s: 0.5,
                wrench: [4.0, 0.0, 0.0, 0.0, 0.0, 0.5]
            }
        );
        assert!(
            (run.commands[1].wrench[2] - 2.0).abs() < 1e-12 && run.commands[1].wrench[4] != 0.0
        );
        assert_eq!(run.wrench_at(0.4), [0.0; 6]);
        assert!(
            (run.samples[1].t_s - 0.04).abs() < 1e-12 && run.samples[1].values[Channel::Y].is_nan()
        );
    }

    #[test]
    fn a_pulse_goes_through_the_rigs_curve() {
        let rig = Rig::builtin("lshpi").unwrap();
        let run = load_messages(
            "a",
            &[command(T0, "v_fore_stbd", 99.0, 1700.0)],
            &[motion(T0, 0.0)],
            &rig,
        )
        .unwrap();
        assert!(
            (run.commands[0].wrench[2] - 18.02).abs() < 1e-9,
            "{:?}",
            run.commands
        );
        assert!(run.notes[0].contains("differs"), "{:?}", run.notes);
    }

    #[test]
    fn what_was_measured_beside_the_motion_comes_along() {
        let rig = Rig::builtin("lshpi").unwrap();
        let beside = |ns: u64, rudder_rad: Option<f64>| pb::VehicleMotion {
            rudder_rad,
            ..motion(ns, 0.1)
        };
        let alone = pb::VehicleMotion {
            x_m: None,
            ..beside(T0 + 80_000_000, Some(0.2))
        };
        let all = [beside(T0, Some(0.1)), motion(T0 + 40_000_000, 0.2), alone];
        let run = load_messages("a", &[], &all, &rig).unwrap();
        assert_eq!(run.samples.len(), 2, "a rudder alone is no motion");
        assert_eq!(run.companions.times_s.len(), 2);
        assert!((run.companions.times_s[1] - 0.08).abs() < 1e-12);
        assert_eq!(run.companions.measured(0).1, [0.1, 0.2]);
        assert!(run.companions.measured(1).0.is_empty());
    }

    #[test]
    fn odd_stamps_and_values_are_named_and_a_stranger_is_refused() {
        let rig = Rig::builtin("lshpi").unwrap();
        let samples = [
            motion(T0 + 80, 1.0),
            motion(T0, 0.0),
            motion(T0, 0.5),
            motion(T0 + 90, f64::NAN),
        ];
        let run = load_messages("a", &[], &samples, &rig).unwrap();
        assert_eq!(
            run.samples
                .iter()
                .map(|s| s.values[Channel::X])
                .collect::<Vec<_>>(),
            [0.0, 1.0]
        );
        assert_eq!(run.notes.len(), 3, "{:?}", run.notes);
        let words = load_messages("a", &[command(T0, "bow", 1.0, 0.0)], &samples, &rig)
            .unwrap_err()
            .to_string();
        assert!(
            words.contains("'bow'") && words.contains("h_fore_stbd"),
            "{words}"
        );
        assert!(
            load_messages("a", &[command(T0, "surge", f64::NAN, 0.0)], &samples, &rig).is_err()
        );
    }
}
