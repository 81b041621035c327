//! Parts of a bag by the numbers in their names, where nothing else says what belongs to it.

use super::{PARTS_NAMED, Part};
use crate::check::Finding;

/// Number of a part in its name, with what stands around it: `run_3.mcap`, or `3_run_2026_05_04.mcap` of newer recorders. Dates and other
/// numbers that are padded with zeros are none.
fn number_of(name: &str, leading: bool) -> Option<(&str, u64)> {
    let stem = name.rsplit_once('.').map_or(name, |(stem, _)| stem);
    let (around, digits) = match leading {
        true => stem.split_once('_').map(|(digits, rest)| (rest, digits))?,
        false => stem.rsplit_once('_')?,
    };
    let is_number = digits.bytes().all(|b| b.is_ascii_digit());
    let is_padded = digits.len() > 1 && digits.starts_with('0');
    let number = digits.parse().ok().filter(|_| is_number && !is_padded)?;
    // What follows the first number is the date of each part.
    Some((if leading { "" } else { around }, number))
}

/// A gap in the numbers of files that nothing else accounts for.
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
    let numbers = numbers(true)
        .filter(|n| n[0] <= 1)
        .or_else(|| numbers(false).filter(|n| n[0] <= 1))?;
    let gone: Vec<u64> = numbers
        .windows(2)
        .flat_map(|w| (w[0] + 1..w[1]).take(PARTS_NAMED))
        .collect();
    if gone.is_empty() {
        return None;
    }
    let gone: Vec<String> = gone.iter().take(PARTS_NAMED).map(u64::to_string).collect();
    Some(Finding::fault(
        "missing_parts",
        None,
        format!(
            "the files are numbered, and part(s) {} are not in the folder ({} are); put them back, or import the rest with --accept-faults",
            gone.join(", "),
            parts.len()
        ),
    ))
}
