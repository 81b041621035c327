//! Every format to grey levels: values, rows, geometry, random bytes.

use bytes::Bytes;
use proptest::prelude::*;

use super::*;

fn frame(format: PixelFormat, (w, h): (u32, u32), stride_bytes: u32, data: Vec<u8>) -> Frame {
    Frame {
        format,
        width_px: w,
        height_px: h,
        stride_bytes,
        data: Bytes::from(data),
        meta: FrameMeta {
            sequence: 7,
            driver_stamp_ns: 0,
            stamp_clock: StampClock::Monotonic,
            stamp_source: StampSource::StartOfExposure,
            flags: 0x2001,
            received_monotonic_ns: 3_000_000,
            mid_exposure_ns: 2_000_000,
            exposure_s: 0.004,
            fault: None,
            lost_before: LossBefore::default(),
        },
    }
}

fn of(channel: Channel) -> GreyRule {
    GreyRule {
        channel,
        ..GreyRule::default()
    }
}

fn colours() -> [Channel; 3] {
    [Channel::Red, Channel::Green, Channel::Blue]
}

fn raw_formats() -> impl Iterator<Item = PixelFormat> {
    PixelFormat::of_cameras().filter(|f| !f.is_compressed())
}

/// Linear red, green, blue of 0 to 1 as this format has them: what a camera does.
fn expose(
    format: PixelFormat,
    w: usize,
    h: usize,
    light: impl Fn(usize, usize) -> [f64; 3],
) -> Frame {
    let full = |bits: u8| f64::from((1u32 << bits) - 1);
    let byte = |v: f64| (v * 255.0).round() as u8;
    let wide = |v: f64| ((v * full(format.bits())).round() as u16).to_le_bytes();
    let y_of = |[r, g, b]: [f64; 3]| 0.299 * r + 0.587 * g + 0.114 * b;
    let luma = |rgb: [f64; 3]| (16.0 + 219.0 * y_of(rgb)).round() as u8;
    let chroma = |rgb: [f64; 3]| {
        let y = y_of(rgb);
        [(rgb[2] - y) / 1.772, (rgb[0] - y) / 1.402].map(|c| (128.0 + 224.0 * c).round() as u8)
    };
    let mean = |cells: &[(usize, usize)]| {
        let mut sum = [0.0; 3];
        for &(row, column) in cells {
            let rgb = light(row.min(h - 1), column.min(w - 1));
            for i in 0..3 {
                sum[i] += rgb[i] / cells.len() as f64;
            }
        }
        sum
    };
    let mut data = Vec::new();
    for row in 0..h {
        for column in 0..w {
            let rgb = light(row, column);
            let [r, g, b] = rgb.map(byte);
            match format {
                PixelFormat::Grey => data.push(g),
                PixelFormat::Y10 | PixelFormat::Y12 | PixelFormat::Y16 => data.extend(wide(rgb[1])),
                PixelFormat::Nv12 => data.push(luma(rgb)),
                // Chroma stands with the even column.
                PixelFormat::Yuyv => {
                    data.extend([luma(rgb), chroma(light(row, column & !1))[column % 2]]);
                }
                PixelFormat::Uyvy => {
                    data.extend([chroma(light(row, column & !1))[column % 2], luma(rgb)]);
                }
                PixelFormat::Rgb24 => data.extend([r, g, b]),
                PixelFormat::Bgr24 => data.extend([b, g, r]),
                PixelFormat::Rgba32 => data.extend([r, g, b, 9]),
                PixelFormat::Bgra32 => data.extend([b, g, r, 9]),
                PixelFormat::Bayer(order, depth) => {
                    let (red_row, red_column) = order.red_at();
                    let sample = match (row % 2 == red_row, column % 2 == red_column) {
                        (true, true) => rgb[0],
                        (false, false) => rgb[2],
                        _ => rgb[1],
                    };
                    match depth {
                        BayerDepth::Eight => data.push(byte(sample)),
                        _ => data.extend(wide(sample)),
                    }
                }
                PixelFormat::Mjpg | PixelFormat::Png => {}
            }
        }
        if format == PixelFormat::Nv12 && w % 2 == 1 {
            data.push(0);
        }
    }
    if format == PixelFormat::Nv12 {
        for row in (0..h).step_by(2) {
            for column in (0..w).step_by(2) {
                data.extend(chroma(mean(&[(row, column), (row + 1, column)])));
            }
        }
    }
    let stride = format.row_bytes(w as u32) as u32;
    frame(format, (w as u32, h as u32), stride, data)
}

