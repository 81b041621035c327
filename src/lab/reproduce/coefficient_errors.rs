//! Errors of three coefficients over many experiments.

/// Three coefficients as one experiment identified them, in SI.
#[derive(Clone, Copy)]
pub(super) struct Identified {
    pub values: [f64; 3],
    pub sds: [f64; 3],
}

/// Errors of the coefficients, each over all experiments.
pub(super) struct CoefficientErrors {
    /// Mean error \[% of the actual\].
    pub mean_percent: [f64; 3],
    /// rms error \[%\].
    pub rms_percent: [f64; 3],
    /// rms of the reported standard deviations \[%\].
    pub sd_percent: [f64; 3],
    /// Largest error in units of its own reported sd.
    pub worst_in_sd: [f64; 3],
}

impl CoefficientErrors {
    /// Errors against the `actual` values.
    pub fn of(actual: [f64; 3], found: &[Identified]) -> CoefficientErrors {
        let n = found.len().max(1) as f64;
        let percent =
            |i: &Identified, k: usize| 100.0 * (i.values[k] - actual[k]) / actual[k].abs();
        let rms = |f: &dyn Fn(&Identified) -> f64| {
            (found.iter().map(|i| f(i).powi(2)).sum::<f64>() / n).sqrt()
        };
        let three = |f: &dyn Fn(usize) -> f64| -> [f64; 3] { std::array::from_fn(f) };
        CoefficientErrors {
            mean_percent: three(&|k| found.iter().map(|i| percent(i, k)).sum::<f64>() / n),
            rms_percent: three(&|k| rms(&|i| percent(i, k))),
            sd_percent: three(&|k| rms(&|i| 100.0 * i.sds[k] / actual[k])),
            worst_in_sd: three(&|k| {
                let in_sd = |i: &Identified| ((i.values[k] - actual[k]) / i.sds[k]).abs();
                found.iter().map(in_sd).fold(0.0, f64::max)
            }),
        }
    }
}
