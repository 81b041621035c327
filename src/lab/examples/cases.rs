//! Cases and what a diagnosis says of them, printed:
//! `SEED=77 CATEGORY=unnamed COUNT=8 cargo run -p hydroline-lab --example cases`, `ONLY="unnamed-2 single-3"`, `FROM=16`,
//! `TELL=1` for each step; `IMAGES=1` for cases of images.

#![allow(clippy::unwrap_used)]

use hydroline_lab::benchmark::{Category, case, catalogue, images, make};

fn main() {
    if std::env::var_os("IMAGES").is_some() {
        of_images();
    } else {
        of_motion();
    }
}

fn of_motion() {
    let var = |n: &str| std::env::var(n).ok();
    let seed: u64 = var("SEED").map_or(1, |s| s.parse().unwrap());
    let ids: Vec<(Category, usize)> = match var("ONLY") {
        Some(only) => only
            .split_whitespace()
            .map(|id| case::parse(id).unwrap())
            .collect(),
        None => {
            let named = |n: String| Category::ALL.into_iter().find(|c| c.name() == n).unwrap();
            let count: usize = var("COUNT").map_or(8, |s| s.parse().unwrap());
            let from: usize = var("FROM").map_or(0, |s| s.parse().unwrap());
            let ids = catalogue(from + count, var("CATEGORY").map(named));
            ids.into_iter().filter(|i| i.1 >= from).collect()
        }
    };
    for (category, index) in ids {
        let made = make(seed, category, index).unwrap();
        let begun = std::time::Instant::now();
        let v = hydroline_diagnose::diagnose(
            &made.sealed.sources,
            &made.sealed.held,
            &made.sealed.rig,
            &|what| {
                if std::env::var("TELL").is_ok() {
                    println!("   {:.1} s {what}", begun.elapsed().as_secs_f64());
                }
            },
        )
        .unwrap()
        .verdict;
        let seconds = begun.elapsed().as_secs_f64();
        let truth: Vec<String> = made
            .key
            .truth
            .iter()
            .filter(|t| t.weight_m > 2e-4)
            .map(|t| {
                let near = if t.exact { "" } else { "~" };
                format!("{}{near} {:.2}", t.effect, t.weight_m * 1e3)
            })
            .collect();
        println!(
            "== {}-{index} {seconds:.1} s {} fits | there: {} {:?}\n   {:?}: {}",
            category.name(),
            v.sets_looked_at,
            truth.join(", "),
            made.key.tank.external_law,
            v.verdict,
            v.sentence
        );
        for e in &v.effects {
            println!(
                "   {} p {:.3} {:?} {:?} exact {:?} {:?}",
                e.effect, e.probability, e.words, e.weight, e.law_exact_probability, e.law_note
            );
        }
        println!(
            "   unnamed {:?} noise {:?} held out {:?}",
            v.unnamed, v.noise, v.fit.held_out
        );
    }
}

fn of_images() {
    let var = |n: &str, or: usize| std::env::var(n).map_or(or, |v| v.parse().unwrap());
    let (from, count) = (var("FROM", 0), var("COUNT", 3));
    let indices: Vec<usize> = (from..from + count).collect();
    let done = |j: &images::ImageJudged| println!("{}: {j:?}\n", j.index);
    let judged = images::run(var("SEED", 1) as u64, &indices, None, &done).unwrap();
    println!("{}", images::words(&judged));
}
