//! Propagates the thrust curve's own uncertainty to the coefficients.
//!
//! First-order propagation: the curve's covariance falls into principal directions; along each the
//! curve is moved by one standard deviation, the runs are loaded and fitted again, and what the
//! coefficients do is one column of the spread that the bollard pull leaves in them. Deadband,
//! asymmetry and scale thus enter exactly as the runs use them (JCGM 100:2008, section 5.2). It is a line of the budget, of type B.

use std::collections::BTreeMap;

use hydroline_core::run::Run;
use hydroline_rigs::Rig;
use nalgebra::{DMatrix, SymmetricEigen};

use super::outcome::{BudgetLine, Identification};

/// Directions whose variance is below this share of the largest are left out.
const NEGLIGIBLE: f64 = 1e-6;

/// The rig with its curve moved by one standard deviation along each principal direction; empty
/// where no bollard pull is known or its pulses are not the curve's.
pub fn moved_rigs(rig: &Rig) -> Vec<Rig> {
    let Some(pull) = &rig.bollard else {
        return Vec::new();
    };
    let n = pull.pulse_us.len();
    let fits = |points: &[(f64, f64)]| {
        points.len() == n && points.iter().zip(&pull.pulse_us).all(|(p, us)| p.0 == *us)
    };
    if n == 0
        || !rig
            .thrusters
            .thrusters
            .iter()
            .all(|t| fits(&t.curve.points))
    {
        return Vec::new();
    }
    // Rounding on its way through a file may leave it a little asymmetric.
    let covariance = DMatrix::from_fn(n, n, |i, j| {
        0.5 * (pull.covariance_n2[i][j] + pull.covariance_n2[j][i])
    });
    let eigen = SymmetricEigen::new(covariance);
    let largest = eigen.eigenvalues.max();
    (0..n)
        .filter(|k| largest > 0.0 && eigen.eigenvalues[*k] > NEGLIGIBLE * largest)
        .map(|k| {
            let mut moved = rig.clone();
            let sd = eigen.eigenvalues[k].sqrt();
            for thruster in &mut moved.thrusters.thrusters {
                for (i, point) in thruster.curve.points.iter_mut().enumerate() {
                    point.1 += sd * eigen.eigenvectors[(i, k)];
                }
                level_falls(&mut thruster.curve.points);
            }
            moved
        })
        .collect()
}

/// The nearest curve that nowhere falls (pool adjacent violators: Barlow et al. 1972, ch. 1). Across the deadband a moved
/// curve may fall by a little, which no rig may hold.
fn level_falls(points: &mut [(f64, f64)]) {
    // Blocks of equal thrust: (mean thrust, points in it).
    let mut blocks: Vec<(f64, usize)> = Vec::with_capacity(points.len());
    for (_, thrust_n) in points.iter() {
        let mut block = (*thrust_n, 1);
        while let Some(&(before, count)) = blocks.last()
            && before > block.0
        {
            let all = count + block.1;
            block.0 = (before * count as f64 + block.0 * block.1 as f64) / all as f64;
            block.1 = all;
            blocks.pop();
        }
        blocks.push(block);
    }
    let levels = blocks
        .iter()
        .flat_map(|(thrust_n, count)| std::iter::repeat_n(*thrust_n, *count));
    for (point, thrust_n) in points.iter_mut().zip(levels) {
        point.1 = thrust_n;
    }
}

/// Whether the covariance of a bollard pull is what is known of the thrust in these runs: the rig has one of this curve, and the loads
/// came from pulses.
pub fn is_measured(rig: &Rig, runs: &[Run]) -> bool {
    let by_curve = |r: &Run| r.from_pulses || r.largest_wrench().iter().all(|w| *w == 0.0);
    runs.iter().all(by_curve) && !moved_rigs(rig).is_empty()
}

