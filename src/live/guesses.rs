//! Limit on wrong tokens: how many a computer may try.
//!
//! A wrong token that a computer repeats (a page of yesterday that still asks) is no further guess: it does not keep the right one
//! out. Whoever has shown the right one on the same connection, or the session's key, guesses nothing and is not asked.

use super::guard::Refusal;
use super::places::Peer;
use std::collections::HashMap;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::time::{Duration, Instant};

/// Wrong tokens at once: more than anyone mistypes.
pub const GUESSES_MAX: usize = 10;
/// Then one in this time: 96 random bits last for ever either way, a word of a dictionary for weeks instead of minutes.
pub const GUESS_EVERY: Duration = Duration::from_secs(6);
/// Computers that are remembered, so that no memory grows with those that come.
const PEERS_MAX: usize = 1024;

#[derive(Debug)]
struct Tried {
    /// Wrong tokens, as hashes, with how often each came.
    wrong: Vec<(u64, usize)>,
    /// When the oldest of them is forgiven.
    forgiven: Instant,
}

/// Wrong tokens by computer.
#[derive(Debug, Default)]
pub struct Guesses(HashMap<Peer, Tried>);

fn digest(offered: &str) -> u64 {
    let mut hasher = DefaultHasher::new();
    offered.hash(&mut hasher);
    hasher.finish()
}

impl Guesses {
    fn forgive(&mut self, now: Instant) {
        self.0.retain(|_, tried| {
            while !tried.wrong.is_empty() && tried.forgiven <= now {
                tried.wrong.remove(0);
                tried.forgiven += GUESS_EVERY;
            }
            !tried.wrong.is_empty()
        });
    }

    /// Whether a token may be looked at.
    ///
    /// # Errors
    /// [`Refusal::Guesses`] after too many wrong ones; whether this one is right is then not said.
    pub fn admit(&mut self, peer: Peer, offered: &str, now: Instant) -> Result<(), Refusal> {
        self.forgive(now);
        let Some(tried) = self.0.get(&peer) else {
            return Ok(());
        };
        let offered = digest(offered);
        match tried.wrong.iter().find(|(wrong, _)| *wrong == offered) {
            Some((_, times)) if *times < GUESSES_MAX => Ok(()),
            None if tried.wrong.len() < GUESSES_MAX => Ok(()),
            _ => Err(Refusal::Guesses),
        }
    }

    /// Notes a token that was wrong.
    pub fn wrong(&mut self, peer: Peer, offered: &str, now: Instant) {
        if !self.0.contains_key(&peer) && self.0.len() >= PEERS_MAX {
            let first = self.0.iter().min_by_key(|(_, tried)| tried.forgiven);
            if let Some(first) = first.map(|(peer, _)| *peer) {
                self.0.remove(&first);
            }
        }
        let offered = digest(offered);
        let tried = self.0.entry(peer).or_insert_with(|| Tried {
            wrong: Vec::new(),
            forgiven: now + GUESS_EVERY,
        });
        match tried.wrong.iter_mut().find(|(wrong, _)| *wrong == offered) {
            Some((_, times)) => *times += 1,
            None => tried.wrong.push((offered, 1)),
        }
        if tried.wrong.len() == GUESSES_MAX && tried.wrong.last() == Some(&(offered, 1)) {
            tracing::warn!(
                "live page: {GUESSES_MAX} wrong tokens from {peer}: its next ones are looked at once in {} s",
                GUESS_EVERY.as_secs()
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn peer(address: &str) -> Peer {
        Peer::of(address.parse().unwrap())
    }

    #[test]
    fn guesses_are_limited_by_computer_and_forgiven_with_time() {
        let mut guesses = Guesses::default();
        let (one, other) = (peer("10.0.0.1"), peer("10.0.0.2"));
        let mut now = Instant::now();
        let mut looked_at = 0;
        for k in 0..100 {
            let guess = format!("guess {k}");
            if guesses.admit(one, &guess, now).is_ok() {
                guesses.wrong(one, &guess, now);
                looked_at += 1;
            }
        }
        assert_eq!(looked_at, GUESSES_MAX);
        assert_eq!(guesses.admit(one, "right", now), Err(Refusal::Guesses));
        assert_eq!(guesses.admit(other, "right", now), Ok(()));
        now += GUESS_EVERY;
        assert_eq!(guesses.admit(one, "right", now), Ok(()));
        guesses.wrong(one, "another", now);
        assert_eq!(guesses.admit(one, "right", now), Err(Refusal::Guesses));
        now += GUESS_EVERY * 2 * GUESSES_MAX as u32;
        guesses.forgive(now);
        assert!(guesses.0.is_empty(), "nothing is remembered for ever");
    }

    #[test]
    fn a_page_of_yesterday_that_goes_on_asking_keeps_nobody_out() {
        let mut guesses = Guesses::default();
        let (one, now) = (peer("10.0.0.1"), Instant::now());
        let mut looked_at = 0;
        for _ in 0..1000 {
            if guesses.admit(one, "yesterday's", now).is_ok() {
                guesses.wrong(one, "yesterday's", now);
                looked_at += 1;
            }
        }
        assert_eq!(looked_at, GUESSES_MAX);
        assert_eq!(guesses.admit(one, "right", now), Ok(()));
    }

    #[test]
    fn memory_does_not_grow_with_computers() {
        let mut guesses = Guesses::default();
        let now = Instant::now();
        for k in 0..3 * PEERS_MAX as u32 {
            let address = std::net::Ipv4Addr::from_bits(k).into();
            guesses.wrong(Peer::of(address), "guess", now);
        }
        assert_eq!(guesses.0.len(), PEERS_MAX);
    }
}
