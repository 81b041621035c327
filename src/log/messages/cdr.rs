//! The little of CDR (OMG DDS-XTypes 1.3, 7.4) that image messages of ROS 2 need, held to the bytes that are there.
//!
//! Four bytes say the byte order; what follows is aligned to its own size, counted from behind them. Strings and
//! sequences begin with their length. A length is believed only as far as the bytes reach: nothing is allocated by it.

use bytes::Bytes;

/// Reason why bytes are no such message.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum CdrError {
    #[error("CDR begins with 00 00, 00 01, 00 06 or 00 07, this with {0:02x} {1:02x}")]
    Kind(u8, u8),
    #[error("{field} needs {need} bytes at byte {at}, {have} are there")]
    Short {
        field: &'static str,
        at: usize,
        need: usize,
        have: usize,
    },
    #[error("{field} is not UTF-8")]
    Text { field: &'static str },
}

/// A message read field by field.
pub(super) struct Cdr {
    bytes: Bytes,
    at: usize,
    big_endian: bool,
}

impl Cdr {
    /// Reads the encapsulation: plain CDR or plain CDR 2, either byte order.
    pub fn new(message: &Bytes) -> Result<Self, CdrError> {
        let big_endian = match message.first_chunk::<4>() {
            Some([0, 0 | 6, ..]) => true,
            Some([0, 1 | 7, ..]) => false,
            Some([a, b, ..]) => return Err(CdrError::Kind(*a, *b)),
            None => {
                return Err(CdrError::Short {
                    field: "CDR's head",
                    at: 0,
                    need: 4,
                    have: message.len(),
                });
            }
        };
        Ok(Self {
            bytes: message.slice(4..),
            at: 0,
            big_endian,
        })
    }

    fn take(&mut self, need: usize, field: &'static str) -> Result<Bytes, CdrError> {
        let end = self
            .at
            .checked_add(need)
            .filter(|end| *end <= self.bytes.len());
        let Some(end) = end else {
            return Err(CdrError::Short {
                field,
                at: self.at,
                need,
                have: self.bytes.len().saturating_sub(self.at),
            });
        };
        let taken = self.bytes.slice(self.at..end);
        self.at = end;
        Ok(taken)
    }

    pub fn u8(&mut self, field: &'static str) -> Result<u8, CdrError> {
        Ok(self.take(1, field)?[0])
    }

    pub fn u32(&mut self, field: &'static str) -> Result<u32, CdrError> {
        self.at = self.at.next_multiple_of(4);
        let four = self.take(4, field)?;
        let four = [four[0], four[1], four[2], four[3]];
        Ok(if self.big_endian {
            u32::from_be_bytes(four)
        } else {
            u32::from_le_bytes(four)
        })
    }

    /// A sequence of bytes: a view of the message, not a copy.
    pub fn blob(&mut self, field: &'static str) -> Result<Bytes, CdrError> {
        let length = self.u32(field)? as usize;
        self.take(length, field)
    }

    /// A text; its length counts the zero at its end.
    pub fn text(&mut self, field: &'static str) -> Result<String, CdrError> {
        let bytes = self.blob(field)?;
        let text = bytes.strip_suffix(&[0]).unwrap_or(&bytes);
        let text = std::str::from_utf8(text).map_err(|_| CdrError::Text { field })?;
        Ok(text.to_owned())
    }
}
