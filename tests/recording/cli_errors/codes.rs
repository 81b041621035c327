//! Exit codes mean the same in every subcommand: each file it takes, missing, a folder, empty, of another kind, is a bad
//! argument (2) with words that name the file and the next step; what was lost is 3.

use crate::support::hydroline;
use hydroline::build_info::BuildInfo;
use hydroline::frame::{Frame, FrameMeta, LossBefore, PixelFormat, StampClock, StampSource};
use hydroline::log::{Entry, FileRecorder, Head, SummaryInput, WriteSettings};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Output;

/// Good inputs, and a place for results that must stay empty.
struct Bench {
    dir: tempfile::TempDir,
}

impl Bench {
    fn new() -> Self {
        let bench = Self {
            dir: tempfile::tempdir().unwrap(),
        };
        let simulated = run(&words(
            "simulate --rig lshpi --plan surge-4n --motion-only --out",
            &bench.path("good.mcap"),
        ));
        assert!(simulated.status.success());
        let image = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/frame.png");
        std::fs::copy(image, bench.path("good.png")).unwrap();
        bench.write("good.csv", b"t,x\n0,0\n1,0.1\n2,0.2\n");
        bench.write(
            "good-map.toml",
            b"[time]\ncolumn = \"t\"\nunit = \"s\"\n[motion.x_m]\ncolumn = \"x\"\nunit = \"m\"\n",
        );
        std::fs::create_dir(bench.path("results")).unwrap();
        bench
    }

    fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    fn write(&self, name: &str, bytes: &[u8]) -> PathBuf {
        let path = self.path(name);
        std::fs::write(&path, bytes).unwrap();
        path
    }

    /// The words of a command line: `LOG`, `IMAGE`, `DATA`, `MAP` are good inputs, `OUT` is a place for a result of any
    /// kind, `BAD` is the file in question.
    fn command(&self, line: &str, bad: &Path) -> Vec<String> {
        line.split(' ')
            .map(|word| {
                let path = match word {
                    "LOG" => self.path("good.mcap"),
                    "IMAGE" => self.path("good.png"),
                    "DATA" => self.path("good.csv"),
                    "MAP" => self.path("good-map.toml"),
                    "BAD" => bad.to_owned(),
                    // After the exposure time that it is of.
                    "500:BAD" => return format!("500:{}", bad.display()),
                    _ if word.starts_with("OUT") => {
                        self.path("results").join(word.trim_start_matches("OUT"))
                    }
                    _ => return word.to_owned(),
                };
                path.to_str().unwrap().to_owned()
            })
            .collect()
    }

    /// Files that a refused command line left in the folder of results, in words; it is empty afterwards.
    fn left_behind(&self, words: &[String]) -> Option<String> {
        let results = self.path("results");
        let entries: Vec<PathBuf> = std::fs::read_dir(&results)
            .unwrap()
            .map(|entry| entry.unwrap().path())
            .collect();
        if entries.is_empty() {
            return None;
        }
        std::fs::remove_dir_all(&results).unwrap();
        std::fs::create_dir(&results).unwrap();
        Some(format!("{words:?}: leaves {entries:?}"))
    }
}

fn words(line: &str, path: &Path) -> Vec<String> {
    let mut words: Vec<String> = line.split(' ').map(str::to_owned).collect();
    words.push(path.to_str().unwrap().to_owned());
    words
}

fn run(words: &[String]) -> Output {
    hydroline().args(words).output().unwrap()
}

