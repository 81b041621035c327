//! Completeness of the registry and its agreement with itself and with the book; messages that say what to write where.

use super::super::*;

#[test]
fn the_registry_is_consistent() {
    let mut ids: Vec<&str> = ALL.iter().map(|i| i.id).collect();
    ids.sort_unstable();
    ids.dedup();
    assert_eq!(ids.len(), ALL.len(), "ids are unique");
    for info in ALL {
        assert_eq!(find(info.id), Some(*info));
        assert!(
            !info.law.is_empty() && !info.source.is_empty(),
            "{}: law and source say something",
            info.id
        );
        for p in info.parameters {
            assert!(
                p.limits.0 <= p.plausible.0
                    && p.plausible.0 < p.plausible.1
                    && p.plausible.1 <= p.limits.1
            );
            assert!(
                (p.plausible.0..=p.plausible.1).contains(&p.typical),
                "{} {}",
                info.id,
                p.name
            );
        }
        // Every law builds at its typical values, and at both limits.
        let at = |value: fn(&ParameterInfo) -> f64| {
            let mut one = CheckedEffect::typical(info);
            one.numbers = info.parameters.iter().map(value).collect();
            one.entry()
        };
        for value in [
            |p: &ParameterInfo| p.typical,
            |p: &ParameterInfo| p.limits.0,
            |p: &ParameterInfo| p.limits.1,
        ] {
            assert!(EffectStack::build(&[at(value)]).is_ok(), "{}", info.id);
        }
        for confusable in info.confusable {
            assert!(
                find(confusable).is_some(),
                "sim/src/effect/{}.rs: `confusable` names \"{confusable}\", which is no effect's id",
                info.id
            );
        }
    }
}

/// A reader's effect was refused until he had edited the files of two others.
#[test]
fn one_of_two_files_says_what_is_confusable() {
    for info in ALL {
        let ids = info.confusable_with();
        let unique: std::collections::BTreeSet<_> = ids.iter().collect();
        assert_eq!(
            unique.len(),
            ids.len(),
            "sim/src/effect/{}.rs: `confusable` lists an id twice: {ids:?}",
            info.id
        );
        assert!(
            !ids.contains(&info.id),
            "sim/src/effect/{}.rs: `confusable` lists the effect itself",
            info.id
        );
        for id in ids {
            let other = find(id).map(EffectInfo::confusable_with);
            assert!(other.unwrap().contains(&info.id), "{} and {id}", info.id);
        }
    }
}

#[test]
fn no_two_effects_of_a_stage_share_their_order() {
    for info in ALL {
        let of_stage = ALL.iter().filter(|other| other.stage == info.stage);
        let taken: Vec<u16> = of_stage.clone().map(|other| other.order).collect();
        let next = (info.order..)
            .find(|order| !taken.contains(order))
            .unwrap_or_default();
        let mut sharing = of_stage.filter(|other| other.order == info.order && other.id != info.id);
        if let Some(other) = sharing.next() {
            panic!(
                "{} and {} both have order {} in stage {}; taken: {taken:?}; next free: {next}, at the end: {}",
                info.id,
                other.id,
                info.order,
                info.stage.name(),
                taken.iter().max().unwrap() / 10 * 10 + 10,
            );
        }
    }
}

/// A file that nobody declares is not compiled, and nothing misses it.
#[test]
fn every_file_of_an_effect_is_registered() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/src/effect");
    for file in std::fs::read_dir(folder).unwrap() {
        let path = file.unwrap().path();
        let is_effect = |text: &str| text.contains("\npub(super) const INFO: EffectInfo");
        if path.is_file() && is_effect(&std::fs::read_to_string(&path).unwrap()) {
            let id = path.file_stem().unwrap().to_string_lossy().into_owned();
            assert!(
                find(&id).is_some(),
                "{}: write `mod {id};` in sim/src/effect.rs and `{id},` in sim/src/effect/registry.rs, \
                 and let its INFO have the id \"{id}\"",
                path.display()
            );
        }
    }
}

/// The laws are derived in the book: a row per effect, with each of its numbers and with `[dof]` where it has a `dof` word.
#[test]
fn every_effect_has_its_row_in_the_chapter_of_physics() {
    let room = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
    let page = room.join("../src/guide").join("theory/physics.md");
    let text = std::fs::read_to_string(page).unwrap();
    for info in ALL {
        let id = info.id;
        let row = text
            .lines()
            .find(|line| line.starts_with(&format!("| `{id}`")))
            .unwrap_or_else(|| {
                panic!("src/guide/theory/physics.md: write a row \"| `{id}` | law | range | source |\" in the table of its stage")
            });
        let has_dof = info.words.iter().any(|w| w.name == "dof");
        assert_eq!(
            row.contains("[dof"),
            has_dof,
            "src/guide/theory/physics.md: [dof] stands where an effect has a `dof` word: {row}"
        );
        // Tables and written laws have too many numbers for a row.
        for p in info.parameters.iter().filter(|_| !info.is_written()) {
            assert!(
                row.contains(&format!("`{}`", p.name)),
                "src/guide/theory/physics.md: the row of {id} says nothing of `{}`: {row}",
                p.name
            );
        }
    }
}
