//! `hydroline reproduce`: the paper's tables, computed and printed beside its numbers.

mod summary;

use super::output::Output;
use super::print::{self, out, outln};
use super::{CliError, Outcome, progress};
use clap::ValueEnum;
use hydroline_lab::reproduce::{
    CalibrationStudy, Disturbed, DofRow, Figure, JointAccuracy, Row, SurgeRun, Table10Row,
    Table11Row, all_dofs, disturbed, figure12, figure13, figure17, joint_accuracy, table3, table7,
    table10, table11,
};
use std::path::PathBuf;
use std::time::Instant;

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum What {
    /// Every table, figure and study in turn, with a line of summary each at the end
    All,
    /// Accuracy of the six formulas, each in its own motion
    Table3,
    /// Changes that disturbances cause in surge, sway and heave
    Table4,
    /// Changes that disturbances cause in roll, pitch and yaw
    Table5,
    /// Surge coefficients through rendered frames, three conditions, paper's and joint estimators (with Table 7)
    Table10,
    /// 5 m predictions from the parameters that Table 10 prints
    Table11,
    /// Coefficients of the other five DOFs through rendered frames
    AllDofs,
    /// Every map from image to laser plane on one synthetic rig, with the scallop of the literal ones
    Calibration,
    /// Six surge runs by the formulas, and by joint pose smoothed over the run
    Table7,
    /// Pitch by Eq. 5 under a heave disturbance
    Figure12,
    /// Pitch and the line's place in the laser plane
    Figure13,
    /// Yaw between path and target, frame by frame, of a surge run
    Figure17,
    /// Joint pose of single frames under all of the tables' disturbances at once, beside its bound
    JointPose,
}

#[derive(Debug, clap::Args)]
#[command(after_help = "\
With every frame and 20 seeds (the defaults) table10 and all-dofs alone take an hour of two cores.

Examples:
  hydroline reproduce table4
  hydroline reproduce figure12 --svg figure12.svg
  hydroline reproduce all --every 10 --seeds 2    # about ten minutes of a core

Exit codes: 0 done; 1 a table cannot be computed; 2 bad arguments or target.")]
pub struct Args {
    /// Table, figure or study to compute
    #[arg(value_enum, value_name = "WHAT")]
    what: What,
    /// Takes every n-th frame of the paper's animations only (table3, table7, figures). The formulas of table7 follow
    /// the vehicle from frame to frame: with few frames they may take a place for its mirror image
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..), value_name = "N")]
    every: u16,
    /// Frames for joint-pose
    #[arg(long, default_value_t = 500, value_parser = clap::value_parser!(u32).range(1..100_000), value_name = "N")]
    frames: u32,
    /// Seed for joint-pose and calibration
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Experiments per condition for table10 and all-dofs, each with its own image noise
    #[arg(long, default_value_t = 20, value_parser = clap::value_parser!(u64).range(1..1000), value_name = "N")]
    seeds: u64,
    /// Target for joint-pose: a file, or hexagons or two-level
    #[arg(long, default_value = "hexagons", value_name = "TARGET")]
    target: String,
    /// Writes the numbers as CSV
    #[arg(long, value_name = "FILE.csv")]
    csv: Option<PathBuf>,
    /// Draws a figure
    #[arg(long, value_name = "FILE.svg")]
    svg: Option<PathBuf>,
    /// Prints one JSON object
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    output: Output,
}

pub fn run(args: &Args) -> Result<Outcome, CliError> {
    match args.what {
        What::All => all(args)?,
        _ => {
            one(args)?;
        }
    }
    Ok(Outcome::Done)
}