/// Every place of the command line that takes a file to read.
const INPUTS: &[&str] = &[
    "rig show BAD",
    "plan list --rig BAD",
    "plan design --rig BAD",
    "plan show BAD",
    "plan show surge-4n --rig BAD",
    "check --rig BAD",
    "aim --rig BAD --for 1s",
    "flat BAD",
    "flat LOG --rig BAD",
    "flat LOG --dark BAD",
    "flat --exposure-us 500:BAD",
    "flat LOG --rig lshpi --write-rig OUTrig.toml --dark BAD",
    "board BAD --out OUTb.svg",
    "target BAD --out OUTt.dxf",
    "calibrate BAD --board dots-50 --out OUTc.toml",
    "calibrate IMAGE --board BAD --out OUTc.toml",
    "calibrate IMAGE --board dots-50 --rig BAD --out OUTc.toml",
    "calibrate IMAGE --board dots-50 --against BAD --out OUTc.toml",
    "record --rig BAD --for 1s --out OUTr.mcap",
    "record --rig lshpi --plan BAD --out OUTr.mcap",
    "record --rig lshpi --for 1s --calibration BAD --out OUTr.mcap",
    "record --rig lshpi --for 1s --calibrate --board BAD --out OUTr.mcap",
    "record --rig lshpi --tank BAD --for 1s --out OUTr.mcap",
    "info BAD",
    "doctor BAD",
    "recover BAD --out OUTm.mcap",
    "export BAD --out OUTtables",
    "replay BAD --out OUTp.mcap",
    "replay LOG BAD --out OUTfolder",
    "replay BAD --rate-hz 25 --out OUTp.mcap",
    "replay LOG --rig BAD --out OUTp.mcap",
    "replay LOG --calibration BAD --out OUTp.mcap",
    "view BAD",
    "view LOG BAD",
    "extract BAD --csv",
    "extract BAD --json",
    "import BAD --map MAP --out OUTi.mcap",
    "import --guess BAD",
    "import DATA --map BAD --out OUTi.mcap",
    "import DATA --map MAP --rig BAD --out OUTi.mcap",
    "import BAD --guess --topic /odom",
    "join BAD LOG --out OUTj.mcap",
    "join LOG BAD --out OUTj.mcap",
    "join LOG LOG --rig BAD --out OUTj.mcap",
    "export LOG --merged --rig BAD --out OUTmerged.csv",
    "identify BAD --rig lshpi",
    "identify LOG BAD --rig lshpi --report OUTreport",
    "identify LOG --rig BAD",
    "identify LOG --rig lshpi --still BAD",
    "identify --bollard BAD --rig lshpi --write-rig OUTrig.toml",
    "diagnose BAD --rig lshpi",
    "diagnose LOG --rig BAD",
    "diagnose LOG --rig lshpi --hold-out BAD --write-rig OUTrig.toml",
    "predict --rig BAD --plan surge-4n",
    "predict --rig lshpi --plan BAD",
    "predict --rig lshpi --plan surge-4n --identified BAD",
    "predict --rig lshpi --plan surge-4n --measured BAD --report OUTreport",
    "simulate --rig BAD --plan surge-4n --out OUTs.mcap",
    "simulate --rig lshpi --plan BAD --out OUTs.mcap",
    "simulate --rig lshpi --plan still --show-board BAD --out OUTs.mcap",
    "simulate --rig lshpi --plan surge-4n --motion-only --draw 1 --draw-from BAD --out OUTs.mcap",
    "coefficients BAD",
    "compare BAD lshpi",
    "compare lshpi BAD",
    "coefficients lshpi --rig BAD --length 1",
    "model BAD --to python --out OUTm.py",
    "model lshpi --to python --seen BAD --out OUTm.py",
    "model lshpi --draws 3 --from BAD --out OUTd.csv",
    "rig set BAD vehicle.mass_kg=3 --out OUTrig.toml",
    "rig import BAD --rig lshpi --out OUTrig.toml",
    "rig import DATA --rig BAD --out OUTrig.toml",
    "rig diff lshpi BAD",
    "publish BAD --rig lshpi --out OUTset",
    "publish LOG --rig BAD --out OUTset",
    "publish LOG --result BAD --out OUTset",
    "reproduce joint-pose --frames 1 --target BAD",
];

