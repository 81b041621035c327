//! Segments of a JPEG before its coded data (T.81, B.2): frame, tables, scans.

use super::Grid;
use super::huffman::Table;
use crate::frame::COMPRESSED_MAX_PX;

/// Components of a frame or a scan at most (T.81, table B.3).
const COMPONENTS_MAX: usize = 4;
/// Blocks in a group of interleaved ones at most (T.81, B.2.3).
const GROUP_MAX: u32 = 10;
/// Scans of an image at most: a progressive one has about ten, and each costs a look at every block.
const SCANS_MAX: usize = 100;
/// Bits of a coefficient that scans may leave for later ones (T.81, table B.3).
const SHIFT_MAX: u8 = 13;

/// Order of frequencies in a block (T.81, figure A.6): place by row and column of each in turn.
#[rustfmt::skip]
pub(super) const ZIGZAG: [u8; 64] = [
     0,  1,  8, 16,  9,  2,  3, 10, 17, 24, 32, 25, 18, 11,  4,  5,
    12, 19, 26, 33, 40, 48, 41, 34, 27, 20, 13,  6,  7, 14, 21, 28,
    35, 42, 49, 56, 57, 50, 43, 36, 29, 22, 15, 23, 30, 37, 44, 51,
    58, 59, 52, 45, 38, 31, 39, 46, 53, 60, 61, 54, 47, 55, 62, 63,
];

type What = &'static str;

/// An image's component: brightness, or one of its colours.
#[derive(Debug, Clone)]
pub(super) struct Component {
    id: u8,
    /// Sampling along a row and a column: blocks in a group of interleaved ones.
    across: u32,
    down: u32,
    quantizer: usize,
    /// Steps of its coefficients in the order of the scan, once a scan begins with it.
    pub steps: Option<[u16; 64]>,
    /// Bits of each coefficient that scans have left for later ones; `None` = none has come.
    left: [Option<u8>; 64],
    /// Of a progressive image: which coefficients of each block are not zero so far, a bit each.
    pub nonzero: Vec<u64>,
}

/// A scan's component with its tables.
#[derive(Debug, Clone, Copy)]
pub(super) struct Part {
    pub component: usize,
    pub dc: usize,
    pub ac: usize,
    /// Blocks of it in a group.
    pub blocks: u32,
}

/// Header of a scan.
#[derive(Debug, Clone)]
pub(super) struct Scan {
    pub parts: Vec<Part>,
    /// Groups of blocks (MCU).
    pub groups: u64,
    /// First and last coefficient.
    pub band: [u8; 2],
    /// Bits that were left before it, and that it leaves.
    pub shifts: [u8; 2],
}

/// Everything stated so far.
#[derive(Debug, Default)]
pub(super) struct Picture {
    size_px: [u32; 2],
    pub progressive: bool,
    pub components: Vec<Component>,
    quantizers: [Option<[u16; 64]>; 4],
    /// Of DC and of AC.
    tables: [[Option<Table>; 4]; 2],
    /// Groups between two restart markers; 0 = none.
    pub interval: u64,
    scans: usize,
    /// A standard table stood in for one that is not there.
    pub lacks_tables: bool,
}

impl Picture {
    pub fn frame(&mut self, body: &[u8], progressive: bool) -> Result<(), What> {
        if !self.components.is_empty() {
            return Err("a second frame header");
        }
        let Some((&[bits, h1, h0, w1, w0, n], listed)) = body.split_first_chunk::<6>() else {
            return Err("a frame header that is too short");
        };
        if bits != 8 {
            return Err("samples that are not of 8 bits");
        }
        let size_px = [[w1, w0], [h1, h0]].map(|b| u32::from(u16::from_be_bytes(b)));
        if size_px.contains(&0) {
            return Err("an image without a width or a height");
        }
        if u64::from(size_px[0]) * u64::from(size_px[1]) > COMPRESSED_MAX_PX {
            return Err("more pixels than are unpacked");
        }
        let (listed, rest) = listed.as_chunks::<3>();
        let count = usize::from(n);
        if listed.len() != count || !rest.is_empty() || !(1..=COMPONENTS_MAX).contains(&count) {
            return Err("a frame header whose length does not fit its components");
        }
        for &[id, sampling, quantizer] in listed {
            let (across, down) = (u32::from(sampling >> 4), u32::from(sampling & 15));
            let quantizer = usize::from(quantizer);
            let right = (1..=4).contains(&across) && (1..=4).contains(&down) && quantizer < 4;
            if !right || self.components.iter().any(|c| c.id == id) {
                return Err("a component that cannot be");
            }
            self.components.push(Component {
                id,
                across,
                down,
                quantizer,
                steps: None,
                left: [None; 64],
                nonzero: Vec::new(),
            });
        }
        (self.size_px, self.progressive) = (size_px, progressive);
        Ok(())
    }

