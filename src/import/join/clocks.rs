//! Both logs read one clock of the host: its records tell the offset.

use super::pair::Pair;
use super::{From, Relation};

/// UNIX time against a clock that no one sets: (that clock, UNIX) \[ns\].
pub(super) type Pairs = Vec<(i128, i128)>;

/// A line through differences: value at a place, slope, and their variances.
fn line(points: &[(f64, f64)]) -> Option<(f64, f64, f64, f64, f64)> {
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
    Some((my, slope, variance / n, variance / sxx, mx))
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
    let at = |l: (f64, f64, f64, f64, f64), x: f64| l.0 + l.1 * (x - l.4);
    let bases_s = ((a[0].1 - a[0].0) - (b[0].1 - b[0].0)) as f64 * 1e-9;
    // Place of the first command on the common clock.
    let own_s = (i128::from(pair.reference_ns()) - b[0].1 + b[0].0 - zero) as f64 * 1e-9;
    let offset_s = bases_s + at(la, own_s) - at(lb, own_s);
    let spread = |l: (f64, f64, f64, f64, f64)| l.2 + l.3 * (own_s - l.4).powi(2);
    Some(Relation {
        from: From::Clocks,
        offset_s,
        offset_sd_s: (spread(la) + spread(lb)).sqrt(),
        drift_ppm: (la.1 - lb.1) / (1.0 + lb.1) * 1e6,
        drift_sd_ppm: (la.3 + lb.3).sqrt() * 1e6,
        reference_ns: pair.reference_ns(),
        warnings: Vec::new(),
    })
}
