//! Two-way clock sync with the controller, as NTP does it (RFC 5905, section 8), over a window of exchanges.
//!
//! One exchange gives four times: t1 last byte of the request out (host), t2 last byte in (controller), t3 last byte of
//! the reply out (controller), t4 last byte in (host). With host midpoint h = (t1 + t4)/2 and controller midpoint
//! c = (t2 + t3)/2, c - h is the clock difference up to half the difference of the two delays.
//!
//! Model of sample i (all in us, relative to the window's centre):
//!   c_i - h_i = offset + drift * (h_i - epoch) + beta * e_i + noise_i,   e_i = excess of rtt_i
//! e_i is the excess round trip. If all of it were on the way out the sample would be off by +e_i/2, all of it on the
//! way back -e_i/2; beta in [-1/2, 1/2] is the mean asymmetry of the jitter and is fitted with the prior N(0, 1/12)
//! (the variance of the uniform distribution on that interval). Given e_i, the split of independent exponential
//! delays is uniform, so the noise is sd e_i / sqrt(12), to which a floor for stamping and scheduling is added:
//!   sigma_i^2 = floor^2 + e_i^2 / 12.
//! The smallest round trip SEEN is not the smallest POSSIBLE. The sum of two independent delays has a density that
//! rises linearly from zero, so its k-th smallest of n lies at c sqrt(k): from r_(1) and r_(k) the fastest exchange's
//! own excess is c = (r_(k) - r_(1)) / (sqrt(k) - 1), and e_i = r_i - r_(1) + c. Without it the fastest
//! exchange would be believed to the stamping floor and the reported sd would be far too small.
//! That weighting keeps the fast exchanges and lets slow ones say almost nothing (NTP's clock filter, smoothed).
//! Outliers are tamed by Huber weights.
//!
//! No exchange can show the asymmetry of the MINIMAL round trip. Uniform over its bounds +-rtt_min/2 it adds
//! the sd rtt_min / sqrt(12); [`Estimate::offset_sd_us`] contains it, [`Estimate::offset_fit_sd_us`] does not.

mod estimate;

pub use estimate::{Estimate, Unwrap32};

use nalgebra::{Matrix3, Vector3};
use std::collections::VecDeque;

/// One exchange. Host times CLOCK_MONOTONIC \[ns\], controller times raw 32-bit \[us\].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Exchange {
    /// Last byte of the request left the host \[ns\].
    pub t1_ns: u64,
    /// Last byte of the request in the controller \[us, wraps\].
    pub t2_us: u32,
    /// Last byte of the reply out of the controller \[us, wraps\].
    pub t3_us: u32,
    /// Last byte of the reply in the host \[ns\].
    pub t4_ns: u64,
    /// Differs after every controller reset.
    pub boot_id: u16,
}

/// Outcome of adding an exchange.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Added {
    /// Taken into the window.
    Taken,
    /// The controller's clock restarted or jumped: the window was emptied first. Jump in us, NaN where only the boot id shows it.
    Reset {
        /// Measured minus expected controller time \[us\].
        jump_us: f64,
    },
    /// Impossible (reply before request, negative round trip beyond the clocks' resolution): ignored.
    Refused {
        /// Round trip minus the time in the controller \[us\].
        rtt_us: f64,
    },
}

#[derive(Debug, Clone, Copy)]
struct Sample {
    host_ns: u64,
    /// Half nanoseconds lost in the midpoint do not matter; half microseconds of the controller do.
    controller_us: f64,
    rtt_us: f64,
}

/// Rate error of a controller's clock that is still followed, as a share: twenty times a ceramic resonator's. On a short line a
/// clock that is 2 % fast makes the time in the controller longer than the whole exchange.
const RATE_ERROR_MAX: f64 = 0.1;

