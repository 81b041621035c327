//! Errors that the poses of a run share, as each pose states them.

/// Errors of one owner, a calibration: independent, each of one standard deviation, and what they do to each pose.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SharedErrors {
    /// Owner: runs of the same one have the same errors.
    pub owner: String,
    /// Poses in time.
    pub poses: Vec<Loadings>,
}

/// What shared errors do to a pose.
#[derive(Debug, Clone, PartialEq)]
pub struct Loadings {
    /// Time since the log's first stamp \[s\].
    pub t_s: f64,
    /// Change of x, y, z \[m\], φ, θ, ψ \[rad\] by each error of one standard deviation.
    pub by: Vec<[f64; 6]>,
}

impl SharedErrors {
    /// Number of the errors.
    pub fn len(&self) -> usize {
        self.poses.iter().map(|p| p.by.len()).max().unwrap_or(0)
    }

    /// Whether the poses share none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// What each error does to the pose next to a time.
    fn next_to(&self, t_s: f64) -> &[[f64; 6]] {
        let after = self.poses.partition_point(|p| p.t_s < t_s);
        let near = [after.checked_sub(1), Some(after)];
        let poses = near.into_iter().flatten().filter_map(|k| self.poses.get(k));
        poses
            .min_by(|a, b| (a.t_s - t_s).abs().total_cmp(&(b.t_s - t_s).abs()))
            .map_or(&[], |p| p.by.as_slice())
    }

    /// What an error does to the pose next to a time: as none where that is not stated.
    pub fn at(&self, error: usize, t_s: f64) -> [f64; 6] {
        self.next_to(t_s).get(error).copied().unwrap_or_default()
    }

    /// Variance of x, y, z \[m²\], φ, θ, ψ \[rad²\] by all of them, of the pose next to a time.
    pub fn variance_at(&self, t_s: f64) -> [f64; 6] {
        self.next_to(t_s).iter().fold([0.0; 6], |sum, by| {
            std::array::from_fn(|i| sum[i] + by[i] * by[i])
        })
    }

    /// The same on a clock on which all is later by so much \[s\].
    #[must_use]
    pub fn later_by(&self, by_s: f64) -> SharedErrors {
        let mut later = self.clone();
        later.poses.iter_mut().for_each(|p| p.t_s += by_s);
        later
    }

    /// Rows of the format's loadings (6 × k, row by row) by error; `None` where that is no such matrix of finite numbers.
    pub fn of_rows(rows: &[f64]) -> Option<Vec<[f64; 6]>> {
        let count = rows.len() / 6;
        let is_matrix = count > 0 && rows.len() == 6 * count && rows.iter().all(|v| v.is_finite());
        let by = |k: usize| std::array::from_fn(|i| rows[i * count + k]);
        is_matrix.then(|| (0..count).map(by).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_pose_states_what_an_error_does() {
        let pose = |t_s: f64, y: f64| Loadings {
            t_s,
            by: vec![[0.0, y, 0.0, 0.0, 0.0, 0.0]],
        };
        let shared = SharedErrors {
            owner: "a".to_owned(),
            poses: vec![pose(0.0, 1.0), pose(1.0, 2.0)],
        };
        assert_eq!(
            [
                shared.at(0, -1.0)[1],
                shared.at(0, 0.6)[1],
                shared.at(0, 9.0)[1]
            ],
            [1.0, 2.0, 2.0]
        );
        assert_eq!(shared.later_by(-0.5).at(0, 0.1)[1], 2.0);
        assert_eq!(shared.at(1, 0.0), [0.0; 6]);
        assert_eq!(shared.variance_at(0.9)[1], 4.0);
        assert_eq!(shared.len(), 1);
        assert!(SharedErrors::default().is_empty());
        assert_eq!(SharedErrors::default().at(0, 0.0), [0.0; 6]);
    }

    #[test]
    fn rows_become_columns_and_nothing_else_does() {
        let rows: Vec<f64> = (0..12).map(f64::from).collect();
        let by = SharedErrors::of_rows(&rows).unwrap();
        assert_eq!(
            by,
            [
                [0.0, 2.0, 4.0, 6.0, 8.0, 10.0],
                [1.0, 3.0, 5.0, 7.0, 9.0, 11.0]
            ]
        );
        for wrong in [&rows[..7], &[], &[f64::NAN; 6]] {
            assert_eq!(SharedErrors::of_rows(wrong), None);
        }
    }
}
