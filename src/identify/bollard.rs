//! Bollard pull: pulse to thrust from a table, with covariance; it makes the thrust scale identifiable.
//!
//! T(p, V) = (V / V0)^k (g (p - p0) + h (p - p0)^2) beyond each edge p0 of the deadband, 0 inside;
//! ahead and astern have their own edge and shape (an asymmetric propeller). k only where the
//! table holds voltages that differ. Quadratic in the pulse as propeller thrust is in the
//! rate of turn (Carlton, Marine Propellers and Propulsion, ch. 6).

use hydroline_numerics::information::Covariance;
use hydroline_numerics::least_squares::{LeastSquares, Normal, Options, minimise};
use hydroline_numerics::noise::OUTLIER_SD;
use hydroline_numerics::statistics::{ljung_box, median, robust_sd};
use hydroline_rigs::{BollardPull, Rig};
use hydroline_sim::{Dual, Real};
use nalgebra::{DMatrix, DVector, Dyn};
use serde::Serialize;
use std::convert::Infallible;

/// Reading of a bollard pull: what the scale shows at one pulse.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pull {
    /// Pulse \[us\].
    pub pulse_us: f64,
    /// Thrust on the scale, ahead positive \[N\].
    pub thrust_n: f64,
    /// Supply \[V\].
    pub voltage_v: Option<f64>,
}

/// A fitted curve.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct Bollard {
    /// Names of the numbers below.
    pub order: Vec<String>,
    /// Estimated numbers, in that order.
    pub values: Vec<f64>,
    /// Covariance of `values`.
    pub covariance: Vec<Vec<f64>>,
    /// (pulse \[us\], thrust \[N\], sd \[N\]) at the middle voltage: the rig's `curve`.
    pub curve: Vec<(f64, f64, f64)>,
    /// Covariance of the thrusts of `curve` \[N²\].
    pub curve_covariance_n2: Vec<Vec<f64>>,
    /// Voltage the curve holds at \[V\]; 0 = not measured.
    pub voltage_v: f64,
    /// Scatter of the readings about the curve \[N\].
    pub rms_n: f64,
    /// Readings left out as outliers.
    pub outliers: usize,
    /// Reasons why the curve is uncertain, one sentence each.
    pub notes: Vec<String>,
}

/// Failure to fit a curve.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum BollardError {
    #[error("{file}: {reason}; the table needs columns pulse_us,thrust_n and may have voltage_v")]
    Table {
        file: String,
        /// Reason, with the line.
        reason: String,
    },
    #[error(
        "{ahead} readings ahead and {astern} astern of {neutral_us} us; at least 4 on each side are needed, spread over the range"
    )]
    TooFew {
        ahead: usize,
        astern: usize,
        neutral_us: f64,
    },
    #[error(
        "the fitted thrust falls from {:.2} N at {:.1} us to {:.2} N at {:.1} us; check the readings there, and add some",
        from.1, from.0, to.1, to.0
    )]
    Falls {
        /// Last point before the fall: (pulse \[us\], thrust \[N\]).
        from: (f64, f64),
        /// First point after it: (pulse \[us\], thrust \[N\]).
        to: (f64, f64),
    },
}

/// Reads `pulse_us,thrust_n[,voltage_v]`; columns by name, any order.
///
/// # Errors
/// [`BollardError::Table`] naming the line.
pub fn read(text: &str, file: &str) -> Result<Vec<Pull>, BollardError> {
    let bad = |reason: String| BollardError::Table {
        file: file.to_owned(),
        reason,
    };
    let mut reader = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .from_reader(text.as_bytes());
    let header = reader.headers().map_err(|e| bad(e.to_string()))?.clone();
    let place = |name: &str| header.iter().position(|h| h == name);
    let pulse = place("pulse_us").ok_or_else(|| bad("no column pulse_us".into()))?;
    let thrust = place("thrust_n").ok_or_else(|| bad("no column thrust_n".into()))?;
    let voltage = place("voltage_v");
    let mut pulls = Vec::new();
    for record in reader.records() {
        let record = record.map_err(|e| bad(e.to_string()))?;
        let line = record.position().map_or(0, csv::Position::line);
        let number = |column: usize| {
            let cell = record.get(column).unwrap_or("");
            let value = cell.parse::<f64>().ok().filter(|v| v.is_finite());
            value.ok_or_else(|| bad(format!("line {line}: '{cell}' is no finite number")))
        };
        let voltage_v = voltage.map(number).transpose()?;
        if voltage_v.is_some_and(|v| v <= 0.0) {
            return Err(bad(format!("line {line}: voltage must be above 0")));
        }
        pulls.push(Pull {
            pulse_us: number(pulse)?,
            thrust_n: number(thrust)?,
            voltage_v,
        });
    }
    Ok(pulls)
}

