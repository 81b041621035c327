//! A log as CSV per topic and PNG per frame, for tools that read no MCAP.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::LogError;
use super::messages::{Stamped, pb};
use super::reader::{LogReader, Record};
use hydroline_core::frame::{Frame, GreyRule};
use hydroline_core::plain;

mod unfinished;

pub use unfinished::is_unfinished;
use unfinished::{TMP, Unfinished};

/// Kinds of files that an export writes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ExportOptions {
    /// CSV per topic.
    pub tables: bool,
    /// PNG per frame (8-bit luma).
    pub frames: bool,
}

/// Outcome of an export: numbers of rows and images.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, schemars::JsonSchema)]
pub struct Exported {
    /// Rows by file.
    pub rows: BTreeMap<PathBuf, u64>,
    /// PNG files.
    pub frames: u64,
    /// Of these, images that an export that was broken off had left: they were not encoded again.
    pub frames_resumed: u64,
    /// Frames without an image (marked faulty or not decodable).
    pub frames_skipped: u64,
    /// Of these, frames that nothing marks as faulty: they should hold an image and do not.
    pub frames_undecodable: u64,
}

/// Writes the tables and frames of `log` into the directory `into`, which has to be empty or is made.
///
/// The files appear in it when all of them are whole. A kill leaves the folder `unfinished.part`; the next export of the same log
/// with the same options goes on from there, one of another removes what was left, and both say so.
///
/// # Errors
/// [`LogError::NotEmpty`]; [`LogError::BeingWritten`]; damage in the log ([`LogError::Damaged`]: recover it first), [`LogError::Output`].
pub fn export(log: &Path, into: &Path, options: ExportOptions) -> Result<Exported, LogError> {
    // A file that is no log makes no folder.
    let reader = LogReader::open(log)?;
    let existed = into.exists();
    std::fs::create_dir_all(into).map_err(LogError::output(into))?;
    let mut unfinished = Unfinished::begin(log, into, options)?;
    let done = match unfinished.placed() {
        Ok(None) => write_all(reader, &mut unfinished, options)
            .and_then(|account| unfinished.settle(&account)),
        Ok(Some(done)) => Ok(done),
        Err(error) => Err(error),
    };
    if done.is_err() {
        // All in it was made by this export.
        unfinished.clear().ok();
        if !existed {
            std::fs::remove_dir(into).ok();
        }
    }
    done
}

fn write_all(
    reader: LogReader,
    unfinished: &mut Unfinished,
    options: ExportOptions,
) -> Result<Exported, LogError> {
    let part = unfinished.part.clone();
    let mut tables = Tables {
        into: &part,
        open: BTreeMap::new(),
        rows: BTreeMap::new(),
    };
    let mut done = Exported::default();
    let mut row = String::new();
    let rule = reader.grey_rule();
    for message in reader {
        let message = message?;
        if let (Record::Frame(frame), true) = (&message.record, options.frames) {
            let saved = save(frame, &rule, unfinished)?;
            done.frames += u64::from(saved != Saved::NoImage);
            done.frames_resumed += u64::from(saved == Saved::Before);
            if saved == Saved::NoImage {
                done.frames_skipped += 1;
                done.frames_undecodable += u64::from(frame.meta.fault.is_none());
            }
        }
        if options.tables
            && let Some((name, header)) = table(&message.record)
        {
            row.clear();
            if rows(&message.record, message.log_ns, &mut row) {
                tables.write(name, header, &row)?;
            }
        }
    }
    done.rows = tables.finish()?;
    Ok(done)
}

struct Tables<'a> {
    into: &'a Path,
    open: BTreeMap<&'static str, BufWriter<File>>,
    rows: BTreeMap<PathBuf, u64>,
}

