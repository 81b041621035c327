use image::codecs::jpeg::JpegEncoder;
use image::{GrayImage, Luma, Rgb, RgbImage};

use super::*;
use crate::frame::{
    BlockAccount, Frame, FrameError, FrameMeta, GreyImage, GreyRule, PixelFormat, StillError,
    inspect_still, read_still, still_size,
};

/// 96 x 64, colour at 4:2:0, a restart marker after every third group (written by libjpeg-turbo).
const RESTARTS: &[u8] = include_bytes!("tests/restarts.jpg");
/// The same image in ten scans.
const PROGRESSIVE: &[u8] = include_bytes!("tests/progressive.jpg");
/// Its brightness, with tables made for it.
const OPTIMIZED: &[u8] = include_bytes!("tests/optimized.jpg");

/// Noise of a camera, the same each time.
fn noise(x: u32, y: u32) -> f64 {
    let hash = |k: u32| {
        let mut v = x.wrapping_mul(0x9e37_79b1) ^ y.wrapping_mul(0x85eb_ca6b) ^ k;
        v = (v ^ v >> 15).wrapping_mul(0x2c1b_3c6d);
        v = (v ^ v >> 12).wrapping_mul(0x297a_2d39);
        f64::from(v ^ v >> 15) / f64::from(u32::MAX) - 0.5
    };
    // Of standard deviation 1.
    (0..12).map(hash).sum()
}

fn level(value: f64) -> u8 {
    value.round().clamp(0.0, 255.0) as u8
}

/// A laser's stripe as the reports have it.
fn stripe(width: u32, height: u32) -> GrayImage {
    GrayImage::from_fn(width, height, |x, y| {
        let z = (f64::from(y) - 0.5 * f64::from(height) - 0.02 * f64::from(x)) / 2.0;
        Luma([level(12.0 + 180.0 * (-0.5 * z * z).exp() + noise(x, y))])
    })
}

fn jpeg(image: &GrayImage, quality: u8) -> Vec<u8> {
    let mut bytes = Vec::new();
    JpegEncoder::new_with_quality(&mut bytes, quality)
        .encode_image(image)
        .unwrap();
    bytes
}

fn colour(image: &GrayImage, quality: u8) -> Vec<u8> {
    let image = RgbImage::from_fn(image.width(), image.height(), |x, y| {
        let Luma([v]) = *image.get_pixel(x, y);
        Rgb([v / 3, v, v / 2])
    });
    let mut bytes = Vec::new();
    JpegEncoder::new_with_quality(&mut bytes, quality)
        .encode_image(&image)
        .unwrap();
    bytes
}

fn read(bytes: &[u8]) -> Result<GreyImage, StillError> {
    read_still(bytes, &GreyRule::default())
}

/// Place of the coded data.
fn scan(bytes: &[u8]) -> usize {
    let at = bytes
        .windows(2)
        .position(|w| w == [0xff, marker::SOS])
        .unwrap();
    at + 2 + usize::from(u16::from_be_bytes([bytes[at + 2], bytes[at + 3]]))
}

/// A file without the segments of some markers.
fn without(bytes: &[u8], markers: &[u8]) -> Vec<u8> {
    let (mut kept, mut at) = (bytes[..2].to_vec(), 2);
    while bytes[at + 1] != marker::SOS {
        let after = at + 2 + usize::from(u16::from_be_bytes([bytes[at + 2], bytes[at + 3]]));
        if !markers.contains(&bytes[at + 1]) {
            kept.extend(&bytes[at..after]);
        }
        at = after;
    }
    kept.extend(&bytes[at..]);
    kept
}

/// Largest difference of grey levels.
fn worst(a: &GreyImage, b: &GreyImage) -> u8 {
    let pairs = a.pixels.iter().zip(&b.pixels);
    pairs.map(|(a, b)| a.abs_diff(*b)).max().unwrap_or(255)
}

#[test]
fn a_cut_jpeg_is_no_image_however_much_of_it_is_there() {
    for whole in [
        &jpeg(&stripe(96, 64), 90)[..],
        &colour(&stripe(96, 64), 90),
        RESTARTS,
        PROGRESSIVE,
        OPTIMIZED,
    ] {
        read(whole).unwrap();
        for length in 0..whole.len() {
            let cut = WholeJpeg::of(&whole[..length]).unwrap_err();
            assert!(!cut.to_string().is_empty(), "{length}");
        }
        // The end marker of its own does not make it whole.
        for length in (scan(whole)..whole.len() - 3).step_by(7) {
            let cut = [&whole[..length], &[0xff, 0xd9]].concat();
            assert!(read(&cut).is_err(), "{length} of {}", whole.len());
        }
    }
}

