//! Light that comes and goes by rows, also in rows that the stripe hides: a Gaussian process (Rasmussen and Williams 2006,
//! chapters 2 and 5) of the rows seen, whose sd between them is known with it.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// Rows taken together: a period of mains light takes 50 and more.
const BIN_ROWS: usize = 4;
/// And while the length is chosen.
const COARSE_ROWS: usize = 8;
/// Lengths of the squared-exponential covariance that are tried \[rows\].
const LENGTHS_ROWS: [f64; 6] = [8.0, 12.0, 18.0, 27.0, 40.0, 60.0];
/// Variance of what is no such process \[grey levels²\]: a twentieth of a level.
const NUGGET2: f64 = 0.05 * 0.05;

/// Light of each row beyond the median, and its sd \[grey levels\].
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Rows {
    pub level: Vec<f64>,
    pub sd: Vec<f64>,
}

/// Some rows together.
struct Bin {
    row: f64,
    level: f64,
    variance: f64,
}

/// Of all rows from those that are seen, each with its sd. All even where nothing is seen.
pub(super) fn of_rows(seen: &[Option<f64>], sds: &[f64]) -> Rows {
    let coarse = bins(seen, sds, COARSE_ROWS);
    let n = coarse.len().max(1) as f64;
    let square: f64 = coarse
        .iter()
        .map(|b| b.level * b.level - b.variance)
        .sum::<f64>()
        / n;
    let amplitude2 = square.max(NUGGET2);
    let likeliest = LENGTHS_ROWS
        .into_iter()
        .filter_map(|length| Some((evidence(&coarse, amplitude2, length)?, length)))
        .max_by(|a, b| a.0.total_cmp(&b.0));
    let even = Rows {
        level: vec![0.0; seen.len()],
        sd: vec![amplitude2.sqrt(); seen.len()],
    };
    let Some((_, length)) = likeliest else {
        return even;
    };
    let bins = bins(seen, sds, BIN_ROWS);
    let Some(solved) = covariance(&bins, amplitude2, length).cholesky() else {
        return even;
    };
    let weights = solved.solve(&levels(&bins));
    let by_row = |row: usize| {
        let at = DVector::from_iterator(
            bins.len(),
            bins.iter()
                .map(|b| alike(amplitude2, length, row as f64 - b.row)),
        );
        let variance = amplitude2 + NUGGET2 - at.dot(&solved.solve(&at));
        (at.dot(&weights), variance.max(NUGGET2).sqrt())
    };
    // The sd of every few rows stands for those about it.
    let every = (0..seen.len() + BIN_ROWS).step_by(BIN_ROWS);
    let every: Vec<(f64, f64)> = every.map(by_row).collect();
    let level = |row: usize| {
        let (k, t) = (row / BIN_ROWS, (row % BIN_ROWS) as f64 / BIN_ROWS as f64);
        match (every.get(k), every.get(k + 1)) {
            (Some(a), Some(b)) => a.0 + t * (b.0 - a.0),
            _ => 0.0,
        }
    };
    Rows {
        level: (0..seen.len()).map(level).collect(),
        sd: (0..seen.len())
            .map(|row| every.get(row / BIN_ROWS).map_or(0.0, |e| e.1))
            .collect(),
    }
}

fn bins(seen: &[Option<f64>], sds: &[f64], rows: usize) -> Vec<Bin> {
    let of_bin = |(k, (seen, sds)): (usize, (&[Option<f64>], &[f64]))| {
        let (mut weights, mut level, mut row) = (0.0, 0.0, 0.0);
        for (n, (by, sd)) in seen.iter().zip(sds).enumerate() {
            if let Some(by) = by {
                let weight = 1.0 / (sd * sd).max(1e-6);
                weights += weight;
                level += weight * by;
                row += weight * (k * rows + n) as f64;
            }
        }
        (weights > 0.0).then(|| Bin {
            row: row / weights,
            level: level / weights,
            variance: 1.0 / weights,
        })
    };
    seen.chunks(rows)
        .zip(sds.chunks(rows))
        .enumerate()
        .filter_map(of_bin)
        .collect()
}

fn alike(amplitude2: f64, length: f64, apart: f64) -> f64 {
    amplitude2 * (-0.5 * (apart / length).powi(2)).exp()
}

fn covariance(bins: &[Bin], amplitude2: f64, length: f64) -> DMatrix<f64> {
    DMatrix::from_fn(bins.len(), bins.len(), |i, j| {
        let own = if i == j {
            bins[i].variance + NUGGET2
        } else {
            0.0
        };
        alike(amplitude2, length, bins[i].row - bins[j].row) + own
    })
}

fn levels(bins: &[Bin]) -> DVector<f64> {
    DVector::from_iterator(bins.len(), bins.iter().map(|b| b.level))
}

/// ln of the bins' density, up to what is the same for all lengths.
fn evidence(bins: &[Bin], amplitude2: f64, length: f64) -> Option<f64> {
    let solved: Cholesky<f64, Dyn> = covariance(bins, amplitude2, length).cholesky()?;
    let levels = levels(bins);
    let of_levels = levels.dot(&solved.solve(&levels));
    let ln_root: f64 = solved.l_dirty().diagonal().iter().map(|d| d.ln()).sum();
    Some(-0.5 * of_levels - ln_root)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_that_the_stripe_hides_are_within_their_sds() {
        for period in [50.0, 61.0, 90.0, 150.0] {
            for gap in [200..236, 300..350, 0..30] {
                let light = |row: usize| 3.0 * (row as f64 / period * std::f64::consts::TAU).sin();
                let noise =
                    |row: usize| 0.1 * (2.0 * ((row * 7919) as f64 * 0.618_034).fract() - 1.0);
                let seen: Vec<Option<f64>> = (0..576)
                    .map(|row| (!gap.contains(&row)).then(|| light(row) + noise(row)))
                    .collect();
                let rows = of_rows(&seen, &vec![0.06; 576]);
                let of = |range: std::ops::Range<usize>| {
                    range
                        .map(|r| ((rows.level[r] - light(r)) / rows.sd[r]).abs())
                        .fold(0.0, f64::max)
                };
                assert!(
                    of(gap.clone()) < 4.0,
                    "{period} {gap:?}: {}",
                    of(gap.clone())
                );
                assert!(of(400..576) < 4.0, "{period}: {}", of(400..576));
                let middle = (gap.start + gap.end) / 2;
                assert!(
                    gap.start == 0 || rows.sd[middle] < 2.0,
                    "{period} {gap:?}: {}",
                    rows.sd[middle]
                );
            }
        }
    }
}
