//! A folder of images as frames: which files, in which order, and when each was true.
//!
//! Names are ordered as people count: `img2` before `img10`. A folder has no clock. With a rate, the number at the end of
//! a name counts frames, so that a number that is missing is a frame that is missing; names that do not count (times of day,
//! hardly any of the numbers there) are taken one after the other. Without a rate the names themselves must end with the
//! frame's UNIX time in nanoseconds, as `hydroline export --frames` and many recorders write them.

use std::cmp::Ordering;
use std::io;
use std::path::{Path, PathBuf};

use hydroline_core::frame::{Frame, FrameMeta, LossBefore, PixelFormat, still_format, still_size};
use hydroline_rigs::bounded;

/// Endings of files that are taken for images.
const ENDINGS: [&str; 3] = ["png", "jpg", "jpeg"];
/// Where times begin that are counted by a rate, UNIX \[ns\]: a folder has no clock, and 0 would mean none.
const START_NS: u64 = 1_000_000_000;
/// A number from here on is a time in nanoseconds (1973), not a count.
const TIME_FROM: u64 = 100_000_000_000_000_000;
/// Numbers count frames if at least one in so many of them has its image.
const COUNTED: u64 = 2;
/// Largest image file that is read \[bytes\].
const FILE_MAX_BYTES: u64 = 1 << 30;

/// Why a folder makes no frames.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum FolderError {
    #[error("{}: {source}; check that it can be read", path.display())]
    Read { path: PathBuf, source: io::Error },
    #[error("{}: holds no images (.png, .jpg, .jpeg) among its {others} entries; name a folder with images", path.display())]
    Empty { path: PathBuf, others: usize },
    #[error(
        "{}: the images' names do not end with UNIX times in nanoseconds (the first is {first}), so nothing says when they were true: give --rate-hz, the frames in a second",
        path.display()
    )]
    NoTimes { path: PathBuf, first: String },
    #[error(
        "{}: the times in the names do not rise at {name}; rename it, or give --rate-hz to take the images in the order of their names",
        path.display()
    )]
    Order { path: PathBuf, name: String },
}

/// A folder's images in the order of their names.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ImageFolder {
    /// The folder.
    pub path: PathBuf,
    /// Its images.
    pub images: Vec<PathBuf>,
    /// Names of what else is there, without hidden files.
    pub others: Vec<String>,
}

impl ImageFolder {
    /// Looks into a folder.
    ///
    /// # Errors
    /// [`FolderError::Read`], [`FolderError::Empty`].
    pub fn open(path: &Path) -> Result<Self, FolderError> {
        let failed = |source| FolderError::Read {
            path: path.to_owned(),
            source,
        };
        let mut names = Vec::new();
        for entry in std::fs::read_dir(path).map_err(failed)? {
            let entry = entry.map_err(failed)?;
            let is_dir = entry.path().is_dir();
            names.push((
                entry.file_name().to_string_lossy().into_owned(),
                entry.path(),
                is_dir,
            ));
        }
        names.retain(|(name, ..)| !name.starts_with('.'));
        names.sort_by(|a, b| natural(&a.0, &b.0));
        let mut folder = Self {
            path: path.to_owned(),
            images: Vec::new(),
            others: Vec::new(),
        };
        for (name, path, is_dir) in names {
            let ending = path
                .extension()
                .and_then(|e| e.to_str())
                .map(str::to_ascii_lowercase);
            if !is_dir && ending.is_some_and(|e| ENDINGS.contains(&e.as_str())) {
                folder.images.push(path);
            } else {
                folder.others.push(name);
            }
        }
        if folder.images.is_empty() {
            return Err(FolderError::Empty {
                path: folder.path,
                others: folder.others.len(),
            });
        }
        Ok(folder)
    }

    /// The others, for a person; `None` = there are none.
    pub fn skipped(&self) -> Option<String> {
        const NAMED: usize = 5;
        let named: Vec<&str> = self.others.iter().take(NAMED).map(String::as_str).collect();
        let more = self.others.len().saturating_sub(NAMED);
        let more = if more > 0 {
            format!(" and {more} more")
        } else {
            String::new()
        };
        (!named.is_empty()).then(|| {
            format!(
                "{}: {} of {} entries are no images (.png, .jpg, .jpeg) and were left out: {}{more}",
                self.path.display(),
                self.others.len(),
                self.others.len() + self.images.len(),
                named.join(", "),
            )
        })
    }

    /// Its images as frames.
    ///
    /// # Errors
    /// [`FolderError::NoTimes`], [`FolderError::Order`].
    pub fn frames(self, rate_hz: Option<f64>) -> Result<FolderFrames, FolderError> {
        let names: Vec<String> = self.images.iter().map(|p| stem(p)).collect();
        let places = places(&names, rate_hz).map_err(|fault| {
            let path = self.path.clone();
            let shown = |k: usize| {
                let name = self.images.get(k).and_then(|p| p.file_name());
                name.map_or_else(String::new, |n| n.to_string_lossy().into_owned())
            };
            match fault {
                Untimed::NoTimes => FolderError::NoTimes {
                    path,
                    first: shown(0),
                },
                Untimed::Order(k) => FolderError::Order {
                    path,
                    name: shown(k),
                },
            }
        })?;
        Ok(FolderFrames {
            images: self.images,
            places,
            next: 0,
        })
    }
}

fn stem(path: &Path) -> String {
    let stem = path.file_stem().unwrap_or_default();
    stem.to_string_lossy().into_owned()
}

