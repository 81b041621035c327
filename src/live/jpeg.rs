//! Grey images as a page shows them.

use hydroline_core::frame::GreyImage;
use image::ExtendedColorType;
use image::codecs::jpeg::JpegEncoder;

/// Wider images are halved until they fit: no screen at a tank shows more.
const WIDTH_MAX_PX: usize = 1280;
const QUALITY: u8 = 75;

/// Appends an image; nothing where it cannot be encoded.
pub fn write_jpeg(grey: &GreyImage, out: &mut Vec<u8>) {
    let before = out.len();
    let sides = (u16::try_from(grey.width_px), u16::try_from(grey.height_px));
    if let (Ok(width), Ok(height)) = sides {
        let mut jpeg = JpegEncoder::new_with_quality(&mut *out, QUALITY);
        let written = jpeg.encode(
            &grey.pixels,
            width.into(),
            height.into(),
            ExtendedColorType::L8,
        );
        if written.is_err() {
            out.truncate(before);
        }
    }
}

/// Number of times that an image of this width is halved.
pub fn halvings(mut width_px: usize) -> u32 {
    let mut times = 0;
    while width_px > WIDTH_MAX_PX {
        (width_px, times) = (width_px / 2, times + 1);
    }
    times
}

/// Halved until it is no wider than a screen; each pixel the mean of four.
pub fn halved(mut image: GreyImage) -> GreyImage {
    for _ in 0..halvings(image.width_px) {
        let (width_px, height_px) = (image.width_px / 2, image.height_px / 2);
        let mut pixels = Vec::with_capacity(width_px * height_px);
        for rows in image.pixels.chunks_exact(2 * image.width_px) {
            let (upper, lower) = rows.split_at(image.width_px);
            let four = upper.chunks_exact(2).zip(lower.chunks_exact(2));
            pixels.extend(four.map(|(u, l)| {
                let sum = u.iter().chain(l).map(|p| u16::from(*p)).sum::<u16>();
                ((sum + 2) / 4) as u8
            }));
        }
        image = GreyImage {
            width_px,
            height_px,
            pixels,
        };
    }
    image
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wide_image_is_halved_to_its_mean() {
        let row = |a: u8, b: u8| [a, b].repeat(1000);
        let pixels = [row(10, 20), row(30, 40), row(0, 0)].concat();
        let small = halved(GreyImage {
            width_px: 2000,
            height_px: 3,
            pixels,
        });
        assert_eq!((small.width_px, small.height_px), (1000, 1));
        assert!(small.pixels.iter().all(|p| *p == 25) && small.pixels.len() == 1000);
    }
}