impl Tables<'_> {
    fn write(&mut self, name: &'static str, header: &str, rows: &str) -> Result<(), LogError> {
        let path = self.into.join(name);
        if !self.open.contains_key(name) {
            let mut file = BufWriter::new(File::create(&path).map_err(LogError::output(&path))?);
            writeln!(file, "{header}").map_err(LogError::output(&path))?;
            self.open.insert(name, file);
        }
        if let Some(file) = self.open.get_mut(name) {
            file.write_all(rows.as_bytes())
                .map_err(LogError::output(&path))?;
        }
        *self.rows.entry(path).or_default() += rows.lines().count() as u64;
        Ok(())
    }

    fn finish(self) -> Result<BTreeMap<PathBuf, u64>, LogError> {
        for (name, mut file) in self.open {
            let path = self.into.join(name);
            file.flush().map_err(LogError::output(&path))?;
        }
        Ok(self.rows)
    }
}

const COMMANDS: &str =
    "log_ns,timestamp_ns,sequence,thruster,thrust_n,pulse_us,due_ns,plan_step,cause";
const ECHOES: &str =
    "log_ns,timestamp_ns,sequence,thruster,pulse_us,controller_time_us,round_trip_s,errors";
const MOTION: &str = "log_ns,timestamp_ns,x_m,y_m,z_m,phi_rad,theta_rad,psi_rad,\
u_mps,v_mps,w_mps,p_radps,q_radps,r_radps,covariance,rudder_rad,elevator_rad,shaft_radps,wave_m,own_covariance,shared_loadings";
const PROFILES: &str = "log_ns,timestamp_ns,sequence,column_px,row_px,peak,sd_px,sigma_px,quality,\
xi_m,eta_m,xi_sd_m,eta_sd_m";
const CLOCK: &str = "log_ns,monotonic_ns,realtime_ns,boottime_ns,bracket_ns,offset_us,offset_sd_us,\
drift_ppm,drift_sd_ppm,round_trip_us,round_trip_spread_us,samples,host_epoch_ns,controller_epoch_us";
const AUTOPILOT: &str = "log_ns,timestamp_ns,message,autopilot_time_us,armed,mode,battery_v,battery_a,\
esc_first,esc_rpm,esc_v,esc_a,north_m,east_m,down_m,north_mps,east_mps,down_mps";
const EVENTS: &str = "log_ns,timestamp_ns,severity,kind,message,values";
const FRAMES: &str = "log_ns,timestamp_ns,sequence,frame_index,driver_stamp_ns,driver_clock,stamp_source,\
v4l2_flags,received_monotonic_ns,exposure_s,fault,sequence_gap_before,time_gap_before,bytes_used";

fn table(record: &Record) -> Option<(&'static str, &'static str)> {
    Some(match record {
        Record::Command(_) => ("commands.csv", COMMANDS),
        Record::Echo(_) => ("echoes.csv", ECHOES),
        Record::Motion(_) => ("motion.csv", MOTION),
        Record::Truth(_) => ("truth.csv", MOTION),
        Record::AutopilotMotion(_) => ("autopilot_motion.csv", MOTION),
        Record::AutopilotState(_) => ("autopilot_state.csv", AUTOPILOT),
        Record::Profile(_) => ("profiles.csv", PROFILES),
        Record::Clock(_) => ("clock.csv", CLOCK),
        Record::Event(_) => ("events.csv", EVENTS),
        Record::FrameInfo(_) => ("frames.csv", FRAMES),
        _ => return None,
    })
}

/// Cells of a row, separated by commas.
struct Row<'a>(&'a mut String);

