//! The server: one thread with one small runtime, apart from everything that records.
//!
//! A viewer's cost is bounded: connections in all and per computer, the time to send a head, the time to take
//! an answer, one encoded picture at a time. Beyond that it is refused or cut off.

mod encoder;
mod foxglove;
mod routes;
mod stalled;

use super::address::{LiveError, check_address};
use super::feed::Feed;
use super::guard::Guard;
use super::token::Token;
use axum::Router;
use hydroline_core::lock::Lock;
use hydroline_core::thread_class::{block_signals, step_back};
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use stalled::Stalled;
use std::collections::HashMap;
use std::net::{IpAddr, SocketAddr, TcpListener};
use std::pin::pin;
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;
use tokio::net::TcpStream;
use tokio::sync::watch;

/// Connections in all: eight viewers with the six that a browser opens at most, and some to spare.
const CONNECTIONS_MAX: usize = 64;
/// Connections of one computer, so that one that wants them all leaves room for a STOP from another.
const CONNECTIONS_PER_PEER: usize = 48;
/// A head that is not there by then is none; a connection that nobody uses ends too.
const HEAD_WITHIN: Duration = Duration::from_secs(5);
/// A viewer that takes nothing of its answer for so long is cut off.
const TAKEN_WITHIN: Duration = Duration::from_secs(10);
/// Longest head; the page's own has less than 1 kB.
const HEAD_MAX: usize = 16 << 10;
/// At the end the last state still gets to whoever waits for it.
const FAREWELL: Duration = Duration::from_millis(300);
/// Behind capture and thrusters, before extraction (10) and poses (19): a STOP must not wait for a picture.
const NICENESS: i32 = 5;

/// A running server; dropping it ends it.
#[derive(Debug)]
pub struct Server {
    address: SocketAddr,
    token: Option<Token>,
    ending: watch::Sender<bool>,
    thread: Option<JoinHandle<()>>,
}

impl Server {
    /// Listens and serves. A `token` opens the page; without one only loopback is served.
    ///
    /// # Errors
    /// [`LiveError`] when the address is open without a token, is taken, or the thread does not start.
    pub fn start(
        address: SocketAddr,
        token: Option<Token>,
        feed: Arc<Feed>,
    ) -> Result<Self, LiveError> {
        check_address(address, token.is_some())?;
        let listen = |source| LiveError::Listen { address, source };
        let listener = TcpListener::bind(address).map_err(listen)?;
        listener.set_nonblocking(true).map_err(listen)?;
        let bound = listener.local_addr().map_err(listen)?;
        let hostname = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
        let guard = Guard::new(token.clone(), Token::random()?, &hostname);
        let (ending, heard) = watch::channel(false);
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .max_blocking_threads(1)
            .build()?;
        let peers = Peers::default();
        let app = routes::router(feed, guard, peers.clone());
        let thread = std::thread::Builder::new()
            .name("live".to_owned())
            .spawn(move || {
                block_signals();
                step_back(NICENESS);
                runtime.block_on(async {
                    match tokio::net::TcpListener::from_std(listener) {
                        Ok(listener) => accept(listener, app, peers, heard).await,
                        Err(error) => tracing::warn!("no live page: {error}"),
                    }
                });
                runtime.shutdown_timeout(FAREWELL);
            })?;
        Ok(Self {
            address: bound,
            token,
            ending,
            thread: Some(thread),
        })
    }

    /// Where it listens.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Address for a browser, token and all.
    pub fn url(&self) -> String {
        self.url_of("http", "/")
    }

    /// Address for Foxglove's *Open connection*, token and all.
    pub fn foxglove_url(&self) -> String {
        self.url_of("ws", super::foxglove::PATH)
    }

    fn url_of(&self, scheme: &str, path: &str) -> String {
        let address = match self.address {
            any if any.ip().is_unspecified() => {
                let name = std::fs::read_to_string("/proc/sys/kernel/hostname");
                let name = name.map(|n| n.trim().to_owned()).unwrap_or_default();
                format!("{name}:{}", any.port())
            }
            one => one.to_string(),
        };
        match &self.token {
            Some(token) => format!("{scheme}://{address}{path}?token={}", token.text()),
            None => format!("{scheme}://{address}{path}"),
        }
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.ending.send_replace(true);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Open connections by computer.
#[derive(Debug, Clone, Default)]
pub(super) struct Peers(Arc<Mutex<HashMap<IpAddr, usize>>>);

/// One of them; dropping it gives its place back.
#[derive(Debug)]
struct Place {
    peers: Peers,
    ip: IpAddr,
}

/// A connection, for what outlives its request: its place is kept until the last of it is gone.
#[derive(Debug, Clone)]
struct Connection {
    _place: Arc<Place>,
    ending: watch::Receiver<bool>,
}

impl Peers {
    /// Open connections in all.
    pub(super) fn count(&self) -> usize {
        self.0.held().values().sum()
    }

    /// A place for one more connection, if there is one.
    fn enter(&self, ip: IpAddr) -> Option<Place> {
        let mut peers = self.0.held();
        let all: usize = peers.values().sum();
        let of_it = peers.get(&ip).copied().unwrap_or(0);
        if all >= CONNECTIONS_MAX || of_it >= CONNECTIONS_PER_PEER {
            return None;
        }
        peers.insert(ip, of_it + 1);
        Some(Place {
            peers: self.clone(),
            ip,
        })
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        let mut peers = self.peers.0.held();
        match peers.get_mut(&self.ip) {
            Some(n) if *n > 1 => *n -= 1,
            _ => {
                peers.remove(&self.ip);
            }
        }
    }
}

async fn ended(ending: &mut watch::Receiver<bool>) {
    let _ = ending.wait_for(|e| *e).await;
}

async fn accept(
    listener: tokio::net::TcpListener,
    app: Router,
    peers: Peers,
    mut ending: watch::Receiver<bool>,
) {
    loop {
        let accepted = tokio::select! {
            () = ended(&mut ending) => break,
            accepted = listener.accept() => accepted,
        };
        match accepted {
            Ok((stream, from)) => {
                // Full: closed without a word, before a byte of it is read.
                if let Some(place) = peers.enter(from.ip()) {
                    tokio::spawn(serve(stream, app.clone(), place, ending.clone()));
                }
            }
            // Out of descriptors: what is open may close meanwhile.
            Err(error) => {
                tracing::debug!("live page: {error}");
                tokio::time::sleep(Duration::from_millis(100)).await;
            }
        }
    }
    // Whoever waits for the last state gets it.
    tokio::time::sleep(FAREWELL).await;
}

async fn serve(stream: TcpStream, app: Router, place: Place, mut ending: watch::Receiver<bool>) {
    let held = Connection {
        _place: Arc::new(place),
        ending: ending.clone(),
    };
    let app = app.layer(axum::Extension(held));
    let _ = stream.set_nodelay(true);
    let io = TokioIo::new(Stalled::new(stream, TAKEN_WITHIN));
    let connection = hyper::server::conn::http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(HEAD_WITHIN)
        .max_buf_size(HEAD_MAX)
        .serve_connection(io, TowerToHyperService::new(app))
        .with_upgrades();
    let mut connection = pin!(connection);
    tokio::select! {
        // Garbage, a viewer that stalls or goes away: its own affair.
        closed = connection.as_mut() => drop(closed),
        () = ended(&mut ending) => {
            connection.as_mut().graceful_shutdown();
            let _ = tokio::time::timeout(FAREWELL, connection).await;
        }
    }
}

#[cfg(test)]
mod tests;
