//! Every key of rig and plan files, for the book: what the readers themselves ask for, and what each key means.

mod meanings;

use crate::raw::{Asked, Includes, Need, Problems, read_document, read_plan, read_rig};

/// A key of a file.
#[derive(Debug, Clone, PartialEq)]
pub struct Key {
    /// As written; of an angle both names, joined by ` or `.
    pub names: Vec<String>,
    /// Type, in words.
    pub kind: String,
    /// Unit; "" = none.
    pub unit: &'static str,
    /// Allowed values; "" = any of the type.
    pub allowed: String,
    /// Value when it is left out, and whether it may be.
    pub default: Default,
    /// What it is.
    pub meaning: &'static str,
}

/// What happens when a key is left out.
#[derive(Debug, Clone, PartialEq)]
pub enum Default {
    /// The file is refused.
    Required,
    /// Nothing is assumed; the meaning says what that means.
    None,
    /// It has this value.
    Value(String),
}

/// A table of a file with its keys.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    /// Its head as written, `[camera]`; of several tables with the same keys all heads.
    pub heads: Vec<String>,
    /// What it describes.
    pub meaning: &'static str,
    /// Its keys.
    pub keys: Vec<Key>,
}

/// What was asked for, and whether it has a meaning: the list must be empty.
pub fn undescribed() -> Vec<String> {
    let mut wrong = Vec::new();
    for (meanings, asked) in [(meanings::RIG, rig_asked()), (meanings::PLAN, plan_asked())] {
        for a in asked.iter().filter(|a| a.kind != TWIN) {
            let (table, key) = split(&a.path);
            let known = match a.kind.as_str() {
                "table" => meanings.iter().any(|m| m.covers(&a.path)),
                _ => meanings
                    .iter()
                    .any(|m| m.covers(table) && m.key(key).is_some()),
            };
            if !known {
                wrong.push(format!("{}: no meaning", a.path));
            }
            if a.kind.is_empty() {
                wrong.push(format!("{}: no type", a.path));
            }
        }
        for m in meanings {
            for table in m.tables {
                for (key, _) in m.keys {
                    if !asked.iter().any(|a| split(&a.path) == (table, key)) {
                        wrong.push(format!("{table}.{key}: no file has it"));
                    }
                }
            }
        }
    }
    wrong
}

/// Tables of a rig file.
pub fn rig() -> Vec<Table> {
    tables(meanings::RIG, &rig_asked())
}

/// Tables of a plan file; the first has the keys that stand before all tables.
pub fn plan() -> Vec<Table> {
    tables(meanings::PLAN, &plan_asked())
}

/// Meanings of tables that have the same keys.
struct Meanings {
    /// Paths of the tables; `[]` after a list of tables, "" before all tables.
    tables: &'static [&'static str],
    meaning: &'static str,
    keys: &'static [(&'static str, &'static str)],
}

impl Meanings {
    fn covers(&self, table: &str) -> bool {
        self.tables.contains(&table) || self.tables.contains(&format!("{table}[]").as_str())
    }

    fn key(&self, name: &str) -> Option<&'static str> {
        let found = self.keys.iter().find(|(key, _)| *key == name);
        found.map(|(_, meaning)| *meaning)
    }
}

/// Table and key of a path.
fn split(path: &str) -> (&str, &str) {
    path.rsplit_once('.').unwrap_or(("", path))
}

fn tables(meanings: &[Meanings], asked: &[Asked]) -> Vec<Table> {
    meanings.iter().map(|m| table(m, asked)).collect()
}

fn table(m: &Meanings, asked: &[Asked]) -> Table {
    let head = |path: &&str| {
        let name = path.replace("[]", "");
        match path.ends_with("[]") {
            true => format!("[[{name}]]"),
            false => format!("[{name}]"),
        }
    };
    let of_table = |key: &str| {
        let path = |a: &&Asked| m.tables.contains(&split(&a.path).0) && split(&a.path).1 == key;
        asked.iter().find(path)
    };
    let keys = m.keys.iter().filter_map(|(name, meaning)| {
        let a = of_table(name)?;
        let radians = name.strip_suffix("_deg").map(|stem| format!("{stem}_rad"));
        let radians = radians.filter(|other| of_table(other).is_some());
        let mut names = vec![(*name).to_owned()];
        names.extend(radians);
        Some(Key {
            names,
            kind: a.kind.clone(),
            unit: a.unit,
            allowed: a.allowed.clone(),
            default: match &a.need {
                Need::Required => Default::Required,
                Need::Optional => Default::None,
                Need::Default(value) => Default::Value(value.clone()),
            },
            meaning,
        })
    });
    Table {
        heads: m
            .tables
            .iter()
            .filter(|t| !t.is_empty())
            .map(head)
            .collect(),
        meaning: m.meaning,
        keys: keys.collect(),
    }
}

