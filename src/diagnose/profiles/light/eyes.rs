//! Logs for eyes: `LOGS="a.mcap b.mcap" cargo test -p hydroline-diagnose --lib -- --ignored --nocapture light_of_logs`.

use crate::profiles::level;
use hydroline_rigs::Rig;

#[test]
#[ignore = "for eyes"]
fn light_of_logs() {
    let rig = Rig::builtin("lshpi").unwrap();
    for log in std::env::var("LOGS").unwrap_or_default().split_whitespace() {
        let begun = std::time::Instant::now();
        let trace = |what: &str| println!("   {:.1} s: {what}", begun.elapsed().as_secs_f64());
        let found = match level(&[log.into()], &rig, &trace) {
            Ok(found) => found.unwrap(),
            Err(error) => {
                println!("{log}: {error}");
                continue;
            }
        };
        let seconds = begun.elapsed().as_secs_f64();
        println!(
            "{log}: {seconds:.1} s, {:?}, odds {:.0}: {}",
            found.word,
            found.log_odds,
            found.sentence()
        );
        for e in &found.effects {
            println!(
                "   {} p {:.4} {:?} {:?} or {:?}",
                e.effect, e.probability, e.parameters, e.words, e.or
            );
        }
        println!("   {:?} {:?}", found.equivalent, found.notes);
    }
}

/// What an even light on a linear camera leaves, by frame and row below the stripe: `LOGS` as above, `cargo test … left_by_rows`.
#[test]
#[ignore = "for eyes"]
fn left_by_rows() {
    use crate::profiles::candidate::Base;
    use crate::profiles::geometry::Geometry;
    use crate::profiles::observe;
    let rig = Rig::builtin("lshpi").unwrap();
    let base = Base::new(&rig).unwrap();
    let geometry = Geometry::new(&rig, base.optics(&[]).unwrap());
    for log in std::env::var("LOGS").unwrap_or_default().split_whitespace() {
        let run = observe::read(log.as_ref(), &rig, 52).unwrap();
        let (looked, _) = super::Looked::known(&[run], &rig, &base, &geometry, &[]).unwrap();
        let (data, best) = (&looked.data, looked.best());
        println!(
            "{log}: ln evidence {:.1}, floors {:?}",
            best.ln_evidence, data.floors
        );
        println!("   shared {:.2?}", best.state.nuisance);
        let mut left = best.left.iter();
        for (frame, own) in data.frames.iter().zip(&best.state.own) {
            let mut sums = std::collections::BTreeMap::<i64, (f64, f64, f64)>::new();
            for sample in frame.bins.iter().flat_map(|b| &b.samples) {
                let l = left.next().unwrap();
                let Some(below) = sample.below_px else {
                    continue;
                };
                let sum = sums.entry(below.round() as i64).or_default();
                sum.0 += l.off * l.belongs;
                sum.1 += l.belongs;
                sum.2 += l.noise * l.belongs;
            }
            println!("   own {own:.2?}, bins {}", frame.bins.len() - 1);
            let mean = |(row, s): (&i64, &(f64, f64, f64))| {
                format!("{row}: {:+.2}±{:.2}", s.0 / s.1, s.2.sqrt() / s.1)
            };
            let near = sums.iter().filter(|(r, _)| r.abs() < 12);
            println!("      {}", near.map(mean).collect::<Vec<_>>().join("  "));
        }
    }
}
