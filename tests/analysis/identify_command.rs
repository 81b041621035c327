//! `identify` as people start it: simulated motion, a run at rest, a bollard pull, the rig it writes.
#![allow(clippy::unwrap_used)]

use crate::support::hydroline;
use hydroline_rigs::Rig;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Output;

fn simulated(dir: &Path, rig: &str, plan: &str, seed: u32) -> PathBuf {
    let log = dir.join(format!("{plan}-{seed}.mcap"));
    let status = hydroline()
        .args(["simulate", "--motion-only", "--rig", rig, "--plan", plan])
        .args(["--seed", &seed.to_string(), "--out"])
        .arg(&log)
        .status()
        .unwrap();
    assert!(status.success());
    log
}

fn identify(logs: &[&PathBuf], more: &[&str]) -> Output {
    hydroline()
        .arg("identify")
        .args(logs)
        .args(["--model", "surge", "--from-rest"])
        .args(more)
        .output()
        .unwrap()
}

fn json(output: &Output) -> Value {
    let words = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{words}");
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn a_run_at_rest_given_as_still_is_the_noise_of_the_fit() {
    let dir = tempfile::tempdir().unwrap();
    let slow = simulated(dir.path(), "lshpi", "surge-4n", 7);
    let fast = simulated(dir.path(), "lshpi", "surge-8n", 8);
    let still = simulated(dir.path(), "lshpi", "still", 9);
    let still = still.to_str().unwrap();
    let logs = [&slow, &fast];
    let found = json(&identify(
        &logs,
        &["--rig", "lshpi", "--still", still, "--json"],
    ));
    let noise = &found["noise"]["x_m"];
    assert_eq!(noise["source"], "measured at rest");
    // Simulated with 0.15 mm; 20 s at 25 Hz give it to 3 %.
    let sd_m = noise["white_sd"].as_f64().unwrap();
    assert!((sd_m / 1.5e-4 - 1.0).abs() < 0.12, "{sd_m}");
    let without = json(&identify(&logs, &["--rig", "lshpi", "--json"]));
    assert_eq!(without["noise"]["x_m"]["source"], "residuals");
    for key in ["x_udot", "x_u", "x_uu"] {
        let parameter = &found["parameters"][key];
        let [value, sd, truth] = ["value", "sd", "rig"].map(|k| parameter[k].as_f64().unwrap());
        assert!(
            (value - truth).abs() < 4.0 * sd,
            "{key}: {value} +- {sd}, {truth}"
        );
    }
    // A moving run is no run at rest.
    let refused = identify(
        &logs,
        &["--rig", "lshpi", "--still", fast.to_str().unwrap()],
    );
    assert!(!refused.status.success());
    let words = String::from_utf8_lossy(&refused.stderr);
    assert!(words.contains("surge-8n-8.mcap"), "{words}");
}

#[test]
fn a_log_given_twice_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let log = simulated(dir.path(), "lshpi", "surge-4n", 5);
    let copy = dir.path().join("copy.mcap");
    std::fs::copy(&log, &copy).unwrap();
    for twice in [[&log, &log], [&log, &copy]] {
        let refused = identify(&twice, &["--rig", "lshpi"]);
        assert!(!refused.status.success());
        let words = String::from_utf8_lossy(&refused.stderr);
        assert!(words.contains("same recording as"), "{words}");
    }
}

#[test]
fn a_report_of_no_log_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let table = dir.path().join("pull.csv");
    std::fs::write(&table, pull_table(&Rig::builtin("lshpi").unwrap())).unwrap();
    let refused = hydroline()
        .args(["identify", "--rig", "lshpi", "--bollard"])
        .arg(&table)
        .arg("--report")
        .arg(dir.path().join("out"))
        .output()
        .unwrap();
    assert!(!refused.status.success());
    assert!(String::from_utf8_lossy(&refused.stderr).contains("--report"));
}

/// Readings every 20 us with 0.1 N of scatter (a fixed pattern of zero mean) of a thruster 10 % weaker than the rig says.
fn pull_table(rig: &Rig) -> String {
    let curve = &rig.thrusters.thrusters[0].curve;
    let mut table = String::from("pulse_us,thrust_n\n");
    for k in 0..=40_i32 {
        let pulse_us = 1100.0 + 20.0 * f64::from(k);
        let scatter_n = 0.1 * f64::from((k * 7) % 5 - 2);
        let thrust_n = 0.9 * curve.thrust_n(pulse_us) + scatter_n;
        table += &format!("{pulse_us},{thrust_n:.3}\n");
    }
    table
}

