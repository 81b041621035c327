//! Expanded uncertainty where some sources act only with a probability.
//!
//! An effect that runs cannot show is there or not: the error that it makes is a mixture, nothing or normal, and no multiple of its
//! standard uncertainty holds a stated share. So the interval is that of the mixture's distribution, by all combinations of the
//! effects that count.
//! Reference: JCGM 101:2008 (GUM supplement 1), propagation of distributions.

use statrs::function::erf::erf;

use super::outcome::COVERAGE;

/// Effects whose combinations are counted one by one; what the others do counts as normal.
const ONE_BY_ONE: usize = 10;
/// Halvings of the interval in which the half-width is looked for: to a millionth of it.
const HALVINGS: usize = 40;

/// Half-width of the interval about 0 that holds the error with the probability of [`COVERAGE`] sds of a normal one.
///
/// `variance` of all that is certain to act; `effects` = probability, and sd where it acts.
#[must_use]
pub fn half_width(variance: f64, effects: &[(f64, f64)]) -> f64 {
    let mut effects: Vec<(f64, f64)> = effects.to_vec();
    effects.sort_by(|a, b| (b.0 * b.1 * b.1).total_cmp(&(a.0 * a.1 * a.1)));
    let rest = effects.split_off(effects.len().min(ONE_BY_ONE));
    let variance = variance + rest.iter().map(|(p, sd)| p * sd * sd).sum::<f64>();
    // Probability and variance of each combination.
    let mut combinations = vec![(1.0, variance)];
    for (p, sd) in &effects {
        let with = combinations.iter().map(|(q, v)| (q * p, v + sd * sd));
        let with: Vec<(f64, f64)> = with.collect();
        combinations.iter_mut().for_each(|c| c.0 *= 1.0 - p);
        combinations.extend(with);
    }
    let largest = combinations.iter().map(|c| c.1).fold(0.0, f64::max);
    let level = erf(COVERAGE / 2f64.sqrt());
    let holds = |half: f64| -> f64 {
        let one = |(p, v): &(f64, f64)| match *v > 0.0 {
            true => p * erf(half / (2.0 * v).sqrt()),
            false => *p,
        };
        combinations.iter().map(one).sum()
    };
    let (mut low, mut high) = (0.0, COVERAGE * largest.sqrt());
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        match holds(middle) < level {
            true => low = middle,
            false => high = middle,
        }
    }
    high
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_certain_is_normal_and_what_is_not_holds_as_much() {
        assert!((half_width(9.0, &[]) - 6.0).abs() < 1e-6);
        assert!((half_width(9.0, &[(1.0, 4.0)]) - 10.0).abs() < 1e-6);
        // An effect of one in a thousand widens by next to nothing, however large.
        assert!(half_width(1.0, &[(1e-3, 1e6)]) < 2.1);
        // One of one in ten: .0455 of all is .455 of those with it, |N| > .747 sd.
        let wide = half_width(1.0, &[(0.1, 1e3)]);
        assert!((wide / 747.0 - 1.0).abs() < 0.05, "{wide}");
        // More than are counted one by one.
        let many = half_width(1.0, &[(0.5, 1.0); 14]);
        assert!((many / (2.0 * 8f64.sqrt()) - 1.0).abs() < 0.03, "{many}");
    }
}
