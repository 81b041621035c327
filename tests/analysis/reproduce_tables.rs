//! The paper's Table 10 and its likes in the other five DOFs, through rendered frames, against the limits that
//! are asked of them. One experiment of the shortest kinds always runs; forty and twenty of each with --ignored.
#![allow(clippy::unwrap_used)]

use hydroline::reproduce::{DofRow, Table10Row, all_dofs, dofs, table3, table10, table10_under};
use hydroline_rigs::Dof;
use statrs::distribution::{ChiSquared, ContinuousCDF, Normal};

/// Asked rms errors of X_udot, X_u, X_u|u| \[%\]: undisturbed by the paper's estimator and by joint pose, disturbed by
/// joint pose.
const PAPER: [f64; 3] = [0.1, 0.5, 0.5];
const JOINT: [f64; 3] = [0.05, 0.15, 0.2];
const JOINT_DISTURBED: [f64; 3] = [0.15, 0.6, 0.7];
/// Asked of 5 m predictions at 4, 8 and 16 N \[mm\].
const PREDICTION_MM: f64 = 6.0;
/// Asked of every coefficient of the other DOFs \[%\].
const OTHERS: f64 = 0.5;

/// Of Table 10, per condition: the rms of so many scatters by a ninth about what it stands for.
const EXPERIMENTS: u64 = 40;
/// Probability that the largest error of a test is beyond its limit where every reported sd is right.
const FALSE_ALARM: f64 = 0.02;

/// The largest of `errors` independent normal errors, in sds: what it exceeds with the chance of a false alarm.
fn largest_of(errors: usize) -> f64 {
    let each = 1.0 - (1.0 - FALSE_ALARM).powf(1.0 / errors as f64);
    -Normal::standard().inverse_cdf(0.5 * each)
}

/// The largest of `parameters` rms errors in their sd, each over so many experiments, by the same chance.
fn rms_of(experiments: u64, parameters: usize) -> f64 {
    let each = 1.0 - (1.0 - FALSE_ALARM).powf(1.0 / parameters as f64);
    let n = experiments as f64;
    (ChiSquared::new(n).unwrap().inverse_cdf(1.0 - each) / n).sqrt()
}

fn by<'r>(rows: &'r [Table10Row], condition: &str, estimator: &str) -> &'r Table10Row {
    rows.iter()
        .find(|r| r.condition == condition && r.estimator == estimator)
        .unwrap()
}

#[test]
fn thinned_animations_keep_the_frame_they_are_measured_from() {
    for row in table3(60).unwrap() {
        let largest = row.ours[0].abs().max(row.ours[1].abs());
        assert!(row.frames >= 4 && largest < 0.1, "{row:?}");
    }
}

#[test]
fn one_undisturbed_surge_experiment_stays_within_its_sd() {
    let rows = table10_under(&[0], 1, &|| ()).unwrap();
    assert_eq!(rows.len(), 2);
    for (estimator, asked) in [("paper", PAPER), ("joint", JOINT)] {
        let row = by(&rows, "surge only", estimator);
        println!(
            "{estimator}: error {:?} %, sd {:?}",
            row.rms_percent, row.sd_percent
        );
        for (k, asked) in asked.into_iter().enumerate() {
            // One draw of an error whose rms is asked: 3.5 of them, and of its sd where that is the measurement's
            // noise (the formulas' own bias is none).
            assert!(row.rms_percent[k] < 3.5 * asked, "{estimator} {k}: {row:?}");
            if estimator == "joint" {
                assert!(row.worst_in_sd[k] < 3.5, "{estimator} {k}: {row:?}");
            }
        }
        assert_eq!(row.lost, 0.0);
    }
}

#[test]
#[ignore = "11 s of processor time: tests/nightly reproduce; every day the surge experiment"]
fn one_yaw_experiment_stays_within_its_sd() {
    let rows = dofs(&[Dof::Yaw], 1, &|| ()).unwrap();
    let joint = rows.iter().find(|r| r.estimator == "joint").unwrap();
    println!("{joint:?}");
    for k in 0..3 {
        assert!(
            joint.rms_percent[k] < OTHERS && joint.worst_in_sd[k] < 3.5,
            "{k}: {joint:?}"
        );
    }
    assert_eq!(joint.lost, 0.0);
}

