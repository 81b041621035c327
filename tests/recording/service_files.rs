//! The files for systemd and udev that ship: what they guarantee, and what systemd says of them.

use std::path::{Path, PathBuf};
use std::process::Command;

/// Highest exposure that is allowed, of 10 (`systemd-analyze security`).
const EXPOSURE_MAX: f64 = 2.5;

fn file(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("src/daemon/service")
        .join(name)
}

#[test]
fn the_unit_runs_record_as_a_user_of_its_own_with_devices_and_priority() {
    let unit = std::fs::read_to_string(file("hydroline.service")).unwrap();
    for line in [
        "Type=notify",
        "User=hydroline",
        "SupplementaryGroups=video dialout",
        "DevicePolicy=closed",
        "NoNewPrivileges=yes",
        "ProtectSystem=strict",
        "StateDirectory=hydroline",
        "LimitRTPRIO=10",
        "SuccessExitStatus=3",
    ] {
        assert!(unit.lines().any(|l| l == line), "no {line}");
    }
    assert!(unit.contains("exec /usr/bin/hydroline record --rig /etc/hydroline/rig.toml"));
    let rules = std::fs::read_to_string(file("60-hydroline.rules")).unwrap();
    assert!(rules.contains("GROUP=\"video\"") && rules.contains("GROUP=\"dialout\""));
}

/// Words of a line of the unit as systemd splits it: by blanks, quotes respected and taken away.
fn split(line: &str) -> Vec<String> {
    let (mut words, mut word, mut quote) = (Vec::new(), None::<String>, None);
    for c in line.chars() {
        match (c, quote) {
            (c, Some(q)) if c == q => quote = None,
            (c, Some(_)) => word.get_or_insert_default().push(c),
            ('\'' | '"', None) => {
                quote = Some(c);
                word.get_or_insert_default();
            }
            (c, None) if c.is_whitespace() => words.extend(word.take()),
            (c, None) => word.get_or_insert_default().push(c),
        }
    }
    words.extend(word);
    words
}

/// Arguments that the unit starts the program with, when its options are these.
fn started(options: &str) -> Vec<String> {
    let unit = std::fs::read_to_string(file("hydroline.service")).unwrap();
    let line = unit.lines().find_map(|l| l.strip_prefix("ExecStart="));
    let given = split(line.unwrap())
        .into_iter()
        .flat_map(|word| match word.as_str() {
            // systemd.service(5): a variable that is a word of its own is split at blanks, quotes respected.
            "$HYDROLINE_OPTIONS" => split(options),
            word => vec![word.replace("%S/", "/var/lib/").replace("%%", "%")],
        });
    let given: Vec<String> = given.collect();
    let script = given[2]
        .replace("/usr/bin/hydroline", "printf '%s\\n'")
        .replace("exec ", "");
    let output = Command::new(&given[0])
        .args([&given[1], &script])
        .args(&given[3..])
        .output()
        .unwrap();
    assert!(output.status.success(), "{given:?}");
    let text = String::from_utf8(output.stdout).unwrap();
    text.lines().map(str::to_owned).collect()
}

#[test]
fn options_of_the_service_keep_what_is_quoted_together() {
    for (options, words) in [
        (
            "--plan surge-4n --note 'still water'",
            &["--plan", "surge-4n", "--note", "still water"][..],
        ),
        (
            "--note \"50 % salt; $(reboot) & `date` > x | y *\"",
            &["--note", "50 % salt; $(reboot) & `date` > x | y *"][..],
        ),
        ("--note=\"it's cold\"", &["--note=it's cold"][..]),
        ("", &[][..]),
    ] {
        let given = started(options);
        let at = given.iter().position(|w| w == "60s").unwrap() + 1;
        let end = given.iter().position(|w| w == "--out").unwrap();
        assert_eq!(given[at..end], *words, "{options}");
        assert!(
            given[end + 1].starts_with("/var/lib/hydroline/20"),
            "{given:?}"
        );
        assert_eq!(given[0], "record");
    }
}

#[test]
fn the_service_starts_no_plan_again() {
    let unit = std::fs::read_to_string(file("hydroline.service")).unwrap();
    let of = |key: &str| {
        let line = unit
            .lines()
            .find_map(|l| l.strip_prefix(&format!("{key}=")));
        line.unwrap_or_else(|| panic!("no {key}")).to_owned()
    };
    // What is started again by itself finds the file of the first start in the unit's own folder.
    assert_eq!(of("RuntimeDirectoryPreserve"), "restart");
    let once = of("Environment");
    let folder = format!("HYDROLINE_PLAN_ONCE=%t/{}/", of("RuntimeDirectory"));
    assert!(once.starts_with(&folder), "{once}");
}

