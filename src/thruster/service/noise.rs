//! At most one event per kind and second, with the count of those it stands for: a broken line must not flood the log.

use std::collections::HashMap;

const QUIET_NS: u64 = 1_000_000_000;

#[derive(Debug, Default)]
pub(super) struct Noise(HashMap<&'static str, (u64, u64)>);

impl Noise {
    /// One more of `kind`; `Some(count)` when an event may go out, for `count` of them.
    pub fn count(&mut self, kind: &'static str, now_ns: u64) -> Option<u64> {
        let (last_ns, held) = self.0.entry(kind).or_insert((0, 0));
        *held += 1;
        if *last_ns != 0 && now_ns < last_ns.saturating_add(QUIET_NS) {
            return None;
        }
        *last_ns = now_ns.max(1);
        Some(std::mem::take(held))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_per_second_and_kind_and_none_forgotten() {
        let mut noise = Noise::default();
        assert_eq!(noise.count("a", 5), Some(1));
        assert_eq!(noise.count("a", 6), None);
        assert_eq!(noise.count("b", 6), Some(1));
        assert_eq!(noise.count("a", 7), None);
        assert_eq!(noise.count("a", 2_000_000_000), Some(3));
    }
}
