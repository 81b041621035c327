//! The log of an import.

mod behind;

use std::path::Path;

use super::check::{Finding, Severity};
use super::map::{Between, Map, Missing, Origin, PLACES};
use super::source::Source;
use super::survey::Survey;
use super::table::{Imported, Sample, pass};
use behind::Behind;
use hydroline_core::build_info::BuildInfo;
use hydroline_core::run::{COMPANIONS, Channel, PerChannel, instrument_sd};
use hydroline_identify::data::StillWatch;
use hydroline_log::messages::{pb, timestamp};
use hydroline_log::{
    Entry, FileRecorder, Head, LogError, MetadataMap, SummaryInput, WriteSettings,
};
use hydroline_rigs::Rig;

/// Steps of a linearly interpolated command \[s\].
const LINEAR_STEP_S: f64 = 0.01;
/// Rows that are kept to measure the noise of a run at rest: 44 minutes at 100 Hz. No run at rest is longer.
const STILL_ROWS_MAX: usize = 1 << 18;
/// Chunks of the log close by size: a table is not cut short by a crash, it is imported again.
const CHUNK_AGE_NS: u64 = 600_000_000_000;
/// That size, with what the log allows for each message beside its bytes: a megabyte of them.
const CHUNK_BYTES: u64 = 4 << 20;

/// Names in a log's session: what a file's own clock, that counts from any zero, said \[ns\] at which UNIX time of the log.
pub(crate) const RELATIVE_ORIGIN: &str = "import.relative_origin_ns";
pub(crate) const RELATIVE_START: &str = "import.relative_start_unix_ns";

/// Reason why nothing was imported.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum ImportError {
    #[error(
        "{faults} fault(s) in the data, nothing written; mend the file or the map, or import what is sound with --accept-faults"
    )]
    Faults { faults: usize },
    /// The table, which was read before.
    #[error("{0}; the table could be read a moment ago: is it being written?")]
    Table(#[from] std::io::Error),
    #[error(transparent)]
    Log(#[from] LogError),
}

/// Numbers of rows and cells that were left out, by kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, schemars::JsonSchema)]
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

/// Outcome of an import: numbers of records, losses and findings.
#[derive(Debug, Clone, PartialEq, serde::Serialize, schemars::JsonSchema)]
pub struct ImportOutcome {
    /// Motion samples.
    pub samples: usize,
    /// Number of commands.
    pub commands: usize,
    /// Rows and cells that were left out.
    pub lost: Lost,
    /// Findings about the table.
    pub findings: Vec<Finding>,
}

/// Options of an import. The default refuses tables with faults.
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
    let begins = (data.start_ns, data.relative_origin_ns);
    let mut log = Writer::create(&data.findings, begins, map, map_text, out, options)?;
    for k in 0..data.times_s.len() {
        log.row(&data.sample(k))?;
    }
    log.finish(data.lost_rows)
}

/// The same from a table that was surveyed with this map: of the samples that were kept then, else by reading it once more.
///
/// # Errors
/// [`ImportError`].
pub fn import_table(
    source: &(impl Source + ?Sized),
    survey: &Survey,
    map: &Map,
    map_text: &str,
    rig: Option<&Rig>,
    out: &Path,
    options: Options,
) -> Result<ImportOutcome, ImportError> {
    let mut log = Writer::create(
        &survey.findings,
        (survey.start_ns, survey.relative_origin_ns),
        map,
        map_text,
        out,
        options,
    )?;
    let (mut at, mut failed) = (0, None);
    let mut write = |row: &mut Sample| {
        let spoilt = survey.spoilt.clear(&mut at, row);
        log.spoilt(spoilt, row);
        log.row(row).map_err(|e| {
            failed = Some(e);
            std::io::Error::other("the log")
        })
    };
    let passed = match &survey.spool {
        Some(spool) => spool.each(write).map(|()| survey.lost_rows),
        None => {
            let mut own: Option<Sample> = None;
            pass(source, map, rig, |sample, _| {
                let row = own.get_or_insert_with(|| sample.clone());
                row.clone_from(sample);
                write(row)
            })
            .and_then(|passed| source.unchanged().map(|()| passed.lost_rows))
        }
    };
    match (failed, passed) {
        (Some(log), _) => Err(log),
        (None, Err(table)) => Err(table.into()),
        (None, Ok(lost_rows)) => log.finish(lost_rows),
    }
}

