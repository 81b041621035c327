//! Commands that were killed or ran out of disk: nothing half done has the final name, and a repeat of the command is all it
//! takes.

use crate::support::hydroline;
use std::collections::BTreeMap;
use std::path::Path;
use std::process::{Output, Stdio};

const TABLE_ROWS: u32 = 400;

fn run(dir: &Path, words: &[&str]) -> Output {
    let mut command = hydroline();
    command.current_dir(dir).args(words).env_remove("RUST_LOG");
    command.output().unwrap()
}

fn said(output: &Output) -> String {
    format!(
        "{:?}\n{}{}",
        output.status.code(),
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    )
}

/// A table with its map, and two logs that can be joined, one of them with images.
fn inputs() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    let mut table = "t,x,u\n".to_owned();
    for k in 0..TABLE_ROWS {
        let t_s = f64::from(k) * 0.05;
        table += &format!("{t_s:.3},{:.5},{}\n", 0.1 * (0.7 * t_s).sin(), (k / 40) % 2);
    }
    std::fs::write(dir.join("t.csv"), table).unwrap();
    let map = "[time]\ncolumn = \"t\"\nunit = \"s\"\n[motion.x_m]\ncolumn = \"x\"\nunit = \"m\"\n\
               [[command]]\nthruster = \"surge\"\ncolumn = \"u\"\nunit = \"N\"\n";
    std::fs::write(dir.join("m.toml"), map).unwrap();
    let images = [
        "simulate", "--rig", "lshpi", "--plan", "still", "--out", "a.mcap",
    ];
    let motion = "simulate --motion-only --rig lshpi --plan surge-4n --out b.mcap";
    for words in [images.to_vec(), motion.split(' ').collect()] {
        let made = run(dir, &words);
        assert!(made.status.success(), "{}", said(&made));
    }
    folder
}

const COMMANDS: [&str; 5] = [
    "import t.csv --map m.toml --out new.mcap",
    "join b.mcap b.mcap --offset-s 0 --out new.mcap",
    "replay a.mcap --out new.mcap",
    "simulate --motion-only --rig lshpi --plan surge-4n --out new.mcap",
    "recover b.mcap --out new.mcap",
];

#[test]
fn a_part_that_a_killed_command_left_is_replaced_and_said() {
    let folder = inputs();
    let dir = folder.path();
    let (new, part) = (dir.join("new.mcap"), dir.join("new.mcap.part"));
    for command in COMMANDS {
        let words: Vec<&str> = command.split(' ').collect();
        std::fs::write(&part, vec![0; 5000]).unwrap();
        let made = run(dir, &words);
        assert_eq!(made.status.code(), Some(0), "{command}: {}", said(&made));
        assert!(
            said(&made).contains("broken off"),
            "{command}: {}",
            said(&made)
        );
        assert!(new.exists() && !part.exists(), "{command}");
        let doctor = run(dir, &["doctor", "new.mcap"]);
        assert_eq!(
            doctor.status.code(),
            Some(0),
            "{command}: {}",
            said(&doctor)
        );
        std::fs::remove_file(&new).unwrap();

        // One that somebody writes stays theirs.
        let held = std::fs::File::create(&part).unwrap();
        held.lock().unwrap();
        let refused = run(dir, &words);
        assert_eq!(
            refused.status.code(),
            Some(2),
            "{command}: {}",
            said(&refused)
        );
        assert!(
            said(&refused).contains("being written"),
            "{command}: {}",
            said(&refused)
        );
        assert!(!new.exists() && part.exists(), "{command}");
        drop(held);
        std::fs::remove_file(&part).unwrap();
    }
}

/// The file system takes no more than 8 kB of a file, as a disk that is full.
#[test]
fn a_log_that_the_disk_did_not_take_leaves_no_stub_that_blocks_the_next_attempt() {
    let folder = inputs();
    let dir = folder.path();
    let binary = hydroline().get_program().to_owned();
    for command in COMMANDS {
        let limited = std::process::Command::new("bash")
            .args(["-c", "trap '' XFSZ; ulimit -f 8; exec \"$@\"", "bash"])
            .arg(&binary)
            .args(command.split(' '))
            .current_dir(dir)
            .output()
            .unwrap();
        assert_eq!(
            limited.status.code(),
            Some(1),
            "{command}: {}",
            said(&limited)
        );
        let left: Vec<_> = std::fs::read_dir(dir)
            .unwrap()
            .map(|e| e.unwrap().file_name())
            .collect();
        assert_eq!(left.len(), 4, "{command}: {left:?}");
        let made = run(dir, &command.split(' ').collect::<Vec<_>>());
        assert_eq!(made.status.code(), Some(0), "{command}: {}", said(&made));
        std::fs::remove_file(dir.join("new.mcap")).unwrap();
    }
}

#[test]
fn an_export_that_was_killed_is_taken_up_by_the_same_command() {
    let folder = inputs();
    let dir = folder.path();
    std::fs::create_dir_all(dir.join("b/unfinished.part")).unwrap();
    std::fs::write(dir.join("b/unfinished.part/motion.csv"), "half").unwrap();
    let made = run(dir, &["export", "b.mcap"]);
    assert_eq!(made.status.code(), Some(0), "{}", said(&made));
    assert!(said(&made).contains("broken off"), "{}", said(&made));
    assert!(dir.join("b/motion.csv").exists() && !dir.join("b/unfinished.part").exists());
    // What is whole stays.
    let again = run(dir, &["export", "b.mcap"]);
    assert_eq!(again.status.code(), Some(2), "{}", said(&again));
}

/// Files of a folder with their content.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let entries = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap());
    let file = |e: std::fs::DirEntry| {
        let name = e.file_name().to_string_lossy().into_owned();
        (name, std::fs::read(e.path()).unwrap())
    };
    entries.map(file).collect()
}

/// It was begun anew, however far it had come.
#[test]
fn an_export_of_images_that_was_killed_goes_on_and_says_how_many_are_there() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    let plan = "name = \"short\"\n[[step]]\nfor_s = 1.2\nwrench = {}\n";
    std::fs::write(dir.join("short.toml"), plan).unwrap();
    for words in [
        "simulate --rig lshpi --plan short.toml --out a.mcap",
        "export a.mcap --out whole",
    ] {
        let made = run(dir, &words.split(' ').collect::<Vec<_>>());
        assert_eq!(made.status.code(), Some(0), "{}", said(&made));
    }
    let part = dir.join("a/unfinished.part");
    let has_image = || {
        let entries = std::fs::read_dir(&part).into_iter().flatten().flatten();
        let mut paths = entries.map(|e| e.path());
        paths.any(|path| path.extension().is_some_and(|e| e == "png"))
    };
    // Killed as soon as there is an image; where it was faster, again.
    let is_killed = (0..20).any(|_| {
        let mut export = hydroline()
            .current_dir(dir)
            .args(["export", "a.mcap"])
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        while export.try_wait().unwrap().is_none() && !has_image() {}
        export.kill().ok();
        export.wait().unwrap();
        let is_left = has_image() && !part.join("moving.txt").exists();
        if !is_left {
            std::fs::remove_dir_all(dir.join("a")).ok();
        }
        is_left
    });
    assert!(is_killed);
    let made = run(dir, &["export", "a.mcap"]);
    assert_eq!(made.status.code(), Some(0), "{}", said(&made));
    for words in ["it goes on", "images are there", "made before the export"] {
        assert!(said(&made).contains(words), "{words}: {}", said(&made));
    }
    assert!(files(&dir.join("a")) == files(&dir.join("whole")));
}
