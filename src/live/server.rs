//! The server: one thread with one small runtime, apart from everything that records.
//!
//! A viewer's cost is bounded: connections in all and per computer ([`places`](super::places)), the time to send a head, the time
//! to take an answer, one encoded picture at a time. Beyond that it is refused or cut off.

mod encoder;
mod foxglove;
mod gate;
mod open;
mod routes;
mod site;
mod stalled;

use super::address::{Flags, LIVE_FLAGS, LiveError, VIEW_FLAGS, check_address_of};
use super::feed::Feed;
use super::guard::Guard;
use super::site::Site;
use super::token::Token;
use axum::Router;
use hydroline_core::thread_class::{block_signals, step_back};
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use open::{Open, Opened};
use stalled::Stalled;
use std::net::SocketAddr;
use std::pin::pin;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;
use tokio::net::{TcpListener, TcpSocket, TcpStream};
use tokio::sync::watch;

/// Connections that the kernel holds until they are accepted: with fewer a crowd that comes at once makes the next one's
/// system try again only after a second.
const BACKLOG: u32 = 1024;
/// A head that is not there by then is none; a connection that nobody uses ends too.
const HEAD_WITHIN: Duration = Duration::from_secs(5);
/// A viewer that takes nothing of its answer for so long is cut off.
const TAKEN_WITHIN: Duration = Duration::from_secs(10);
/// Longest head; the page's own has less than 1 kB.
const HEAD_MAX: usize = 16 << 10;
/// At the end the last state still gets to whoever waits for it.
const FAREWELL: Duration = Duration::from_millis(300);
/// Between two attempts to accept, where that failed.
const AGAIN: Duration = Duration::from_millis(10);
/// Threads that read logs for a page: a picture need not wait for a plot.
const READERS: usize = 3;
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
        let app = |guard, open| routes::router(feed, guard, open);
        Self::serving(address, token, (LIVE_FLAGS, 1), app)
    }

    /// The same of a page that only shows.
    ///
    /// # Errors
    /// As [`Server::start`].
    pub fn showing(
        address: SocketAddr,
        token: Option<Token>,
        site: Arc<dyn Site>,
    ) -> Result<Self, LiveError> {
        let app = |guard, _| site::router(site, guard);
        Self::serving(address, token, (VIEW_FLAGS, READERS), app)
    }

    fn serving(
        address: SocketAddr,
        token: Option<Token>,
        (flags, readers): (Flags, usize),
        app: impl FnOnce(Guard, Open) -> Router,
    ) -> Result<Self, LiveError> {
        check_address_of(flags, address, token.is_some())?;
        let listen = |source| LiveError::Listen {
            flag: flags.listen,
            address,
            source,
        };
        let hostname = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
        let guard = Guard::new(token.clone(), Token::random()?, &hostname);
        let (ending, heard) = watch::channel(false);
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .max_blocking_threads(readers)
            .build()?;
        let listener = {
            let _inside = runtime.enter();
            listening(address).map_err(listen)?
        };
        let bound = listener.local_addr().map_err(listen)?;
        let open = Open::default();
        let app = app(guard, open.clone());
        let thread = std::thread::Builder::new()
            .name("live".to_owned())
            .spawn(move || {
                block_signals();
                step_back(NICENESS);
                // As a task among the others, so that it takes turns with them.
                let accepting = runtime.spawn(accept(listener, app, open, heard));
                let _ = runtime.block_on(accepting);
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

/// Listens, as a listener of the standard library does, with room for a crowd.
fn listening(address: SocketAddr) -> std::io::Result<TcpListener> {
    let socket = match address {
        SocketAddr::V4(_) => TcpSocket::new_v4()?,
        SocketAddr::V6(_) => TcpSocket::new_v6()?,
    };
    socket.set_reuseaddr(true)?;
    socket.bind(address)?;
    socket.listen(BACKLOG)
}

async fn ended(ending: &mut watch::Receiver<bool>) {
    let _ = ending.wait_for(|e| *e).await;
}

async fn accept(listener: TcpListener, app: Router, open: Open, mut ending: watch::Receiver<bool>) {
    loop {
        let accepted = tokio::select! {
            () = ended(&mut ending) => break,
            accepted = listener.accept() => accepted,
        };
        match accepted {
            Ok((stream, from)) => {
                let connection = open.enter(from.ip(), ending.clone());
                tokio::spawn(serve(stream, app.clone(), connection));
                // What it has sent already is read before another one may take its place.
                tokio::task::yield_now().await;
            }
            // Out of descriptors: one that waits gives back its own.
            Err(error) => {
                tracing::debug!("live page: {error}");
                open.give_way();
                tokio::time::sleep(AGAIN).await;
            }
        }
    }
    // Whoever waits for the last state gets it.
    tokio::time::sleep(FAREWELL).await;
}

async fn serve(stream: TcpStream, app: Router, mut opened: Opened) {
    let app = app.layer(axum::Extension(opened.connection.clone()));
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
        // First what it has sent: a STOP that is here is pressed, whoever has to give way.
        biased;
        // Garbage, a viewer that stalls or goes away: its own affair.
        closed = connection.as_mut() => drop(closed),
        () = opened.gives_way.notified() => {}
        () = ended(&mut opened.ending) => {
            connection.as_mut().graceful_shutdown();
            let _ = tokio::time::timeout(FAREWELL, connection).await;
        }
    }
}

#[cfg(test)]
mod tests;
