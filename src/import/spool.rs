//! Samples of the first pass, kept for the second: cells are split and read once.

use std::fs::File;
use std::io::{self, Write};
use std::os::unix::fs::FileExt;
use std::sync::Arc;

use crate::map::{Map, PLACES};
use crate::table::Sample;

/// Samples are kept in memory up to here; what is more goes to a scratch file.
const MEMORY_BYTES: usize = 8 << 20;

/// Numbers of eight bytes each, row after row: only what the map names.
#[derive(Debug, Clone)]
struct Shape {
    places: Vec<usize>,
    commands: usize,
    pulses: bool,
    compare: bool,
}

impl Shape {
    fn of(map: &Map) -> Shape {
        Shape {
            places: (0..PLACES).filter(|p| map.missing(*p).is_some()).collect(),
            commands: map.commands.len(),
            pulses: map.commands.iter().any(|c| c.pulse),
            compare: map.time.compare.is_some(),
        }
    }

    fn row_bytes(&self) -> usize {
        let loads = self.commands * (1 + usize::from(self.pulses));
        8 * (2 + self.places.len() + loads + usize::from(self.compare))
    }
}

pub(crate) struct Spooler {
    shape: Shape,
    buffer: Vec<u8>,
    scratch: Option<File>,
    /// No room for a scratch file: the table is read again instead.
    given_up: bool,
}

impl Spooler {
    pub fn new(map: &Map) -> Spooler {
        Spooler {
            shape: Shape::of(map),
            buffer: Vec::new(),
            scratch: None,
            given_up: false,
        }
    }

    pub fn row(&mut self, sample: &Sample) {
        if self.given_up {
            return;
        }
        let mut put = |v: f64| self.buffer.extend_from_slice(&v.to_bits().to_le_bytes());
        put(f64::from_bits(sample.line));
        put(sample.t_s);
        for place in &self.shape.places {
            put(sample.values[*place]);
        }
        sample.commands.iter().for_each(|v| put(*v));
        if self.shape.pulses {
            sample.pulses_us.iter().for_each(|v| put(*v));
        }
        if self.shape.compare {
            put(sample.compare_s);
        }
        if self.buffer.len() >= MEMORY_BYTES && self.spill().is_err() {
            self.given_up = true;
            self.buffer = Vec::new();
            self.scratch = None;
        }
    }

    fn spill(&mut self) -> io::Result<()> {
        let scratch = match &mut self.scratch {
            Some(scratch) => scratch,
            none => none.insert(tempfile::tempfile()?),
        };
        scratch.write_all(&self.buffer)?;
        self.buffer.clear();
        Ok(())
    }

    /// `None` = they could not be kept.
    pub fn finish(self) -> Option<Spool> {
        (!self.given_up).then(|| {
            Spool(Arc::new(Kept {
                shape: self.shape,
                scratch: self.scratch,
                rest: self.buffer,
            }))
        })
    }
}

#[derive(Debug)]
struct Kept {
    shape: Shape,
    scratch: Option<File>,
    /// After those in the file.
    rest: Vec<u8>,
}

#[derive(Debug, Clone)]
pub(crate) struct Spool(Arc<Kept>);

impl Spool {
    /// Hands on every sample as it was.
    pub fn each(&self, mut each: impl FnMut(&mut Sample) -> io::Result<()>) -> io::Result<()> {
        let Kept {
            shape,
            scratch,
            rest,
        } = &*self.0;
        let mut sample = Sample {
            line: 0,
            t_s: 0.0,
            values: [f64::NAN; PLACES],
            commands: vec![f64::NAN; shape.commands],
            pulses_us: vec![0.0; shape.commands],
            compare_s: f64::NAN,
        };
        if let Some(scratch) = scratch {
            // Whole rows, about a megabyte of them.
            let mut piece = vec![0; ((1 << 20) / shape.row_bytes()).max(1) * shape.row_bytes()];
            let (mut at, end) = (0, scratch.metadata()?.len());
            while at < end {
                let bytes = piece.len().min((end - at) as usize);
                scratch.read_exact_at(&mut piece[..bytes], at)?;
                at += bytes as u64;
                shape.rows(&piece[..bytes], &mut sample, &mut each)?;
            }
        }
        shape.rows(rest, &mut sample, &mut each)
    }
}

impl Shape {
    fn rows(
        &self,
        bytes: &[u8],
        sample: &mut Sample,
        each: &mut impl FnMut(&mut Sample) -> io::Result<()>,
    ) -> io::Result<()> {
        for row in bytes.chunks_exact(self.row_bytes()) {
            let mut words = row
                .as_chunks::<8>()
                .0
                .iter()
                .map(|b| u64::from_le_bytes(*b));
            let mut word = || words.next().unwrap_or_default();
            sample.line = word();
            sample.t_s = f64::from_bits(word());
            for place in &self.places {
                sample.values[*place] = f64::from_bits(word());
            }
            for load in &mut sample.commands {
                *load = f64::from_bits(word());
            }
            if self.pulses {
                for pulse in &mut sample.pulses_us {
                    *pulse = f64::from_bits(word());
                }
            }
            if self.compare {
                sample.compare_s = f64::from_bits(word());
            }
            each(sample)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_come_back_to_the_bit_from_memory_and_from_the_scratch_file() {
        let map = "[time]\ncolumn = \"t\"\nunit = \"s\"\ncompare_column = \"t2\"\ncompare_unit = \"s\"\n[motion.x_m]\ncolumn = \"x\"\nunit = \"m\"\n[motion.psi_rad]\ncolumn = \"yaw\"\nunit = \"deg\"\n[[command]]\nthruster = \"a\"\ncolumn = \"a\"\nunit = \"us\"\n[[command]]\nthruster = \"surge\"\ncolumn = \"b\"\nunit = \"N\"\n";
        let map = Map::from_toml(map, "map.toml").unwrap();
        for rows in [0, 1, 3, 200_000_u64] {
            let sample = |k: u64| {
                let v = k as f64;
                let mut values = [f64::NAN; PLACES];
                (values[0], values[5]) = (v / 3.0, -0.0);
                Sample {
                    line: k + 2,
                    t_s: v / 7.0,
                    values,
                    commands: vec![v.sqrt(), f64::NAN],
                    pulses_us: vec![1500.0 + v, 0.0],
                    compare_s: v / 11.0,
                }
            };
            let mut spooler = Spooler::new(&map);
            (0..rows).for_each(|k| spooler.row(&sample(k)));
            assert_eq!(spooler.scratch.is_some(), rows > 100_000);
            let spool = spooler.finish().unwrap();
            // Twice: reading takes nothing away.
            for _ in 0..2 {
                let mut k = 0;
                let bits = |s: &Sample| {
                    let all = s.values.iter().chain(&s.commands).chain(&s.pulses_us);
                    let all = all.chain([&s.t_s, &s.compare_s]);
                    (s.line, all.map(|v| v.to_bits()).collect::<Vec<_>>())
                };
                spool
                    .each(|s| {
                        assert_eq!(bits(s), bits(&sample(k)));
                        k += 1;
                        Ok(())
                    })
                    .unwrap();
                assert_eq!(k, rows);
            }
        }
    }
}