/// Without a plan there is nothing that must not be begun again, and a camera that dropped off its bus (1) may be back.
#[test]
fn a_service_that_only_records_is_started_again_after_a_lost_camera() {
    let unit = std::fs::read_to_string(file("hydroline.service")).unwrap();
    assert!(unit.lines().any(|l| l == "Restart=on-failure"));
    let prevented = unit
        .lines()
        .find_map(|l| l.strip_prefix("RestartPreventExitStatus="))
        .unwrap();
    // What is given (2) does not mend itself.
    assert_eq!(prevented, "2");
    // A run without a plan notes none: the start after it is like the first.
    let _alone = crate::support::alone();
    let dir = tempfile::tempdir().unwrap();
    let begun = dir.path().join("plan-begun");
    let output = crate::support::hydroline()
        .args(["record", "--rig", "lshpi", "--for", "200ms", "--out"])
        .arg(dir.path().join("run.mcap"))
        .env("HYDROLINE_PLAN_ONCE", &begun)
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(matches!(output.status.code(), Some(0 | 3)), "{said}");
    assert!(!begun.exists());
}

#[test]
fn a_service_over_a_bare_floor_begins_its_plan_and_warns() {
    let _alone = crate::support::alone();
    let dir = tempfile::tempdir().unwrap();
    let (plan, begun) = (dir.path().join("plan.toml"), dir.path().join("plan-begun"));
    std::fs::write(&plan, "[[step]]\nfor_s = 0.2\nwrench = { surge_n = 8.0 }\n").unwrap();
    let log = dir.path().join("service.mcap");
    let output = crate::support::hydroline()
        .args(["record", "--rig"])
        .arg(crate::support::bare_rig(dir.path()))
        .arg("--plan")
        .arg(&plan)
        .arg("--out")
        .arg(&log)
        .env("HYDROLINE_PLAN_ONCE", &begun)
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(matches!(output.status.code(), Some(0 | 3)), "{said}");
    assert!(said.contains("no target that would show"), "{said}");
    assert!(moved(&log), "{said}");
    // It was the one start: what comes next drives nothing.
    assert!(begun.exists());
}

/// Whether any thruster was commanded to push.
fn moved(log: &Path) -> bool {
    let (records, _) = crate::support::read(log);
    let pushes = |r: &hydroline::log::Record| matches!(r, hydroline::log::Record::Command(c) if c.pulse_us != 1500.0);
    records.iter().any(pushes)
}

#[test]
fn what_is_started_again_records_and_drives_nothing() {
    let _alone = crate::support::alone();
    let dir = tempfile::tempdir().unwrap();
    let (plan, begun) = (dir.path().join("plan.toml"), dir.path().join("plan-begun"));
    std::fs::write(&plan, "[[step]]\nfor_s = 0.2\nwrench = { surge_n = 8.0 }\n").unwrap();
    std::fs::write(&begun, "plan surge-4n\n").unwrap();
    let log = dir.path().join("again.mcap");
    let output = crate::support::hydroline()
        .args(["record", "--rig", "lshpi", "--plan"])
        .arg(&plan)
        .arg("--out")
        .arg(&log)
        .env("HYDROLINE_PLAN_ONCE", &begun)
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(matches!(output.status.code(), Some(0 | 3)), "{said}");
    assert!(said.contains("is not run"), "{said}");
    assert!(!moved(&log), "{said}");
    let (_, metadata) = crate::support::read(&log);
    let session = &metadata["session"];
    assert!(
        session["plan.withheld"].contains("systemctl stop"),
        "{session:?}"
    );
}

#[test]
fn systemd_rates_the_units_exposure() {
    let security = Command::new("systemd-analyze")
        .args(["security", "--offline=true", "--no-pager"])
        .arg(file("hydroline.service"))
        .output();
    let Ok(output) = security else {
        println!(
            "SKIPPED: service_files::systemd_rates_the_units_exposure: systemd-analyze is not installed"
        );
        return;
    };
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    let rated = said
        .lines()
        .find_map(|l| l.split_once("exposure level for hydroline.service: "))
        .unwrap_or_else(|| panic!("{said}{}", String::from_utf8_lossy(&output.stderr)));
    let exposure: f64 = rated.1.split_whitespace().next().unwrap().parse().unwrap();
    println!("exposure {exposure} of 10");
    assert!(exposure <= EXPOSURE_MAX, "{said}");
}