/// Computes and prints one table or figure; returns its summary in a line.
fn one(args: &Args) -> Result<String, CliError> {
    for (flag, path) in [("--csv", &args.csv), ("--svg", &args.svg)] {
        if let Some(path) = path {
            args.output.file(flag, path)?;
        }
    }
    let every = usize::from(args.every);
    let figure = match args.what {
        What::Figure12 => Some(figure12(every)),
        What::Figure13 => Some(figure13(every)),
        What::Figure17 => Some(figure17(every)),
        _ => None,
    };
    if let Some(figure) = figure {
        let figure = figure?;
        print(args.json, "figure", &figure, || print_figure(&figure))?;
        save(args.output, args.csv.as_ref(), &figure.csv())?;
        save(args.output, args.svg.as_ref(), &figure.svg())?;
        return Ok(figure.notes.join("; "));
    }
    if args.svg.is_some() {
        return Err(CliError::Config(
            "--svg draws figures: figure12, figure13 or figure17; for a table give --csv"
                .to_owned(),
        ));
    }
    let (csv, line) = match args.what {
        What::Table4 | What::Table5 => {
            let five = args.what == What::Table5;
            let cells = disturbed(five)?;
            let name = if five { "table5" } else { "table4" };
            print(args.json, name, &cells, || print_cells(&cells))?;
            let csv = csv_of(
                "formula,disturbance,from,to,condition,paper,ours,unit,no_answer",
                cells.iter().map(|c| {
                    format!(
                        "{:?},{:?},{},{},\"{}\",\"{}\",{},{},{}",
                        c.motion,
                        c.by,
                        c.from_to[0],
                        c.from_to[1],
                        c.condition,
                        c.paper.unwrap_or("lost"),
                        c.ours,
                        c.unit,
                        c.missing
                    )
                }),
            );
            (csv, summary::disturbed(&cells))
        }
        What::Calibration => {
            let study = CalibrationStudy::compute(args.seed)?;
            print(args.json, "calibration", &study, || out!("{study}"))?;
            (csv_of_any(&study), summary::calibration(&study))
        }
        What::Table10 => {
            let bar = progress::bar(3 * args.seeds, "experiments");
            let rows = table10(args.seeds, &|| bar.inc(1))?;
            bar.finish_and_clear();
            print(args.json, "table10", &rows, || print_table10(&rows))?;
            (csv_of_any(&rows), summary::table10(&rows))
        }
        What::Table11 => {
            let rows = table11();
            print(args.json, "table11", &rows, || print_table11(&rows))?;
            (csv_of_any(&rows), summary::table11(&rows))
        }
        What::AllDofs => {
            let bar = progress::bar(5 * args.seeds, "experiments");
            let rows = all_dofs(args.seeds, &|| bar.inc(1))?;
            bar.finish_and_clear();
            print(args.json, "all_dofs", &rows, || print_all_dofs(&rows))?;
            (csv_of_any(&rows), summary::all_dofs(&rows))
        }
        What::Table7 => {
            let runs = table7(every)?;
            print(args.json, "table7", &runs, || print_table7(&runs))?;
            let csv = csv_of(
                "thrust_n,disturbance,frames,paper_psi_s_deg,paper_max_mm,whole_pixel_psi_s_deg,whole_pixel_max_mm,formula_psi_s_deg,formula_max_mm,joint_max_mm,smoothed_max_mm",
                runs.iter().map(|r| {
                    format!(
                        "{},{:?},{},{},{},{},{},{},{},{},{}",
                        r.thrust_n,
                        r.disturbance,
                        r.frames,
                        r.paper_psi_s_deg,
                        r.paper_max_mm,
                        r.whole_pixel_psi_s_deg,
                        r.whole_pixel_max_mm,
                        r.formula_psi_s_deg,
                        r.formula_max_mm,
                        r.joint_mm[1],
                        r.smoothed_mm[1]
                    )
                }),
            );
            (csv, summary::table7(&runs))
        }
        What::JointPose => {
            let found = joint_accuracy(args.frames as usize, args.seed, &args.target)?;
            print(args.json, "joint_pose", &found, || print_joint(&found))?;
            let csv = csv_of(
                "rms,reported_sd,bound,covered_95",
                (0..6).map(|i| {
                    format!(
                        "{},{},{},{}",
                        found.rms[i],
                        found.reported_sd[i],
                        found.bound[i],
                        found.covered_95_each[i]
                    )
                }),
            );
            (csv, summary::joint(&found))
        }
        _ => {
            let rows = table3(every)?;
            print(args.json, "table3", &rows, || print_table3(&rows))?;
            let csv = csv_of(
                "motion,unit,frames,paper_low,paper_high,whole_pixel_low,whole_pixel_high,formula_low,formula_high,ours_low,ours_high",
                rows.iter().map(|r| {
                    format!(
                        "{:?},{},{},{},{},{},{},{},{},{},{}",
                        r.motion,
                        r.unit,
                        r.frames,
                        r.paper[0],
                        r.paper[1],
                        r.whole_pixel[0],
                        r.whole_pixel[1],
                        r.formula[0],
                        r.formula[1],
                        r.ours[0],
                        r.ours[1]
                    )
                }),
            );
            (csv, summary::table3(&rows))
        }
    };
    save(args.output, args.csv.as_ref(), &csv)?;
    Ok(line)
}

