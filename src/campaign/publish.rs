//! Runs as a data set that another group can use: README.md, runs.csv, columns.csv, a table of each run in SI, the rig, checksums.
//!
//! What ITTC's procedures ask to be reported of a run stands in runs.csv as far as a log knows it: water, distances to walls, floor
//! and surface, waiting time, speeds, amplitudes, frequencies, loads. What no log says is named in README.md.

mod columns;
mod readme;

use std::collections::BTreeMap;
use std::path::Path;

use chrono::{DateTime, Utc};
use hydroline_core::plain;
use hydroline_core::run::{Channel, Run};
use hydroline_core::session::FREE_KEY;
use hydroline_identify::data::LoadError;
use hydroline_identify::merged::Merged;
use hydroline_identify::{Seen, seen};
use hydroline_log::MetadataMap;
use hydroline_numerics::statistics::median;
use hydroline_rigs::{Dof, Rig};
use sha2::{Digest, Sha256};

/// Longer than so many usual steps is a gap, as the tables' flags have it.
const GAP_STEPS: f64 = 3.0;
/// Components of a load, in SNAME order.
const LOADS: [&str; 6] = [
    "surge_n", "sway_n", "heave_n", "roll_nm", "pitch_nm", "yaw_nm",
];
/// Longest wait that belongs to a day at the tank \[s\].
const DAY_S: f64 = 86_400.0;

/// A file of the data set: its path in the folder, and what is in it.
pub type File = (String, Vec<u8>);

/// What only a person knows of a data set.
#[derive(Debug, Clone, Default)]
pub struct About {
    /// Title.
    pub title: String,
    /// Who made the runs; `None` = not stated.
    pub authors: Option<String>,
    /// Licence of the data; `None` = not stated.
    pub licence: Option<String>,
    /// Paper or report that the data belong to; `None` = not stated.
    pub reference: Option<String>,
    /// Program and version that made the data set.
    pub made_by: String,
}

/// A run of the data set.
#[derive(Debug, Clone)]
pub struct Published {
    /// Name, and that of its table without the ending.
    pub name: String,
    /// UNIX time of t = 0 \[ns\].
    pub start_ns: u64,
    /// From t = 0 to the last row \[s\].
    pub length_s: f64,
    /// Rows of its table.
    pub rows: usize,
    /// Rows per second, by the usual step; `None` = fewer than two rows.
    pub rate_hz: Option<f64>,
    /// Steps that are longer than three usual ones.
    pub gaps: usize,
    /// Least distances of the CG from the walls, the floor and the surface \[m\]; `None` = not measured in the tank's frame.
    pub least_m: [Option<f64>; 3],
    /// Channels that were measured.
    pub channels: Vec<Channel>,
    /// Motion by DOF.
    pub seen: BTreeMap<String, Seen>,
    /// Largest load of each component \[N, N m\]; `None` = nothing was commanded.
    pub largest_load: Option<[f64; 6]>,
    /// What the log says of its session.
    pub session: MetadataMap,
    /// Its table.
    pub table: Vec<u8>,
}

impl Published {
    /// Reads a log, with its load by `rig`.
    ///
    /// # Errors
    /// [`LoadError`].
    pub fn read(name: &str, log: &Path, rig: &Rig) -> Result<Published, LoadError> {
        let merged = Merged::read(log, Some(rig))?;
        let mut table = Vec::new();
        // Into memory: nothing fails.
        let _ = merged.write(&mut table);
        let run = merged.run();
        let mut steps: Vec<f64> = run
            .samples
            .windows(2)
            .map(|w| w[1].t_s - w[0].t_s)
            .collect();
        let usual_s = median(&mut steps).filter(|s| *s > 0.0);
        let is_gap = |step: &&f64| usual_s.is_some_and(|usual_s| **step > GAP_STEPS * usual_s);
        let channels = Channel::ALL.into_iter().filter(|c| run.has(*c));
        Ok(Published {
            name: name.to_owned(),
            start_ns: run.start_ns,
            length_s: run.end_s(),
            rows: merged.rows(),
            rate_hz: usual_s.map(|s| 1.0 / s),
            gaps: steps.iter().filter(is_gap).count(),
            least_m: distances(run, rig),
            channels: channels.collect(),
            seen: seen(run),
            largest_load: (!run.commands.is_empty()).then(|| run.largest_wrench()),
            session: merged.session().clone(),
            table,
        })
    }

    /// Its table's path in the data set.
    fn file(&self) -> String {
        format!("runs/{}.csv", self.name)
    }

    /// A value of the session; empty = the log does not say it.
    fn said(&self, key: &str) -> &str {
        self.session.get(key).map_or("", String::as_str)
    }

    /// Start in UTC.
    fn start_utc(&self) -> String {
        let at = DateTime::<Utc>::from_timestamp_nanos(self.start_ns as i64);
        at.format("%Y-%m-%dT%H:%M:%SZ").to_string()
    }

    /// Statements under keys of the recorder's own (`record --set`): KEY=VALUE, with semicolons between.
    fn free_keys(&self) -> String {
        let free = self.session.iter().filter_map(|(key, value)| {
            let key = key.strip_prefix(FREE_KEY)?;
            Some(format!("{key}={value}"))
        });
        free.collect::<Vec<_>>().join("; ")
    }

