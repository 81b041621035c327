//! The state of focus, exposure and laser at a glance: what `aim` shows and `record` has in its status line.
//!
//! A core without I/O: frames and profiles in, one [`AimView`] per window out.

use hydroline_core::event::kind;
use hydroline_core::frame::FrameFault;
use hydroline_log::messages::pb::StripeProfile;
use serde::Serialize;
use std::collections::VecDeque;

/// Without a frame for so long the camera stands still \[s\].
const SILENT_S: f64 = 1.0;
/// Bit of `StripeProfile.quality`: the point's columns were saturated.
const SATURATED: u32 = 1;

/// One window's summary.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct AimView {
    /// Frames per second over the window \[1/s\].
    pub rate_fps: f64,
    /// Frames per second that the rig asks for \[1/s\]; 0 = not known.
    pub wanted_fps: f64,
    /// Frames per second over the last windows, long enough to judge by \[1/s\]; `None` = not yet.
    pub steady_fps: Option<f64>,
    /// Time without any frame up to now, in whole windows \[s\].
    pub silent_s: f64,
    /// Fault of the newest frame, in words, if it is faulty.
    pub newest_fault: Option<&'static str>,
    /// Frames lost since the start (sequence and time gaps).
    pub lost: u64,
    /// Frames marked faulty since the start.
    pub faulty: u64,
    /// Median peak over background of the newest stripe \[grey levels\].
    pub peak: Option<f64>,
    /// Median width (standard deviation) of the newest stripe \[px\].
    pub sigma_px: Option<f64>,
    /// Share of saturated points, 0..1.
    pub saturated: f64,
    /// Columns in which a point was found, of all columns.
    pub columns: (usize, u32),
    /// Noise of the image \[grey levels\].
    pub noise_sd: f64,
    /// Share of the stripe that lies on the target, and that would with the vehicle at the rig's start; `None` = not known.
    pub on_target: Option<(f64, f64)>,
    /// Minutes of recording the disk still takes; `None` = not asked.
    pub disk_min: Option<f64>,
}

/// Gathers frames until asked for a [`AimView`].
#[derive(Debug, Default)]
pub struct Gatherer {
    frames: u64,
    lost: u64,
    faulty: u64,
    newest: Option<StripeProfile>,
    on_target: Option<(f64, f64)>,
    newest_fault: Option<FrameFault>,
    wanted_fps: f64,
    silent_s: f64,
    /// Frames and length \[s\] of the last windows.
    windows: VecDeque<(u64, f64)>,
}

/// A rate is judged over this time at least \[s\] ...
const STEADY_S: f64 = 2.0;
/// ... and over this many of the rig's frames: one frame more or less is then 4 %.
const STEADY_FRAMES: f64 = 25.0;
/// Below this share of the rig's rate something is wrong: exposure too long, USB too narrow, another mode.
pub(super) const SLOW: f64 = 0.9;
/// A stripe in fewer of all columns is narrow.
pub(super) const WIDE: f64 = 0.5;
/// More of the stripe saturated is too bright.
pub(super) const SATURATED_MAX: f64 = 0.05;
/// A weaker line is too dark \[grey levels\].
pub(super) const PEAK_MIN: f64 = 60.0;
/// A wider line (standard deviation) is out of focus \[px\].
pub(super) const SIGMA_MAX_PX: f64 = 3.5;

impl Gatherer {
    /// For a camera that is to deliver `wanted_fps` frames per second.
    pub fn new(wanted_fps: f64) -> Self {
        Self {
            wanted_fps,
            ..Self::default()
        }
    }

    /// Takes a window into the mean rate; `None` while it is too short to judge by.
    fn steady_fps(&mut self, window_s: f64) -> Option<f64> {
        self.windows.push_back((self.frames, window_s));
        let sums = |w: &VecDeque<(u64, f64)>| {
            w.iter().fold((0, 0.0), |(n, s), (frames, length_s)| {
                (n + frames, s + length_s)
            })
        };
        let needed_s = if self.wanted_fps > 0.0 {
            STEADY_S.max(STEADY_FRAMES / self.wanted_fps)
        } else {
            STEADY_S
        };
        while let Some((_, first_s)) = self.windows.front()
            && sums(&self.windows).1 - first_s >= needed_s
        {
            self.windows.pop_front();
        }
        let (frames, length_s) = sums(&self.windows);
        (length_s >= needed_s).then(|| frames as f64 / length_s)
    }

    /// Counts a frame.
    pub fn frame(&mut self, meta: &hydroline_core::frame::FrameMeta) {
        self.frames += 1;
        self.lost +=
            u64::from(meta.lost_before.sequence_gap) + u64::from(meta.lost_before.time_gap);
        self.faulty += u64::from(meta.fault.is_some());
        self.newest_fault = meta.fault;
    }