#[test]
fn a_bollard_pull_goes_into_a_rig_and_cures_the_thrust_scale() {
    let dir = tempfile::tempdir().unwrap();
    let rig = Rig::builtin("lshpi").unwrap();
    let table = dir.path().join("pull.csv");
    std::fs::write(&table, pull_table(&rig)).unwrap();
    let written = dir.path().join("measured.toml");
    let status = hydroline()
        .args(["identify", "--rig", "lshpi", "--bollard"])
        .arg(&table)
        .arg("--write-rig")
        .arg(&written)
        .status()
        .unwrap();
    assert!(status.success());
    let measured = Rig::load(&written).unwrap();
    let at = |rig: &Rig| rig.thrusters.thrusters[0].curve.thrust_n(1850.0);
    let ratio = at(&measured) / at(&rig);
    assert!((ratio - 0.9).abs() < 0.02, "{ratio}");

    // One run may leave a random force open, by its own noise, and an interval many times as wide; two do not.
    let logs = [3, 4].map(|seed| simulated(dir.path(), "lshpi", "surge-8n", seed));
    let with = |rig: &str| json(&identify(&logs.each_ref(), &["--rig", rig, "--json"]));
    let (plain, cured) = (with("lshpi"), with(written.to_str().unwrap()));
    let blind = |found: &Value| found["blind_spots"].to_string().contains("thrust_scale");
    assert!(blind(&plain) && !blind(&cured));
    // A tenth less thrust for the same motion: a tenth less mass and drag, and the curve's own uncertainty in the budget.
    let number = |found: &Value, what: &str| found["parameters"]["x_uu"][what].as_f64().unwrap();
    // One line instead of the other, and nothing of it in the scatter of the samples.
    let line = |found: &Value, source: &str| -> Option<f64> {
        let lines = found["budget"].as_array().unwrap();
        let line = lines.iter().find(|l| l["source"] == source)?;
        line["contributions"]["x_uu"].as_f64()
    };
    let (scale, curve) = ("thrust scale", "thrust curve");
    assert!(line(&plain, scale).is_some() && line(&plain, curve).is_none());
    assert!(line(&cured, scale).is_none());
    let by_curve = line(&cured, curve).unwrap();
    let same = number(&cured, "sd") / (0.9 * number(&plain, "sd"));
    assert!((0.8..1.25).contains(&same), "{same}");
    // The readings' scatter of 0.14 N at the 2.8 N of a thruster leaves some percents, and the budget says so.
    let (wanted, value) = (0.9 * number(&plain, "value"), number(&cured, "value"));
    let sd = by_curve.hypot(number(&cured, "sd"));
    assert!(
        (value - wanted).abs() < 3.0 * sd,
        "{value} +- {sd}, {wanted}"
    );
    assert!(by_curve > 0.0 && sd < 0.1 * wanted.abs(), "{by_curve} {sd}");
    assert!(number(&cured, "combined_sd") >= sd * (1.0 - 1e-9));

    // Never over a file that is there.
    let again = hydroline()
        .args(["identify", "--rig", "lshpi", "--bollard"])
        .arg(&table)
        .arg("--write-rig")
        .arg(&written)
        .output()
        .unwrap();
    assert!(!again.status.success());
    assert!(String::from_utf8_lossy(&again.stderr).contains("measured.toml"));
}

/// lshpi that knows its surge drag to 1 %.
fn rig_that_was_identified(path: &Path) -> Rig {
    let mut rig = Rig::builtin("lshpi").unwrap();
    let value = rig.vehicle.coefficients[0].quadratic;
    let sd = 0.01 * value.abs();
    rig.identified = Some(hydroline_rigs::Identified {
        coefficients: vec!["x_uu".into()],
        values: vec![value],
        sd: vec![sd],
        covariance: vec![vec![sd * sd]],
        source: None,
    });
    std::fs::write(path, rig.to_toml()).unwrap();
    rig
}

