//! Corners of a polygon: sides that meet only where they should.

use crate::raw::{One, Quantity, ordered};

/// Corners a polygon may have: the check for crossings looks at every pair of sides.
const MOST_CORNERS: usize = 1000;

/// Expected form of the list of corners, for messages.
const CORNERS: &str = "a list of 3 to 1000 corners [x, y] in m";

/// Corners in order round an outline, each coordinate in the range.
pub(super) fn corners(each: Quantity) -> One<Vec<[f64; 2]>> {
    ordered(
        each,
        "corners [x, y]",
        "[[x, y], …]",
        CORNERS,
        move |s, item| {
            let elements = s.elements(item, CORNERS)?;
            if !(3..=MOST_CORNERS).contains(&elements.len()) {
                s.wrong_type(item, CORNERS);
                return None;
            }
            // Each is read, so that all that is wrong is reported.
            let points: Vec<Option<[f64; 2]>> = elements
                .iter()
                .map(|element| s.numbers_of(element, &each))
                .collect();
            let points: Vec<[f64; 2]> = points.into_iter().collect::<Option<_>>()?;
            if let Some((i, k)) = crossing(&points) {
                let [from, other] = [points[i], points[k]];
                s.rule_at(
                    item,
                    format!("side {i} (from {from:?}) meets side {k} (from {other:?})"),
                    "List the corners in order round the outline, each once",
                );
                return None;
            }
            Some(points)
        },
    )
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
