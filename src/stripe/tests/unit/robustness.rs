//! Frames that hold no stripe, or more than one: what must never go wrong.

use crate::synthetic::{StripeImage, render};
use crate::{Extractor, ExtractorConfig, Profile, ProfileFault, quality};
use hydroline_core::frame::GreyImage;
use proptest::prelude::*;

fn extract(image: &GreyImage) -> Profile {
    Extractor::new(ExtractorConfig::default()).extract(image)
}

fn flat(width_px: usize, height_px: usize, level: u8) -> GreyImage {
    GreyImage {
        width_px,
        height_px,
        pixels: vec![level; width_px * height_px],
    }
}

/// Adds a round blob, as a particle in the sheet makes it.
fn blob(image: &mut GreyImage, column: usize, row: usize, sigma_px: f64, peak: f64) {
    let reach = (4.0 * sigma_px) as usize;
    for r in row.saturating_sub(reach)..(row + reach).min(image.height_px) {
        for c in column.saturating_sub(reach)..(column + reach).min(image.width_px) {
            let d2 = (r as f64 - row as f64).powi(2) + (c as f64 - column as f64).powi(2);
            let light = peak * (-0.5 * d2 / (sigma_px * sigma_px)).exp();
            let pixel = &mut image.pixels[r * image.width_px + c];
            *pixel = (f64::from(*pixel) + light).min(255.0) as u8;
        }
    }
}

fn overlay(images: &[GreyImage]) -> GreyImage {
    let mut out = images[0].clone();
    for other in &images[1..] {
        for (a, b) in out.pixels.iter_mut().zip(&other.pixels) {
            *a = (*a).max(*b);
        }
    }
    out
}

#[test]
fn frames_without_a_stripe_say_why() {
    for level in [0, 90, 255] {
        let profile = extract(&flat(720, 576, level));
        assert!(profile.points.is_empty());
        assert!(
            matches!(profile.fault, Some(ProfileFault::Dark { mean_level, .. }) if mean_level == f64::from(level))
        );
    }
    let noise = render(&StripeImage {
        peak: 0.0,
        noise_sd: 4.0,
        background: 30.0,
        ..Default::default()
    });
    assert!(
        matches!(extract(&noise).fault, Some(ProfileFault::Dark { .. })),
        "{:?}",
        extract(&noise).fault
    );
    for (w, h) in [(0, 0), (1, 1), (720, 1), (1, 576), (7, 100)] {
        assert!(
            matches!(
                extract(&flat(w, h, 9)).fault,
                Some(ProfileFault::TooSmall { .. })
            ),
            "{w}x{h}"
        );
    }
    let short = GreyImage {
        width_px: 100,
        height_px: 100,
        pixels: vec![0; 50],
    };
    let fault = extract(&short).fault;
    assert_eq!(
        fault,
        Some(ProfileFault::Malformed {
            width_px: 100,
            height_px: 100,
            needed: 10_000,
            got: 50
        })
    );
    let mut dust = render(&StripeImage {
        peak: 0.0,
        ..Default::default()
    });
    for i in 0..20 {
        blob(&mut dust, 35 * i + 10, (97 * i) % 500 + 30, 1.5, 200.0);
    }
    assert!(
        matches!(
            extract(&dust).fault,
            Some(ProfileFault::TooFewColumns { found: 0, .. })
        ),
        "{:?}",
        extract(&dust).fault
    );
}

#[test]
fn particles_neither_displace_nor_replace_the_stripe() {
    let stripe = StripeImage {
        slope: 0.2,
        row0_px: 200.0,
        noise_sd: 3.0,
        ..Default::default()
    };
    let mut image = render(&stripe);
    for i in 0..24 {
        let column = 30 * i + 12;
        let away = [-60.0, 35.0, -20.0, 90.0, 14.0][i % 5];
        blob(
            &mut image,
            column,
            (stripe.row_px(column as f64) + away) as usize,
            2.0 + 0.1 * (i % 4) as f64,
            220.0,
        );
    }
    let profile = extract(&image);
    assert!(
        profile.points.len() > 690,
        "{} points",
        profile.points.len()
    );
    assert!(
        profile.candidates.len() > 20,
        "{} candidates",
        profile.candidates.len()
    );
    let mut far_sigma = 0;
    for p in &profile.points {
        let error = p.row_px - stripe.row_px(p.column_px);
        assert!(error.abs() < 0.6, "column {}: {error} px off", p.column_px);
        far_sigma += usize::from(error.abs() > 4.0 * p.sd_px && p.quality == 0);
    }
    assert!(
        far_sigma <= 7,
        "{far_sigma} points lie 4 sd off without a remark"
    );
    assert!(
        profile
            .points
            .iter()
            .any(|p| p.quality & quality::RIVAL != 0)
    );
}

