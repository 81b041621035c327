//! Choice of each column's candidate for the stripe: dynamic programming over columns.
//!
//! Every column pays a reward for its candidate's contrast (against the frame's typical best);
//! a change of row beyond the slack costs in proportion, up to the price of a depth step.
//! A column may have no point; leaving and coming back costs as much as a step. So a particle
//! or a glint shorter than the price of two steps never wins, however bright, while the
//! segments of a stepped target, longer than that, do.

use super::coarse::{MAX_PER_COLUMN, Spot, Spots};

/// Change of row from column to column that costs nothing \[px\]: slope and coarse error.
const FREE_JUMP_PX: f32 = 2.5;
/// Cost per px beyond it, in columns' rewards.
const JUMP_COST_PER_PX: f32 = 0.5;
/// Brightest reward: a glint is worth no more than a good stripe.
const REWARD_MAX: f32 = 1.2;
/// Reward of a candidate that is ruled out: no path gains by it.
const RULED_OUT: f32 = -1e3;
/// Came from, or stays at, "no point".
const NONE: u8 = u8::MAX;

#[derive(Debug, Clone, Default)]
pub(super) struct PathScratch {
    back: Vec<[u8; MAX_PER_COLUMN + 1]>,
    chosen: Vec<u8>,
}

/// For every column the index of its candidate on the stripe, or `None`.
pub(super) fn choose<'a>(
    spots: &Spots,
    columns: usize,
    step_cost: f32,
    scratch: &'a mut PathScratch,
) -> impl Iterator<Item = Option<usize>> + use<'a> {
    let typical = typical_contrast(spots, columns);
    scratch.back.clear();
    scratch.chosen.clear();
    scratch.chosen.resize(columns, NONE);
    let mut values = [f32::NEG_INFINITY; MAX_PER_COLUMN];
    let mut none_value = 0.0f32;
    let mut previous: &[Spot] = &[];
    let per_contrast = 1.0 / typical;
    scratch.back.extend((0..columns).map(|column| {
        let here = spots.column(column);
        let mut back = [NONE; MAX_PER_COLUMN + 1];
        let from_none = none_value - 0.5 * step_cost;
        let mut best = none_value;
        // Most columns have one candidate, and so has the column before.
        if let ([spot], [from]) = (here, previous) {
            if values[0] - 0.5 * step_cost > best {
                best = values[0] - 0.5 * step_cost;
                back[MAX_PER_COLUMN] = 0;
            }
            let via = values[0] - jump_cost(spot, from, step_cost);
            let mut value = from_none;
            if via > value {
                value = via;
                back[0] = 0;
            }
            values[0] = value + reward(spot, per_contrast);
            none_value = best;
            previous = here;
            return back;
        }
        for (m, value) in values.iter().enumerate().take(previous.len()) {
            if value - 0.5 * step_cost > best {
                best = value - 0.5 * step_cost;
                back[MAX_PER_COLUMN] = m as u8;
            }
        }
        let mut next = values;
        for (k, spot) in here.iter().enumerate() {
            let mut value = from_none;
            for (m, from) in previous.iter().enumerate() {
                let via = values[m] - jump_cost(spot, from, step_cost);
                if via > value {
                    value = via;
                    back[k] = m as u8;
                }
            }
            next[k] = value + reward(spot, per_contrast);
        }
        none_value = best;
        values = next;
        previous = here;
        back
    }));
    let mut state = NONE;
    let mut value = none_value;
    for (m, v) in values.iter().enumerate().take(previous.len()) {
        // Leaving through the image's edge ends a segment like any other: half a step.
        if v - 0.5 * step_cost > value {
            value = v - 0.5 * step_cost;
            state = m as u8;
        }
    }
    for (chosen, back) in scratch.chosen.iter_mut().zip(&scratch.back).rev() {
        *chosen = state;
        state = back[usize::from(state).min(MAX_PER_COLUMN)];
    }
    scratch
        .chosen
        .iter()
        .map(|&c| (c != NONE).then_some(usize::from(c)))
}

/// Median over columns of each column's best contrast; 1 where there is none.
fn typical_contrast(spots: &Spots, columns: usize) -> f32 {
    let mut histogram = [0u32; 256];
    let mut total = 0;
    for column in 0..columns {
        let spots = spots.column(column);
        if let Some(best) = spots.iter().map(|s| s.contrast).max()
            && best > 0
        {
            histogram[usize::from(best)] += 1;
            total += 1;
        }
    }
    let mut seen = 0;
    let median = histogram.iter().position(|count| {
        seen += count;
        seen > total / 2
    });
    median.map_or(1.0, |contrast| contrast as f32).max(1.0)
}

/// Price of going from one candidate to another in the next column.
#[inline(always)]
fn jump_cost(to: &Spot, from: &Spot, step_cost: f32) -> f32 {
    let jump = (to.row_px - from.row_px).abs() - FREE_JUMP_PX;
    (jump.max(0.0) * JUMP_COST_PER_PX).min(step_cost)
}

#[inline(always)]
fn reward(spot: &Spot, per_contrast: f32) -> f32 {
    if spot.contrast == 0 {
        return RULED_OUT;
    }
    (f32::from(spot.contrast) * per_contrast).min(REWARD_MAX)
}