/// Settings of [`ClockSync`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SyncSettings {
    /// Exchanges older than this leave the window \[s\].
    pub window_s: f64,
    /// Most exchanges kept.
    pub samples: usize,
    /// Floor of a sample's sd: stamping and scheduling noise \[us\].
    pub floor_us: f64,
    /// Prior sd of the drift \[ppm\]: a ceramic resonator's, a crystal's is far inside.
    pub drift_prior_ppm: f64,
    /// A jump larger than this against the prediction is a reset \[us\].
    pub reset_us: f64,
}

impl Default for SyncSettings {
    fn default() -> Self {
        Self {
            window_s: 60.0,
            samples: 256,
            floor_us: 10.0,
            drift_prior_ppm: 5000.0,
            reset_us: 500_000.0,
        }
    }
}

/// The estimator: exchanges in, [`Estimate`] out.
#[derive(Debug)]
pub struct ClockSync {
    settings: SyncSettings,
    window: VecDeque<Sample>,
    unwrap: Unwrap32,
    boot_id: Option<u16>,
    generation: u32,
    estimate: Option<Estimate>,
}

impl ClockSync {
    /// Estimator without exchanges.
    pub fn new(settings: SyncSettings) -> Self {
        Self {
            settings,
            window: VecDeque::new(),
            unwrap: Unwrap32::default(),
            boot_id: None,
            generation: 0,
            estimate: None,
        }
    }

    /// Takes one exchange.
    pub fn add(&mut self, x: Exchange) -> Added {
        let held_us = f64::from(x.t3_us.wrapping_sub(x.t2_us));
        let rtt_us = (x.t4_ns as f64 - x.t1_ns as f64) * 1e-3 - held_us;
        // -2 us: both clocks' resolution; and the time in the controller is by a clock whose rate is not known yet. A held time of
        // half the wrap is t3 before t2.
        let least_us = -2.0 - RATE_ERROR_MAX * held_us;
        if x.t4_ns < x.t1_ns || rtt_us < least_us || held_us > (1u64 << 31) as f64 {
            return Added::Refused { rtt_us };
        }
        let host_ns = x.t1_ns + (x.t4_ns - x.t1_ns) / 2;
        let mut outcome = Added::Taken;
        if self.boot_id.is_some_and(|id| id != x.boot_id) {
            self.restart();
            outcome = Added::Reset { jump_us: f64::NAN };
        }
        self.boot_id = Some(x.boot_id);
        let mut t2_us = self.unwrap(x.t2_us, host_ns);
        if let Some(e) = self.estimate {
            let jump_us = t2_us as f64 + held_us / 2.0 - e.controller_at_us(host_ns);
            let allowed_us = self.settings.reset_us + 5.0 * e.sd_at_us(host_ns) + rtt_us.abs();
            if jump_us.abs() > allowed_us {
                self.restart();
                t2_us = self.unwrap(x.t2_us, host_ns);
                outcome = Added::Reset { jump_us };
            }
        }
        let controller_us = t2_us as f64 + held_us / 2.0;
        self.window.push_back(Sample {
            host_ns,
            controller_us,
            rtt_us: rtt_us.max(0.0),
        });
        let oldest_ns = host_ns.saturating_sub((self.settings.window_s * 1e9) as u64);
        while self.window.len() > self.settings.samples.max(1)
            || self.window.front().is_some_and(|s| s.host_ns < oldest_ns)
        {
            self.window.pop_front();
        }
        self.estimate = self.fit();
        outcome
    }

    /// The newest estimate.
    pub fn estimate(&self) -> Option<Estimate> {
        self.estimate
    }

    /// A controller stamp made 64 bits wide, near what the clock should read at `host_ns`.
    pub fn unwrap(&mut self, raw_us: u32, host_ns: u64) -> u64 {
        match &self.estimate {
            Some(e) => self
                .unwrap
                .unwrap_near_us(raw_us, e.controller_at_us(host_ns).max(0.0) as u64),
            None => self.unwrap.unwrap_us(raw_us),
        }
    }