#[test]
#[ignore = "120 experiments of 650 frames: half an hour of one core; run with --release and --ignored"]
fn forty_experiments_of_table_10_reach_what_is_asked() {
    let rows = table10(EXPERIMENTS, &|| ()).unwrap();
    let conditions = ["surge only", "with pitch", "with pitch and yaw"];
    let errors = conditions.len() * 3 * EXPERIMENTS as usize;
    let largest = largest_of(errors);
    println!("the largest of {errors} errors may be {largest:.2} sd");
    let mut missed = Vec::new();
    let mut check = |row: &Table10Row, what: &str, value: f64, asked: f64| {
        println!(
            "{} | {}: {what} {value:.4}, asked {asked}",
            row.condition, row.estimator
        );
        if value.is_nan() || value > asked {
            missed.push(format!(
                "{} | {}: {what} {value:.4} > {asked}",
                row.condition, row.estimator
            ));
        }
    };
    let names = ["X_udot", "X_u", "X_u|u|"];
    let paper = by(&rows, "surge only", "paper");
    for (k, asked) in PAPER.into_iter().enumerate() {
        check(paper, names[k], paper.rms_percent[k], asked);
    }
    for condition in conditions {
        let joint = by(&rows, condition, "joint");
        let asked = match condition {
            "surge only" => JOINT,
            _ => JOINT_DISTURBED,
        };
        for (k, asked) in asked.into_iter().enumerate() {
            check(joint, names[k], joint.rms_percent[k], asked);
        }
        // Each error within 3 of its sd is asked. What is asked of every single one cannot be held against the largest of
        // 360: where every sd is right it still exceeds 3 in 62 of 100 such sets. So a parameter's rms error is held to
        // its sd as near as so many experiments tell (far within 3), and the largest to what the largest may be.
        for (k, name) in names.iter().enumerate() {
            check(
                joint,
                &format!("{name} rms error in its sd"),
                joint.rms_percent[k] / joint.sd_percent[k],
                rms_of(EXPERIMENTS, conditions.len() * 3),
            );
            check(
                joint,
                &format!("{name} largest error in its sd"),
                joint.worst_in_sd[k],
                largest,
            );
        }
        if condition != "surge only" {
            for mm in joint.prediction_worst_mm {
                check(joint, "5 m prediction, worst [mm]", mm, PREDICTION_MM);
            }
            // The paper's estimator is off by percents, as in the paper.
            let paper = by(&rows, condition, "paper");
            for k in 0..3 {
                assert!(
                    paper.rms_percent[k] > 10.0 * joint.rms_percent[k]
                        && paper.rms_percent[k] > 1.0,
                    "{paper:?}"
                );
            }
        }
    }
    assert!(missed.is_empty(), "{missed:#?}");
}

#[test]
#[ignore = "100 experiments of some 1200 frames: half an hour of one core and more; run with --release and --ignored"]
fn twenty_experiments_of_the_other_dofs_reach_half_a_percent() {
    let rows = all_dofs(20, &|| ()).unwrap();
    let joint: Vec<&DofRow> = rows.iter().filter(|r| r.estimator == "joint").collect();
    assert_eq!(joint.len(), 5);
    let largest = largest_of(joint.len() * 3 * 20);
    for row in joint {
        println!(
            "{}: rms {:?} %, largest in sd {:?}",
            row.dof, row.rms_percent, row.worst_in_sd
        );
        for k in 0..3 {
            assert!(row.rms_percent[k] <= OTHERS, "{row:?}");
            assert!(row.rms_percent[k] <= 3.0 * row.sd_percent[k], "{row:?}");
            assert!(row.worst_in_sd[k] <= largest, "{row:?}");
        }
    }
}
