//! Tables as instruments and programs write them: each comes in with a short map, and as it is.
//!
//! The files are those of `reports/tables` of the full set; the same kinds, made in memory, stand beside the reader.

use std::collections::BTreeMap;
use std::path::Path;

use super::inputs::full;
use crate::guess::guess;
use crate::{Imported, Map, Severity, TableFile, read_table};

/// A table read by a map.
fn read(table: &Path, toml: &str) -> Imported {
    let map =
        Map::from_toml(toml, "map.toml").unwrap_or_else(|e| panic!("{}: {e}", table.display()));
    let found = read_table(&TableFile::open(table).unwrap(), &map, None).unwrap();
    for f in &found.findings {
        println!("  {:?} {}: {}", f.severity, f.kind, f.message);
    }
    found
}

const XF: &str = "[motion.x_m]\ncolumn = \"x\"\nunit = \"m\"\n[[command]]\nthruster = \"surge\"\ncolumn = \"F\"\n";
const T: &str = "[time]\ncolumn = \"t\"\nunit = \"s\"\n";

/// Values of which the folders' files were made: x \[m\] and F \[N\] at each hundredth of a second.
fn clean(folder: &Path) -> BTreeMap<i64, (f64, f64)> {
    let toml = format!("[file]\ncomment = \"#\"\n{T}{XF}");
    let data = read(&folder.join("comment-lines/data.csv"), &toml);
    let row = |k: usize| {
        (
            (100.0 * data.times_s[k]).round() as i64,
            (data.motion[0][k], data.commands[0][k]),
        )
    };
    (0..data.times_s.len()).map(row).collect()
}

/// x and F of a table against the clean ones, to the printed digits; how many rows both have.
fn same(data: &Imported, clean: &BTreeMap<i64, (f64, f64)>, offset_m: f64, digit_m: f64) -> usize {
    let mut rows = 0;
    for (k, t_s) in data.times_s.iter().enumerate() {
        assert!(
            (100.0 * t_s - (100.0 * t_s).round()).abs() < 1e-7,
            "row {k} at {t_s} s"
        );
        let Some((x, f)) = clean.get(&((100.0 * t_s).round() as i64)) else {
            continue;
        };
        let own = data.motion[0][k] - offset_m;
        assert!(
            (own - x).abs() <= 0.51 * digit_m + 1e-12,
            "row {k}: {own} for {x}"
        );
        if let Some(load) = data.commands.first() {
            assert_eq!(load[k], *f, "row {k}");
        }
        rows += 1;
    }
    rows
}

