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