/// What is asked of a rig file, of all its shapes together.
fn rig_asked() -> Vec<Asked> {
    let samples = [
        include_str!("reference/every-key.toml"),
        // The shapes that exclude others: by file, and the second kind of marks on a board.
        "target = { file = \"builtin:hexagons\" }\nboard = { file = \"builtin:dots-50\" }",
        "board = { pattern = \"dots\" }",
    ];
    union(samples.iter().map(|text| {
        let problems = Problems::listening();
        read_document(FILE, text, &problems, |root| {
            read_rig(root, &Includes::Builtin)
        });
        problems.into_asked()
    }))
}

/// What is asked of a plan file.
fn plan_asked() -> Vec<Asked> {
    let text = "name = \"p\"\nstep = [{ wrench = {}, shape = \"sine\" }, { thrust_n = {}, shape = \"chirp\" }]";
    let problems = Problems::listening();
    read_document(FILE, text, &problems, |root| read_plan(root, "plan"));
    union([problems.into_asked()])
}

/// Name of the sample: what a target file within it is asked has another one.
const FILE: &str = "sample";

fn union(asked: impl IntoIterator<Item = Vec<Asked>>) -> Vec<Asked> {
    let mut all: Vec<Asked> = Vec::new();
    for a in asked.into_iter().flatten().filter(|a| a.file == FILE) {
        match all.iter_mut().find(|known| known.path == a.path) {
            Some(known) if known.kind.is_empty() => *known = a,
            Some(_) => {}
            None => all.push(a),
        }
    }
    // Radians are the same key as degrees.
    let degrees: Vec<String> = all.iter().map(|a| a.path.clone()).collect();
    let is_twin = |path: &str| {
        let stem = path.strip_suffix("_rad");
        stem.is_some_and(|stem| degrees.contains(&format!("{stem}_deg")))
    };
    all.iter_mut()
        .filter(|a| is_twin(&a.path))
        .for_each(|a| a.kind = TWIN.to_owned());
    all
}

/// Kind of the radians of an angle that has degrees too.
const TWIN: &str = "radians";

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn every_key_that_is_asked_for_has_a_meaning_and_every_meaning_a_key() {
        let wrong = undescribed();
        assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    }

    /// The sample in `reference/every-key.toml` reaches every call that reads a key.
    #[test]
    fn every_key_that_a_reader_names_is_asked_for() {
        const READERS: [&str; 16] = [
            "number",
            "number_opt",
            "number_or",
            "integer",
            "integer_opt",
            "integer_or",
            "angle",
            "angle_opt",
            "angle_or",
            "choice",
            "choice_opt",
            "flag_or",
            "text_opt",
            "numbers",
            "numbers_opt",
            "interval_opt",
        ];
        let asked = rig_asked().into_iter().chain(plan_asked());
        let asked: BTreeSet<String> = asked.map(|a| split(&a.path).1.to_owned()).collect();
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("src/raw");
        let mut seen = 0;
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_none_or(|e| e != "rs") {
                continue;
            }
            let text = std::fs::read_to_string(&path).unwrap();
            for reader in READERS {
                for call in text.split(&format!(".{reader}(")).skip(1) {
                    let Some(rest) = call.trim_start().strip_prefix('"') else {
                        continue; // a key by a variable: the tables below have them
                    };
                    let key = rest.split('"').next().unwrap();
                    let degrees = format!("{key}_deg");
                    assert!(
                        asked.contains(key) || asked.contains(&degrees),
                        "{}: {key} is read, and the samples do not reach it",
                        path.display()
                    );
                    seen += 1;
                }
            }
        }
        assert!(seen > 80, "{seen}");
    }
}
