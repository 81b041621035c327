//! Result of the fit, and 32-bit times made 64 bits wide.

use crate::record::ControllerClock;

/// State of the controller's clock by the fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// CLOCK_MONOTONIC the fit is centred on \[ns\].
    pub host_epoch_ns: u64,
    /// Controller clock (unwrapped) at that moment \[us\].
    pub controller_us: f64,
    /// Standard deviation of `controller_us`, unobservable path asymmetry included \[us\].
    pub offset_sd_us: f64,
    /// The part of it that comes from the fit alone \[us\].
    pub offset_fit_sd_us: f64,
    /// Controller fast against host \[ppm\].
    pub drift_ppm: f64,
    /// Its standard deviation \[ppm\].
    pub drift_sd_ppm: f64,
    /// Covariance of `controller_us` and drift \[us ppm\].
    pub covariance_us_ppm: f64,
    /// Smallest round trip in the window, time in the controller taken off \[us\].
    pub round_trip_min_us: f64,
    /// Median round trip \[us\].
    pub round_trip_us: f64,
    /// 95th percentile minus minimum \[us\].
    pub round_trip_spread_us: f64,
    /// Exchanges in the window.
    pub samples: u32,
    /// Counts controller resets; controller times of different generations do not compare.
    pub generation: u32,
}

impl Estimate {
    /// Controller clock (unwrapped) at a host time \[us\].
    pub fn controller_at_us(&self, host_ns: u64) -> f64 {
        self.controller_us + self.since_epoch_us(host_ns) * (1.0 + self.drift_ppm * 1e-6)
    }

    /// Host time \[ns\] at a reading of the controller's clock (unwrapped, \[us\]).
    pub fn host_at_ns(&self, controller_us: f64) -> u64 {
        let since_us = (controller_us - self.controller_us) / (1.0 + self.drift_ppm * 1e-6);
        self.host_epoch_ns
            .saturating_add_signed((since_us * 1e3).round() as i64)
    }

    /// Standard deviation of either conversion at a host time \[us\]; grows away from the epoch with the drift's.
    pub fn sd_at_us(&self, host_ns: u64) -> f64 {
        let t = self.since_epoch_us(host_ns) * 1e-6;
        let variance = self.offset_sd_us.powi(2)
            + 2.0 * t * self.covariance_us_ppm
            + (t * self.drift_sd_ppm).powi(2);
        variance.max(0.0).sqrt()
    }

    /// The log's message.
    pub fn record(&self) -> ControllerClock {
        ControllerClock {
            offset_us: self.controller_us,
            offset_sd_us: self.offset_sd_us,
            drift_ppm: self.drift_ppm,
            drift_sd_ppm: self.drift_sd_ppm,
            round_trip_us: self.round_trip_us,
            round_trip_spread_us: self.round_trip_spread_us,
            samples: self.samples,
            host_epoch_ns: self.host_epoch_ns,
            controller_epoch_us: self.controller_us.max(0.0).round() as u64,
        }
    }

    fn since_epoch_us(&self, host_ns: u64) -> f64 {
        (i128::from(host_ns) - i128::from(self.host_epoch_ns)) as f64 * 1e-3
    }
}

/// A controller time of 32 bits made 64 bits wide, by the nearest to the last one (late stamps may step back).
#[derive(Debug, Clone, Copy, Default)]
pub struct Unwrap32 {
    last: Option<u64>,
}

impl Unwrap32 {
    /// The unwrapped time; right as long as consecutive stamps are less than 2^31 us = 35.8 min apart.
    pub fn unwrap_us(&mut self, raw_us: u32) -> u64 {
        let full = match self.last {
            // One wrap in reserve, so that a stamp older than the first one does not go below zero.
            None => (1 << 32) + u64::from(raw_us),
            Some(last) => nearest(last, raw_us),
        };
        self.last = Some(full);
        full
    }

    /// The same by an expected time instead of the last stamp: right over gaps of any length.
    pub fn unwrap_near_us(&mut self, raw_us: u32, expected_us: u64) -> u64 {
        let full = nearest(expected_us, raw_us);
        self.last = Some(full);
        full
    }
}

fn nearest(reference: u64, raw: u32) -> u64 {
    reference.saturating_add_signed(i64::from(raw.wrapping_sub(reference as u32) as i32))
}
