//! Coded data of a scan (T.81, F.2 and G.2), group by group.

use super::JpegDamage;
use super::bits::{Bits, Padding};
use super::huffman::Table;
use super::marker;
use super::picture::{Part, Picture, Scan};
use super::progressive::{self, Run};

/// Largest coefficient of a block of 8 x 8 samples of 8 bits: 8 x 128, and what fast transforms are off by (1 %).
const LARGEST: i32 = 1034;
/// Bits of a difference of two DC coefficients and of an AC coefficient at most (T.81, tables F.1 and F.2).
const BITS_MAX: [u32; 2] = [11, 10];
/// Bytes that hardware adds behind the last code to fill a word of its bus (Logitech's C270 and C910 do): fewer than
/// the 16 of the widest.
const ADDED_MAX: usize = 15;

/// Decoder of a scan's blocks.
#[derive(Clone)]
struct Coder<'a> {
    parts: Vec<(Part, Tables<'a>)>,
    /// Last DC coefficient of each part.
    dc: Vec<i32>,
    /// Whether values are held against what a block can have.
    bounded: bool,
}

#[derive(Clone)]
struct Tables<'a> {
    dc: &'a Table,
    ac: &'a Table,
    /// Largest coefficients, in steps.
    bounds: [i32; 64],
}