#[test]
fn a_hole_or_zeros_in_a_jpegs_data_are_damage() {
    for whole in [
        &jpeg(&stripe(160, 96), 95)[..],
        &colour(&stripe(160, 96), 90),
        RESTARTS,
        PROGRESSIVE,
        OPTIMIZED,
    ] {
        let (from, sound) = (scan(whole), read(whole).unwrap());
        // Of fewer bytes some leave as many blocks as there were: see the flips below.
        for bytes in [150, 500] {
            for at in (from..whole.len().saturating_sub(bytes + 2)).step_by(11) {
                let (before, rest) = whole.split_at(at);
                let hole = [before, &rest[bytes..]].concat();
                let zeros = [before, &vec![0; bytes], &rest[bytes..]].concat();
                for (what, damaged) in [("hole", hole), ("zeros", zeros)] {
                    if let Ok(image) = read(&damaged) {
                        panic!(
                            "{what} of {bytes} at {at} of {}: off by {}",
                            whole.len(),
                            worst(&image, &sound)
                        );
                    }
                }
            }
        }
    }
}

/// Contents that a sound image may have, drawn sharp and on the blocks' own grid, too.
fn contents() -> Vec<(String, GrayImage)> {
    let (w, h) = (176, 120);
    let mut all = vec![("stripe".to_owned(), stripe(w, h))];
    let mut draw = |name: String, of: &dyn Fn(u32, u32) -> f64| {
        let image = GrayImage::from_fn(w, h, |x, y| Luma([level(of(x, y))]));
        all.push((name, image));
    };
    for grey in [0.0, 12.0, 128.0, 255.0] {
        draw(format!("even {grey}"), &|_, _| grey);
        draw(format!("noise about {grey}"), &|x, y| {
            grey + 3.0 * noise(x, y)
        });
    }
    draw("loud noise".to_owned(), &|x, y| 128.0 + 60.0 * noise(x, y));
    draw("slope".to_owned(), &|x, y| {
        f64::from(x) + 0.3 * f64::from(y)
    });
    for side in [3, 5, 8, 16, 24, 31] {
        draw(format!("chess {side}"), &|x, y| {
            30.0 + 180.0 * f64::from((x / side + y / side) % 2) + noise(x, y)
        });
        for (dx, dy) in [(0, 0), (3, 5)] {
            draw(format!("dots {side} from {dx} {dy}"), &|x, y| {
                let d = |v: u32| f64::from(v % (2 * side)) + 0.5 - 0.5 * f64::from(side);
                let r = d(x + dx).hypot(d(y + dy));
                20.0 + 200.0 / (1.0 + (2.0 * (r - 0.5 * f64::from(side))).exp())
            });
            draw(format!("squares {side} from {dx} {dy}"), &|x, y| {
                let inside = (x + dx) % (3 * side) < side && (y + dy) % (3 * side) < side;
                20.0 + 200.0 * f64::from(u8::from(inside))
            });
        }
    }
    for row in [40, 44, 63] {
        draw(format!("bar from row {row}"), &|x, y| {
            let on = y >= row && y < row + 16 && x >= 24;
            15.0 + 200.0 * f64::from(u8::from(on)) + noise(x, y)
        });
        draw(format!("step of the stripe in row {row}"), &|x, y| {
            let at = f64::from(row) + if x < 64 { 0.0 } else { 9.0 };
            let z = (f64::from(y) - at) / 1.2;
            10.0 + 230.0 * (-0.5 * z * z).exp() + 1.5 * noise(x, y)
        });
    }
    all
}

#[test]
fn a_sound_jpeg_is_whole_whatever_it_shows() {
    for (name, image) in contents() {
        let grey = [25, 50, 80, 95, 100].map(|quality| (quality, jpeg(&image, quality)));
        for (quality, bytes) in grey.into_iter().chain([(90, colour(&image, 90))]) {
            if let Err(error) = read(&bytes) {
                panic!("{name} at quality {quality}: {error}");
            }
        }
    }
}

/// Stripes as lasers and cameras make them.
#[test]
fn a_sound_jpeg_of_any_stripe_is_whole() {
    let runs = std::env::var("HYDROLINE_STRIPES").map_or(40, |n| n.parse().unwrap());
    let mut refused = Vec::new();
    for k in 0..runs {
        let draw = |n: u32, from: f64, to: f64| {
            let u = (noise(k * 31 + n, 7 * n + 1) / 3.0 + 0.5).clamp(0.0, 1.0);
            from + (to - from) * u
        };
        let (row, slope) = (draw(1, 30.0, 110.0), draw(2, -0.1, 0.1));
        let (peak, sigma, sd) = (draw(3, 40.0, 240.0), draw(4, 0.8, 3.5), draw(5, 0.0, 2.0));
        let step = if k % 3 == 0 { draw(6, 0.0, 20.0) } else { 0.0 };
        let image = GrayImage::from_fn(320, 160, |x, y| {
            let at = row + slope * f64::from(x) + if x > 150 { step } else { 0.0 };
            let z = (f64::from(y) - at) / sigma;
            let value = 12.0 + peak * (-0.5 * z * z).exp();
            Luma([level(value + sd * noise(x + k, y))])
        });
        for quality in [70, 80, 90, 95, 98] {
            if let Err(error) = read(&jpeg(&image, quality)) {
                refused.push(format!(
                    "stripe {k} (step {step}, sigma {sigma}, noise {sd}) at quality {quality}: {error}"
                ));
            }
        }
    }
    assert!(
        refused.is_empty(),
        "{} of {} sound images are called damaged:\n{}",
        refused.len(),
        5 * runs,
        refused.join("\n")
    );
}

