//! Stretches of a run without a pose: what a person wants to know is from when to when, and what ended the last pose.

use serde::Serialize;

/// Shorter ones are single frames that a fit did without \[s\].
const WORTH_TELLING_S: f64 = 0.5;

/// A stretch without a pose.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct Gap {
    /// First frame of it, since the run's first frame \[s\].
    pub from_s: f64,
    /// Last one \[s\].
    pub to_s: f64,
    /// Number of frames.
    pub frames: u64,
    /// Reason why its first frame has none: what comes later is often only because the place is not known any more.
    pub first_reason: String,
    /// No pose came behind it.
    pub to_the_end: bool,
}

/// Gathers them, frame by frame.
#[derive(Debug, Default)]
pub struct Gaps {
    first_ns: Option<u64>,
    open: Option<Gap>,
    found: Vec<Gap>,
}

impl Gaps {
    fn since_s(&mut self, stamp_ns: u64) -> f64 {
        let first_ns = *self.first_ns.get_or_insert(stamp_ns);
        stamp_ns.saturating_sub(first_ns) as f64 * 1e-9
    }

    /// A frame with a pose.
    pub fn pose(&mut self, stamp_ns: u64) {
        self.since_s(stamp_ns);
        self.close(false);
    }

    /// A frame without one.
    pub fn none(&mut self, stamp_ns: u64, why: &str) {
        let at_s = self.since_s(stamp_ns);
        let gap = self.open.get_or_insert_with(|| Gap {
            from_s: at_s,
            to_s: at_s,
            frames: 0,
            first_reason: why.to_owned(),
            to_the_end: false,
        });
        gap.to_s = at_s;
        gap.frames += 1;
    }

    fn close(&mut self, to_the_end: bool) {
        let gap = self.open.take();
        self.found.extend(
            gap.filter(|g| g.to_s - g.from_s >= WORTH_TELLING_S)
                .map(|g| Gap { to_the_end, ..g }),
        );
    }

    /// All of them, at the end of the run.
    pub fn done(&mut self) -> Vec<Gap> {
        self.close(true);
        std::mem::take(&mut self.found)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    #[test]
    fn a_stretch_is_reported_with_its_first_reason_and_single_frames_are_not() {
        let mut gaps = Gaps::default();
        for k in 0..100 {
            let stamp_ns = (1_000 + 40 * k) * MS;
            match k {
                5 => gaps.none(stamp_ns, "one frame"),
                20..40 => gaps.none(stamp_ns, if k == 20 { "lost" } else { "far" }),
                80.. => gaps.none(stamp_ns, "lost again"),
                _ => gaps.pose(stamp_ns),
            }
        }
        let found = gaps.done();
        assert_eq!(found.len(), 2);
        assert_eq!((found[0].from_s, found[0].to_s), (0.8, 1.56));
        assert_eq!((found[0].frames, found[0].to_the_end), (20, false));
        assert_eq!(found[0].first_reason, "lost");
        assert!(found[1].to_the_end);
        assert!(gaps.done().is_empty());
    }
}
