//! Faults of the data, ruled out before physics is blamed (theory/identifiability.md, data faults).

mod kinematics;

use hydroline_inference::body::Body;
use hydroline_inference::recording::Recording;
use hydroline_numerics::outliers;
use hydroline_numerics::parallel;
use hydroline_numerics::statistics::{extent, median};
use hydroline_rigs::{Dof, Rig};

use super::verdict::DataFault;
use hydroline_core::run::{Channel, Command, PerChannel, Run};
use hydroline_identify::data::memory_s;
use hydroline_import::check::{STUCK_ROWS, check_motion};
use hydroline_import::{Imported, Severity};
use hydroline_log::messages::pb;

/// Fewest samples of a channel from which anything is said of it.
const SAMPLES_LEAST: usize = 8;
/// Share of samples out of the motion around them above which a channel is no measurement.
const OUTLIERS_MAX: f64 = 0.05;
/// Share that is worth a line.
const OUTLIERS_SOME: f64 = 0.03;
/// Samples of which a share says something: two of fifty are chance.
const OUTLIERS_OF: usize = 50;
/// Drift of the controller's clock worth a line \[ppm\].
const DRIFT_SOME_PPM: f64 = 20.0;

/// Tolerances by which the rig's model has to move a channel that stands before it is called dead: coefficients are off by some factor, and a
/// coarse instrument shows no less than a few.
const DEAD_TOLERANCES: f64 = 5.0;

/// A vehicle may stay within one step of a coarse instrument for this long under its first load \[s\].
const WAITS_ON_S: f64 = 0.5;

/// Records that a log holds besides its run.
#[derive(Debug, Clone, Default)]
pub struct Records {
    /// Motion in file order: (stamp \[ns\], channels, NaN = not measured).
    pub motion: Vec<(u64, PerChannel<f64>)>,
    /// Drift of the controller's clock against the host's with its sd \[ppm\].
    pub drift_ppm: Vec<(f64, f64)>,
    /// (monotonic, realtime) \[ns\] of the clock records.
    pub clocks_ns: Vec<(u64, u64)>,
}

impl Records {
    /// Takes a motion message.
    pub fn motion(&mut self, ns: u64, m: &pb::VehicleMotion) {
        let measured = m.channels().map(|v| v.unwrap_or(f64::NAN));
        self.motion.push((ns, measured));
    }
}

/// Everything wrong with one log.
pub fn faults(run: &Run, records: &Records, rig: &Rig) -> Vec<DataFault> {
    let mut found = table(run, records, rig);
    let memory_s = memory_s(&rig.vehicle);
    found.extend(long_gap(run, memory_s));
    // Models and splines end at a gap that the vehicle does not remember.
    if let Some(whole) = run.longest_stretch(memory_s) {
        let of_run = |mut f: DataFault| {
            f.run.clone_from(&run.name);
            f
        };
        found.extend(against_model(&whole, rig).into_iter().map(of_run));
        found.extend(kinematics::kinematics(&whole, rig).into_iter().map(of_run));
    }
    found.extend(outliers(run, rig));
    found.extend(clocks(run, records, rig));
    found
}

/// A gap that cuts the run in two.
fn long_gap(run: &Run, memory_s: f64) -> Option<DataFault> {
    let (from_s, gap_s) = run.longest_gap().filter(|gap| gap.1 > memory_s)?;
    let evidence = format!(
        "no motion for {gap_s:.1} s after {from_s:.2} s, longer than the vehicle remembers ({memory_s:.0} s): what lies before and behind it are runs of their own"
    );
    Some(fault(run, "long_gap", "stamp", evidence, false))
}

pub(super) fn fault(
    run: &Run,
    kind: &str,
    channel: &str,
    evidence: String,
    fatal: bool,
) -> DataFault {
    DataFault {
        fault: kind.to_owned(),
        channel: channel.to_owned(),
        run: run.name.clone(),
        evidence,
        fatal,
    }
}

