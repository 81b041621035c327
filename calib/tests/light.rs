//! Boards as cameras with a tone curve see them: found, measured, and honest about it.
#![allow(clippy::unwrap_used, clippy::panic)]

mod light {
    pub mod views;
}

use hydroline_calib::detect::{Grey, detect};
use light::views::{KINDS, Tally, covered, flipped, judge, view};
use std::collections::BTreeMap;

fn tally(kind: &str, seeds: std::ops::Range<u64>, gamma: impl Fn(u64) -> f64) -> Tally {
    let mut tally = Tally::default();
    for seed in seeds {
        let shot = view(kind, seed, gamma(seed));
        let grey = Grey::new(720, 576, &shot.pixels).unwrap();
        tally.take(seed, detect(&grey, &shot.board).map(|d| judge(&shot, &d)));
    }
    tally
}

/// Log-uniform over the curves that are asked for, by the golden ratio.
fn spread(seed: u64) -> f64 {
    let share = (seed as f64 * 0.618_034).fract();
    0.4 * (2.5f64 / 0.4).powf(share)
}

/// The table: per board and band of γ. `LIGHT_VIEWS=40 cargo test -p hydroline-calib --test light table -- --ignored --nocapture`
#[test]
#[ignore = "hundreds of images"]
fn table_over_tone_curves() {
    let views = std::env::var("LIGHT_VIEWS").map_or(40, |v| v.parse().unwrap());
    let only = std::env::var("LIGHT_KIND").unwrap_or_default();
    println!(
        "board, gamma: found; node error rms px (median, worst view), rms(error/sd); object rms, worst mm, views within 0.1 mm"
    );
    for kind in KINDS.into_iter().filter(|k| k.contains(&only)) {
        for (name, low, high) in [
            ("0.4-0.7", 0.4, 0.7),
            ("0.7-1.4", 0.7, 1.4),
            ("1.4-2.5", 1.4, 2.5),
        ] {
            let band = tally(kind, 0..views, |seed| {
                low * (high / low as f64).powf((seed as f64 * 0.618_034).fract())
            });
            println!("{kind:9} {name}: {band}");
        }
    }
    let _ = spread(0);
}

#[test]
#[ignore]
fn dbg_reports() {
    for (name, kind) in [
        ("chess-25-g2.2", "chess-25"),
        ("chess-25-g0.45", "chess-25"),
        ("dots-50-g2.2", "dots-50"),
    ] {
        let data = std::fs::read(format!("/tmp/h/boards/{name}.pgm")).unwrap();
        let pixels = &data[data.len() - 720 * 576..];
        let board = light::views::board(kind);
        match detect(&Grey::new(720, 576, pixels).unwrap(), &board) {
            Err(e) => println!("{name}: {e}"),
            Ok(d) => {
                let map = hydroline_calib::map::fit(
                    hydroline_calib::map::Method::Homography,
                    &d.nodes(),
                    &Default::default(),
                )
                .unwrap();
                let c = hydroline_calib::Calibration::of_board(
                    map,
                    &d.nodes(),
                    hydroline_calib::calibration::board_map::Provenance {
                        medium: hydroline_calib::Medium::Air,
                        date: None,
                        board: String::new(),
                        placement: Default::default(),
                        coplanarity: hydroline_calib::board::coplanarity::Coplanarity::unknown(
                            "",
                            [0.0, 0.5, 0.5],
                        ),
                        image: None,
                        missing: vec![],
                    },
                );
                println!(
                    "{name}: {} nodes {:?} blur {:.2} noise {:.2} contrast {:.1} {:?}",
                    d.nodes.len(),
                    d.orientation,
                    d.blur_px,
                    d.noise,
                    d.contrast,
                    c.residuals
                );
                let mut worst: Vec<_> = c
                    .nodes
                    .iter()
                    .map(|n| (1e3 * n.dxi_m.hypot(n.deta_m), n.xi_m, n.eta_m))
                    .collect();
                worst.sort_by(|a, b| b.0.total_cmp(&a.0));
                println!("{:.3?}", &worst[..6]);
            }
        }
    }
}

fn counted(counts: &mut BTreeMap<String, Vec<u64>>, words: String, seed: u64) {
    counts.entry(words).or_default().push(seed);
}

#[test]
#[ignore = "hundreds of images"]
fn table_of_mirrored_and_covered_views() {
    let views: u64 = std::env::var("LIGHT_VIEWS").map_or(40, |v| v.parse().unwrap());
    let only = std::env::var("LIGHT_KIND").unwrap_or_default();
    for kind in KINDS.into_iter().filter(|k| k.contains(&only)) {
        let (mut mirrored, mut hidden) = (BTreeMap::new(), BTreeMap::new());
        for seed in 0..views {
            let short = |e: hydroline_calib::detect::NotFound| {
                e.to_string().chars().take(50).collect::<String>()
            };
            let shot = view(kind, seed, spread(seed));
            let pixels = flipped(&shot.pixels, seed % 2 == 0);
            let answer = detect(&Grey::new(720, 576, &pixels).unwrap(), &shot.board);
            counted(
                &mut mirrored,
                answer.map_or_else(short, |d| format!("FOUND {:?}", d.orientation)),
                seed,
            );
            let c = covered(kind, seed, spread(seed));
            let answer = detect(&Grey::new(720, 576, &c.shot.pixels).unwrap(), &c.shot.board);
            let words = match answer {
                Ok(d) => {
                    let hidden = d
                        .nodes
                        .iter()
                        .filter(|n| !c.visible.contains(&(n.i, n.j)))
                        .count();
                    let worth = judge(&c.shot, &d);
                    let px = (worth.sum_px2 / (2.0 * worth.nodes as f64)).sqrt();
                    format!(
                        "FOUND {:?}{}{}",
                        d.orientation,
                        if hidden > 1 { " FALSE NODES" } else { "" },
                        if px > 0.2 { " WRONG ORDER" } else { "" }
                    )
                }
                Err(hydroline_calib::detect::NotFound::Covered { missing, .. }) => {
                    if missing.starts_with(c.side) {
                        "covered, side right".to_owned()
                    } else if missing.contains(" or ") && missing.contains(c.side) {
                        "covered, side open".to_owned()
                    } else {
                        format!("covered, {} said {missing}", c.side)
                    }
                }
                Err(e) => format!(
                    "{} {}",
                    short(e),
                    if c.visible.len() * 10
                        < 4 * (c.shot.board.columns * c.shot.board.rows) as usize
                    {
                        "(<40 %)"
                    } else {
                        ""
                    }
                ),
            };
            counted(&mut hidden, words, seed);
        }
        println!("{kind} mirrored:");
        for (w, s) in &mirrored {
            println!("  {:3} {w} {:?}", s.len(), &s[..s.len().min(8)]);
        }
        println!("{kind} covered:");
        for (w, s) in &hidden {
            println!("  {:3} {w} {:?}", s.len(), &s[..s.len().min(8)]);
        }
    }
}
#[test]
#[ignore]
fn dbg_seed() {
    let c = covered("dots-50", 7, spread(7));
    std::fs::write(
        "/tmp/h/boards/seed7.pgm",
        [b"P5 720 576 255\n".as_slice(), &c.shot.pixels].concat(),
    )
    .unwrap();
}