/// A number of the curve with its range.
#[derive(Debug, Clone, Copy)]
struct Number {
    name: &'static str,
    start: f64,
    low: f64,
    high: f64,
}

struct Model {
    pulls: Vec<Pull>,
    numbers: Vec<Number>,
    middle_v: f64,
    /// Readings that count.
    used: Vec<bool>,
}

impl Model {
    fn thrust<T: Real>(&self, p: &[T], pulse_us: f64, voltage_v: Option<f64>) -> T {
        let [ahead_us, g_ahead, h_ahead, astern_us, g_astern, h_astern] =
            std::array::from_fn(|i| p[i]);
        let pulse = T::from_f64(pulse_us);
        let beyond = (pulse - ahead_us).max(T::zero());
        let below = (astern_us - pulse).max(T::zero());
        let shape = (g_ahead + h_ahead * beyond) * beyond - (g_astern + h_astern * below) * below;
        match (p.get(6), voltage_v) {
            // (V / V0)^k = exp(k ln(V / V0))
            (Some(k), Some(v)) => shape * (*k * (v / self.middle_v).ln()).exp(),
            _ => shape,
        }
    }

    /// Curve minus reading \[N\].
    fn residuals(&self, at: &[f64]) -> Vec<f64> {
        let each = self.pulls.iter();
        each.map(|r| self.thrust(at, r.pulse_us, r.voltage_v) - r.thrust_n)
            .collect()
    }

    /// The curve with the least sum of squares, from several widths of the deadband: beside an edge that is too far out no reading
    /// says where it is.
    fn fitted(&mut self, near: Option<&[f64]>) -> Vec<f64> {
        let starts: Vec<Vec<f64>> = match near {
            Some(at) => vec![at.to_vec()],
            None => DEADBANDS
                .iter()
                .map(|share| {
                    let start = |n: &Number| match n.name {
                        EDGE_AHEAD => n.low + share * (n.high - n.low),
                        EDGE_ASTERN => n.high - share * (n.high - n.low),
                        _ => n.start,
                    };
                    self.numbers.iter().map(start).collect()
                })
                .collect(),
        };
        let mut best: Option<(f64, Vec<f64>)> = None;
        for start in starts {
            let Ok(found) = minimise(self, start, &Options::DEFAULT);
            if best.as_ref().is_none_or(|b| found.normal.cost < b.0) {
                best = Some((found.normal.cost, found.at));
            }
        }
        best.map_or_else(Vec::new, |b| b.1)
    }

    fn normal(&self, at: &[f64]) -> Normal<Dyn> {
        let n = at.len();
        let duals: Vec<Dual<7>> = (0..n).map(|i| Dual::variable(at[i], i)).collect();
        let mut made = Normal {
            cost: 0.0,
            gradient: DVector::zeros(n),
            hessian: DMatrix::zeros(n, n),
        };
        for (r, _) in self.pulls.iter().zip(&self.used).filter(|(_, used)| **used) {
            let thrust = self.thrust(&duals, r.pulse_us, r.voltage_v);
            let residual = thrust.value - r.thrust_n;
            made.cost += 0.5 * residual * residual;
            for i in 0..n {
                made.gradient[i] += thrust.slope[i] * residual;
                for j in 0..n {
                    made.hessian[(i, j)] += thrust.slope[i] * thrust.slope[j];
                }
            }
        }
        made
    }
}

impl LeastSquares<Dyn> for Model {
    type Point = Vec<f64>;
    type Evaluated = ();
    type Error = Infallible;

    fn cost(&mut self, at: &Vec<f64>, (): &mut ()) -> Option<f64> {
        let each = self.residuals(at).into_iter().zip(&self.used);
        let squares = each.filter(|(_, used)| **used).map(|(r, _)| r * r);
        Some(0.5 * squares.sum::<f64>()).filter(|c| c.is_finite())
    }

    fn begin(&mut self, _: &Vec<f64>, (): &mut ()) -> Result<(), Infallible> {
        Ok(())
    }

