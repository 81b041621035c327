//! Where the pattern ends, and whether the board does: it may be cut by the image's border, hidden
//! by what is in front of it, or be a smaller board.

use hydroline_rigs::Board;
use nalgebra::Matrix3;

use super::image::Grey;
use crate::map::geometry::apply;

/// Places so many steps beyond the last node show whether the pattern goes on.
const NEXT: f64 = 0.6;
/// Places so many steps inside and outside of the board's edge are compared: clear of the edge's blur
/// and of what the file's margin is off.
const BESIDE: f64 = 0.2;
/// Least step of grey at an edge, and most along the face, as a share of the pattern's.
const STEP: f64 = 0.25;

/// Inputs by which the ends of a pattern are judged: `seen` columns and rows in upright order.
pub(super) struct Ends<'a> {
    pub image: &'a Grey<'a>,
    pub board: &'a Board,
    pub seen: [u32; 2],
    /// Index to image.
    pub to_image: &'a Matrix3<f64>,
    pub contrast: f64,
}

impl Ends<'_> {
    fn at(&self, axis: usize, along: f64, across: f64) -> Option<[f64; 2]> {
        let mut at = [across; 2];
        at[axis] = along;
        let (w, h) = (self.image.width() as f64, self.image.height() as f64);
        apply(self.to_image, at)
            .filter(|p| p[0] > 0.0 && p[1] > 0.0 && p[0] < w - 1.0 && p[1] < h - 1.0)
    }

    /// The last index of an end, and the direction outwards.
    fn end(&self, axis: usize, far: bool) -> (f64, f64) {
        if far {
            (f64::from(self.seen[axis]) - 1.0, 1.0)
        } else {
            (0.0, -1.0)
        }
    }

    /// Whether the image shows that the pattern ends, at both ends: places more than half a step
    /// beyond are in view (and hold none, or the lattice would be larger).
    pub fn in_view(&self, axis: usize) -> bool {
        [false, true].into_iter().all(|far| {
            let (last, out) = self.end(axis, far);
            let across = self.seen[1 - axis];
            let in_view =
                (0..across).filter(|&k| self.at(axis, last + NEXT * out, f64::from(k)).is_some());
            in_view.count() * 2 > across as usize
        })
    }

    /// Whether the board's own edge is seen where its margin puts it: the face goes on from the last
    /// nodes up to there, and then something else begins.
    fn edge(&self, axis: usize, far: bool) -> bool {
        let (last, out) = self.end(axis, far);
        let margin = self.board.margin_m / self.board.pitch_m;
        let step = STEP * self.contrast;
        let places = self.seen[1 - axis].saturating_sub(1);
        let mut beyond = Vec::with_capacity(places as usize);
        let mut shown = 0;
        for k in 0..places {
            let grey = |beyond: f64| {
                let [c, r] = self.at(axis, last + beyond * out, f64::from(k) + 0.5)?;
                Some(f64::from(self.image.sample(c, r)))
            };
            let (Some(face), Some(inside), Some(outside)) = (
                grey(0.5 * margin),
                grey(margin - BESIDE),
                grey(margin + BESIDE),
            ) else {
                continue;
            };
            beyond.push(outside);
            shown += u32::from((inside - face).abs() < step && (outside - inside).abs() > step);
        }
        beyond.sort_by(f64::total_cmp);
        let Some(middle) = beyond.get(beyond.len() / 2) else {
            return false;
        };
        // A chessboard's squares alternate: after another row of them light and dark are found.
        let alike = beyond.iter().filter(|v| (*v - middle).abs() < step).count();
        // And its dark squares may be as dark as what is behind it.
        shown * 5 > places * 2 && alike * 10 >= places as usize * 7
    }

    /// Whether the board's edges are seen at both ends.
    pub fn both_edges(&self, axis: usize) -> bool {
        self.edge(axis, false) && self.edge(axis, true)
    }

    /// Where the rest of `wanted` columns and rows must be, as the camera sees it.
    pub fn missing(&self, wanted: [u32; 2]) -> String {
        // ξ runs to the image's left, η up.
        const SIDES: [[&str; 2]; 2] = [["right", "left"], ["lower", "upper"]];
        let words: Vec<String> = (0..2)
            .filter(|&axis| self.seen[axis] < wanted[axis])
            .map(|axis| {
                let part = part(wanted[axis] - self.seen[axis], wanted[axis]);
                match [false, true].map(|far| self.edge(axis, far)) {
                    [false, true] => format!("{} {part}", SIDES[axis][0]),
                    [true, false] => format!("{} {part}", SIDES[axis][1]),
                    _ => format!("{part} to the {} or {}", SIDES[axis][1], SIDES[axis][0]),
                }
            })
            .collect();
        words.join(" and the ")
    }
}

/// A share in words.
pub(crate) fn part(missing: u32, of: u32) -> &'static str {
    match f64::from(missing) / f64::from(of.max(1)) {
        s if s < 0.18 => "edge",
        s if s < 0.29 => "quarter",
        s if s < 0.42 => "third",
        s if s < 0.59 => "half",
        _ => "two thirds",
    }
}
