//! Is a buffer a frame? Damaged ones are kept, marked, and excluded from analysis.

use hydroline_rigs::PixelFormat;

use super::device::{BufferInfo, PixFormat};
use super::stamp::flags;
use hydroline_core::frame::{FrameFault, JpegDamage, WholeJpeg};

/// A buffer that the driver gave back without a frame in it (EPIPE on the endpoint): no bytes, no stamp, no number.
pub fn is_void(info: &BufferInfo) -> bool {
    info.flags & flags::ERROR != 0 && info.bytes_used == 0 && info.stamp_ns == 0
}

/// Gravest fault that flags and length show, at no cost; `None` = they show none.
pub fn fault(
    kind: PixelFormat,
    format: &PixFormat,
    info: &BufferInfo,
    bytes: usize,
    stale: bool,
) -> Option<FrameFault> {
    if info.flags & flags::ERROR != 0 {
        return Some(FrameFault::DriverError);
    }
    if kind != PixelFormat::Mjpg {
        let needed = kind.image_bytes(format.width_px, format.height_px, format.stride_bytes);
        if (bytes as u64) < needed {
            return Some(FrameFault::Truncated);
        }
    }
    stale.then_some(FrameFault::Stale)
}

/// Damage of a frame's JPEG on its own; what does not fit within it is seen where it is unpacked. All of its codes are
/// decoded, some milliseconds of a large frame: not while the driver waits for the buffer.
pub fn jpeg_damage(kind: PixelFormat, data: &[u8]) -> Option<JpegDamage> {
    match kind {
        PixelFormat::Mjpg => WholeJpeg::of(data).err(),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GREY: PixFormat = PixFormat {
        fourcc: *b"GREY",
        width_px: 4,
        height_px: 2,
        stride_bytes: 6,
        size_bytes: 12,
        field: 1,
        memory_planes: 1,
        full_range: false,
    };

    fn info(flag_bits: u32) -> BufferInfo {
        BufferInfo {
            flags: flag_bits,
            stamp_ns: 1,
            ..BufferInfo::default()
        }
    }

    #[test]
    fn raw_frames_need_their_last_pixel_but_not_the_padding_behind_it() {
        let whole = |n: usize| fault(PixelFormat::Grey, &GREY, &info(0), n, false);
        assert_eq!(
            (whole(9), whole(10), whole(12)),
            (Some(FrameFault::Truncated), None, None)
        );
    }

    #[test]
    fn jpegs_need_all_their_data_and_nothing_behind_their_end() {
        let of = |data: &[u8]| jpeg_damage(PixelFormat::Mjpg, data);
        assert_eq!(jpeg_damage(PixelFormat::Grey, &[1, 2]), None);
        let jpeg = crate::v4l::tests::fake_kernel::jpeg();
        let (head, tail) = jpeg.split_at(jpeg.len() - 2);
        assert_eq!(of(&jpeg), None);
        // Cameras pad, some with what the buffer held before.
        assert_eq!(of(&[&jpeg[..], &[0, 0]].concat()), None);
        assert_eq!(of(&[&jpeg[..], &[7, 0xff, 9]].concat()), None);
        for bad in [
            &[][..],
            &[0xff, 0xd8],
            &[0xff, 0xd8, 1, 2, 0xff, 0xd9],
            &[0xff, 0xd9],
            &[0; 4],
            head,
            tail,
            &[&[0], &jpeg[..]].concat(),
            &[&head[..head.len() - 9], tail].concat(),
        ] {
            assert!(of(bad).is_some(), "{bad:?}");
        }
    }

    #[test]
    fn the_drivers_word_comes_first() {
        assert_eq!(
            fault(PixelFormat::Grey, &GREY, &info(flags::ERROR), 0, true),
            Some(FrameFault::DriverError)
        );
        assert_eq!(
            fault(PixelFormat::Grey, &GREY, &info(0), 12, true),
            Some(FrameFault::Stale)
        );
        assert!(is_void(&BufferInfo {
            flags: flags::ERROR,
            ..BufferInfo::default()
        }));
        assert!(!is_void(&info(flags::ERROR)) && !is_void(&BufferInfo::default()));
    }
}
