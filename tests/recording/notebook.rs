//! The guide's notebook runs on a log, and `export --merged` says the same as it does.

use std::path::Path;
use std::process::Command;

use crate::support::hydroline;

fn run(words: &[&str]) -> String {
    let out = hydroline().args(words).output().unwrap();
    let said = String::from_utf8_lossy(&out.stderr).into_owned();
    assert_eq!(out.status.code(), Some(0), "{words:?}: {said}");
    String::from_utf8_lossy(&out.stdout).into_owned()
}

#[test]
fn the_notebook_reads_a_log_as_the_merged_table_has_it() {
    let dir = tempfile::tempdir().unwrap();
    let (log, table) = (dir.path().join("run.mcap"), dir.path().join("run.csv"));
    let path = log.to_str().unwrap();
    run(&[
        "simulate",
        "--rig",
        "lshpi",
        "--plan",
        "surge-4n",
        "--motion-only",
        "--out",
        path,
    ]);
    run(&["export", path, "--merged"]);
    let text = std::fs::read_to_string(&table).unwrap();
    let header: Vec<&str> = text.lines().next().unwrap().split(',').collect();
    for name in [
        "t_s",
        "x_m",
        "x_sd_m",
        "psi_sd_rad",
        "u_mps",
        "surge_n",
        "flags",
    ] {
        assert!(header.contains(&name), "{name} in {header:?}");
    }
    for row in text.lines() {
        assert_eq!(row.split(',').count(), header.len(), "{row}");
        assert!(!row.contains("NaN") && !row.contains("inf"), "{row}");
    }

    let Some(python) = crate::inputs::python(&["pandas", "mcap_protobuf"]) else {
        return;
    };
    let notebook = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/guide/read-a-log.ipynb");
    let notebook: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(notebook).unwrap()).unwrap();
    let mut script = String::new();
    for cell in notebook["cells"].as_array().unwrap() {
        if cell["cell_type"] == "code" {
            for line in cell["source"].as_array().unwrap() {
                script += line.as_str().unwrap();
            }
            script.push('\n');
        }
    }
    // Held against the table: rows, places, and the thrust in force where it holds until the next row (else the table has its mean).
    script += "\nimport sys\nother = pd.read_csv(sys.argv[1])\n\
        assert len(other) == len(merged) and len(other) > 100\n\
        assert (other['timestamp_ns'].to_numpy() == merged['timestamp_ns'].to_numpy()).all()\n\
        for name in ['x_m', 'y_m', 'psi_rad']:\n    assert (other[name].to_numpy() == merged[name].to_numpy()).all(), name\n\
        for name in wide.columns[1:]:\n    a, b = other[f'thrust_{name}_n'], merged[name]\n    holds = b == b.shift(-1)\n    assert holds.sum() > 0.9 * len(b) and (a[holds] == b[holds]).all(), name\n";
    let out = Command::new(&python)
        .args(["-c", &script])
        .arg(&table)
        .env("HYDROLINE_LOG", &log)
        .output()
        .unwrap();
    assert!(
        out.status.success(),
        "{}",
        String::from_utf8_lossy(&out.stderr)
    );
}