/// Time, units, dead and stuck channels, kinematics: the checks an imported table goes through.
fn table(run: &Run, records: &Records, rig: &Rig) -> Vec<DataFault> {
    let Some(first) = records.motion.first().map(|m| m.0) else {
        return Vec::new();
    };
    let rows = records.motion.len();
    let data = Imported {
        times_s: records
            .motion
            .iter()
            .map(|m| (m.0 as i128 - i128::from(first)) as f64 * 1e-9)
            .collect(),
        start_ns: first,
        lines: (1..=rows as u64).collect(),
        motion: std::array::from_fn(|c| {
            // Companions are not looked at here.
            let of = |m: &(u64, PerChannel<f64>)| m.1.get(c).copied().unwrap_or(f64::NAN);
            let column: Vec<f64> = records.motion.iter().map(of).collect();
            if column.iter().any(|v| v.is_finite()) {
                column
            } else {
                Vec::new()
            }
        }),
        ..Imported::default()
    };
    let mut findings = Vec::new();
    let since_s = first.saturating_sub(run.start_ns) as f64 * 1e-9;
    check_motion(&data, since_s, &mut findings);
    let driven = run.largest_wrench();
    findings
        .into_iter()
        .filter(|f| f.severity > Severity::Info)
        .filter_map(|f| {
            let mut all = Channel::ALL.into_iter();
            let place = all.find(|c| f.message.starts_with(c.name()));
            let channel = place.map_or("stamp", Channel::name);
            let fatal = match f.kind {
                "dead_channel" => {
                    place.is_some_and(|p| driven[p.dof().index()] > 0.0 && is_moved(run, rig, p))
                }
                "stuck_channel" => !place.is_some_and(|p| {
                    waits(run, p.dof().index(), &data.times_s, &data.motion[p.index()])
                }),
                // Rates that are noise about rest say nothing.
                "kinematics" => return None,
                "units" => f.severity == Severity::Fault,
                _ => f.severity == Severity::Fault,
            };
            Some(fault(run, f.kind, channel, f.message, fatal))
        })
        .collect()
}

/// Whether a channel is constant only before the first load that moves it: the vehicle waits, and the instrument is coarse.
fn waits(run: &Run, dof: usize, times_s: &[f64], values: &[f64]) -> bool {
    let mut stands = values.chunk_by(|a, b| a == b).map(<[f64]>::len);
    let standing = stands.next().unwrap_or(0);
    let Some(waited_s) = standing.checked_sub(1).and_then(|k| times_s.get(k)) else {
        return false;
    };
    let until_s = run.samples.first().map_or(0.0, |s| s.t_s) + waited_s;
    // A hull that is turned moves along x and y by both of their loads.
    let moves = if dof < 2 { 0..2 } else { dof..dof + 1 };
    let driven = |c: &&Command| c.wrench[moves.clone()].iter().any(|w| *w != 0.0);
    let first = run.commands.iter().find(driven);
    stands.all(|rows| rows < STUCK_ROWS) && first.is_some_and(|c| c.t_s >= until_s - WAITS_ON_S)
}

/// Robust gain and correlation of measured on predicted displacement.
fn gain(predicted: &[f64], measured: &[f64]) -> (f64, f64) {
    let n = predicted.len().max(1) as f64;
    let (mp, mm) = (
        predicted.iter().sum::<f64>() / n,
        measured.iter().sum::<f64>() / n,
    );
    let (mut pp, mut mm2, mut pm) = (0.0, 0.0, 0.0);
    for (p, m) in predicted.iter().zip(measured) {
        pp += (p - mp).powi(2);
        mm2 += (m - mm).powi(2);
        pm += (p - mp) * (m - mm);
    }
    (pm / pp.max(1e-300), pm / (pp * mm2).sqrt().max(1e-300))
}

fn span(values: &[f64]) -> f64 {
    let (low, high) = extent(values.iter().copied());
    high - low
}

/// Gains between what was measured and what the rig's model makes of the commands, with their meaning.
const UNITS: [(f64, &str); 6] = [
    (1000.0, "mm stored as m, or mrad as rad"),
    (1e-3, "m stored as mm, or rad as mrad"),
    (100.0, "cm stored as m"),
    (0.01, "m stored as cm"),
    (57.295_779_513, "degrees stored as rad"),
    (0.017_453_292_5, "radians converted to rad once too often"),
];