/// (folder/file, map, offset of x, its last digit, fewest rows), sound and equal to the clean data.
const SOUND: &[(&str, &str, f64, f64, usize)] = &[
    (
        "duplicate-header/data.csv",
        "[motion.x_m]\ncolumn = \"x\"\nnth = 1\nunit = \"m\"\n[[command]]\nthruster = \"surge\"\ncolumn = \"F\"\n[time]\ncolumn = \"t\"\nunit = \"s\"\n",
        0.0,
        1e-6,
        1900,
    ),
    (
        "duplicate-header/data.csv",
        "[motion.x_m]\ncolumn = 3\nunit = \"m\"\n[[command]]\nthruster = \"surge\"\ncolumn = \"F\"\n[time]\ncolumn = \"t\"\nunit = \"s\"\n",
        0.4,
        1e-6,
        1900,
    ),
    (
        "excel-sep-line/data.csv",
        "[file]\nseparator = \";\"\ndecimal = \",\"\n[time]\ncolumn = \"t\"\nunit = \"s\"\n[motion.x_m]\ncolumn = \"x\"\nunit = \"m\"\n[[command]]\nthruster = \"surge\"\ncolumn = \"F\"\n",
        0.0,
        1e-6,
        2500,
    ),
    (
        "trailing-comma-rows/data.csv",
        "[time]\ncolumn = \"t\"\nunit = \"s\"\n[motion.x_m]\ncolumn = \"x\"\nunit = \"m\"\n[[command]]\nthruster = \"surge\"\ncolumn = \"F\"\n",
        0.0,
        1e-6,
        2500,
    ),
    (
        "trailing-comma-header/data.csv",
        "[time]\ncolumn = \"t\"\nunit = \"s\"\n[motion.x_m]\ncolumn = \"x\"\nunit = \"m\"\n[[command]]\nthruster = \"surge\"\ncolumn = \"F\"\n",
        0.0,
        1e-6,
        2500,
    ),
    (
        "units-row/data.csv",
        "[file]\nunits_line = 2\n[time]\ncolumn = \"t\"\nunit = \"s\"\n[motion.x_m]\ncolumn = \"x\"\nunit = \"m\"\n[[command]]\nthruster = \"surge\"\ncolumn = \"F\"\n",
        0.0,
        1e-6,
        2500,
    ),
    (
        "date-and-time-columns/data.csv",
        "[time]\ncolumns = [\"Date\", \"Time\"]\nunit = \"iso8601\"\n[motion.x_m]\ncolumn = \"x\"\nunit = \"m\"\n[[command]]\nthruster = \"surge\"\ncolumn = \"F\"\n",
        0.0,
        1e-6,
        1400,
    ),
    (
        "micros-wrap/data.csv",
        "[time]\ncolumn = \"t\"\nunit = \"us\"\nunwrap = 32\n[motion.x_m]\ncolumn = \"x\"\nunit = \"m\"\n[[command]]\nthruster = \"surge\"\ncolumn = \"F\"\n",
        0.0,
        1e-6,
        2300,
    ),
    (
        "labview-lvm/data.lvm",
        "[file]\nseparator = \"\\t\"\ndecimal = \",\"\nheader_line = 22\n[time]\ncolumn = \"X_Value\"\nunit = \"s\"\n[motion.x_m]\ncolumn = \"Position\"\nunit = \"m\"\n[[command]]\nthruster = \"surge\"\ncolumn = \"Force\"\n",
        0.0,
        1e-6,
        2200,
    ),
    (
        "vicon-nexus/data.csv",
        "[file]\nheader_line = 4\nunits_line = 5\n[time]\ncolumn = \"Frame\"\nrate_hz = 100\n[motion.x_m]\ncolumn = \"X\"\nnth = 1\nunit = \"mm\"\n",
        0.2,
        1e-6,
        1100,
    ),
    (
        "qtm-6d-header/data.tsv",
        "[file]\nseparator = \"\\t\"\nheader_line = 11\n[time]\ncolumn = \"Time\"\nunit = \"s\"\n[motion.x_m]\ncolumn = \"AUV X\"\nunit = \"mm\"\n[motion.phi_rad]\ncolumn = \"Roll\"\nunit = \"deg\"\n",
        1.5,
        1e-6,
        980,
    ),
    (
        "ros2-topic-echo-csv/data.csv",
        "[file]\nheader = false\n[time]\ncolumns = [1, 2]\nunit = [\"s\", \"ns\"]\nclock = \"unix\"\n[motion.x_m]\ncolumn = 5\nunit = \"m\"\n[quaternion]\ncolumns = [8, 9, 10, 11]\norder = \"xyzw\"\n",
        0.0,
        1e-6,
        440,
    ),
];

#[test]
fn every_layout_comes_in_with_a_short_map() {
    let Some(folder) = full("reports/tables") else {
        return;
    };
    let clean = clean(&folder);
    assert!(clean.len() > 2700);
    for (file, toml, offset_m, digit_m, least) in SOUND {
        println!("{file}");
        assert!(toml.lines().count() <= 17, "{file}");
        let data = read(&folder.join(file), toml);
        assert!(!data.has_faults(), "{file}");
        let rows = same(&data, &clean, *offset_m, *digit_m);
        assert!(rows >= *least, "{file}: {rows}");
    }
}