#[test]
fn a_dimmer_ghost_loses_and_is_listed() {
    let stripe = StripeImage {
        row0_px: 300.4,
        ..Default::default()
    };
    let ghost = StripeImage {
        row0_px: 350.0,
        peak: 90.0,
        seed: 7,
        ..stripe.clone()
    };
    let profile = extract(&overlay(&[render(&stripe), render(&ghost)]));
    assert!(
        profile
            .points
            .iter()
            .all(|p| (p.row_px - 300.4).abs() < 0.3)
    );
    let ghosts = profile
        .candidates
        .iter()
        .filter(|p| (p.row_px - 350.0).abs() < 0.5)
        .count();
    assert!(ghosts > 700, "{ghosts}");
}

#[test]
fn depth_steps_are_followed_and_marked() {
    let low = StripeImage {
        row0_px: 320.2,
        ..Default::default()
    };
    let high = StripeImage {
        row0_px: 290.7,
        ..low.clone()
    };
    let (low_image, mut image) = (render(&low), render(&high));
    for row in 0..image.height_px {
        let line = row * 720;
        image.pixels[line..line + 240].copy_from_slice(&low_image.pixels[line..line + 240]);
        image.pixels[line + 500..line + 720]
            .copy_from_slice(&low_image.pixels[line + 500..line + 720]);
    }
    let profile = extract(&image);
    assert_eq!(profile.points.len(), 720);
    for p in &profile.points {
        let truth = if (240.0..500.0).contains(&p.column_px) {
            290.7
        } else {
            320.2
        };
        assert!(
            (p.row_px - truth).abs() < 0.15,
            "column {}: {}",
            p.column_px,
            p.row_px
        );
        let near = [240.0, 500.0]
            .iter()
            .any(|s: &f64| p.column_px - s >= -6.0 && p.column_px - s < 6.0);
        assert_eq!(
            p.quality & quality::NEAR_STEP != 0,
            near,
            "column {}",
            p.column_px
        );
    }
}

#[test]
fn no_point_at_the_border_rather_than_a_biased_one() {
    // The stripe leaves the frame through its upper border.
    let stripe = StripeImage {
        row0_px: 40.0,
        slope: -0.1,
        ..Default::default()
    };
    let profile = extract(&render(&stripe));
    assert!(profile.points.len() > 300);
    for p in &profile.points {
        assert!(
            (p.row_px - stripe.row_px(p.column_px)).abs() < 0.12,
            "column {}",
            p.column_px
        );
    }
    assert!(
        profile
            .points
            .iter()
            .all(|p| stripe.row_px(p.column_px) > 5.0)
    );
}

#[test]
fn a_frame_gives_the_same_bits_whatever_came_before() {
    let first = render(&StripeImage {
        sigma_px: 3.0,
        peak: 700.0,
        haze_fraction: 0.05,
        ..Default::default()
    });
    let second = render(&StripeImage {
        slope: -0.2,
        row0_px: 300.0,
        seed: 3,
        ..Default::default()
    });
    let mut used = Extractor::new(ExtractorConfig::default());
    used.extract(&first);
    assert_eq!(used.extract(&second), extract(&second));
    assert_eq!(used.extract(&first), extract(&first));
}

#[test]
fn whole_pixels_are_whole_and_central() {
    let stripe = StripeImage {
        row0_px: 287.3,
        noise_sd: 1.0,
        ..Default::default()
    };
    let config = ExtractorConfig {
        whole_pixel: true,
        ..Default::default()
    };
    let profile = Extractor::new(config).extract(&render(&stripe));
    assert_eq!(profile.points.len(), 720);
    assert!(
        profile
            .points
            .iter()
            .all(|p| p.row_px == 287.0 || p.row_px == 288.0)
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn no_image_panics_and_every_number_is_finite(
        width_px in 0usize..90,
        height_px in 0usize..90,
        seed in any::<u64>(),
        kind in 0u8..5,
        whole_pixel in any::<bool>(),
    ) {
        let mut state = seed | 1;
        let pixels: Vec<u8> = (0..width_px * height_px)
            .map(|i| {
                // xorshift64: any bytes, no distribution in mind.
                state ^= state << 13;
                state ^= state >> 7;
                state ^= state << 17;
                let byte = (state >> 32) as u8;
                let row = i / width_px.max(1);
                match kind {
                    0 => byte,
                    1 => if byte > 250 { 255 } else { 3 },
                    2 => if row % 11 < 4 { 255 } else { byte / 16 },
                    3 => if (row as u64) < seed % 90 { 200 } else { byte / 8 },
                    _ => if (row as u64).abs_diff(seed % 90) < 3 { 255 } else { 0 },
                }
            })
            .collect();
        let image = GreyImage { width_px, height_px, pixels };
        let mut extractor = Extractor::new(ExtractorConfig { whole_pixel, ..Default::default() });
        let profile = extractor.extract(&image);
        prop_assert_eq!(profile.points.is_empty(), profile.fault.is_some());
        for p in profile.points.iter().chain(&profile.candidates) {
            prop_assert!(p.row_px.is_finite() && p.peak.is_finite() && p.sd_px.is_finite() && p.sigma_px.is_finite());
            prop_assert!(p.sd_px > 0.0 && p.row_px >= 0.0 && p.row_px < height_px as f64);
        }
    }
}
