//! The connections that are open, as tasks and requests hold them: the adapter of [`places`](super::super::places).

use super::super::places::{Number, Peer, Places};
use hydroline_core::lock::Lock;
use std::collections::HashMap;
use std::net::IpAddr;
use std::sync::{Arc, Mutex};
use tokio::sync::{Notify, watch};

#[derive(Debug, Default)]
struct Held {
    places: Places,
    /// Tells a connection that it gives way.
    ends: HashMap<Number, Arc<Notify>>,
}

impl Held {
    fn end(&mut self, gone: Option<Number>) {
        if let Some(end) = gone.and_then(|number| self.ends.remove(&number)) {
            end.notify_one();
        }
    }
}

/// All of them.
#[derive(Debug, Clone, Default)]
pub(super) struct Open(Arc<Mutex<Held>>);

/// A connection that was just accepted.
pub(super) struct Opened {
    pub(super) connection: Connection,
    /// Notified when another one takes its place.
    pub(super) gives_way: Arc<Notify>,
    pub(super) ending: watch::Receiver<bool>,
}

/// One of them; dropping it gives its place back.
#[derive(Debug)]
struct Place {
    open: Open,
    number: Number,
    peer: Peer,
}

/// A connection, for what outlives its request: its place is its own until the last of it is gone.
#[derive(Debug, Clone)]
pub(super) struct Connection {
    place: Arc<Place>,
    pub(super) ending: watch::Receiver<bool>,
}

impl Open {
    /// Open connections in all.
    pub(super) fn count(&self) -> usize {
        self.0.held().places.count()
    }

    /// Lets one more in, whoever has to give way.
    pub(super) fn enter(&self, ip: IpAddr, ending: watch::Receiver<bool>) -> Opened {
        let (peer, gives_way) = (Peer::of(ip), Arc::new(Notify::new()));
        let mut held = self.0.held();
        let (number, gone) = held.places.enter(peer);
        held.ends.insert(number, gives_way.clone());
        held.end(gone);
        drop(held);
        let open = self.clone();
        let place = Place { open, number, peer };
        let connection = Connection {
            place: Arc::new(place),
            ending: ending.clone(),
        };
        Opened {
            connection,
            gives_way,
            ending,
        }
    }

    /// Ends a connection that waits.
    pub(super) fn give_way(&self) {
        let mut held = self.0.held();
        let gone = held.places.give_way();
        held.end(gone);
    }
}

impl Connection {
    /// The computer at its other end.
    pub(super) fn peer(&self) -> Peer {
        self.place.peer
    }

    /// Keeps its place, as a request of it has passed the guard; false where there is no room.
    pub(super) fn keep(&self) -> bool {
        let Place { open, number, .. } = &*self.place;
        open.0.held().places.keep(*number)
    }

    /// Whether a request of it has passed the guard before, and its place is kept.
    pub(super) fn is_kept(&self) -> bool {
        let Place { open, number, .. } = &*self.place;
        open.0.held().places.is_kept(*number)
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        let mut held = self.open.0.held();
        held.places.leave(self.number);
        held.ends.remove(&self.number);
    }
}
