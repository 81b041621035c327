//! Logs by the folder: a bad one is reported and skipped, results lie by their logs' names, what is done is left.

use crate::support::hydroline;
use std::path::Path;
use std::time::{Duration, SystemTime};

/// Exit code, stdout, stderr.
fn run(dir: &Path, words: &[&str]) -> (Option<i32>, String, String) {
    let output = hydroline().current_dir(dir).args(words).output().unwrap();
    (
        output.status.code(),
        String::from_utf8(output.stdout).unwrap(),
        String::from_utf8(output.stderr).unwrap(),
    )
}

/// Two sound logs, one of them in a folder of its own, and one that is cut before its first message.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    std::fs::create_dir_all(dir.join("logs/day")).unwrap();
    for (seed, log) in [("1", "logs/a.mcap"), ("2", "logs/day/b.mcap")] {
        let words = "simulate --motion-only --rig lshpi --plan reversals --seed";
        let mut words: Vec<&str> = words.split(' ').collect();
        words.extend([seed, "--out", log]);
        assert_eq!(run(dir, &words).0, Some(0), "{log}");
    }
    let whole = std::fs::read(dir.join("logs/a.mcap")).unwrap();
    std::fs::write(dir.join("logs/cut.mcap"), &whole[..3000]).unwrap();
    std::fs::write(dir.join("logs/none.mcap"), "text").unwrap();
    folder
}

#[test]
fn info_and_doctor_take_a_folder_and_skip_what_is_no_log() {
    let folder = folder();
    let dir = folder.path();
    let (code, out, err) = run(dir, &["doctor", "logs"]);
    assert_eq!(code, Some(3), "{err}");
    for words in ["logs/a.mcap: ", "logs/day/b.mcap: ", "NOT sound"] {
        assert!(out.contains(words), "no '{words}' in {out}");
    }
    assert!(err.contains("none.mcap: not an MCAP file"), "{err}");
    assert!(err.contains("1 of 4 logs could not be used"), "{err}");

    // One object per line; of the bad one too.
    let (code, out, _) = run(dir, &["info", "logs", "--json"]);
    assert_eq!(code, Some(3));
    let lines: Vec<serde_json::Value> = out
        .lines()
        .map(|l| serde_json::from_str(l).unwrap())
        .collect();
    let logs: Vec<&str> = lines.iter().map(|l| l["log"].as_str().unwrap()).collect();
    let all = ["a.mcap", "cut.mcap", "day/b.mcap", "none.mcap"].map(|l| format!("logs/{l}"));
    assert_eq!(logs, all);
    assert!(lines[3]["error"].as_str().unwrap().contains("not an MCAP"));
    assert!(lines[0]["messages"].as_u64().unwrap() > 0);

    // One log by itself prints what it always printed.
    let (code, out, _) = run(dir, &["info", "logs/a.mcap", "--json"]);
    assert_eq!(code, Some(0));
    let one: serde_json::Value = serde_json::from_str(&out).unwrap();
    assert!(one.get("log").is_none());

    let (code, _, err) = run(dir, &["doctor", "logs/none.mcap", "logs/none.mcap"]);
    assert_eq!(code, Some(2), "{err}");
    assert!(err.contains("none of the 2 logs could be used"), "{err}");
}

#[test]
fn grep_finds_logs_by_rig_and_plan_and_says_where_nothing_is_found() {
    let folder = folder();
    let dir = folder.path();
    let (_, out, _) = run(dir, &["info", "logs", "--grep", "SEED = 2$"]);
    let lines: Vec<&str> = out.lines().collect();
    assert!(
        lines.contains(&"logs/day/b.mcap: seed = 2"),
        "one line each: {out}"
    );
    assert!(lines.iter().all(|l| l.starts_with("logs/day/b.mcap: ")));
    // A text that is printed as a number of lines is searched line by line.
    let (_, out, _) = run(dir, &["info", "logs", "--grep", r"^rig\.toml: mass_kg"]);
    assert_eq!(out.lines().count(), 2, "{out}");
    let (code, out, err) = run(dir, &["info", "logs/a.mcap", "--grep", "submarine"]);
    assert_eq!((code, out.as_str()), (Some(1), ""));
    assert!(err.contains("--grep submarine: found in none"), "{err}");
    let (code, _, err) = run(dir, &["info", "logs", "--grep", "("]);
    assert_eq!(code, Some(2));
    assert!(err.contains("--grep"), "{err}");
}

