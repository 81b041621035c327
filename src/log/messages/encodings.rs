//! Names of pixel formats in image messages: Foxglove's and those of ROS 2 (`sensor_msgs/image_encodings.hpp`).
//!
//! Neither has a name for samples of 10 and 12 bits in 16. They are written as `mono10`, `mono12`, `bayer_rggb10` and so
//! on: viewers do not show them, and nobody takes them for full 16 bits.

use hydroline_rigs::{BayerDepth, BayerOrder, PixelFormat};

/// Encodings that are read, for errors.
pub(super) const READ: &str = "mono8, mono10, mono12, mono16, 8UC1, 8UC3, 8UC4, 16UC1, yuyv, yuv422_yuy2, uyvy, yuv422, nv12, \
     rgb8, bgr8, rgba8, bgra8, bayer_rggb8 to bayer_bggr16, jpeg and png";

/// The name that is written.
pub(super) fn encoding(format: PixelFormat) -> &'static str {
    use BayerDepth::{Eight, Sixteen, Ten, Twelve};
    use BayerOrder::{Bggr, Gbrg, Grbg, Rggb};
    match format {
        PixelFormat::Grey => "mono8",
        PixelFormat::Y10 => "mono10",
        PixelFormat::Y12 => "mono12",
        PixelFormat::Y16 => "mono16",
        PixelFormat::Yuyv => "yuyv",
        PixelFormat::Uyvy => "uyvy",
        PixelFormat::Nv12 => "nv12",
        PixelFormat::Rgb24 => "rgb8",
        PixelFormat::Bgr24 => "bgr8",
        PixelFormat::Rgba32 => "rgba8",
        PixelFormat::Bgra32 => "bgra8",
        PixelFormat::Mjpg => "jpeg",
        PixelFormat::Png => "png",
        PixelFormat::Bayer(order, depth) => match (order, depth) {
            (Rggb, Eight) => "bayer_rggb8",
            (Grbg, Eight) => "bayer_grbg8",
            (Gbrg, Eight) => "bayer_gbrg8",
            (Bggr, Eight) => "bayer_bggr8",
            (Rggb, Ten) => "bayer_rggb10",
            (Grbg, Ten) => "bayer_grbg10",
            (Gbrg, Ten) => "bayer_gbrg10",
            (Bggr, Ten) => "bayer_bggr10",
            (Rggb, Twelve) => "bayer_rggb12",
            (Grbg, Twelve) => "bayer_grbg12",
            (Gbrg, Twelve) => "bayer_gbrg12",
            (Bggr, Twelve) => "bayer_bggr12",
            (Rggb, Sixteen) => "bayer_rggb16",
            (Grbg, Sixteen) => "bayer_grbg16",
            (Gbrg, Sixteen) => "bayer_gbrg16",
            (Bggr, Sixteen) => "bayer_bggr16",
        },
    }
}

/// The format of an uncompressed image's name; OpenCV's `8UC3` and `8UC4` are blue first.
pub(super) fn encoded(name: &str) -> Option<PixelFormat> {
    Some(match name {
        "8UC1" => PixelFormat::Grey,
        "16UC1" => PixelFormat::Y16,
        "yuv422_yuy2" => PixelFormat::Yuyv,
        "yuv422" => PixelFormat::Uyvy,
        "8UC3" => PixelFormat::Bgr24,
        "8UC4" => PixelFormat::Bgra32,
        _ => PixelFormat::of_cameras().find(|f| !f.is_compressed() && encoding(*f) == name)?,
    })
}

/// The format of a compressed image's name: a word of Foxglove's, or image_transport's `bgr8; jpeg compressed bgr8`.
pub(crate) fn compression(name: &str) -> Option<PixelFormat> {
    // Depth images have a head of their own before the PNG.
    let words = name.to_ascii_lowercase();
    match () {
        () if words.contains("compresseddepth") => None,
        () if words.contains("jpeg") || words.contains("jpg") => Some(PixelFormat::Mjpg),
        () if words.contains("png") => Some(PixelFormat::Png),
        () => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_format_is_read_back_from_its_name() {
        for format in PixelFormat::of_cameras().chain([PixelFormat::Png]) {
            let name = encoding(format);
            let back = if format.is_compressed() {
                compression(name)
            } else {
                encoded(name)
            };
            assert_eq!(back, Some(format), "{name}");
        }
        for (name, format) in [
            ("bgr8; jpeg compressed bgr8", Some(PixelFormat::Mjpg)),
            ("mono16; png compressed ", Some(PixelFormat::Png)),
            ("16UC1; compressedDepth png", None),
            ("webp", None),
        ] {
            assert_eq!(compression(name), format, "{name}");
        }
        assert_eq!(encoded("32FC1"), None);
        assert_eq!(encoded("jpeg"), None);
    }
}
