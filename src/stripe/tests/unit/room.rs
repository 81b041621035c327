//! Stripes in real rooms: the table of what comes out, and a small fixed share of it as a test.
//!
//! The whole table: `cargo test -p hydroline-stripe --lib room -- --ignored --nocapture`.

mod kinds;
mod scene;

use crate::{Extractor, ExtractorConfig, Profile, quality};
use kinds::Kind;
use scene::Scene;

/// A point farther from the truth than this is elsewhere \[px\].
const ELSEWHERE_PX: f64 = 3.0;

/// Results of the frames of one kind.
#[derive(Debug, Default, Clone)]
struct Tally {
    columns: f64,
    within_1px: f64,
    elsewhere: f64,
    frames: f64,
    frames_astray: f64,
    count: f64,
    square: f64,
    over_sd: f64,
    beyond_4_sd: f64,
    /// Largest mean error of one frame \[px\], and the mean of the squares of those means.
    worst_bias: f64,
    bias_square: f64,
    clipped: f64,
    clipped_flagged: f64,
    whole: f64,
    whole_flagged: f64,
    hazed: f64,
}

impl Tally {
    fn add(&mut self, scene: &Scene, profile: &Profile, clipped: &[bool]) {
        self.frames += 1.0;
        self.columns += scene.width_px as f64;
        self.hazed += f64::from(profile.haze_level > 0.0);
        let (mut sum, mut near, mut astray) = (0.0, 0.0, 0.0);
        for p in &profile.points {
            let error = p.row_px - scene.row_px(p.column_px);
            if error.abs() > ELSEWHERE_PX {
                astray += 1.0;
                continue;
            }
            let column = p.column_px as usize;
            let saturated = p.quality & quality::SATURATED != 0;
            if clipped[column] {
                self.clipped += 1.0;
                self.clipped_flagged += f64::from(saturated);
            } else {
                self.whole += 1.0;
                self.whole_flagged += f64::from(saturated);
            }
            self.within_1px += f64::from(error.abs() <= 1.0);
            if p.quality & (quality::NEAR_STEP | quality::RIVAL) == 0 {
                near += 1.0;
                sum += error;
                self.count += 1.0;
                self.square += error * error;
                self.over_sd += (error / p.sd_px).powi(2);
                self.beyond_4_sd += f64::from(error.abs() > 4.0 * p.sd_px);
            }
        }
        self.elsewhere += astray;
        self.frames_astray += f64::from(astray > 7.0);
        if near > 100.0 {
            let bias = sum / near;
            self.worst_bias = self.worst_bias.max(bias.abs());
            self.bias_square += bias * bias;
        }
    }

    fn found(&self) -> f64 {
        self.within_1px / self.columns
    }

    fn rms(&self) -> f64 {
        (self.square / self.count.max(1.0)).sqrt()
    }

    fn honesty(&self) -> f64 {
        (self.over_sd / self.count.max(1.0)).sqrt()
    }

    fn flagged(&self) -> f64 {
        if self.clipped == 0.0 {
            f64::NAN
        } else {
            self.clipped_flagged / self.clipped
        }
    }

    fn print(&self, kind: Kind) {
        println!(
            "{:16} {:7.4} {:8.4} {:4}/{:<4} {:8.4} {:6.2} {:6.2} {:8.4} {:8.4} {:7.4} {:7.4} {:5}",
            format!("{kind:?}"),
            self.found(),
            self.elsewhere / self.columns,
            self.frames_astray,
            self.frames,
            self.rms(),
            self.honesty(),
            100.0 * self.beyond_4_sd / self.count.max(1.0),
            (self.bias_square / self.frames).sqrt(),
            self.worst_bias,
            self.flagged(),
            self.whole_flagged / self.whole.max(1.0),
            self.hazed,
        );
    }
}