#[test]
fn a_plain_colour_comes_out_of_every_format_in_every_channel() {
    let rgb = [0.8, 0.4, 0.2];
    for (w, h) in [(6, 4), (7, 5), (2, 2)] {
        for format in raw_formats() {
            let frame = expose(format, w, h, |_, _| rgb);
            for (channel, value) in colours().into_iter().zip(rgb) {
                let value = if format.has_colour() { value } else { rgb[1] };
                let grey = frame.to_grey(&of(channel)).unwrap();
                assert_eq!(
                    (grey.width_px, grey.height_px, grey.pixels.len()),
                    (w, h, w * h)
                );
                // Luma and chroma are rounded to 1 of 219 and 224 levels.
                let within = if format.is_yuv() { 2.0 } else { 0.5 };
                for level in grey.pixels {
                    let off = (f64::from(level) - 255.0 * value).abs();
                    assert!(off <= within, "{format:?} {channel:?} {w}x{h}: {level}");
                }
            }
            let luma = match format {
                f if !f.has_colour() => 255.0 * rgb[1],
                // The camera's own, as it stands in the bytes.
                f if f.is_yuv() => 16.0 + 219.0 * (0.299 * 0.8 + 0.587 * 0.4 + 0.114 * 0.2),
                _ => 255.0 * (0.2126 * 0.8 + 0.7152 * 0.4 + 0.0722 * 0.2),
            };
            for level in frame.to_grey(&GreyRule::default()).unwrap().pixels {
                assert!(
                    (f64::from(level) - luma).abs() <= 1.0,
                    "{format:?}: {level}"
                );
            }
        }
    }
}

#[test]
fn padding_is_passed_over_and_one_byte_too_few_is_an_error() {
    for format in raw_formats() {
        let (w, h) = (6u32, 4u32);
        let tight = expose(format, w as usize, h as usize, |row, column| {
            [0.1 + 0.05 * row as f64, 0.4, 0.1 * column as f64]
        });
        let row = format.row_bytes(w) as usize;
        let stride = row + 5;
        let mut padded = Vec::new();
        for line in tight.data.chunks(row) {
            padded.extend(line);
            padded.extend([0xee; 5]);
        }
        padded.truncate(padded.len() - 5);
        let padded = frame(format, (w, h), stride as u32, padded);
        for channel in [Channel::Luma, Channel::Red, Channel::Green, Channel::Blue] {
            let grey = tight.to_grey(&of(channel)).unwrap();
            assert_eq!(padded.to_grey(&of(channel)).unwrap(), grey, "{format:?}");
        }
        let short = Frame {
            data: padded.data.slice(..padded.data.len() - 1),
            ..padded.clone()
        };
        let error = short.to_grey(&GreyRule::default()).unwrap_err();
        let words = error.to_string();
        assert!(matches!(error, FrameError::Short { .. }), "{words}");
        assert!(
            words.contains(format.name()) && words.contains("frame 7"),
            "{words}"
        );
    }
}

/// Mean row of the light of each column, over the columns away from the border.
fn row_px(grey: &GreyImage) -> f64 {
    let columns = 4..grey.width_px - 4;
    let n = columns.len() as f64;
    let centroid = |column: usize| {
        let (mut sum, mut moment) = (0.0, 0.0);
        for row in 0..grey.height_px {
            let level = f64::from(grey.pixels[row * grey.width_px + column]);
            sum += level;
            moment += level * row as f64;
        }
        moment / sum
    };
    columns.map(centroid).sum::<f64>() / n
}