/// A value or a place that each command refuses, with what its words must hold.
const VALUES: &[(&str, &[&str])] = &[
    ("demo --out LOG", &["exists", "--out"]),
    ("devices --lnog", &["--long"]),
    ("rig new --out LOG", &["exists", "--out"]),
    ("rig show lshpy", &["lshpi"]),
    (
        "rig set lshpi vehicle.mass_kg=3m --out OUTrig.toml",
        &["kg"],
    ),
    (
        "rig import DATA --rig lshpi --speed 2 --out OUTrig.toml",
        &["--prime"],
    ),
    ("rig diff lshpi lshpy", &["lshpi"]),
    ("compare lshpi lshpy", &["lshpi"]),
    ("coefficients lshpi --prime I", &["--length"]),
    ("coefficients lshpi --speed 2", &["--length"]),
    ("coefficients lshpi --prime III --length 1", &["bis"]),
    ("model lshpi --to matlab --out OUTm.m", &["mss"]),
    (
        "model lshpi --to mss --out OUT1m.m",
        &["--out", "my_vehicle.m"],
    ),
    (
        "model lshpi --draws 10 --out OUTd.csv",
        &["--write-rig", "--from"],
    ),
    ("model bluerov2 --draws 10 --out OUTd.txt", &[".npz"]),
    ("publish LOG --out LOG", &["--out", "not a folder"]),
    ("publish LOG LOG --out OUTset", &["good.mcap", "twice"]),
    ("plan show surge-5n", &["surge-4n"]),
    (
        "plan show surge-4n --scale 0",
        &["--scale", "above 0", "0.42"],
    ),
    ("plan list --rig lshpy", &["lshpi"]),
    (
        "plan design --rig lshpi --length 1s",
        &["--length", "5s to 10m"],
    ),
    ("plan design --rig lshpi --plans 0", &["--plans", "1..=20"]),
    (
        "record --rig lshpi --next --plan surge-4n --out OUTr.mcap",
        &["--next", "--plan"],
    ),
    (
        "record --rig lshpi --until-decided --max-runs 0 --out OUTr.mcap",
        &["--max-runs", "1..=100"],
    ),
    (
        "record --rig lshpi --plan surge-4n --yes --out OUTr.mcap",
        &["--yes", "--until-decided"],
    ),
    ("plan design --rig lshpi --dof surj", &["--dof", "surge"]),
    (
        "plan design --rig lshpi --for fun",
        &["identify", "diagnose"],
    ),
    ("check --rig lshpi --disk", &["--disk"]),
    ("aim --rig lshpi --for 0s", &["longer than 0"]),
    (
        "aim --rig lshpi --for 1s --live-token long-enough-for-a-token",
        &["without --live", "0.0.0.0:8080"],
    ),
    (
        "aim --rig lshpi --for 1s --live 0.0.0.0:0",
        &["0.0.0.0:0", "--live-token", "ssh -L"],
    ),
    (
        "record --rig lshpi --for 1s --live [::]:0 --out OUTr.mcap",
        &["[::]:0", "--live-token", "ssh -L"],
    ),
    (
        "simulate --rig lshpi --plan surge-4n --live 127.0.0.1:0 --live-token short --out OUTs.mcap",
        &["5 characters", "16 to 128", "e.g."],
    ),
    (
        "replay LOG --live run.mcap --out OUTp.mcap",
        &["run.mcap", "--live=127.0.0.1:8080"],
    ),
    (
        "aim --rig lshpi --disk OUTnone --for 1s",
        &["--disk", "create it first"],
    ),
    ("flat --exposure-us 500", &["US:PATH", "500:dim/"]),
    ("flat --exposure-us -3:OUTx", &["-3", "above 0"]),
    ("flat LOG --write-rig OUTrig.toml", &["--rig"]),
    // Simulated without images.
    ("flat LOG", &["good.mcap", "no image"]),
    ("board dots-50 --out OUTb.png", &[".svg", ".dxf", ".pdf"]),
    ("board dots-50 --tile a5 --out OUTb.pdf", &["a4, a3"]),
    (
        "board dots-50 --tile a4 --out OUTb.svg",
        &["--tile", ".pdf"],
    ),
    ("board dots-50 --margin-mm 10 --out OUTb.pdf", &["--tile"]),
    (
        "board dots-50 --tile a4 --margin-mm 1 --out OUTb.pdf",
        &["1 mm", "5 to 50 mm"],
    ),
    (
        "target hexagons --tile a3 --overlap-mm 99 --out OUTt.pdf",
        &["99 mm", "0 to 30 mm"],
    ),
    ("target hexagon --out OUTt.svg", &["hexagons"]),
    (
        "calibrate IMAGE --board dots-50 --method affin --out OUTc.toml",
        &["affine"],
    ),
    (
        "calibrate IMAGE --board dots-50 --at 1 --out OUTc.toml",
        &["XI,ETA"],
    ),
    (
        "calibrate IMAGE --board dots-50 --out OUTno/c.toml",
        &["create it first"],
    ),
    ("record --rig lshpi --for soon --out OUTr.mcap", &["30s"]),
    (
        "record --rig lshpi --for 1s --start-within-m 0 --out OUTr.mcap",
        &["--start-within-m", "up to 1 m"],
    ),
    (
        "record --rig lshpi --for 1s --start-within-deg 90 --out OUTr.mcap",
        &["--start-within-deg", "up to 45 deg"],
    ),
    (
        "record --rig lshpi --for 1s --calibration a.toml --no-remembered --out OUTr.mcap",
        &["--calibration", "--no-remembered"],
    ),
    ("record --rig lshpi --for 1s", &["--out"]),
    ("info", &["<LOG|FOLDER>"]),
    ("info LOG --grep [", &["--grep", "regular expression"]),
    ("doctor LOG --jsno", &["--json"]),
    ("recover LOG --out LOG", &["exists", "--out"]),
    ("export LOG --tables-only --frames-only", &["--frames-only"]),
    ("export LOG --out LOG", &["--out", "good.mcap"]),
    (
        "replay LOG --refine floor-slope --out OUTp.mcap",
        &["floor_slope"],
    ),
    // Simulated without images: a log of the wrong kind.
    (
        "replay LOG --out OUTp.mcap",
        &["good.mcap", "no image", "hydroline info"],
    ),
    ("view LOG LOG LOG LOG LOG", &["5 logs", "at most 4"]),
    (
        "view LOG --listen 0.0.0.0:0",
        &["--listen 0.0.0.0:0", "--live-token", "see the logs"],
    ),
    ("view LOG --listen LOG", &["ADDRESS:PORT"]),
    ("view LOG@9..3", &["ends before it begins"]),
    (
        "extract IMAGE IMAGE --annotate OUTa.png",
        &["--annotate", "one image"],
    ),
    ("extract IMAGE --channel infrared", &["infrared", "green"]),
    ("extract IMAGE --bits 17", &["--bits", "8..=16"]),
    (
        "replay LOG --rate-hz 25 --out OUTp.mcap",
        &["--rate-hz", "folders of images"],
    ),
    (
        "replay LOG --image-topic /none --out OUTp.mcap",
        &["good.mcap", "/none", "no images at all"],
    ),
    (
        "calibrate LOG --image-topic /none --rig lshpi --board dots-50 --out OUTc.toml",
        &["good.mcap", "/none", "no images at all"],
    ),
    ("import DATA --out OUTi.mcap", &["--map"]),
    ("import --guess DATA --out OUTi.mcap", &["--guess", "--out"]),
    (
        "import --guess DATA --topic /odom",
        &["--topic", "/odom", "name a log"],
    ),
    (
        "join LOG LOG --offset-s soon --out OUTj.mcap",
        &["--offset-s", "soon"],
    ),
    (
        "join LOG LOG --offset-sd-s 0.1 --out OUTj.mcap",
        &["--offset-s"],
    ),
    (
        "join LOG LOG --offset-s 1e8 --out OUTj.mcap",
        &["--offset-s", "no command falls within the motion"],
    ),
    ("export LOG --merged --frames-only", &["--frames-only"]),
    (
        "identify LOG --rig lshpi --model surg",
        &["--model", "surge"],
    ),
    ("identify LOG --rig lshpi --fix k", &["--fix", "x_udot"]),
    ("identify LOG --rig lshpi --fail-on misfits", &["misfit"]),
    (
        "identify --bollard DATA --rig lshpi --fail-on misfit",
        &["--fail-on", "LOG"],
    ),
    (
        "identify LOG --rig lshpi --report LOG",
        &["--report", "good.mcap", "not a folder"],
    ),
    (
        "diagnose LOG --rig lshpi --report LOG",
        &["--report", "good.mcap", "not a folder"],
    ),
    (
        "diagnose LOG --rig lshpi --hold-out LOG",
        &["--hold-out", "another log"],
    ),
    ("diagnose LOG@9..3 --rig lshpi", &["ends before it begins"]),
    (
        "predict --rig lshpi --plan surge-4n --rate 0",
        &["--rate", "10000"],
    ),
    (
        "predict --rig lshpi --plan surge-4n --report LOG",
        &["--report", "good.mcap", "not a folder"],
    ),
    (
        "predict --rig lshpi --plan surge-4n --other-rig",
        &["--measured"],
    ),
    (
        "simulate --rig lshpi --plan surge-4 --out OUTs.mcap",
        &["surge-4n"],
    ),
    ("reproduce table6", &["table7"]),
    ("reproduce table4 --svg OUTf.svg", &["figure12", "--csv"]),
    ("reproduce table4 --csv OUTno/t.csv", &["create it first"]),
    ("campaign OUTno --out OUTc", &["no such folder"]),
    ("prove --cases 0", &["--cases", "1"]),
    ("prove --only single", &["single"]),
    (
        "prove --only single-0 --only single-1",
        &["--only", "--keep"],
    ),
    ("prove --cases 2 --list --json", &["--list", "--json"]),
    ("prove --cases 1 --keep LOG", &["--keep", "not a folder"]),
    ("completions bahs", &["bash"]),
    ("man --out LOG", &["--out", "not a folder"]),
    ("sim-controller --kind maestro", &["--socket", "--pty"]),
    (
        "sim-controller --kind maestro --socket OUTnone.sock",
        &["none.sock", "first"],
    ),
];

