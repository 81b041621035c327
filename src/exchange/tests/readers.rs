//! Written files in their own readers: Python, CasADi, FMPy, NumPy, Octave, libsdformat. `tests/nightly exchange` installs them.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use hydroline_exchange::draws::{drawn, of_rig, table};
use hydroline_exchange::npz::npz;
use hydroline_exchange::target::{About, FMU_LIBRARY, Target, export};
use hydroline_identify::predict::predict;
use hydroline_plan::setpoint::setpoint;
use hydroline_rigs::{ParameterValue, PhysicsEntry, Plan, Rig};
use hydroline_sim::{Allocation, World};
use std::path::{Path, PathBuf};
use std::process::Command;

/// Relative distance at which nothing is lost.
const NOTHING_LOST: f64 = 1e-6;
const STEP_S: f64 = 0.02;

fn rig() -> Rig {
    let mut rig = Rig::builtin("lshpi").unwrap();
    let effect = |id: &str, name: &str, value: f64, dof: Option<&str>| {
        let mut parameters = vec![(name.to_owned(), ParameterValue::Number(value))];
        parameters.extend(dof.map(|d| ("dof".to_owned(), ParameterValue::Word(d.to_owned()))));
        PhysicsEntry {
            effect: id.to_owned(),
            parameters,
        }
    };
    rig.physics = vec![
        effect("thruster_lag", "lag_s", 0.3, Some("surge")),
        effect("thruster_deadband", "width_n", 0.4, Some("heave")),
        effect("thrust_asymmetry", "reverse_gain", 0.8, Some("yaw")),
        effect("coulomb_friction", "f_n", 0.2, Some("sway")),
        effect("current", "vx_mps", 0.02, None),
    ];
    rig
}

fn about(library: Option<&[u8]>) -> About<'_> {
    About {
        made_by: "a test",
        ranges: &[],
        function: "mss_model",
        library,
    }
}

fn write(folder: &Path, name: &str, target: Target, library: Option<&[u8]>) {
    let made = export(&rig(), target, &about(library)).unwrap();
    std::fs::write(folder.join(name), made.bytes).unwrap();
}

/// Simulator that a reader is held against: `predict` has the readers' own step, an FMU the step of the simulated tank.
#[derive(Clone, Copy, PartialEq)]
enum Beside {
    Predict,
    World,
}

/// A plan's thrusts on the grid, and our motion each 0.2 s, in the folder.
fn case(folder: &Path, plan: &str, beside: Beside) {
    let (rig, plan) = (rig(), Plan::builtin(plan).unwrap());
    let allocation = Allocation::new(&rig.thrusters).unwrap();
    let steps = (plan.duration_s() / STEP_S).round() as u64;
    let thrust_n: Vec<Vec<f64>> = (0..=steps)
        .map(|k| {
            setpoint(&rig, &allocation, &plan, 0.04 * (k / 2) as f64)
                .unwrap()
                .thrust_n
        })
        .collect();
    let motion: Vec<Vec<f64>> = match beside {
        Beside::Predict => {
            let motion = predict(&rig, &plan, None, 5.0, 0.0).unwrap().motion;
            motion.iter().map(|m| m.into_array().to_vec()).collect()
        }
        Beside::World => {
            let mut world = World::new(&rig, rig.tank.start_pose).unwrap();
            let mut rows = Vec::new();
            for (k, thrust) in thrust_n.iter().enumerate() {
                let t_s = STEP_S * k as f64;
                if k % 10 == 0 {
                    let state = world.state_at(t_s).unwrap();
                    rows.push(state.eta.iter().chain(&state.nu).copied().collect());
                }
                if k == 0 || *thrust != thrust_n[k - 1] {
                    world.command_thrusts(t_s, thrust).unwrap();
                }
            }
            rows
        }
    };
    let rows = |rows: &[Vec<f64>]| -> String {
        let line = |r: &Vec<f64>| r.iter().map(f64::to_string).collect::<Vec<_>>().join(",") + "\n";
        rows.iter().map(line).collect()
    };
    std::fs::write(folder.join("thrust.csv"), rows(&thrust_n)).unwrap();
    std::fs::write(folder.join("motion.csv"), rows(&motion)).unwrap();
    // MSS: rates, pose, own states.
    let mut start = vec![0.0; 6];
    start.extend(rig.tank.start_pose);
    start.push(0.0);
    std::fs::write(folder.join("start.csv"), rows(&[start])).unwrap();
    let case = serde_json::json!({ "step_s": STEP_S, "thrust_n": thrust_n, "motion": motion });
    std::fs::write(folder.join("case.json"), case.to_string()).unwrap();
}

