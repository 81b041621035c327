//! Guarantees of the log format (src/guide/reference/interfaces.md): logs of every release are read as they were
//! written, and no field of a message changed its number, type or name.
//!
//! `tests/data/logs/VERSION` holds logs of that release, `expected.json` with what they hold, and the release's messages as
//! protobuf descriptors. A release adds its folder, and nothing that lies there is ever changed: make the logs, copy
//! `src/log/generated/hydroline.fds`, and run this test with `HYDROLINE_WRITE_EXPECTED=1`, which writes what is missing.

use crate::support::hydroline;
use prost_types::{DescriptorProto, EnumDescriptorProto, FileDescriptorSet};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Contents of a log: equal where `export` merely writes them otherwise.
#[derive(Debug, Default, PartialEq, Serialize, Deserialize)]
struct Contents {
    /// Rows by table.
    rows: BTreeMap<String, usize>,
    /// Digest of each column's cells by `table:column`.
    columns: BTreeMap<String, String>,
    /// Images, and the digest of all their grey levels.
    images: (usize, String),
    /// The rig, as its keys are understood today.
    rig: BTreeMap<String, String>,
    /// Plan, note and summary that people look for.
    metadata: BTreeMap<String, String>,
}

/// FNV-1a, 64 bits: the same in every version of Rust.
#[derive(Clone, Copy)]
struct Digest(u64);

impl Digest {
    fn new() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }

    fn add(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.0 = (self.0 ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3);
        }
    }

    fn text(self) -> String {
        format!("{:016x}", self.0)
    }
}

fn releases() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/logs");
    let mut found: Vec<PathBuf> = std::fs::read_dir(folder)
        .unwrap()
        .map(|e| e.unwrap().path())
        .collect();
    found.sort();
    assert!(!found.is_empty());
    found
}

fn run(words: &[&str]) -> String {
    let output = hydroline().args(words).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{words:?}: {said}");
    String::from_utf8(output.stdout).unwrap()
}

/// A cell as what it says: a number is its value, however it is written.
fn cell(text: &str) -> Vec<u8> {
    match text.parse::<f64>() {
        // Stamps have more digits than a double.
        Ok(value) if text.len() < 16 || text.contains(['.', 'e']) => {
            value.to_bits().to_le_bytes().to_vec()
        }
        _ => text.as_bytes().to_vec(),
    }
}

fn contents(log: &Path) -> Contents {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let (log_text, out_text) = (log.to_str().unwrap(), out.to_str().unwrap());
    run(&["export", log_text, "--out", out_text]);
    let mut files: Vec<PathBuf> = std::fs::read_dir(&out)
        .unwrap()
        .map(|e| e.unwrap().path())
        .collect();
    files.sort();
    let mut found = Contents::default();
    let mut levels = Digest::new();
    for file in files {
        let name = file.file_name().unwrap().to_string_lossy().into_owned();
        if name.ends_with(".png") {
            let image = image::open(&file).unwrap().into_luma8();
            levels.add(&image.width().to_le_bytes());
            levels.add(image.as_raw());
            found.images.0 += 1;
            continue;
        }
        let text = std::fs::read_to_string(&file).unwrap();
        let mut lines = text.lines();
        let names: Vec<&str> = lines.next().unwrap().split(',').collect();
        let mut columns = vec![Digest::new(); names.len()];
        let mut rows = 0;
        for line in lines {
            rows += 1;
            // Only the last column holds sentences.
            for (digest, text) in columns.iter_mut().zip(line.splitn(names.len(), ',')) {
                digest.add(&cell(text));
                digest.add(b"\n");
            }
        }
        found.rows.insert(name.clone(), rows);
        for (column, digest) in names.iter().zip(columns) {
            found
                .columns
                .insert(format!("{name}:{column}"), digest.text());
        }
    }
    found.images.1 = levels.text();
    let info: serde_json::Value =
        serde_json::from_str(&run(&["info", log_text, "--json"])).unwrap();
    let metadata = |map: &str, key: &str| info["metadata"][map][key].as_str().map(str::to_owned);
    for (map, key) in [
        ("session", "plan.name"),
        ("session", "note"),
        ("session", "version"),
        ("summary", "frames.received"),
    ] {
        if let Some(value) = metadata(map, key) {
            found.metadata.insert(format!("{map}.{key}"), value);
        }
    }
    let rig: toml::Table = metadata("rig", "toml").unwrap().parse().unwrap();
    let parsed = hydroline_rigs::Rig::from_toml(&rig.to_string(), "kept", None).unwrap();
    let effective: toml::Table = parsed.to_toml().parse().unwrap();
    // Keys typed then have the same values in force now.
    flatten(
        "",
        &toml::Value::Table(rig),
        &toml::Value::Table(effective),
        &mut found.rig,
    );
    found
}

/// Every key of the rig in the log with the value that it has today.
fn flatten(
    path: &str,
    typed: &toml::Value,
    now: &toml::Value,
    into: &mut BTreeMap<String, String>,
) {
    match (typed, now) {
        (toml::Value::Table(typed), toml::Value::Table(now)) => {
            for (key, value) in typed {
                let path = format!("{path}.{key}");
                let now = now
                    .get(key)
                    .unwrap_or_else(|| panic!("{path} is no key any more"));
                flatten(&path, value, now, into);
            }
        }
        (_, now) => {
            into.insert(path.trim_start_matches('.').to_owned(), now.to_string());
        }
    }
}