/// Everything in turn; a table that fails is named at the end, and the others still come.
fn all(args: &Args) -> Result<(), CliError> {
    if args.csv.is_some() || args.svg.is_some() || args.json {
        return Err(CliError::Config(
            "reproduce all prints words; --csv, --svg and --json go with one table".to_owned(),
        ));
    }
    let (mut lines, mut failed) = (Vec::new(), Vec::new());
    for what in What::value_variants().iter().filter(|w| **w != What::All) {
        let name = what
            .to_possible_value()
            .map_or_else(String::new, |v| v.get_name().to_owned());
        outln!("== {name}");
        let start = Instant::now();
        let found = one(&Args {
            what: *what,
            target: args.target.clone(),
            csv: None,
            svg: None,
            ..*args
        });
        outln!("");
        let words = found.unwrap_or_else(|error| {
            failed.push(name.clone());
            format!("FAILED: {error}")
        });
        lines.push(format!(
            "{name:<12}{:>8.1} s  {words}",
            start.elapsed().as_secs_f64()
        ));
    }
    outln!("== summary");
    for line in lines {
        outln!("{line}");
    }
    if failed.is_empty() {
        Ok(())
    } else {
        Err(CliError::Run(format!("{} failed", failed.join(", "))))
    }
}

fn csv_of(header: &str, rows: impl Iterator<Item = String>) -> String {
    std::iter::once(header.to_owned())
        .chain(rows)
        .map(|line| line + "\n")
        .collect()
}

/// The rows of a table as CSV: one column per number, `a.0`, `a.1` for lists.
fn csv_of_any(table: &impl serde::Serialize) -> String {
    let value = serde_json::to_value(table).unwrap_or_default();
    let rows = match value {
        serde_json::Value::Array(rows) => rows,
        // A study: the list in it.
        serde_json::Value::Object(mut map) => match map.values_mut().find(|v| v.is_array()) {
            Some(serde_json::Value::Array(rows)) => std::mem::take(rows),
            _ => vec![map.into()],
        },
        other => vec![other],
    };
    let flat: Vec<Vec<(String, String)>> = rows
        .iter()
        .map(|row| {
            let mut cells = Vec::new();
            flatten("", row, &mut cells);
            cells
        })
        .collect();
    let mut names: Vec<&str> = Vec::new();
    for (name, _) in flat.iter().flatten() {
        if !names.contains(&name.as_str()) {
            names.push(name);
        }
    }
    csv_of(
        &names.join(","),
        flat.iter().map(|cells| {
            let cell = |name: &&str| {
                let found = cells.iter().find(|(n, _)| n == name);
                found.map_or_else(String::new, |(_, v)| v.clone())
            };
            names.iter().map(cell).collect::<Vec<_>>().join(",")
        }),
    )
}

fn flatten(name: &str, value: &serde_json::Value, cells: &mut Vec<(String, String)>) {
    let below = |key: &str| match name {
        "" => key.to_owned(),
        _ => format!("{name}.{key}"),
    };
    match value {
        serde_json::Value::Object(map) => map
            .iter()
            .for_each(|(key, v)| flatten(&below(key), v, cells)),
        serde_json::Value::Array(list) => (0..)
            .zip(list)
            .for_each(|(i, v): (usize, _)| flatten(&below(&i.to_string()), v, cells)),
        serde_json::Value::Null => cells.push((name.to_owned(), String::new())),
        serde_json::Value::String(text) => {
            cells.push((
                name.to_owned(),
                format!("\"{}\"", text.replace('"', "\"\"")),
            ));
        }
        other => cells.push((name.to_owned(), other.to_string())),
    }
}