    pub fn huffman(&mut self, mut body: &[u8]) -> Result<(), What> {
        while let Some((name, rest)) = body.split_first() {
            let (class, number) = (usize::from(name >> 4), usize::from(name & 15));
            let Some((counts, rest)) = rest.split_first_chunk::<16>() else {
                return Err("a Huffman table that is cut");
            };
            let total = counts.iter().map(|n| usize::from(*n)).sum();
            let Some((symbols, rest)) = rest.split_at_checked(total) else {
                return Err("a Huffman table that is cut");
            };
            let places = self.tables.get_mut(class);
            let Some(place) = places.and_then(|of| of.get_mut(number)) else {
                return Err("a Huffman table of a number that cannot be");
            };
            *place = Some(Table::new(counts, symbols)?);
            body = rest;
        }
        Ok(())
    }

    pub fn quantizers(&mut self, mut body: &[u8]) -> Result<(), What> {
        while let Some((name, rest)) = body.split_first() {
            let (bytes, number) = (usize::from(name >> 4) + 1, usize::from(name & 15));
            let (Some((steps, rest)), true) = (rest.split_at_checked(64 * bytes), bytes <= 2)
            else {
                return Err("a quantization table that is cut");
            };
            let Some(place) = self.quantizers.get_mut(number) else {
                return Err("a quantization table of a number that cannot be");
            };
            let mut table = [0; 64];
            for (step, bytes) in table.iter_mut().zip(steps.chunks_exact(bytes)) {
                *step = bytes.iter().fold(0, |sum, b| sum << 8 | u16::from(*b));
            }
            if table.contains(&0) {
                return Err("a quantization table with a step of zero");
            }
            *place = Some(table);
            body = rest;
        }
        Ok(())
    }

    pub fn restarts(&mut self, body: &[u8]) -> Result<(), What> {
        let &[high, low] = body else {
            return Err("a restart interval that is not of two bytes");
        };
        self.interval = u64::from(u16::from_be_bytes([high, low]));
        Ok(())
    }

