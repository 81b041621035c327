//! `hydroline reproduce`: the paper's tables, computed and printed beside its numbers.

use super::print::{out, outln};
use super::{CliError, Outcome, progress};
use crate::reproduce::{
    CalibrationStudy, Disturbed, DofRow, JointAccuracy, Row, Table10Row, Table11Row, all_dofs,
    disturbed, joint_accuracy, table3, table10, table11,
};

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum What {
    /// Accuracy of the six formulas, each in its own motion
    Table3,
    /// What disturbances do to surge, sway and heave
    Table4,
    /// What disturbances do to roll, pitch and yaw
    Table5,
    /// All six degrees of freedom from single frames under all disturbances at once
    JointPose,
    /// Surge coefficients through rendered frames, three conditions, paper's and joint estimators (with Table 7)
    Table10,
    /// 5 m predictions from the parameters that Table 10 prints
    Table11,
    /// Coefficients of the other five DOFs through rendered frames
    AllDofs,
    /// Every map from image to laser plane on one synthetic rig, with the scallop of the literal ones
    Calibration,
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
    /// Seed for joint-pose and calibration
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Experiments per condition for table10 and all-dofs, each with its own image noise
    #[arg(long, default_value_t = 20, value_parser = clap::value_parser!(u64).range(1..1000), value_name = "N")]
    seeds: u64,
    /// Prints one JSON object
    #[arg(long)]
    json: bool,
}

pub fn run(args: &Args) -> Result<Outcome, CliError> {
    match args.what {
        What::Table3 => {
            let rows = table3(usize::from(args.every)).map_err(CliError::run)?;
            print(args.json, "table3", &rows, || print_table3(&rows));
        }
        What::Table4 | What::Table5 => {
            let five = args.what == What::Table5;
            let cells = disturbed(five).map_err(CliError::run)?;
            print(
                args.json,
                if five { "table5" } else { "table4" },
                &cells,
                || print_cells(&cells),
            );
        }
        What::Calibration => {
            let study = CalibrationStudy::compute(args.seed).map_err(CliError::run)?;
            print(args.json, "calibration", &study, || out!("{study}"));
        }
        What::JointPose => {
            let found = joint_accuracy(args.frames as usize, args.seed).map_err(CliError::run)?;
            print(args.json, "joint_pose", &found, || print_joint(&found));
        }
        What::Table10 => {
            let bar = progress::bar(3 * args.seeds, "experiments");
            let rows = table10(args.seeds, &|| bar.inc(1)).map_err(CliError::run)?;
            bar.finish_and_clear();
            print(args.json, "table10", &rows, || print_table10(&rows));
        }
        What::Table11 => {
            let rows = table11();
            print(args.json, "table11", &rows, || print_table11(&rows));
        }
        What::AllDofs => {
            let bar = progress::bar(5 * args.seeds, "experiments");
            let rows = all_dofs(args.seeds, &|| bar.inc(1)).map_err(CliError::run)?;
            bar.finish_and_clear();
            print(args.json, "all_dofs", &rows, || print_all_dofs(&rows));
        }
    }
    Ok(Outcome::Done)
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
            "  {name:9} rms {:.5}  reported sd {:.5}",
            found.rms[i],
            found.reported_sd[i]
        );
    }
    outln!(
        "  largest error {:.1} of its sd; {:.1} % inside the 95 % region",
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
