//! Numbers of a log's topics: which there are, each with its own column.

use std::collections::HashMap;

/// Fields that are listed: of logs with more, each array has its first elements alone.
const FIELDS_MAX: usize = 4000;
/// An array with more elements is a picture, a cloud or a stripe, and no number over time.
const ELEMENTS_MAX: usize = 64;

/// A number in each message of a channel.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Field {
    /// Channel in the log.
    pub channel: u16,
    /// Path in its messages, such as `pose.position.x`.
    pub path: String,
    /// Which of several senders on one topic, by the text of its messages that names them; "" = there is one.
    pub key: String,
}

/// The fields met so far; each has a number, for good.
#[derive(Debug, Default)]
pub struct Fields {
    all: Vec<Field>,
    /// Numbers of fields by channel, key and path.
    numbers: HashMap<u16, HashMap<String, HashMap<String, usize>>>,
}

impl Fields {
    /// All of them, by their numbers.
    pub fn all(&self) -> &[Field] {
        &self.all
    }

    /// Number of a field, new or known; `None` = it is part of a long array, or there are too many.
    pub fn number(&mut self, channel: u16, key: &str, path: &str) -> Option<usize> {
        let known = self.numbers.get(&channel).and_then(|c| c.get(key));
        if let Some(number) = known.and_then(|k| k.get(path)) {
            return Some(*number);
        }
        if self.all.len() >= FIELDS_MAX || is_of_long_array(path) {
            return None;
        }
        let number = self.all.len();
        self.all.push(Field {
            channel,
            path: path.to_owned(),
            key: key.to_owned(),
        });
        let of_channel = self.numbers.entry(channel).or_default();
        let of_key = of_channel.entry(key.to_owned()).or_default();
        of_key.insert(path.to_owned(), number);
        Some(number)
    }

    /// Leaves out the arrays that turned out to be long ones: all their elements are no fields any more where the last
    /// that is kept was met. Numbers stay as they are.
    pub fn listed(&self) -> impl Iterator<Item = (usize, &Field)> {
        let last = format!("[{}]", ELEMENTS_MAX - 1);
        let long: Vec<(u16, &str)> = (self.all.iter())
            .filter_map(|f| Some((f.channel, f.path.split_once(&last)?.0)))
            .collect();
        let is_long = move |field: &Field| {
            long.iter().any(|(channel, lead)| {
                let rest = field.path.strip_prefix(lead);
                *channel == field.channel && rest.is_some_and(|r| r.starts_with('['))
            })
        };
        self.all
            .iter()
            .enumerate()
            .filter(move |(_, field)| !is_long(field))
    }
}

/// Whether a path goes through an element behind those that are kept of an array.
fn is_of_long_array(path: &str) -> bool {
    let elements = path.split('[').skip(1);
    let mut numbers = elements.filter_map(|e| e.split_once(']')?.0.parse::<usize>().ok());
    numbers.any(|n| n >= ELEMENTS_MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_field_keeps_its_number_and_a_long_array_is_no_field() {
        let mut fields = Fields::default();
        let x = fields.number(1, "", "pose.x");
        assert_eq!(fields.number(1, "bow", "pose.x"), Some(1));
        assert_eq!(fields.number(1, "", "pose.x"), x);
        for k in 0..200 {
            let number = fields.number(2, "", &format!("column_px[{k}]"));
            assert_eq!(number.is_some(), k < ELEMENTS_MAX);
        }
        fields.number(2, "", "covariance[0]");
        let listed: Vec<&str> = fields.listed().map(|(_, f)| f.path.as_str()).collect();
        assert_eq!(listed, ["pose.x", "pose.x", "covariance[0]"]);
    }
}
