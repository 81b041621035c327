//! Parts of a bag by the numbers in their names, where nothing else says what belongs to it.

use std::iter;
use std::ops::Range;

use super::{PARTS_NAMED, Part};
use crate::check::Finding;

/// Number from which on a file's is none of its place among others, but a date or a count of something else: bags of a day have some
/// hundred parts.
const NUMBER_MAX: u64 = 1000;

/// Number of a part in its name, with what stands around it: `run_3.mcap`, or `3_run_2026_05_04.mcap` of newer recorders. Dates and other
/// numbers that are padded with zeros are none.
fn number_of(name: &str, leading: bool) -> Option<(&str, u64)> {
    let stem = name.rsplit_once('.').map_or(name, |(stem, _)| stem);
    let (around, digits) = match leading {
        true => stem.split_once('_').map(|(digits, rest)| (rest, digits))?,
        false => stem.rsplit_once('_')?,
    };
    let are_digits = |text: &str| text.bytes().all(|b| b.is_ascii_digit());
    let is_padded = digits.len() > 1 && digits.starts_with('0');
    // Behind year and month it is a day.
    let is_day = !leading
        && around.rsplit_once('_').is_some_and(|(before, month)| {
            let year = before.len().checked_sub(4).and_then(|at| before.get(at..));
            month.len() == 2 && are_digits(month) && year.is_some_and(are_digits)
        });
    let is_number = are_digits(digits) && !is_padded && !is_day;
    let number = digits.parse().ok().filter(|_| is_number)?;
    // What follows the first number is the date of each part.
    Some((if leading { "" } else { around }, number))
}

/// A gap in the numbers of files that nothing else accounts for, or the parts before the first: a warning, for recordings of their own
/// may be numbered too.
pub(super) fn numbering(parts: &[Part]) -> Option<Finding> {
    let numbers = |leading: bool| -> Option<Vec<u64>> {
        let mut own = Vec::new();
        let mut around = None;
        for part in parts {
            let stem = part
                .name
                .rsplit_once('.')
                .map_or(part.name.as_str(), |(s, _)| s);
            match number_of(&part.name, leading) {
                Some((rest, number)) if around.is_none_or(|a| a == rest) => {
                    around = Some(rest);
                    own.push((number, stem));
                }
                // The first part went without a number once.
                None if !leading => own.push((0, stem)),
                _ => return None,
            }
        }
        let bare = |stem: &str| around.is_some_and(|a| a == stem);
        let is_numbered = |n: &(u64, &str)| number_of(&format!("{}.x", n.1), leading).is_some();
        if own.iter().any(|n| !is_numbered(n) && !bare(n.1)) {
            return None;
        }
        let mut numbers: Vec<u64> = own.iter().map(|n| n.0).collect();
        numbers.sort_unstable();
        let all = numbers.len();
        numbers.dedup();
        (numbers.len() == all && all > 1).then_some(numbers)
    };
    // Recordings that are numbered by other than their parts begin anywhere.
    let is_of_parts = |n: &Vec<u64>| n[0] <= 1;
    let numbers = numbers(true)
        .filter(is_of_parts)
        .or_else(|| numbers(false))?;
    if is_of_parts(&numbers) {
        let gone = named(between(&numbers));
        if !gone.is_empty() {
            return Some(Finding::fault(
                "missing_parts",
                None,
                format!(
                    "the files are numbered, and part(s) {gone} are not in the folder ({} are); put them back, or import the rest with --accept-faults",
                    parts.len()
                ),
            ));
        }
    }
    let first = numbers[0];
    (1..NUMBER_MAX).contains(&first).then(|| {
        let gone = named(iter::once(0..first).chain(between(&numbers)));
        Finding::warning(
            "missing_parts",
            None,
            format!(
                "the files are numbered from {first} on, and recorders count parts from 0: if they are of one recording, part(s) {gone} are not in the folder; put them back"
            ),
        )
    })
}

/// Numbers between those that are there.
fn between(numbers: &[u64]) -> impl Iterator<Item = Range<u64>> + '_ {
    numbers.windows(2).map(|w| w[0] + 1..w[1])
}

/// Numbers as words, not more than a few; empty = there are none.
fn named(numbers: impl Iterator<Item = Range<u64>>) -> String {
    let few: Vec<String> = numbers
        .flatten()
        .take(PARTS_NAMED)
        .map(|n| n.to_string())
        .collect();
    few.join(", ")
}
