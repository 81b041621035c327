//! A controller that says that it puts out something else than it was commanded.

use super::{bounded, path, words};
use hydroline::thruster::controller::{ControllerConfig, Faults, PtyController, SimController};
use hydroline_rigs::Rig;

/// A simulated controller of the built-in rig with these faults, and a rig file that names its line.
fn controlled(dir: &std::path::Path, faults: Faults) -> (PtyController, String) {
    let rig = Rig::builtin("lshpi").unwrap();
    let controller = SimController::new(ControllerConfig::for_rig(&rig.thrusters));
    let pty = PtyController::start(controller, None, Box::new(|_| {})).unwrap();
    pty.set_faults(faults);
    let port = format!(
        "port = \"{}\"\nallow_unstable_node = true",
        pty.path().unwrap().display()
    );
    let text = rig.effective_toml.replace("port = \"sim\"", &port);
    assert_ne!(text, rig.effective_toml);
    let file = path(dir, "rig.toml");
    std::fs::write(&file, text).unwrap();
    (pty, file)
}

/// Neutral that no answer confirmed at the end: "finished as planned", exit code 0, and the next run began.
#[test]
fn a_run_whose_neutral_nobody_confirms_is_the_last() {
    let _alone = crate::support::alone();
    let dir = tempfile::tempdir().unwrap();
    let faults = Faults {
        without_channels: true,
        ..Faults::default()
    };
    let (_pty, rig) = controlled(dir.path(), faults);
    let log = path(dir.path(), "run.mcap");
    let output = bounded(&[
        "record", "--rig", &rig, "--for", "500ms", "--runs", "2", "--out", &log,
    ]);
    let said = words(&output);
    assert_eq!(output.status.code(), Some(3), "{said}");
    assert!(said.contains("has not confirmed neutral"), "{said}");
    assert!(dir.path().join("run-1.mcap").exists(), "{said}");
    assert!(!dir.path().join("run-2.mcap").exists(), "{said}");
}

/// "Output fault" in every answer, and the plan went on to its end with exit code 0.
#[test]
fn a_controller_that_goes_on_reporting_faults() {
    let _alone = crate::support::alone();
    let dir = tempfile::tempdir().unwrap();
    let faults = Faults {
        errors: 1 << 7,
        ..Faults::default()
    };
    let (_pty, rig) = controlled(dir.path(), faults);
    let (plan, log) = (path(dir.path(), "plan.toml"), path(dir.path(), "run.mcap"));
    let ahead = "name = \"ahead\"\n[[step]]\nfor_s = 1.0\nwrench = { surge_n = 4.0 }\n";
    std::fs::write(&plan, ahead).unwrap();
    let output = bounded(&["record", "--rig", &rig, "--plan", &plan, "--out", &log]);
    let said = words(&output);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(
        said.contains("output fault") && said.contains("aborted to neutral: fault"),
        "{said}"
    );
}

/// 8. Asked 1548 us, echoed another pulse to the end of the plan: "finished as planned".
#[test]
fn a_controller_that_contradicts() {
    let _alone = crate::support::alone();
    let dir = tempfile::tempdir().unwrap();
    let faults = Faults {
        stuck: true,
        ..Faults::default()
    };
    let (pty, rig) = controlled(dir.path(), faults);
    let (plan, log) = (path(dir.path(), "plan.toml"), path(dir.path(), "run.mcap"));
    let ahead = "name = \"ahead\"\n[[step]]\nfor_s = 3.0\nwrench = { surge_n = 4.0 }\n";
    std::fs::write(&plan, ahead).unwrap();
    let output = bounded(&["record", "--rig", &rig, "--plan", &plan, "--out", &log]);
    let said = words(&output);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("contradicted"), "{said}");
    let output = bounded(&["doctor", &log]);
    assert_eq!(output.status.code(), Some(3), "{}", words(&output));
    // A controller at rest that answers is what `check` wants to see.
    pty.set_faults(Faults::default());
    let output = bounded(&["check", "--rig", &rig]);
    assert!(words(&output).contains("answers; "), "{}", words(&output));
}