#[test]
fn a_new_thrust_curve_ends_what_was_identified_with_the_old_one() {
    let dir = tempfile::tempdir().unwrap();
    let from = dir.path().join("known.toml");
    let rig = rig_that_was_identified(&from);
    let table = dir.path().join("pull.csv");
    std::fs::write(&table, pull_table(&rig)).unwrap();
    let written = dir.path().join("measured.toml");
    let output = hydroline()
        .args(["identify", "--bollard"])
        .arg(&table)
        .arg("--rig")
        .arg(&from)
        .arg("--write-rig")
        .arg(&written)
        .output()
        .unwrap();
    let words = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{words}");
    assert!(words.contains("note: x_uu: identified with"), "{words}");
    let measured = Rig::load(&written).unwrap();
    assert!(measured.bollard.is_some() && measured.identified.is_none());
    assert_eq!(
        measured.vehicle.coefficients[0],
        rig.vehicle.coefficients[0]
    );

    // Logs beside it that determine the coefficient: known anew, nothing to note.
    let log = simulated(dir.path(), "lshpi", "surge-8n", 3);
    let both = dir.path().join("both.toml");
    let output = identify(
        &[&log],
        &[
            "--rig",
            from.to_str().unwrap(),
            "--bollard",
            table.to_str().unwrap(),
            "--write-rig",
            both.to_str().unwrap(),
        ],
    );
    let words = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{words}");
    assert!(!words.contains("x_uu: identified with"), "{words}");
    let known = Rig::load(&both).unwrap().identified.unwrap();
    assert!(known.coefficients.contains(&"x_uu".to_owned()), "{known:?}");
}

#[test]
fn what_was_found_is_not_lost_with_what_fails_after_it() {
    let dir = tempfile::tempdir().unwrap();
    let log = simulated(dir.path(), "lshpi", "surge-8n", 3);
    // Names that no file system takes: both fail, and not before they are tried.
    let no_folder = dir.path().join("y".repeat(300));
    let too_long = dir.path().join("x".repeat(300));
    let output = identify(
        &[&log],
        &[
            "--rig",
            "lshpi",
            "--json",
            "--report",
            no_folder.to_str().unwrap(),
            "--write-rig",
            too_long.to_str().unwrap(),
        ],
    );
    let words = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{words}");
    for word in ["xxx", "identify.html"] {
        assert!(words.contains(word), "no {word} in {words}");
    }
    let found: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(found["parameters"]["x_u"]["value"].is_number());

    // A report that fails takes neither the result nor the rig with it.
    let written = dir.path().join("fitted.toml");
    let output = identify(
        &[&log],
        &[
            "--rig",
            "lshpi",
            "--json",
            "--report",
            no_folder.to_str().unwrap(),
            "--write-rig",
            written.to_str().unwrap(),
        ],
    );
    assert_eq!(output.status.code(), Some(1));
    let found: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(found["parameters"]["x_u"]["value"].is_number());
    assert!(Rig::load(&written).unwrap().identified.is_some());

    // A log that is damaged leaves the curve of the pull; one that is none is typed again, with nothing in the way.
    let table = dir.path().join("pull.csv");
    std::fs::write(&table, pull_table(&Rig::builtin("lshpi").unwrap())).unwrap();
    let broken = dir.path().join("broken.mcap");
    let bytes = std::fs::read(&log).unwrap();
    let curve = dir.path().join("curve.toml");
    for (content, code) in [(&b"no log"[..], 2), (&bytes[..bytes.len() / 2], 1)] {
        std::fs::write(&broken, content).unwrap();
        let output = identify(
            &[&broken],
            &[
                "--rig",
                "lshpi",
                "--bollard",
                table.to_str().unwrap(),
                "--write-rig",
                curve.to_str().unwrap(),
            ],
        );
        let words = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{words}");
        assert!(words.contains("broken.mcap"), "{words}");
        assert_eq!(words.contains("bollard pull only"), code == 1, "{words}");
        assert_eq!(curve.exists(), code == 1);
    }
    assert!(Rig::load(&curve).unwrap().bollard.is_some());
}

