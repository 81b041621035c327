//! Why no board was found, in words one can act on.

use hydroline_rigs::{Board, BoardPattern};

use super::image::{Grey, Plane};

/// Why there are no nodes.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum NotFound {
    #[error(
        "the image is empty: {width} × {height} px, grey levels within {range:.0}; check lens cap, light and exposure"
    )]
    Empty {
        width: usize,
        height: usize,
        /// Spread of the grey levels (1st to 99th percentile).
        range: f64,
    },
    #[error(
        "{:.0} % of the image is saturated; shorten the exposure until the board's white is below 230", 100.0 * share
    )]
    Saturated {
        /// Share of pixels at 254 or 255.
        share: f64,
    },
    #[error(
        "the image is blurred by {blur_px:.1} px; nodes need less than 3 px: focus (`hydroline aim`), or hold the board still"
    )]
    Blurred {
        /// Standard deviation of the point spread \[px\].
        blur_px: f64,
    },
    #[error("no board in the image; bring the board into view, dark marks on a light face")]
    NoBoard,
    #[error("another board than the file's: {} nodes{} seen, {} × {} expected; give the file of the board that is in the tank",
        format_args!("{} × {}", seen[0], seen[1]),
        pattern.map(|p| format!(" of {p}")).unwrap_or_default(), wanted[0], wanted[1])]
    WrongBoard {
        seen: [u32; 2],
        wanted: [u32; 2],
        /// Pattern seen, where it is not the file's.
        pattern: Option<&'static str>,
    },
    #[error(
        "only {} × {} of {} × {} nodes are in view and no key says which; show all columns and rows, or use a board with a key",
        seen[0], seen[1], wanted[0], wanted[1]
    )]
    PartlySeen { seen: [u32; 2], wanted: [u32; 2] },
    #[error(
        "{} × {} nodes are seen, but the image ends little more than half a step beyond them and no key says that they are the board's: a tiled floor looks the same; show what is around the board, or use a board with a key",
        seen[0], seen[1]
    )]
    EndNotSeen { seen: [u32; 2] },
    #[error(
        "{nodes} of {of} nodes are seen, the {missing} of the board is missing and no key says which node is which: take away what is in front of the board; if nothing is, give the file of the board that is in the tank"
    )]
    Covered {
        nodes: usize,
        of: usize,
        /// Which part is missing, as the camera sees it.
        missing: String,
    },
    #[error("the image is mirrored{}: the board's key runs the wrong way round; switch off the camera's flip (`horizontal_flip` or `vertical_flip`, whichever is on: a [[camera.control]] in the rig with value = 0, or v4l2-ctl), or take the mirror out of the light's way{}",
        if *aside { ", or the board lies on its side" } else { "" },
        if *aside { "; if the board lies on its side, put it upright: this board and its key look the same both ways" } else { "" })]
    Mirrored {
        /// A board on its side would look the same.
        aside: bool,
    },
    #[error(
        "the board lies on its side ({} × {} nodes seen, {} × {} expected); put it upright",
        seen[0], seen[1], wanted[0], wanted[1]
    )]
    NotUpright { seen: [u32; 2], wanted: [u32; 2] },
    #[error("another board than the file's: of {squares} light squares with a marker too few are those of {dictionary} in their places; {}",
        match seen {
            Some(side) if dictionary.contains(&format!("_{side}X")) => "the dictionary fits: check columns and rows (nodes are inner corners, one less than squares), and that the square at the upper left is dark (OpenCV's legacy pattern is another one)".to_owned(),
            Some(side) => format!("they are of a dictionary DICT_{side}X{side}: give the file of the board that is in view"),
            None => "they are of no 4X4 to 7X7 dictionary of OpenCV's, or marker_m is wrong: measure the markers' side with their dark border".to_owned(),
        })]
    OtherMarkers {
        squares: usize,
        dictionary: &'static str,
        /// Bits along the side of the markers seen.
        seen: Option<u32>,
    },
    #[error("two boards in view ({first} and {second} nodes); cover or remove one")]
    TwoBoards { first: usize, second: usize },
}

/// Share of saturated pixels that explains a board that is not found: marks are lost by a twentieth
/// of the image, which is a fifth of a board that fills half of it.
const SATURATED: f64 = 0.05;