fn save(output: Output, path: Option<&PathBuf>, text: &str) -> Result<(), CliError> {
    let Some(path) = path else { return Ok(()) };
    output.write(path, text)
}

fn print_figure(figure: &Figure) {
    outln!("{}", figure.title);
    for s in &figure.series {
        outln!("  {}: {} points", s.name, s.points.len());
    }
    for note in &figure.notes {
        outln!("  {note}");
    }
    outln!("  --svg draws it, --csv and --json give the points");
}

fn print_table7(runs: &[SurgeRun]) {
    outln!(
        "Table 7: psi_S and greatest error of x over a surge run of 1 m at psi_S = -4 deg\n\
         (disturbances chosen to the paper's size: its Figs 15 and 16 are lost)"
    );
    outln!(
        "{:26} {:>17} {:>17} {:>17} {:>10} {:>10}",
        "",
        "paper",
        "whole pixel",
        "formula, ours",
        "joint",
        "smoothed"
    );
    for r in runs {
        let pair = |psi: f64, mm: f64| format!("{psi:.2} deg {mm:.1} mm");
        outln!(
            "{:2} N {:21} {:>17} {:>17} {:>17} {:>7.2} mm {:>7.2} mm  (sd {:.2}; {} frames, no answer {:?})",
            r.thrust_n,
            format!("{:?}", r.disturbance),
            pair(r.paper_psi_s_deg, r.paper_max_mm),
            pair(r.whole_pixel_psi_s_deg, r.whole_pixel_max_mm),
            pair(r.formula_psi_s_deg, r.formula_max_mm),
            r.joint_mm[1],
            r.smoothed_mm[1],
            r.smoothed_sd_mm,
            r.frames,
            r.missing
        );
    }
}

/// Output of `--json`: the table or figure under its name.
pub(super) type Printed<'a, T> = std::collections::BTreeMap<&'static str, &'a T>;

fn print<T: serde::Serialize + schemars::JsonSchema>(
    json: bool,
    name: &'static str,
    value: &T,
    words: impl FnOnce(),
) -> Result<(), CliError> {
    if json {
        print::json(&Printed::from([(name, value)]))
    } else {
        words();
        Ok(())
    }
}

fn print_table3(rows: &[Row]) {
    outln!("Table 3: least and greatest error of each formula in its own motion");
    outln!(
        "{:6} {:>4} {:>6}  {:>15}  {:>15}  {:>17}  {:>17}  no answer",
        "",
        "",
        "frames",
        "paper",
        "whole pixel",
        "formula, ours",
        "ours"
    );
    for r in rows {
        let span = |v: [f64; 2], digits: usize| format!("{:+.digits$} .. {:+.digits$}", v[0], v[1]);
        outln!(
            "{:6} {:>4} {:>6}  {:>15}  {:>15}  {:>17}  {:>17}  {:?}",
            format!("{:?}", r.motion).to_lowercase(),
            r.unit,
            r.frames,
            span(r.paper, 1),
            span(r.whole_pixel, 2),
            span(r.formula, 3),
            span(r.ours, 4),
            r.missing
        );
        if let Some(corner) = r.ours_at_corners {
            outln!(
                "       within 8 mm of a joint or widest point: {}",
                span(corner, 4)
            );
        }
    }
}

fn print_cells(cells: &[Disturbed]) {
    outln!(
        "Largest change of a formula's result by another motion; entries the paper's text has lost are marked *"
    );
    for c in cells {
        let name = |m: hydroline_lab::reproduce::Motion| format!("{m:?}").to_lowercase();
        let lost = if c.missing > 0 {
            format!("  ({} frames without an answer)", c.missing)
        } else {
            String::new()
        };
        outln!(
            "{:6} under {:6} {:>4} .. {:<3}  paper {:>10}  ours {:8.3} {}  {}{lost}",
            name(c.motion),
            name(c.by),
            c.from_to[0],
            c.from_to[1],
            c.paper.unwrap_or("*"),
            c.ours,
            c.unit,
            c.condition
        );
    }
}

