//! Columns for rows: a vertical stripe is a horizontal one in the transposed image.

use super::{Profile, StripePoint};
use hydroline_core::frame::{GreyImage, GreyView};

/// Side of a block that stays in the cache \[px\].
const BLOCK_PX: usize = 32;

/// The image with rows and columns exchanged. Its buffer must fit its size.
pub(super) fn image(image: GreyView<'_>) -> GreyImage {
    let (width, height) = (image.width_px, image.height_px);
    let mut pixels = vec![0; image.pixels.len()];
    for top in (0..height).step_by(BLOCK_PX) {
        for left in (0..width).step_by(BLOCK_PX) {
            for row in top..(top + BLOCK_PX).min(height) {
                for column in left..(left + BLOCK_PX).min(width) {
                    pixels[column * height + row] = image.pixels[row * width + column];
                }
            }
        }
    }
    GreyImage {
        width_px: height,
        height_px: width,
        pixels,
    }
}

/// The profile of the transposed image, in the image's own columns and rows.
pub(super) fn profile(mut profile: Profile) -> Profile {
    let turn = |p: &mut StripePoint| std::mem::swap(&mut p.column_px, &mut p.row_px);
    profile.points.iter_mut().for_each(turn);
    profile.candidates.iter_mut().for_each(turn);
    profile.size_px = (profile.size_px.1, profile.size_px.0);
    profile
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::{StripeImage, render};
    use crate::{Extractor, ExtractorConfig, Orientation, ProfileFault};

    #[test]
    fn a_vertical_stripe_gives_the_points_of_the_same_one_lying_down() {
        let lying = render(&StripeImage {
            width_px: 413,
            height_px: 301,
            row0_px: 120.4,
            slope: 0.1,
            haze_fraction: 0.03,
            ..Default::default()
        });
        let standing = image((&lying).into());
        assert_eq!(image((&standing).into()), lying);
        let flat = Extractor::new(ExtractorConfig::default()).extract(&lying);
        let mut upright = Extractor::new(ExtractorConfig {
            orientation: Orientation::Vertical,
            ..Default::default()
        });
        let found = upright.extract(&standing);
        assert_eq!(found.points.len(), 413);
        assert_eq!(found.size_px, (301, 413));
        for (a, b) in found.points.iter().zip(&flat.points) {
            assert_eq!((a.row_px, a.column_px), (b.column_px, b.row_px));
            assert_eq!((a.sd_px, a.peak, a.quality), (b.sd_px, b.peak, b.quality));
        }
    }

    #[test]
    fn faults_speak_of_the_image_as_it_is() {
        let mut upright = Extractor::new(ExtractorConfig {
            orientation: Orientation::Vertical,
            ..Default::default()
        });
        let small = GreyImage {
            width_px: 300,
            height_px: 8,
            pixels: vec![0; 2400],
        };
        let fault = upright.extract(&small).fault;
        assert!(
            matches!(
                fault,
                Some(ProfileFault::TooSmall {
                    width_px: 300,
                    height_px: 8,
                    ..
                })
            ),
            "{fault:?}"
        );
        let short = GreyImage {
            width_px: 100,
            height_px: 100,
            pixels: vec![0; 50],
        };
        assert!(matches!(
            upright.extract(&short).fault,
            Some(ProfileFault::Malformed {
                needed: 10_000,
                got: 50,
                ..
            })
        ));
    }
}
