//! Digests over the metadata maps: the rig, the calibration and the session stand outside the chunks, where MCAP has
//! no checksum, and a killed recording has no checksum over its data section either.
//!
//! Each map carries its digest under [`KEY`]; the first channel's metadata, which stands in a chunk and under that
//! chunk's checksum, repeats the digests of all maps of the head. A bit that flips in a map, in its name or in its
//! digest no longer agrees with one of the two.

use std::collections::BTreeMap;
use std::fmt;

use serde::Serialize;
use sha2::{Digest, Sha256};

use super::part::MetadataMap;

/// Key of a map's own digest: SHA-256 (FIPS 180-4) over name and entries, hexadecimal.
pub(super) const KEY: &str = "sha256";
/// In a channel's metadata: the digest of the map whose name follows.
const IN_CHANNEL: &str = "metadata.sha256.";
/// Maps whose content changes what an analysis computes.
const GUARDED: [&str; 3] = ["rig", "calibration", "session"];

/// Digest of a map under its name; its own entry [`KEY`] does not count.
fn digest(name: &str, map: &MetadataMap) -> String {
    let mut hasher = Sha256::new();
    let mut add = |text: &str| {
        // The length ahead of each text: no two maps give the same bytes.
        hasher.update((text.len() as u64).to_le_bytes());
        hasher.update(text.as_bytes());
    };
    add(name);
    for (key, value) in map.iter().filter(|(key, _)| *key != KEY) {
        add(key);
        add(value);
    }
    hasher
        .finalize()
        .iter()
        .map(|byte| format!("{byte:02x}"))
        .collect()
}

/// The map with its digest.
pub(super) fn sealed(name: &str, mut map: MetadataMap) -> MetadataMap {
    map.insert(KEY.to_owned(), digest(name, &map));
    map
}

/// Whether a map carries its digest and agrees with it.
pub(super) fn holds(name: &str, map: &MetadataMap) -> bool {
    map.get(KEY)
        .is_some_and(|stated| *stated == digest(name, map))
}

/// Metadata of the first channel: the digests of the head's maps.
pub(super) fn for_channel(head: &[(String, MetadataMap)]) -> MetadataMap {
    let digests = head.iter();
    digests
        .map(|(name, map)| (format!("{IN_CHANNEL}{name}"), digest(name, map)))
        .collect()
}

/// The digests that a channel repeats, by the name of their map.
pub(super) fn in_channel(metadata: &MetadataMap) -> impl Iterator<Item = (&str, &str)> {
    metadata
        .iter()
        .filter_map(|(key, value)| Some((key.strip_prefix(IN_CHANNEL)?, value.as_str())))
}

/// State of a metadata map by its digests.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum SealState {
    /// It is not what was written.
    Altered,
    /// It was written and is not in the file, or its name is not what was written.
    Missing,
    /// It carries no digest, and none is left in a chunk: damage in it cannot be noticed.
    Unverifiable,
}

/// A map of which the digests do not say that it is as it was written.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, schemars::JsonSchema)]
pub struct SealFinding {
    /// Name of the metadata.
    pub name: String,
    /// State by the digests.
    pub state: SealState,
}

/// Key in the session of a replayed log for metadata of the original that was damaged: this and the metadata's name.
pub const DAMAGED_KEY: &str = "replay.metadata.";

impl SealFinding {
    /// Whether it is not as it was written; without a digest nothing is known.
    pub fn damaged(&self) -> bool {
        matches!(self.state, SealState::Altered | SealState::Missing)
    }
}

impl fmt::Display for SealFinding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = &self.name;
        match self.state {
            SealState::Altered => {
                write!(
                    f,
                    "metadata `{name}` is damaged: it differs from its digest"
                )
            }
            SealState::Missing => write!(
                f,
                "metadata `{name}` was written and is not in the file, or its name is damaged"
            ),
            SealState::Unverifiable => write!(
                f,
                "metadata `{name}` carries no digest: damage in it cannot be noticed"
            ),
        }
    }
}

