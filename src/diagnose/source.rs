//! A log, read once: its run, and what shows faults of the data.

use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use hydroline_rigs::Rig;

use super::faults::{Records, fault, faults};
use super::single_run_split::release_instant;
use super::verdict::DataFault;
use hydroline_core::run::{Joined, Run, instrument_sd};
use hydroline_identify::data::{LoadError, load_messages};
use hydroline_log::messages::{timestamp, unix_ns};
use hydroline_log::{LogReader, Record};

/// A log taken apart.
#[derive(Debug, Clone, Default)]
pub struct Source {
    /// Commands and motion; of a log of frames alone its name.
    pub run: Run,
    /// Faults of its data.
    pub faults: Vec<DataFault>,
    /// Log that holds its frames; `None` = there are none to ask.
    pub frames: Option<PathBuf>,
}

impl Source {
    /// The same with the frames of another log: of the recording whose replay has given the motion.
    #[must_use]
    pub fn with_frames_of(mut self, log: &Path) -> Source {
        self.frames = Some(log.to_owned());
        self
    }

    /// Sources of which windows of one recording that meet are one: given whole or cut, a run says the same.
    #[must_use]
    pub fn joined(sources: &[Source]) -> Vec<Source> {
        let mut sorted: Vec<&Source> = sources.iter().collect();
        let first_s = |s: &Source| s.run.samples.first().map_or(f64::INFINITY, |s| s.t_s);
        sorted.sort_by(|a, b| first_s(a).total_cmp(&first_s(b)));
        let mut made: Vec<Source> = Vec::new();
        for source in sorted {
            let joined = made.iter_mut().find_map(|m| {
                let run = m.run.joined_with(&source.run)?;
                Some((m, run))
            });
            match joined {
                Some((whole, run)) => {
                    whole.run = run;
                    whole.faults.extend(source.faults.iter().cloned());
                }
                None => made.push(source.clone()),
            }
        }
        made
    }

    /// Whether any motion was measured.
    pub fn has_motion(&self) -> bool {
        !self.run.samples.is_empty()
    }
}

/// A log, or `LOG@FROM..TO`: a window of it \[s since the log's first stamp\]. Either end may be left out.
#[derive(Debug, Clone, PartialEq)]
pub struct Part {
    /// The file.
    pub path: PathBuf,
    /// The window \[s\].
    pub window_s: Option<(f64, f64)>,
}

impl From<&Path> for Part {
    fn from(path: &Path) -> Part {
        Part {
            path: path.to_owned(),
            window_s: None,
        }
    }
}

impl Part {
    /// Whether both hold some of the same recording.
    pub fn overlaps(&self, other: &Part) -> bool {
        let ends = |p: &Part| p.window_s.unwrap_or((0.0, f64::INFINITY));
        let ((from, to), (begin, end)) = (ends(self), ends(other));
        self.path == other.path && from < end && begin < to
    }
}

impl From<&PathBuf> for Part {
    fn from(path: &PathBuf) -> Part {
        Part::from(path.as_path())
    }
}

impl fmt::Display for Part {
    /// As the command line takes it.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.path.display())?;
        match self.window_s {
            None => Ok(()),
            Some((from_s, to_s)) if to_s.is_finite() => write!(f, "@{from_s}..{to_s}"),
            Some((from_s, _)) => write!(f, "@{from_s}.."),
        }
    }
}

impl FromStr for Part {
    type Err = String;

    fn from_str(text: &str) -> Result<Part, String> {
        let whole = Part::from(Path::new(text));
        // A file of that name is that file.
        let Some((path, window)) = text.rsplit_once('@').filter(|_| !whole.path.exists()) else {
            return Ok(whole);
        };
        let Some((from, to)) = window.split_once("..") else {
            return Ok(whole);
        };
        let end = |text: &str, none: f64| {
            if text.is_empty() {
                return Ok(none);
            }
            let number = text.parse::<f64>().ok();
            number
                .filter(|v| v.is_finite() && *v >= 0.0)
                .ok_or_else(|| {
                    format!(
                        "'@{window}': '{text}' is not a number >= 0; \
                     write LOG@34..64, seconds since the log's start"
                    )
                })
        };
        let (from_s, to_s) = (end(from, 0.0)?, end(to, f64::INFINITY)?);
        if to_s <= from_s {
            return Err(format!(
                "'@{window}' ends before it begins; write LOG@34..64, seconds since the log's start"
            ));
        }
        Ok(Part {
            path: PathBuf::from(path),
            window_s: Some((from_s, to_s)),
        })
    }
}

