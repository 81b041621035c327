//! The log of an import.

use std::path::Path;

use super::check::{Finding, Severity};
use super::map::{Between, Map};
use super::table::Imported;
use hydroline_core::build_info::BuildInfo;
use hydroline_identify::data::StillWatch;
use hydroline_log::messages::{pb, timestamp};
use hydroline_log::{
    Entry, FileRecorder, Head, LogError, MetadataMap, SummaryInput, WriteSettings,
};

/// Steps of a linearly interpolated command \[s\].
const LINEAR_STEP_S: f64 = 0.01;

/// Why nothing was imported.
#[derive(Debug, thiserror::Error)]
pub enum ImportError {
    /// Findings forbid it.
    #[error(
        "{faults} fault(s) in the data, nothing written; mend the file or the map, or import what is sound with --accept-faults"
    )]
    Faults {
        /// How many.
        faults: usize,
    },
    /// The log.
    #[error(transparent)]
    Log(#[from] LogError),
}

/// What was left out, by kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
pub struct Lost {
    /// Rows with too few or too many cells, without a time, or whose time does not advance.
    pub rows: usize,
    /// Cells of measured channels in the rows that are left.
    pub motion_cells: usize,
    /// Cells of commands in the rows that are left: the command before goes on.
    pub command_cells: usize,
}

impl Lost {
    /// All kinds together.
    pub fn total(&self) -> usize {
        self.rows + self.motion_cells + self.command_cells
    }
}

/// What was written.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct ImportOutcome {
    /// Motion samples.
    pub samples: usize,
    /// Commands.
    pub commands: usize,
    /// What was left out.
    pub lost: Lost,
    /// What was found.
    pub findings: Vec<Finding>,
}

/// How to import.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Options {
    /// Writes what is sound although there are faults. Default: no; a fault is for the person to look at first.
    pub accept_faults: bool,
    /// The importing program.
    pub build: BuildInfo,
}

/// Writes a log; with faults only when they are accepted, and then only what is sound.
///
/// # Errors
/// [`ImportError`].
pub fn import(
    data: &Imported,
    map: &Map,
    map_text: &str,
    out: &Path,
    options: Options,
) -> Result<ImportOutcome, ImportError> {
    let faults = data
        .findings
        .iter()
        .filter(|f| f.severity == Severity::Fault)
        .count();
    if faults > 0 && !options.accept_faults {
        return Err(ImportError::Faults { faults });
    }
    let mut session = MetadataMap::from([
        ("kind".to_owned(), "import".to_owned()),
        ("import.map".to_owned(), map_text.to_owned()),
    ]);
    session.insert(
        "import.findings".to_owned(),
        serde_json::to_string(&data.findings).unwrap_or_default(),
    );
    let head = Head {
        rig_toml: "# imported: no rig was recorded\n".to_owned(),
        calibration_toml: None,
        session,
        build: options.build,
    };
    let mut log = FileRecorder::create(out, false, head, WriteSettings::offline(None))?;
    let at = |t_s: f64| data.start_ns + (t_s.max(0.0) * 1e9).round() as u64;
    let mut outcome = ImportOutcome {
        samples: 0,
        commands: 0,
        lost: Lost {
            rows: data.lost_rows,
            ..Lost::default()
        },
        findings: data.findings.clone(),
    };
    let mut still = StillWatch::default();
    let mut sequence = 0u32;
    let mut last: Option<(f64, usize)> = None;
    for (k, &t_s) in data.times_s.iter().enumerate() {
        // Time that does not advance cannot be told from time that is wrong: the row is left out.
        if last.is_some_and(|(before, _)| t_s <= before) {
            outcome.lost.rows += 1;
            continue;
        }
        for (c, values) in map.commands.iter().zip(&data.commands) {
            let Some(&value) = values.get(k) else {
                continue;
            };
            if !value.is_finite() {
                outcome.lost.command_cells += 1;
                continue;
            }
            let before = last
                .and_then(|(t0, k0)| values.get(k0).filter(|v| v.is_finite()).map(|v| (t0, *v)));
            let mut steps = vec![(t_s, value)];
            if let (Between::Linear, Some((t0, v0))) = (c.between, before) {
                // The mean of each piece at the piece's start: a held staircase with the same integral.
                let pieces = ((t_s - t0) / LINEAR_STEP_S).ceil().clamp(1.0, 1000.0) as usize;
                let piece = |i: usize| {
                    (
                        t0 + (t_s - t0) * i as f64 / pieces as f64,
                        v0 + (value - v0) * (i as f64 + 0.5) / pieces as f64,
                    )
                };
                steps = (0..pieces).map(piece).collect();
                if k + 1 == data.times_s.len() {
                    steps.push((t_s, value));
                }
            } else if c.between == Between::Linear {
                steps.clear();
            }
            for (at_s, thrust_n) in steps {
                let message = pb::ThrusterCommand {
                    timestamp: Some(timestamp(at(at_s))),
                    sequence,
                    thruster: c.thruster.clone(),
                    thrust_n,
                    cause: "import".to_owned(),
                    ..Default::default()
                };
                still.command(&message);
                log.write(at(t_s), &Entry::command(&message))?;
                sequence = sequence.wrapping_add(1);
                outcome.commands += 1;
            }
        }
        let value = |c: usize| data.motion[c].get(k).copied().filter(|v| v.is_finite());
        outcome.lost.motion_cells += (0..12)
            .filter(|c| data.motion[*c].get(k).is_some_and(|v| !v.is_finite()))
            .count();
        if (0..12).any(|c| value(c).is_some()) {
            let message = motion(at(t_s), &value, map);
            still.motion(&message);
            log.write(at(t_s), &Entry::motion(&message))?;
            outcome.samples += 1;
        }
        last = Some((t_s, k));
    }
    let mut summary = SummaryInput::clean("imported to the table's end");
    // 2 mm and 0.1°: the default tolerance of a rig; a table comes without one.
    summary
        .more
        .extend(still.metadata([0.002, 0.1f64.to_radians()]));
    log.finish(&summary)?;
    Ok(outcome)
}

fn motion(unix_ns: u64, value: &impl Fn(usize) -> Option<f64>, map: &Map) -> pb::VehicleMotion {
    let mut covariance = Vec::new();
    let channels = map.channels();
    let sd = |c: usize| {
        channels
            .iter()
            .find(|(p, ..)| *p == c)
            .and_then(|(_, m, _)| m.sd)
    };
    if (0..6).all(|c| sd(c).is_some()) {
        covariance = vec![0.0; 36];
        for c in 0..6 {
            covariance[7 * c] = sd(c).unwrap_or(0.0).powi(2);
        }
    }
    pb::VehicleMotion {
        timestamp: Some(timestamp(unix_ns)),
        x_m: value(0),
        y_m: value(1),
        z_m: value(2),
        phi_rad: value(3),
        theta_rad: value(4),
        psi_rad: value(5),
        u_mps: value(6),
        v_mps: value(7),
        w_mps: value(8),
        p_radps: value(9),
        q_radps: value(10),
        r_radps: value(11),
        covariance,
        ..pb::VehicleMotion::default()
    }
}
