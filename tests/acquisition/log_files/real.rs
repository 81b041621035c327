//! Files written by others.

use hydroline::log::doctor::{Grade, doctor};
use hydroline::log::info::{Ending, info};
use hydroline::log::recover::recover;

use super::damage::flip_bits;
use super::support::{Rng, python_counts, read_all};
use crate::inputs::{input, on_both_sets};
use std::path::Path;

const FILES: [(&str, u64); 5] = [
    ("wbag_0.mcap", 1246),
    ("wbag_3.mcap", 1240),
    ("talker.mcap", 20),
    ("multiple_files_2.mcap", 529),
    ("bag_with_topics_and_service_events.mcap", 10),
];

#[test]
fn rosbag2_files_are_counted_right() {
    let Some(root) = input("cases/real/mcap") else {
        return;
    };
    for (name, messages) in FILES {
        let report = info(&root.join(name)).unwrap();
        assert_eq!(report.messages, messages, "{name}");
        assert_eq!(
            report.topics.iter().map(|t| t.messages).sum::<u64>(),
            messages
        );
        assert_eq!(
            (report.ending, report.profile.as_str()),
            (Ending::Whole, "ros2")
        );
        assert!(report.damage.is_empty(), "{report}");
        let diagnosis = doctor(&root.join(name)).unwrap();
        assert!(diagnosis.sound, "{diagnosis}");
        assert!(report.to_string().contains(&messages.to_string()));
    }
}

#[test]
fn rosbag2_files_survive_recovery() {
    let Some(root) = input("cases/real/mcap") else {
        return;
    };
    let dir = tempfile::tempdir().unwrap();
    for (name, messages) in FILES {
        let mended = dir.path().join(name);
        let recovery = recover(&root.join(name), &mended).unwrap();
        assert!(
            recovery.was_whole && recovery.messages_total == messages,
            "{recovery}"
        );
        if let Some(counts) = python_counts(&mended) {
            let sum: u64 = counts
                .as_object()
                .unwrap()
                .values()
                .filter_map(|v| v.as_u64())
                .sum();
            assert_eq!(sum, messages, "{name}");
        }
    }
}

/// Cuts at `cuts` places: what is read is a prefix of the whole, and the missing end is named.
fn cut(cuts: u64, every: bool) {
    let Some(root) = input("cases/real/mcap") else {
        return;
    };
    let dir = tempfile::tempdir().unwrap();
    for (name, _) in FILES {
        let bytes = std::fs::read(root.join(name)).unwrap();
        let (whole, _) = read_all(&bytes);
        let mut rng = Rng(99);
        let n = bytes.len() as u64;
        let places: Vec<u64> = if every {
            (0..n).collect()
        } else {
            (0..cuts).map(|_| rng.below(n)).collect()
        };
        for (i, place) in places.into_iter().enumerate() {
            let part = &bytes[..place as usize];
            let (messages, errors) = read_all(part);
            assert_eq!(
                messages[..],
                whole[..messages.len()],
                "{name} cut at {place}"
            );
            assert!(!errors.is_empty(), "{name} cut at {place} went unnoticed");
            if i % 10 == 0 {
                let (path, mended) = (dir.path().join("cut.mcap"), dir.path().join("mended.mcap"));
                std::fs::write(&path, part).unwrap();
                if let Ok(recovery) = recover(&path, &mended) {
                    assert!(recovery.messages_total >= messages.len() as u64);
                    std::fs::remove_file(&mended).unwrap();
                } else {
                    assert!(place < 8, "{name} cut at {place}");
                }
                doctor(&path).ok();
            }
        }
    }
}

#[test]
fn rosbag2_files_cut_at_many_bytes() {
    cut(60, false);
}

/// `cargo test -p hydroline --test log_files -- --ignored rosbag2_files_cut_at_every_byte`
#[test]
#[ignore = "100000 cuts, 10000 recoveries: minutes"]
fn rosbag2_files_cut_at_every_byte() {
    cut(0, true);
}

fn flips(n: usize) {
    let Some(root) = input("cases/real/mcap") else {
        return;
    };
    for (name, _) in FILES {
        let bytes = std::fs::read(root.join(name)).unwrap();
        if doctor(&root.join(name))
            .unwrap()
            .found("unchecked", Grade::Note)
        {
            // Its writer stated no checksum anywhere: wrong data cannot be noticed, a panic could.
            let (mut damaged, mut rng) = (bytes.clone(), Rng(5));
            for _ in 0..n {
                let bit = rng.below(bytes.len() as u64 * 8) as usize;
                damaged[bit / 8] ^= 1 << (bit % 8);
                read_all(&damaged);
                damaged[bit / 8] ^= 1 << (bit % 8);
            }
            println!("{name}: no checksum in the file, {n} flips without a panic");
            continue;
        }
        let (detected, harmless) = flip_bits(&bytes, n, 5);
        println!("{name}: {detected} of {n} flips noticed, {harmless} harmless");
    }
}

#[test]
fn rosbag2_files_with_flipped_bits() {
    flips(40);
}

/// `cargo test -p hydroline --test log_files -- --ignored rosbag2_files_with_many --nocapture`
#[test]
#[ignore = "5 x 2000 flips take a while"]
fn rosbag2_files_with_many_flipped_bits() {
    flips(2000);
}

/// Logs of this project's conventions made by another writer, with no metadata at all.
#[test]
fn logs_made_elsewhere_read_without_metadata() {
    use hydroline::log::{LogReader, Record};
    let Some(path) = input("cases/images/surge-4n-disturbed.mcap") else {
        return;
    };
    let (mut frames, mut commands, mut truths) = (0, 0, 0);
    for message in LogReader::open(&path).unwrap() {
        match message.unwrap().record {
            Record::Frame(f) => {
                assert_eq!((f.width_px, f.height_px), (720, 576));
                f.to_grey(&Default::default()).unwrap();
                frames += 1;
            }
            Record::Command(_) => commands += 1,
            Record::Truth(t) => truths += u32::from(t.x_m.is_some()),
            other => panic!("{other:?}"),
        }
    }
    assert_eq!((frames, commands, truths), (36, 12, 36));
    assert_eq!(LogReader::open(&path).unwrap().rig_toml(), None);
    assert!(doctor(&path).unwrap().sound, "{}", doctor(&path).unwrap());
}

/// Every log of the cases is sound by its own rules: the doctor raises no false alarm.
fn the_doctor_raises_no_false_alarm(cases: &Path) {
    let mut examined = 0;
    for folder in [
        "images",
        "images/effects",
        "motion/case103",
        "motion/case204",
    ] {
        for entry in std::fs::read_dir(cases.join(folder)).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_some_and(|e| e == "mcap") {
                let diagnosis = doctor(&path).unwrap();
                assert!(diagnosis.sound, "{diagnosis}");
                examined += 1;
            }
        }
    }
    assert!(examined > 10, "{examined}");
}

on_both_sets!("cases":
    the_doctor_raises_no_false_alarm,
);