struct Writer<'a> {
    map: &'a Map,
    log: Behind,
    start_ns: u64,
    /// sd of the six pose channels, where all are known.
    covariance: Vec<f64>,
    /// `None` = the run is too long for one at rest.
    still: Option<StillWatch>,
    outcome: ImportOutcome,
    sequence: u32,
    last_s: Option<f64>,
    /// Last value of each command.
    before: Vec<Option<(f64, f64)>>,
    /// A linear command's last step, which stands when the table ends.
    open: Vec<Option<(f64, f64)>>,
}

impl<'a> Writer<'a> {
    fn create(
        findings: &[Finding],
        (start_ns, relative_origin_ns): (u64, Option<i128>),
        map: &'a Map,
        map_text: &str,
        out: &Path,
        options: Options,
    ) -> Result<Self, ImportError> {
        let faults = findings
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
        let stated = map.channels.iter().filter_map(|c| {
            let channel = Channel::ALL.get(c.place)?;
            Some(instrument_sd::entry(*channel, c.sd?))
        });
        session.extend(stated);
        if let Some(ns) = relative_origin_ns {
            session.insert(RELATIVE_START.to_owned(), start_ns.to_string());
            session.insert(RELATIVE_ORIGIN.to_owned(), ns.to_string());
        }
        session.insert(
            "import.findings".to_owned(),
            serde_json::to_string(findings).unwrap_or_default(),
        );
        let head = Head {
            rig_toml: "# imported: no rig was recorded\n".to_owned(),
            calibration_toml: None,
            session,
            build: options.build,
        };
        let mut settings = WriteSettings::offline(None);
        settings.limits.chunk_age_ns = CHUNK_AGE_NS;
        settings.limits.chunk_bytes = CHUNK_BYTES;
        Ok(Writer {
            map,
            log: Behind::new(FileRecorder::create_whole(out, false, head, settings)?),
            start_ns,
            covariance: covariance(map),
            still: Some(StillWatch::default()),
            outcome: ImportOutcome {
                samples: 0,
                commands: 0,
                lost: Lost::default(),
                findings: findings.to_vec(),
            },
            sequence: 0,
            last_s: None,
            before: vec![None; map.commands.len()],
            open: vec![None; map.commands.len()],
        })
    }

    fn at(&self, t_s: f64) -> u64 {
        let since_ns = (t_s.max(0.0) * 1e9).round() as u64;
        self.start_ns.saturating_add(since_ns)
    }

    /// Values that were taken out of a row.
    fn spoilt(&mut self, count: usize, row: &Sample) {
        // Those of channels whose missing cells are faults are counted with the row.
        let counted = (0..PLACES).filter(|p| self.is_lost(*p, row)).count();
        self.outcome.lost.motion_cells += count.saturating_sub(counted);
    }

    fn is_lost(&self, place: usize, row: &Sample) -> bool {
        self.map.missing(place) == Some(Missing::Fault) && !row.values[place].is_finite()
    }

    fn row(&mut self, row: &Sample) -> Result<(), ImportError> {
        let t_s = row.t_s;
        // Time that does not advance cannot be distinguished from time that is wrong, and behind 2554 all stamps of 64 bits
        // are one: the row is left out.
        if self.last_s.is_some_and(|before| t_s <= before) || self.at(t_s) == u64::MAX {
            self.outcome.lost.rows += 1;
            return Ok(());
        }
        for i in 0..self.map.commands.len() {
            self.command(i, row)?;
        }
        self.outcome.lost.motion_cells += (0..PLACES).filter(|p| self.is_lost(*p, row)).count();
        if row.values.iter().any(|v| v.is_finite()) {
            let message = self.motion(row);
            if let Some(still) = &mut self.still {
                still.motion(&message);
            }
            self.log.write(self.at(t_s), Entry::motion(&message))?;
            self.outcome.samples += 1;
            if self.outcome.samples > STILL_ROWS_MAX {
                self.still = None;
            }
        }
        self.last_s = Some(t_s);
        Ok(())
    }