impl Row<'_> {
    fn cell(&mut self, value: impl std::fmt::Display) -> &mut Self {
        let _ = write!(self.0, "{value},");
        self
    }
    /// Nothing for what is no number.
    fn number(&mut self, value: f64) -> &mut Self {
        self.maybe(Some(value).filter(|v| v.is_finite()))
    }
    fn maybe(&mut self, value: Option<impl std::fmt::Display>) -> &mut Self {
        match value {
            Some(v) => self.cell(v),
            None => self.cell(""),
        }
    }
    /// RFC 4180: quoted where it must be. A log's text may come from anyone: it begins no formula.
    fn text(&mut self, value: &str) -> &mut Self {
        // Line breaks inside a cell are legal but break line-based tools.
        let value = value.replace(['\n', '\r', '\t'], " ");
        let value = plain::cell(&value);
        if value.contains([',', '"']) {
            self.cell(format_args!("\"{}\"", value.replace('"', "\"\"")))
        } else {
            self.cell(value)
        }
    }
    fn end(&mut self) {
        self.0.pop();
        self.0.push('\n');
    }
}

/// Appends the rows of a record; one per message, one per point for a profile.
fn rows(record: &Record, log_ns: u64, out: &mut String) -> bool {
    let stamp = |t: Option<u64>| t.unwrap_or(log_ns);
    let before = out.len();
    let mut row = Row(out);
    match record {
        Record::Command(c) => {
            row.cell(log_ns)
                .cell(stamp(c.stamp_ns()))
                .cell(c.sequence)
                .text(&c.thruster);
            row.number(c.thrust_n)
                .number(c.pulse_us)
                .cell(c.due_ns)
                .cell(c.plan_step)
                .text(&c.cause);
            row.end();
        }
        Record::Echo(e) => {
            row.cell(log_ns)
                .cell(stamp(e.stamp_ns()))
                .cell(e.sequence)
                .text(&e.thruster);
            row.number(e.pulse_us)
                .cell(e.controller_time_us)
                .number(e.round_trip_s)
                .cell(e.errors);
            row.end();
        }
        Record::Motion(m) | Record::AutopilotMotion(m) | Record::Truth(m) => {
            motion(m, log_ns, stamp(m.stamp_ns()), &mut row)
        }
        Record::Profile(p) => profile(p, log_ns, stamp(p.stamp_ns()), &mut row),
        Record::Clock(c) => {
            row.cell(log_ns)
                .cell(c.monotonic_ns)
                .cell(c.realtime_ns)
                .cell(c.boottime_ns)
                .cell(c.bracket_ns);
            let k = c.controller.as_ref();
            row.maybe(k.map(|k| k.offset_us))
                .maybe(k.map(|k| k.offset_sd_us));
            row.maybe(k.map(|k| k.drift_ppm))
                .maybe(k.map(|k| k.drift_sd_ppm));
            row.maybe(k.map(|k| k.round_trip_us))
                .maybe(k.map(|k| k.round_trip_spread_us));
            row.maybe(k.map(|k| k.samples))
                .maybe(k.map(|k| k.host_epoch_ns));
            row.maybe(k.map(|k| k.controller_epoch_us));
            row.end();
        }
        Record::Event(e) => {
            let severity = format!("{:?}", super::messages::event_severity(e)).to_lowercase();
            let values: Vec<String> = e.values.iter().map(|(k, v)| format!("{k}={v}")).collect();
            row.cell(log_ns)
                .cell(stamp(e.stamp_ns()))
                .cell(severity)
                .text(&e.kind);
            row.text(&e.message).text(&values.join(" "));
            row.end();
        }
        Record::FrameInfo(f) => {
            row.cell(log_ns)
                .cell(stamp(f.stamp_ns()))
                .cell(f.sequence)
                .cell(f.frame_index);
            row.cell(f.driver_stamp_ns)
                .text(&f.driver_clock)
                .text(&f.stamp_source)
                .cell(f.v4l2_flags);
            row.cell(f.received_monotonic_ns)
                .cell(f.exposure_s)
                .text(&f.fault);
            row.cell(f.sequence_gap_before)
                .cell(f.time_gap_before)
                .cell(f.bytes_used);
            row.end();
        }
        Record::AutopilotState(a) => autopilot(a, log_ns, stamp(a.stamp_ns()), &mut row),
        _ => {}
    }
    out.len() > before
}

