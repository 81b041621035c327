//! `hydroline reproduce`: the paper's tables, computed and printed beside its numbers.

use super::print::outln;
use super::{CliError, Outcome, inputs};
use crate::reproduce::{
    Disturbed, Figure, JointAccuracy, Row, SurgeRun, disturbed, figure12, figure13, figure17,
    joint_accuracy, table3, table7,
};
use std::path::PathBuf;

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum What {
    /// Accuracy of the six formulas, each in its own motion
    Table3,
    /// What disturbances do to surge, sway and heave
    Table4,
    /// What disturbances do to roll, pitch and yaw
    Table5,
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
pub struct Args {
    /// What to compute
    #[arg(value_enum, value_name = "WHAT")]
    what: What,
    /// Takes every n-th frame of the paper's animations only
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..), value_name = "N")]
    every: u16,
    /// Frames for joint-pose
    #[arg(long, default_value_t = 500, value_parser = clap::value_parser!(u32).range(1..100_000), value_name = "N")]
    frames: u32,
    /// Seed for joint-pose
    #[arg(long, default_value_t = 1)]
    seed: u64,
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
}

pub fn run(args: &Args) -> Result<Outcome, CliError> {
    for (flag, path) in [("--csv", &args.csv), ("--svg", &args.svg)] {
        if let Some(path) = path {
            inputs::new_file(flag, path)?;
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
        let figure = figure.map_err(CliError::run)?;
        print(args.json, "figure", &figure, || print_figure(&figure));
        save(args.csv.as_ref(), &figure.csv())?;
        save(args.svg.as_ref(), &figure.svg())?;
        return Ok(Outcome::Done);
    }
    if args.svg.is_some() {
        return Err(CliError::Config(
            "--svg draws figures: figure12, figure13 or figure17; for a table give --csv"
                .to_owned(),
        ));
    }
    let csv = match args.what {
        What::Table4 | What::Table5 => {
            let five = args.what == What::Table5;
            let cells = disturbed(five).map_err(CliError::run)?;
            let name = if five { "table5" } else { "table4" };
            print(args.json, name, &cells, || print_cells(&cells));
            csv_of(
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
            )
        }
        What::Table7 => {
            let runs = table7(every).map_err(CliError::run)?;
            print(args.json, "table7", &runs, || print_table7(&runs));
            csv_of(
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
            )
        }
        What::JointPose => {
            let found = joint_accuracy(args.frames as usize, args.seed, &args.target)
                .map_err(CliError::run)?;
            print(args.json, "joint_pose", &found, || print_joint(&found));
            csv_of(
                "rms,reported_sd,bound",
                (0..6).map(|i| {
                    format!(
                        "{},{},{}",
                        found.rms[i], found.reported_sd[i], found.bound[i]
                    )
                }),
            )
        }
        _ => {
            let rows = table3(every).map_err(CliError::run)?;
            print(args.json, "table3", &rows, || print_table3(&rows));
            csv_of(
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
            )
        }
    };
    save(args.csv.as_ref(), &csv)?;
    Ok(Outcome::Done)
}

fn csv_of(header: &str, rows: impl Iterator<Item = String>) -> String {
    std::iter::once(header.to_owned())
        .chain(rows)
        .map(|line| line + "\n")
        .collect()
}

fn save(path: Option<&PathBuf>, text: &str) -> Result<(), CliError> {
    let Some(path) = path else { return Ok(()) };
    std::fs::write(path, text).map_err(|e| CliError::Run(format!("{}: {e}", path.display())))
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

fn print(json: bool, name: &str, value: &impl serde::Serialize, words: impl FnOnce()) {
    if json {
        outln!("{}", serde_json::json!({ name: value }))
    } else {
        words()
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
        let name = |m: crate::reproduce::Motion| format!("{m:?}").to_lowercase();
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
            "  {name:9} rms {:.5}  reported sd {:.5}  bound {:.5}",
            found.rms[i],
            found.reported_sd[i],
            found.bound[i]
        );
    }
    outln!(
        "  largest error {:.1} of its sd; {:.1} % inside the 95 % region",
        found.worst_in_sd,
        100.0 * found.covered_95
    );
}
