//! Candidates that continue each other from column to column.

use super::coarse::Spots;

/// Largest change of row per column inside a chain \[px\]: slope and coarse error.
const MAX_JUMP_PX: f32 = 3.0;
/// Most columns without a candidate inside a chain.
const MAX_GAP_COLUMNS: usize = 3;
/// Chains closer than this where one of them ends are cut there \[px\]: two things that
/// cross look like one for a while, and which goes on as which is not known.
const CROSSING_PX: f32 = 14.0;

/// A run of candidates `(column, spot, row)`.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Chain {
    pub links: Vec<(usize, usize, f32)>,
}

impl Chain {
    pub fn first(&self) -> usize {
        self.links.first().map_or(0, |l| l.0)
    }

    pub fn last(&self) -> usize {
        self.links.last().map_or(0, |l| l.0)
    }

    fn row_at(&self, column: usize) -> Option<f32> {
        let after = self.links.partition_point(|l| l.0 < column);
        self.links.get(after).map(|l| l.2)
    }
}

/// Chains of at least `shortest` candidates, from left to right.
pub(super) fn link(spots: &Spots, columns: usize, shortest: usize) -> Vec<Chain> {
    let mut open: Vec<Chain> = Vec::new();
    let mut done: Vec<Chain> = Vec::new();
    let mut taken: Vec<bool> = Vec::new();
    for column in 0..columns {
        let here = spots.column(column);
        open.retain_mut(|chain| {
            let alive = column - chain.last() <= MAX_GAP_COLUMNS + 1;
            if !alive && chain.links.len() >= shortest {
                done.push(std::mem::take(chain));
            }
            alive
        });
        taken.clear();
        taken.resize(open.len(), false);
        for (index, spot) in here.iter().enumerate() {
            let nearest = open
                .iter()
                .enumerate()
                .filter(|(k, _)| !taken.get(*k).copied().unwrap_or(true))
                .filter_map(|(k, chain)| {
                    let (last, _, row_px) = *chain.links.last()?;
                    let reach = MAX_JUMP_PX + (column - last - 1) as f32;
                    let off = (spot.row_px - row_px).abs();
                    (off <= reach).then_some((k, off))
                })
                .min_by(|a, b| a.1.total_cmp(&b.1));
            let link = (column, index, spot.row_px);
            match nearest {
                Some((k, _)) => {
                    open[k].links.push(link);
                    taken[k] = true;
                }
                None => {
                    open.push(Chain { links: vec![link] });
                    taken.push(true);
                }
            }
        }
    }
    done.extend(open);
    done.retain(|chain| chain.links.len() >= shortest);
    let mut cut = cut_at_crossings(done);
    cut.retain(|chain| chain.links.len() >= shortest);
    cut.sort_by_key(Chain::first);
    cut
}

/// Cuts chains where another begins or ends beside them.
fn cut_at_crossings(chains: Vec<Chain>) -> Vec<Chain> {
    let ends: Vec<(usize, f32)> = chains
        .iter()
        .flat_map(|chain| [chain.links.first(), chain.links.last()])
        .flatten()
        .map(|l| (l.0, l.2))
        .collect();
    let mut out = Vec::with_capacity(chains.len());
    for chain in chains {
        let mut cuts: Vec<usize> = ends
            .iter()
            .filter(|(column, row_px)| {
                chain.first() < *column
                    && *column < chain.last()
                    && chain
                        .row_at(*column)
                        .is_some_and(|own| (own - row_px).abs() < CROSSING_PX)
            })
            .map(|end| end.0)
            .collect();
        cuts.sort_unstable();
        let mut rest = chain.links;
        for column in cuts.into_iter().rev() {
            let at = rest.partition_point(|l| l.0 < column);
            out.push(Chain {
                links: rest.split_off(at),
            });
        }
        out.push(Chain { links: rest });
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::coarse::Spot;

    fn spots(columns: usize, rows: impl Fn(usize) -> Vec<f32>) -> Spots {
        let mut spots = Spots::default();
        spots.clear(columns);
        for column in 0..columns {
            let mut here = rows(column);
            here.sort_by(f32::total_cmp);
            for row_px in here {
                spots.push(
                    column,
                    Spot {
                        row_px,
                        contrast: 50,
                    },
                );
            }
        }
        spots
    }

    #[test]
    fn parallel_lines_make_a_chain_each() {
        let chains = link(
            &spots(100, |c| vec![100.0 + 0.3 * c as f32, 300.0]),
            100,
            12,
        );
        assert_eq!(chains.len(), 2);
        assert!(chains.iter().all(|c| c.first() == 0 && c.last() == 99));
    }

    #[test]
    fn lines_that_cross_are_cut_where_they_do() {
        let chains = link(
            &spots(200, |c| {
                let low = 100.0 + 0.5 * c as f32;
                if (low - 150.0).abs() < 8.0 {
                    vec![150.0]
                } else {
                    vec![low, 150.0]
                }
            }),
            200,
            12,
        );
        // No chain holds both lines: its rows are all on one.
        for chain in &chains {
            let off = |f: fn(f32, f32) -> f32| {
                chain
                    .links
                    .iter()
                    .filter(|l| f(l.0 as f32, l.2).abs() > 8.0)
                    .count()
            };
            let (sloped, flat) = (off(|c, r| r - 100.0 - 0.5 * c), off(|_, r| r - 150.0));
            assert!(sloped == 0 || flat == 0, "{chain:?}");
        }
        assert!(chains.len() >= 4, "{}", chains.len());
    }

    #[test]
    fn what_is_short_is_left_out() {
        let chains = link(
            &spots(60, |c| if c < 8 { vec![50.0] } else { vec![] }),
            60,
            12,
        );
        assert!(chains.is_empty());
    }
}