/// Words of which a next step has at least one.
const STEPS: &[&str] = &[
    "Give ", "give ", "Add ", "Mend ", "mend ", "name ", "Name ", "check ", "Check ", "Write ",
    "write ", "needs ", "Export ", "export ",
];

/// Faults of how a command line was refused, each in words; exit code 2 and `parts` are required.
fn faults(words: &[String], output: &Output, parts: &[&str]) -> Vec<String> {
    let stderr = String::from_utf8_lossy(&output.stderr);
    let mut faults = Vec::new();
    if output.status.code() != Some(2) {
        faults.push(format!("{:?}", output.status.code()));
    }
    for part in parts.iter().filter(|part| !stderr.contains(**part)) {
        faults.push(format!("no '{part}'"));
    }
    if stderr.contains("panicked") {
        faults.push("panicked".to_owned());
    }
    faults
        .iter()
        .map(|fault| format!("{words:?}: {fault}: {stderr}"))
        .collect()
}

#[test]
fn a_file_that_cannot_be_used_is_a_bad_argument_in_every_command() {
    let bench = Bench::new();
    let bad = [
        bench.path("nothing-here.toml"),
        bench.path("a-folder"),
        bench.write("empty.toml", b""),
        bench.write("garbage.toml", &[0x8f, b'x', 0, 0xff, b'=', 0x80, b'\n']),
    ];
    std::fs::create_dir(&bad[1]).unwrap();
    let mut wrong = Vec::new();
    for line in INPUTS {
        for path in &bad {
            let words = bench.command(line, path);
            let output = run(&words);
            wrong.extend(faults(&words, &output, &[path.to_str().unwrap()]));
            let stderr = String::from_utf8_lossy(&output.stderr);
            if !STEPS.iter().any(|step| stderr.contains(step)) {
                wrong.push(format!("{words:?}: no next step in: {stderr}"));
            }
            wrong.extend(bench.left_behind(&words));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn a_value_that_cannot_be_used_is_a_bad_argument_in_every_command() {
    let bench = Bench::new();
    let mut wrong = Vec::new();
    for (line, parts) in VALUES {
        let words = bench.command(line, Path::new(""));
        wrong.extend(faults(&words, &run(&words), parts));
        wrong.extend(bench.left_behind(&words));
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn no_command_is_missing_in_the_tables() {
    let first = |line: &&str| line.split(' ').next().unwrap().to_owned();
    let tested: BTreeSet<String> = VALUES.iter().map(|v| first(&v.0)).collect();
    let all = hydroline::cli::command(BuildInfo::default());
    let all: BTreeSet<String> = all
        .get_subcommands()
        .map(|c| c.get_name().to_owned())
        .collect();
    assert_eq!(tested, all);
    // Of these no argument is a file to read.
    let without = [
        "demo",
        "devices",
        "campaign",
        "prove",
        "completions",
        "man",
        "sim-controller",
    ];
    let reading: BTreeSet<String> = INPUTS.iter().map(first).collect();
    let expected = all
        .into_iter()
        .filter(|name| !without.contains(&name.as_str()));
    assert_eq!(reading, expected.collect());
}

#[test]
fn garbage_beside_good_images_is_left_out_and_said() {
    let bench = Bench::new();
    let garbage = bench.write("garbage.png", b"no image at all");
    let words = bench.command("extract IMAGE BAD", &garbage);
    let output = run(&words);
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(3), "{stderr}");
    assert!(
        stderr.contains("garbage.png") && stderr.contains("1 of 2"),
        "{stderr}"
    );
    assert!(String::from_utf8_lossy(&output.stdout).contains("good.png"));
}

/// Ten frames and, with `lost`, two that the camera did not deliver before the sixth.
fn log_of_frames(path: &Path, lost: u32) {
    let settings = WriteSettings::offline(Some(PixelFormat::Grey));
    let head = Head {
        rig_toml: hydroline_rigs::Rig::builtin("lshpi")
            .unwrap()
            .effective_toml,
        ..Head::default()
    };
    let mut log = FileRecorder::create(path, false, head, settings).unwrap();
    for k in 0..10u32 {
        let gap = if k == 5 { lost } else { 0 };
        let sequence = k + if k >= 5 { lost } else { 0 };
        let stamp_ns = 1_760_000_000_000_000_000 + u64::from(sequence) * 40_000_000;
        let (width_px, height_px) = (64, 48);
        let frame = Frame {
            format: PixelFormat::Grey,
            width_px,
            height_px,
            stride_bytes: width_px,
            data: vec![8; 64 * 48].into(),
            meta: FrameMeta {
                sequence,
                driver_stamp_ns: stamp_ns,
                stamp_clock: StampClock::Realtime,
                stamp_source: StampSource::MidExposure,
                flags: 0,
                received_monotonic_ns: 1,
                mid_exposure_ns: stamp_ns,
                exposure_s: 0.004,
                fault: None,
                lost_before: LossBefore {
                    sequence_gap: gap,
                    time_gap: 0,
                },
            },
        };
        log.write(stamp_ns, &Entry::frame(&frame, u64::from(k)))
            .unwrap();
    }
    log.finish(&SummaryInput::clean("done")).unwrap();
}

#[test]
fn lost_frames_are_the_doctors_finding_and_no_failure_of_what_reads_the_log() {
    let dir = tempfile::tempdir().unwrap();
    let (whole, gap, cut) = ("whole.mcap", "gap.mcap", "cut.mcap");
    let path = |name: &str| dir.path().join(name);
    log_of_frames(&path(whole), 0);
    log_of_frames(&path(gap), 2);
    let bytes = std::fs::read(path(gap)).unwrap();
    std::fs::write(path(cut), &bytes[..bytes.len() - 200]).unwrap();
    let code = |command: &str, log: &str, out: Option<&str>| {
        let mut line = hydroline();
        line.arg(command).arg(path(log));
        if let Some(out) = out {
            line.arg("--out").arg(path(out));
        }
        let output = line.output().unwrap();
        let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
        (output.status.code().unwrap(), stderr)
    };
    for (log, info, doctor) in [(whole, 0, 0), (gap, 0, 3), (cut, 0, 3)] {
        assert_eq!(code("info", log, None).0, info, "info {log}");
        assert_eq!(code("doctor", log, None).0, doctor, "doctor {log}");
    }
    // Nothing is lost by reading what is there. (Frames without a target have no pose, lost ones or not.)
    assert_eq!(code("export", gap, Some("tables")).0, 0);
    for (log, out) in [(whole, "whole-replayed.mcap"), (gap, "replayed.mcap")] {
        let (code, stderr) = code("replay", log, Some(out));
        assert_eq!(code, 3, "{log}: {stderr}");
        assert!(stderr.contains("frames have a pose"), "{log}: {stderr}");
    }
    // A cut log is the run's failure, and its cure is named.
    for (command, out) in [("export", "cut-tables"), ("replay", "cut-replayed.mcap")] {
        let (code, stderr) = code(command, cut, Some(out));
        assert_eq!(code, 1, "{command}: {stderr}");
        assert!(stderr.contains("hydroline recover"), "{command}: {stderr}");
    }
}