/// A frame with a sharp square on the blocks' grid, as recorders and cameras draw over a picture.
fn with_square(sequence: u32, [left, top]: [u32; 2]) -> Frame {
    let mut image = stripe(160, 120);
    for (x, y) in (0..8).flat_map(|y| (0..8).map(move |x| (x, y))) {
        image.put_pixel(left + x, top + y, Luma([220]));
    }
    Frame {
        format: PixelFormat::Mjpg,
        width_px: 160,
        height_px: 120,
        stride_bytes: 0,
        data: jpeg(&image, 95).into(),
        meta: FrameMeta::at(sequence, 0),
    }
}

#[test]
fn what_looks_like_damage_at_one_place_of_every_frame_is_the_picture() {
    let rule = GreyRule::default();
    let mut account = BlockAccount::default();
    for k in 0..5 {
        let frame = with_square(k, [40, 16]);
        let error = frame.to_grey(&rule).unwrap_err();
        assert!(matches!(error, FrameError::Damaged { .. }), "{error}");
        let inspected = frame.inspect(&rule).unwrap();
        assert_eq!(
            inspected.seams,
            [JpegDamage::Foreign {
                column_px: 40,
                row_px: 16
            }]
        );
        account.see(&inspected.seams);
    }
    let picture = account.picture();
    assert_eq!(picture.len(), 1);
    let frame = with_square(5, [40, 16]);
    let image = frame.to_grey_with(&rule, &picture).unwrap();
    assert_eq!(image, inspect_still(&frame.data, &rule).unwrap().image);
    // At another place, or as a file of its own, it is not; and data that do not decode never are.
    for other in [with_square(6, [96, 16]), with_square(7, [40, 96])] {
        let error = other.to_grey_with(&rule, &picture).unwrap_err();
        assert!(error.to_string().contains("damaged JPEG"), "{error}");
    }
    assert!(matches!(
        read(&frame.data),
        Err(StillError::Damaged(JpegDamage::Foreign { .. }))
    ));
    let cut = Frame {
        data: frame.data.slice(..frame.data.len() / 2),
        ..frame
    };
    let error = cut.to_grey_with(&rule, &picture).unwrap_err();
    assert!(matches!(error, FrameError::Damaged { .. }), "{error}");
}

#[test]
fn mjpeg_without_huffman_tables_is_read_whatever_its_app_marker() {
    for whole in [jpeg(&stripe(96, 64), 90), colour(&stripe(96, 64), 90)] {
        let sound = read(&whole).unwrap();
        let bare = without(&whole, &[marker::DHT, marker::APP0]);
        let with = |app: &[u8]| [&bare[..2], app, &bare[2..]].concat();
        for app in [
            &[][..],
            b"\xff\xe0\x00\x10AVI1\0\0\0\0\0\0\0\0\0\0",
            b"\xff\xe0\x00\x10JFIF\0\x01\x01\0\0\x01\0\x01\0\0",
            b"\xff\xe4\x00\x04AB",
        ] {
            assert_eq!(read(&with(app)).unwrap(), sound, "{app:?}");
        }
        // Tables that it does state hold.
        assert!(WholeJpeg::of(&whole).unwrap().with_tables() == whole);
    }
    let bare = without(OPTIMIZED, &[marker::DHT]);
    assert!(matches!(read(&bare), Err(StillError::Damaged(_))));
    let bare = without(PROGRESSIVE, &[marker::DHT]);
    assert!(matches!(read(&bare), Err(StillError::Damaged(_))));
}