fn print_joint(found: &JointAccuracy) {
    outln!(
        "{} frames under all disturbances at once, {} without a pose",
        found.frames,
        found.failed
    );
    for (i, name) in ["x mm", "y mm", "z mm", "phi deg", "theta deg", "psi deg"]
        .iter()
        .enumerate()
    {
        outln!(
            "  {name:9} rms {:.5}  reported sd {:.5}  bound {:.5}  95 % interval holds {:.1} %",
            found.rms[i],
            found.reported_sd[i],
            found.bound[i],
            100.0 * found.covered_95_each[i]
        );
    }
    outln!(
        "  largest error {:.1} of its sd; {:.1} % inside the 95 % region of all six together",
        found.worst_in_sd,
        100.0 * found.covered_95
    );
}

fn print_table11(rows: &[Table11Row]) {
    outln!("Table 11 from Table 10: largest position error over 5 m [mm] at 4, 8, 16 N");
    for r in rows {
        let words = |v: [f64; 3]| format!("{:7.2} {:7.2} {:7.2}", v[0], v[1], v[2]);
        outln!(
            "{:20} ours {}   paper {}",
            r.condition,
            words(r.error_mm),
            words(r.printed_mm)
        );
    }
}

fn print_table10(rows: &[Table10Row]) {
    let n = rows.first().map_or(0, |r| r.seeds);
    outln!(
        "Table 10 through rendered frames, {n} experiment(s) per condition; errors in % of the actual coefficient"
    );
    let three = |v: [f64; 3], digits: usize| v.map(|x| format!("{x:9.digits$}")).join("");
    for r in rows {
        outln!("{} | {} estimator", r.condition, r.estimator);
        outln!("  {:32}{:>9}{:>9}{:>9}", "", "X_udot", "X_u", "X_u|u|");
        outln!("  {:32}{}", "rms error, %", three(r.rms_percent, 3));
        outln!("  {:32}{}", "mean error, %", three(r.mean_percent, 3));
        outln!("  {:32}{}", "reported sd, %", three(r.sd_percent, 3));
        outln!(
            "  {:32}{}",
            "largest error, in its sd",
            three(r.worst_in_sd, 2)
        );
        outln!(
            "  {:32}{}",
            "paper's own error, %",
            three(r.printed_percent, 3)
        );
        outln!(
            "  {:32}{}   worst{}   paper{}",
            "5 m at 4, 8, 16 N, rms mm",
            three(r.prediction_mm, 2),
            three(r.prediction_worst_mm, 2),
            three(r.prediction_printed_mm, 1)
        );
        let psi = r.psi_s_deg.map_or(String::new(), |p| {
            format!(", psi_S {:.2} and {:.2} deg", p[0], p[1])
        });
        outln!(
            "  position at 4 and 8 N: largest error {:.2} and {:.2} mm (paper {} and {}), rms {:.3} and {:.3}{psi}, frames lost {:.1} %",
            r.position_mm[0],
            r.position_mm[1],
            r.position_printed_mm[0],
            r.position_printed_mm[1],
            r.position_rms_mm[0],
            r.position_rms_mm[1],
            100.0 * r.lost
        );
    }
}

fn print_all_dofs(rows: &[DofRow]) {
    let n = rows.first().map_or(0, |r| r.seeds);
    outln!(
        "Other five DOFs through rendered frames, undisturbed, {n} experiment(s) each; errors in %"
    );
    outln!(
        "{:6} {:6} {:>29} {:>29} {:>29} {:>24}  position rms, frames lost",
        "",
        "",
        "rms error",
        "mean error",
        "reported sd",
        "largest in sd"
    );
    for r in rows {
        let three = |v: [f64; 3], width: usize| v.map(|x| format!("{x:>width$.3}")).join(" ");
        outln!(
            "{:6} {:6} {:>29} {:>29} {:>29} {:>24}  {:.4} {}, {:.1} % of {}",
            r.dof,
            r.estimator,
            three(r.rms_percent, 8),
            three(r.mean_percent, 8),
            three(r.sd_percent, 8),
            three(r.worst_in_sd, 6),
            r.position_rms,
            if ["sway", "heave"].contains(&r.dof.as_str()) {
                "mm"
            } else {
                "deg"
            },
            100.0 * r.lost,
            r.frames
        );
    }
}