#[test]
fn export_of_a_folder_is_repeated_for_what_is_new() {
    let folder = folder();
    let dir = folder.path();
    let words = ["export", "logs", "--merged", "--out", "tables", "--update"];
    let (code, out, err) = run(dir, &words);
    assert_eq!(code, Some(3), "{err}");
    for table in ["tables/a.csv", "tables/day/b.csv"] {
        assert!(out.contains(&format!("{table}: ")), "{out}");
        assert!(dir.join(table).is_file());
    }
    assert!(err.contains("2 of 4 logs could not be used"), "{err}");
    let (_, out, err) = run(dir, &words);
    assert_eq!(out, "", "nothing is new");
    assert!(err.contains("tables/a.csv: up to date"), "{err}");
    // A log that is newer than its table is exported again, the other is left.
    let table = std::fs::File::options()
        .write(true)
        .open(dir.join("tables/a.csv"))
        .unwrap();
    table
        .set_modified(SystemTime::now() - Duration::from_secs(3600))
        .unwrap();
    let (_, out, err) = run(dir, &words);
    assert!(
        out.starts_with("tables/a.csv: ") && out.lines().count() == 1,
        "{out:?}, {err}"
    );
    // Without --update nothing is replaced.
    let (code, _, err) = run(dir, &words[..5]);
    assert_eq!(code, Some(2), "{err}");
    assert!(err.contains("tables/a.csv exists"), "{err}");

    // An export that was broken off is made anew.
    let words = ["export", "logs", "--tables-only", "--out", "f", "--update"];
    std::fs::create_dir_all(dir.join("f/a/unfinished.part")).unwrap();
    std::fs::write(dir.join("f/a/unfinished.part/motion.csv"), "").unwrap();
    let (_, out, err) = run(dir, &words);
    assert!(out.contains("f/a/motion.csv: "), "{out} {err}");
    assert!(!dir.join("f/a/unfinished.part").exists());
    assert_eq!(run(dir, &words).1, "");
    let (code, _, err) = run(
        dir,
        &["export", "logs/a.mcap", "logs/a.mcap", "--out", "twice"],
    );
    assert_eq!(code, Some(2));
    assert!(err.contains("would both become twice/a"), "{err}");
}

#[test]
fn replay_of_a_folder_goes_on_after_a_bad_log_and_is_repeated() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    std::fs::create_dir(dir.join("logs")).unwrap();
    let words = "record --rig lshpi --for 1s --no-remembered --out logs/b.mcap";
    let words: Vec<&str> = words.split(' ').collect();
    let (code, _, err) = run(dir, &words);
    // 3: a busy machine lost a frame, which does not matter here.
    assert!(matches!(code, Some(0 | 3)), "{err}");
    std::fs::write(dir.join("logs/a.mcap"), "text").unwrap();
    let words = ["replay", "logs", "--out", "poses", "--update"];
    let (code, out, err) = run(dir, &words);
    assert_eq!(code, Some(3), "{err}");
    assert!(out.contains("logs/b.mcap -> poses/b.mcap"), "{out}");
    assert!(err.contains("logs/a.mcap: not an MCAP file"), "{err}");
    let (_, out, err) = run(dir, &words);
    assert_eq!(out, "");
    assert!(err.contains("poses/b.mcap: up to date"), "{err}");
    // A file that a kill has cut is no result: it is made anew, and the same.
    let whole = std::fs::read(dir.join("poses/b.mcap")).unwrap();
    std::fs::write(dir.join("poses/b.mcap"), &whole[..whole.len() / 2]).unwrap();
    let mut json = words.to_vec();
    json.push("--json");
    let (_, out, _) = run(dir, &json);
    let printed: serde_json::Value = serde_json::from_str(&out).unwrap();
    assert_eq!(printed["replays"].as_array().unwrap().len(), 1);
    assert_eq!(printed["refused"][0]["log"], "logs/a.mcap");
    let again = std::fs::read(dir.join("poses/b.mcap")).unwrap();
    assert_eq!(again.len(), whole.len());
    let hidden = std::fs::read_dir(dir.join("poses")).unwrap().count();
    assert_eq!(hidden, 1, "no part is left");
    // Without --update nothing is replaced.
    let (code, _, err) = run(dir, &words[..4]);
    assert_eq!(code, Some(2), "{err}");
    assert!(err.contains("poses/b.mcap exists"), "{err}");
}
