//! Any bytes are an answer: an error or a sound object, never a panic.

use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use toml::Value;

use super::{at, full_rig, leaves};
use crate::{Board, Plan, Rig, RigError, Target};

const FILES: [&str; 7] = [
    include_str!("../../../lshpi.toml"),
    include_str!("../../../bench-v4l.toml"),
    include_str!("../../../template.toml"),
    include_str!("../../../plans/mixed-6dof.toml"),
    include_str!("../../../plans/two-tone.toml"),
    include_str!("../../../targets/hexagons.toml"),
    include_str!("../../../boards/dots-50.toml"),
];

/// Reads a text as every kind of file; what is accepted must read back as itself, what
/// is refused must say why.
fn answer(text: &str) {
    fn refused(error: &RigError) {
        assert!(!error.problems().is_empty() && error.problems().len() <= 201);
        assert!(error.to_string().contains("any.toml"));
    }
    match Rig::from_toml(text, "any.toml", None) {
        Ok(rig) => {
            let again = Rig::from_toml(&rig.effective_toml, "again.toml", None);
            assert_eq!(again.as_ref(), Ok(&rig));
        }
        Err(error) => refused(&error),
    }
    match Plan::from_toml(text, "any.toml") {
        Ok(plan) => {
            let again = Plan::from_toml(&plan.to_toml(), "again.toml").unwrap();
            assert_eq!((&again.name, &again.steps), (&plan.name, &plan.steps));
            for t_s in [-1.0, 0.0, 0.5 * plan.duration_s(), 2.0 * plan.duration_s()] {
                let (index, _) = plan.load_at(t_s);
                assert!(index <= plan.steps.len());
            }
            let _ = plan.check_against(&Rig::builtin("lshpi").unwrap());
        }
        Err(error) => refused(&error),
    }
    match Target::from_toml(text, "any.toml") {
        Ok(target) => assert_eq!(Target::from_toml(&target.to_toml(), "t"), Ok(target)),
        Err(error) => refused(&error),
    }
    match Board::from_toml(text, "any.toml") {
        Ok(board) => assert_eq!(Board::from_toml(&board.to_toml(), "b"), Ok(board)),
        Err(error) => refused(&error),
    }
}

/// One change to a text.
#[derive(Debug, Clone)]
enum Change {
    Byte(usize, u8),
    Delete(usize, usize),
    Insert(usize, String),
    DropLine(usize),
    RepeatLine(usize, usize),
    SwapLines(usize, usize),
}

fn change() -> impl Strategy<Value = Change> {
    let place = 0..20_000_usize;
    prop_oneof![
        (place.clone(), any::<u8>()).prop_map(|(i, b)| Change::Byte(i, b)),
        (place.clone(), 1..40_usize).prop_map(|(i, n)| Change::Delete(i, n)),
        (place.clone(), "[-+0-9.eE\\[\\]{}=\",#_a-z\n ]{1,12}")
            .prop_map(|(i, s)| Change::Insert(i, s)),
        place.clone().prop_map(Change::DropLine),
        (place.clone(), place.clone()).prop_map(|(a, b)| Change::RepeatLine(a, b)),
        (place.clone(), place).prop_map(|(a, b)| Change::SwapLines(a, b)),
    ]
}

fn apply(text: &str, change: &Change) -> String {
    let mut bytes = text.as_bytes().to_vec();
    let mut lines: Vec<&str> = text.lines().collect();
    let (n, rows) = (bytes.len().max(1), lines.len().max(1));
    if bytes.is_empty() {
        return String::new();
    }
    match change {
        Change::Byte(i, b) => bytes[i % n] = *b,
        Change::Delete(i, many) => {
            let from = i % n;
            bytes.drain(from..(from + many).min(n));
        }
        Change::Insert(i, s) => {
            bytes.splice(i % n..i % n, s.bytes());
        }
        Change::DropLine(i) => {
            lines.remove(i % rows);
            return lines.join("\n");
        }
        Change::RepeatLine(a, b) => {
            lines.insert(b % rows, lines[a % rows]);
            return lines.join("\n");
        }
        Change::SwapLines(a, b) => {
            lines.swap(a % rows, b % rows);
            return lines.join("\n");
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

proptest! {
    // A failing case is printed with its input; no files are left beside the sources.
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, rng_seed: RngSeed::Fixed(1), ..ProptestConfig::default() })]

    #[test]
    fn any_bytes(bytes in proptest::collection::vec(any::<u8>(), 0..400)) {
        answer(&String::from_utf8_lossy(&bytes));
    }

    #[test]
    fn any_toml_like_text(text in "([a-z_]{1,8}(\\.[a-z]{1,4})? ?= ?(-?[0-9]{1,5}(\\.[0-9e]{1,4})?|\"[a-z/]{0,6}\"|\\[[0-9, ]{0,8}\\]|true|nan)\n|\\[{1,2}[a-z.]{1,8}\\]{1,2}\n){0,12}") {
        answer(&text);
    }

    #[test]
    fn changed_files(file in 0..FILES.len(), changes in proptest::collection::vec(change(), 1..5)) {
        let text = changes.iter().fold(FILES[file].to_owned(), |text, change| apply(&text, change));
        answer(&text);
    }

    /// Numbers moved by up to 10 %: most such rigs are sound, and all of those read back
    /// from their effective form as themselves.
    #[test]
    fn moved_numbers_round_trip(moves in proptest::collection::vec((0..10_000_usize, 0.9..1.1_f64), 1..6)) {
        let mut table = full_rig("lshpi");
        let numbers: Vec<_> = leaves(&table)
            .into_iter()
            .filter(|(path, _)| !path.contains("direction") && !path.contains("curve") && !path.contains("_us"))
            .collect();
        for (which, factor) in moves {
            let (_, steps) = &numbers[which % numbers.len()];
            if let Value::Float(value) = at(&mut table, steps) {
                *value *= factor;
            }
        }
        answer(&table.to_string());
    }
}

/// The round trip above must not pass for want of sound rigs.
#[test]
fn moved_numbers_mostly_make_sound_rigs() {
    let table = full_rig("lshpi");
    let (mut sound, mut tried) = (0, 0);
    for (path, steps) in leaves(&table) {
        let mut table = table.clone();
        if let Value::Float(value) = at(&mut table, &steps) {
            if path.contains("direction") {
                continue;
            }
            *value *= 0.97;
            tried += 1;
            if let Ok(rig) = Rig::from_toml(&table.to_string(), "moved.toml", None) {
                assert_eq!(
                    Rig::from_toml(&rig.effective_toml, "again.toml", None),
                    Ok(rig),
                    "{path}"
                );
                sound += 1;
            }
        }
    }
    assert!(tried > 200 && 5 * sound > 4 * tried, "{sound} of {tried}");
}

#[test]
fn deep_and_long_files_are_refused_quickly() {
    answer(&"[".repeat(100_000));
    answer(&format!("a = {}", "[".repeat(50_000)));
    answer(&format!("a = {}", "{a=".repeat(50_000)));
    answer(&"[[step]]\n".repeat(50_000));
    answer(
        &(0..40_000)
            .map(|i| format!("k{i} = 1\n"))
            .collect::<String>(),
    );
    answer(&"x".repeat(2 << 20));
}
