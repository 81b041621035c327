//! Inputs that may never end: a pipe, a terminal, a device. They are named at once, and standard input is read as `-`.

use crate::support::hydroline;
use std::ffi::CString;
use std::io::Write;
use std::os::unix::ffi::OsStrExt;
use std::path::Path;
use std::process::{Command, Output, Stdio};

/// Longest that an answer may take \[s\]: what waits for a pipe waits for ever.
const PATIENCE_S: &str = "10";

/// Runs the binary on a table given to its standard input; it is ended when it waits.
fn run(dir: &Path, words: &[&str], table: &str) -> Output {
    let mut child = Command::new("timeout")
        .arg(PATIENCE_S)
        .arg(hydroline().get_program())
        .args(words)
        .current_dir(dir)
        .env_remove("RUST_LOG")
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    child.stdin.take().unwrap().write_all(table.as_bytes()).ok();
    child.wait_with_output().unwrap()
}

fn said(output: &Output) -> String {
    format!(
        "{:?}\n{}{}",
        output.status.code(),
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    )
}

fn pipe(path: &Path) {
    let name = CString::new(path.as_os_str().as_bytes()).unwrap();
    // SAFETY: the name is a terminated string.
    assert_eq!(unsafe { libc::mkfifo(name.as_ptr(), 0o600) }, 0);
}

const MAP: &str =
    "[time]\ncolumn = \"t\"\nunit = \"s\"\n[motion.x_m]\ncolumn = \"x\"\nunit = \"m\"\n";

fn table() -> String {
    let row = |k: u32| format!("{},{}\n", f64::from(k) * 0.1, (f64::from(k) * 0.1).sin());
    "t,x\n".to_owned() + &(0..100).map(row).collect::<String>()
}

#[test]
fn a_pipe_or_a_device_as_an_input_is_said_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    std::fs::write(dir.join("m.toml"), MAP).unwrap();
    std::fs::write(dir.join("t.csv"), table()).unwrap();
    for name in [
        "p.mcap", "p.csv", "p.toml", "p.png", "p.bin", "p.ulg", "p.db3",
    ] {
        pipe(&dir.join(name));
    }
    for (words, what) in [
        ("info p.mcap", "a pipe"),
        ("info p.ulg", "a pipe"),
        ("info /dev/zero", "a device"),
        ("doctor p.mcap", "a pipe"),
        ("doctor /dev/tty", "a device"),
        ("recover p.mcap --out new.mcap", "a pipe"),
        ("replay p.mcap --out new.mcap", "a pipe"),
        ("export p.mcap", "a pipe"),
        ("identify p.mcap --rig lshpi", "a pipe"),
        ("diagnose p.mcap --rig lshpi", "a pipe"),
        ("join p.mcap p.mcap --out new.mcap", "a pipe"),
        (
            "calibrate p.mcap --board dots-50 --rig lshpi --out c.toml",
            "a pipe",
        ),
        (
            "calibrate p.png --board dots-50 --rig lshpi --out c.toml",
            "a pipe",
        ),
        ("extract p.png", "a pipe"),
        ("import p.csv --map m.toml --out new.mcap", "a pipe"),
        ("import p.bin --map m.toml --out new.mcap", "a pipe"),
        ("import p.db3 --map m.toml --out new.mcap", "a pipe"),
        ("import t.csv --map p.toml --out new.mcap", "a pipe"),
        ("import /dev/zero --map m.toml --out new.mcap", "a device"),
        ("import --guess p.csv", "a pipe"),
        ("import --guess /dev/random", "a device"),
        ("rig show ./p.toml", "a pipe"),
        (
            "simulate --rig ./p.toml --plan still --out new.mcap",
            "a pipe",
        ),
    ] {
        let words: Vec<&str> = words.split(' ').collect();
        let output = run(dir, &words, "");
        assert_eq!(
            output.status.code(),
            Some(2),
            "{words:?}: {}",
            said(&output)
        );
        assert!(said(&output).contains(what), "{words:?}: {}", said(&output));
        assert!(!dir.join("new.mcap").exists(), "{words:?}");
    }
}

#[test]
fn a_pipe_inside_a_folder_is_said_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    std::fs::create_dir_all(dir.join("logs/bag")).unwrap();
    std::fs::create_dir(dir.join("frames")).unwrap();
    let simulate = "simulate --motion-only --rig lshpi --plan surge-4n --out logs/a.mcap";
    let made = run(dir, &simulate.split(' ').collect::<Vec<_>>(), "");
    assert!(made.status.success(), "{}", said(&made));
    for name in ["logs/b.mcap", "logs/bag/bag_0.db3", "frames/frame_1.png"] {
        pipe(&dir.join(name));
    }
    std::fs::write(dir.join("m.toml"), MAP).unwrap();
    for (words, code, named) in [
        ("info logs", 3, "b.mcap"),
        ("doctor logs", 3, "b.mcap"),
        ("export logs --tables-only --out tables", 3, "b.mcap"),
        (
            "import logs/bag --map m.toml --out new.mcap",
            2,
            "bag_0.db3",
        ),
        (
            "replay frames --rate-hz 25 --rig lshpi --out new.mcap",
            2,
            "frame_1.png",
        ),
        ("extract frames", 2, "frame_1.png"),
    ] {
        let words: Vec<&str> = words.split(' ').collect();
        let output = run(dir, &words, "");
        assert_eq!(
            output.status.code(),
            Some(code),
            "{words:?}: {}",
            said(&output)
        );
        let all = said(&output);
        assert!(
            all.contains(named) && all.contains("a pipe"),
            "{words:?}: {all}"
        );
    }
}

#[test]
fn standard_input_is_read_where_a_stream_can_be_read() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    std::fs::write(dir.join("m.toml"), MAP).unwrap();
    std::fs::write(dir.join("t.csv"), table()).unwrap();
    for (words, input) in [
        ("import - --map m.toml --out a.mcap", table()),
        ("import t.csv --map - --out b.mcap", MAP.to_owned()),
        ("import --guess -", table()),
    ] {
        let words: Vec<&str> = words.split(' ').collect();
        let output = run(dir, &words, &input);
        assert_eq!(
            output.status.code(),
            Some(0),
            "{words:?}: {}",
            said(&output)
        );
    }
    let (a, b) = (dir.join("a.mcap"), dir.join("b.mcap"));
    assert_eq!(std::fs::read(a).unwrap(), std::fs::read(b).unwrap());

    // A log is read more than once; and there is one standard input.
    for (words, what) in [
        ("info -", "more than once"),
        ("import - --map - --out c.mcap", "read before"),
    ] {
        let words: Vec<&str> = words.split(' ').collect();
        let output = run(dir, &words, MAP);
        assert_eq!(
            output.status.code(),
            Some(2),
            "{words:?}: {}",
            said(&output)
        );
        assert!(said(&output).contains(what), "{words:?}: {}", said(&output));
    }
    // What a shell hands over with <(..) is a stream, too.
    let binary = hydroline().get_program().to_owned();
    let output = Command::new("bash")
        .args([
            "-c",
            "exec timeout 10 \"$0\" import <(cat t.csv) --map <(cat m.toml) --out d.mcap",
        ])
        .arg(binary)
        .current_dir(dir)
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
    let (a, d) = (dir.join("a.mcap"), dir.join("d.mcap"));
    assert_eq!(std::fs::read(a).unwrap(), std::fs::read(d).unwrap());
}
