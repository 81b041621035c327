//! Lines as they are drawn: no more points than pixels show, and none outside the axes.

use crate::svg::Path;

/// The area between the axes \[px\]: upper left and lower right corner.
pub(super) type Area = [[f64; 2]; 2];

/// The path of a line through `points` \[px\]; NaN breaks it.
pub(super) fn path(points: impl Iterator<Item = [f64; 2]>, area: Area) -> Path {
    let mut path = Path::new();
    let mut last: Option<[f64; 2]> = None;
    for to in thinned(points) {
        if !to.iter().all(|v| v.is_finite()) {
            path.lift();
            last = None;
            continue;
        }
        match last {
            None if inside(to, area) => path.to(to),
            None => {}
            Some(from) => match clipped(from, to, area) {
                Some((a, b)) => {
                    if a != from {
                        path.lift();
                        path.to(a);
                    }
                    path.to(b);
                    if b != to {
                        path.lift();
                    }
                }
                None => path.lift(),
            },
        }
        last = Some(to);
    }
    path.lift();
    path
}

/// Of the points that follow each other in one column of pixels: the first, the least, the greatest and the last.
/// The line drawn through them is the same, and no peak is lost: U. Jugel et al., "M4: A Visualization-Oriented
/// Time Series Data Aggregation", PVLDB 7 (2014) 797.
fn thinned(points: impl Iterator<Item = [f64; 2]>) -> impl Iterator<Item = [f64; 2]> {
    let mut points = points.peekable();
    std::iter::from_fn(move || {
        let first = points.next()?;
        let column = first[0].floor();
        let finite = |p: &[f64; 2]| p[0].is_finite() && p[1].is_finite();
        let (mut least, mut greatest, mut last) =
            ((0usize, first), (0usize, first), (0usize, first));
        let mut k = 0;
        while let Some(p) =
            points.next_if(|p| finite(&first) && finite(p) && p[0].floor() == column)
        {
            k += 1;
            if p[1] < least.1[1] {
                least = (k, p);
            }
            if p[1] > greatest.1[1] {
                greatest = (k, p);
            }
            last = (k, p);
        }
        let mut kept = [(0, first), least, greatest, last];
        kept.sort_by_key(|(k, _)| *k);
        let mut kept = kept.to_vec();
        kept.dedup_by_key(|(k, _)| *k);
        Some(kept.into_iter().map(|(_, p)| p))
    })
    .flatten()
}

pub(super) fn inside(p: [f64; 2], [low, high]: Area) -> bool {
    (0..2).all(|k| low[k] <= p[k] && p[k] <= high[k])
}

/// The part of a straight line that lies in the area: Y.-D. Liang and B. A. Barsky, ACM Trans. Graph. 3 (1984) 1.
fn clipped(from: [f64; 2], to: [f64; 2], [low, high]: Area) -> Option<([f64; 2], [f64; 2])> {
    let (mut enters, mut leaves) = (0.0f64, 1.0f64);
    for k in 0..2 {
        let run = to[k] - from[k];
        if run == 0.0 {
            if from[k] < low[k] || from[k] > high[k] {
                return None;
            }
            continue;
        }
        let (a, b) = ((low[k] - from[k]) / run, (high[k] - from[k]) / run);
        enters = enters.max(a.min(b));
        leaves = leaves.min(a.max(b));
    }
    let at = |part: f64| -> [f64; 2] {
        std::array::from_fn(|k| (from[k] + part * (to[k] - from[k])).clamp(low[k], high[k]))
    };
    (enters <= leaves).then(|| {
        (
            if enters > 0.0 { at(enters) } else { from },
            if leaves < 1.0 { at(leaves) } else { to },
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const AREA: Area = [[0.0, 0.0], [100.0, 50.0]];

    fn drawn(points: &[[f64; 2]]) -> String {
        path(points.iter().copied(), AREA).element().to_string()
    }

    #[test]
    fn lines_are_cut_at_the_edges_and_begin_again_inside() {
        assert_eq!(
            drawn(&[[0.0, 25.0], [50.0, 75.0], [100.0, 25.0]]),
            "<path d=\"M0 25L25 50M75 50L100 25\"/>"
        );
        // Straight through from outside to outside, and past without touching.
        assert_eq!(
            drawn(&[[-100.0, 10.0], [200.0, 10.0]]),
            "<path d=\"M0 10L100 10\"/>"
        );
        assert_eq!(drawn(&[[-10.0, -10.0], [200.0, -5.0]]), "<path d=\"\"/>");
    }

    #[test]
    fn a_gap_breaks_the_line_and_a_lone_point_stays_visible() {
        assert_eq!(
            drawn(&[
                [1.0, 1.0],
                [2.5, 1.0],
                [f64::NAN, 0.0],
                [9.0, 9.0],
                [20.0, f64::NAN]
            ]),
            "<path d=\"M1 1L2.5 1M9 9h0\"/>"
        );
    }

    #[test]
    fn one_sample_in_a_million_that_peaks_is_drawn() {
        let line = (0..1_000_000).map(|k| {
            let y = if k == 654_321 { 3.0 } else { 25.0 };
            [1e-4 * f64::from(k), y]
        });
        let d = path(line, AREA).element().to_string();
        assert!(d.contains("L65.4 3L"), "{}", &d[..200]);
        assert!(d.len() < 10_000, "{}", d.len());
    }

    proptest! {
        #[test]
        fn nothing_is_drawn_outside(
            points in prop::collection::vec(prop::array::uniform2(-300.0..300.0f64), 0..40),
        ) {
            let d = drawn(&points);
            let numbers = d
                .trim_start_matches("<path d=\"")
                .trim_end_matches("\"/>")
                .replace("h0", "")
                .replace(['M', 'L'], " ");
            let numbers: Vec<f64> = numbers
                .split_whitespace()
                .map(|v| v.parse().map_err(|_| TestCaseError::fail(d.clone())))
                .collect::<Result<_, _>>()?;
            for p in numbers.chunks(2) {
                prop_assert!((0.0..=100.0).contains(&p[0]) && (0.0..=50.0).contains(&p[1]), "{}", d);
            }
        }
    }
}
