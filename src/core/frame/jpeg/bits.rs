//! Bits of coded data (T.81, F.2.2.5), up to the next marker.

use super::huffman::Table;

/// A reader of bits. Behind the last of them it gives none: what needs more is damage.
#[derive(Debug, Clone)]
pub(super) struct Bits<'a> {
    data: &'a [u8],
    /// Next byte to take.
    at: usize,
    /// Bits taken and not used, from the top; below them zeros.
    held: u64,
    count: u32,
}

/// Why a code could not be read.
pub(super) const ENDED: &str = "they end, or a marker stands among them";
const NO_CODE: &str = "a code of no symbol";

impl<'a> Bits<'a> {
    pub fn new(data: &'a [u8], at: usize) -> Self {
        Bits {
            data,
            at,
            held: 0,
            count: 0,
        }
    }

    fn fill(&mut self) {
        while self.count <= 56 {
            let byte = match (self.data.get(self.at), self.data.get(self.at + 1)) {
                (Some(0xff), Some(0)) => {
                    self.at += 2;
                    0xff
                }
                (Some(0xff) | None, _) => return,
                (Some(byte), _) => {
                    self.at += 1;
                    *byte
                }
            };
            self.held |= u64::from(byte) << (56 - self.count);
            self.count += 8;
        }
    }

    fn used(&mut self, bits: u32) -> Result<(), &'static str> {
        if bits > self.count {
            return Err(ENDED);
        }
        self.held <<= bits;
        self.count -= bits;
        Ok(())
    }

    /// Next bits as a number; at most 16.
    pub fn number(&mut self, bits: u32) -> Result<u32, &'static str> {
        if bits == 0 {
            return Ok(0);
        }
        if self.count < bits {
            self.fill();
        }
        let value = (self.held >> (64 - bits)) as u32;
        self.used(bits)?;
        Ok(value)
    }

    /// Next symbol of a table.
    pub fn symbol(&mut self, table: &Table) -> Result<u8, &'static str> {
        if self.count < 16 {
            self.fill();
        }
        let (symbol, length) = table.find((self.held >> 48) as u16).ok_or(
            // Of what is left, zeros were made.
            if self.count < 16 { ENDED } else { NO_CODE },
        )?;
        self.used(length)?;
        Ok(symbol)
    }

    /// Next value of so many bits, with its sign (T.81, F.2.2.1: RECEIVE and EXTEND).
    pub fn value(&mut self, bits: u32) -> Result<i32, &'static str> {
        let value = self.number(bits)? as i32;
        Ok(match bits {
            0 => 0,
            _ if value < 1 << (bits - 1) => value - (1 << bits) + 1,
            _ => value,
        })
    }

    /// Bits up to the end of the byte begun.
    pub fn padding(&mut self) -> Result<Padding, &'static str> {
        self.fill();
        let bits = self.count % 8;
        let value = self.number(bits)?;
        Ok(match value {
            _ if bits == 0 || value == (1 << bits) - 1 => Padding::Ones,
            0 => Padding::Zeros,
            _ => Padding::Mixed,
        })
    }

    /// Whole bytes that were not used up to the next marker, as they count without stuffing, and the marker's place.
    pub fn left(mut self) -> (usize, usize) {
        let mut bytes = 0;
        loop {
            self.fill();
            bytes += self.count as usize / 8;
            let whole = self.count - self.count % 8;
            if whole == 0 {
                return (bytes, self.at);
            }
            (self.held, self.count) = (0, 0);
        }
    }

    /// Place of the reader in the data, give or take what it holds.
    pub fn place(&self) -> usize {
        self.at.saturating_sub(self.count as usize / 8)
    }
}

/// Bits between the last code and the end of its byte.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Padding {
    /// As T.81, F.1.2.3 has it; also no bits at all.
    Ones,
    /// As some hardware writes it.
    Zeros,
    /// As no writer would.
    Mixed,
}
