//! The Rust side of what `extract` costs in Python (`src/python/tests/figures.py`).
//!
//! `time_extract WIDTH_PX HEIGHT_PX COUNT`: stdin has an image's grey levels, row by row, and then a line per round of `COUNT`
//! images, so that two programs can take turns; stdout gets a line with each round's seconds per image.

use hydroline_core::frame::GreyImage;
use hydroline_stripe::{Extractor, ExtractorConfig};
use std::error::Error;
use std::hint::black_box;
use std::io::{BufRead, Read, Write};
use std::time::Instant;

fn main() -> Result<(), Box<dyn Error>> {
    let numbers: Vec<usize> = std::env::args()
        .skip(1)
        .map(|word| word.parse())
        .collect::<Result<_, _>>()?;
    let [width_px, height_px, count] = numbers[..] else {
        return Err("usage: time_extract WIDTH_PX HEIGHT_PX COUNT < GREY".into());
    };
    let mut input = std::io::stdin().lock();
    let mut pixels = vec![0; width_px * height_px];
    input.read_exact(&mut pixels)?;
    let image = GreyImage {
        width_px,
        height_px,
        pixels,
    };
    let mut extractor = Extractor::new(ExtractorConfig::default());
    for line in input.lines() {
        line?;
        let began = Instant::now();
        for _ in 0..count {
            black_box(extractor.extract(black_box(&image)));
        }
        println!("{:.9}", began.elapsed().as_secs_f64() / count as f64);
        std::io::stdout().flush()?;
    }
    Ok(())
}
