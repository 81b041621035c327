//! Pixel formats: their names here, at V4L2 and in bytes, in one place for everything that captures, logs and reads them.

/// Bytes of the largest frame that is recorded and read again: 8192 x 8192 pixels of one byte, twice what sensors of
/// machine vision have. Rigs, the log's writer and its readers know this one limit.
pub const FRAME_BYTES_MAX: u64 = 64 << 20;

/// Order of the colours of a Bayer mosaic, named by its first four pixels: two of the first row, two of the second.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum BayerOrder {
    /// Red first, blue on the diagonal.
    Rggb,
    /// Green first, then red.
    Grbg,
    /// Green first, then blue.
    Gbrg,
    /// Blue first, red on the diagonal.
    Bggr,
}

impl BayerOrder {
    /// Row and column of the red sample in each block of 2 x 2; the blue one stands on the diagonal.
    pub fn red_at(self) -> (usize, usize) {
        match self {
            BayerOrder::Rggb => (0, 0),
            BayerOrder::Grbg => (0, 1),
            BayerOrder::Gbrg => (1, 0),
            BayerOrder::Bggr => (1, 1),
        }
    }
}

/// Bits of a Bayer sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum BayerDepth {
    /// One byte.
    Eight,
    /// 10 bits, right-aligned in 16, little endian.
    Ten,
    /// 12 bits, right-aligned in 16, little endian.
    Twelve,
    /// 16 bits, little endian.
    Sixteen,
}

/// Pixel formats that are read. Samples of more than 8 bits stand right-aligned in 16, little endian, as V4L2 defines.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum PixelFormat {
    /// 8-bit grey.
    Grey,
    /// 10-bit grey.
    Y10,
    /// 12-bit grey.
    Y12,
    /// 16-bit grey.
    Y16,
    /// Y'CbCr 4:2:2 packed, luma first.
    Yuyv,
    /// Y'CbCr 4:2:2 packed, chroma first.
    Uyvy,
    /// Y'CbCr 4:2:0, the plane of luma followed by the one of interleaved chroma.
    Nv12,
    /// 8-bit red, green, blue.
    Rgb24,
    /// 8-bit blue, green, red.
    Bgr24,
    /// 8-bit red, green, blue and a byte that is not looked at.
    Rgba32,
    /// 8-bit blue, green, red and a byte that is not looked at.
    Bgra32,
    /// A colour filter's raw mosaic.
    Bayer(BayerOrder, BayerDepth),
    /// Motion JPEG.
    Mjpg,
    /// PNG: of logs made elsewhere; no camera delivers it.
    Png,
}