    fn linearise(&mut self, at: &Vec<f64>, (): &()) -> Result<Normal<Dyn>, Infallible> {
        Ok(self.normal(at))
    }

    fn moved(&self, at: &Vec<f64>, step: &DVector<f64>) -> Option<Vec<f64>> {
        let each = at.iter().zip(step).zip(&self.numbers);
        Some(
            each.map(|((v, s), n)| (v + s).clamp(n.low, n.high))
                .collect(),
        )
    }

    fn moves(&self, at: &Vec<f64>, gradient: &DVector<f64>, k: usize) -> bool {
        // A number on its bound that wants out stays for this step.
        let n = &self.numbers[k];
        !((at[k] <= n.low && gradient[k] > 0.0) || (at[k] >= n.high && gradient[k] < 0.0))
    }
}

const EDGE_AHEAD: &str = "edge_ahead_us";
const EDGE_ASTERN: &str = "edge_astern_us";
/// Shares of an edge's range at which fits begin.
const DEADBANDS: [f64; 4] = [0.1, 0.0, 0.3, 0.6];
/// Rounds of fit and outliers.
const ROUNDS: usize = 4;
/// A direction whose information is below this share of the largest (at unit information of each number) is rounding.
const RANK: f64 = 1e-11;

/// Fits the curve; `range_us` = (min, neutral, max) pulse of the rig.
///
/// # Errors
/// [`BollardError`].
pub fn fit(pulls: &[Pull], range_us: (f64, f64, f64)) -> Result<Bollard, BollardError> {
    let (min_us, neutral_us, max_us) = range_us;
    let ahead = pulls
        .iter()
        .filter(|p| p.pulse_us > neutral_us && p.thrust_n > 0.0)
        .count();
    let astern = pulls
        .iter()
        .filter(|p| p.pulse_us < neutral_us && p.thrust_n < 0.0)
        .count();
    if ahead < 4 || astern < 4 {
        return Err(BollardError::TooFew {
            ahead,
            astern,
            neutral_us,
        });
    }
    let mut volts: Vec<f64> = pulls.iter().filter_map(|p| p.voltage_v).collect();
    volts.sort_by(f64::total_cmp);
    let middle_v = volts.get(volts.len() / 2).copied().unwrap_or(0.0);
    let spread_v = volts
        .last()
        .zip(volts.first())
        .map_or(0.0, |(high, low)| high - low);
    let with_voltage = volts.len() == pulls.len() && spread_v > 0.01 * middle_v;
    let (up_us, down_us) = (max_us - neutral_us, neutral_us - min_us);
    let free = |name: &'static str, start: f64, low: f64, high: f64| Number {
        name,
        start,
        low,
        high,
    };
    let largest = pulls.iter().fold(0.0_f64, |m, p| m.max(p.thrust_n.abs()));
    let slope = |span_us: f64| (0.3 * largest / span_us, 5.0 * largest / span_us);
    let curvature = |span_us: f64| {
        (
            0.7 * largest / span_us.powi(2),
            5.0 * largest / span_us.powi(2),
        )
    };
    let mut numbers = vec![
        free(
            EDGE_AHEAD,
            neutral_us + 0.05 * up_us,
            neutral_us,
            neutral_us + 0.5 * up_us,
        ),
        free("slope_ahead_npus", slope(up_us).0, 0.0, slope(up_us).1),
        free(
            "curvature_ahead_npus2",
            curvature(up_us).0,
            -curvature(up_us).1,
            curvature(up_us).1,
        ),
        free(
            EDGE_ASTERN,
            neutral_us - 0.05 * down_us,
            neutral_us - 0.5 * down_us,
            neutral_us,
        ),
        free("slope_astern_npus", slope(down_us).0, 0.0, slope(down_us).1),
        free(
            "curvature_astern_npus2",
            curvature(down_us).0,
            -curvature(down_us).1,
            curvature(down_us).1,
        ),
    ];
    if with_voltage {
        numbers.push(free("voltage_exponent", 1.5, 0.0, 4.0));
    }
    let mut model = Model {
        pulls: pulls.to_vec(),
        numbers,
        middle_v,
        used: vec![true; pulls.len()],
    };
    let mut at = model.fitted(None);
    for _ in 0..ROUNDS {
        let residuals = model.residuals(&at);
        let sd = robust_sd(&residuals).max(1e-9);
        let each = residuals.iter();
        let next: Vec<bool> = each.map(|r| r.abs() <= OUTLIER_SD * sd).collect();
        let same = next == model.used;
        model.used = next;
        at = model.fitted(Some(&at));
        if same {
            break;
        }
    }
    let normal = model.normal(&at);
    let n = at.len();
    let counted = model.used.iter().filter(|u| **u).count();
    let freedom = (counted as f64 - n as f64).max(1.0);
    let variance = 2.0 * normal.cost / freedom;
    let c = Covariance::of_information(&normal.hessian, RANK).with_infinities() * variance;
    let residuals = model.residuals(&at);
    let notes = notes_on(&model, &at, &residuals, range_us);
    let duals: Vec<Dual<7>> = at
        .iter()
        .enumerate()
        .map(|(i, v)| Dual::variable(*v, i))
        .collect();
    let at_pulse =
        |pulse_us: &f64| model.thrust(&duals, *pulse_us, with_voltage.then_some(middle_v));
    let mut pulses: Vec<f64> = (0..=8)
        .map(|k| min_us + (at[3] - min_us) * f64::from(k) / 8.0)
        .collect();
    // Without a deadband both edges are at neutral, which is one point then.
    let first = i32::from(at[0] <= at[3]);
    pulses.extend((first..=8).map(|k| at[0] + (max_us - at[0]) * f64::from(k) / 8.0));
    let thrusts: Vec<Dual<7>> = pulses.iter().map(at_pulse).collect();
    let slopes = DMatrix::from_fn(pulses.len(), n, |k, i| thrusts[k].slope[i]);
    let spread = &slopes * &c * slopes.transpose();
    let rows = |m: &DMatrix<f64>| -> Vec<Vec<f64>> {
        m.row_iter().map(|r| r.iter().copied().collect()).collect()
    };
    Ok(Bollard {
        order: model.numbers.iter().map(|n| n.name.to_owned()).collect(),
        curve: pulses
            .iter()
            .zip(&thrusts)
            .enumerate()
            .map(|(k, (pulse_us, t))| (*pulse_us, t.value, spread[(k, k)].max(0.0).sqrt()))
            .collect(),
        curve_covariance_n2: rows(&spread),
        covariance: rows(&c),
        values: at,
        voltage_v: middle_v,
        rms_n: variance.sqrt(),
        outliers: pulls.len() - counted,
        notes,
    })
}

