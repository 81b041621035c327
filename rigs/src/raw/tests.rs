//! Whole files, right and wrong.

mod files;
mod messages;
mod mutations;
mod response;
mod rules;

use toml::{Table, Value};

use crate::{Rig, RigError};

/// One step of a path into a TOML tree.
#[derive(Clone, Debug)]
enum Step {
    Key(String),
    Index(usize),
}

/// Paths of all values that are neither tables nor lists, as the errors write them.
fn leaves(table: &Table) -> Vec<(String, Vec<Step>)> {
    fn walk(value: &Value, path: &str, steps: &[Step], found: &mut Vec<(String, Vec<Step>)>) {
        let below = |step: Step| [steps, &[step]].concat();
        match value {
            Value::Table(table) => {
                for (key, value) in table {
                    let path = if path.is_empty() {
                        key.clone()
                    } else {
                        format!("{path}.{key}")
                    };
                    walk(value, &path, &below(Step::Key(key.clone())), found);
                }
            }
            Value::Array(array) => {
                for (i, value) in array.iter().enumerate() {
                    walk(
                        value,
                        &format!("{path}[{i}]"),
                        &below(Step::Index(i)),
                        found,
                    );
                }
            }
            _ => found.push((path.to_owned(), steps.to_vec())),
        }
    }
    let mut found = Vec::new();
    walk(&Value::Table(table.clone()), "", &[], &mut found);
    found
}

/// The value at a path.
fn at<'t>(table: &'t mut Table, steps: &[Step]) -> &'t mut Value {
    let (Step::Key(first), rest) = (&steps[0], &steps[1..]) else {
        panic!("root is a table")
    };
    rest.iter()
        .fold(table.get_mut(first).unwrap(), |value, step| match step {
            Step::Key(key) => value.get_mut(key).unwrap(),
            Step::Index(i) => value.get_mut(*i).unwrap(),
        })
}

/// The built-in rig with every key there is, as a tree.
fn full_rig(name: &str) -> Table {
    Rig::builtin(name).unwrap().effective_toml.parse().unwrap()
}

/// The built-in rig with one text replaced; panics when the text is not there.
pub(super) fn changed(from: &str, to: &str) -> RigError {
    let text = include_str!("../../lshpi.toml");
    assert!(text.contains(from), "{from:?} is not in lshpi.toml");
    Rig::from_toml(&text.replacen(from, to, 1), "my.toml", None).expect_err(to)
}

pub(super) fn tells(error: &RigError, words: &[&str]) {
    let message = error.to_string();
    for word in words {
        assert!(message.contains(word), "no {word:?} in:\n{message}");
    }
}
