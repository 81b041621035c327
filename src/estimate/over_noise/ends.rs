//! Interval of a mixture of normal errors.

use statrs::function::erf::erf;

/// Part of a mixture of normal errors.
pub(super) struct Part {
    pub weight: f64,
    pub mean: f64,
    pub sd: f64,
}

/// Ends of the interval that leaves 2.5 % of a mixture on either side, over its sd; its mean is 0.
///
/// A random force that is improbable and large makes the mean square, and hardly the interval.
pub(super) fn relative_ends(parts: &[Part]) -> [f64; 2] {
    let square = |p: &Part| p.weight * (p.sd * p.sd + p.mean * p.mean);
    let sd = parts.iter().map(square).sum::<f64>().sqrt();
    if !(sd.is_finite() && sd > 0.0) {
        return [-NORMAL_95, NORMAL_95];
    }
    let below = |at: f64| -> f64 {
        let each = parts.iter().filter(|p| p.sd > 0.0);
        each.map(|p| 0.5 * p.weight * (1.0 + erf((at - p.mean) / (2f64.sqrt() * p.sd))))
            .sum()
    };
    [0.025, 0.975].map(|share| {
        // By Cantelli's inequality no end is farther out.
        let most = sd * (1.0_f64 / 0.025 - 1.0).sqrt();
        let (mut low, mut high) = (-most, most);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            match below(middle) < share {
                true => low = middle,
                false => high = middle,
            }
        }
        0.5 * (low + high) / sd
    })
}

/// Half-width of a normal 95 % interval over its sd.
pub(crate) const NORMAL_95: f64 = 1.959_964;
/// Halvings of the interval in which an end is looked for: to a millionth of it.
const HALVINGS: usize = 25;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ends_hold_95_of_a_hundred_of_a_mixture_about_its_mean() {
        let one = |weight, mean, sd| Part { weight, mean, sd };
        for end in relative_ends(&[one(1.0, 0.0, 3.0)]) {
            assert!((end.abs() - NORMAL_95).abs() < 1e-4, "{end}");
        }
        // One of a hundred a hundred times as wide: ten times the sd, and hardly wider.
        let rare = relative_ends(&[one(0.99, 0.0, 1.0), one(0.01, 0.0, 100.0)]);
        let sd = (0.99_f64 + 100.0).sqrt();
        assert!((1.96..2.5).contains(&(sd * rare[1])), "{rare:?}");
        // To one side.
        let skew = relative_ends(&[one(0.9, -0.2, 1.0), one(0.1, 1.8, 3.0)]);
        assert!(skew[1] > -1.3 * skew[0], "{skew:?}");
    }
}
