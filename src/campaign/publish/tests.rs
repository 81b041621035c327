use super::*;
use hydroline_core::build_info::BuildInfo;
use hydroline_daemon::simulate::{Options, simulate};
use hydroline_rigs::Plan;

fn log(folder: &Path, name: &str, plan: &str, rig: &Rig, start_unix_s: u64) -> Published {
    let path = folder.join(format!("{name}.mcap"));
    let options = Options {
        motion_only: true,
        position_noise_m: 1e-4,
        attitude_noise_rad: 1e-4,
        note: Some("=a note".to_owned()),
        build: BuildInfo::default(),
        start_unix_s,
        ..Options::default()
    };
    let plan = Plan::builtin(plan).unwrap();
    simulate(rig, &plan, &path, &options, &mut |_, _| {}).unwrap();
    Published::read(name, &path, rig).unwrap()
}

fn of<'a>(files: &'a [File], name: &str) -> &'a str {
    let (_, bytes) = files.iter().find(|f| f.0 == name).unwrap();
    std::str::from_utf8(bytes).unwrap()
}

fn rows(text: &str) -> (csv::StringRecord, Vec<csv::StringRecord>) {
    let mut reader = csv::Reader::from_reader(text.as_bytes());
    let head = reader.headers().unwrap().clone();
    (head, reader.records().map(Result::unwrap).collect())
}

#[test]
fn a_data_set_says_of_each_run_and_column_what_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let rig = Rig::builtin("lshpi").unwrap();
    let later = log(folder.path(), "b", "reversals", &rig, 1_777_000_100);
    let first = log(folder.path(), "a", "surge-8n", &rig, 1_777_000_000);
    let more = ("coefficients.csv".to_owned(), b"coefficient\n".to_vec());
    let about = About {
        title: "Two runs".to_owned(),
        licence: Some("CC-BY-4.0".to_owned()),
        ..About::default()
    };
    let files = files(&[later, first], &rig, &about, vec![more]).unwrap();

    let (head, runs) = rows(of(&files, "runs.csv"));
    let cell = |row: usize, name: &str| {
        let place = head.iter().position(|h| h == name);
        assert!(place.is_some(), "no column {name}");
        runs[row][place.unwrap()].to_owned()
    };
    let number = |row: usize, name: &str| cell(row, name).parse::<f64>().unwrap();
    // In the order of their starts, with the wait between them.
    assert_eq!((cell(0, "run"), cell(1, "run")), ("a".into(), "b".into()));
    assert_eq!(cell(0, "waiting_s"), "");
    let waited_s = 100.0 - number(0, "length_s");
    assert!((number(1, "waiting_s") - waited_s).abs() < 0.05);
    assert_eq!(cell(0, "kind"), "simulate");
    assert_eq!(cell(0, "plan"), "surge-8n");
    assert!(cell(0, "start_utc").starts_with("2026-04-24T"));
    assert_eq!(cell(0, "note"), "'=a note");
    assert!((number(0, "largest_surge_n") - 8.0).abs() < 0.1);
    assert!(number(1, "speed_surge_mps") > 0.05);
    // The CG 0.83 m above the floor in 1.5 m of water, y = 0 between walls at 2 m.
    assert!((number(0, "least_distance_floor_m") - 0.83).abs() < 0.01);
    assert!((number(0, "least_distance_surface_m") - 0.67).abs() < 0.01);
    assert!(number(0, "least_distance_wall_m") < 2.0);

    // Every column of runs.csv and of a table is in the dictionary, with a meaning.
    let (_, dictionary) = rows(of(&files, "columns.csv"));
    let (table, _) = rows(of(&files, "runs/a.csv"));
    for (file, name) in head
        .iter()
        .map(|h| ("runs.csv", h))
        .chain(table.iter().map(|h| ("runs/*.csv", h)))
    {
        let entry = dictionary.iter().find(|r| &r[0] == file && &r[1] == name);
        assert!(entry.is_some(), "{file} {name} is in no dictionary");
        assert!(!entry.unwrap()[3].is_empty(), "{name}");
    }

    let card = of(&files, "README.md");
    for words in [
        "# Two runs",
        "Licence: CC-BY-4.0",
        "All of them are simulated",
        "29.777",
        "coefficients.csv",
        "z **down**",
        "temperature of the water: not stated for 2 of 2 runs",
        "authors: not stated",
    ] {
        assert!(card.contains(words), "no {words:?} in\n{card}");
    }
    assert!(!card.contains("licence: not stated"));

    // Every file but the list itself has its checksum.
    let sums = of(&files, "SHA256SUMS");
    for (name, bytes) in files.iter().filter(|f| f.0 != "SHA256SUMS") {
        let digest = Sha256::digest(bytes);
        let hex: String = digest.iter().map(|b| format!("{b:02x}")).collect();
        assert!(sums.contains(&format!("{hex}  {name}\n")), "{name}");
    }
}

#[test]
fn another_group_finds_the_same_motion_in_the_tables() {
    let folder = tempfile::tempdir().unwrap();
    let rig = Rig::builtin("lshpi").unwrap();
    let run = log(folder.path(), "a", "surge-8n", &rig, 1_777_000_000);
    let again = Merged::read(&folder.path().join("a.mcap"), Some(&rig)).unwrap();
    let text = String::from_utf8(run.table.clone()).unwrap();
    let (head, records) = rows(&text);
    let x = head.iter().position(|h| h == "x_m").unwrap();
    assert_eq!(records.len(), run.rows);
    for (record, sample) in records.iter().zip(&again.run().samples) {
        assert_eq!(record[x].parse::<f64>().unwrap(), sample.values[Channel::X]);
    }
}
