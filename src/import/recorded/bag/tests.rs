use super::*;
use crate::check::Severity;

fn bag(text: &str, parts: &[(&str, u64)]) -> Bag {
    let mut bag = Bag {
        stated: (!text.is_empty()).then(|| Stated::read(text)),
        ..Bag::default()
    };
    for (name, count) in parts {
        let own = [("/pose", *count), ("/cmd", *count)].map(|(t, n)| (t.to_owned(), n));
        bag.add(Path::new(name), own.into_iter().collect());
    }
    bag
}

fn said(bag: &Bag, mapped: Option<&[&str]>) -> Vec<(Severity, &'static str, String)> {
    let mapped: Option<Vec<String>> = mapped.map(|m| m.iter().map(|t| (*t).to_owned()).collect());
    let found = bag.findings(mapped.as_deref());
    found
        .into_iter()
        .map(|f| (f.severity, f.kind, f.message))
        .collect()
}

const TOTAL: &str = "rosbag2_bagfile_information:\n  message_count: 60\n  relative_file_paths: [r_0.mcap, r_1.mcap, old/r_2.mcap.zstd]\n";

/// Files of these names, one message in each topic.
fn of<'a>(names: &[&'a str]) -> Vec<(&'a str, u64)> {
    names.iter().map(|n| (*n, 1)).collect()
}

fn by_topic(pose: u64, cmd: u64) -> String {
    format!(
        "{TOTAL}  topics_with_message_count:\n  - topic_metadata: {{name: /pose}}\n    message_count: {pose}\n  - topic_metadata: {{name: /cmd}}\n    message_count: {cmd}\n"
    )
}

#[test]
fn a_bag_that_is_as_its_account_says_has_no_finding() {
    let whole = [("r_0.mcap", 10), ("r_1.mcap", 10), ("r_2.mcap", 10)];
    for text in [TOTAL, &by_topic(30, 30)] {
        assert_eq!(said(&bag(text, &whole), Some(&["/pose"])), []);
    }
    assert_eq!(
        bag(TOTAL, &[]).place_of(Path::new("x/r_2.mcap.zstd")),
        Some(2)
    );
}

#[test]
fn a_part_that_is_missing_was_a_gap_without_a_name() {
    let two = [("r_0.mcap", 10), ("r_2.mcap", 10)];
    for (text, mapped) in [
        (TOTAL.to_owned(), Some(&["/pose"][..])),
        (by_topic(30, 30), Some(&["/pose"])),
        (TOTAL.to_owned(), None),
        (
            TOTAL.replace("message_count: 60", "version: 4"),
            Some(&["/pose"]),
        ),
    ] {
        let found = said(&bag(&text, &two), mapped);
        let [(Severity::Fault, "missing_parts", words)] = &found[..] else {
            panic!("{found:?}");
        };
        assert!(words.contains("r_1.mcap"), "{words}");
    }
    // It holds nothing of what the map names; the files have other names.
    let found = said(&bag(&by_topic(20, 30), &two), Some(&["/pose"]));
    assert!(matches!(found[..], [(Severity::Warning, ..)]), "{found:?}");
    let renamed = [("a.mcap", 10), ("b.mcap", 10), ("c.mcap", 10)];
    let found = said(&bag(TOTAL, &renamed), Some(&["/pose"]));
    assert!(
        matches!(found[..], [(Severity::Warning, "renamed_parts", _)]),
        "{found:?}"
    );
}