    /// Reads a scan's header and holds it against the frame's.
    pub fn scan(&mut self, body: &[u8]) -> Result<Scan, What> {
        self.scans += 1;
        if self.components.is_empty() {
            return Err("a scan before the frame's header");
        }
        if self.scans > SCANS_MAX {
            return Err("more scans than are read");
        }
        let long = "a scan's header whose length does not fit its components";
        let (n, rest) = body.split_first().ok_or(long)?;
        let (listed, rest) = rest.split_at_checked(2 * usize::from(*n)).ok_or(long)?;
        let &[from, to, shifts] = rest else {
            return Err(long);
        };
        let (listed, _) = listed.as_chunks::<2>();
        let mut parts: Vec<Part> = Vec::new();
        for &[id, tables] in listed {
            let component = self.components.iter().position(|c| c.id == id);
            let component = component.ok_or("a scan of a component that there is not")?;
            if parts.iter().any(|p| p.component == component) {
                return Err("a scan with a component twice");
            }
            let of = &mut self.components[component];
            // Those in force when a component's first scan begins hold for all of them.
            of.steps = of.steps.or(self.quantizers[of.quantizer]);
            if of.steps.is_none() {
                return Err("a component without its quantization table");
            }
            parts.push(Part {
                component,
                dc: usize::from(tables >> 4),
                ac: usize::from(tables & 15),
                blocks: of.across * of.down,
            });
        }
        let most = |of: fn(&Component) -> u32| self.components.iter().map(of).max().unwrap_or(1);
        let [most_across, most_down] = [most(|c| c.across), most(|c| c.down)];
        let [width, height] = self.size_px;
        if let [one] = &mut parts[..] {
            one.blocks = 1;
        }
        let groups = match &parts[..] {
            [] => return Err("a scan of nothing"),
            [one] => {
                let of = &self.components[one.component];
                let side = |px: u32, part: u32, most: u32| (px * part).div_ceil(8 * most);
                u64::from(side(width, of.across, most_across))
                    * u64::from(side(height, of.down, most_down))
            }
            _ if parts.iter().map(|p| p.blocks).sum::<u32>() > GROUP_MAX => {
                return Err("a group of more blocks than there can be");
            }
            _ => {
                u64::from(width.div_ceil(8 * most_across))
                    * u64::from(height.div_ceil(8 * most_down))
            }
        };
        let (high, low) = (shifts >> 4, shifts & 15);
        let right = match self.progressive {
            false => (from, to, high, low) == (0, 63, 0, 0),
            true => {
                let dc = from == 0 && to == 0;
                let ac = from > 0 && from <= to && to < 64 && parts.len() == 1;
                (dc || ac) && low <= SHIFT_MAX && (high == 0 || high == low + 1)
            }
        };
        if !right {
            return Err("a scan of coefficients that cannot be");
        }
        let scan = Scan {
            parts,
            groups,
            band: [from, to],
            shifts: [high, low],
        };
        self.stand_in(&scan)?;
        for part in &scan.parts {
            let left = &mut self.components[part.component].left;
            for bits in &mut left[usize::from(from)..=usize::from(to)] {
                // The first scan of a coefficient has none before it, each later one goes on where the last ended.
                let before = match high {
                    0 => None,
                    _ => Some(high),
                };
                if *bits != before {
                    return Err("scans of a coefficient out of their order");
                }
                *bits = Some(low);
            }
        }
        Ok(scan)
    }

    /// Puts the standard tables where a sequential scan names some that are not there, as MJPEG may.
    fn stand_in(&mut self, scan: &Scan) -> Result<(), What> {
        let missing = "a scan without its Huffman tables";
        for part in &scan.parts {
            let needed = match (self.progressive, scan.band[0], scan.shifts[0]) {
                (false, ..) => [true, true],
                (true, 0, 0) => [true, false],
                (true, 0, _) => [false, false],
                (true, ..) => [false, true],
            };
            for (class, number) in [part.dc, part.ac].into_iter().enumerate() {
                let place = self.tables[class].get_mut(number).ok_or(missing)?;
                if !needed[class] || place.is_some() {
                    continue;
                }
                if self.progressive {
                    return Err(missing);
                }
                *place = Some(Table::standard(class, number).ok_or(missing)?);
                self.lacks_tables = true;
            }
        }
        Ok(())
    }

    pub fn table(&self, class: usize, number: usize) -> Result<&Table, What> {
        let of = self.tables.get(class).and_then(|of| of.get(number));
        of.and_then(Option::as_ref)
            .ok_or("a scan without its Huffman tables")
    }

    /// Holds the whole against the frame's header, at the end marker.
    pub fn ended(&self) -> Result<(), What> {
        let whole = |c: &Component| c.left.iter().all(|left| *left == Some(0));
        match self.components.iter().all(whole) {
            true if !self.components.is_empty() => Ok(()),
            _ => Err("the end before all coefficients have come"),
        }
    }

    /// Blocks of the first component, where they lie on the image's own grid.
    pub fn grid(&self) -> Option<Grid> {
        let first = self.components.first()?;
        let full = |c: &Component| c.across <= first.across && c.down <= first.down;
        let steps = first.steps.filter(|_| self.components.iter().all(full))?;
        let mut placed = [0; 64];
        for (place, step) in ZIGZAG.iter().zip(steps) {
            placed[usize::from(*place)] = step;
        }
        let group = match self.components.len() {
            1 => [1, 1],
            _ => [first.across as usize, first.down as usize],
        };
        Some(Grid {
            steps: placed,
            group,
            interval: usize::try_from(self.interval).unwrap_or(0),
        })
    }
}
