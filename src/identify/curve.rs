//! Propagates the thrust curve's own uncertainty to the coefficients.
//!
//! First-order propagation: the curve's covariance falls into principal directions; along each the
//! curve is moved by one standard deviation, the runs are loaded and fitted again, and what the
//! coefficients do is one column of the spread that the bollard pull leaves in them. Deadband,
//! asymmetry and scale thus enter exactly as the runs use them (JCGM 100:2008, section 5.2).

use hydroline_numerics::information::correlation;
use hydroline_rigs::Rig;
use nalgebra::{DMatrix, SymmetricEigen};

use super::outcome::Identification;

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

/// Adds to a result what refits with moved curves found: `values[k]` in the result's order.
/// Intervals grow about their estimates in proportion to the sd.
pub fn widen(result: &mut Identification, values: &[Vec<f64>]) {
    let n = result.order.len();
    let centre: Vec<f64> = result
        .order
        .iter()
        .map(|k| result.value(k).unwrap_or(f64::NAN))
        .collect();
    for (i, key) in result.order.iter().enumerate() {
        let added: f64 = values.iter().map(|v| (v[i] - centre[i]).powi(2)).sum();
        let Some(p) = result.parameters.get_mut(key) else {
            continue;
        };
        let Some(sd) = p.sd.filter(|sd| *sd > 0.0 && added.is_finite()) else {
            continue;
        };
        let wider = sd.hypot(added.sqrt());
        p.combined_sd = p.combined_sd.map(|c| c.hypot(added.sqrt()));
        p.u95 = p.combined_sd.map(|c| 2.0 * c);
        let about = p.value;
        let grow = |end: f64| about + (end - about) * wider / sd;
        (p.low, p.high) = (p.low.map(grow), p.high.map(grow));
        p.sd = Some(wider);
    }
    let mut whole = DMatrix::from_element(n, n, f64::INFINITY);
    for i in 0..n {
        for j in 0..n {
            let added: f64 = values
                .iter()
                .map(|v| (v[i] - centre[i]) * (v[j] - centre[j]))
                .sum();
            if let Some(cell) = &mut result.covariance[i][j] {
                *cell += added;
                whole[(i, j)] = *cell;
            } else if i != j {
                whole[(i, j)] = 0.0;
            }
            let combined = result.covariance_combined.get_mut(i);
            if let Some(cell) = combined.and_then(|row| row[j].as_mut()) {
                *cell += added;
            }
        }
    }
    result.correlation = correlation(&whole)
        .row_iter()
        .map(|r| r.iter().copied().collect())
        .collect();
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
