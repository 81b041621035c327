//! Diagnosis at image level: the logs of an independent renderer, and a fixed handful of our own.
//! The key is read here and nowhere else.

#![allow(clippy::unwrap_used)] // a test

use crate::inputs::{input, logs_of, on_both_sets};
use hydroline::diagnose::Watch;
use hydroline::diagnose::profiles::{Findings, level};
use hydroline::diagnose::verdict::Word;
use hydroline::prove::images;
use hydroline_rigs::Rig;
use std::path::Path;

fn found(path: &Path) -> Findings {
    let rig = Rig::builtin("lshpi").unwrap();
    let watch = Watch::unlimited(&|_| {});
    let found = level(&[path.to_owned()], &rig, watch).unwrap().unwrap();
    println!("{}: {}", path.display(), found.sentence());
    found
}

/// Of the four logs with a true flat port, a tilted sheet, a larger target, and nothing, the third; all of them:
/// [`all_four_independent_effects`].
fn the_independent_effects_are_named_with_their_numbers(images: &Path) {
    effects_are_named(images, &["c"]);
}

#[test]
#[ignore = "two minutes of processor time: tests/nightly"]
fn all_four_independent_effects() {
    if let Some(images) = input("cases/images") {
        effects_are_named(&images, &["a", "b", "c", "d"]);
    }
}

fn effects_are_named(images: &Path, logs: &[&str]) {
    let text = std::fs::read_to_string(images.join("effects/key.json")).unwrap();
    let key: serde_json::Value = serde_json::from_str(&text).unwrap();
    for log in logs {
        let truth = &key[*log];
        let found = found(&images.join(format!("effects/{log}.mcap")));
        let truth = truth.as_object().unwrap();
        let named: Vec<&str> = found.effects.iter().map(|e| e.effect.as_str()).collect();
        let wanted: Vec<&str> = truth.keys().map(String::as_str).collect();
        assert_eq!(named, wanted, "{log}");
        let word = if wanted.is_empty() {
            Word::None
        } else {
            Word::Named
        };
        assert_eq!(found.word, word, "{log}");
        for (effect, values) in found.effects.iter().zip(truth.values()) {
            // Written as a list in the order of the registry's parameters, or as one number; the
            // tilt's are tangents.
            let values: Vec<f64> = match values {
                serde_json::Value::Array(list) => {
                    list.iter().map(|v| v.as_f64().unwrap()).collect()
                }
                one => vec![one.as_f64().unwrap()],
            };
            let info = hydroline_sim::effect::find(&effect.effect).unwrap();
            for (p, value) in info.parameters.iter().zip(values) {
                let value = if p.unit == "rad" { value.atan() } else { value };
                let got = effect.parameters[p.name];
                let z = (got.value - value) / got.sd.unwrap();
                println!(
                    "  {} {} = {:.6}, key {value:.6}, z {z:.2}",
                    effect.effect, p.name, got.value
                );
                assert!(z.abs() < 3.0, "{log}: {} = {got:?}, key {value}", p.name);
            }
        }
        // Held-out frames: their rows fit to the noise.
        let (after, noise) = (
            found.fit.held_out.after["row_px"],
            found.fit.held_out.noise["row_px"],
        );
        assert!(
            after <= 1.2 * noise,
            "{log}: {after} px held out, noise {noise}"
        );
    }
}

/// One over the target; with those over the bare floor: [`all_undisturbed_logs`].
fn undisturbed_logs_of_the_independent_renderer_give_nothing(images: &Path) {
    give_nothing(images, &["surge-4n-disturbed"]);
}

#[test]
#[ignore = "a minute of processor time: tests/nightly"]
fn all_undisturbed_logs() {
    if let Some(images) = input("cases/images") {
        let logs = [
            "surge-4n",
            "surge-4n-disturbed",
            "heave",
            "roll",
            "pitch",
            "yaw",
        ];
        give_nothing(&images, &logs);
    }
}

fn give_nothing(images: &Path, logs: &[&str]) {
    for log in logs_of(images, logs) {
        let found = found(&images.join(format!("{log}.mcap")));
        assert_eq!(found.word, Word::None, "{log}");
        assert!(found.effects.is_empty(), "{log}: {:?}", found.effects);
    }
}

/// Sealed cases of one effect (refraction, a tilted sheet, a larger target) and of none, found right before: a regression
/// test, no estimate. `hydroline prove --images 90` makes others.
#[test]
#[ignore = "two minutes of processor time: tests/nightly"]
fn a_handful_of_our_own_cases() {
    let judged = come_out_right(&[0, 3, 9, 2]);
    let nothing = judged.last().unwrap();
    assert!(nothing.found.is_empty(), "nothing is there: {nothing:?}");
}

fn come_out_right(cases: &[usize]) -> Vec<images::ImageJudged> {
    let judged = images::run(2, cases, None, &|_| {}).unwrap();
    for line in judged.iter().filter_map(images::complaint) {
        println!("{line}");
    }
    println!("{}", images::words(&judged));
    assert!(judged.iter().all(|j| j.right), "{judged:?}");
    judged
}

on_both_sets!("cases/images":
    the_independent_effects_are_named_with_their_numbers,
    undisturbed_logs_of_the_independent_renderer_give_nothing,
);