/// Sign, units and swapped columns against the rig's own model: physics changes a motion by tens of
/// percent, these by factors.
fn against_model(run: &Run, rig: &Rig) -> Vec<DataFault> {
    let mut found = Vec::new();
    let largest = run.largest_wrench();
    for dof in Dof::ALL {
        let i = dof.index();
        let place = Channel::POSES[i];
        let tolerance = rig.tolerance.channels()[place];
        if largest[i] == 0.0 {
            continue;
        }
        let Some((predicted, measured)) = by_the_rig(run, rig, i) else {
            continue;
        };
        let expected = span(&predicted);
        if !(expected.is_finite() && expected > 20.0 * tolerance) {
            continue;
        }
        let channel = place.name();
        let (g, r) = gain(&predicted, &measured);
        let moved = span(&measured);
        if r < -0.8 && g < -0.2 {
            found.push(fault(run, "sign", channel, format!("{channel} follows the commands with the opposite sign: {g:.2} times what the rig's model makes of them (correlation {r:.3})"), true));
        } else if let Some((factor, words)) = UNITS
            .iter()
            .find(|(f, _)| r > 0.8 && (g / f > 0.45 && g / f < 2.2) && !(0.2..5.0).contains(&g))
        {
            found.push(fault(run, "units", channel, format!("{channel} moves {g:.4} times what the rig's model makes of the commands (correlation {r:.3}): {words}, a factor of {factor:.4}?"), true));
        } else if moved < 0.1 * expected || r.abs() < 0.3 {
            // Something else moves as this one should.
            let other = Dof::ALL
                .into_iter()
                .filter(|o| *o != dof && largest[o.index()] == 0.0)
                .find_map(|o| {
                    let t: Vec<f64> = run.measured(Channel::POSES[o.index()]).collect();
                    (t.len() == predicted.len())
                        .then(|| (o, gain(&predicted, &t)))
                        .filter(|(_, (g, r))| *r > 0.9 && (0.2..5.0).contains(g))
                });
            match other {
                Some((o, (g, r))) => found.push(fault(run, "swapped_columns", channel, format!("{} is commanded but {} moves, {g:.2} times as {channel} should (correlation {r:.3}): columns swapped?", dof.name(), Channel::POSES[o.index()].name()), true)),
                None if moved < 0.02 * expected && is_moved(run, rig, place) => found.push(fault(run, "dead_channel", channel, format!("{channel} moves by {moved:.2e} where the rig's model makes {expected:.2e} of the commands"), true)),
                None => {}
            }
        }
    }
    found
}

/// Whether the rig's model moves a channel by what the command of its DOF varies about its median. A constant load holds a vehicle
/// in its place (against weight, current or tether) or on its way, and a controller's is all but constant: then what stands is no dead
/// channel.
fn is_moved(run: &Run, rig: &Rig, channel: Channel) -> bool {
    let dof = channel.dof().index();
    let in_force = run.samples.iter().map(|s| run.wrench_at(s.t_s)[dof]);
    let middle = median(&mut in_force.collect::<Vec<_>>()).unwrap_or(0.0);
    let mut varied = run.clone();
    let before = Command {
        t_s: 0.0,
        wrench: [0.0; 6],
    };
    varied.commands.insert(0, before);
    for command in &mut varied.commands {
        command.wrench[dof] -= middle;
    }
    let recording = Recording::new(std::slice::from_ref(&varied), rig.tank.start_pose[5]);
    let Ok(body) = Body::plain(recording, rig, &[dof]) else {
        return true;
    };
    let mut begin = body.begin();
    // From rest: the way that a vehicle has is none of the command's doing.
    let starts = body.starts.iter().flatten();
    for (value, state) in begin.iter_mut().skip(body.own.len()).zip(starts) {
        if state.is_rate() {
            *value = 0.0;
        }
    }
    let moved = span_of(&body.values(0, &[], &begin), channel);
    moved.is_nan() || moved > DEAD_TOLERANCES * rig.tolerance.channels()[channel]
}

fn span_of(motion: &[PerChannel<f64>], channel: Channel) -> f64 {
    let values: Vec<f64> = motion.iter().map(|v| v[channel]).collect();
    span(&values)
}