/// A line across the image keeps its row in every colour of every mosaic, and between the rows of chroma.
#[test]
fn interpolation_does_not_shift_rows() {
    let formats = raw_formats().filter(|f| f.is_yuv() || matches!(f, PixelFormat::Bayer(..)));
    for format in formats {
        for (k, channel) in colours().into_iter().enumerate() {
            for phase in 0..8 {
                let centre_px = 20.0 + 0.25 * f64::from(phase);
                // Tilted a little: rounding to whole levels averages out.
                let image = expose(format, 64, 41, |row, column| {
                    let z = (row as f64 - centre_px - 0.03 * (column as f64 - 31.5)) / 1.6;
                    let mut rgb = [0.0; 3];
                    rgb[k] = 0.95 * (-0.5 * z * z).exp();
                    rgb
                });
                let off = row_px(&image.to_grey(&of(channel)).unwrap()) - centre_px;
                assert!(
                    off.abs() < 0.01,
                    "{format:?} {channel:?} at {centre_px}: {off}"
                );
            }
        }
    }
}

#[test]
fn deep_samples_are_rounded_to_the_nearest_level() {
    for (format, bits) in [
        (PixelFormat::Y10, 10),
        (PixelFormat::Y12, 12),
        (PixelFormat::Y16, 16),
    ] {
        let max = (1u32 << bits) - 1;
        let step = max.div_ceil(4000).max(1);
        let samples: Vec<u16> = (0..=max).step_by(step as usize).map(|s| s as u16).collect();
        let data = samples.iter().flat_map(|s| s.to_le_bytes()).collect();
        let image = frame(format, (samples.len() as u32, 1), 0, data);
        let grey = image.to_grey(&GreyRule::default()).unwrap();
        let errors = samples
            .iter()
            .zip(&grey.pixels)
            .map(|(sample, level)| f64::from(*level) - f64::from(*sample) * 255.0 / f64::from(max));
        let (mut mean, mut square, mut worst) = (0.0, 0.0, 0.0f64);
        let n = samples.len() as f64;
        for error in errors {
            mean += error / n;
            square += error * error / n;
            worst = worst.max(error.abs());
        }
        assert!(
            worst <= 0.5 + 1e-9 && mean.abs() < 0.01,
            "{format:?}: {worst} {mean}"
        );
        // Uniform over one level: 1/sqrt(12).
        assert!(
            (square.sqrt() - 0.2887).abs() < 0.01,
            "{format:?}: {}",
            square.sqrt()
        );
        assert_eq!((grey.pixels[0], grey.pixels.last()), (0, Some(&255)));
    }
    // 12 bits in a container of 16, and what is beyond them is clipped.
    let data = [0u16, 2048, 4095, 4096, 65535]
        .iter()
        .flat_map(|s| s.to_le_bytes());
    let image = frame(PixelFormat::Y16, (5, 1), 0, data.collect());
    let rule = GreyRule {
        bits: Some(12),
        ..GreyRule::default()
    };
    assert_eq!(
        image.to_grey(&rule).unwrap().pixels,
        [0, 128, 255, 255, 255]
    );
}

#[test]
fn packed_colours_have_the_luma_of_decoded_ones() {
    let bytes: Vec<u8> = (0..768u32).map(|i| (i * 7919 % 256) as u8).collect();
    let image = frame(PixelFormat::Rgb24, (16, 16), 0, bytes.clone());
    let decoded = image::RgbImage::from_raw(16, 16, bytes).unwrap();
    let theirs = image::DynamicImage::from(decoded).into_luma8().into_raw();
    assert_eq!(image.to_grey(&GreyRule::default()).unwrap().pixels, theirs);
}

#[test]
fn yuv_is_converted_by_its_range() {
    // BT.601 red: limited 81 90 240, full 76 85 255.
    for (range, [y, u, v]) in [
        (YuvRange::Limited, [81, 90, 240]),
        (YuvRange::Full, [76, 85, 255]),
    ] {
        for (format, data) in [
            (PixelFormat::Yuyv, vec![y, u, y, v]),
            (PixelFormat::Uyvy, vec![u, y, v, y]),
            (PixelFormat::Nv12, vec![y, y, u, v]),
        ] {
            let image = frame(format, (2, 1), 0, data);
            for (channel, wanted) in colours().into_iter().zip([255u8, 0, 0]) {
                let rule = GreyRule {
                    channel,
                    bits: None,
                    yuv_range: range,
                };
                for level in image.to_grey(&rule).unwrap().pixels {
                    assert!(
                        level.abs_diff(wanted) <= 2,
                        "{format:?} {range:?} {channel:?}: {level}"
                    );
                }
            }
        }
    }
}

