//! Results of many cases, kept in a file that a run which was broken off goes on from.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::Write as _;
use std::ops::Range;

/// What is found of one case: a number or two by name.
pub type Found = Vec<(String, Vec<f64>)>;

/// Cases of these seeds, in their order. With `COVERAGE_KEPT=FOLDER` those that are in `FOLDER/NAME.txt` are read, and the others added.
pub fn cases(name: &str, seeds: Range<u64>, made: impl Fn(u64) -> Found) -> Vec<(u64, Found)> {
    let path = std::env::var("COVERAGE_KEPT").ok();
    let path = path.map(|folder| std::path::Path::new(&folder).join(format!("{name}.txt")));
    let text = path.as_ref().and_then(|p| std::fs::read_to_string(p).ok());
    let known: BTreeMap<u64, Found> = text
        .iter()
        .flat_map(|t| t.lines())
        .filter_map(read)
        .collect();
    let mut file = path.map(|path| {
        let mut options = std::fs::OpenOptions::new();
        options.create(true).append(true).open(path).unwrap()
    });
    let each = seeds.map(|seed| {
        if let Some(found) = known.get(&seed) {
            return (seed, found.clone());
        }
        let found = made(seed);
        if let Some(file) = &mut file {
            // At once, as one line: two processes may add to it.
            file.write_all(line(seed, &found).as_bytes()).unwrap();
        }
        (seed, found)
    });
    each.collect()
}

/// `COVERAGE_SEEDS=N` or `COVERAGE_SEEDS=A..B`, or so many.
pub fn seeds(count: u64) -> Range<u64> {
    let Ok(asked) = std::env::var("COVERAGE_SEEDS") else {
        return 0..count;
    };
    match asked.split_once("..") {
        Some((from, to)) => from.parse().unwrap()..to.parse().unwrap(),
        None => 0..asked.parse().unwrap(),
    }
}

fn line(seed: u64, found: &Found) -> String {
    let mut text = seed.to_string();
    for (key, numbers) in found {
        write!(text, "\t{key}").unwrap();
        numbers.iter().for_each(|v| write!(text, " {v:e}").unwrap());
    }
    text + "\n"
}

/// A line; `None` where it was broken off.
fn read(line: &str) -> Option<(u64, Found)> {
    let (seed, rest) = line.split_once('\t')?;
    let one = |text: &str| -> Option<(String, Vec<f64>)> {
        let mut words = text.split(' ');
        let key = words.next()?.to_owned();
        let numbers: Result<Vec<f64>, _> = words.map(str::parse).collect();
        Some((key, numbers.ok()?))
    };
    let found: Option<Found> = rest.split('\t').map(one).collect();
    Some((seed.parse().ok()?, found?))
}

#[test]
fn a_case_is_read_as_it_was_written() {
    let found = vec![
        ("x_u".to_owned(), vec![-0.25, 1.0]),
        ("x_uu".to_owned(), vec![3e-7]),
    ];
    let text = line(7, &found);
    assert_eq!(read(text.trim_end()), Some((7, found)));
    assert_eq!(read("7"), None);
}
