use super::*;
use proptest::prelude::*;

/// Writes what ROS 2 writes.
pub(crate) struct Writer {
    pub bytes: Vec<u8>,
    big: bool,
}

impl Writer {
    pub(crate) fn new(big: bool) -> Self {
        let bytes = vec![0, u8::from(!big), 0, 0];
        Self { bytes, big }
    }
    pub(crate) fn u32(&mut self, value: u32) {
        while !self.bytes.len().is_multiple_of(4) {
            self.bytes.push(0);
        }
        self.bytes.extend(match self.big {
            true => value.to_be_bytes(),
            false => value.to_le_bytes(),
        });
    }
    pub(crate) fn text(&mut self, text: &str) {
        self.u32(text.len() as u32 + 1);
        self.bytes.extend(text.bytes().chain([0]));
    }
    pub(crate) fn blob(&mut self, data: &[u8]) {
        self.u32(data.len() as u32);
        self.bytes.extend(data);
    }
}

pub(crate) fn written(
    big: bool,
    encoding: &str,
    (w, h, step): (u32, u32, u32),
    data: &[u8],
) -> Vec<u8> {
    let mut out = Writer::new(big);
    out.u32(1_760_000_000);
    out.u32(40_000_000);
    // A length that leaves the next field unaligned.
    out.text("camera");
    out.u32(h);
    out.u32(w);
    out.text(encoding);
    out.bytes.push(u8::from(big));
    out.u32(step);
    out.blob(data);
    out.bytes
}

#[test]
fn images_of_either_byte_order_are_read() {
    for big in [false, true] {
        let sample = |v: u16| {
            if big {
                v.to_be_bytes()
            } else {
                v.to_le_bytes()
            }
        };
        let data: Vec<u8> = [1u16, 258].into_iter().flat_map(sample).collect();
        let bytes = Bytes::from(written(big, "mono16", (2, 1, 4), &data));
        let ImageMessage::Raw(raw) = image(&bytes).unwrap() else {
            panic!("not raw");
        };
        assert_eq!((raw.width, raw.height, raw.step), (2, 1, 4));
        assert_eq!(
            (raw.encoding.as_str(), raw.frame_id.as_str()),
            ("mono16", "camera")
        );
        assert_eq!(raw.data[..], [1, 0, 2, 1]);
        assert_eq!(
            raw.timestamp,
            Some(Timestamp::new(1_760_000_000, 40_000_000))
        );
    }
    let mut out = Writer::new(false);
    out.u32(0);
    out.u32(0);
    out.text("");
    out.text("rgb8; jpeg compressed bgr8");
    out.blob(&[1, 2, 3]);
    let ImageMessage::Compressed(found) = compressed(&Bytes::from(out.bytes)).unwrap() else {
        panic!("not compressed");
    };
    // A stamp that nobody set is none.
    assert_eq!((found.timestamp, found.data.len()), (None, 3));
    assert_eq!(found.format, "rgb8; jpeg compressed bgr8");
}

#[test]
fn a_forged_length_and_every_cut_are_errors() {
    let whole = written(false, "mono8", (3, 2, 3), &[7; 6]);
    for cut in 0..whole.len() {
        let error = image(&Bytes::copy_from_slice(&whole[..cut])).unwrap_err();
        assert!(matches!(error, CdrError::Short { .. }), "{cut}: {error}");
    }
    let mut forged = whole.clone();
    let at = forged.len() - 10;
    forged[at..at + 4].copy_from_slice(&u32::MAX.to_le_bytes());
    let words = image(&Bytes::from(forged)).unwrap_err().to_string();
    assert!(words.contains("data needs 4294967295 bytes"), "{words}");
    let xml = Bytes::from_static(b"<xml>");
    assert_eq!(image(&xml).unwrap_err(), CdrError::Kind(b'<', b'x'));
}

proptest! {
    #[test]
    fn random_bytes_are_a_message_or_an_error(mut bytes in prop::collection::vec(any::<u8>(), 0..200), kind in 0u8..3) {
        if let (Some(head), true) = (bytes.first_chunk_mut::<2>(), kind < 2) {
            *head = [0, kind];
        }
        let bytes = Bytes::from(bytes);
        for read in [image(&bytes), compressed(&bytes)] {
            match read {
                Ok(ImageMessage::Raw(raw)) => prop_assert!(raw.data.len() <= bytes.len()),
                Ok(ImageMessage::Compressed(c)) => prop_assert!(c.data.len() <= bytes.len()),
                Err(_) => {}
            }
        }
    }

    #[test]
    fn flipped_bytes_never_panic(at in 0usize..80, value in any::<u8>()) {
        let mut bytes = written(false, "bayer_rggb8", (4, 4, 4), &[9; 16]);
        let at = at % bytes.len();
        bytes[at] = value;
        let _ = image(&Bytes::from(bytes));
    }
}