fn png(image: impl Into<image::DynamicImage>) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    image
        .into()
        .write_to(&mut bytes, image::ImageFormat::Png)
        .unwrap();
    bytes.into_inner()
}

#[test]
fn png_of_16_bits_is_read_by_the_bits_it_is_said_to_have() {
    type Deep = image::ImageBuffer<image::Luma<u16>, Vec<u16>>;
    let bytes = png(Deep::from_raw(4, 1, vec![0, 2048, 4095, 65535]).unwrap());
    let read = |bits| {
        let rule = GreyRule {
            bits,
            ..GreyRule::default()
        };
        read_still(&bytes, &rule).unwrap().pixels
    };
    assert_eq!(read(None), [0, 8, 16, 255]);
    assert_eq!(read(Some(12)), [0, 128, 255, 255]);
    // The same bytes as a log's compressed image.
    let logged = frame(PixelFormat::Png, (4, 1), 0, bytes.clone());
    assert_eq!(
        logged.to_grey(&GreyRule::default()).unwrap().pixels,
        [0, 8, 16, 255]
    );

    type DeepColour = image::ImageBuffer<image::Rgb<u16>, Vec<u16>>;
    let colour = png(DeepColour::from_raw(1, 1, vec![4095, 2048, 0]).unwrap());
    let rule = GreyRule {
        channel: Channel::Green,
        bits: Some(12),
        ..GreyRule::default()
    };
    assert_eq!(read_still(&colour, &rule).unwrap().pixels, [128]);
    let plain = png(image::RgbImage::from_raw(1, 1, vec![9, 200, 7]).unwrap());
    assert_eq!(read_still(&plain, &rule).unwrap().pixels, [200]);
    let words = read_still(b"II*\0 a TIFF", &rule).unwrap_err().to_string();
    assert!(words.contains("PNG (8 or 16 bit) and JPEG"), "{words}");
}

#[test]
fn a_laser_that_clips_its_own_channel_is_noticed_in_luma() {
    for format in raw_formats() {
        let image = expose(format, 8, 12, |row, _| {
            [0.1, if (4..8).contains(&row) { 1.0 } else { 0.2 }, 0.1]
        });
        let hidden = image.hidden_clipping(&GreyRule::default()).unwrap();
        let Some(hidden) = hidden else {
            assert!(!format.has_colour(), "{format:?}");
            continue;
        };
        assert_eq!(hidden.channel, Channel::Green, "{format:?}");
        assert!(hidden.pixels >= 4, "{format:?}: {}", hidden.pixels);
        assert_eq!(image.hidden_clipping(&of(Channel::Green)).unwrap(), None);
        // Clipping that the luma hides shows in the channel.
        let top = |rule| image.to_grey(&rule).unwrap().pixels.into_iter().max();
        assert!(top(GreyRule::default()) < Some(254), "{format:?}");
        assert!(top(of(Channel::Green)) >= Some(254), "{format:?}");
    }
}

proptest! {
    #[test]
    fn random_bytes_give_an_image_or_an_error(
        kind in 0usize..29,
        (w, h, stride) in prop_oneof![
            (0u32..20, 0u32..20, 0u32..100),
            (any::<u32>(), any::<u32>(), any::<u32>()),
        ],
        data in prop::collection::vec(any::<u8>(), 0..2000),
        channel in prop::sample::select(vec![Channel::Luma, Channel::Red, Channel::Green, Channel::Blue]),
        bits in prop::option::of(any::<u8>()),
    ) {
        let format = PixelFormat::of_cameras().nth(kind).unwrap_or(PixelFormat::Png);
        let image = frame(format, (w, h), stride, data.clone());
        let rule = GreyRule { channel, bits, yuv_range: YuvRange::Full };
        if let Ok(grey) = image.to_grey(&rule) {
            prop_assert_eq!(grey.pixels.len(), (w * h) as usize);
        }
        let _ = image.hidden_clipping(&rule);
        let _ = read_still(&data, &rule);
    }
}
