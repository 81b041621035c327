//! A controller that says that it puts out something else than it was commanded.

use super::{bounded, path, words};
use hydroline::thruster::controller::{ControllerConfig, Faults, PtyController, SimController};
use hydroline_rigs::Rig;

/// 8. Asked 1548 us, echoed another pulse to the end of the plan: "finished as planned".
#[test]
fn a_controller_that_contradicts() {
    let _alone = crate::support::alone();
    let dir = tempfile::tempdir().unwrap();
    let rig = Rig::builtin("lshpi").unwrap();
    let controller = SimController::new(ControllerConfig::for_rig(&rig.thrusters));
    let pty = PtyController::start(controller, None, Box::new(|_| {})).unwrap();
    pty.set_faults(Faults {
        stuck: true,
        ..Faults::default()
    });
    let port = format!(
        "port = \"{}\"\nallow_unstable_node = true",
        pty.path().unwrap().display()
    );
    let text = rig.effective_toml.replace("port = \"sim\"", &port);
    assert_ne!(text, rig.effective_toml);
    let (rig, plan, log) = (
        path(dir.path(), "rig.toml"),
        path(dir.path(), "plan.toml"),
        path(dir.path(), "run.mcap"),
    );
    std::fs::write(&rig, text).unwrap();
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