/// p below which residuals are called not white.
const NOT_WHITE: f64 = 1e-3;
/// Share of the pulse range beyond the readings that is worth a word.
const EXTRAPOLATED: f64 = 0.02;
/// A curve this many times the rig's is another unit.
const OTHER_UNIT: f64 = 3.0;

/// Reasons why a fitted curve is uncertain by itself: bounds, range, residuals.
fn notes_on(
    model: &Model,
    at: &[f64],
    residuals: &[f64],
    (min_us, neutral_us, max_us): (f64, f64, f64),
) -> Vec<String> {
    let mut notes = Vec::new();
    for (free, value) in model.numbers.iter().zip(at) {
        // An edge at neutral is a thruster without a deadband.
        let on_bound = *value <= free.low || *value >= free.high;
        if on_bound && *value != neutral_us {
            notes.push(format!(
                "{}: ended on its range {:.4e} .. {:.4e}; its sd is not to be trusted",
                free.name, free.low, free.high
            ));
        }
    }
    let mut order: Vec<usize> = (0..model.pulls.len()).collect();
    order.sort_by(|a, b| {
        model.pulls[*a]
            .pulse_us
            .total_cmp(&model.pulls[*b].pulse_us)
    });
    let ends = order.first().zip(order.last());
    if let Some((low_us, high_us)) =
        ends.map(|(a, b)| (model.pulls[*a].pulse_us, model.pulls[*b].pulse_us))
    {
        let slack_us = EXTRAPOLATED * (max_us - min_us);
        if low_us > min_us + slack_us || high_us < max_us - slack_us {
            notes.push(format!(
                "readings cover {low_us:.0} .. {high_us:.0} us, the rig sends {min_us:.0} .. {max_us:.0} us: beyond the readings the curve is extrapolated, and its sd there knows nothing of another shape"
            ));
        }
    }
    let by_pulse: Vec<f64> = order
        .iter()
        .map(|k| match model.used[*k] {
            true => residuals[*k],
            false => f64::NAN,
        })
        .collect();
    let lags = (by_pulse.len() / 4).clamp(1, 10);
    if let Some(w) = ljung_box(&by_pulse, lags).filter(|w| w.p_value < NOT_WHITE && w.lag1 > 0.0) {
        notes.push(format!(
            "residuals in the order of the pulse are far from white (Ljung-Box p = {:.1e}, neighbours correlate {:.2}): the thrust is not quadratic in the pulse, or the readings drifted",
            w.p_value, w.lag1
        ));
    }
    notes
}

