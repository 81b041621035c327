use super::*;
use hydroline_calib::analytic::IdealMap;
use hydroline_calib::plane::PlaneMap;

fn calibration(date: &str, medium: Medium, board: &str) -> Calibration {
    let rig = Rig::builtin("lshpi").unwrap();
    Calibration {
        medium,
        date: Some(date.to_owned()),
        board: Some(board.to_owned()),
        image: Some(ImageSize::of(&rig.camera)),
        ..IdealMap::of(&rig).describe()
    }
}

fn wanted(medium: Medium, board: Option<&str>) -> Wanted {
    let rig = Rig::builtin("lshpi").unwrap();
    Wanted {
        camera: camera(&rig).unwrap(),
        image: ImageSize::of(&rig.camera),
        medium,
        board: board.map(str::to_owned),
    }
}

fn at(text: &str) -> SystemTime {
    humantime::parse_rfc3339(text).unwrap()
}

#[test]
fn the_latest_of_this_camera_and_medium_is_found_its_boards_first() {
    let dir = tempfile::tempdir().unwrap();
    let memory = Memory::from_variables(Some(dir.path().into()), None);
    let camera = wanted(Medium::Air, None).camera;
    let old = calibration("2026-03-01T10:00:00Z", Medium::Fresh, "dots-50");
    let new = calibration("2026-03-08T10:00:00Z", Medium::Fresh, "dots-50");
    let air = calibration("2026-03-09T10:00:00Z", Medium::Air, "dots-50");
    let other = calibration("2026-03-10T10:00:00Z", Medium::Fresh, "chess-25");
    // The newest is written first: a file's age says nothing.
    for kept in [&new, &old, &air, &other] {
        memory.keep(&camera, kept).unwrap();
    }
    memory.keep("by-id another", &new).unwrap();
    let now = at("2026-03-11T10:00:00Z");
    let find = |medium, board| memory.find(&wanted(medium, board), now);
    let (found, words) = find(Medium::Fresh, Some("dots-50"));
    let found = found.unwrap();
    assert_eq!(found.calibration, new);
    let [words] = words.as_slice() else {
        panic!("{words:?}")
    };
    for part in [
        "2026-03-08T10:00:00Z (3 days old)",
        "dots-50",
        "fresh",
        found.path.to_str().unwrap(),
        "--calibration FILE",
        "--no-remembered",
    ] {
        assert!(words.contains(part), "{part}: {words}");
    }
    // One of another board is taken where there is none of the rig's: the map is the camera's.
    let (of_another, words) = find(Medium::Fresh, Some("wc-lines-50"));
    assert_eq!(of_another.unwrap().calibration, other);
    assert!(words[0].contains("chess-25"), "{words:?}");
    // A rig that names no board takes any, and a file is a calibration like any other.
    assert_eq!(find(Medium::Fresh, None).0.unwrap().calibration, other);
    assert_eq!(Calibration::load(&found.path).unwrap(), new);
    // Of another medium none is taken, and what there is is said.
    let (none, words) = find(Medium::Salt, Some("dots-50"));
    assert!(none.is_none());
    assert!(
        words[0].contains("salt") && words[0].contains("in air"),
        "{words:?}"
    );
    let another = Wanted {
        camera: "by-id third".to_owned(),
        ..wanted(Medium::Fresh, None)
    };
    assert_eq!(memory.find(&another, now), (None, Vec::new()));
    let cropped = Wanted {
        image: ImageSize {
            width_px: 100,
            height_px: 100,
        },
        ..wanted(Medium::Fresh, None)
    };
    assert!(memory.find(&cropped, now).0.is_none());
}

#[test]
fn what_does_not_read_is_said_and_hinders_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let memory = Memory::from_variables(Some(dir.path().into()), None);
    let kept = calibration("2026-03-01T10:00:00Z", Medium::Air, "dots-50");
    let path = memory
        .keep(&wanted(Medium::Air, None).camera, &kept)
        .unwrap();
    std::fs::write(path.with_file_name("x.toml"), "garbage").unwrap();
    std::fs::write(path.with_file_name("y.toml"), kept.to_toml().unwrap()).unwrap();
    let now = at("2026-03-01T10:30:00Z");
    let (found, words) = memory.find(&wanted(Medium::Air, None), now);
    assert_eq!(found.unwrap().path, path);
    let words = words.join("\n");
    for part in ["x.toml", "y.toml", "30 min old"] {
        assert!(words.contains(part), "{part}: {words}");
    }
}

#[test]
fn the_folder_is_the_one_of_the_base_directories() {
    let folder = |data: Option<&str>, home: Option<&str>| {
        Memory::from_variables(data.map(Into::into), home.map(Into::into)).folder
    };
    let expected = |path: &str| Some(PathBuf::from(path));
    assert_eq!(
        folder(Some("/data"), Some("/home/me")),
        expected("/data/hydroline/calibrations")
    );
    for none in [None, Some(""), Some("relative")] {
        assert_eq!(
            folder(none, Some("/home/me")),
            expected("/home/me/.local/share/hydroline/calibrations")
        );
    }
    let nowhere = Memory::from_variables(None, None);
    let kept = calibration("2026-03-01T10:00:00Z", Medium::Air, "dots-50");
    let refused = nowhere.keep("c", &kept).unwrap_err().to_string();
    assert!(refused.contains("XDG_DATA_HOME"), "{refused}");
    // Where no file can be, the words name the place.
    let file = Memory::from_variables(Some("/dev/null".into()), None);
    let refused = file.keep("c", &kept).unwrap_err().to_string();
    assert!(refused.contains("/dev/null"), "{refused}");
}

/// They stayed for ever.
#[test]
fn calibrations_that_a_killed_command_left_unfinished_are_cleared() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("hydroline/calibrations");
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::write(folder.join(".hydroline-a1b2c3.part"), "half").unwrap();
    let memory = Memory::from_variables(Some(dir.path().into()), None);
    let camera = wanted(Medium::Air, None).camera;
    let found = calibration("2026-03-01T10:00:00Z", Medium::Fresh, "dots-50");
    let path = memory.keep(&camera, &found).unwrap();
    assert!(path.exists());
    assert_eq!(std::fs::read_dir(&folder).unwrap().count(), 1);
}
