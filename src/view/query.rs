//! Parameters of a request: letters and digits, nothing escaped.

use std::str::FromStr;

/// Bound of a time that is asked for \[s\]: 292 years, as far as nanoseconds in 64 bits reach.
const TIME_MAX_S: f64 = 9.2e9;

/// A query, and what is wrong with it.
#[derive(Debug, Clone, Copy)]
pub struct Query<'a>(pub &'a str);

/// Parameter that is missing or no number.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("parameter {name}: '{value}' is not {wanted}")]
pub struct BadQuery {
    name: &'static str,
    value: String,
    wanted: &'static str,
}

impl<'a> Query<'a> {
    fn get(self, name: &str) -> Option<&'a str> {
        self.0.split('&').find_map(|pair| {
            let (key, value) = pair.split_once('=')?;
            (key == name).then_some(value)
        })
    }

    /// Whether a parameter is 1.
    pub fn is(self, name: &str) -> bool {
        self.get(name) == Some("1")
    }

    /// A word of a list; `None` = it is not there, or another one.
    pub fn word(self, name: &str, words: &[&'static str]) -> Option<&'static str> {
        let own = self.get(name)?;
        words.iter().find(|w| **w == own).copied()
    }

    /// A whole number; without the parameter `without`.
    pub fn whole<N: FromStr>(self, name: &'static str, without: N) -> Result<N, BadQuery> {
        let Some(text) = self.get(name) else {
            return Ok(without);
        };
        text.parse().map_err(|_| bad(name, text, "a whole number"))
    }

    /// A time since a log's zero \[s\], as nanoseconds.
    pub fn time_ns(self, name: &'static str) -> Result<i64, BadQuery> {
        let text = self.get(name).unwrap_or_default();
        let seconds: Option<f64> = text.parse().ok();
        let seconds = seconds.filter(|s| s.abs() <= TIME_MAX_S);
        seconds
            .map(|s| (s * 1e9).round() as i64)
            .ok_or_else(|| bad(name, text, "a time in seconds"))
    }

    /// A list of whole numbers, at most `most`.
    pub fn list(self, name: &'static str, most: usize) -> Result<Vec<usize>, BadQuery> {
        let text = self.get(name).unwrap_or_default();
        let numbers: Result<Vec<usize>, _> = text.split(',').map(str::parse).collect();
        let numbers = numbers.ok().filter(|n| n.len() <= most);
        numbers.ok_or_else(|| bad(name, text, "a list of whole numbers, as 1,2,3"))
    }
}

fn bad(name: &'static str, value: &str, wanted: &'static str) -> BadQuery {
    // What was sent is shown, not all of it.
    let value = value.chars().take(40).collect();
    BadQuery {
        name,
        value,
        wanted,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_read_and_anything_else_is_named() {
        let query = Query("log=1&t=-1.5&of=3,4,5&full=1&as=png&x");
        assert_eq!(query.whole("log", 0usize), Ok(1));
        assert_eq!(query.whole("width", 800usize), Ok(800));
        assert_eq!(query.time_ns("t"), Ok(-1_500_000_000));
        assert_eq!(query.list("of", 3), Ok(vec![3, 4, 5]));
        assert!(query.is("full") && !query.is("t"));
        assert_eq!(query.word("as", &["png"]), Some("png"));
        assert!(query.list("of", 2).is_err());
        for wrong in ["", "t=", "t=NaN", "t=inf", "t=1e300", "t=x"] {
            assert!(Query(wrong).time_ns("t").is_err(), "{wrong}");
        }
        let words = Query("log=-1")
            .whole("log", 0usize)
            .unwrap_err()
            .to_string();
        assert_eq!(words, "parameter log: '-1' is not a whole number");
    }
}