/// Format, name in rigs and logs, V4L2's four characters.
type Row = (PixelFormat, &'static str, [u8; 4]);

/// Every format of a camera.
const TABLE: [Row; 28] = {
    use BayerDepth::{Eight, Sixteen, Ten, Twelve};
    use BayerOrder::{Bggr, Gbrg, Grbg, Rggb};
    use PixelFormat as P;
    [
        (P::Grey, "GREY", *b"GREY"),
        (P::Y10, "Y10", *b"Y10 "),
        (P::Y12, "Y12", *b"Y12 "),
        (P::Y16, "Y16", *b"Y16 "),
        (P::Yuyv, "YUYV", *b"YUYV"),
        (P::Uyvy, "UYVY", *b"UYVY"),
        (P::Nv12, "NV12", *b"NV12"),
        (P::Rgb24, "RGB24", *b"RGB3"),
        (P::Bgr24, "BGR24", *b"BGR3"),
        (P::Rgba32, "RGBA32", *b"AB24"),
        (P::Bgra32, "BGRA32", *b"AR24"),
        (P::Mjpg, "MJPG", *b"MJPG"),
        (P::Bayer(Rggb, Eight), "RGGB8", *b"RGGB"),
        (P::Bayer(Grbg, Eight), "GRBG8", *b"GRBG"),
        (P::Bayer(Gbrg, Eight), "GBRG8", *b"GBRG"),
        (P::Bayer(Bggr, Eight), "BGGR8", *b"BA81"),
        (P::Bayer(Rggb, Ten), "RGGB10", *b"RG10"),
        (P::Bayer(Grbg, Ten), "GRBG10", *b"BA10"),
        (P::Bayer(Gbrg, Ten), "GBRG10", *b"GB10"),
        (P::Bayer(Bggr, Ten), "BGGR10", *b"BG10"),
        (P::Bayer(Rggb, Twelve), "RGGB12", *b"RG12"),
        (P::Bayer(Grbg, Twelve), "GRBG12", *b"BA12"),
        (P::Bayer(Gbrg, Twelve), "GBRG12", *b"GB12"),
        (P::Bayer(Bggr, Twelve), "BGGR12", *b"BG12"),
        (P::Bayer(Rggb, Sixteen), "RGGB16", *b"RG16"),
        (P::Bayer(Grbg, Sixteen), "GRBG16", *b"GR16"),
        (P::Bayer(Gbrg, Sixteen), "GBRG16", *b"GB16"),
        (P::Bayer(Bggr, Sixteen), "BGGR16", *b"BYR2"),
    ]
};

impl PixelFormat {
    /// The formats that a camera may deliver.
    pub fn of_cameras() -> impl Iterator<Item = PixelFormat> {
        TABLE.into_iter().map(|(format, ..)| format)
    }

    fn row(self) -> Option<Row> {
        TABLE.into_iter().find(|(format, ..)| *format == self)
    }

    /// Name in rigs and logs.
    pub fn name(self) -> &'static str {
        self.row().map_or("PNG", |(_, name, _)| name)
    }

    /// V4L2's four characters.
    pub fn fourcc(self) -> [u8; 4] {
        self.row().map_or(*b"PNG ", |(_, _, code)| code)
    }

    /// The format of V4L2's four characters, if it is read.
    pub fn of_fourcc(code: [u8; 4]) -> Option<PixelFormat> {
        let row = TABLE.into_iter().find(|(.., c)| *c == code);
        row.map(|(format, ..)| format)
    }

    /// Whether a frame's size in bytes does not follow from its size in pixels.
    pub fn is_compressed(self) -> bool {
        matches!(self, PixelFormat::Mjpg | PixelFormat::Png)
    }

    /// Whether it distinguishes colours (a compressed image may or may not).
    pub fn has_colour(self) -> bool {
        !matches!(
            self,
            PixelFormat::Grey | PixelFormat::Y10 | PixelFormat::Y12 | PixelFormat::Y16
        )
    }

    /// Whether its colour is a difference to luma (Y'CbCr).
    pub fn is_yuv(self) -> bool {
        matches!(
            self,
            PixelFormat::Yuyv | PixelFormat::Uyvy | PixelFormat::Nv12
        )
    }

    /// Bits of a sample; of a PNG, those it has at most.
    pub fn bits(self) -> u8 {
        match self {
            PixelFormat::Y10 | PixelFormat::Bayer(_, BayerDepth::Ten) => 10,
            PixelFormat::Y12 | PixelFormat::Bayer(_, BayerDepth::Twelve) => 12,
            PixelFormat::Y16 | PixelFormat::Png | PixelFormat::Bayer(_, BayerDepth::Sixteen) => 16,
            _ => 8,
        }
    }

    /// Whether a pixel must have a neighbour: colour is shared by the two of a pair.
    pub fn pairs_columns(self) -> bool {
        self.is_yuv()
    }

    /// Whether a row must have a neighbour.
    pub fn pairs_rows(self) -> bool {
        self == PixelFormat::Nv12
    }

    /// Bytes of a row's pixels without padding; 0 for compressed formats. Fits for any width.
    pub fn row_bytes(self, width_px: u32) -> u64 {
        let w = u64::from(width_px);
        match self {
            PixelFormat::Grey | PixelFormat::Bayer(_, BayerDepth::Eight) => w,
            // A chroma pair stands below the last column, even of an odd width.
            PixelFormat::Nv12 => w.next_multiple_of(2),
            PixelFormat::Y10
            | PixelFormat::Y12
            | PixelFormat::Y16
            | PixelFormat::Yuyv
            | PixelFormat::Uyvy
            | PixelFormat::Bayer(..) => 2 * w,
            PixelFormat::Rgb24 | PixelFormat::Bgr24 => 3 * w,
            PixelFormat::Rgba32 | PixelFormat::Bgra32 => 4 * w,
            PixelFormat::Mjpg | PixelFormat::Png => 0,
        }
    }

    /// Rows of memory of an image: NV12's plane of chroma stands below its plane of luma.
    pub fn memory_rows(self, height_px: u32) -> u64 {
        let h = u64::from(height_px);
        match self {
            PixelFormat::Nv12 => h + h.div_ceil(2),
            _ => h,
        }
    }

    /// Bytes of an image up to its last pixel, with rows of `stride_bytes`, or of their pixels where these are more.
    pub fn image_bytes(self, width_px: u32, height_px: u32, stride_bytes: u32) -> u64 {
        let row = self.row_bytes(width_px);
        let stride = u64::from(stride_bytes).max(row);
        let before = self.memory_rows(height_px).saturating_sub(1);
        // The last row's padding need not be there.
        stride.saturating_mul(before).saturating_add(row)
    }

    /// Bytes that a camera's image of this size counts for against [`FRAME_BYTES_MAX`]: its own, of a compressed one those
    /// of its pixels as grey levels, which it unpacks to.
    pub fn counted_bytes(self, width_px: u32, height_px: u32) -> u64 {
        match self.is_compressed() {
            true => u64::from(width_px) * u64::from(height_px),
            false => self.image_bytes(width_px, height_px, 0),
        }
    }
}