/// Holds the maps of a file against their digests and those in its chunks; what is in order is not listed.
///
/// A log of another writer has neither maps of ours nor digests: nothing is said of it.
pub(super) fn check(
    maps: &BTreeMap<String, MetadataMap>,
    in_chunks: &BTreeMap<String, String>,
) -> Vec<SealFinding> {
    let mut findings = Vec::new();
    for (name, map) in maps {
        let found = digest(name, map);
        let states: Vec<&String> = map
            .get(KEY)
            .into_iter()
            .chain(in_chunks.get(name))
            .collect();
        let state = if states.iter().any(|stated| **stated != found) {
            SealState::Altered
        } else if states.is_empty() && GUARDED.contains(&name.as_str()) {
            SealState::Unverifiable
        } else {
            continue;
        };
        let name = name.clone();
        findings.push(SealFinding { name, state });
    }
    let missing = in_chunks.keys().filter(|name| !maps.contains_key(*name));
    findings.extend(missing.map(|name| SealFinding {
        name: name.clone(),
        state: SealState::Missing,
    }));
    findings
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn map(entries: &[(&str, &str)]) -> MetadataMap {
        let own = |(k, v): &(&str, &str)| ((*k).to_owned(), (*v).to_owned());
        entries.iter().map(own).collect()
    }

    fn digests(head: &[(String, MetadataMap)]) -> BTreeMap<String, String> {
        let channel = for_channel(head);
        in_channel(&channel)
            .map(|(name, digest)| (name.to_owned(), digest.to_owned()))
            .collect()
    }

    #[test]
    fn what_is_as_it_was_written_is_not_listed() {
        let rig = sealed("rig", map(&[("toml", "[camera]\n")]));
        let head = vec![("rig".to_owned(), rig)];
        let maps: BTreeMap<_, _> = head.iter().cloned().collect();
        assert!(check(&maps, &digests(&head)).is_empty());
        assert!(check(&maps, &BTreeMap::new()).is_empty(), "its own digest");
        // Sealed again, as by a replay: the old digest does not count.
        let again = sealed("rig", maps["rig"].clone());
        assert_eq!(again, maps["rig"]);
    }

    #[test]
    fn altered_missing_and_unsealed_maps_are_distinguished() {
        let head = vec![
            ("rig".to_owned(), sealed("rig", map(&[("toml", "a = 1")]))),
            ("session".to_owned(), sealed("session", map(&[]))),
        ];
        let stated = digests(&head);
        let states = |maps: &[(&str, MetadataMap)]| -> Vec<(String, SealState)> {
            let maps = maps
                .iter()
                .map(|(n, m)| ((*n).to_owned(), m.clone()))
                .collect();
            let found = check(&maps, &stated).into_iter();
            found.map(|f| (f.name, f.state)).collect()
        };
        // The digest went with the content: the chunk still knows.
        let changed = sealed("rig", map(&[("toml", "a = 2")]));
        let session = head[1].1.clone();
        assert_eq!(
            states(&[("rig", changed), ("session", session.clone())]),
            [("rig".to_owned(), SealState::Altered)]
        );
        assert_eq!(
            states(&[("rih", head[0].1.clone()), ("session", session)]),
            [
                ("rih".to_owned(), SealState::Altered),
                ("rig".to_owned(), SealState::Missing)
            ]
        );
        let old = BTreeMap::from([
            ("rig".to_owned(), map(&[("toml", "a = 1")])),
            ("theirs".to_owned(), map(&[("k", "v")])),
        ]);
        let found = check(&old, &BTreeMap::new());
        assert_eq!(found.len(), 1, "{found:?}");
        assert_eq!(found[0].state, SealState::Unverifiable);
    }

    proptest! {
        #[test]
        fn moving_a_byte_between_key_and_value_changes_the_digest(
            key in "[a-z]{2,8}", value in "[a-z]{2,8}", cut in 1usize..8,
        ) {
            let whole = format!("{key}{value}");
            let cut = cut.min(whole.len() - 1);
            prop_assume!(cut != key.len());
            let a = digest("rig", &map(&[(key.as_str(), value.as_str())]));
            let b = digest("rig", &map(&[(&whole[..cut], &whole[cut..])]));
            prop_assert_ne!(a, b);
        }
    }
}