    /// Forgets everything about the controller's clock: it was reset.
    pub fn restart(&mut self) {
        self.window.clear();
        self.unwrap = Unwrap32::default();
        self.boot_id = None;
        self.estimate = None;
        self.generation += 1;
    }

    fn fit(&self) -> Option<Estimate> {
        let newest = self.window.back()?;
        let n = self.window.len();
        let mut rtt: Vec<f64> = self.window.iter().map(|s| s.rtt_us).collect();
        rtt.sort_by(f64::total_cmp);
        let quantile = |q: f64| rtt[((n - 1) as f64 * q).round() as usize];
        let rtt_min = rtt[0];
        // Excess of the fastest exchange (module head). Fewer than four say nothing; k as large as linearity allows.
        let k = (n / 6).clamp(4, 16);
        let hidden = if n >= 4 {
            (rtt[k - 1] - rtt_min) / ((k as f64).sqrt() - 1.0)
        } else {
            rtt_min / 2.0
        };

        // Centred on the newest sample: conversions are asked for now, not for the window's middle.
        let (h0, c0) = (newest.host_ns, newest.controller_us);
        let rows: Vec<(f64, f64, f64, f64)> = self
            .window
            .iter()
            .map(|s| {
                let t_us = -((h0 - s.host_ns.min(h0)) as f64) * 1e-3;
                let e = s.rtt_us - rtt_min + hidden;
                let variance = self.settings.floor_us.powi(2) + e * e / 12.0;
                (
                    t_us * 1e-6,
                    e,
                    (s.controller_us - c0) - t_us,
                    1.0 / variance,
                )
            })
            .collect();
        // Unknowns: offset [us], drift [ppm = us/s], beta [-]. Priors keep one or two samples solvable.
        let prior = Matrix3::from_diagonal(&Vector3::new(
            0.0,
            self.settings.drift_prior_ppm.powi(-2),
            12.0,
        ));
        let mut huber = vec![1.0; n];
        let mut solution = Vector3::zeros();
        let mut covariance = Matrix3::zeros();
        for _ in 0..4 {
            let (mut normal, mut right) = (prior, Vector3::zeros());
            for (&(t, e, y, w), h) in rows.iter().zip(&huber) {
                let a = Vector3::new(1.0, t, e);
                normal += a * a.transpose() * (w * h);
                right += a * (y * w * h);
            }
            let inverse = normal.cholesky()?.inverse();
            solution = inverse * right;
            let mut chi2 = 0.0;
            for (&(t, e, y, w), h) in rows.iter().zip(huber.iter_mut()) {
                let z = (y - solution[0] - solution[1] * t - solution[2] * e).abs() * w.sqrt();
                *h = if z > 2.0 { 2.0 / z } else { 1.0 };
                chi2 += z.min(2.0) * z;
            }
            // Residuals larger than the model's widen the sd; smaller ones do not narrow it below the floor.
            let scale = if n > 3 {
                (chi2 / (n - 3) as f64).max(1.0)
            } else {
                1.0
            };
            covariance = inverse * scale;
        }
        // beta is learnt from slow exchanges; below the fastest one seen the slope is its own, with beta's prior.
        let fit_variance = covariance[(0, 0)] + hidden * hidden / 12.0;
        Some(Estimate {
            host_epoch_ns: h0,
            controller_us: c0 + solution[0],
            offset_sd_us: (fit_variance + rtt_min * rtt_min / 12.0).sqrt(),
            offset_fit_sd_us: fit_variance.sqrt(),
            drift_ppm: solution[1],
            drift_sd_ppm: covariance[(1, 1)].sqrt(),
            covariance_us_ppm: covariance[(0, 1)],
            round_trip_min_us: rtt_min,
            round_trip_us: quantile(0.5),
            round_trip_spread_us: quantile(0.95) - rtt_min,
            samples: n as u32,
            generation: self.generation,
        })
    }
}

#[cfg(test)]
mod tests;
