//! The profile for people: CSV and a picture.

use super::{Profile, quality};
use hydroline_core::frame::GreyImage;
use image::{Rgb, RgbImage};
use std::io::{self, Write};

/// Header of [`write_csv`] (reference/interfaces.md, `hydroline extract`).
pub const CSV_HEADER: &str = "column_px,row_px,peak,sd_px";

/// Writes the points as CSV, one line per point, after the header.
///
/// # Errors
/// The writer's.
pub fn write_csv(profile: &Profile, out: &mut impl Write) -> io::Result<()> {
    writeln!(out, "{CSV_HEADER}")?;
    for p in &profile.points {
        writeln!(
            out,
            "{},{:.4},{:.2},{:.4}",
            p.column_px, p.row_px, p.peak, p.sd_px
        )?;
    }
    Ok(())
}

/// The frame with its stripe: green = sound, yellow = near a step or with a rival,
/// red = saturated, blue = candidates that lost. An image whose buffer is short comes out black.
pub fn annotate(image: &GreyImage, profile: &Profile) -> RgbImage {
    let width = u32::try_from(image.width_px).unwrap_or(0);
    let height = u32::try_from(image.height_px).unwrap_or(0);
    let mut picture = RgbImage::new(width, height);
    for (to, from) in picture.pixels_mut().zip(&image.pixels) {
        *to = Rgb([*from; 3]);
    }
    let mut dot = |column: f64, row: f64, colour: [u8; 3]| {
        let (c, r) = (column.round(), row.round());
        if c >= 0.0 && r >= 0.0 && c < f64::from(width) && r < f64::from(height) {
            picture.put_pixel(c as u32, r as u32, Rgb(colour));
        }
    };
    for p in &profile.candidates {
        dot(p.column_px, p.row_px, [80, 120, 255]);
    }
    for p in &profile.points {
        let colour = if p.quality & quality::SATURATED != 0 {
            [255, 40, 40]
        } else if p.quality & (quality::RIVAL | quality::NEAR_STEP) != 0 {
            [255, 220, 0]
        } else {
            [0, 255, 80]
        };
        dot(p.column_px, p.row_px, colour);
    }
    picture
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::{Extractor, ExtractorConfig, StripePoint};

    #[test]
    fn csv_has_the_fixed_header_and_a_line_per_point() {
        let point = StripePoint {
            column_px: 3.0,
            row_px: 10.25,
            peak: 99.5,
            sd_px: 0.0312,
            sigma_px: 2.0,
            quality: 0,
        };
        let profile = Profile {
            points: vec![point],
            ..Default::default()
        };
        let mut out = Vec::new();
        write_csv(&profile, &mut out).unwrap();
        assert_eq!(
            String::from_utf8(out).unwrap(),
            "column_px,row_px,peak,sd_px\n3,10.2500,99.50,0.0312\n"
        );
    }

    #[test]
    fn the_stripe_is_drawn_where_it_lies() {
        let stripe = crate::synthetic::StripeImage {
            width_px: 64,
            height_px: 64,
            row0_px: 30.2,
            ..Default::default()
        };
        let image = crate::synthetic::render(&stripe);
        let profile = Extractor::new(ExtractorConfig::default()).extract(&image);
        let picture = annotate(&image, &profile);
        assert_eq!(picture.get_pixel(32, 30), &Rgb([0, 255, 80]));
        assert_eq!(picture.get_pixel(32, 5).0[0], image.pixels[5 * 64 + 32]);
    }
}
