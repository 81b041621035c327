//! Image level.
#![allow(clippy::unwrap_used)]

use hydroline::diagnose::profiles::{candidate, fit::Problem, model::Kind, observe, prior::Motion, search};
use hydroline_rigs::Rig;
use std::path::Path;

#[test]
#[ignore]
fn look() {
    let rig = Rig::builtin("lshpi").unwrap();
    let path = std::env::var("LOG").unwrap();
    let most: usize = std::env::var("FRAMES").map_or(30, |v| v.parse().unwrap());
    let t = std::time::Instant::now();
    let run = observe::read(Path::new(&path), &rig, most).unwrap();
    println!("{} frames of {}, {:?}", run.frames.len(), run.in_log, t.elapsed());
    for f in &run.frames {
        println!(" t {:.2} bins {} edges {} haze {:.4}", f.t_s, f.bins.len(), f.edges.len(), f.profile.haze_level);
    }
    let runs = [run];
    let motions = vec![Motion::new(&runs[0], &rig).unwrap()];
    let base = candidate::Base::new(&rig).unwrap();
    let all = candidate::vocabulary(&base);
    let problem = Problem::new(&rig, base, &runs, motions);
    let found = search::search(&problem, &all, &|_| {}).unwrap();
    println!("searched {:?}", t.elapsed());
    let zero = search::Searched::score(&found.nothing);
    for f in found.all.iter().take(24) {
        let names: Vec<String> = f.effects.iter().zip(&f.state.numbers).zip(&f.sds).map(|((e, n), s)| format!("{} {:.5?} sd {:.5?}", all[*e].info.id, n, s)).collect();
        println!("{:9.1} rms {:.4} {:.4} {:.4} floors {:.4?} {}", search::Searched::score(f) - zero,
            f.rms_px(Kind::Row), f.rms_px(Kind::Width), f.rms_px(Kind::End), f.state.floors, names.join(" + "));
    }
    let b = found.best();
    println!("wobbles {:?}", b.state.wobbles.map(|w| (w.sd, w.tau_s, w.drive)));
    println!("shared {:?} {:.3?}", problem.shared, b.state.shared);
    for p in &b.state.poses[0] { println!("  {:.5?}", p); }
    for f in found.all.iter().filter(|f| f.effects.len() == 1) {
        println!("visible {} {:.2}", all[f.effects[0]].info.id, search::visibility(&all[f.effects[0]], f));
    }
}
