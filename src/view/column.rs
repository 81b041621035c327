//! Samples of one number over time, and fewer of them that show the same: least and greatest of each stretch.

/// A sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Time since the log's zero \[ns\].
    pub at_ns: i64,
    /// Value; finite.
    pub value: f64,
}

/// Samples that are kept of a number: 2 MB, an hour at 36 per second as they are. Beyond them the samples are thinned.
const KEPT_MAX: usize = 1 << 17;
/// Samples that are thinned to two, the least and the greatest.
const THINNED: usize = 4;

/// A number over time, in bounded memory.
///
/// Beyond a bound of samples each four neighbours become two: the least and the greatest of them, at their own times. So
/// whatever is left is a sample of the log, and no peak is lost.
#[derive(Debug, Clone, PartialEq)]
pub struct Column {
    samples: Vec<Sample>,
    kept_max: usize,
    thinned: bool,
    sorted: bool,
    not_finite: u64,
}

impl Default for Column {
    fn default() -> Self {
        Self::holding(KEPT_MAX)
    }
}

impl Column {
    /// One that keeps at most so many samples.
    fn holding(kept_max: usize) -> Self {
        Self {
            samples: Vec::new(),
            kept_max: kept_max.max(THINNED),
            thinned: false,
            sorted: true,
            not_finite: 0,
        }
    }

    /// Takes a sample; one that is no number is counted and left out.
    pub fn push(&mut self, at_ns: i64, value: f64) {
        if !value.is_finite() {
            self.not_finite += 1;
            return;
        }
        self.sorted &= self.samples.last().is_none_or(|last| last.at_ns <= at_ns);
        self.samples.push(Sample { at_ns, value });
        if self.samples.len() > self.kept_max {
            self.sort();
            let fours = self.samples.chunks(THINNED);
            self.samples = fours.flat_map(extremes).collect();
            self.thinned = true;
        }
    }

    /// Whether some samples of the log are not here, only the least and the greatest of their neighbours.
    pub fn is_thinned(&self) -> bool {
        self.thinned
    }

    /// Samples that were NaN or infinite.
    pub fn not_finite(&self) -> u64 {
        self.not_finite
    }

    /// The samples that are kept, in the order of time.
    pub fn samples(&mut self) -> &[Sample] {
        self.sort();
        &self.samples
    }

    fn sort(&mut self) {
        if !self.sorted {
            self.samples.sort_by_key(|s| s.at_ns);
            self.sorted = true;
        }
    }
}

/// The least and the greatest of samples in the order of time; of one that is both, one.
fn extremes(samples: &[Sample]) -> impl Iterator<Item = Sample> {
    let least = (samples.iter()).min_by(|a, b| a.value.total_cmp(&b.value));
    let greatest = (samples.iter()).max_by(|a, b| a.value.total_cmp(&b.value));
    let mut both = [least.copied(), greatest.copied()];
    if both[0].map(|s| s.at_ns) > both[1].map(|s| s.at_ns) {
        both.swap(0, 1);
    }
    if both[0] == both[1] {
        both[1] = None;
    }
    both.into_iter().flatten()
}

/// The samples from `from_ns` to `to_ns` as a plot of that many pixels shows them: all where there are no more than two to a
/// pixel, else the least and the greatest in each pixel, at their own times. One neighbour on either side comes with them, so that
/// a line goes on to the edges. `samples` are in the order of time.
pub fn decimated(samples: &[Sample], from_ns: i64, to_ns: i64, pixels: usize) -> Vec<Sample> {
    let begin = samples.partition_point(|s| s.at_ns < from_ns);
    let end = samples.partition_point(|s| s.at_ns <= to_ns).max(begin);
    let inside = &samples[begin..end];
    let mut shown = Vec::with_capacity(inside.len().min(2 * pixels) + 2);
    shown.extend(begin.checked_sub(1).map(|k| samples[k]));
    if inside.len() <= 2 * pixels {
        shown.extend(inside);
    } else {
        let width = (i128::from(to_ns) - i128::from(from_ns) + 1).max(1);
        let pixel = |s: &Sample| {
            let at = i128::from(s.at_ns) - i128::from(from_ns);
            at * pixels as i128 / width
        };
        for same in inside.chunk_by(|a, b| pixel(a) == pixel(b)) {
            shown.extend(extremes(same));
        }
    }
    shown.extend(samples.get(end));
    shown
}

#[cfg(test)]
#[path = "tests/unit/column.rs"]
mod tests;