/// Along a DOF what the rig's own model makes of a run, and what was measured; `None` where too little was.
fn by_the_rig(run: &Run, rig: &Rig, dof: usize) -> Option<(Vec<f64>, Vec<f64>)> {
    let recording = Recording::new(std::slice::from_ref(run), rig.tank.start_pose[5]);
    let body = Body::plain(recording, rig, &[dof]).ok()?;
    let predicted = body.values(0, &[], &body.begin());
    let run = body.recording.runs.first()?;
    let both = predicted.iter().enumerate();
    let place = Channel::POSES[dof];
    let both: (Vec<f64>, Vec<f64>) = both
        .map(|(k, p)| (p[place], run.measured(k)[place]))
        .filter(|(_, m)| m.is_finite())
        .unzip();
    (both.0.len() >= SAMPLES_LEAST).then_some(both)
}

/// Samples that stand out of the motion around them, all of the log's, in the axes in which they were measured.
fn outliers(run: &Run, rig: &Rig) -> Vec<DataFault> {
    let tolerance = rig.tolerance.channels();
    let found = parallel::map_slice(&Channel::POSES, |&place| {
        let each = run.samples.iter().map(|s| (s.t_s, s.values[place]));
        let (times_s, measured): (Vec<f64>, Vec<f64>) = each.filter(|s| s.1.is_finite()).unzip();
        let n = measured.len();
        let out = outliers::outliers(&times_s, &measured, tolerance[place]);
        let count = out.iter().filter(|o| **o).count();
        let first_s = out.iter().position(|o| *o).map_or(0.0, |k| times_s[k]);
        let share = count as f64 / n.max(1) as f64;
        (share > OUTLIERS_SOME && n > OUTLIERS_OF).then(|| {
            let channel = place.name();
            let evidence = format!(
                "{:.1} % of {n} samples of {channel} stand out of the motion around them, the first at {first_s:.2} s; what no vehicle follows is left out of the fit",
                100.0 * share
            );
            fault(run, "outliers", channel, evidence, share > OUTLIERS_MAX)
        })
    });
    found.into_iter().flatten().collect()
}

