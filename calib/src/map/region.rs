//! Where a map holds: the convex hull of its nodes on the sheet.

use serde::{Deserialize, Serialize};

/// A convex polygon on the laser plane, counter-clockwise.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Region {
    corners_m: Vec<[f64; 2]>,
}

/// A point this far outside \[m\] still counts as inside: the nodes on the border are
/// themselves uncertain by about as much, and without it half of what lies exactly on
/// the outer line would be lost to noise.
const SLACK_M: f64 = 2e-4;

impl Region {
    /// Convex hull of points (ξ, η) \[m\], by Andrew's monotone chain.
    pub fn hull(points: impl IntoIterator<Item = [f64; 2]>) -> Self {
        let mut sorted: Vec<[f64; 2]> = points
            .into_iter()
            .filter(|p| p.iter().all(|v| v.is_finite()))
            .collect();
        sorted.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
        sorted.dedup();
        if sorted.len() < 3 {
            return Region { corners_m: sorted };
        }
        let mut hull: Vec<[f64; 2]> = Vec::with_capacity(sorted.len() + 1);
        for pass in 0..2 {
            let floor = hull.len();
            let chain: Box<dyn Iterator<Item = &[f64; 2]>> = if pass == 0 {
                Box::new(sorted.iter())
            } else {
                Box::new(sorted.iter().rev())
            };
            for &p in chain {
                while hull.len() >= floor + 2
                    && cross(hull[hull.len() - 2], hull[hull.len() - 1], p) <= 1e-15
                {
                    hull.pop();
                }
                hull.push(p);
            }
            hull.pop();
        }
        Region { corners_m: hull }
    }

    /// Corners (ξ, η) \[m\], counter-clockwise.
    pub fn corners_m(&self) -> &[[f64; 2]] {
        &self.corners_m
    }

    /// Whether a sheet point \[m\] lies inside (or within 0.2 mm). False for NaN.
    pub fn contains(&self, xi_m: f64, eta_m: f64) -> bool {
        let n = self.corners_m.len();
        n >= 3
            && (0..n).all(|k| {
                let (a, b) = (self.corners_m[k], self.corners_m[(k + 1) % n]);
                let length = (b[0] - a[0]).hypot(b[1] - a[1]);
                cross(a, b, [xi_m, eta_m]) >= -SLACK_M * length
            })
    }

    /// Smallest and largest (ξ, η) \[m\]; `None` when empty.
    pub fn bounds_m(&self) -> Option<([f64; 2], [f64; 2])> {
        let first = *self.corners_m.first()?;
        Some(
            self.corners_m
                .iter()
                .fold((first, first), |(low, high), p| {
                    (
                        [low[0].min(p[0]), low[1].min(p[1])],
                        [high[0].max(p[0]), high[1].max(p[1])],
                    )
                }),
        )
    }
}

fn cross(a: [f64; 2], b: [f64; 2], p: [f64; 2]) -> f64 {
    (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn area_m2(region: &Region) -> f64 {
        let n = region.corners_m.len();
        (0..n)
            .map(|k| {
                let (a, b) = (region.corners_m[k], region.corners_m[(k + 1) % n]);
                0.5 * (a[0] * b[1] - a[1] * b[0])
            })
            .sum()
    }

    #[test]
    fn a_square() {
        let region = Region::hull([[0.0, 0.0], [1.0, 0.0], [0.5, 0.5], [1.0, 1.0], [0.0, 1.0]]);
        assert_eq!(region.corners_m().len(), 4);
        assert!((area_m2(&region) - 1.0).abs() < 1e-12);
        assert!(region.contains(0.5, 0.999) && region.contains(1.0001, 0.5));
        assert!(!region.contains(1.001, 0.5) && !region.contains(f64::NAN, 0.5));
        assert_eq!(region.bounds_m(), Some(([0.0, 0.0], [1.0, 1.0])));
    }

    proptest! {
        #[test]
        fn holds_all_its_points(points in prop::collection::vec([-1.0..1.0f64, -1.0..1.0f64], 3..40)) {
            let region = Region::hull(points.clone());
            prop_assume!(region.corners_m().len() >= 3 && area_m2(&region) > 1e-3);
            for p in points {
                prop_assert!(region.contains(p[0], p[1]));
            }
        }
    }
}