impl Bollard {
    /// Warning where the curve is far from the one the rig holds: grams read as newtons, another thruster.
    pub fn against(&self, rig: &Rig) -> Option<String> {
        let thruster = rig.thrusters.thrusters.first()?;
        let pairs = self
            .curve
            .iter()
            .map(|(pulse_us, thrust_n, _)| (*thrust_n, thruster.curve.thrust_n(*pulse_us)));
        let largest = pairs.clone().fold(0.0_f64, |m, p| m.max(p.1.abs()));
        // Near neutral both are small, and a deadband makes any ratio.
        let strong = pairs.filter(|p| p.1.abs() > 0.3 * largest);
        let mut ratios: Vec<f64> = strong.map(|p| p.0 / p.1).collect();
        let ratio = median(&mut ratios)?;
        let other = !(1.0 / OTHER_UNIT..=OTHER_UNIT).contains(&ratio);
        other.then(|| {
            format!(
                "the measured curve is {ratio:.3} times the rig's of {}: readings in grams or pounds, pulses the wrong way round, or another thruster? The table must be in newtons, ahead positive",
                thruster.name
            )
        })
    }

    /// Puts curve and covariance into a rig: every thruster's, since the pull was made with one of them.
    ///
    /// # Errors
    /// [`BollardError::Falls`] where the fitted thrust falls with rising pulse, which no rig may hold.
    pub fn put(&self, rig: &mut Rig) -> Result<(), BollardError> {
        let points: Vec<(f64, f64)> = self.curve.iter().map(|p| (p.0, p.1 + 0.0)).collect();
        if let Some(w) = points
            .windows(2)
            .find(|w| w[0].0 >= w[1].0 || w[0].1 > w[1].1)
        {
            return Err(BollardError::Falls {
                from: w[0],
                to: w[1],
            });
        }
        for thruster in &mut rig.thrusters.thrusters {
            thruster.curve.points.clone_from(&points);
        }
        rig.bollard = Some(BollardPull {
            voltage_v: self.voltage_v,
            scatter_n: self.rms_n,
            pulse_us: points.iter().map(|p| p.0).collect(),
            covariance_n2: self.curve_covariance_n2.clone(),
        });
        Ok(())
    }