/// Takes into a budget what refits with moved curves found: `values[k]` in the result's order. What the samples say stays as it is.
pub fn widen(result: &mut Identification, values: &[Vec<f64>]) {
    let centre: Vec<f64> = result
        .order
        .iter()
        .map(|k| result.value(k).unwrap_or(f64::NAN))
        .collect();
    let by_curve = |i: usize, j: usize| -> f64 {
        let each = values.iter();
        each.map(|v| (v[i] - centre[i]) * (v[j] - centre[j])).sum()
    };
    // Where no budget was made this is all that is known of type B.
    if result.covariance_combined.is_empty() {
        result.covariance_combined.clone_from(&result.covariance);
    }
    for (i, row) in result.covariance_combined.iter_mut().enumerate() {
        for (j, cell) in row.iter_mut().enumerate() {
            let added = by_curve(i, j);
            if let Some(cell) = cell.as_mut().filter(|_| added.is_finite()) {
                *cell += added;
            }
        }
    }
    let sd = |i: usize| by_curve(i, i).sqrt();
    let each = result.order.iter().enumerate();
    let each = each.map(|(i, key)| (key.clone(), sd(i)));
    let contributions: BTreeMap<String, f64> = each.filter(|(_, sd)| *sd > 0.0).collect();
    if !contributions.is_empty() {
        result.budget.push(BudgetLine {
            source: "thrust curve".to_owned(),
            kind: "B".to_owned(),
            sd: None,
            probability: None,
            unit: "of the curve's points".to_owned(),
            basis: "[bollard] of the rig".to_owned(),
            sensitivities: BTreeMap::new(),
            contributions,
            reduce: "a bollard pull of more readings".to_owned(),
        });
    }
    result.combine();
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Nothing falls, the sum of thrusts stays, and a curve that did not fall stays as it is.
        #[test]
        fn levelled_curves_rise_and_keep_their_mean(thrusts in proptest::collection::vec(-50.0f64..50.0, 2..20)) {
            let curve = |t: &[f64]| -> Vec<(f64, f64)> { t.iter().enumerate().map(|(i, t)| (i as f64, *t)).collect() };
            let mut points = curve(&thrusts);
            level_falls(&mut points);
            prop_assert!(points.windows(2).all(|w| w[0].1 <= w[1].1));
            let sum: f64 = points.iter().map(|p| p.1).sum();
            prop_assert!((sum - thrusts.iter().sum::<f64>()).abs() < 1e-9);
            let mut sorted = thrusts;
            sorted.sort_by(f64::total_cmp);
            let mut rising = curve(&sorted);
            level_falls(&mut rising);
            prop_assert_eq!(rising, curve(&sorted));
        }
    }
    use hydroline_rigs::BollardPull;

    #[test]
    fn directions_carry_the_whole_covariance() {
        let mut rig = Rig::builtin("lshpi").unwrap();
        assert!(
            moved_rigs(&rig).is_empty(),
            "no bollard pull, nothing to move"
        );
        let points = rig.thrusters.thrusters[0].curve.points.clone();
        let n = points.len();
        // 2 % of scale, and 0.05 N of its own at the last point.
        let cell = |i: usize, j: usize| {
            4e-4 * points[i].1 * points[j].1 + if i == j && i + 1 == n { 0.0025 } else { 0.0 }
        };
        let covariance_n2: Vec<Vec<f64>> = (0..n)
            .map(|i| (0..n).map(|j| cell(i, j)).collect())
            .collect();
        rig.bollard = Some(BollardPull {
            voltage_v: 16.0,
            scatter_n: 0.1,
            pulse_us: points.iter().map(|p| p.0).collect(),
            covariance_n2: covariance_n2.clone(),
        });
        let moved = moved_rigs(&rig);
        assert_eq!(moved.len(), 2);
        for i in 0..n {
            let sum: f64 = moved
                .iter()
                .map(|m| (m.thrusters.thrusters[0].curve.points[i].1 - points[i].1).powi(2))
                .sum();
            assert!((sum - covariance_n2[i][i]).abs() < 1e-9, "{i}");
        }
        // A curve changed since the pull is not the one whose covariance is known.
        rig.thrusters.thrusters[0].curve.points[0].0 -= 1.0;
        assert!(moved_rigs(&rig).is_empty());
    }
}
