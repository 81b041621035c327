//! ChArUco boards in difficult pictures: found, every corner under its own index, and none wrong.
//!
//! `CHARUCO=100 cargo test -p hydroline-calib --release --test charuco -- --ignored --nocapture`; `CHARUCO_OUT=DIR` writes
//! pictures, truth and found corners for `calib/benches/charuco_opencv.py`.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

mod synthetic;

use std::fmt::Write as _;
use std::path::Path;

use hydroline_calib::charuco::Markers;
use hydroline_calib::detect::{Grey, InHand, NotFound, detect_in_hand};
use hydroline_rigs::BoardPattern;
use synthetic::hard::{Picture, charuco_picture};

/// A corner further off is another corner \[px\], or one that nobody can use.
const WRONG_PX: f64 = 0.5;

#[derive(Default)]
struct Totals {
    /// A person sees the board.
    asked: usize,
    found: usize,
    /// Of those found, whose markers said which corner is which.
    identified: usize,
    /// Whose markers did not, although the picture is in focus.
    unread: usize,
    corners: usize,
    /// Off, or under another index than their own.
    wrong: usize,
    square_sum_px2: f64,
}

/// Distance of each corner from where its index says it is \[px\].
fn offs(picture: &Picture, found: &InHand) -> Vec<f64> {
    let columns = picture.board.columns as usize;
    let off = |n: &hydroline_calib::detect::LatticeNode| {
        let [i, j] = n.index.map(|k| usize::try_from(k).unwrap());
        let (p, _) = picture.nodes[j * columns + i];
        (n.pixel[0] - p[0]).hypot(n.pixel[1] - p[1])
    };
    found.nodes.iter().map(off).collect()
}

fn run(seeds: impl Iterator<Item = u64>, out: Option<&Path>) -> Totals {
    let mut totals = Totals::default();
    for seed in seeds {
        let picture = charuco_picture(seed);
        let [w, h] = picture.size;
        let grey = Grey::new(w, h, &picture.pixels).unwrap();
        let begun = std::time::Instant::now();
        let found = detect_in_hand(&grey, &picture.board);
        let mut line = picture.head_line(seed, begun.elapsed()) + ": ";
        let counts = picture.is_of_board();
        totals.asked += usize::from(counts);
        match &found {
            Ok(found) if found.identified => {
                let offs = offs(&picture, found);
                let squares: f64 = offs.iter().map(|o| o * o).sum();
                totals.found += usize::from(counts);
                totals.identified += usize::from(counts);
                totals.corners += offs.len();
                totals.wrong += offs.iter().filter(|o| **o > WRONG_PX).count();
                totals.square_sum_px2 += squares;
                write!(
                    line,
                    "{} found, rms {:.3} px, worst {:.2} px, blur {:.2}",
                    offs.len(),
                    (squares / offs.len() as f64).sqrt(),
                    offs.iter().copied().fold(0.0, f64::max),
                    found.blur_px
                )
                .unwrap();
            }
            Ok(found) => {
                totals.found += usize::from(counts);
                let sharp = picture.difficulty != "defocused";
                totals.unread += usize::from(counts && sharp);
                write!(line, "{} found, markers not read", found.nodes.len()).unwrap();
            }
            Err(why) => write!(line, "{}{why}", if counts { "MISSED: " } else { "" }).unwrap(),
        }
        println!("{line}");
        if let Some(out) = out {
            write(out, seed, &picture, found.as_ref().ok());
        }
    }
    println!(
        "{} of {} boards found, of {} the markers read; {} corners, rms {:.3} px, {} wrong",
        totals.found,
        totals.asked,
        totals.identified,
        totals.corners,
        (totals.square_sum_px2 / totals.corners.max(1) as f64).sqrt(),
        totals.wrong
    );
    totals
}

fn write(out: &Path, seed: u64, picture: &Picture, found: Option<&InHand>) {
    let [w, h] = picture.size;
    let mut file = format!("P5\n{w} {h}\n255\n").into_bytes();
    file.extend(&picture.pixels);
    std::fs::write(out.join(format!("{seed:04}.pgm")), file).unwrap();
    let markers = Markers::of(&picture.board).unwrap();
    let b = &picture.board;
    let id = |k: [i32; 2]| markers.corner_id(k).unwrap();
    let mut truth = format!(
        "# {} {} {} {} {}\n",
        b.columns,
        b.rows,
        markers.dictionary.name(),
        markers.share,
        picture.difficulty
    );
    for (n, (p, seen)) in picture.nodes.iter().enumerate() {
        let k = [n as i32 % b.columns as i32, n as i32 / b.columns as i32];
        writeln!(truth, "{} {} {} {}", id(k), p[0], p[1], u8::from(*seen)).unwrap();
    }
    std::fs::write(out.join(format!("{seed:04}.txt")), truth).unwrap();
    let mut ours = String::new();
    for n in found.filter(|f| f.identified).map_or(&[][..], |f| &f.nodes) {
        writeln!(ours, "{} {} {}", id(n.index), n.pixel[0], n.pixel[1]).unwrap();
    }
    std::fs::write(out.join(format!("{seed:04}.ours")), ours).unwrap();
}

#[test]
#[ignore = "minutes; the command is in the book"]
fn a_hundred_pictures() {
    let number = |name: &str, usual: u64| std::env::var(name).map_or(usual, |v| v.parse().unwrap());
    let out = std::env::var("CHARUCO_OUT").ok().filter(|v| !v.is_empty());
    let from = number("CHARUCO_FROM", 0);
    let totals = run(
        from..from + number("CHARUCO", 100),
        out.as_deref().map(Path::new),
    );
    assert!(totals.found * 100 >= totals.asked * 95);
    assert_eq!((totals.wrong, totals.unread), (0, 0));
}

#[test]
fn a_share_of_them() {
    let totals = run([15, 16, 28, 78, 99].into_iter(), None);
    assert_eq!((totals.identified, totals.wrong), (totals.asked, 0));
}

/// One picture under other board files: what is wrong with each is said.
#[test]
fn another_board_is_said_to_be_another() {
    let picture = charuco_picture(15);
    let [w, h] = picture.size;
    let grey = Grey::new(w, h, &picture.pixels).unwrap();
    assert!(detect_in_hand(&grey, &picture.board).unwrap().identified);
    let BoardPattern::Charuco {
        dictionary,
        marker_m,
    } = picture.board.pattern
    else {
        panic!("no markers")
    };
    let asked = |side: u32, columns: u32| {
        let mut board = picture.board.clone();
        board.columns = columns;
        board.pattern = BoardPattern::Charuco {
            dictionary: hydroline_rigs::Dictionary { side, ..dictionary },
            marker_m,
        };
        detect_in_hand(&grey, &board)
    };
    // The picture's dictionary has sides of 4.
    match asked(6, picture.board.columns) {
        Err(NotFound::OtherMarkers { seen, .. }) => assert_eq!(seen, Some(4)),
        other => panic!("{other:?}"),
    }
    match asked(4, picture.board.columns + 1) {
        Err(why @ NotFound::OtherMarkers { seen: Some(4), .. }) => {
            assert!(why.to_string().contains("check columns and rows"), "{why}");
        }
        other => panic!("{other:?}"),
    }
    // In a mirror.
    let pixels: Vec<u8> = (picture.pixels.chunks(w))
        .flat_map(|row| row.iter().rev().copied())
        .collect();
    let mirrored = detect_in_hand(&Grey::new(w, h, &pixels).unwrap(), &picture.board);
    assert_eq!(mirrored, Err(NotFound::Mirrored { aside: false }));
}
