//! Cases for eyes: `SEED=77 CATEGORY=unnamed COUNT=8 cargo test -p hydroline-benchmark --lib -- --ignored --nocapture of_cases`,
//! or `ONLY="unnamed-2 single-3"`.
use super::{Category, case, catalogue, make};

#[test]
#[ignore = "for eyes"]
fn of_cases() {
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
        for a in v.alternatives.iter().take(4) {
            println!(
                "   {:.3} {:.1} {:?} {:?}",
                a.probability, a.log_evidence, a.effects, a.train
            );
        }
        println!(
            "   unnamed {:?} noise {:?} held out {:?}",
            v.unnamed, v.noise, v.fit.held_out
        );
    }
}

/// `SEED=77 COUNT=6 FROM=0 cargo test -p hydroline-benchmark --lib -- --ignored --nocapture image_cases`
#[test]
#[ignore = "for eyes"]
fn of_image_cases() {
    let var = |n: &str, or: usize| std::env::var(n).map_or(or, |v| v.parse().unwrap());
    let (from, count) = (var("FROM", 0), var("COUNT", 3));
    let indices: Vec<usize> = (from..from + count).collect();
    let done = |j: &super::images::ImageJudged| println!("{}: {j:?}\n", j.index);
    let judged = super::images::run(var("SEED", 1) as u64, &indices, None, &done).unwrap();
    println!("{}", super::images::words(&judged));
}

/// Stripes of an image case: clean, lit and with what lights them removed by its known numbers: `SEED=38 INDEX=24 … of_removal`.
#[test]
#[ignore = "for eyes"]
fn of_removal() {
    use hydroline_diagnose::profiles::candidate::Base;
    use hydroline_diagnose::profiles::geometry::Geometry;
    use hydroline_diagnose::profiles::light::Looked;
    let var = |n: &str, or: u64| std::env::var(n).map_or(or, |s| s.parse().unwrap());
    let case = super::images::make(var("SEED", 38), var("INDEX", 24) as usize).unwrap();
    let base = Base::new(&case.rig).unwrap();
    let geometry = Geometry::new(&case.rig, base.optics(&[]).unwrap());
    let truth = hydroline_sim::effect::check(&case.truth).unwrap();
    let (looked, _) = Looked::known(&case.runs, &case.rig, &base, &geometry, &truth).unwrap();
    let removed = looked.removed(&case.runs, &geometry, None).unwrap();
    for (clean, (lit, removed)) in case.clean.iter().zip(case.runs.iter().zip(&removed)) {
        for k in (0..clean.frames.len()).step_by(6) {
            println!("{} frame {k}", clean.name);
            for run in [clean, lit, removed] {
                let f = &run.frames[k];
                let dark: f64 = f.image.pixels[..36000].iter().map(|p| f64::from(*p)).sum();
                print!(
                    "   noise {:.3} dark {:.3}: ",
                    f.profile.noise_sd,
                    dark / 36000.0
                );
                for b in f.bins.iter().step_by(8) {
                    print!(
                        " {:.0}: {:.3} w {:.4}±{:.4}",
                        b.column_px, b.row_px, b.sigma_px, b.sigma_sd_px
                    );
                }
                println!();
            }
        }
    }
}