#[test]
fn a_script_can_stop_at_a_misfit() {
    let dir = tempfile::tempdir().unwrap();
    // The vehicle's thrusters lag, and the rig that it is identified with does not know.
    let lagging = dir.path().join("lagging.toml");
    let rig = Rig::builtin("lshpi").unwrap().effective_toml;
    let lag = "\n[[physics]]\neffect = \"thruster_lag\"\nlag_s = 0.25\n";
    std::fs::write(&lagging, rig + lag).unwrap();
    let wrong = simulated(dir.path(), lagging.to_str().unwrap(), "reversals", 4);
    let right = simulated(dir.path(), "lshpi", "reversals", 5);
    let report = dir.path().join("report");
    let report = report.to_str().unwrap();
    let at_misfit = |log, more: &[&str]| {
        let output = identify(&[log], &[&["--rig", "lshpi", "--json"], more].concat());
        let words = String::from_utf8_lossy(&output.stderr).into_owned();
        let found: Value = serde_json::from_slice(&output.stdout).unwrap();
        let misfits = found["misfit"].as_array().unwrap().len();
        (output.status.code(), misfits, words)
    };
    let (code, misfits, words) = at_misfit(&right, &["--fail-on", "misfit"]);
    assert_eq!((code, misfits), (Some(0), 0), "{words}");
    let (code, misfits, words) = at_misfit(&wrong, &[]);
    assert_eq!(code, Some(0), "{words}");
    assert!(misfits > 0);
    // The result is printed and written all the same.
    let (code, misfits, words) = at_misfit(&wrong, &["--fail-on", "misfit", "--report", report]);
    assert_eq!(code, Some(1), "{words}");
    assert!(misfits > 0);
    for part in [
        "--fail-on misfit: The model does not explain",
        "hydroline diagnose",
    ] {
        assert!(words.contains(part), "no '{part}' in {words}");
    }
    assert!(std::path::Path::new(report).join("identify.html").is_file());
}

fn predicted(rig: &str, more: &[&str]) -> Vec<Vec<f64>> {
    let output = hydroline()
        .args(["predict", "--rig", rig, "--plan", "surge-8n", "--rate", "5"])
        .args(more)
        .output()
        .unwrap();
    let words = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{words}");
    let table = String::from_utf8(output.stdout).unwrap();
    let row = |line: &str| line.split(',').map(|v| v.parse().unwrap()).collect();
    table.lines().skip(1).map(row).collect()
}

#[test]
fn a_fit_goes_into_a_rig_with_its_sd_and_predict_uses_it() {
    let dir = tempfile::tempdir().unwrap();
    let log = simulated(dir.path(), "lshpi", "surge-8n", 3);
    // A rig that knows surge 20 % wrongly.
    let mut wrong = Rig::builtin("lshpi").unwrap();
    for value in [
        &mut wrong.vehicle.coefficients[0].added,
        &mut wrong.vehicle.coefficients[0].linear,
        &mut wrong.vehicle.coefficients[0].quadratic,
    ] {
        *value *= 1.2;
    }
    let from = dir.path().join("wrong.toml");
    std::fs::write(&from, wrong.to_toml()).unwrap();
    let written = dir.path().join("fitted.toml");
    let output = identify(
        &[&log],
        &[
            "--rig",
            from.to_str().unwrap(),
            "--json",
            "--write-rig",
            written.to_str().unwrap(),
        ],
    );
    let found = json(&output);
    let rig = Rig::load(&written).unwrap();
    let known = rig.identified.clone().unwrap();
    let surge = rig.vehicle.coefficients[0];
    for (key, value) in [
        ("x_udot", surge.added),
        ("x_u", surge.linear),
        ("x_uu", surge.quadratic),
    ] {
        let parameter = &found["parameters"][key];
        let i = known.coefficients.iter().position(|k| k == key).unwrap();
        assert_eq!(parameter["value"].as_f64(), Some(value), "{key}");
        assert_eq!(known.values[i], value);
        // The whole budget, not the samples alone.
        let [own, all] = ["sd", "combined_sd"].map(|k| parameter[k].as_f64().unwrap());
        assert!(all > own, "{key}: {all} {own}");
        assert!((known.sd[i] / all - 1.0).abs() < 1e-9, "{key}");
        assert!((known.covariance[i][i] - known.sd[i].powi(2)).abs() < 1e-9 * known.sd[i].powi(2));
    }
    // Coefficients that were not fitted stay.
    assert_eq!(
        rig.vehicle.coefficients[1..],
        wrong.vehicle.coefficients[1..]
    );

    // The rig alone predicts what the old rig predicts with the fit beside it, band and all.
    let fit = dir.path().join("fit.json");
    std::fs::write(&fit, &output.stdout).unwrap();
    let by_rig = predicted(written.to_str().unwrap(), &[]);
    let by_fit = predicted(
        from.to_str().unwrap(),
        &["--identified", fit.to_str().unwrap()],
    );
    let without = predicted(from.to_str().unwrap(), &[]);
    // Time, twelve channels, and their twelve sds where there is a band.
    assert_eq!((by_rig[0].len(), without[0].len()), (25, 13));
    for (a, b) in by_rig.iter().flatten().zip(by_fit.iter().flatten()) {
        assert!((a - b).abs() <= 1e-9 * (1e-6 + b.abs()), "{a} {b}");
    }
    let (last, off) = (by_rig.last().unwrap(), without.last().unwrap());
    // The band is of the whole budget, of which the thrust's 5 % are most.
    assert!(
        last[13] > 1e-3 * last[1].abs() && (last[1] - off[1]).abs() > last[13],
        "{last:?} {off:?}"
    );

    // A coefficient changed by hand is not the one whose covariance is known.
    let text = std::fs::read_to_string(&written).unwrap();
    let number = format!("{:?}", surge.linear);
    let changed = text.replacen(&number, "-33.0", 1);
    std::fs::write(&written, changed).unwrap();
    let refused = hydroline()
        .args(["predict", "--plan", "surge-8n", "--rig"])
        .arg(&written)
        .output()
        .unwrap();
    assert!(!refused.status.success());
    assert!(String::from_utf8_lossy(&refused.stderr).contains("x_u = "));
}