    fn command(&mut self, i: usize, row: &Sample) -> Result<(), ImportError> {
        let command = &self.map.commands[i];
        let (t_s, value) = (row.t_s, row.commands[i]);
        if !value.is_finite() {
            self.outcome.lost.command_cells += usize::from(command.missing == Missing::Fault);
            return Ok(());
        }
        let before = self.before[i].replace((t_s, value));
        // A constant load is sent once.
        if matches!(command.origin, Origin::Value(_)) && before.is_some() {
            return Ok(());
        }
        if command.between == Between::Hold {
            return self.send(i, t_s, t_s, value, row.pulses_us[i]);
        }
        if let Some((t0, v0)) = before {
            // The mean of each piece at the piece's start: a held staircase with the same integral.
            let pieces = ((t_s - t0) / LINEAR_STEP_S).ceil().clamp(1.0, 1000.0) as usize;
            for k in 0..pieces {
                let at_s = t0 + (t_s - t0) * k as f64 / pieces as f64;
                let mean = v0 + (value - v0) * (k as f64 + 0.5) / pieces as f64;
                self.send(i, at_s, t_s, mean, 0.0)?;
            }
        }
        self.open[i] = Some((t_s, value));
        Ok(())
    }

    fn send(
        &mut self,
        i: usize,
        at_s: f64,
        log_s: f64,
        thrust_n: f64,
        pulse_us: f64,
    ) -> Result<(), ImportError> {
        let message = pb::ThrusterCommand {
            timestamp: Some(timestamp(self.at(at_s))),
            sequence: self.sequence,
            thruster: self.map.commands[i].thruster.clone(),
            thrust_n,
            pulse_us,
            cause: "import".to_owned(),
            ..Default::default()
        };
        if let Some(still) = &mut self.still {
            still.command(&message);
        }
        self.log.write(self.at(log_s), Entry::command(&message))?;
        self.sequence = self.sequence.wrapping_add(1);
        self.outcome.commands += 1;
        Ok(())
    }

    fn finish(mut self, lost_rows: usize) -> Result<ImportOutcome, ImportError> {
        for i in 0..self.open.len() {
            // Of a table with one row too: it says what holds then.
            if let Some((t_s, value)) = self.open[i].take() {
                self.send(i, t_s, t_s, value, 0.0)?;
            }
        }
        self.outcome.lost.rows += lost_rows;
        let mut summary = SummaryInput::clean("imported to the table's end");
        // 2 mm and 0.1°: the default tolerance of a rig; a table comes without one.
        let tolerance = [0.002, 0.1f64.to_radians()];
        if let Some(still) = &self.still {
            summary.more.extend(still.metadata(tolerance));
        }
        self.log.finish(&summary)?;
        Ok(self.outcome)
    }

    fn motion(&self, row: &Sample) -> pb::VehicleMotion {
        let value = |c: usize| Some(row.values[c]).filter(|v| v.is_finite());
        let channels = PerChannel::from_fn(|c| value(c.index()));
        let companions: [_; COMPANIONS.len()] =
            std::array::from_fn(|i| value(Channel::ALL.len() + i));
        let [rudder_rad, elevator_rad, shaft_radps, wave_m] = companions;
        pb::VehicleMotion {
            covariance: self.covariance.clone(),
            rudder_rad,
            elevator_rad,
            shaft_radps,
            wave_m,
            ..pb::VehicleMotion::of(self.at(row.t_s), channels)
        }
    }
}

/// 6 x 6, where the sd of all six pose channels is known; else empty.
fn covariance(map: &Map) -> Vec<f64> {
    let sd = |place: usize| {
        map.channels
            .iter()
            .find(|c| c.place == place)
            .and_then(|c| c.sd)
    };
    let sds: Option<Vec<f64>> = (0..6).map(sd).collect();
    let Some(sds) = sds else {
        return Vec::new();
    };
    let mut covariance = vec![0.0; 36];
    for (c, sd) in sds.iter().enumerate() {
        covariance[7 * c] = sd.powi(2);
    }
    covariance
}
