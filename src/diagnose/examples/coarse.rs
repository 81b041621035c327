//! Temporary.
use hydroline_diagnose::{Part, read};
use hydroline_inference::{fit::*, prior::PriorTable, recording::Recording, search::*};
use hydroline_rigs::{Dof, Rig};
fn main() {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let rig = Rig::load(std::path::Path::new(&args[0])).unwrap();
    let given: Vec<usize> = args[1]
        .split(',')
        .filter(|s| !s.is_empty())
        .map(|n| Dof::ALL.into_iter().position(|d| d.name() == n).unwrap())
        .collect();
    let runs: Vec<_> = args[2..]
        .iter()
        .map(|a| {
            let p: Part = a.parse().unwrap();
            read(p, &rig).unwrap().run
        })
        .collect();
    let recording = Recording::new(&runs, rig.tank.start_pose[5]);
    let mut dofs = recording.moving(&rig.tolerance.channels());
    dofs.retain(|d| !given.contains(d));
    let p = Problem::beside(&runs, &rig, &dofs, &given, PriorTable::default()).unwrap();
    let t = std::time::Instant::now();
    println!(
        "dofs {dofs:?} noise {:?}",
        p.noises
            .channels
            .each()
            .filter_map(|(c, n)| Some((c.name(), n.as_ref()?.total_sd())))
            .collect::<Vec<_>>()
    );
    let f = search(
        p,
        Options {
            floor_over_tolerance: std::env::var("SHARE")
                .ok()
                .and_then(|v| v.parse().ok())
                .unwrap_or(0.05),
            ..Options::default()
        },
        hydroline_inference::limit::Watch::unlimited(&|s: &str| {
            println!("{:.1} s {s}", t.elapsed().as_secs_f64())
        }),
    )
    .unwrap();
    let p = &f.problem;
    println!(
        "{:.2} s, {} fits, floor {:?}",
        t.elapsed().as_secs_f64(),
        f.fits,
        p.noises.floor_sd.by_name()
    );
    let mut all: Vec<_> = f.models.values().collect();
    all.sort_by(|a, b| b.ln_score.total_cmp(&a.ln_score));
    for m in all.iter().take(12) {
        println!(
            "{:.1} {:?} {:?} {:?} {:?}",
            m.ln_score,
            m.terms
                .iter()
                .map(|t| p.body.candidates[*t].name())
                .collect::<Vec<_>>(),
            m.cells.misfit[dofs[0]],
            p.left(&m.terms, &m.point).by_name(),
            p.body
                .natural(&m.terms, &m.point)
                .iter()
                .map(|v| v.0 as f32)
                .take(9)
                .collect::<Vec<_>>()
        );
    }
}
