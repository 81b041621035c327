//! Target and board files as typed.

use super::{Section, quantity};
use crate::{Board, BoardPattern, GaugeBlock, Slab, SlabOutline, Target};

/// Corners a polygon may have: the check for crossings looks at every pair of sides.
const MOST_CORNERS: usize = 1000;

/// Reads a target's own keys: `name`, `[[slab]]`, `origin_m`, `heading_deg`.
pub(crate) fn read_target(s: &Section<'_>) -> Option<Target> {
    let name = s.name("name");
    let placement = read_placement(s);
    let entries = s.tables("slab", 256);
    if entries.is_empty() && !s.has("slab") {
        s.missing(
            "slab",
            "at least one [[slab]]; for a bare floor leave the target out of the rig",
        );
    }
    let slabs: Vec<Option<Slab>> = entries.iter().map(read_slab).collect();
    s.finish();
    let slabs: Vec<Slab> = slabs.into_iter().collect::<Option<_>>()?;
    for (i, slab) in slabs.iter().enumerate() {
        if slabs[..i].iter().any(|earlier| earlier.name == slab.name) {
            entries[i].rule(
                "name",
                format!("the name {} is used twice", slab.name),
                "Give every slab its own name",
            );
        }
    }
    let (origin, heading) = placement?;
    let [x, y] = origin.unwrap_or([0.0; 2]);
    (!slabs.is_empty()).then_some(())?;
    Some(Target {
        name: name?,
        slabs,
        origin: [x, y, heading.unwrap_or(0.0)],
    })
}

/// Place of a target on the floor as typed: X and Y \[m\], heading \[rad\].
pub(super) type Placement = (Option<[f64; 2]>, Option<f64>);

/// `origin_m` and `heading_deg` where typed.
pub(super) fn read_placement(s: &Section<'_>) -> Option<Placement> {
    let origin = s.numbers_opt("origin_m", quantity(-1000.0, 1000.0, "m"));
    let heading = s.angle_opt("heading", quantity(-360.0, 360.0, "deg"));
    if (origin.is_none() && s.has("origin_m"))
        || (heading.is_none() && (s.has("heading_rad") || s.has("heading_deg")))
    {
        return None;
    }
    Some((origin, heading))
}

#[derive(Clone, Copy)]
enum Shape {
    Rectangle,
    HexagonChain,
    Polygon,
}

fn read_slab(s: &Section<'_>) -> Option<Slab> {
    let name = s.name("name");
    let shape = s.choice(
        "shape",
        &[
            ("rectangle", Shape::Rectangle),
            ("hexagon_chain", Shape::HexagonChain),
            ("polygon", Shape::Polygon),
        ],
    );
    let length = quantity(-1000.0, 1000.0, "m");
    let size = quantity(0.0, 1000.0, "m").above();
    let outline = match shape {
        Some(Shape::Rectangle) => {
            let (x0, x1) = (s.number("x0_m", length), s.number("x1_m", length));
            let width = s.number("width_m", size);
            if let (Some(x0), Some(x1)) = (x0, x1)
                && x0 >= x1
            {
                s.rule(
                    "x1_m",
                    format!("the slab ends at {x1} m, before its start at {x0} m"),
                    "Enter x0_m below x1_m",
                );
            }
            x0.zip(x1)
                .zip(width)
                .map(|((x0_m, x1_m), width_m)| SlabOutline::Rectangle {
                    x0_m,
                    x1_m,
                    width_m,
                })
        }
        Some(Shape::HexagonChain) => {
            let (x0, side) = (s.number("x0_m", length), s.number("side_m", size));
            let count = s.integer("count", 1, 1000, "hexagons");
            x0.zip(side)
                .zip(count)
                .map(|((x0_m, side_m), count)| SlabOutline::HexagonChain {
                    x0_m,
                    side_m,
                    count: count as u32,
                })
        }
        Some(Shape::Polygon) => read_polygon(s),
        None => {
            // Which of these belong here is unknown until the shape is: blame none.
            for key in ["x0_m", "x1_m", "width_m", "side_m", "count", "points_m"] {
                s.item(key);
            }
            None
        }
    };
    let top_m = s.number("top_m", quantity(0.0, 10.0, "m").above());
    let albedo = s.number_or("albedo", quantity(0.0, 10.0, ""), 1.0);
    s.finish();
    Some(Slab {
        name: name?,
        outline: outline?,
        top_m: top_m?,
        albedo,
    })
}

fn read_polygon(s: &Section<'_>) -> Option<SlabOutline> {
    let expected = "a list of 3 to 1000 corners [x, y] in m";
    s.asks_number(
        "points_m",
        "corners [x, y]",
        &quantity(-1000.0, 1000.0, "m"),
    );
    s.requires("points_m");
    let Some(item) = s.item("points_m") else {
        s.missing("points_m", format!("`points_m = [[x, y], …]`, {expected}"));
        return None;
    };
    let elements = s.elements(&item, expected)?;
    if !(3..=MOST_CORNERS).contains(&elements.len()) {
        s.wrong_type(&item, expected);
        return None;
    }
    let corner = quantity(-1000.0, 1000.0, "m");
    let points: Vec<Option<[f64; 2]>> = elements
        .iter()
        .map(|element| s.numbers_of(element, &corner))
        .collect();
    let points_m: Vec<[f64; 2]> = points.into_iter().collect::<Option<_>>()?;
    if let Some((i, k)) = crossing(&points_m) {
        s.rule(
            "points_m",
            format!(
                "side {i} (from {:?}) meets side {k} (from {:?})",
                points_m[i], points_m[k]
            ),
            "List the corners in order round the outline, each once",
        );
        return None;
    }
    Some(SlabOutline::Polygon { points_m })
}

