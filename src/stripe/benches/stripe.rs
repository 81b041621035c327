//! Time per 720 x 576 frame on one core: `cargo bench -p hydroline-stripe --bench stripe`.
//! Asked (issue 2, must show 4): <= 0.3 ms on an unknown frame.

use divan::{Bencher, black_box};
use hydroline_core::frame::GreyImage;
use hydroline_stripe::{Extractor, ExtractorConfig};
use synthetic::{StripeImage, render};

#[path = "../tests/synthetic/mod.rs"]
mod synthetic;

fn main() {
    divan::main();
}

/// Frames by name: what the extractor meets in a tank, and what is worse.
const FRAMES: [&str; 5] = ["clear", "tilted", "hazy", "noisy", "clipped"];

fn frame(name: &str) -> GreyImage {
    let plain = StripeImage {
        noise_sd: 2.0,
        peak: 180.0,
        slope: 0.02,
        ..Default::default()
    };
    render(&match name {
        "tilted" => StripeImage {
            slope: 0.36,
            row0_px: 150.0,
            ..plain
        },
        "hazy" => StripeImage {
            haze_fraction: 0.05,
            ..plain
        },
        "noisy" => StripeImage {
            noise_sd: 4.0,
            peak: 60.0,
            ..plain
        },
        "clipped" => StripeImage {
            peak: 765.0,
            ..plain
        },
        _ => plain,
    })
}

#[divan::bench(args = FRAMES)]
fn unknown_frame(bencher: Bencher, name: &str) {
    let image = frame(name);
    let mut extractor = Extractor::new(ExtractorConfig::default());
    bencher.bench_local(|| extractor.extract(black_box(&image)));
}