/// Order of names in which runs of digits count by their value.
pub fn natural(a: &str, b: &str) -> Ordering {
    let (mut left, mut right) = (a, b);
    loop {
        let (x, y) = (piece(left), piece(right));
        if x.is_empty() || y.is_empty() {
            // Equal as numbers (`1` and `01`): then by letters, so that the order is one.
            return x.len().cmp(&y.len()).then_with(|| a.cmp(b));
        }
        let digits = |s: &str| s.starts_with(|c: char| c.is_ascii_digit());
        let order = if digits(x) && digits(y) {
            let (x, y) = (x.trim_start_matches('0'), y.trim_start_matches('0'));
            x.len().cmp(&y.len()).then_with(|| x.cmp(y))
        } else {
            x.cmp(y)
        };
        if order != Ordering::Equal {
            return order;
        }
        (left, right) = (&left[x.len()..], &right[y.len()..]);
    }
}

/// The run of digits, or of anything else, that a text begins with.
fn piece(text: &str) -> &str {
    let digits = text.starts_with(|c: char| c.is_ascii_digit());
    let end = text.find(|c: char| c.is_ascii_digit() != digits);
    &text[..end.unwrap_or(text.len())]
}

/// The last run of digits of a name.
fn number(stem: &str) -> Option<u64> {
    let end = stem.rfind(|c: char| c.is_ascii_digit())? + 1;
    let start = stem[..end].rfind(|c: char| !c.is_ascii_digit());
    let start = start.map_or(0, |at| {
        at + stem[at..].chars().next().map_or(1, char::len_utf8)
    });
    stem[start..end].parse().ok()
}

/// A frame's number, its time, and how many are missing before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Place {
    sequence: u32,
    stamp_ns: u64,
    missing: u32,
}

#[derive(Debug, PartialEq, Eq)]
enum Untimed {
    NoTimes,
    /// At this image.
    Order(usize),
}

/// Where the frames of these names stand in time.
fn places(names: &[String], rate_hz: Option<f64>) -> Result<Vec<Place>, Untimed> {
    let numbers: Option<Vec<u64>> = names.iter().map(|name| number(name)).collect();
    let count = u32::try_from(names.len()).unwrap_or(u32::MAX);
    let Some(rate_hz) = rate_hz else {
        let times = numbers.filter(|n| n.iter().all(|t| *t >= TIME_FROM));
        let times = times.ok_or(Untimed::NoTimes)?;
        if let Some(k) = times.windows(2).position(|t| t[1] <= t[0]) {
            return Err(Untimed::Order(k + 1));
        }
        let place = |(sequence, stamp_ns)| Place {
            sequence,
            stamp_ns,
            missing: 0,
        };
        return Ok((0..count).zip(times).map(place).collect());
    };
    let counts = numbers.filter(|n| {
        let rises = n.windows(2).all(|pair| pair[1] > pair[0]);
        let (first, last) = (
            n.first().copied().unwrap_or(0),
            n.last().copied().unwrap_or(0),
        );
        rises && (last - first) / COUNTED < u64::from(count) && last < TIME_FROM
    });
    let first = counts
        .as_ref()
        .and_then(|n| n.first().copied())
        .unwrap_or(0);
    let steps: Vec<u32> = match counts {
        // Bounded above by twice the count.
        Some(numbers) => numbers.iter().map(|n| (n - first) as u32).collect(),
        None => (0..count).collect(),
    };
    let mut expected = 0;
    let place = |sequence: u32| {
        let missing = sequence - expected;
        expected = sequence + 1;
        let since_ns = (f64::from(sequence) / rate_hz * 1e9).round() as u64;
        Place {
            sequence,
            stamp_ns: START_NS.saturating_add(since_ns),
            missing,
        }
    };
    Ok(steps.into_iter().map(place).collect())
}

/// The images of a folder, one after the other.
pub struct FolderFrames {
    images: Vec<PathBuf>,
    places: Vec<Place>,
    next: usize,
}

impl FolderFrames {
    /// Frames that the numbers of the names leave out.
    pub fn missing(&self) -> u64 {
        self.places.iter().map(|p| u64::from(p.missing)).sum()
    }

    /// File of the frame of a number.
    pub fn file(&self, sequence: u32) -> Option<&Path> {
        let place = self.places.iter().position(|p| p.sequence == sequence)?;
        self.images.get(place).map(PathBuf::as_path)
    }

    fn read(path: &Path, place: Place) -> Result<Frame, FolderError> {
        let failed = |source| FolderError::Read {
            path: path.to_owned(),
            source,
        };
        let bytes = read_image(path).map_err(failed)?;
        // A file that is no image becomes a frame that does not decode, and is counted as one.
        let format = still_format(&bytes).unwrap_or(PixelFormat::Png);
        let (width_px, height_px) = still_size(&bytes, format).unwrap_or((0, 0));
        Ok(Frame {
            format,
            width_px,
            height_px,
            stride_bytes: 0,
            data: bytes.into(),
            meta: FrameMeta {
                lost_before: LossBefore {
                    sequence_gap: place.missing,
                    time_gap: 0,
                },
                ..FrameMeta::at(place.sequence, place.stamp_ns)
            },
        })
    }
}

/// The bytes of an image file.
///
/// # Errors
/// The system's, and a file beyond any image.
pub fn read_image(path: &Path) -> io::Result<Vec<u8>> {
    bounded::check_file(path)?;
    let length = std::fs::metadata(path)?.len();
    if length > FILE_MAX_BYTES {
        let words = format!("{length} bytes; images of up to {FILE_MAX_BYTES} are read");
        return Err(io::Error::new(io::ErrorKind::FileTooLarge, words));
    }
    std::fs::read(path)
}

impl Iterator for FolderFrames {
    type Item = Result<Frame, FolderError>;

    fn next(&mut self) -> Option<Self::Item> {
        let (path, place) = (self.images.get(self.next)?, *self.places.get(self.next)?);
        self.next += 1;
        Some(Self::read(path, place))
    }
}

#[cfg(test)]
mod tests;