#[test]
fn counts_beyond_what_is_there_passed_without_a_word() {
    let cut = [("r_0.mcap", 10), ("r_1.mcap", 4), ("r_2.mcap", 10)];
    let text = format!("{TOTAL}  files:\n  - path: r_1.mcap\n    message_count: 20\n");
    for mapped in [None, Some(&["/pose"][..])] {
        let found = said(&bag(&text, &cut), mapped);
        let [(Severity::Fault, "missing_messages", words)] = &found[..] else {
            panic!("{found:?}");
        };
        for word in ["60", "48", "12 are lost", "r_1.mcap: 8 of 20"] {
            assert!(words.contains(word), "{word}: {words}");
        }
    }
    let found = said(&bag(&by_topic(24, 36), &cut), Some(&["/pose"]));
    assert!(
        matches!(found[..], [(Severity::Warning, "missing_messages", _)]),
        "{found:?}"
    );
    let found = said(&bag(&by_topic(24, 36), &cut), Some(&["/cmd[a]"]));
    assert!(matches!(found[..], [(Severity::Fault, ..)]), "{found:?}");
    // More than it counts is no loss.
    let more = [
        ("r_0.mcap", 10),
        ("r_1.mcap", 10),
        ("r_2.mcap", 10),
        ("x.mcap", 9),
    ];
    let found = said(&bag(TOTAL, &more), Some(&["/pose"]));
    let [(Severity::Warning, "bag_metadata", words)] = &found[..] else {
        panic!("{found:?}");
    };
    assert!(words.contains("x.mcap"), "{words}");
}

#[test]
fn an_account_that_cannot_be_read_is_said_and_nothing_more() {
    for text in ["rosbag2: 1\n", "a: [\n"] {
        let found = said(&bag(text, &[("r_0.mcap", 1)]), None);
        assert!(
            matches!(found[..], [(Severity::Warning, "bag_metadata", _)]),
            "{found:?}"
        );
    }
}

#[test]
fn a_gap_in_the_numbers_of_parts_without_an_account_passed() {
    for (names, gone) in [
        (&["r_0.mcap", "r_1.mcap", "r_3.mcap"][..], "part(s) 2 "),
        (&["r.db3", "r_1.db3", "r_4.db3"], "part(s) 2, 3 "),
        (
            &[
                "0_r_2026_05_04-09_00_00.mcap",
                "2_r_2026_05_04-09_02_00.mcap",
            ],
            "part(s) 1 ",
        ),
    ] {
        let found = said(&bag("", &of(names)), None);
        let [(Severity::Fault, "missing_parts", words)] = &found[..] else {
            panic!("{names:?}: {found:?}");
        };
        assert!(words.contains(gone), "{words}");
    }
    for names in [
        &["r_0.mcap", "r_1.mcap", "r_2.mcap"][..],
        &["r.mcap", "r_1.mcap"],
        &["r_7.mcap"],
        &["tank_20260504.mcap", "tank_20260505.mcap"],
        &["run_2026_05_14.mcap", "run_2026_05_15.mcap"],
        &["run_2026_05_04.mcap", "run_2026_05_09.mcap"],
        &["2026_05_04.mcap", "2026_06_11.mcap"],
        &["a_1.mcap", "b_3.mcap"],
        &["tank.mcap", "lake.mcap"],
        &[
            "0_r_2026_05_04-09_00_00.mcap",
            "1_r_2026_05_04-09_02_00.mcap",
        ],
    ] {
        assert_eq!(said(&bag("", &of(names)), None), [], "{names:?}");
    }
}

#[test]
fn the_first_parts_of_a_bag_without_an_account_were_missing_without_a_word() {
    for (names, gone) in [
        (&["r_1.mcap", "r_2.mcap"][..], "part(s) 0 are not"),
        (&["r_2.mcap", "r_3.mcap"], "part(s) 0, 1 are not"),
        (&["r_2.db3", "r_5.db3"], "part(s) 0, 1, 3, 4 are not"),
        (
            &[
                "1_r_2026_05_04-09_00_00.mcap",
                "2_r_2026_05_04-09_02_00.mcap",
            ],
            "part(s) 0 are not",
        ),
    ] {
        let found = said(&bag("", &of(names)), None);
        let [(Severity::Warning, "missing_parts", words)] = &found[..] else {
            panic!("{names:?}: {found:?}");
        };
        assert!(words.contains(gone), "{words}");
    }
}
