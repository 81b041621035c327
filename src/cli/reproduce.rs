//! `hydroline reproduce`: the paper's tables, computed and printed beside its numbers.

use super::print::out;
use super::{CliError, Outcome};
use crate::reproduce::{
    CalibrationStudy, Disturbed, JointAccuracy, Row, disturbed, joint_accuracy, table3,
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
    /// Frames for all-dofs
    #[arg(long, default_value_t = 500, value_parser = clap::value_parser!(u32).range(1..100_000), value_name = "N")]
    frames: u32,
    /// Seed for all-dofs and calibration
    #[arg(long, default_value_t = 1)]
    seed: u64,
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
        What::AllDofs => {
            let found = joint_accuracy(args.frames as usize, args.seed).map_err(CliError::run)?;
            print(args.json, "all_dofs", &found, || print_joint(&found));
        }
    }
    Ok(Outcome::Done)
}

fn print(json: bool, name: &str, value: &impl serde::Serialize, words: impl FnOnce()) {
    if json {
        println!("{}", serde_json::json!({ name: value }))
    } else {
        words()
    }
}

fn print_table3(rows: &[Row]) {
    println!("Table 3: least and greatest error of each formula in its own motion");
    println!(
        "{:6} {:>4} {:>6}  {:>15}  {:>15}  {:>17}  {:>17}  no answer",
        "", "", "frames", "paper", "whole pixel", "formula, ours", "ours"
    );
    for r in rows {
        let span = |v: [f64; 2], digits: usize| format!("{:+.digits$} .. {:+.digits$}", v[0], v[1]);
        println!(
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
            println!(
                "       within 8 mm of a joint or widest point: {}",
                span(corner, 4)
            );
        }
    }
}

fn print_cells(cells: &[Disturbed]) {
    println!(
        "Largest change of a formula's result by another motion; entries the paper's text has lost are marked *"
    );
    for c in cells {
        let name = |m: crate::reproduce::Motion| format!("{m:?}").to_lowercase();
        let lost = if c.missing > 0 {
            format!("  ({} frames without an answer)", c.missing)
        } else {
            String::new()
        };
        println!(
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
    println!(
        "{} frames under all disturbances at once, {} without a pose",
        found.frames, found.failed
    );
    for (i, name) in ["x mm", "y mm", "z mm", "phi deg", "theta deg", "psi deg"]
        .iter()
        .enumerate()
    {
        println!(
            "  {name:9} rms {:.5}  reported sd {:.5}",
            found.rms[i], found.reported_sd[i]
        );
    }
    println!(
        "  largest error {:.1} of its sd; {:.1} % inside the 95 % region",
        found.worst_in_sd,
        100.0 * found.covered_95
    );
}
