//! Blocks of progressive coding (T.81, G.2): of which only is known which coefficients are not zero.

use super::bits::Bits;
use super::huffman::Table;
use super::picture::{Picture, Scan};

/// Bits of a DC difference at most (T.81, table F.1), and of an AC coefficient.
const BITS_MAX: [u32; 2] = [11, 10];
/// Runs of empty blocks from here on are runs of 16 zeros (T.81, table G.1).
const ZEROS_16: u32 = 15;

/// Decoder of one scan.
pub(super) struct Run<'a> {
    /// Tables of its parts by the number of their blocks in a group; `None` where a scan needs none.
    dc: Vec<(u32, Option<&'a Table>)>,
    ac: Option<&'a Table>,
    first: u32,
    last: u32,
    refines: bool,
    nonzero: &'a mut [u64],
    /// Blocks that are still to come without a code of their own.
    empty: u32,
}

/// The states of the blocks of a scan of AC coefficients, made where it is the first.
pub(super) fn taken(picture: &mut Picture, scan: &Scan) -> Vec<u64> {
    match (&scan.parts[..], picture.progressive && scan.band[0] > 0) {
        ([part], true) => {
            let mut nonzero = std::mem::take(&mut picture.components[part.component].nonzero);
            // Bounded by the pixels that are unpacked.
            nonzero.resize(scan.groups as usize, 0);
            nonzero
        }
        _ => Vec::new(),
    }
}

/// Puts them back.
pub(super) fn put_back(picture: &mut Picture, scan: &Scan, nonzero: Vec<u64>) {
    if let ([part], false) = (&scan.parts[..], nonzero.is_empty()) {
        picture.components[part.component].nonzero = nonzero;
    }
}

impl<'a> Run<'a> {
    pub fn new(
        picture: &'a Picture,
        scan: &Scan,
        nonzero: &'a mut [u64],
    ) -> Result<Self, &'static str> {
        let refines = scan.shifts[0] > 0;
        let is_dc = scan.band[0] == 0;
        let mut dc = Vec::new();
        for part in &scan.parts {
            let table = match is_dc && !refines {
                true => Some(picture.table(0, part.dc)?),
                false => None,
            };
            dc.push((part.blocks, table));
        }
        let ac = match (is_dc, &scan.parts[..]) {
            (false, [part]) => Some(picture.table(1, part.ac)?),
            _ => None,
        };
        Ok(Run {
            dc,
            ac,
            first: u32::from(scan.band[0]),
            last: u32::from(scan.band[1]),
            refines,
            nonzero,
            empty: 0,
        })
    }

    /// Whether empty blocks are still to come.
    pub fn is_open(&self) -> bool {
        self.empty > 0
    }

    pub fn group(&mut self, bits: &mut Bits<'_>, group: u64) -> Result<(), &'static str> {
        let Some(table) = self.ac else {
            return self.dc_group(bits);
        };
        let place = usize::try_from(group).unwrap_or(usize::MAX);
        let nonzero = self.nonzero.get(place).copied();
        let nonzero = nonzero.ok_or("a block that there is not")?;
        self.nonzero[place] = match self.refines {
            false => self.ac_first(bits, table, nonzero)?,
            true => self.ac_refined(bits, table, nonzero)?,
        };
        Ok(())
    }

    fn dc_group(&mut self, bits: &mut Bits<'_>) -> Result<(), &'static str> {
        for (blocks, table) in &self.dc {
            for _ in 0..*blocks {
                let Some(table) = table else {
                    bits.number(1)?;
                    continue;
                };
                let size = u32::from(bits.symbol(table)?);
                if size > BITS_MAX[0] {
                    return Err("a value of more bits than there can be");
                }
                bits.value(size)?;
            }
        }
        Ok(())
    }

    /// Number of empty blocks that a code states, its own among them.
    fn empties(bits: &mut Bits<'_>, size: u32) -> Result<u32, &'static str> {
        Ok((1 << size) + bits.number(size)?)
    }

    fn ac_first(
        &mut self,
        bits: &mut Bits<'_>,
        table: &Table,
        mut nonzero: u64,
    ) -> Result<u64, &'static str> {
        if self.empty > 0 {
            self.empty -= 1;
            return Ok(nonzero);
        }
        let mut at = self.first;
        while at <= self.last {
            let symbol = bits.symbol(table)?;
            let (zeros, size) = (u32::from(symbol >> 4), u32::from(symbol & 15));
            match (zeros, size) {
                (ZEROS_16, 0) => at += 16,
                (_, 0) => {
                    self.empty = Self::empties(bits, zeros)? - 1;
                    return Ok(nonzero);
                }
                _ => {
                    at += zeros;
                    if at > self.last {
                        return Err("a block that is too long");
                    }
                    if size > BITS_MAX[1] {
                        return Err("a value of more bits than there can be");
                    }
                    bits.value(size)?;
                    nonzero |= 1 << at;
                    at += 1;
                }
            }
        }
        Ok(nonzero)
    }

    /// The next bit of coefficients that are not zero, and those that become so (T.81, G.1.2.3).
    fn ac_refined(
        &mut self,
        bits: &mut Bits<'_>,
        table: &Table,
        before: u64,
    ) -> Result<u64, &'static str> {
        let (mut nonzero, mut at) = (before, self.first);
        while self.empty == 0 && at <= self.last {
            let symbol = bits.symbol(table)?;
            let (mut zeros, size) = (u32::from(symbol >> 4), u32::from(symbol & 15));
            match (zeros, size) {
                (ZEROS_16, 0) => {}
                (_, 0) => {
                    self.empty = Self::empties(bits, zeros)?;
                    break;
                }
                (_, 1) => {
                    bits.number(1)?;
                }
                _ => return Err("a refinement of more than one bit"),
            }
            loop {
                if at > self.last {
                    return Err("a block that is too long");
                }
                if before >> at & 1 == 1 {
                    bits.number(1)?;
                } else if zeros == 0 {
                    break;
                } else {
                    zeros -= 1;
                }
                at += 1;
            }
            nonzero |= u64::from(size) << at;
            at += 1;
        }
        if self.empty > 0 {
            for at in at..=self.last {
                if before >> at & 1 == 1 {
                    bits.number(1)?;
                }
            }
            self.empty -= 1;
        }
        Ok(nonzero)
    }
}
