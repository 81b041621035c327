//! A name in words, and the unit that ends it.

/// A name in small words; what the unit says is taken off.
pub(in crate::guess) struct Words {
    pub words: Vec<String>,
    /// The unit that ends it, as in `x_mm`.
    pub unit: Option<&'static str>,
}

const SUFFIXES: [(&[&str], &str); 27] = [
    (&["deg", "per", "s"], "deg/s"),
    (&["rad", "per", "s"], "rad/s"),
    (&["deg", "s"], "deg/s"),
    (&["rad", "s"], "rad/s"),
    (&["mm", "s"], "mm/s"),
    (&["cm", "s"], "cm/s"),
    (&["m", "s"], "m/s"),
    (&["m", "per", "s"], "m/s"),
    (&["ft", "s"], "ft/s"),
    (&["mps"], "m/s"),
    (&["radps"], "rad/s"),
    (&["degps"], "deg/s"),
    (&["dps"], "deg/s"),
    (&["rpm"], "rpm"),
    (&["kn"], "kn"),
    (&["kts"], "kn"),
    (&["knots"], "kn"),
    (&["mm"], "mm"),
    (&["cm"], "cm"),
    (&["ft"], "ft"),
    (&["m"], "m"),
    (&["deg"], "deg"),
    (&["degrees"], "deg"),
    (&["cdeg"], "cdeg"),
    (&["rad"], "rad"),
    (&["n"], "N"),
    (&["nm"], "N m"),
];
const TIME_SUFFIXES: [(&str, &str); 9] = [
    ("s", "s"),
    ("sec", "s"),
    ("secs", "s"),
    ("seconds", "s"),
    ("ms", "ms"),
    ("us", "us"),
    ("usec", "us"),
    ("ns", "ns"),
    ("nsec", "ns"),
];

/// Splits `/odom/pose/position/x`, `posX`, `x_mm`, `AUV X [mm]` into words.
pub(super) fn split(name: &str) -> Vec<String> {
    let bare = match name.find(['[', '(', '{']) {
        Some(at) if at > 0 => &name[..at],
        _ => crate::unit::in_degrees(name)
            .map_or(name, |unit| &name[..name.trim_end().len() - unit.len()]),
    };
    let mut words: Vec<String> = vec![String::new()];
    let mut before = ' ';
    for c in bare.chars() {
        let turns = (before.is_lowercase() || before.is_ascii_digit()) && c.is_uppercase();
        if !c.is_alphanumeric() || turns {
            words.push(String::new());
        }
        if c.is_alphanumeric()
            && let Some(word) = words.last_mut()
        {
            word.extend(c.to_lowercase());
        }
        before = c;
    }
    words.retain(|w| !w.is_empty());
    words
}

impl Words {
    pub fn of(name: &str) -> Words {
        let mut words = split(name);
        let timely = tells_time(&words);
        let mut unit = None;
        if words.len() >= 2 && timely {
            let last = words[words.len() - 1].clone();
            if let Some((_, own)) = TIME_SUFFIXES.iter().find(|(w, _)| *w == last) {
                unit = Some(*own);
                words.pop();
            }
        } else {
            for (suffix, own) in SUFFIXES {
                let ends = words.len() > suffix.len() && words.ends_with(&suffix.map_strings());
                // `pos_n` is a way to the north.
                let north = suffix == ["n"] && words.iter().any(|w| is_way_or_speed(w));
                if ends && !north {
                    unit = Some(own);
                    words.truncate(words.len() - suffix.len());
                    break;
                }
            }
        }
        Words { words, unit }
    }
}

trait MapStrings {
    fn map_strings(&self) -> Vec<String>;
}
impl MapStrings for &[&str] {
    fn map_strings(&self) -> Vec<String> {
        self.iter().map(|s| (*s).to_owned()).collect()
    }
}

/// Whether words name a time; `t` does so first, not behind another word, of which it is a letter (`Water T`).
pub(super) fn tells_time(words: &[String]) -> bool {
    words.first().is_some_and(|w| w == "t") || words.iter().any(|w| is_time(w))
}

fn is_time(word: &str) -> bool {
    matches!(
        word,
        "time"
            | "timestamp"
            | "stamp"
            | "timestamps"
            | "times"
            | "zeit"
            | "uhrzeit"
            | "heure"
            | "temps"
            | "tiempo"
            | "clock"
            | "utc"
            | "datetime"
            | "elapsed"
    )
}

/// Whether a word says that something is a place or how fast it changes.
pub(super) fn is_way_or_speed(word: &str) -> bool {
    matches!(
        word,
        "pos" | "position" | "p" | "v" | "vel" | "velocity" | "speed"
    )
}