#[test]
fn what_the_runs_do_not_determine_is_not_written_into_a_rig() {
    let dir = tempfile::tempdir().unwrap();
    // So weak a push that the quadratic term cannot be found.
    let plan = dir.path().join("weak.toml");
    std::fs::write(
        &plan,
        "name = \"weak\"\n[[step]]\nfor_s = 12.0\nwrench = { surge_n = 0.3 }\n",
    )
    .unwrap();
    let log = dir.path().join("weak.mcap");
    let status = hydroline()
        .args([
            "simulate",
            "--motion-only",
            "--rig",
            "lshpi",
            "--seed",
            "3",
            "--plan",
        ])
        .arg(&plan)
        .arg("--out")
        .arg(&log)
        .status()
        .unwrap();
    assert!(status.success());
    let written = dir.path().join("fitted.toml");
    let output = identify(
        &[&log],
        &["--rig", "lshpi", "--write-rig", written.to_str().unwrap()],
    );
    let words = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{words}");
    assert!(
        words.contains("not written: x_uu: not determined"),
        "{words}"
    );
    let (rig, before) = (Rig::load(&written).unwrap(), Rig::builtin("lshpi").unwrap());
    assert_eq!(
        rig.vehicle.coefficients[0].quadratic,
        before.vehicle.coefficients[0].quadratic
    );
    // The rig's value, with all the uncertainty that the runs leave in it: predict makes its band of that too.
    let known = rig.identified.unwrap();
    let i = known.coefficients.iter().position(|k| k == "x_uu").unwrap();
    let value = before.vehicle.coefficients[0].quadratic;
    assert_eq!(known.values[i], value);
    assert!(known.sd[i] > 0.2 * value.abs(), "{known:?}");
}

#[test]
fn a_measured_run_stands_beside_its_prediction() {
    let dir = tempfile::tempdir().unwrap();
    let log = simulated(dir.path(), "lshpi", "surge-4n", 11);
    let predict = |plan: &str, more: &[&str]| {
        hydroline()
            .args(["predict", "--rig", "lshpi", "--plan", plan, "--measured"])
            .arg(&log)
            .args(more)
            .output()
            .unwrap()
    };
    let out = dir.path().join("out");
    let output = predict("surge-4n", &["--json", "--report", out.to_str().unwrap()]);
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    let found = json(&output);
    assert!(words.contains("x: rms residual 0.1"), "{words}");
    assert!(!words.contains("WARNING"), "{words}");
    let x = &found["measured"]["channels"][0];
    assert_eq!(x["channel"], "x_m");
    // Simulated by the rig itself with 0.15 mm: what is left is that, and the start's own share.
    let rms_m = x["rms"].as_f64().unwrap();
    assert!((1.2e-4..2.5e-4).contains(&rms_m), "{rms_m}");
    let page = std::fs::read_to_string(out.join("predict.html")).unwrap();
    assert!(page.contains("rms residual x 0.1") && page.contains("measured - predicted"));
    assert!(out.join("predict.svg").exists());
    // Another plan's loads are named.
    let other = predict("surge-8n", &[]);
    let words = String::from_utf8_lossy(&other.stderr);
    assert!(other.status.success(), "{words}");
    assert!(
        words.contains("WARNING") && words.contains("X is not the plan's in 100 %"),
        "{words}"
    );
}