fn said(command: &mut Command) -> String {
    let out = command
        .output()
        .unwrap_or_else(|e| panic!("{command:?}: {e}"));
    let words = String::from_utf8_lossy(&out.stdout).into_owned();
    assert!(
        out.status.success(),
        "{command:?}: {words}{}",
        String::from_utf8_lossy(&out.stderr)
    );
    words
}

fn script(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/readers")
        .join(name)
}

/// Python with numpy, casadi and fmpy.
fn python() -> Command {
    Command::new(std::env::var_os("HYDROLINE_EXCHANGE_PYTHON").unwrap_or("python3".into()))
}

fn distance(words: &str) -> f64 {
    words
        .lines()
        .rev()
        .find_map(|l| l.trim().parse().ok())
        .unwrap_or_else(|| panic!("{words}"))
}

fn each_plan(folder: &Path, beside: Beside, mut read: impl FnMut() -> String) {
    for plan in ["surge-8n", "reversals", "mixed-6dof"] {
        case(folder, plan, beside);
        let off = distance(&read());
        println!("{plan}: {off:.1e}");
        assert!(off < NOTHING_LOST, "{plan}: {off}");
    }
}

#[test]
#[ignore = "needs Python: tests/nightly exchange"]
fn python_moves_as_we_do() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), "model.py", Target::Python, None);
    each_plan(folder.path(), Beside::Predict, || {
        said(python().arg(script("python_module.py")).arg(folder.path()))
    });
}

#[test]
#[ignore = "needs CasADi: tests/nightly exchange"]
fn casadi_moves_as_we_do() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), "casadi_model.py", Target::Casadi, None);
    each_plan(folder.path(), Beside::Predict, || {
        said(python().arg(script("casadi_module.py")).arg(folder.path()))
    });
}

#[test]
#[ignore = "needs Octave: tests/nightly exchange"]
fn octave_moves_as_we_do() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), "mss_model.m", Target::Mss, None);
    each_plan(folder.path(), Beside::Predict, || {
        said(
            Command::new("octave-cli")
                .arg("--no-init-file")
                .arg(script("octave.m"))
                .arg(folder.path()),
        )
    });
}

#[test]
#[ignore = "needs FMPy and the library: tests/nightly exchange"]
fn fmpy_moves_as_we_do() {
    let folder = tempfile::tempdir().unwrap();
    let library = std::env::var_os("HYDROLINE_FMU_LIBRARY")
        .map(PathBuf::from)
        .unwrap_or_else(|| {
            let test = std::env::current_exe().unwrap();
            let name = format!(
                "{}{FMU_LIBRARY}{}",
                std::env::consts::DLL_PREFIX,
                std::env::consts::DLL_SUFFIX
            );
            test.parent().unwrap().join(name)
        });
    let bytes = std::fs::read(&library).unwrap_or_else(|e| panic!("{}: {e}", library.display()));
    write(folder.path(), "model.fmu", Target::Fmu, Some(&bytes));
    each_plan(folder.path(), Beside::World, || {
        said(python().arg(script("fmu.py")).arg(folder.path()))
    });
}

#[test]
#[ignore = "needs NumPy: tests/nightly exchange"]
fn numpy_reads_the_draws() {
    let folder = tempfile::tempdir().unwrap();
    let mut rig = rig();
    rig.identified = Some(hydroline_rigs::Identified {
        coefficients: vec!["x_u".into()],
        values: vec![-20.0],
        sd: vec![2.0],
        covariance: vec![vec![4.0]],
        source: None,
    });
    let models = of_rig(&rig).unwrap();
    let made = table(&models, &drawn(&models, 3, 1));
    std::fs::write(folder.path().join("draws.npz"), npz(&made).unwrap()).unwrap();
    let words = said(python().arg(script("draws.py")).arg(folder.path()));
    assert_eq!(
        words.trim(),
        format!("x_u (3, 1) [0, 0, 0] [{}]", made.rows[0][0])
    );
}

/// With Debian's libsdformat-dev.
#[test]
#[ignore = "needs libsdformat: tests/nightly exchange"]
fn libsdformat_reads_the_model() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), "model.sdf", Target::Sdf, None);
    let flags = said(Command::new("pkg-config").args(["--cflags", "--libs", "sdformat12"]));
    let program = folder.path().join("reader");
    said(
        Command::new("c++")
            .args(["-std=c++17", "-o"])
            .arg(&program)
            .arg(script("sdf.cc"))
            .args(flags.split_whitespace()),
    );
    let words = said(Command::new(&program).arg(folder.path().join("model.sdf")));
    let parts: Vec<&str> = words.split_whitespace().collect();
    assert_eq!(parts[..4], ["lshpi", "9", "8", "9"]);
    assert!(
        (parts[4].parse::<f64>().unwrap() - 29.777).abs() < 1e-9,
        "{words}"
    );
}
