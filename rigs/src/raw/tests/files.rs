//! Included files, plans, targets and boards.

use super::tells;
use crate::{Board, Plan, Rig, Target};

#[test]
fn mistakes_in_an_included_file_name_that_file() {
    let folder = tempfile_dir();
    std::fs::create_dir_all(folder.join("targets")).unwrap();
    let target = include_str!("../../../targets/hexagons.toml");
    let rig_path = folder.join("rig.toml");
    std::fs::write(&rig_path, include_str!("../../../lshpi.toml")).unwrap();
    let missing = Rig::load(&rig_path).expect_err("no target file yet");
    tells(
        &missing,
        &["rig.toml", "target", "hexagons.toml", "builtin:hexagons"],
    );
    std::fs::write(folder.join("targets/hexagons.toml"), target).unwrap();
    assert_eq!(
        Rig::load(&rig_path).unwrap(),
        Rig::builtin("lshpi").unwrap()
    );
    std::fs::write(
        folder.join("targets/hexagons.toml"),
        target.replace("count = 6", "count = 0"),
    )
    .unwrap();
    let wrong = Rig::load(&rig_path).expect_err("no hexagons");
    tells(&wrong, &["targets/hexagons.toml:", "slab[1].count", "is 0"]);
    std::fs::write(&rig_path, [0xff, 0xfe, 0x00]).unwrap();
    tells(
        &Rig::load(&rig_path).expect_err("binary"),
        &["rig.toml", "not UTF-8"],
    );
    tells(
        &Rig::load(&folder).expect_err("a folder"),
        &["cannot be read"],
    );
    tells(
        &Rig::load_or_builtin("lshp").expect_err("name"),
        &["did you mean `lshpi`", "bench-v4l"],
    );
    tells(
        &Rig::load_or_builtin("no/such.toml").expect_err("path"),
        &["no/such.toml", "cannot be read"],
    );
    std::fs::remove_dir_all(&folder).unwrap();
}

