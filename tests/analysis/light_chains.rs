//! Whole chains under real light: a board calibrates, frames become poses, poses coefficients, as people do it, by the
//! binary's commands. Each chain has a vehicle, a light and a camera of its own, and runs once more under even light on a
//! linear camera. The rig that calibrates, replays and identifies knows nothing of any of it.
//!
//! Judged are coefficients and how many frames have a pose. Errors of poses are printed, not judged: one calibration's error
//! moves all poses of a chain alike (a board rotated by 0.003° is a roll of ten sds of a frame), clean or not.
//!
//! ```sh
//! cargo test --workspace --test analysis light_chains -- --ignored --nocapture
//! ```
//!
//! A quarter of an hour of one core. Results are kept in `target/tmp/light-chains` (`HYDROLINE_LIGHT_CHAINS`), one file per chain:
//! what was broken off goes on where it stopped, as long as binary and chain are the same.
#![allow(clippy::unwrap_used, clippy::panic)]

mod chain;
mod setup;

use chain::{Outcome, run};
use setup::{Drawn, GROUPS, Group};
use std::path::{Path, PathBuf};

/// Chains of must-show 3.
const CHAINS: u64 = 10;
fn folder() -> PathBuf {
    let named = std::env::var_os("HYDROLINE_LIGHT_CHAINS").map(PathBuf::from);
    named.unwrap_or_else(|| Path::new(env!("CARGO_TARGET_TMPDIR")).join("light-chains"))
}

/// The chain's result: read where it was left, else computed and left there.
fn kept(folder: &Path, drawn: &Drawn, lit: bool) -> Outcome {
    let name = format!("{:02}-{}", drawn.chain, if lit { "lit" } else { "clean" });
    let path = folder.join(format!("{name}.json"));
    let key = drawn.key(lit, GROUPS);
    let left = std::fs::read(&path).ok();
    let left = left.and_then(|bytes| serde_json::from_slice::<serde_json::Value>(&bytes).ok());
    if let Some(outcome) = left
        .filter(|v| v["key"] == key)
        .and_then(|v| Outcome::read(&v))
    {
        return outcome;
    }
    let work = tempfile::tempdir().unwrap();
    let outcome = run(work.path(), drawn, lit, GROUPS);
    std::fs::create_dir_all(folder).unwrap();
    let text = serde_json::to_vec_pretty(&outcome.json(&key)).unwrap();
    let part = folder.join(format!("{name}.part"));
    std::fs::write(&part, text).unwrap();
    std::fs::rename(&part, &path).unwrap();
    outcome
}

/// Shares that must hold of a set of chains; what fails, in words.
fn judged(name: &str, all: &[Outcome]) -> Vec<String> {
    let mut failed = Vec::new();
    let of: Vec<_> = all.iter().flat_map(|o| &o.coefficients).collect();
    let inside = of.iter().filter(|c| c.inside()).count();
    let square = of.iter().map(|c| c.sds().powi(2)).sum::<f64>() / of.len().max(1) as f64;
    let (poses, frames) = all
        .iter()
        .fold((0, 0), |(p, f), o| (p + o.poses, f + o.frames));
    let worst = all.iter().map(|o| o.worst_sds).fold(0.0, f64::max);
    let rms: [f64; 6] = std::array::from_fn(|i| {
        let sum: f64 = all.iter().map(|o| o.square_sds[i]).sum();
        (sum / poses.max(1) as f64).sqrt()
    });
    println!(
        "{name}: {inside} of {} coefficients inside, mean squared error in sds {square:.2}; {poses} of {frames} frames with a pose, \
         rms in sds x y z φ θ ψ {rms:.2?}, worst {worst:.1}",
        of.len()
    );
    if of.is_empty() || (inside as f64) < 0.9 * of.len() as f64 {
        failed.push(format!(
            "{name}: {inside} of {} coefficients inside",
            of.len()
        ));
    }
    if (poses as f64) < 0.9 * frames as f64 {
        failed.push(format!("{name}: {poses} of {frames} frames with a pose"));
    }
    failed
}

#[test]
#[ignore = "ten whole chains under real light and ten clean ones, a quarter of an hour"]
fn coefficients_of_ten_whole_chains_lie_within_their_intervals() {
    let folder = folder();
    let (mut lit, mut clean) = (Vec::new(), Vec::new());
    for (under, all) in [(true, &mut lit), (false, &mut clean)] {
        for chain in 0..CHAINS {
            let drawn = Drawn::new(chain);
            println!("chain {chain}: {}", drawn.light_in_words());
            let outcome = kept(&folder, &drawn, under);
            outcome.print(if under { "  lit" } else { "clean" });
            all.push(outcome);
        }
    }
    let mut failed = judged("under real light", &lit);
    failed.extend(judged("clean", &clean));
    assert!(failed.is_empty(), "{failed:#?}");
}

/// A short one of every day: one run in surge.
#[test]
fn a_small_chain_under_real_light_gives_surge_within_its_intervals() {
    const SURGE: &[Group] = &[GROUPS[0].first_run()];
    let _alone = crate::support::alone();
    let dir = tempfile::tempdir().unwrap();
    let drawn = Drawn::new(100);
    println!("{}", drawn.light_in_words());
    let outcome = run(dir.path(), &drawn, true, SURGE);
    outcome.print("lit");
    assert_eq!(outcome.coefficients.len(), 3);
    assert!(outcome.poses * 10 >= outcome.frames * 9);
    for c in &outcome.coefficients {
        // Three intervals of 95 % miss one time in seven; three sds hardly ever.
        assert!(c.sds().abs() < 3.0, "{c:?}");
    }
}
