//! Our extractor beside OpenCV on the same frames, one core each:
//! `cargo bench -p hydroline-stripe --bench stripe_vs_opencv`. Python is `$HYDROLINE_PYTHON` or `python3`, with
//! `opencv-python-headless` and `numpy` (`python3 -m venv V && V/bin/pip install
//! opencv-python-headless numpy`, then `HYDROLINE_PYTHON=V/bin/python`); without them ours alone.

use hydroline_core::frame::GreyImage;
use hydroline_stripe::{Extractor, ExtractorConfig, Profile};
use serde::Deserialize;
use std::error::Error;
use std::path::Path;
use std::time::Instant;
use synthetic::{StripeImage, render, row_bound_px};

#[path = "../tests/synthetic/mod.rs"]
mod synthetic;

const REPEATS: usize = 300;

#[derive(Deserialize)]
struct Theirs {
    opencv: String,
    numpy: String,
    results: Vec<Row>,
}

/// One line of the table.
#[derive(Deserialize)]
struct Row {
    frame: String,
    method: String,
    best_ms: f64,
    median_ms: f64,
    rms_px: f64,
    bias_px: f64,
    columns: usize,
}

fn frames() -> Vec<(&'static str, StripeImage)> {
    let plain = StripeImage {
        noise_sd: 2.0,
        slope: 0.02,
        ..Default::default()
    };
    vec![
        ("clear", plain.clone()),
        (
            "tilted",
            StripeImage {
                slope: 0.3,
                row0_px: 150.0,
                seed: 1,
                ..plain.clone()
            },
        ),
        (
            "dim",
            StripeImage {
                peak: 60.0,
                noise_sd: 4.0,
                seed: 2,
                ..plain.clone()
            },
        ),
        (
            "narrow",
            StripeImage {
                sigma_px: 1.0,
                seed: 3,
                ..plain.clone()
            },
        ),
        (
            "wide",
            StripeImage {
                sigma_px: 3.0,
                seed: 4,
                ..plain.clone()
            },
        ),
        (
            "hazy 5 %",
            StripeImage {
                haze_fraction: 0.05,
                seed: 5,
                ..plain.clone()
            },
        ),
        (
            "clipped 3 x",
            StripeImage {
                peak: 765.0,
                seed: 6,
                ..plain
            },
        ),
    ]
}

fn measure(name: &str, method: &str, truth: &StripeImage, mut run: impl FnMut() -> Profile) -> Row {
    let mut times: Vec<f64> = (0..REPEATS)
        .map(|_| {
            let start = Instant::now();
            std::hint::black_box(run());
            start.elapsed().as_secs_f64() * 1e3
        })
        .collect();
    times.sort_by(f64::total_cmp);
    let profile = run();
    let errors: Vec<f64> = profile
        .points
        .iter()
        .map(|p| p.row_px - truth.row_px(p.column_px))
        .collect();
    let count = errors.len().max(1) as f64;
    Row {
        frame: name.to_owned(),
        method: method.to_owned(),
        best_ms: times[0],
        median_ms: times[REPEATS / 2],
        rms_px: (errors.iter().map(|e| e * e).sum::<f64>() / count).sqrt(),
        bias_px: errors.iter().sum::<f64>() / count,
        columns: errors.len(),
    }
}

fn ours(name: &str, stripe: &StripeImage, image: &GreyImage) -> Vec<Row> {
    let mut extractor = Extractor::new(ExtractorConfig::default());
    vec![measure(name, "ours, unknown frame", stripe, || {
        extractor.extract(image)
    })]
}

fn theirs(
    folder: &Path,
    frames: &[(&str, StripeImage)],
    images: &[GreyImage],
) -> Result<Theirs, Box<dyn Error>> {
    let mut index = Vec::new();
    for (i, ((name, s), image)) in frames.iter().zip(images).enumerate() {
        let file = format!("{i}.raw");
        std::fs::write(folder.join(&file), &image.pixels)?;
        index.push(serde_json::json!({
            "name": name, "file": file, "width_px": s.width_px, "height_px": s.height_px,
            "row0_px": s.row0_px, "slope": s.slope,
        }));
    }
    std::fs::write(folder.join("frames.json"), serde_json::to_vec(&index)?)?;
    let python = std::env::var("HYDROLINE_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("benches/stripe_opencv.py");
    let output = std::process::Command::new(&python)
        .arg(script)
        .arg(folder)
        .output()?;
    if !output.status.success() {
        return Err(format!("{python}: {}", String::from_utf8_lossy(&output.stderr)).into());
    }
    Ok(serde_json::from_slice(&output.stdout)?)
}

fn main() -> Result<(), Box<dyn Error>> {
    let frames = frames();
    let images: Vec<GreyImage> = frames.iter().map(|(_, s)| render(s)).collect();
    let folder = tempfile::tempdir()?;
    let other = theirs(folder.path(), &frames, &images);
    match &other {
        Ok(o) => println!(
            "OpenCV {}, NumPy {}, one thread each; ms = best of {REPEATS} (60 in Python)",
            o.opencv, o.numpy
        ),
        Err(e) => eprintln!("OpenCV not measured: {e}"),
    }
    println!(
        "{:12} {:24} {:>8} {:>9} {:>8} {:>9} {:>7} {:>7}",
        "frame", "", "best ms", "median ms", "rms px", "bias px", "x bound", "columns"
    );
    for ((name, stripe), image) in frames.iter().zip(&images) {
        let bound = row_bound_px(
            stripe.sigma_px,
            stripe.peak,
            stripe.noise_sd,
            stripe.row_px(100.0),
        );
        let mine = ours(name, stripe, image);
        let rest = other
            .iter()
            .flat_map(|o| &o.results)
            .filter(|r| r.frame == *name);
        for r in mine.iter().chain(rest) {
            println!(
                "{:12} {:24} {:8.3} {:9.3} {:8.4} {:9.4} {:7.2} {:7}",
                r.frame,
                r.method,
                r.best_ms,
                r.median_ms,
                r.rms_px,
                r.bias_px,
                r.rms_px / bound,
                r.columns
            );
        }
    }
    Ok(())
}