fn tempfile_dir() -> std::path::PathBuf {
    let folder = std::env::temp_dir().join(format!("hydroline-rigs-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

#[test]
fn a_rig_may_place_its_target() {
    let text = include_str!("../../../lshpi.toml")
        .replace("origin_m = [0.0, 0.0]", "origin_m = [0.5, -0.1]")
        .replace("heading_deg = 0 ", "heading_deg = 4 ");
    let target = Rig::from_toml(&text, "a", None).unwrap().target.unwrap();
    assert_eq!(target.origin, [0.5, -0.1, 4_f64.to_radians()]);
    let text = include_str!("../../../lshpi.toml")
        .replace("[rig]", "target = \"builtin:sway-board\"\n[rig]")
        .replace("[target]\nfile", "[other]\nfile");
    let error = Rig::from_toml(&text, "a", None).expect_err("an unknown table");
    tells(&error, &["other: unknown key"]);
}

#[test]
fn plans_that_make_no_sense() {
    for (text, words) in [
        ("", &["step: missing"][..]),
        ("name = \"x\"\nstep = []", &["step"]),
        (
            "[[step]]\nfor_s = -1\nwrench = {}",
            &["step[0].for_s", "is -1", "above 0"],
        ),
        ("[[step]]\nfor_s = 0\nwrench = {}", &["step[0].for_s"]),
        ("[[step]]\nwrench = {}", &["step[0].for_s: missing"]),
        ("[[step]]\nfor_s = 1", &["step[0].wrench: missing"]),
        (
            "[[step]]\nfor_s = 1\nwrench = {}\nthrust_n = {}",
            &["step[0].thrust_n", "both given"],
        ),
        (
            "[[step]]\nfor_s = 1\nwrench = { surge = 1 }",
            &[
                "step[0].wrench.surge: unknown key",
                "did you mean `surge_n`",
            ],
        ),
        (
            "[[step]]\nfor_s = 1\nwrench = { surge_n = inf }",
            &["step[0].wrench.surge_n"],
        ),
        (
            "[[step]]\nfor_s = 1\nwrench = {}\nshape = \"sine\"",
            &["step[0].period_s: missing"],
        ),
        (
            "[[step]]\nfor_s = 1\nwrench = {}\nshape = \"chirp\"\nf0_hz = 1",
            &["step[0].f1_hz: missing"],
        ),
        (
            "[[step]]\nfor_s = 1\nwrench = {}\nperiod_s = 2",
            &["step[0].period_s", "shape = \"sine\" only"],
        ),
        (
            "[[step]]\nfor_s = 1\nwrench = {}\nshape = \"sin\"\nperiod_s = 1",
            &["step[0].shape", "did you mean `sine`"],
        ),
        (
            "[[step]]\nfor_s = 1\nwrench = {}\n[[step]]\nfor_s = 1\nshape = \"ramp\"\nthrust_n = { a = 1 }",
            &["step[1].shape", "ramp"],
        ),
        (
            "[[step]]\nfor_s = 1\nthrust_n = { \"a b\" = 1 }",
            &["step[0].thrust_n.a b"],
        ),
        (
            "[[step]]\nfor_s = 1\nwrench = {}\nfors = 2",
            &["step[0].fors: unknown key"],
        ),
    ] {
        tells(&Plan::from_toml(text, "p.toml").expect_err(text), words);
    }
    let unnamed = Plan::from_toml("[[step]]\nfor_s = 1\nwrench = {}", "plans/my-run.toml").unwrap();
    assert_eq!(
        (unnamed.name.as_str(), unnamed.duration_s()),
        ("my-run", 1.0)
    );
}

#[test]
fn targets_and_boards_that_make_no_sense() {
    let polygon = |points: &str| {
        format!(
            "name = \"t\"\n[[slab]]\nname = \"s\"\nshape = \"polygon\"\ntop_m = 0.1\npoints_m = {points}"
        )
    };
    Target::from_toml(
        &polygon("[[0, 0], [1, 0], [1, 1], [0.5, 0.2], [0, 1]]"),
        "t",
    )
    .unwrap();
    Target::from_toml(&polygon("[[0, 0], [1, 0], [0, 1]]"), "t").unwrap();
    for (points, word) in [
        ("[[0, 0], [1, 1], [1, 0], [0, 1]]", "meets side"),
        ("[[0, 0], [1, 0], [0.5, 0]]", "meets side"),
        ("[[0, 0], [0, 0], [1, 0], [1, 1]]", "meets side"),
        ("[[0, 0], [2, 0], [2, 1], [1, 0], [0, 1]]", "meets side"),
        ("[[0, 0], [1, 0]]", "3 to 1000 corners"),
        ("[[0, 0], [1, 0], [1]]", "points_m[2]"),
        ("[[0, 0], [1, 0], [1, nan]]", "points_m[2][1]"),
    ] {
        tells(
            &Target::from_toml(&polygon(points), "t").expect_err(points),
            &["slab[0].points_m", word],
        );
    }
    let target = include_str!("../../../targets/hexagons.toml");
    for (from, to, words) in [
        (
            "x0_m = 0.0\nx1_m",
            "x0_m = 9.0\nx1_m",
            &["slab[0].x1_m", "before its start"][..],
        ),
        (
            "name = \"hexagons\"\nshape",
            "name = \"board\"\nshape",
            &["slab[1].name", "twice"],
        ),
        (
            "side_m = 0.12",
            "width_m = 0.12",
            &["slab[1].side_m: missing", "slab[1].width_m: unknown"],
        ),
        (
            "shape = \"hexagon_chain\"",
            "shape = \"hexagons\"",
            &["slab[1].shape"],
        ),
    ] {
        assert!(target.contains(from), "{from}");
        tells(
            &Target::from_toml(&target.replace(from, to), "t").expect_err(to),
            words,
        );
    }
    let board = include_str!("../../../boards/wc-lines-50.toml");
    for (from, to, words) in [
        ("line_m = 0.002", "line_m = 0.06", &["line_m", "pitch"][..]),
        (
            "line_m = 0.002",
            "diameter_m = 0.002",
            &["line_m: missing", "diameter_m: unknown"],
        ),
        ("columns = 11", "columns = 1", &["columns", "from 2 to 200"]),
        ("height_m = 0.010", "height_m = 0", &["block[0].height_m"]),
    ] {
        assert!(board.contains(from), "{from}");
        tells(
            &Board::from_toml(&board.replacen(from, to, 1), "b").expect_err(to),
            words,
        );
    }
    let board = include_str!("../../../boards/charuco-25.toml");
    for (from, to, words) in [
        (
            "marker_m = 0.018",
            "marker_m = 0.025",
            &["marker_m", "pitch"][..],
        ),
        (
            "\"DICT_4X4_100\"\n",
            "\"DICT_4X4_50\"\n",
            &["dictionary", "82 light squares", "50 markers"],
        ),
        (
            "\"DICT_4X4_100\"\n",
            "\"DICT_4X4_10\"\n",
            &["dictionary", "DICT_4X4_1000"],
        ),
    ] {
        assert!(board.contains(from), "{from}");
        tells(
            &Board::from_toml(&board.replacen(from, to, 1), "b").expect_err(to),
            words,
        );
    }
}

#[test]
fn what_an_identification_left_is_read_back_and_held_against_itself() {
    let mut rig = Rig::builtin("lshpi").unwrap();
    assert!(rig.identified.is_none());
    rig.identified = Some(crate::Identified {
        coefficients: vec!["x_udot".into(), "x_u".into()],
        values: vec![-250.25, -20.125],
        sd: vec![1.5, 0.1],
        covariance: vec![vec![2.25, -0.01], vec![-0.01, 0.01]],
        source: None,
    });
    let text = rig.to_toml();
    let read = Rig::from_toml(&text, "r.toml", None).unwrap();
    assert_eq!(read.identified, rig.identified);
    for (was, is, words) in [
        ("[1.5, 0.1]", "[1.5]", "2 coefficients need 2 values"),
        ("[2.25, -0.01]", "[-2.25, -0.01]", "negative"),
        ("\"x_u\"]", "7]", "name"),
        ("values = [", "valeus = [", "valeus"),
    ] {
        assert!(text.contains(was), "{was}: {text}");
        let wrong = Rig::from_toml(&text.replace(was, is), "r.toml", None).expect_err(words);
        tells(&wrong, &["identified", words]);
    }
}