fn measure(kind: Kind, seeds: std::ops::Range<u64>) -> Tally {
    let mut extractor = Extractor::new(ExtractorConfig::default());
    let mut tally = Tally::default();
    let verbose = std::env::var("ROOM_VERBOSE").is_ok();
    for seed in seeds {
        let scene = kind.scene(seed);
        let (image, clipped) = scene.render();
        let profile = extractor.extract(&image);
        let mut one = Tally::default();
        one.add(&scene, &profile, &clipped);
        if verbose {
            one.print(kind);
            println!(
                "    seed {seed} {scene:?} -> noise {:.2} haze {:.4} {:?}",
                profile.noise_sd, profile.haze_level, profile.fault
            );
        }
        tally.add(&scene, &profile, &clipped);
    }
    tally
}

#[test]
#[ignore = "the whole table"]
fn whole_table() {
    let frames = std::env::var("ROOM_FRAMES")
        .ok()
        .and_then(|n| n.parse().ok())
        .unwrap_or(16);
    let only = std::env::var("ROOM_KIND").unwrap_or_default();
    println!(
        "{:16} {:>7} {:>8} {:>9} {:>8} {:>6} {:>6} {:>8} {:>8} {:>7} {:>7} {:>5}",
        "",
        "found",
        "elsewh.",
        "astray",
        "rms px",
        "err/sd",
        "%>4sd",
        "bias",
        "worst",
        "flagged",
        "false",
        "hazed"
    );
    for kind in Kind::ALL {
        if format!("{kind:?}").contains(&only) {
            measure(kind, 0..frames).print(kind);
        }
    }
}

/// Frames of each kind in the everyday tests; seeds apart from those of the printed table.
const EVERYDAY: std::ops::Range<u64> = 500..502;

#[test]
fn lamps_bars_windows_and_reflections_do_not_hide_the_stripe() {
    for kind in [
        Kind::BarThin,
        Kind::BarWide,
        Kind::BarSoft,
        Kind::Bars,
        Kind::Lamp,
        Kind::WindowHard,
        Kind::WindowSoft,
        Kind::ReflectionShort,
        Kind::ReflectionDim,
        Kind::JpegBar,
        Kind::Everything,
    ] {
        let tally = measure(kind, EVERYDAY);
        assert!(tally.found() > 0.97, "{kind:?}: found {}", tally.found());
        let elsewhere = tally.elsewhere / tally.columns;
        assert!(elsewhere < 0.005, "{kind:?}: {elsewhere} elsewhere");
    }
}

#[test]
fn clipping_at_any_ceiling_is_flagged() {
    for kind in [Kind::Ceiling, Kind::Ceiling235, Kind::Ceiling240] {
        let tally = measure(kind, EVERYDAY);
        assert!(tally.clipped > 1000.0, "{kind:?}: nothing is clipped");
        let flagged = tally.flagged();
        assert!(flagged >= 0.99, "{kind:?}: {flagged} flagged");
        let honesty = tally.honesty();
        assert!((0.9..1.1).contains(&honesty), "{kind:?}: {honesty}");
    }
    let clean = measure(Kind::Clean, EVERYDAY);
    assert_eq!(clean.whole_flagged, 0.0);
}

#[test]
fn banding_neither_shifts_the_rows_nor_passes_for_haze() {
    for kind in [Kind::BandingFlat, Kind::BandingTilted, Kind::BandingFine] {
        let tally = measure(kind, EVERYDAY);
        assert!(tally.worst_bias <= 0.03, "{kind:?}: {}", tally.worst_bias);
        assert_eq!(tally.hazed, 0.0, "{kind:?}");
        let honesty = tally.honesty();
        assert!((0.9..1.1).contains(&honesty), "{kind:?}: {honesty}");
    }
}

#[test]
fn sds_hold_through_jpeg() {
    let kinds = [Kind::Jpeg90, Kind::Jpeg75, Kind::Jpeg60];
    let tallies = kinds.map(|kind| measure(kind, EVERYDAY.start..EVERYDAY.start + 4));
    let sum = |f: fn(&Tally) -> f64| tallies.iter().map(f).sum::<f64>();
    // Frames differ by 0.2: all twelve together.
    let honesty = (sum(|t| t.over_sd) / sum(|t| t.count)).sqrt();
    assert!((0.85..1.15).contains(&honesty), "{honesty}");
}
