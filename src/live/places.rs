//! Places of connections: who is let in, and who gives way.
//!
//! A connection *waits* until one of its requests has passed the guard; from then on its place is *kept*. However many come and
//! send nothing, the next one gets in: the oldest that waits gives way to it, of the computer that has most of them waiting.
//! So whoever presses STOP always finds a place, and no crowd costs those theirs who look already.

use std::collections::BTreeMap;
use std::net::{IpAddr, Ipv6Addr};

/// Connections that wait: what a crowd has time for until the head of a request has come.
pub const WAITING_MAX: usize = 64;
/// Connections that are kept: eight viewers with the six that a browser opens at most, and some to spare.
pub const KEPT_MAX: usize = 64;
/// Of them those of one computer, so that one that wants them all leaves room for viewers elsewhere.
pub const KEPT_PER_PEER: usize = 48;

/// A computer: its address in IPv4, its network of 64 bits in IPv6, where each has as many addresses as it likes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Peer(IpAddr);

impl Peer {
    /// The computer behind an address.
    pub fn of(address: IpAddr) -> Self {
        match address.to_canonical() {
            IpAddr::V6(v6) => {
                let network = v6.to_bits() & !u128::from(u64::MAX);
                Self(Ipv6Addr::from_bits(network).into())
            }
            v4 => Self(v4),
        }
    }
}

impl std::fmt::Display for Peer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.0 {
            IpAddr::V4(address) => address.fmt(f),
            IpAddr::V6(network) => write!(f, "{network}/64"),
        }
    }
}

/// Number of a connection; the later has the greater one.
pub type Number = u64;

#[derive(Debug, Clone, Copy)]
struct Held {
    peer: Peer,
    kept: bool,
}

/// The connections that are open.
#[derive(Debug, Default)]
pub struct Places {
    held: BTreeMap<Number, Held>,
    next: Number,
}

impl Places {
    /// Open connections in all.
    pub fn count(&self) -> usize {
        self.held.len()
    }

    /// A place for one more connection, and the one that gives way to it.
    pub fn enter(&mut self, peer: Peer) -> (Number, Option<Number>) {
        let number = self.next;
        self.next += 1;
        self.held.insert(number, Held { peer, kept: false });
        let waiting = self.held.values().filter(|h| !h.kept).count();
        let gone = if waiting > WAITING_MAX {
            self.give_way()
        } else {
            None
        };
        (number, gone)
    }

    /// Ends the waiting connection that is due first, also where no place but something else is wanting; `None` = none waits.
    pub fn give_way(&mut self) -> Option<Number> {
        let mut of_peer: BTreeMap<Peer, (usize, Number)> = BTreeMap::new();
        for (number, held) in self.held.iter().filter(|(_, h)| !h.kept) {
            of_peer.entry(held.peer).or_insert((0, *number)).0 += 1;
        }
        let by_most = |(count, oldest): &(usize, Number)| (*count, std::cmp::Reverse(*oldest));
        let (_, oldest) = of_peer.into_values().max_by_key(by_most)?;
        self.held.remove(&oldest);
        Some(oldest)
    }

    /// Keeps the place of a connection whose request has passed the guard; false where there is no room: it is answered
    /// and goes.
    pub fn keep(&mut self, number: Number) -> bool {
        let Some(held) = self.held.get(&number).copied() else {
            return false;
        };
        if held.kept {
            return true;
        }
        let kept = || self.held.values().filter(|h| h.kept);
        let of_peer = kept().filter(|h| h.peer == held.peer).count();
        let room = kept().count() < KEPT_MAX && of_peer < KEPT_PER_PEER;
        if room && let Some(held) = self.held.get_mut(&number) {
            held.kept = true;
        }
        room
    }

    /// Whether a connection's place is kept.
    pub fn is_kept(&self, number: Number) -> bool {
        self.held.get(&number).is_some_and(|h| h.kept)
    }

    /// Gives the place back.
    pub fn leave(&mut self, number: Number) {
        self.held.remove(&number);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn peer(address: &str) -> Peer {
        Peer::of(address.parse().unwrap())
    }

    #[test]
    fn a_crowd_that_says_nothing_gives_way_and_whoever_was_let_in_does_not() {
        let mut places = Places::default();
        let crowd = peer("127.0.0.1");
        let (viewer, _) = places.enter(crowd);
        assert!(places.keep(viewer));
        let numbers: Vec<Number> = (0..500).map(|_| places.enter(crowd).0).collect();
        assert!(places.is_kept(viewer));
        assert_eq!(places.count(), 1 + WAITING_MAX);
        // The newest are there, the oldest are gone.
        assert!(places.keep(numbers[499]));
        assert!(!places.keep(numbers[0]));
    }

    #[test]
    fn whoever_comes_from_elsewhere_is_not_driven_out_by_a_crowd() {
        let mut places = Places::default();
        let (guest, _) = places.enter(peer("192.168.1.9"));
        for _ in 0..500 {
            let (_, gone) = places.enter(peer("192.168.1.7"));
            assert_ne!(gone, Some(guest));
        }
        assert!(places.keep(guest));
    }

    #[test]
    fn a_network_of_ipv6_is_one_computer() {
        assert_eq!(peer("2001:db8:1:2::7"), peer("2001:db8:1:2:ffff::1"));
        assert_ne!(peer("2001:db8:1:2::7"), peer("2001:db8:1:3::7"));
        assert_eq!(peer("::ffff:10.0.0.1"), peer("10.0.0.1"));
        assert_ne!(peer("10.0.0.1"), peer("10.0.0.2"));
        assert_eq!(peer("2001:db8:1:2::7").to_string(), "2001:db8:1:2::/64");
        let mut places = Places::default();
        let mut kept = 0;
        for k in 0..KEPT_MAX {
            let (number, _) = places.enter(peer(&format!("2001:db8:1:2::{k:x}")));
            kept += usize::from(places.keep(number));
        }
        assert_eq!(kept, KEPT_PER_PEER);
        let (elsewhere, _) = places.enter(peer("2001:db8:1:3::7"));
        assert!(places.keep(elsewhere));
    }

    #[test]
    fn a_place_that_is_given_back_is_free() {
        let mut places = Places::default();
        let one = peer("10.0.0.1");
        let numbers: Vec<Number> = (0..KEPT_PER_PEER).map(|_| places.enter(one).0).collect();
        assert!(numbers.iter().all(|n| places.keep(*n)));
        let (late, _) = places.enter(one);
        assert!(!places.keep(late));
        places.leave(numbers[7]);
        assert!(places.keep(late));
        assert!(places.give_way().is_none(), "all that are there are kept");
    }
}