#[test]
fn logs_of_every_release_hold_what_they_held() {
    for release in releases() {
        let mut found: BTreeMap<String, Contents> = BTreeMap::new();
        for entry in std::fs::read_dir(&release).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_some_and(|e| e == "mcap") {
                let name = path.file_name().unwrap().to_string_lossy().into_owned();
                found.insert(name, contents(&path));
            }
        }
        let file = release.join("expected.json");
        if !file.exists() && std::env::var_os("HYDROLINE_WRITE_EXPECTED").is_some() {
            std::fs::write(&file, serde_json::to_string_pretty(&found).unwrap()).unwrap();
        }
        let expected: BTreeMap<String, Contents> =
            serde_json::from_slice(&std::fs::read(&file).unwrap()).unwrap();
        assert_eq!(
            found.keys().collect::<Vec<_>>(),
            expected.keys().collect::<Vec<_>>()
        );
        for (log, then) in &expected {
            let now = &found[log];
            let name = format!("{}/{log}", release.display());
            assert_eq!(now.images, then.images, "{name}");
            assert_eq!(now.metadata, then.metadata, "{name}");
            // New tables, columns and keys may come; what was there stays as it was.
            let kept = |now: &BTreeMap<String, String>, then: &BTreeMap<String, String>| {
                let changed = |(k, v): &(&String, &String)| now.get(*k) != Some(*v);
                then.iter()
                    .filter(changed)
                    .map(|(k, _)| k.clone())
                    .collect::<Vec<_>>()
            };
            assert_eq!(kept(&now.columns, &then.columns), [""; 0], "{name}");
            assert_eq!(kept(&now.rig, &then.rig), [""; 0], "{name}");
            for (table, rows) in &then.rows {
                assert_eq!(now.rows.get(table), Some(rows), "{name}: {table}");
            }
        }
    }
}

/// Messages and enumerations by their full names, nested ones too.
#[derive(Default)]
struct Declared {
    messages: BTreeMap<String, DescriptorProto>,
    enums: BTreeMap<String, EnumDescriptorProto>,
}

impl Declared {
    fn at(path: &Path) -> Self {
        let bytes = std::fs::read(path).unwrap();
        let set = <FileDescriptorSet as prost::Message>::decode(bytes.as_slice()).unwrap();
        let mut found = Self::default();
        for file in &set.file {
            for message in &file.message_type {
                found.message(file.package(), message);
            }
            for each in &file.enum_type {
                let name = format!("{}.{}", file.package(), each.name());
                found.enums.insert(name, each.clone());
            }
        }
        found
    }

    fn message(&mut self, within: &str, message: &DescriptorProto) {
        let name = format!("{within}.{}", message.name());
        for nested in &message.nested_type {
            self.message(&name, nested);
        }
        for each in &message.enum_type {
            self.enums
                .insert(format!("{name}.{}", each.name()), each.clone());
        }
        self.messages.insert(name, message.clone());
    }
}

/// Where the messages of now break what a release guaranteed.
fn broken(then: &Declared, now: &Declared) -> Vec<String> {
    let mut broken = Vec::new();
    for (name, message) in &then.messages {
        let Some(new) = now.messages.get(name) else {
            broken.push(format!("message {name} is gone"));
            continue;
        };
        for field in &message.field {
            let same = new.field.iter().find(|f| f.number == field.number);
            let is_kept = same.is_some_and(|f| {
                (f.name(), f.r#type, f.label, f.type_name())
                    == (field.name(), field.r#type, field.label, field.type_name())
            });
            if !is_kept {
                broken.push(format!(
                    "{name}.{} (number {})",
                    field.name(),
                    field.number()
                ));
            }
        }
    }
    for (name, each) in &then.enums {
        let Some(new) = now.enums.get(name) else {
            broken.push(format!("enum {name} is gone"));
            continue;
        };
        for value in &each.value {
            let is_kept = |v: &prost_types::EnumValueDescriptorProto| {
                (v.name(), v.number()) == (value.name(), value.number())
            };
            if !new.value.iter().any(is_kept) {
                broken.push(format!("{name}.{}", value.name()));
            }
        }
    }
    broken
}

#[test]
fn no_field_of_a_released_message_changed_number_type_or_name() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let now = Declared::at(&root.join("src/log/generated/hydroline.fds"));
    assert!(now.messages.contains_key("hydroline.VehicleMotion"));
    for release in releases() {
        let then = Declared::at(&release.join("hydroline.fds"));
        assert!(then.messages.len() > 8, "{}", release.display());
        assert_eq!(broken(&then, &now), [""; 0], "{}", release.display());
    }
}

#[test]
fn a_renamed_renumbered_or_retyped_field_breaks_the_guarantee() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let then = Declared::at(&root.join("src/log/generated/hydroline.fds"));
    for change in 0..4 {
        let mut now = Declared::at(&root.join("src/log/generated/hydroline.fds"));
        let message = now.messages.get_mut("hydroline.VehicleMotion").unwrap();
        match change {
            0 => message.field[1].name = Some("other".to_owned()),
            1 => message.field[1].number = Some(9999),
            2 => message.field[1].r#type = Some(4),
            _ => drop(message.field.remove(1)),
        }
        assert_eq!(broken(&then, &now).len(), 1, "change {change}");
        // A field that is added breaks nothing.
        assert!(broken(&now, &then).len() < 2);
    }
}