fn autopilot(a: &pb::AutopilotState, log_ns: u64, stamp_ns: u64, row: &mut Row<'_>) {
    let list = |values: &[f64]| {
        values
            .iter()
            .map(f64::to_string)
            .collect::<Vec<_>>()
            .join(" ")
    };
    row.cell(log_ns).cell(stamp_ns).text(&a.message);
    row.cell(a.autopilot_time_us)
        .maybe(a.armed)
        .maybe(a.mode)
        .maybe(a.battery_v)
        .maybe(a.battery_a);
    row.cell(a.esc_first)
        .text(&list(&a.esc_rpm))
        .text(&list(&a.esc_v))
        .text(&list(&a.esc_a));
    row.maybe(a.north_m)
        .maybe(a.east_m)
        .maybe(a.down_m)
        .maybe(a.north_mps)
        .maybe(a.east_mps)
        .maybe(a.down_mps);
    row.end();
}

fn motion(m: &pb::VehicleMotion, log_ns: u64, stamp_ns: u64, row: &mut Row<'_>) {
    row.cell(log_ns).cell(stamp_ns);
    for value in m.channels() {
        row.maybe(value.filter(|v| v.is_finite()));
    }
    let joined = |of: &[f64]| -> String {
        let words: Vec<String> = of.iter().map(f64::to_string).collect();
        words.join(" ")
    };
    row.text(&joined(&m.covariance));
    for value in m.companions() {
        row.maybe(value.filter(|v| v.is_finite()));
    }
    let own = m.own_covariance().filter(|_| !m.shared_loadings.is_empty());
    row.cell(own.map_or_else(String::new, |own| joined(&own)));
    // Numbers alone: no text that a spreadsheet could take for a formula.
    row.cell(joined(&m.shared_loadings));
    row.end();
}

fn profile(p: &pb::StripeProfile, log_ns: u64, stamp_ns: u64, row: &mut Row<'_>) {
    for (i, column) in p.column_px.iter().enumerate() {
        row.cell(log_ns)
            .cell(stamp_ns)
            .cell(p.sequence)
            .cell(column);
        for values in [&p.row_px, &p.peak, &p.sd_px, &p.sigma_px] {
            row.maybe(values.get(i));
        }
        row.maybe(p.quality.get(i));
        for values in [&p.xi_m, &p.eta_m, &p.xi_sd_m, &p.eta_sd_m] {
            row.maybe(values.get(i));
        }
        row.end();
    }
}

/// Way to a frame's image.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Saved {
    /// Encoded here.
    Now,
    /// An export that was broken off had made it.
    Before,
    /// The frame holds none.
    NoImage,
}

/// `frame_<sequence>_<mid-exposure, UNIX ns>.png`, which has its name when it is whole.
fn save(frame: &Frame, rule: &GreyRule, unfinished: &mut Unfinished) -> Result<Saved, LogError> {
    let meta = &frame.meta;
    let name = format!("frame_{:08}_{}.png", meta.sequence, meta.mid_exposure_ns);
    // Of frames by the same name the last one's image stays, as without a break.
    if unfinished.images.remove(&name) {
        return Ok(Saved::Before);
    }
    let Ok(grey) = frame.to_grey(rule) else {
        return Ok(Saved::NoImage);
    };
    let path = unfinished.part.join(&name);
    let tmp = unfinished.part.join(name + TMP);
    let (w, h) = (grey.width_px as u32, grey.height_px as u32);
    let mut out = BufWriter::new(File::create(&tmp).map_err(LogError::output(&path))?);
    image::write_buffer_with_format(
        &mut out,
        &grey.pixels,
        w,
        h,
        image::ColorType::L8,
        image::ImageFormat::Png,
    )
    .map_err(LogError::output(&path))?;
    out.flush()
        .and_then(|()| std::fs::rename(&tmp, &path))
        .map_err(LogError::output(&path))?;
    Ok(Saved::Now)
}

#[cfg(test)]
mod tests;