#[test]
fn sparse_rounded_long_and_foreign_units_are_no_faults() {
    let Some(folder) = full("reports/tables") else {
        return;
    };
    let clean = clean(&folder);
    let sparse = "[time]\ncolumn = \"__time\"\nunit = \"s\"\nclock = \"unix\"\n[motion.x_m]\ncolumn = \"/odom/pose/position/x\"\nunit = \"m\"\nmissing = \"skip\"\n[[command]]\nthruster = \"surge\"\ncolumn = \"/cmd/surge\"\nmissing = \"hold\"\n";
    let data = read(&folder.join("plotjuggler-sparse/data.csv"), sparse);
    assert!(!data.has_faults());
    let mut seen = 0;
    for (k, x) in data.motion[0]
        .iter()
        .enumerate()
        .filter(|p| p.1.is_finite())
    {
        let own = clean
            .get(&((100.0 * data.times_s[k]).round() as i64))
            .unwrap();
        assert!((x - own.0).abs() < 1e-9);
        seen += 1;
    }
    assert!(seen > 1800 && seen < data.times_s.len());

    let rounded = format!("[time]\ncolumn = \"t\"\nunit = \"s\"\nrate_hz = 120\n{XF}");
    let data = read(&folder.join("rounded-stamps/data.csv"), &rounded);
    assert!(!data.has_faults());
    for (k, t_s) in data.times_s.iter().enumerate() {
        assert!((t_s - k as f64 / 120.0).abs() < 2e-9, "row {k} at {t_s}");
    }

    let long = format!("{T}[motion.x_m]\ncolumn = \"x\"\nunit = \"m\"\n");
    assert!(!read(&folder.join("auv-survey-1km/data.csv"), &long).has_faults());

    let knots = format!("{T}[motion.u_mps]\ncolumn = \"u\"\nunit = \"kn\"\n");
    let data = read(&folder.join("units-knots-feet/data.csv"), &knots);
    assert!(!data.has_faults());
    assert!((data.motion[6][0] - 0.002_920 * 1852.0 / 3600.0).abs() < 1e-12);

    for (file, command) in [("mocap", false), ("thruster", true)] {
        let toml = std::fs::read_to_string(folder.join(format!("two-files/{file}.toml"))).unwrap();
        let data = read(&folder.join(format!("two-files/{file}.csv")), &toml);
        assert!(!data.has_faults() && data.commands.len() == usize::from(command));
    }
}

#[test]
fn lost_bodies_are_faults_and_lines_are_the_editors() {
    let Some(folder) = full("reports/tables") else {
        return;
    };
    let toml = |name: &str| std::fs::read_to_string(folder.join(name).join("map.toml")).unwrap();
    let data = read(
        &folder.join("zeros-for-a-lost-body/data.csv"),
        &toml("zeros-for-a-lost-body"),
    );
    let zeros = data.findings.iter().find(|f| f.kind == "zeros").unwrap();
    assert_eq!((zeros.severity, zeros.line), (Severity::Fault, Some(2002)));
    // With the loss accepted they are lost, not zero.
    assert!(data.motion[0].iter().all(|x| *x != 0.0));
    for (file, line) in [
        ("lf", 22),
        ("crlf", 22),
        ("blank", 24),
        ("blank-before", 25),
    ] {
        let data = read(
            &folder.join(format!("line-numbers/{file}.csv")),
            &toml("line-numbers"),
        );
        let bad = data
            .findings
            .iter()
            .find(|f| f.kind == "not_a_number")
            .unwrap();
        assert_eq!(bad.line, Some(line), "{file}");
    }
}

/// A guessed map loads unchanged; of the layouts that need a map it is the right one.
#[test]
fn guessed_maps_are_right_without_an_edit() {
    let Some(folder) = full("reports/tables") else {
        return;
    };
    let clean = clean(&folder);
    for (file, offset_m) in [
        ("vicon-nexus/data.csv", 0.2),
        ("qtm-6d-header/data.tsv", 1.5),
        ("labview-lvm/data.lvm", 0.0),
        ("ros2-topic-echo-csv/data.csv", 0.0),
        ("trailing-comma-rows/data.csv", 0.0),
        ("trailing-comma-header/data.csv", 0.0),
        ("date-and-time-columns/data.csv", 0.0),
        ("comment-lines/data.csv", 0.0),
        ("excel-sep-line/data.csv", 0.0),
        ("units-row/data.csv", 0.0),
        ("micros-wrap/data.csv", 0.0),
        ("duplicate-header/data.csv", 0.0),
    ] {
        let path = folder.join(file);
        let found = guess(&TableFile::open(&path).unwrap()).unwrap().unwrap();
        println!("== {file}: {}\n{}", found.kind, found.toml);
        for remark in &found.remarks {
            println!("  > {remark}");
        }
        let data = read(&path, &found.toml);
        assert!(!data.has_faults(), "{file}");
        assert!(same(&data, &clean, offset_m, 1e-6) > 400, "{file}");
    }
}