/// Reads a log or a window of it; of a log of frames without motion, where they are. A decay without a window is taken from where the hull was released.
///
/// # Errors
/// [`LoadError`].
pub fn read(part: impl Into<Part>, rig: &Rig) -> Result<Source, LoadError> {
    let Part { path, window_s } = part.into();
    let path = path.as_path();
    let name = path.file_stem().map_or_else(
        || path.display().to_string(),
        |s| s.to_string_lossy().into_owned(),
    );
    let (mut commands, mut motion, mut frames) = (Vec::new(), Vec::new(), None);
    let mut records = Records::default();
    let mut reader = LogReader::open(path)?;
    for message in reader.by_ref() {
        match message?.record {
            Record::Command(command) => commands.push(command),
            Record::Motion(sample) => {
                records.motion(
                    unix_ns(sample.timestamp.as_ref().unwrap_or(&timestamp(0))),
                    &sample,
                );
                motion.push(sample);
            }
            Record::Frame(_) => frames = Some(path.to_owned()),
            Record::Clock(pair) => {
                records
                    .clocks_ns
                    .push((pair.monotonic_ns, pair.realtime_ns));
                if let Some(c) = &pair.controller {
                    records.drift_ppm.push((c.drift_ppm, c.drift_sd_ppm));
                }
            }
            _ => {}
        }
    }
    if motion.is_empty() {
        if frames.is_none() {
            return Err(LoadError::NoMotion {
                log: path.display().to_string(),
                frames: 0,
            });
        }
        let run = Run {
            name,
            ..Run::default()
        };
        return Ok(Source {
            run,
            frames,
            ..Source::default()
        });
    }
    let mut run = load_messages(&name, &commands, &motion, rig)?;
    if let Some(session) = reader.metadata().get("session") {
        run.joined = Joined::of(session);
        run.instrument_sd = instrument_sd::of_session(session);
    }
    if let Some((from_s, to_s)) = window_s {
        let end_s = run.end_s();
        run = cut(run, &mut records, from_s, to_s);
        run.name = format!("{name}@{from_s}..{:.2}", run.end_s());
        if run.samples.is_empty() {
            return Err(LoadError::EmptyWindow {
                log: path.display().to_string(),
                from_s,
                to_s,
                end_s,
            });
        }
    }
    let mut found = Vec::new();
    if window_s.is_none()
        && let Some((at_s, channel)) = release_instant(&run, rig)
    {
        found.push(fault(&run, "before_release", channel, format!("no thruster ran, and {channel} swings freely from {at_s:.2} s on; what was before is not fitted"), false));
        run = cut(run, &mut records, at_s, f64::INFINITY);
    }
    found.extend(faults(&run, &records, rig));
    Ok(Source {
        run,
        faults: found,
        frames,
    })
}

fn cut(run: Run, records: &mut Records, from_s: f64, to_s: f64) -> Run {
    let start_ns = run.start_ns;
    records
        .motion
        .retain(|(ns, _)| (from_s..=to_s).contains(&(ns.saturating_sub(start_ns) as f64 * 1e-9)));
    run.window(from_s, to_s)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn a_window_is_part_of_the_name_and_checked() {
        let part: Part = "roll.mcap@9..34.5".parse().unwrap();
        assert_eq!(part.path, Path::new("roll.mcap"));
        assert_eq!(part.window_s, Some((9.0, 34.5)));
        let open: Part = "roll.mcap@9..".parse().unwrap();
        assert_eq!(open.window_s, Some((9.0, f64::INFINITY)));
        let next: Part = "roll.mcap@34.5..60".parse().unwrap();
        assert!(open.overlaps(&part) && !part.overlaps(&next) && !next.overlaps(&part));
        assert!(next.overlaps(&Part::from(Path::new("roll.mcap"))));
        for part in ["roll.mcap@9..34.5", "roll.mcap@9..", "roll.mcap"] {
            assert_eq!(part.parse::<Part>().unwrap().to_string(), part);
        }
        let whole: Part = "me@work.mcap".parse().unwrap();
        assert_eq!(whole, Part::from(Path::new("me@work.mcap")));
        for wrong in ["a@5..3", "a@x..3", "a@1..nan", "a@-1..3"] {
            let said = wrong.parse::<Part>().unwrap_err();
            assert!(said.contains("LOG@34..64"), "{said}");
        }
    }
}
