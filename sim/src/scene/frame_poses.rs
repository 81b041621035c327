//! The poses that the rows of one frame show.

use super::Pose6;

/// One pose for the whole frame, or one per row (rolling shutter, interlace).
#[derive(Debug, Clone, PartialEq)]
pub struct FramePoses(Kind);

#[derive(Debug, Clone, PartialEq)]
enum Kind {
    Still(Pose6),
    Rows { poses: Vec<Pose6>, interlaced: bool },
}

/// The poses of one field of a frame.
pub(super) enum Field {
    Still(Pose6),
    /// One per row of the whole frame; the other field's rows only serve as surroundings of the blur.
    Rows(Vec<Pose6>),
}

impl From<Pose6> for FramePoses {
    fn from(pose: Pose6) -> Self {
        FramePoses(Kind::Still(pose))
    }
}

impl FramePoses {
    /// One pose per row, top row first. `interlaced`: even and odd rows are two pictures, each blurred on its own.
    /// Without rows: the origin.
    pub fn rows(poses: Vec<Pose6>, interlaced: bool) -> Self {
        match poses[..] {
            [] => FramePoses(Kind::Still(Pose6::default())),
            [pose] => FramePoses(Kind::Still(pose)),
            _ => FramePoses(Kind::Rows { poses, interlaced }),
        }
    }

    /// The pose of the whole frame, if there is one.
    pub fn still(&self) -> Option<&Pose6> {
        match &self.0 {
            Kind::Still(pose) => Some(pose),
            Kind::Rows { .. } => None,
        }
    }

    /// Pose at a row \[px\], between rows on the line between their poses; interlaced: the mean of both fields.
    pub fn at_row(&self, row_px: f64) -> Pose6 {
        match &self.0 {
            Kind::Still(pose) => *pose,
            Kind::Rows { poses, interlaced } => {
                let last = poses.len() - 1;
                // NaN becomes row 0.
                let row = row_px.max(0.0).min(last as f64);
                let low = (row as usize).min(last - 1);
                let share = if *interlaced { 0.5 } else { row - low as f64 };
                let (a, b) = (poses[low].to_array(), poses[low + 1].to_array());
                Pose6::from(std::array::from_fn(|i| a[i] + share * (b[i] - a[i])))
            }
        }
    }

    /// The fields: one, or the even and the odd rows.
    pub(super) fn fields(&self) -> Vec<Field> {
        match &self.0 {
            Kind::Still(pose) => vec![Field::Still(*pose)],
            Kind::Rows {
                poses,
                interlaced: false,
            } => vec![Field::Rows(poses.clone())],
            Kind::Rows { poses, .. } => (0..2)
                .map(|parity| {
                    let own = |row: usize| match row % 2 == parity {
                        true => poses[row],
                        false => {
                            poses[if row + 1 < poses.len() {
                                row + 1
                            } else {
                                row - 1
                            }]
                        }
                    };
                    let rows: Vec<Pose6> = (0..poses.len()).map(own).collect();
                    if rows.iter().all(|p| *p == rows[0]) {
                        Field::Still(rows[0])
                    } else {
                        Field::Rows(rows)
                    }
                })
                .collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose(x_m: f64) -> Pose6 {
        Pose6 {
            x_m,
            ..Pose6::default()
        }
    }

    #[test]
    fn rows_are_interpolated_and_held_at_the_ends() {
        let poses = FramePoses::rows((0..4).map(|j| pose(f64::from(j))).collect(), false);
        for (row, x) in [
            (-3.0, 0.0),
            (0.25, 0.25),
            (2.5, 2.5),
            (3.0, 3.0),
            (9.0, 3.0),
            (f64::NAN, 0.0),
        ] {
            assert_eq!(poses.at_row(row).x_m, x);
        }
        assert_eq!(
            FramePoses::rows(vec![pose(2.0)], true).still(),
            Some(&pose(2.0))
        );
    }

    #[test]
    fn fields_hold_their_own_rows() {
        let poses = FramePoses::rows([0.0, 5.0, 0.0, 5.0, 0.0].map(pose).to_vec(), true);
        let fields = poses.fields();
        let still = |f: &Field| match f {
            Field::Still(p) => p.x_m,
            Field::Rows(_) => f64::NAN,
        };
        assert_eq!(fields.iter().map(still).collect::<Vec<_>>(), [0.0, 5.0]);
        assert_eq!(poses.at_row(2.2).x_m, 2.5);
    }
}
