//! ARCHITECTURE.md says which room uses which; the manifests must say the same.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Rooms by their folder, each with the rooms that its `[dependencies]` name.
fn by_manifest(root: &Path) -> BTreeMap<String, BTreeSet<String>> {
    let read = |folder: &str| -> toml::Table {
        let path = root.join(folder).join("Cargo.toml");
        std::fs::read_to_string(path).unwrap().parse().unwrap()
    };
    let members = read(".")["workspace"]["members"].clone();
    let members = members.as_array().unwrap().iter();
    members
        .map(|m| m.as_str().unwrap().to_owned())
        .filter(|m| m != ".")
        .filter_map(|m| {
            let manifest = read(&m);
            let ours = manifest["package"]["name"].as_str().unwrap();
            ours.starts_with("hydroline-").then(|| {
                let uses = manifest["dependencies"].as_table().unwrap().keys();
                let uses = uses.filter_map(|d| d.strip_prefix("hydroline-"));
                (m, uses.map(str::to_owned).collect())
            })
        })
        .collect()
}

/// The same by the table of ARCHITECTURE.md, whose rows stand in the order of the layers.
fn by_document(root: &Path) -> Vec<(String, BTreeSet<String>)> {
    let text = std::fs::read_to_string(root.join("ARCHITECTURE.md")).unwrap();
    let name = |cell: &str| cell.trim().trim_matches('`').to_owned();
    text.lines()
        .filter(|l| l.starts_with("| `"))
        .map(|l| {
            let cells: Vec<&str> = l.trim_matches('|').split('|').collect();
            let uses = cells[2].split(',').map(name).filter(|u| !u.is_empty());
            (name(cells[0]), uses.collect())
        })
        .collect()
}

#[test]
fn the_rooms_use_what_the_document_says_and_only_rooms_above_them() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let manifests = by_manifest(root);
    let document = by_document(root);
    assert!(document.len() > 10, "the table of rooms was not found");
    let mut known = BTreeSet::new();
    for (room, uses) in &document {
        assert_eq!(
            manifests.get(room),
            Some(uses),
            "ARCHITECTURE.md and {room}/Cargo.toml differ"
        );
        assert!(
            uses.is_subset(&known),
            "{room} uses {uses:?}, which stand not above it in ARCHITECTURE.md"
        );
        known.insert(room.rsplit('/').next().unwrap().to_owned());
    }
    let rooms: BTreeSet<&String> = manifests.keys().collect();
    let documented: BTreeSet<&String> = document.iter().map(|(room, _)| room).collect();
    assert_eq!(rooms, documented, "rooms without a row in ARCHITECTURE.md");
}