#[test]
fn what_stands_behind_the_end_or_fills_a_word_before_a_marker_is_no_damage() {
    let whole = jpeg(&stripe(96, 64), 90);
    let sound = read(&whole).unwrap();
    let end = whole.len() - 2;
    for filled in [
        [&whole[..], &[0; 900]].concat(),
        [&whole[..], &whole].concat(),
        [&whole[..end], &[0xff, 0xff, 0xff, 0xd9]].concat(),
        // As Logitech's cameras do.
        [&whole[..end], &[0, 0, 0, 0xff, 0xd9]].concat(),
        [&whole[..end], &[0x7f, 0xff, 0xd9]].concat(),
    ] {
        assert_eq!(read(&filled).unwrap(), sound);
    }
    // Blocks more than there should be were some of the image before.
    let [low, high] = [87, 95].map(|rows| jpeg(&stripe(96, rows), 90));
    let mut more = high;
    let header = |bytes: &[u8]| bytes.windows(2).position(|w| w == [0xff, 0xc0]).unwrap();
    more[header(&low) + 5..header(&low) + 7].copy_from_slice(&[0, 80]);
    let error = read(&more).unwrap_err().to_string();
    assert!(error.contains("left over"), "{error}");
}

/// Flips of single bits: JPEG has no checksum, and a value that is another decodes as well. What the seams do not show is
/// no larger than noise but for a few.
#[test]
fn a_flipped_bit_of_a_jpeg_is_damage_or_hardly_changes_it() {
    let whole = jpeg(&stripe(320, 240), 95);
    let (from, sound) = (scan(&whole), read(&whole).unwrap());
    let flips: Vec<_> = (from..whole.len() - 2).step_by(23).collect();
    let [mut plain, mut unseen] = [0, 0];
    for (k, at) in flips.iter().enumerate() {
        let mut flipped = whole.clone();
        flipped[*at] ^= 1 << (k % 8);
        match read(&flipped) {
            Ok(image) if worst(&image, &sound) > 12 => unseen += 1,
            Ok(_) => plain += 1,
            Err(error) => assert!(matches!(error, StillError::Damaged(_)), "{error}"),
        }
    }
    let seen = flips.len() - plain - unseen;
    assert!(
        unseen * 20 < flips.len() && seen * 3 > flips.len(),
        "of {} flips {seen} are seen, {plain} hardly change the image, {unseen} do",
        flips.len()
    );
}

#[test]
fn an_image_stored_on_its_side_is_turned_upright() {
    let upright = stripe(96, 64);
    let exif = |orientation: u8| {
        let mut app =
            b"\xff\xe1\x00\x22Exif\0\0MM\0\x2a\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0".to_vec();
        app.extend([orientation, 0, 0, 0, 0, 0, 0]);
        app
    };
    let rule = GreyRule::default();
    for (orientation, stored) in [
        (1, upright.clone()),
        (2, image::imageops::flip_horizontal(&upright)),
        (3, image::imageops::rotate180(&upright)),
        (4, image::imageops::flip_vertical(&upright)),
        (6, image::imageops::rotate270(&upright)),
        (8, image::imageops::rotate90(&upright)),
    ] {
        let bytes = jpeg(&stored, 95);
        let bytes = [&bytes[..2], &exif(orientation), &bytes[2..]].concat();
        let grey = read(&bytes).unwrap();
        assert_eq!((grey.width_px, grey.height_px), (96, 64), "{orientation}");
        let off = grey.pixels.iter().zip(upright.as_raw());
        let off = off.map(|(a, b)| a.abs_diff(*b)).max();
        assert!(off < Some(9), "{orientation}: {off:?}");
        assert_eq!(still_size(&bytes, PixelFormat::Mjpg), Some((96, 64)));
        // As a frame of the size that it is shown with, and of the one that was negotiated with a camera.
        let frame = |width_px, height_px| Frame {
            format: PixelFormat::Mjpg,
            width_px,
            height_px,
            stride_bytes: 0,
            data: bytes.clone().into(),
            meta: FrameMeta::at(0, 0),
        };
        assert_eq!(frame(96, 64).to_grey(&rule).unwrap(), grey);
        let (w, h) = stored.dimensions();
        let negotiated = frame(w, h).to_grey(&rule).unwrap();
        assert_eq!(
            (negotiated.width_px, negotiated.height_px),
            (w as usize, h as usize)
        );
        let other = frame(95, 64).to_grey(&rule);
        assert!(matches!(other, Err(FrameError::CompressedSize { .. })));
    }
}

#[test]
fn a_damaged_frame_says_so_with_its_number() {
    let whole = jpeg(&stripe(96, 64), 90);
    let at = |bytes: &[u8]| Frame {
        format: PixelFormat::Mjpg,
        width_px: 96,
        height_px: 64,
        stride_bytes: 0,
        data: bytes.to_vec().into(),
        meta: FrameMeta::at(7, 0),
    };
    for cut in [1, 30, whole.len() / 2, whole.len() - 1] {
        let error = at(&whole[..cut]).to_grey(&GreyRule::default()).unwrap_err();
        let words = error.to_string();
        assert!(
            matches!(error, FrameError::Damaged { .. }) && words.starts_with("frame 7: damaged"),
            "{cut}: {words}"
        );
    }
}