/// Sound recordings of real instruments have no fault of lost or spoilt data.
#[test]
fn real_recordings_are_sound() {
    let roll = "[time]\ncolumn = \"time\"\nunit = \"s\"\n[motion.phi_rad]\ncolumn = \"phi\"\nunit = \"rad\"\n";
    let drive = "[time]\ncolumn = \"time_exp\"\nunit = \"s\"\n[motion.x_m]\ncolumn = \"q_meas\"\nunit = \"m\"\n[motion.u_mps]\ncolumn = \"v_est\"\nunit = \"m/s\"\n[[command]]\nthruster = \"surge\"\ncolumn = \"u_in\"\n";
    // Notes before, a degree sign in Latin-1, no names, runs of blanks.
    let zigzag = "[file]\nseparator = \"blanks\"\nheader = false\nfirst_line = 5\nencoding = \"latin1\"\n[time]\ncolumn = 1\nunit = \"s\"\n[motion.x_m]\ncolumn = 2\nunit = \"m\"\n[motion.u_mps]\ncolumn = 5\nunit = \"m/s\"\n";
    for (file, toml) in [
        (
            "cases/real/hsva-zigzag/HSVA_CPMC_KVLCC2_Z_10_05.dat",
            zigzag,
        ),
        ("cases/real/roll-decay/model_test_21338.csv", roll),
        ("cases/real/emps/DATA_EMPS_SC.csv", drive),
    ] {
        let Some(path) = super::inputs::input(file) else {
            continue;
        };
        assert!(!read(&path, toml).has_faults(), "{file}");
    }
}

/// Memory and time of a large table: `HYDROLINE_TABLE` names one with columns t x y z roll pitch yaw F.
#[test]
#[ignore = "needs a large table"]
fn a_large_table_is_streamed() {
    let Some(path) = std::env::var_os("HYDROLINE_TABLE") else {
        return;
    };
    let start = std::time::Instant::now();
    let table = TableFile::open(Path::new(&path)).unwrap();
    let angle = |name: &str, column: &str| {
        format!("[motion.{name}]\ncolumn = \"{column}\"\nunit = \"rad\"\n")
    };
    let length = |name: &str, column: &str| {
        format!("[motion.{name}]\ncolumn = \"{column}\"\nunit = \"m\"\n")
    };
    let toml = format!(
        "{T}{}{}{}{}{}{}[[command]]\nthruster = \"surge\"\ncolumn = \"F\"\n",
        length("x_m", "x"),
        length("y_m", "y"),
        length("z_m", "z"),
        angle("phi_rad", "roll"),
        angle("theta_rad", "pitch"),
        angle("psi_rad", "yaw")
    );
    let map = Map::from_toml(&toml, "m").unwrap();
    let found = crate::survey(&table, &map, None).unwrap();
    println!("surveyed in {:?}: {:?}", start.elapsed(), found.findings);
    let folder = tempfile::tempdir().unwrap();
    let options = crate::Options::default();
    let outcome = crate::import_table(
        &table,
        &found,
        &map,
        "",
        None,
        &folder.path().join("o.mcap"),
        options,
    )
    .unwrap();
    println!(
        "{} samples, {} commands in {:?}",
        outcome.samples,
        outcome.commands,
        start.elapsed()
    );
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    println!(
        "{}",
        status.lines().find(|l| l.starts_with("VmHWM")).unwrap()
    );
}
