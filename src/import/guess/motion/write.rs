//! The guessed channels as a map has them.

use super::super::Draft;
use super::super::file::quoted;
use super::super::shape::Shape;
use super::super::stats::{Column, Stats};
use super::{LOADS, Motion};
use crate::map::place_name;

impl Motion {
    pub fn write(&self, shape: &Shape, stats: &Stats, draft: &mut Draft) {
        self.axes(shape, draft);
        for c in &self.channels {
            draft.line(format!("[motion.{}]", place_name(c.place)));
            for question in &c.questions {
                draft.toml.push(format!("# {question}"));
                draft
                    .remarks
                    .push(format!("{}: {question}", place_name(c.place)));
            }
            draft
                .toml
                .extend(shape.key(c.column).lines().map(str::to_owned));
            draft.line(format!("unit = \"{}\"", c.unit));
            if c.sign < 0.0 {
                draft.line("sign = -1");
            }
            if (6..9).contains(&c.place) && self.in_tank {
                draft.line("frame = \"tank\"");
            }
            missing(&stats.columns[c.column], draft);
        }
        if let Some((columns, order)) = self.quaternion {
            draft.line("[quaternion]");
            let list: Vec<String> = columns
                .iter()
                .map(|c| {
                    shape
                        .key(*c)
                        .lines()
                        .next()
                        .unwrap_or("")
                        .trim_start_matches("column = ")
                        .to_owned()
                })
                .collect();
            draft.line(format!("columns = [{}]", list.join(", ")));
            draft.line(format!("order = \"{order}\""));
            if self.y_up {
                draft.line("axes = \"y_up\"");
            }
            missing(&stats.columns[columns[0]], draft);
        }
        for (dof, column, unit, questions) in &self.loads {
            draft.line("[[command]]");
            for question in questions {
                draft.toml.push(format!("# {question}"));
                draft
                    .remarks
                    .push(format!("command {}: {question}", LOADS[*dof]));
            }
            draft.line(format!("thruster = \"{}\"", LOADS[*dof]));
            draft
                .toml
                .extend(shape.key(*column).lines().map(str::to_owned));
            draft.line(format!("unit = \"{unit}\""));
            missing(&stats.columns[*column], draft);
        }
        for note in &self.notes {
            draft.question(note.clone());
        }
        for left in self.left.words() {
            draft.question(left);
        }
    }

    /// Whose axes these are is in no file.
    fn axes(&self, shape: &Shape, draft: &mut Draft) {
        let across = [1, 2, 3, 4, 5, 7, 8, 9, 10, 11]
            .iter()
            .any(|p| self.has(*p))
            || self.quaternion.is_some();
        if self.y_up {
            draft.question("axes: x forward, y up, z to starboard, as Motive has them unless set otherwise, so z_m = -Y and y_m = Z; whether the body points along x is not written");
        } else if across {
            let kind = shape.kind;
            draft.question(format!(
                "signs and axes are the file's, taken for x forward, y to starboard, z down, as {kind} need not have them: with z up, sign = -1 on y_m z_m theta_rad psi_rad v_mps w_mps q_radps r_radps, and axes = \"z_up\" of a quaternion"
            ));
        }
        if (6..9).any(|p| self.has(p)) && (self.frame_open || self.in_tank) {
            let frame = if self.in_tank { "tank" } else { "body" };
            let other = if self.in_tank { "body" } else { "tank" };
            let checked =
                if self.has(0) && self.has(1) && (self.has(5) || self.quaternion.is_some()) {
                    "; import holds this against the positions"
                } else {
                    ""
                };
            draft.question(format!("velocities are taken to be along the {frame}'s axes, which is not written: else frame = \"{other}\"{checked}"));
        }
    }
}

/// Cells that may be empty.
fn missing(column: &Column, draft: &mut Draft) {
    if let (Some(word), 0) = (&column.word, column.other_words) {
        draft.line("missing = \"skip\"");
        draft.line(format!("missing_value = {}", quoted(word)));
        draft.remarks.push(format!(
            "{} of {} cells hold '{word}': taken as not measured in that row",
            column.words,
            column.rows()
        ));
        return;
    }
    if column.empty == 0 {
        return;
    }
    let rows = column.rows();
    if column.empty * 20 > rows {
        draft.line("missing = \"skip\"");
        draft.remarks.push(format!(
            "{} of {rows} cells are empty: taken as not measured in that row",
            column.empty
        ));
    } else {
        draft.question(format!(
            "{} of {rows} cells are empty: a fault unless missing = \"skip\" (or \"hold\")",
            column.empty
        ));
    }
}