/// Data faults by a drift of clocks, as the log's own clock records show it.
fn clocks(run: &Run, records: &Records, rig: &Rig) -> Vec<DataFault> {
    let mut found = Vec::new();
    let span_s = run.end_s();
    let speed = run
        .samples
        .windows(2)
        .map(|w| (w[1].values[Channel::X] - w[0].values[Channel::X]).abs() / (w[1].t_s - w[0].t_s))
        .filter(|v| v.is_finite())
        .fold(0.0, |m: f64, v| m.max(v))
        .min(1.0);
    let mut judge = |ppm: f64, sd: f64, whose: &str| {
        if ppm.abs() > DRIFT_SOME_PPM.max(5.0 * sd) {
            let shift_m = ppm.abs() * 1e-6 * span_s * speed;
            found.push(fault(run, "clock_drift", "stamp", format!("{whose} drifts by {ppm:.0} ppm (sd {sd:.0}) in the log's own clock records: {:.1} ms over the run, {:.2} mm of motion", ppm.abs() * 1e-3 * span_s, shift_m * 1e3), shift_m > rig.tolerance.position_m));
        }
    };
    if let Some((ppm, sd)) = records.drift_ppm.last() {
        judge(*ppm, *sd, "the controller's clock");
    }
    if let (Some(a), Some(b)) = (records.clocks_ns.first(), records.clocks_ns.last())
        && b.0.saturating_sub(a.0) > 2_000_000_000
    {
        let (mono, real) = ((b.0 - a.0) as f64, (b.1 as f64) - (a.1 as f64));
        judge(
            (real / mono - 1.0) * 1e6,
            5.0,
            "realtime against the monotonic clock",
        );
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use hydroline_core::run::Sample;

    /// A run whose heave is driven by these loads from these times on, and whose z stands.
    fn standing(loads: &[(f64, f64)]) -> Run {
        let sample = |k: u32| {
            let mut values = PerChannel::NAN;
            values[Channel::Z] = 1.2;
            Sample {
                t_s: 0.05 * f64::from(k),
                values,
                covariance: None,
            }
        };
        let command = |(t_s, load): &(f64, f64)| Command {
            t_s: *t_s,
            wrench: [0.0, 0.0, *load, 0.0, 0.0, 0.0],
        };
        Run {
            samples: (0..400).map(sample).collect(),
            commands: loads.iter().map(command).collect(),
            ..Run::default()
        }
    }

    /// A vehicle whose depth was held against its weight, by a load that hardly varied, was called a dead channel.
    #[test]
    fn a_vehicle_that_is_held_in_its_place_is_no_dead_channel() {
        let rig = Rig::builtin("lshpi").unwrap();
        let dead = |loads: &[(f64, f64)]| {
            let run = standing(loads);
            let mut records = Records::default();
            for s in &run.samples {
                records.motion.push(((s.t_s * 1e9) as u64, s.values));
            }
            let found = faults(&run, &records, &rig);
            let dead = found.iter().filter(|f| f.fault == "dead_channel");
            let is_fatal: Vec<bool> = dead.map(|f| f.fatal).collect();
            assert!(!is_fatal.is_empty(), "{found:?}");
            is_fatal.contains(&true)
        };
        assert!(!dead(&[(0.0, -5.0)]));
        assert!(!dead(&[(0.0, -5.0), (7.0, -5.002), (13.0, -5.0)]));
        assert!(dead(&[(0.0, -5.0), (7.0, 5.0), (13.0, 0.0)]));
    }

    /// A coarse instrument that shows the same before the first load was taken for a stuck channel.
    #[test]
    fn a_vehicle_that_waits_is_not_a_stuck_channel() {
        let times_s: Vec<f64> = (0..200).map(|k| 0.05 * f64::from(k)).collect();
        let run = |load_at_s: f64| Run {
            samples: vec![Sample {
                t_s: 0.0,
                values: PerChannel::splat(0.0),
                covariance: None,
            }],
            commands: vec![Command {
                t_s: load_at_s,
                wrench: [1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
            }],
            ..Run::default()
        };
        let from = |row: usize| -> Vec<f64> {
            (0..200)
                .map(|k| f64::from(u16::try_from(usize::saturating_sub(k, row)).unwrap_or(0)))
                .collect()
        };
        let mut seen = from(60);
        assert!(waits(&run(3.0), 0, &times_s, &seen));
        assert!(
            !waits(&run(1.0), 0, &times_s, &seen),
            "it should have moved"
        );
        assert!(!waits(&run(3.0), 3, &times_s, &seen), "nothing moves it");
        seen[100..140].fill(7.0);
        assert!(!waits(&run(3.0), 0, &times_s, &seen), "it sticks later");
        let mut missing = from(60);
        missing[0] = f64::NAN;
        assert!(!waits(&run(3.0), 0, &times_s, &missing));
        assert!(!waits(&run(3.0), 0, &[], &[]));
    }

    /// A drive's encoder at 200 Hz, fast between its ends and still at them: 8.6 % of its samples were called outliers, fatally.
    #[test]
    fn fast_motion_of_a_fine_encoder_holds_no_outliers_and_spikes_are_found() {
        let rig = Rig::builtin("lshpi").unwrap();
        // Out within a second, a second's rest, back, and rest.
        let stroke = |t_s: f64| 0.2 - 0.2 * (std::f64::consts::PI * t_s.clamp(0.0, 1.0)).cos();
        let shown = |spike_m: f64| {
            let mut run = Run::default();
            for k in 0..4000_u32 {
                let t_s = 0.005 * f64::from(k);
                let x_m = stroke(t_s % 4.0) - stroke(t_s % 4.0 - 2.0);
                let noise = 1e-5 * (f64::from(k * 7919 % 101) / 50.0 - 1.0);
                let spike = if k % 16 == 5 { spike_m } else { 0.0 };
                let mut values = PerChannel::NAN;
                values[Channel::X] = x_m + noise + spike;
                run.samples.push(Sample {
                    t_s,
                    values,
                    covariance: None,
                });
            }
            outliers(&run, &rig)
        };
        assert!(shown(0.0).is_empty(), "{:?}", shown(0.0));
        let found = shown(0.5);
        assert!(found.len() == 1 && found[0].fatal, "{found:?}");
        assert!(found[0].evidence.contains("at 0.0"), "{found:?}");
    }
}