/// Part of the light that the grey image shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Channel {
    /// Brightness: the camera's own luma, or Rec. 709's weights over red, green and blue.
    #[default]
    Luma,
    /// Red channel of a colour camera.
    Red,
    /// Green channel of a colour camera.
    Green,
    /// Blue channel of a colour camera.
    Blue,
}

impl Channel {
    /// With their names, in the order of the declaration.
    pub const ALL: [(&'static str, Channel); 4] = [
        ("luma", Channel::Luma),
        ("red", Channel::Red),
        ("green", Channel::Green),
        ("blue", Channel::Blue),
    ];

    /// Name in rigs and on the command line.
    pub fn name(self) -> &'static str {
        Channel::ALL[self as usize].0
    }
}

/// Levels that Y'CbCr takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum YuvRange {
    /// Luma 16 to 235, chroma 16 to 240 (BT.601).
    #[default]
    Limited,
    /// 0 to 255 (JPEG).
    Full,
}

impl YuvRange {
    /// With their names, in the order of the declaration.
    pub const ALL: [(&'static str, YuvRange); 2] =
        [("limited", YuvRange::Limited), ("full", YuvRange::Full)];

    /// Name in rigs.
    pub fn name(self) -> &'static str {
        YuvRange::ALL[self as usize].0
    }
}

/// Rule by which grey levels come out of a frame: one for all frames of a stream, never guessed from a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct GreyRule {
    /// Channel that becomes the grey level.
    pub channel: Channel,
    /// Bits that samples of 16 really have, right-aligned; `None` = what the format says.
    pub bits: Option<u8>,
    /// Levels of Y'CbCr; only channels ask for it.
    pub yuv_range: YuvRange,
}

impl GreyRule {
    /// Bits of a format's samples: 16 may hold fewer.
    pub fn bits_of(&self, format: PixelFormat) -> u8 {
        match format.bits() {
            16 => self.bits.unwrap_or(16).clamp(8, 16),
            fixed => fixed,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_codes_are_each_of_one_format() {
        for (format, name, code) in TABLE {
            assert_eq!((format.name(), format.fourcc()), (name, code));
            assert_eq!(PixelFormat::of_fourcc(code), Some(format));
            let same = TABLE.iter().filter(|row| row.1 == name || row.2 == code);
            assert_eq!(same.count(), 1, "{name}");
        }
        assert_eq!(PixelFormat::of_fourcc(*b"pRAA"), None);
    }

    #[test]
    fn sizes_are_those_of_v4l2() {
        let bayer = |depth| PixelFormat::Bayer(BayerOrder::Rggb, depth);
        for (format, row, whole) in [
            (PixelFormat::Grey, 640, 307_200),
            (PixelFormat::Y10, 1280, 614_400),
            (PixelFormat::Y16, 1280, 614_400),
            (PixelFormat::Uyvy, 1280, 614_400),
            (PixelFormat::Nv12, 640, 460_800),
            (PixelFormat::Rgb24, 1920, 921_600),
            (PixelFormat::Bgra32, 2560, 1_228_800),
            (bayer(BayerDepth::Eight), 640, 307_200),
            (bayer(BayerDepth::Ten), 1280, 614_400),
            (PixelFormat::Mjpg, 0, 0),
        ] {
            assert_eq!(format.row_bytes(640), row, "{format:?}");
            assert_eq!(format.image_bytes(640, 480, 0), whole, "{format:?}");
        }
        // Rows of 8 bytes, the last one without its padding; a chroma row below.
        assert_eq!(PixelFormat::Grey.image_bytes(5, 3, 8), 21);
        assert_eq!(PixelFormat::Nv12.image_bytes(5, 3, 8), 8 * 4 + 6);
        // A forged size does not wrap around.
        let forged = PixelFormat::Bgra32.image_bytes(u32::MAX, u32::MAX, u32::MAX);
        assert_eq!(forged, u64::MAX);
    }

    #[test]
    fn only_samples_of_16_bits_may_hold_fewer() {
        let rule = GreyRule {
            bits: Some(12),
            ..GreyRule::default()
        };
        assert_eq!(rule.bits_of(PixelFormat::Y16), 12);
        assert_eq!(rule.bits_of(PixelFormat::Y10), 10);
        assert_eq!(rule.bits_of(PixelFormat::Grey), 8);
        assert_eq!(GreyRule::default().bits_of(PixelFormat::Y16), 16);
    }
}
