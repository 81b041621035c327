//! One line for each table: what a reader of `reproduce all` looks at first.

use hydroline_reproduce::{
    CalibrationStudy, Disturbed, DofRow, JointAccuracy, Row, SurgeRun, Table10Row, Table11Row,
};

fn three(values: [f64; 3]) -> String {
    values.map(|v| format!("{v:.3}")).join(" / ")
}

pub fn table3(rows: &[Row]) -> String {
    let largest = |r: &Row| r.ours[0].abs().max(r.ours[1].abs());
    let words: Vec<String> = rows
        .iter()
        .map(|r| {
            let name = format!("{:?}", r.motion).to_lowercase();
            format!("{name} {:.4} {}", largest(r), r.unit)
        })
        .collect();
    format!("ours at most: {}", words.join(", "))
}

pub fn disturbed(cells: &[Disturbed]) -> String {
    let lost: usize = cells.iter().map(|c| c.missing).sum();
    let printed = cells.iter().filter(|c| c.paper.is_some()).count();
    format!(
        "{} entries, {printed} of them printed in the paper; {lost} frames without an answer",
        cells.len()
    )
}

pub fn table7(runs: &[SurgeRun]) -> String {
    let most = |f: &dyn Fn(&SurgeRun) -> f64| runs.iter().map(f).fold(0.0, f64::max);
    format!(
        "greatest error: formula {:.1} mm, joint pose {:.2}, smoothed {:.2} (paper {:.1})",
        most(&|r| r.formula_max_mm),
        most(&|r| r.joint_mm[1]),
        most(&|r| r.smoothed_mm[1]),
        most(&|r| r.paper_max_mm)
    )
}

pub fn table10(rows: &[Table10Row]) -> String {
    let words: Vec<String> = rows
        .iter()
        .filter(|r| r.estimator == "joint")
        .map(|r| format!("{} {} %", r.condition, three(r.rms_percent)))
        .collect();
    format!(
        "joint pose, rms of X_udot / X_u / X_u|u|: {}",
        words.join(", ")
    )
}

pub fn table11(rows: &[Table11Row]) -> String {
    let furthest = rows
        .iter()
        .flat_map(|r| r.error_mm.iter().zip(r.printed_mm))
        .map(|(ours, printed)| (ours - printed).abs())
        .fold(0.0, f64::max);
    format!("at most {furthest:.2} mm from what the paper prints (asked 0.1)")
}

pub fn all_dofs(rows: &[DofRow]) -> String {
    let words: Vec<String> = rows
        .iter()
        .filter(|r| r.estimator == "joint")
        .map(|r| format!("{} {} %", r.dof, three(r.rms_percent)))
        .collect();
    format!("joint pose, rms: {}", words.join(", "))
}

pub fn calibration(study: &CalibrationStudy) -> String {
    let words: Vec<String> = study
        .rows
        .iter()
        .filter(|r| r.method == "homography")
        .map(|r| format!("{} {:.3} mm", r.case, r.max_mm))
        .collect();
    format!("homography at most: {}", words.join(", "))
}

pub fn joint(found: &JointAccuracy) -> String {
    let rms = found.rms.map(|v| format!("{v:.4}")).join(" / ");
    format!(
        "rms {rms} (mm, deg), {:.1} % inside the 95 % region",
        100.0 * found.covered_95
    )
}