    /// Losses that were marked on an earlier frame may turn out to be none.
    pub fn event(&mut self, event: &hydroline_core::event::Event) {
        if *event.kind == kind::CAMERA_GAP_RETRACTED {
            let frames = event.values.iter().find(|v| v.0 == "frames");
            self.lost = self.lost.saturating_sub(frames.map_or(0, |v| v.1 as u64));
        }
    }

    /// Keeps the newest profile.
    pub fn profile(&mut self, profile: StripeProfile) {
        self.newest = Some(profile);
    }

    /// Keeps how much of it lies on the target, and how much should.
    pub fn on_target(&mut self, shares: Option<(f64, f64)>) {
        self.on_target = shares;
    }

    /// Summarises the window of `window_s` seconds that ends now and starts the next one.
    pub fn view(&mut self, window_s: f64, disk_min: Option<f64>) -> AimView {
        let rate_fps = if window_s > 0.0 {
            self.frames as f64 / window_s
        } else {
            0.0
        };
        self.silent_s = if self.frames == 0 {
            self.silent_s + window_s
        } else {
            0.0
        };
        let steady_fps = self.steady_fps(window_s);
        self.frames = 0;
        let profile = self.newest.as_ref();
        let points = profile.map_or(0, |p| p.row_px.len());
        let saturated = profile.map_or(0, |p| {
            p.quality.iter().filter(|q| **q & SATURATED != 0).count()
        });
        AimView {
            rate_fps,
            wanted_fps: self.wanted_fps,
            steady_fps,
            silent_s: self.silent_s,
            newest_fault: self.newest_fault.map(words),
            lost: self.lost,
            faulty: self.faulty,
            peak: profile.and_then(|p| median(&p.peak)),
            sigma_px: profile.and_then(|p| median(&p.sigma_px)),
            saturated: if points == 0 {
                0.0
            } else {
                saturated as f64 / points as f64
            },
            columns: (points, profile.map_or(0, |p| p.width_px)),
            noise_sd: profile.map_or(0.0, |p| p.noise_sd),
            on_target: self.on_target,
            disk_min,
        }
    }
}

fn words(fault: FrameFault) -> &'static str {
    match fault {
        FrameFault::DriverError => "the driver reports an error",
        FrameFault::Truncated => "too few bytes",
        FrameFault::BrokenJpeg => "broken JPEG",
        FrameFault::Stale => "stale, or the same picture again",
    }
}

fn median(values: &[f32]) -> Option<f64> {
    let mut sorted: Vec<f32> = values.iter().copied().filter(|v| v.is_finite()).collect();
    sorted.sort_by(f32::total_cmp);
    sorted.get(sorted.len() / 2).map(|v| f64::from(*v))
}

impl AimView {
    /// No frame for longer than a camera pauses.
    pub(super) fn stands_still(&self) -> bool {
        self.silent_s >= SILENT_S.max(3.0 / self.wanted_fps.max(0.1))
    }

    /// Changes to make, in the words of someone standing at the tank; empty when all is well.
    pub fn advice(&self) -> Vec<String> {
        let mut advice = Vec::new();
        // Without fresh pixels nothing can be said of laser and lens.
        if self.stands_still() {
            advice.push(format!(
                "no frame for {:.0} s: is the cable in, and does the camera stream? `hydroline check` says more",
                self.silent_s
            ));
            return advice;
        }
        if let Some(rate) = self.steady_fps
            && rate < SLOW * self.wanted_fps
        {
            advice.push(format!(
                "{rate:.1} frames/s, the rig asks for {:.1}: shorten the exposure, or is the USB line shared or too slow?",
                self.wanted_fps
            ));
        }
        if let Some(fault) = &self.newest_fault {
            advice.push(format!(
                "the newest frame is faulty ({fault}): check cable, hub and power; {} faulty so far",
                self.faulty
            ));
            return advice;
        }
        let (found, all) = self.columns;
        if found == 0 {
            advice.push("no stripe: is the laser on, in view, and the lens cap off?".to_owned());
            return advice;
        }
        if (found as f64) < WIDE * f64::from(all) {
            advice.push(format!(
                "stripe in only {found} of {all} columns: aim the laser's fan at the image's middle"
            ));
        }
        if self.saturated > SATURATED_MAX {
            advice.push(format!(
                "{:.0} % saturated: shorten the exposure or lower the gain",
                100.0 * self.saturated
            ));
        }
        match (self.peak, self.sigma_px) {
            (Some(peak), _) if peak < PEAK_MIN => {
                advice.push(format!(
                    "peak {peak:.0} of 255 is weak: lengthen the exposure or darken the hall"
                ));
            }
            (_, Some(sigma)) if sigma > SIGMA_MAX_PX => {
                advice.push(format!(
                    "stripe {sigma:.1} px wide (sd): focus the lens, then the laser"
                ));
            }
            _ => {}
        }
        if self.lost > 0 {
            advice.push(format!(
                "{} frames lost so far: see `hydroline check`",
                self.lost
            ));
        }
        advice
    }
}

