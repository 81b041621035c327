//! Where to look: the last frame's stripe with a margin.

use super::Profile;
use super::coarse::{BLOCK_ROWS, TILE_COLUMNS, Tile};

/// Reach within which a second candidate is a rival \[px\]; no band is narrower, so that the
/// points of a band carry the same quality bits as those of the whole frame.
pub(super) const RIVAL_REACH_PX: f64 = 24.0;
/// Share of the band's own points that must be found again, else the whole frame is searched.
pub(super) const MIN_SHARE_FOUND: f64 = 0.9;

/// Rows to search, per group of 32 columns.
#[derive(Debug, Clone, PartialEq)]
pub struct Band {
    size_px: (usize, usize),
    rows: Vec<(f64, f64)>,
    points: usize,
}

impl Band {
    /// The rows within `margin_px` (at least 28) of a profile; groups of columns without a point
    /// take their neighbours' rows. `None` without points.
    pub fn from_profile(profile: &Profile, margin_px: f64) -> Option<Self> {
        let groups = profile.size_px.0.div_ceil(TILE_COLUMNS);
        let mut found: Vec<Option<(f64, f64)>> = vec![None; groups];
        for point in &profile.points {
            if let Some(group) = found.get_mut(point.column_px as usize / TILE_COLUMNS) {
                let (low, high) = group.unwrap_or((point.row_px, point.row_px));
                *group = Some((low.min(point.row_px), high.max(point.row_px)));
            }
        }
        let margin = margin_px.max(RIVAL_REACH_PX + BLOCK_ROWS as f64);
        let nearest = |i: usize| {
            (0..groups).find_map(|d| {
                let left = i
                    .checked_sub(d)
                    .and_then(|j| found.get(j).copied().flatten());
                let right = found.get(i + d).copied().flatten();
                match (left, right) {
                    (Some(a), Some(b)) => Some((a.0.min(b.0), a.1.max(b.1))),
                    (a, b) => a.or(b),
                }
            })
        };
        let rows = (0..groups)
            .map(|i| nearest(i).map(|(low, high)| (low - margin, high + margin)))
            .collect::<Option<Vec<_>>>()?;
        (!rows.is_empty()).then_some(Self {
            size_px: profile.size_px,
            rows,
            points: profile.points.len(),
        })
    }

    /// Size of the images this band is for: columns, rows \[px\].
    pub fn size_px(&self) -> (usize, usize) {
        self.size_px
    }

    /// Points of the profile the band was made from.
    pub(super) fn points(&self) -> usize {
        self.points
    }

    /// Whether a row is so far inside that its neighbourhood was searched too.
    pub(super) fn holds(&self, column: usize, row_px: f64) -> bool {
        let (low, high) = self
            .rows
            .get(column / TILE_COLUMNS)
            .copied()
            .unwrap_or((0.0, 0.0));
        let last = self.size_px.1 as f64;
        let reach = RIVAL_REACH_PX.min(0.5 * (high - low) - 1.0);
        (row_px - low >= reach || low <= 0.0) && (high - row_px >= reach || high >= last)
    }

    /// The tiles to search.
    pub(super) fn tiles(&self) -> impl Iterator<Item = Tile> + '_ {
        let (width, height) = self.size_px;
        let blocks = (height / BLOCK_ROWS).max(1);
        self.rows.iter().enumerate().map(move |(i, (low, high))| {
            let block = |row: f64| ((row / BLOCK_ROWS as f64).max(0.0) as usize).min(blocks - 1);
            let from = i * TILE_COLUMNS;
            Tile {
                from,
                to: (from + TILE_COLUMNS).min(width),
                first: block(*low),
                last: block(*high),
            }
        })
    }
}
