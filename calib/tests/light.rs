//! Boards as real cameras see them: through a tone curve, mirrored, half covered. Found and measured, or
//! refused with the right reason; honest about both.
//!
//! A small share every day; the table over tone curves: `LIGHT_VIEWS=40 cargo test -p hydroline-calib --test light -- --ignored
//! --nocapture`, `LIGHT_KIND=chess-25` for one board, `LIGHT_WORST=1` names the views that do worst.
#![allow(clippy::unwrap_used, clippy::panic)]

mod light {
    pub mod views;
}
mod synthetic;

use hydroline_calib::detect::{Detection, Grey, NotFound, Orientation, detect};
use hydroline_calib::online::{OnlineCalibration, OnlineOptions};
use hydroline_rigs::Board;
use light::views::{Covered, KINDS, Tally, board, covered, flipped, judge, number, view};
use synthetic::{Scene, Tone, View, render};

fn look(board: &Board, pixels: &[u8]) -> Result<Detection, NotFound> {
    detect(&Grey::new(720, 576, pixels).unwrap(), board)
}

/// Views of a board with γ log-uniform from `low` to `high`, by the golden ratio.
fn tally(kind: &str, seeds: std::ops::Range<u64>, [low, high]: [f64; 2]) -> Tally {
    let mut tally = Tally::default();
    for seed in seeds {
        let shot = view(kind, seed, gamma(seed, [low, high]));
        let found = look(&shot.board, &shot.pixels);
        tally.take(seed, found.map(|d| judge(&shot, &d)));
    }
    tally
}

fn gamma(seed: u64, [low, high]: [f64; 2]) -> f64 {
    low * (high / low).powf((seed as f64 * 0.618_034).fract())
}

const CURVES: [f64; 2] = [0.4, 2.5];

#[test]
fn a_cameras_tone_curve_hides_no_board_and_no_error() {
    let mut all = Tally::default();
    for kind in KINDS {
        let of = tally(kind, 100..105, CURVES);
        println!("{kind}: {of}");
        all.asked += of.asked;
        all.worth.extend(of.worth);
        all.missed.extend(of.missed);
    }
    // Thin lines in the strongest noise and blur are what is lost.
    assert!(all.found() >= 0.95, "{all}");
    assert!((0.8..1.25).contains(&all.sds()), "{all}");
    assert!(all.within_mm(0.1) >= 0.95, "{all}");
}

#[test]
#[ignore = "hundreds of images"]
fn table_over_tone_curves() {
    println!(
        "board, gamma: found; node error rms px (median, worst view), rms(error/sd); object rms (median), worst mm, views within 0.1 mm; nodes; residuals over noise (median, worst)"
    );
    for kind in KINDS.into_iter().filter(|k| chosen(k)) {
        for band in [[0.4, 0.7], [0.7, 1.4], [1.4, 2.5]] {
            let all = tally(kind, 0..number("LIGHT_VIEWS", 40.0) as u64, band);
            println!("{kind:9} {}-{}: {all}", band[0], band[1]);
            assert!(all.found() >= 0.95, "{kind} {band:?}");
            assert!((0.8..1.25).contains(&all.sds()), "{kind} {band:?}");
            assert!(all.within_mm(0.1) >= 0.95, "{kind} {band:?}");
        }
    }
}

fn chosen(kind: &str) -> bool {
    kind.contains(&std::env::var("LIGHT_KIND").unwrap_or_default())
}

/// The reports' views: 45° from above, linear noise of 2 under the curve, a black tank behind the board.
fn reported(board: &Board, gamma: f64) -> (View, Vec<u8>) {
    let half = hydroline_calib::board::half_size_m(board);
    let view = View::pinhole(
        [720, 576],
        740.0,
        740.0 * half[1] / 250.0 + 0.7 * half[1],
        0.785,
        std::f64::consts::FRAC_PI_2,
        0.0,
    );
    let scene = Scene {
        greys: [170.0, 25.0, 2.0],
        light: [1.0, 0.9, 1.0, 0.8],
        tone: Tone {
            gamma,
            noise_before: true,
            ..Tone::LINEAR
        },
        seed: 3,
        ..Scene::default()
    };
    let pixels = render(board, &view, &scene);
    (view, pixels)
}

/// Reported: "no board in the image" (γ 2.2) and "key is hidden" (0.45).
#[test]
fn a_chessboard_pressed_or_lifted_by_the_camera_is_found_with_its_key() {
    let board = board("chess-25");
    for gamma in [2.2, 0.45] {
        let found = look(&board, &reported(&board, gamma).1).unwrap();
        assert_eq!(found.orientation, Orientation::KeySeen, "gamma {gamma}");
        assert!(found.nodes.len() >= 138, "{}", found.nodes.len());
        let seen = found.gamma.unwrap();
        assert!((0.7..1.4).contains(&(seen / gamma)), "{seen} for {gamma}");
    }
    // A linear camera has no curve, and nothing is fitted that is not there.
    assert_eq!(look(&board, &reported(&board, 1.0).1).unwrap().gamma, None);
}

