//! `sensor_msgs/msg/Image` and `sensor_msgs/msg/CompressedImage` of ROS 2, as the messages of Foxglove that they are.

use bytes::Bytes;
use foxglove::messages::{CompressedImage, RawImage, Timestamp};

use super::ImageMessage;
use super::cdr::{Cdr, CdrError};
use super::encodings::encoded;

/// `std_msgs/msg/Header`; a stamp of zero is none.
fn header(cdr: &mut Cdr) -> Result<(Option<Timestamp>, String), CdrError> {
    let seconds = cdr.u32("header.stamp.sec")?;
    let nanoseconds = cdr.u32("header.stamp.nanosec")?;
    let frame_id = cdr.text("header.frame_id")?;
    let said = (seconds, nanoseconds) != (0, 0) && nanoseconds < 1_000_000_000;
    Ok((said.then(|| Timestamp::new(seconds, nanoseconds)), frame_id))
}

/// `sensor_msgs/msg/Image`.
pub(crate) fn image(message: &Bytes) -> Result<ImageMessage, CdrError> {
    let mut cdr = Cdr::new(message)?;
    let (timestamp, frame_id) = header(&mut cdr)?;
    let height = cdr.u32("height")?;
    let width = cdr.u32("width")?;
    let encoding = cdr.text("encoding")?;
    let big_endian = cdr.u8("is_bigendian")? != 0;
    let step = cdr.u32("step")?;
    let mut data = cdr.blob("data")?;
    // Frames hold little endian.
    if big_endian && encoded(&encoding).is_some_and(|format| format.bits() > 8) {
        let swapped: Vec<u8> = data.chunks_exact(2).flat_map(|b| [b[1], b[0]]).collect();
        data = Bytes::from(swapped);
    }
    Ok(ImageMessage::Raw(RawImage {
        timestamp,
        frame_id,
        width,
        height,
        encoding,
        step,
        data,
    }))
}

/// `sensor_msgs/msg/CompressedImage`.
pub(crate) fn compressed(message: &Bytes) -> Result<ImageMessage, CdrError> {
    let mut cdr = Cdr::new(message)?;
    let (timestamp, frame_id) = header(&mut cdr)?;
    let format = cdr.text("format")?;
    let data = cdr.blob("data")?;
    Ok(ImageMessage::Compressed(CompressedImage {
        timestamp,
        frame_id,
        data,
        format,
    }))
}

#[cfg(test)]
pub(crate) mod tests;
