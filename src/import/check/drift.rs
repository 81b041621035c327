//! A second clock in the same rows.

use super::Finding;

/// Least-squares slope of the second clock over the first, updated row by row (Welford).
#[derive(Debug, Default)]
pub(super) struct Drift {
    count: f64,
    mean: (f64, f64),
    sxx: f64,
    sxy: f64,
}

impl Drift {
    pub fn add(&mut self, times_s: &[f64], compare_s: &[f64]) {
        for (x, y) in times_s.iter().zip(compare_s).filter(|p| p.1.is_finite()) {
            self.count += 1.0;
            let (dx, dy) = (x - self.mean.0, y - self.mean.1);
            self.mean.0 += dx / self.count;
            self.mean.1 += dy / self.count;
            self.sxx += dx * (x - self.mean.0);
            self.sxy += dx * (y - self.mean.1);
        }
    }

    pub fn report(&self, findings: &mut Vec<Finding>) {
        if self.count < 4.0 {
            return;
        }
        let slope = self.sxy / self.sxx;
        let ppm = (slope - 1.0) * 1e6;
        findings.push(if ppm.abs() > 1e5 {
            Finding::fault(
                "compare_unit",
                None,
                format!(
                    "the second clock runs {slope:.4} times as fast; is time.compare_unit right?"
                ),
            )
        } else if ppm.abs() > 20.0 {
            Finding::warning(
                "clock_drift",
                None,
                format!("the second clock gains {ppm:.0} ppm on the time column"),
            )
        } else {
            Finding::info(
                "clock_drift",
                format!("the clocks agree within {ppm:.1} ppm"),
            )
        });
    }
}