    /// The `curve` of a rig file; falling pieces of the fit are refused by the rig's own check.
    pub fn to_toml(&self) -> String {
        let mut out = format!(
            "# Bollard pull, {} V, scatter {:.3} N; sd of each point behind it.\ncurve = [\n",
            self.voltage_v, self.rms_n
        );
        for (pulse_us, thrust_n, sd_n) in &self.curve {
            out += &format!(
                "  [{pulse_us:.2}, {:.3}],  # +- {sd_n:.3}\n",
                thrust_n + 0.0
            );
        }
        out + "]\n"
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{SeedableRng, rngs::StdRng};
    use rand_distr::{Distribution, StandardNormal};

    #[test]
    fn deadband_asymmetry_and_voltage_are_found_within_their_sd() {
        let truth = [1531.0, 0.06, 2.1e-4, 1467.0, 0.05, 1.5e-4, 1.7];
        let mut rng = StdRng::seed_from_u64(4);
        let mut pulls = Vec::new();
        for volts in [14.0, 15.0, 16.0] {
            for k in 0..=40 {
                let pulse_us = 1100.0 + 20.0 * f64::from(k);
                let (up, down) = (
                    (pulse_us - truth[0]).max(0.0),
                    (truth[3] - pulse_us).max(0.0),
                );
                let shape =
                    truth[1] * up + truth[2] * up * up - truth[4] * down - truth[5] * down * down;
                let noise: f64 = StandardNormal.sample(&mut rng);
                pulls.push(Pull {
                    pulse_us,
                    thrust_n: shape * (volts / 15.0_f64).powf(truth[6]) + 0.1 * noise,
                    voltage_v: Some(volts),
                });
            }
        }
        pulls[17].thrust_n += 9.0;
        let found = fit(&pulls, (1100.0, 1500.0, 1900.0)).unwrap();
        for (i, actual) in truth.iter().enumerate() {
            let sd = found.covariance[i][i].sqrt();
            assert!(
                (found.values[i] - actual).abs() < 4.0 * sd,
                "{}: {} +- {sd}, {actual}",
                found.order[i],
                found.values[i]
            );
        }
        assert!(
            (found.rms_n - 0.1).abs() < 0.03 && found.outliers >= 1,
            "{found:?}"
        );
        // Into a rig file and back, bit for bit.
        let mut rig = Rig::builtin("lshpi").unwrap();
        found.put(&mut rig).unwrap();
        let read = Rig::from_toml(&rig.to_toml(), "rig.toml", None).unwrap();
        assert_eq!(read.bollard, rig.bollard);
        assert_eq!(read.thrusters, rig.thrusters);
        let pull = read.bollard.unwrap();
        for (k, (_, _, sd)) in found.curve.iter().enumerate() {
            assert!((pull.covariance_n2[k][k].sqrt() - sd).abs() < 1e-12);
        }
        assert!(
            found
                .curve
                .windows(2)
                .all(|w| w[0].0 < w[1].0 && w[0].1 <= w[1].1),
            "{:?}",
            found.curve
        );
    }

    #[test]
    fn an_uncertain_table_is_named() {
        let rig = Rig::builtin("lshpi").unwrap();
        let curve = &rig.thrusters.thrusters[0].curve;
        let mut rng = StdRng::seed_from_u64(6);
        let mut pulls = |low: i32, high: i32, scale: f64, bump: f64| -> Vec<Pull> {
            let pull = |k: i32| {
                let noise: f64 = StandardNormal.sample(&mut rng);
                let pulse_us = 1500.0 + 10.0 * f64::from(k);
                let thrust_n =
                    curve.thrust_n(pulse_us) + bump * (f64::from(k) / 3.0).sin() + 0.1 * noise;
                Pull {
                    pulse_us,
                    thrust_n: scale * thrust_n,
                    voltage_v: None,
                }
            };
            (low..=high).map(pull).collect()
        };
        let range = (1100.0, 1500.0, 1900.0);
        let words = |pulls: &[Pull]| {
            let found = fit(pulls, range).unwrap();
            (found.notes.join("; "), found.against(&rig))
        };
        let (narrow, same) = words(&pulls(-15, 15, 1.0, 0.0));
        assert!(
            narrow.contains("extrapolated") && same.is_none(),
            "{narrow} {same:?}"
        );
        let (full, grams) = words(&pulls(-40, 40, 101.97, 0.0));
        assert!(!full.contains("extrapolated"), "{full}");
        assert!(grams.is_some_and(|w| w.contains("grams")));
        let (wavy, _) = words(&pulls(-40, 40, 1.0, 1.0));
        assert!(wavy.contains("white"), "{wavy}");
    }

    #[test]
    fn a_thruster_without_deadband_has_one_point_at_neutral() {
        let mut rng = StdRng::seed_from_u64(5);
        let pull = |k: i32| {
            let noise: f64 = StandardNormal.sample(&mut rng);
            let pulse_us = 1500.0 + 20.0 * f64::from(k);
            Pull {
                pulse_us,
                thrust_n: 0.05 * (pulse_us - 1500.0) + 0.02 * noise,
                voltage_v: None,
            }
        };
        let pulls: Vec<Pull> = (-20..=20).filter(|k| *k != 0).map(pull).collect();
        let found = fit(&pulls, (1100.0, 1500.0, 1900.0)).unwrap();
        let mut rig = Rig::builtin("lshpi").unwrap();
        found.put(&mut rig).unwrap();
        assert!(Rig::from_toml(&rig.to_toml(), "rig.toml", None).is_ok());
    }

    #[test]
    fn a_table_that_is_wrong_names_its_line() {
        assert!(
            read("pulse_us,thrust_n\n1500,0\n1600,abc\n", "b.csv")
                .unwrap_err()
                .to_string()
                .contains("line 3")
        );
        assert!(
            read("pulse,thrust\n", "b.csv")
                .unwrap_err()
                .to_string()
                .contains("pulse_us")
        );
        let few = read("thrust_n,pulse_us\n3,1600\n", "b.csv").unwrap();
        assert!(matches!(
            fit(&few, (1100.0, 1500.0, 1900.0)),
            Err(BollardError::TooFew {
                ahead: 1,
                astern: 0,
                ..
            })
        ));
    }
}
