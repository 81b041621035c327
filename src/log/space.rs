//! How much room a recording takes, in one place for everything that tells or checks it.

use hydroline_rigs::{Camera, PixelFormat};

/// Bytes of one frame \[byte\], at most: as it comes from the camera, since what compression saves
/// is not promised. GREY 1 byte/px, YUYV 4:2:2 2 byte/px (V4L2), MJPG at most 0.5 byte/px (4 bits
/// per pixel is a very good JPEG).
pub fn bytes_per_frame(camera: &Camera) -> f64 {
    let bytes_per_px = match camera.pixel_format {
        PixelFormat::Grey => 1.0,
        PixelFormat::Yuyv => 2.0,
        PixelFormat::Mjpg => 0.5,
    };
    f64::from(camera.width_px) * f64::from(camera.height_px) * bytes_per_px
}

/// Bytes of one second of frames \[byte/s\], at most.
pub fn bytes_per_s(camera: &Camera) -> f64 {
    bytes_per_frame(camera) * camera.rate_fps
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_format_takes_what_v4l2_says() {
        let mut camera = hydroline_rigs::Rig::builtin("lshpi").unwrap().camera;
        (camera.width_px, camera.height_px, camera.rate_fps) = (720, 576, 25.0);
        for (format, bytes) in [
            (PixelFormat::Grey, 414_720.0),
            (PixelFormat::Yuyv, 829_440.0),
            (PixelFormat::Mjpg, 207_360.0),
        ] {
            camera.pixel_format = format;
            assert_eq!(bytes_per_frame(&camera), bytes);
            assert_eq!(bytes_per_s(&camera), 25.0 * bytes);
        }
    }
}