impl<'a> Coder<'a> {
    fn new(picture: &'a Picture, scan: &Scan) -> Result<Self, &'static str> {
        let mut parts = Vec::new();
        for part in &scan.parts {
            let steps = picture.components[part.component].steps.unwrap_or([1; 64]);
            let tables = Tables {
                dc: picture.table(0, part.dc)?,
                ac: picture.table(1, part.ac)?,
                // Rounded to a step: one more.
                bounds: steps.map(|step| LARGEST / i32::from(step.max(1)) + 1),
            };
            parts.push((*part, tables));
        }
        let dc = vec![0; parts.len()];
        Ok(Coder {
            parts,
            dc,
            bounded: true,
        })
    }

    fn group(&mut self, bits: &mut Bits<'_>) -> Result<(), &'static str> {
        for ((part, tables), dc) in self.parts.iter().zip(&mut self.dc) {
            for _ in 0..part.blocks {
                block(bits, tables, dc, self.bounded)?;
            }
        }
        Ok(())
    }

    /// Whether what follows are groups, to the last bit: then as many are missing before.
    fn goes_on(&self, mut bits: Bits<'_>) -> bool {
        let mut coder = self.clone();
        coder.bounded = false;
        while coder.group(&mut bits).is_ok() {
            let mut end = bits.clone();
            if end.padding().is_ok_and(|p| p != Padding::Mixed) && end.left().0 == 0 {
                return true;
            }
        }
        false
    }
}

/// One block of sequential coding (T.81, F.2.2).
fn block(
    bits: &mut Bits<'_>,
    tables: &Tables<'_>,
    dc: &mut i32,
    bounded: bool,
) -> Result<(), &'static str> {
    const BOUND: &str = "a value beyond black or white";
    const LONG: &str = "a value of more bits than there can be";
    let size = u32::from(bits.symbol(tables.dc)?);
    if size > BITS_MAX[0] {
        return Err(LONG);
    }
    *dc += bits.value(size)?;
    if bounded && dc.abs() > tables.bounds[0] {
        return Err(BOUND);
    }
    let mut at = 1;
    while at < 64 {
        let symbol = bits.symbol(tables.ac)?;
        let (zeros, size) = (usize::from(symbol >> 4), u32::from(symbol & 15));
        match (zeros, size) {
            (0, 0) => return Ok(()),
            (15, 0) => {
                at += 16;
                // Zeros at the end are never coded: there is a code for the end.
                if at >= 64 {
                    return Err("a block that is too long");
                }
                continue;
            }
            (_, 0) => return Err("a code of no symbol"),
            _ => {}
        }
        at += zeros;
        let bound = tables.bounds.get(at).ok_or("a block that is too long")?;
        if size > BITS_MAX[1] {
            return Err(LONG);
        }
        if bits.value(size)?.abs() > *bound && bounded {
            return Err(BOUND);
        }
        at += 1;
    }
    Ok(())
}

/// Sequential or progressive blocks of one group.
enum Blocks<'a> {
    Sequential(Coder<'a>),
    Progressive(Run<'a>),
}

impl Picture {
    /// Decodes a scan's data from a place on; the place of the marker behind them.
    pub fn decode(&mut self, scan: &Scan, data: &[u8], from: usize) -> Result<usize, JpegDamage> {
        // Taken out while the tables are borrowed, and put back.
        let mut nonzero = progressive::taken(self, scan);
        let done = self.blocks(scan, data, from, &mut nonzero);
        progressive::put_back(self, scan, nonzero);
        done
    }

    fn blocks(
        &self,
        scan: &Scan,
        data: &[u8],
        from: usize,
        nonzero: &mut [u64],
    ) -> Result<usize, JpegDamage> {
        let header = |what| JpegDamage::Segment { at: from, what };
        let mut blocks = match self.progressive {
            false => Blocks::Sequential(Coder::new(self, scan).map_err(header)?),
            true => Blocks::Progressive(Run::new(self, scan, nonzero).map_err(header)?),
        };
        let mcus = scan.groups;
        let mut bits = Bits::new(data, from);
        for mcu in 0..mcus {
            if self.interval > 0 && mcu > 0 && mcu.is_multiple_of(self.interval) {
                let at = blocks.closed(bits, mcu, mcus)?;
                bits = Bits::new(data, restarted(data, at, mcu / self.interval, (mcu, mcus))?);
                blocks.restart();
            }
            blocks
                .group(&mut bits, mcu)
                .map_err(|what| JpegDamage::Data {
                    at: bits.place(),
                    mcu,
                    mcus,
                    what,
                })?;
        }
        let at = blocks.closed(bits, mcus, mcus)?;
        // Some hardware ends the last interval as it ends the others.
        match self.interval {
            n if n > 0 && mcus.is_multiple_of(n) => {
                Ok(restarted(data, at, mcus / n, (mcus, mcus)).unwrap_or(at))
            }
            _ => Ok(at),
        }
    }
}

/// Place behind the restart marker that is due: the `nth`, counted from 1.
fn restarted(
    data: &[u8],
    at: usize,
    nth: u64,
    (mcu, mcus): (u64, u64),
) -> Result<usize, JpegDamage> {
    let (found, after) = super::next_marker(data, at)?;
    if found == marker::RST0 + ((nth - 1) % 8) as u8 {
        return Ok(after);
    }
    let what = "the restart marker that is due is not there";
    Err(JpegDamage::Data {
        at,
        mcu,
        mcus,
        what,
    })
}

impl Blocks<'_> {
    fn group(&mut self, bits: &mut Bits<'_>, mcu: u64) -> Result<(), &'static str> {
        match self {
            Blocks::Sequential(coder) => coder.group(bits),
            Blocks::Progressive(run) => run.group(bits, mcu),
        }
    }

    fn restart(&mut self) {
        if let Blocks::Sequential(coder) = self {
            coder.dc.fill(0);
        }
    }

    /// Ends an interval or a scan: nothing but padding may follow up to the marker, whose place this is.
    fn closed(&self, mut bits: Bits<'_>, mcu: u64, mcus: u64) -> Result<usize, JpegDamage> {
        let at = bits.place();
        let wrong = |what| JpegDamage::Data {
            at,
            mcu,
            mcus,
            what,
        };
        if matches!(self, Blocks::Progressive(run) if run.is_open()) {
            return Err(wrong("a run of empty blocks goes beyond the last"));
        }
        let here = bits.clone();
        let padding = bits.padding().map_err(wrong)?;
        if padding == Padding::Mixed {
            return Err(wrong("bits behind the last block that are no padding"));
        }
        let (bytes, marker_at) = bits.left();
        if bytes == 0 {
            return Ok(marker_at);
        }
        let added = match self {
            Blocks::Sequential(coder) => {
                padding == Padding::Ones && bytes <= ADDED_MAX && !coder.goes_on(here)
            }
            Blocks::Progressive(_) => false,
        };
        match added {
            true => Ok(marker_at),
            false => Err(JpegDamage::LeftOver { at, mcus, bytes }),
        }
    }
}
