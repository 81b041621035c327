//! The calibration board.

use super::dictionary::Dictionary;
use crate::raw::{Quantity, Section, keys_of, name, number, numbers, tables, whole, words};

const fn size() -> Quantity {
    number(0.0, 10.0, "m").above()
}

shapes! {
    /// Marks at its nodes: crossings of lines, centres of dots, or corners of a chessboard.
    pub enum BoardPattern: Copy by "pattern" {
        /// Grid lines.
        Lines = "lines" {
            /// Width of the lines; of `pattern = "lines"`. Less than `pitch_m`.
            line_m: f64 = size(),
        },
        /// Round dots.
        Dots = "dots" {
            /// Diameter of the dots; of `pattern = "dots"`. Less than `pitch_m`.
            diameter_m: f64 = size(),
        },
        /// Chessboard squares of the pitch's size.
        Chessboard = "chessboard",
        /// ChArUco: a chessboard with a marker in every light square, as OpenCV's `CharucoBoard` draws it: the square at
        /// the upper left dark, markers numbered from there row by row.
        Charuco = "charuco" {
            /// OpenCV's name of the markers' dictionary; of `pattern = "charuco"`.
            dictionary: Dictionary = words(Dictionary::ALL.iter().copied()),
            /// Side of the markers, with their dark border; of `pattern = "charuco"`. Less than `pitch_m`.
            marker_m: f64 = size(),
        },
    }
}

table! {
    /// A gauge block on the board, which shows how board and laser sheet lie to each other. Omitted: there is none.
    pub struct GaugeBlock: Copy as BlockTyped {
        /// Its centre on the board, from the board's middle.
        pub centre_m: [f64; 2] = numbers(number(-20.0, 20.0, "m")),
        /// Its width and height on the board.
        pub size_m: [f64; 2] = numbers(size()),
        /// Height above the face of the board.
        pub height_m: f64 = number(0.0, 1.0, "m").above(),
    }
}

table! {
    /// The calibration board, written out or by `file`; `board = "FILE"` is the same as `file` alone. A board file has the
    /// same keys without the word board. Omitted: there is none.
    ///
    /// `columns` x `rows` nodes, `pitch_m` apart.
    pub struct Board as BoardTyped, checked by marks_apart {
        /// Name of the board.
        pub name: String = name(),
        /// Pattern of its nodes.
        pub pattern: BoardPattern = keys_of(),
        /// Number of nodes along the board's width.
        pub columns: u32 = whole(2, 200, "nodes"),
        /// Number of nodes along its height.
        pub rows: u32 = whole(2, 200, "nodes"),
        /// Distance from node to node.
        ///
        /// Wang-Cheng: 0.050.
        pub pitch_m: f64 = size(),
        /// Distance from the outermost nodes to the edge.
        pub margin_m: f64 = number(0.0, 10.0, "m"),
        /// Thickness of the board.
        pub thickness_m: f64 = size(),
        /// Gauge blocks.
        key block: Vec<GaugeBlock> = tables(256) => |b| Some(b.blocks.clone()),
        /// Gauge blocks.
        made blocks: Vec<GaugeBlock>,
    }
}

impl BoardPattern {
    /// Whether its nodes are corners of squares in chessboard order.
    pub fn is_chess(&self) -> bool {
        matches!(
            self,
            BoardPattern::Chessboard | BoardPattern::Charuco { .. }
        )
    }
}

fn marks_apart(typed: &mut BoardTyped, s: &Section<'_>) {
    typed.blocks = typed.block.take();
    if let (Some(BoardPattern::Charuco { dictionary, .. }), Some(columns), Some(rows)) =
        (typed.pattern, typed.columns, typed.rows)
    {
        let markers = (columns + 1) * (rows + 1) / 2;
        if markers > dictionary.markers {
            s.rule(
                "dictionary",
                format!(
                    "{columns} x {rows} nodes have {markers} light squares, the dictionary {} markers",
                    dictionary.markers
                ),
                "Enter a dictionary with as many, or fewer columns and rows",
            );
        }
    }
    let (key, mark) = match typed.pattern {
        Some(BoardPattern::Charuco { marker_m, .. }) => ("marker_m", marker_m),
        Some(BoardPattern::Lines { line_m }) => ("line_m", line_m),
        Some(BoardPattern::Dots { diameter_m }) => ("diameter_m", diameter_m),
        _ => return,
    };
    if let Some(pitch) = typed.pitch_m.filter(|pitch| mark >= *pitch) {
        s.rule(
            key,
            format!("marks of {mark} m run into each other at a pitch of {pitch} m"),
            "Enter a mark smaller than pitch_m",
        );
    }
}

table! {
    /// Nothing: a board has no place.
    pub(crate) struct NoPlace as NoPlaceTyped {}
}