impl std::fmt::Display for AimView {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let number = |v: Option<f64>, digits: usize| {
            v.map_or_else(|| "-".to_owned(), |v| format!("{v:.digits$}"))
        };
        write!(
            f,
            "{:5.1} fps | columns {:3}/{} | peak {:>3} | width {:>4} px sd | saturated {:3.0} % | noise {:.1} | lost {} | faulty {}",
            self.rate_fps,
            self.columns.0,
            self.columns.1,
            number(self.peak, 0),
            number(self.sigma_px, 2),
            100.0 * self.saturated,
            self.noise_sd,
            self.lost,
            self.faulty,
        )?;
        match self.disk_min {
            Some(minutes) => write!(f, " | disk {minutes:.0} min"),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hydroline_core::frame::{FrameMeta, LossBefore, StampClock, StampSource};

    fn profile(n: usize, peak: f32, saturated: usize) -> StripeProfile {
        StripeProfile {
            width_px: 720,
            row_px: vec![288.0; n],
            peak: vec![peak; n],
            sigma_px: vec![2.0; n],
            quality: (0..n).map(|i| u32::from(i < saturated)).collect(),
            noise_sd: 2.0,
            ..StripeProfile::default()
        }
    }

    fn meta(fault: Option<FrameFault>) -> FrameMeta {
        FrameMeta {
            sequence: 1,
            driver_stamp_ns: 0,
            stamp_clock: StampClock::Monotonic,
            stamp_source: StampSource::EndOfFrame,
            flags: 0,
            received_monotonic_ns: 0,
            mid_exposure_ns: 0,
            exposure_s: 0.0,
            fault,
            lost_before: LossBefore::default(),
        }
    }

    /// Advice after `windows` half seconds of `frames` each at a good stripe.
    fn after(frames: u64, windows: usize, fault: Option<FrameFault>) -> Vec<String> {
        let mut gatherer = Gatherer::new(25.0);
        gatherer.profile(profile(700, 180.0, 0));
        gatherer.frame(&meta(fault));
        let mut advice = Vec::new();
        for _ in 0..windows {
            for _ in 0..frames {
                gatherer.frame(&meta(fault));
            }
            advice = gatherer.view(0.5, None).advice();
        }
        advice
    }

    #[test]
    fn a_camera_that_stands_still_is_no_good_stripe() {
        // The first window has a frame, two more have none: 1 s.
        assert_eq!(after(0, 2, None), Vec::<String>::new());
        let advice = after(0, 3, None);
        assert!(
            advice[0].contains("no frame for 1 s") && advice.len() == 1,
            "{advice:?}"
        );
    }

    #[test]
    fn a_camera_that_is_too_slow_is_named_with_both_rates() {
        let advice = after(10, 8, None);
        assert!(
            advice[0].contains("20.0 frames/s") && advice[0].contains("25.0"),
            "{advice:?}"
        );
        // Twelve or thirteen frames in half a second are 25 a second.
        assert_eq!(after(12, 8, None), Vec::<String>::new());
    }

    #[test]
    fn a_faulty_frame_is_not_called_a_missing_laser() {
        let advice = after(12, 1, Some(FrameFault::Truncated));
        assert!(
            advice[0].contains("faulty (too few bytes)") && advice.len() == 1,
            "{advice:?}"
        );
    }

    #[test]
    fn a_good_stripe_needs_no_advice() {
        let mut gatherer = Gatherer::default();
        gatherer.frame(&meta(None));
        gatherer.profile(profile(700, 180.0, 0));
        let view = gatherer.view(0.5, Some(42.0));
        assert_eq!(view.advice(), Vec::<String>::new());
        assert!(view.to_string().contains("700/720") && view.to_string().contains("disk 42 min"));
    }

    #[test]
    fn each_trouble_is_named_with_its_cure() {
        let mut gatherer = Gatherer::default();
        gatherer.frame(&meta(None));
        assert!(gatherer.view(0.5, None).advice()[0].contains("no stripe"));
        gatherer.frame(&meta(None));
        gatherer.profile(profile(700, 240.0, 350));
        assert!(gatherer.view(0.5, None).advice()[0].contains("50 % saturated"));
        gatherer.frame(&meta(None));
        gatherer.profile(profile(100, 30.0, 0));
        let advice = gatherer.view(0.5, None).advice();
        assert!(
            advice[0].contains("100 of 720") && advice[1].contains("weak"),
            "{advice:?}"
        );
    }
}