/// Reported: 0.12 mm where 0.018 are usual, without a word.
#[test]
fn residuals_beyond_noise_are_said() {
    let board = board("dots-50");
    let found = look(&board, &reported(&board, 2.2).1).unwrap();
    let residuals = |found: &Detection| {
        let mut online = OnlineCalibration::new(board.clone(), OnlineOptions::default());
        online.push(found, None).misfit.unwrap()
    };
    let usual = residuals(&found);
    assert!(usual.ratio < 1.5, "{}", usual.words());
    // A board whose outer column was drawn 0.3 mm off; one dot with something on it.
    let mut shifted = found.clone();
    for n in shifted.nodes.iter_mut().filter(|n| n.i < 3) {
        n.node.row_px += 0.3 * f64::from(n.j % 2);
    }
    let said = residuals(&shifted);
    assert!(
        said.unusual() && said.words().contains("OUT OF THE ORDINARY"),
        "{}",
        said.words()
    );
    let mut stained = found.clone();
    stained.nodes[60].node.column_px += 0.4;
    let said = residuals(&stained);
    assert!(said.unusual() && said.words().contains("worst node"));
    assert!(said.worst_sds > 5.0 && said.ratio < usual.ratio + 1.0);
}

#[test]
fn a_mirrored_image_is_refused_by_the_key() {
    for kind in KINDS {
        for seed in 200..203 {
            let shot = view(kind, seed, gamma(seed, CURVES));
            let mirrored = flipped(&shot.pixels, seed % 2 == 0);
            let reason = look(&shot.board, &mirrored).unwrap_err();
            assert!(
                matches!(reason, NotFound::Mirrored { .. }),
                "{kind} {seed}: {reason}"
            );
            let words = reason.to_string();
            assert!(
                words.contains("mirrored") && words.contains("horizontal_flip"),
                "{words}"
            );
            // Flipped both ways it is rotated, not mirrored.
            let rotated = flipped(&flipped(&shot.pixels, true), false);
            assert!(look(&shot.board, &rotated).is_ok(), "{kind} {seed}");
        }
    }
}

/// Without a key nothing on a chessboard tells left from right: the orientation says that it is assumed.
#[test]
fn without_a_key_nobody_can_tell_that_the_image_is_mirrored() {
    let board = board("chess-25");
    let scene = Scene {
        key: false,
        ..Scene::default()
    };
    let view = View::pinhole([720, 576], 740.0, 0.5, 0.3, 1.57, 0.05);
    let pixels = flipped(&render(&board, &view, &scene), false);
    let found = look(&board, &pixels).unwrap();
    assert_eq!(found.orientation, Orientation::UprightAssumed);
}

/// Outcome of a covered board, in words to be counted; wrong ones are in capitals.
fn judge_covered(c: &Covered) -> String {
    let (board, of) = (
        &c.shot.board,
        (c.shot.board.columns * c.shot.board.rows) as usize,
    );
    match look(board, &c.shot.pixels) {
        Ok(d) if !d.orientation.is_usable() => "key hidden".to_owned(),
        Ok(d) => {
            let hidden = d.nodes.iter().filter(|n| !c.visible.contains(&(n.i, n.j)));
            let worth = judge(&c.shot, &d);
            let order = (worth.sum_px2 / (2.0 * worth.nodes as f64)).sqrt() > 0.2;
            let mut online = OnlineCalibration::new(board.clone(), OnlineOptions::default());
            let part = online.push(&d, None).missing_part;
            let reported = part.as_ref().is_some_and(|p| p.contains(c.side));
            let wrong = [
                (hidden.count() > 1, " WITH FALSE NODES"),
                (order, " IN WRONG ORDER"),
                (!reported && d.nodes.len() * 10 < of * 7, " WITHOUT A WORD"),
            ];
            let wrong: String = wrong.iter().filter(|w| w.0).map(|w| w.1).collect();
            format!("calibrates the rest{wrong}")
        }
        Err(NotFound::Covered { missing, nodes, .. }) if missing.contains(c.side) => {
            let exact = nodes <= c.visible.len() && nodes * 10 >= c.visible.len() * 7;
            let count = if exact { "" } else { " WRONG COUNT" };
            if missing.contains(" or ") {
                format!("covered, one side or the other{count}")
            } else {
                format!("covered, the right side{count}")
            }
        }
        Err(NotFound::Covered { missing, .. }) => format!("covered, WRONG SIDE {missing}"),
        // Fewer than three in ten are no board.
        Err(NotFound::NoBoard) if c.visible.len() * 10 < of * 35 => "too few nodes".to_owned(),
        Err(other) => format!("WRONG REASON {other}"),
    }
}

#[test]
fn a_half_covered_board_says_so_or_calibrates_the_rest() {
    for kind in ["dots-50", "chess-25"] {
        for seed in 300..306 {
            let words = judge_covered(&covered(kind, seed, gamma(seed, CURVES)));
            println!("{kind} {seed}: {words}");
            assert!(
                !words.chars().any(|c| c.is_ascii_uppercase()),
                "{kind} {seed}: {words}"
            );
        }
    }
}