/// The first two sides of a closed polygon that touch where they should not.
fn crossing(points: &[[f64; 2]]) -> Option<(usize, usize)> {
    let n = points.len();
    let side = |i: usize| (points[i], points[(i + 1) % n]);
    for i in 0..n {
        let (a, b) = side(i);
        if a == b {
            return Some((i, (i + 1) % n));
        }
        for k in i + 1..n {
            let (c, d) = side(k);
            let neighbours = k == i + 1 || (i == 0 && k == n - 1);
            let touch = if neighbours {
                // They share one corner; folding back along the other side is the fault.
                let (shared, p, q) = if k == i + 1 { (b, a, d) } else { (a, b, c) };
                turn(shared, p, q) == 0.0 && along(shared, p, q) > 0.0
            } else {
                meet(a, b, c, d)
            };
            if touch {
                return Some((i, k));
            }
        }
    }
    None
}

/// Twice the signed area of the triangle o, a, b.
fn turn(o: [f64; 2], a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0])
}

fn along(o: [f64; 2], a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - o[0]) * (b[0] - o[0]) + (a[1] - o[1]) * (b[1] - o[1])
}

/// Whether the closed segments ab and cd have a point in common.
fn meet(a: [f64; 2], b: [f64; 2], c: [f64; 2], d: [f64; 2]) -> bool {
    let on = |o: [f64; 2], p: [f64; 2], q: [f64; 2]| turn(o, p, q) == 0.0 && along(q, o, p) <= 0.0;
    let (t1, t2, t3, t4) = (turn(a, b, c), turn(a, b, d), turn(c, d, a), turn(c, d, b));
    let properly = (t1 > 0.0) != (t2 > 0.0)
        && (t3 > 0.0) != (t4 > 0.0)
        && t1 != 0.0
        && t2 != 0.0
        && t3 != 0.0
        && t4 != 0.0;
    properly || on(a, b, c) || on(a, b, d) || on(c, d, a) || on(c, d, b)
}

#[derive(Clone, Copy)]
enum Pattern {
    Lines,
    Dots,
    Chessboard,
}

/// Reads a calibration board's own keys.
pub(crate) fn read_board(s: &Section<'_>) -> Option<Board> {
    let name = s.name("name");
    let pattern = s.choice(
        "pattern",
        &[
            ("lines", Pattern::Lines),
            ("dots", Pattern::Dots),
            ("chessboard", Pattern::Chessboard),
        ],
    );
    let columns = s.integer("columns", 2, 200, "nodes").map(|v| v as u32);
    let rows = s.integer("rows", 2, 200, "nodes").map(|v| v as u32);
    let size = quantity(0.0, 10.0, "m").above();
    let pitch_m = s.number("pitch_m", size);
    let margin_m = s.number("margin_m", quantity(0.0, 10.0, "m"));
    let thickness_m = s.number("thickness_m", size);
    let mark_key = match pattern {
        Some(Pattern::Lines) => Some("line_m"),
        Some(Pattern::Dots) => Some("diameter_m"),
        Some(Pattern::Chessboard) => None,
        None => {
            s.item("line_m");
            s.item("diameter_m");
            None
        }
    };
    let mark_m = mark_key.map(|key| s.number(key, size));
    if let (Some(key), Some(Some(mark)), Some(pitch)) = (mark_key, mark_m, pitch_m)
        && mark >= pitch
    {
        s.rule(
            key,
            format!("marks of {mark} m run into each other at a pitch of {pitch} m"),
            "Enter a mark smaller than pitch_m",
        );
    }
    let blocks = read_blocks(s);
    s.finish();
    let board = Board {
        name: name?,
        pattern: match (pattern?, mark_m) {
            (Pattern::Lines, Some(mark)) => BoardPattern::Lines { line_m: mark? },
            (Pattern::Dots, Some(mark)) => BoardPattern::Dots { diameter_m: mark? },
            _ => BoardPattern::Chessboard,
        },
        columns: columns?,
        rows: rows?,
        pitch_m: pitch_m?,
        margin_m: margin_m?,
        thickness_m: thickness_m?,
        blocks: blocks?,
    };
    Some(board)
}

fn read_blocks(s: &Section<'_>) -> Option<Vec<GaugeBlock>> {
    let mut blocks = Vec::new();
    let mut sound = true;
    for entry in s.tables("block", 256) {
        let centre_m = entry.numbers("centre_m", quantity(-20.0, 20.0, "m"));
        let size_m = entry.numbers("size_m", quantity(0.0, 10.0, "m").above());
        let height_m = entry.number("height_m", quantity(0.0, 1.0, "m").above());
        entry.finish();
        match (centre_m, size_m, height_m) {
            (Some(centre_m), Some(size_m), Some(height_m)) => blocks.push(GaugeBlock {
                centre_m,
                size_m,
                height_m,
            }),
            _ => sound = false,
        }
    }
    sound.then_some(blocks)
}