/// Range of grey levels below which there is nothing to see: some noise.
const EMPTY_RANGE: f64 = 25.0;

/// 1st and 99th percentile, and the share of saturated pixels.
fn levels(image: &Grey<'_>) -> (f64, f64) {
    let mut histogram = [0usize; 256];
    for &v in image.pixels() {
        histogram[usize::from(v)] += 1;
    }
    let total = image.pixels().len().max(1);
    let percentile = |share: f64| {
        let mut sum = 0;
        let goal = (share * total as f64) as usize;
        histogram
            .iter()
            .position(|&n| {
                sum += n;
                sum > goal
            })
            .unwrap_or(255) as f64
    };
    (
        percentile(0.99) - percentile(0.01),
        (histogram[254] + histogram[255]) as f64 / total as f64,
    )
}

pub(super) fn refuse_empty(image: &Grey<'_>) -> Result<(), NotFound> {
    let small = image.width() < 48 || image.height() < 48;
    let (range, saturated) = if small { (0.0, 0.0) } else { levels(image) };
    if saturated > 0.9 {
        return Err(NotFound::Saturated { share: saturated });
    }
    if small || range < EMPTY_RANGE {
        return Err(NotFound::Empty {
            width: image.width(),
            height: image.height(),
            range,
        });
    }
    Ok(())
}

/// The reason for an image in which the board was not found.
pub(super) fn explain(image: &Grey<'_>, board: &Board) -> NotFound {
    let (_, saturated) = levels(image);
    if saturated > SATURATED {
        return NotFound::Saturated { share: saturated };
    }
    for (pattern, name) in [
        (BoardPattern::Chessboard, "a chessboard"),
        (
            BoardPattern::Dots {
                diameter_m: 0.3 * board.pitch_m,
            },
            "dots",
        ),
        (
            BoardPattern::Lines {
                line_m: 0.04 * board.pitch_m,
            },
            "lines",
        ),
    ] {
        if std::mem::discriminant(&pattern) == std::mem::discriminant(&board.pattern) {
            continue;
        }
        if let Some(seen) = super::seen_as(image, board, pattern) {
            return NotFound::WrongBoard {
                seen,
                wanted: [board.columns, board.rows],
                pattern: Some(name),
            };
        }
    }
    let blur_px = sharpest_edge_px(image);
    if blur_px > super::WORST_BLUR_PX {
        return NotFound::Blurred { blur_px };
    }
    NotFound::NoBoard
}

/// Blur of the sharpest edges: an edge of height c blurred by s rises by c/(s√2π) per
/// pixel at most, so the ratio of range to slope among the strongest slopes says how
/// sharp anything in the image is. 0 when nothing stands out of the noise.
fn sharpest_edge_px(image: &Grey<'_>) -> f64 {
    let plane = Plane::smoothed(image, 2);
    let (w, h) = (plane.width, plane.height);
    const REACH: usize = 8;
    if w < 4 * REACH || h < 4 * REACH {
        return 0.0;
    }
    let mut blurs = Vec::new();
    let mut slopes: Vec<(f32, usize)> = Vec::with_capacity(w * h);
    for r in REACH..h - REACH {
        for c in REACH..w - REACH {
            let i = r * w + c;
            let (gx, gy) = (
                0.5 * (plane.values[i + 1] - plane.values[i - 1]),
                0.5 * (plane.values[i + w] - plane.values[i - w]),
            );
            slopes.push((gx.hypot(gy), i));
        }
    }
    let k = slopes.len() / 200;
    slopes.select_nth_unstable_by(k, |a, b| b.0.total_cmp(&a.0));
    for &(slope, i) in &slopes[..k] {
        let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
        for d in 0..=2 * REACH {
            for v in [
                plane.values[i + d - REACH],
                plane.values[i + d * w - REACH * w],
            ] {
                low = low.min(v);
                high = high.max(v);
            }
        }
        if slope > 1.0 {
            // In image pixels; the plane's own smoothing (1 pixel of 2) taken off.
            let s = f64::from((high - low) / slope) / (2.0 * std::f64::consts::PI).sqrt();
            blurs.push(2.0 * (s * s - 1.0).max(0.0).sqrt());
        }
    }
    blurs.sort_by(f64::total_cmp);
    blurs.get(blurs.len() / 2).copied().unwrap_or(0.0)
}
