//! Room that a recording takes, in one place for everything that reports or checks it.

use hydroline_rigs::Camera;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

/// Whether a log can be made in the folder `dir`; if not, why, with what to do.
pub fn writable_folder(dir: &Path) -> Result<(), String> {
    let shown = dir.display();
    match std::fs::metadata(dir) {
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => {
            return Err(format!("{shown}: there is no such folder; create it first"));
        }
        Err(e) => return Err(format!("{shown}: {e}; name another folder")),
        Ok(found) if !found.is_dir() => {
            return Err(format!("{shown}: is a file, not a folder; name the folder"));
        }
        Ok(_) => {}
    }
    // Tried, not queried: rights alone do not show a disk that is mounted read-only.
    // A name of its own for each trial: several results of one command are begun side by side.
    static TRIALS: AtomicU64 = AtomicU64::new(0);
    let trial = dir.join(format!(
        ".hydroline-trial-{}-{}",
        std::process::id(),
        TRIALS.fetch_add(1, Ordering::Relaxed)
    ));
    let made = std::fs::OpenOptions::new()
        .write(true)
        .create_new(true)
        .open(&trial);
    match made {
        Ok(_) => {
            std::fs::remove_file(&trial).ok();
            Ok(())
        }
        Err(why) => Err(format!(
            "{shown}: cannot be written to ({why}); name another folder or give yourself the right"
        )),
    }
}

/// A very good JPEG takes 4 bits for a pixel.
const COMPRESSED_BYTES_PER_PX: f64 = 0.5;

/// Bytes of one frame \[byte\], at most: as it comes from the camera, since what compression saves
/// is not guaranteed. What a format takes is V4L2's; a compressed one has no size of its own.
pub fn bytes_per_frame(camera: &Camera) -> f64 {
    if camera.pixel_format.is_compressed() {
        let pixels = f64::from(camera.width_px) * f64::from(camera.height_px);
        return pixels * COMPRESSED_BYTES_PER_PX;
    }
    camera
        .pixel_format
        .image_bytes(camera.width_px, camera.height_px, 0) as f64
}

/// Bytes of one second of frames \[byte/s\], at most.
pub fn bytes_per_s(camera: &Camera) -> f64 {
    bytes_per_frame(camera) * camera.rate_fps
}

#[cfg(test)]
mod tests {
    use super::*;
    use hydroline_rigs::{BayerDepth, BayerOrder, PixelFormat};

    #[test]
    fn a_folder_is_tried_by_several_at_once() {
        let dir = tempfile::tempdir().unwrap();
        std::thread::scope(|scope| {
            for _ in 0..8 {
                scope.spawn(|| {
                    for _ in 0..200 {
                        assert_eq!(writable_folder(dir.path()), Ok(()));
                    }
                });
            }
        });
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0);
    }

    #[test]
    fn a_folder_that_takes_no_log_is_reported_with_the_cure() {
        let dir = tempfile::tempdir().unwrap();
        assert_eq!(writable_folder(dir.path()), Ok(()));
        let missing = writable_folder(&dir.path().join("nowhere")).unwrap_err();
        assert!(missing.contains("create it first"), "{missing}");
        let file = dir.path().join("file");
        std::fs::write(&file, "").unwrap();
        assert!(writable_folder(&file).unwrap_err().contains("not a folder"));
        // /proc is a file system that takes no new files, not even from root.
        let refused = writable_folder(Path::new("/proc")).unwrap_err();
        assert!(refused.contains("cannot be written"), "{refused}");
    }

    #[test]
    fn a_format_takes_what_v4l2_says() {
        let mut camera = hydroline_rigs::Rig::builtin("lshpi").unwrap().camera;
        (camera.width_px, camera.height_px, camera.rate_fps) = (720, 576, 25.0);
        for (format, bytes) in [
            (PixelFormat::Grey, 414_720.0),
            (PixelFormat::Yuyv, 829_440.0),
            (PixelFormat::Nv12, 622_080.0),
            (PixelFormat::Y12, 829_440.0),
            (PixelFormat::Rgb24, 1_244_160.0),
            (
                PixelFormat::Bayer(BayerOrder::Gbrg, BayerDepth::Eight),
                414_720.0,
            ),
            (PixelFormat::Mjpg, 207_360.0),
        ] {
            camera.pixel_format = format;
            assert_eq!(bytes_per_frame(&camera), bytes);
            assert_eq!(bytes_per_s(&camera), 25.0 * bytes);
        }
    }
}
