//! Both logs read one clock of the host: its records tell the offset.

use super::pair::Pair;
use super::{From, Relation};

/// UNIX time against a clock that no one sets: (that clock, UNIX) \[ns\].
pub(super) type Pairs = Vec<(i128, i128)>;

/// A line through differences, by their mean place.
struct Line {
    middle: f64,
    value: f64,
    value_variance: f64,
    slope: f64,
    slope_variance: f64,
}

impl Line {
    fn at(&self, x: f64) -> f64 {
        self.value + self.slope * (x - self.middle)
    }

    fn variance_at(&self, x: f64) -> f64 {
        self.value_variance + self.slope_variance * (x - self.middle).powi(2)
    }
}

fn line(points: &[(f64, f64)]) -> Option<Line> {
    let n = points.len() as f64;
    if points.len() < 3 {
        return None;
    }
    let (mx, my) = (
        points.iter().map(|p| p.0).sum::<f64>() / n,
        points.iter().map(|p| p.1).sum::<f64>() / n,
    );
    let sxx: f64 = points.iter().map(|p| (p.0 - mx).powi(2)).sum();
    let sxy: f64 = points.iter().map(|p| (p.0 - mx) * (p.1 - my)).sum();
    if sxx <= 0.0 {
        return None;
    }
    let slope = sxy / sxx;
    let rest: f64 = points
        .iter()
        .map(|p| (p.1 - my - slope * (p.0 - mx)).powi(2))
        .sum();
    let variance = rest / (n - 2.0);
    Some(Line {
        middle: mx,
        value: my,
        value_variance: variance / n,
        slope,
        slope_variance: variance / sxx,
    })
}

/// `None` = no such records in both, or of two hosts or two starts of one.
pub(super) fn relation(pair: &Pair) -> Option<Relation> {
    let (a, b) = (&pair.motion_clocks, &pair.command_clocks);
    let ends = |p: &Pairs| Some((p.first()?.0, p.last()?.0));
    let ((a0, a1), (b0, b1)) = (ends(a)?, ends(b)?);
    let [boot_a, boot_b] = &pair.boots;
    if boot_a
        .as_ref()
        .zip(boot_b.as_ref())
        .is_some_and(|(a, b)| a != b)
    {
        return None;
    }
    // Clocks of one start of one host overlap when the recordings do; of others it would be chance.
    if a1 < b0 || b1 < a0 {
        return None;
    }
    let zero = b0;
    let of = |p: &Pairs| -> Vec<(f64, f64)> {
        let base = p[0].1 - p[0].0;
        p.iter()
            .map(|(m, u)| ((m - zero) as f64 * 1e-9, (u - m - base) as f64 * 1e-9))
            .collect()
    };
    let (la, lb) = (line(&of(a))?, line(&of(b))?);
    let bases_s = ((a[0].1 - a[0].0) - (b[0].1 - b[0].0)) as f64 * 1e-9;
    // Place of the first command on the common clock.
    let own_s = (i128::from(pair.reference_ns()) - b[0].1 + b[0].0 - zero) as f64 * 1e-9;
    let offset_s = bases_s + la.at(own_s) - lb.at(own_s);
    Some(Relation {
        from: From::Clocks,
        offset_s,
        offset_sd_s: (la.variance_at(own_s) + lb.variance_at(own_s)).sqrt(),
        drift_ppm: (la.slope - lb.slope) / (1.0 + lb.slope) * 1e6,
        drift_sd_ppm: (la.slope_variance + lb.slope_variance).sqrt() * 1e6,
        reference_ns: pair.reference_ns(),
        warnings: Vec::new(),
    })
}