    /// Cells of runs.csv with the names of their columns.
    fn row(&self, waiting_s: Option<f64>) -> Vec<(String, String)> {
        let number = |v: Option<f64>| v.map_or(String::new(), |v| v.to_string());
        let mut row: Vec<(String, String)> = Vec::new();
        let mut add = |name: &str, cell: String| row.push((name.to_owned(), cell));
        add("run", self.name.clone());
        add("file", self.file());
        add("kind", self.said("kind").to_owned());
        add("start_utc", self.start_utc());
        add("waiting_s", number(waiting_s));
        add("length_s", self.length_s.to_string());
        add("rows", self.rows.to_string());
        add("rate_hz", number(self.rate_hz));
        add("gaps", self.gaps.to_string());
        add("plan", self.said("plan.name").to_owned());
        add("repeat", self.said("run").to_owned());
        add("medium", self.said("medium").to_owned());
        add(
            "water_temperature_degc",
            self.said("water.temperature_c").to_owned(),
        );
        add(
            "water_salinity_gpkg",
            self.said("water.salinity_gpkg").to_owned(),
        );
        add("ballast_kg", self.said("ballast_kg").to_owned());
        for (name, least_m) in ["wall", "floor", "surface"].into_iter().zip(self.least_m) {
            add(&format!("least_distance_{name}_m"), number(least_m));
        }
        let channels = self.channels.iter().map(|c| c.name());
        add("measured", channels.collect::<Vec<_>>().join(" "));
        for dof in Dof::ALL {
            let of = self.seen.get(dof.name());
            let (name, (speed, way)) = (dof.name(), columns::units(dof));
            add(
                &format!("speed_{name}_{speed}"),
                number(of.map(|s| s.speed)),
            );
            let amplitude = of.and_then(|s| s.amplitude);
            add(&format!("amplitude_{name}_{way}"), number(amplitude));
            let frequency_hz = of.and_then(|s| s.frequency_hz);
            add(&format!("frequency_{name}_hz"), number(frequency_hz));
        }
        for (d, name) in LOADS.into_iter().enumerate() {
            let largest = self.largest_load.and_then(|l| l.get(d).copied());
            add(&format!("largest_{name}"), number(largest));
        }
        let line = |text: &str| plain::cell(&text.replace(['\n', '\r'], " ")).into_owned();
        add("operator", line(self.said("operator")));
        add("free_keys", line(&self.free_keys()));
        add("note", line(self.said("note")));
        row
    }
}

/// Least distances of the CG from the walls, the floor and the surface \[m\]; none where positions are of no tank.
fn distances(run: &Run, rig: &Rig) -> [Option<f64>; 3] {
    let tank = rig.tank;
    let inside = |[low, high]: [f64; 2], value: f64| (value - low).min(high - value);
    let each = |of: &dyn Fn(&hydroline_core::run::Sample) -> f64| {
        let values = run.samples.iter().map(of).filter(|v| v.is_finite());
        values.reduce(f64::min).filter(|least| *least >= 0.0)
    };
    [
        each(&|s| {
            let (x, y) = (s.values[Channel::X], s.values[Channel::Y]);
            // NaN of either is no distance.
            if x.is_finite() && y.is_finite() {
                inside(tank.x_m, x).min(inside(tank.y_m, y))
            } else {
                f64::NAN
            }
        }),
        each(&|s| -s.values[Channel::Z]),
        each(&|s| s.values[Channel::Z] + tank.depth_m),
    ]
}

/// From the end of the run before to the start of each \[s\]; `None` of the first, of runs at once, and over days.
fn waits(runs: &[&Published]) -> Vec<Option<f64>> {
    let of = |k: usize| {
        let before = runs.get(k.checked_sub(1)?)?;
        let between_s = runs.get(k)?.start_ns.checked_sub(before.start_ns)? as f64 * 1e-9;
        let waiting_s = between_s - before.length_s;
        (0.0..DAY_S).contains(&waiting_s).then_some(waiting_s)
    };
    (0..runs.len()).map(of).collect()
}

/// All files of the data set, runs in the order of their starts; `more` = further ones, as coefficients.csv, that README.md lists.
///
/// # Errors
/// Those of the CSV writer.
pub fn files(
    runs: &[Published],
    rig: &Rig,
    about: &About,
    more: Vec<File>,
) -> Result<Vec<File>, csv::Error> {
    let mut runs: Vec<&Published> = runs.iter().collect();
    runs.sort_by_key(|r| (r.start_ns, r.name.clone()));
    let waits = waits(&runs);
    let rows: Vec<Vec<(String, String)>> = runs
        .iter()
        .zip(&waits)
        .map(|(run, waiting_s)| run.row(*waiting_s))
        .collect();
    let mut writer = csv::Writer::from_writer(Vec::new());
    if let Some(first) = rows.first() {
        writer.write_record(first.iter().map(|cell| &cell.0))?;
    }
    for row in &rows {
        writer.write_record(row.iter().map(|cell| &cell.1))?;
    }
    let list = writer.into_inner().map_err(|e| e.into_error())?;
    let mut files = vec![
        (
            "README.md".to_owned(),
            readme::text(&runs, rig, about, &more).into_bytes(),
        ),
        ("runs.csv".to_owned(), list),
        ("columns.csv".to_owned(), columns::text(&rows, rig)?),
        ("rig.toml".to_owned(), rig.to_toml().into_bytes()),
    ];
    files.extend(more);
    files.extend(runs.iter().map(|r| (r.file(), r.table.clone())));
    let sums = files.iter().map(|(name, bytes)| {
        let digest = Sha256::digest(bytes);
        let hex: String = digest.iter().map(|b| format!("{b:02x}")).collect();
        format!("{hex}  {name}\n")
    });
    let sums: String = sums.collect();
    files.push(("SHA256SUMS".to_owned(), sums.into_bytes()));
    Ok(files)
}

#[cfg(test)]
mod tests;
