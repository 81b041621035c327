//! The live page: what a run shows while it runs, and its STOP button.
//!
//! ```text
//! core, without I/O                             server (feature `server`)
//! state     what a run says of itself           server         accepts, limits, ends
//! picture   one frame with what is drawn on it  server/routes  axum: request -> guard -> answer
//! feed      latest values, who looks, STOP      server/encoder images to JPEG, while somebody looks
//! address   `--live [ADDR]`                     server/foxglove a viewer's WebSocket
//! guard     may this request be answered?       server/stalled a viewer that stops reading
//! guesses   how many wrong tokens it may try    server/open    the connections that are open
//! places    which connection gives way
//! token     secrets and their comparison
//! metrics   the state for Prometheus
//! page      one HTML file, everything in it
//! site      another page that only shows        server/site    the same guard and server for it
//! foxglove  the run as the log's topics, for Foxglove viewers (feature `server`)
//! ```
//!
//! Whoever publishes ([`Feed`]) never waits for whoever looks: there is one place for the newest state and one for the
//! newest picture, and each viewer asks for what is newer than what it has. A slow viewer sees fewer of them, and
//! costs nobody anything.
//!
//! ```
//! use hydroline_live::{Feed, State, Token, check_address};
//!
//! let outside = "0.0.0.0:8080".parse()?;
//! assert!(check_address(outside, false).is_err()); // off this computer only with a token
//! let token = Token::chosen("the-tank-of-building-7")?;
//! assert!(check_address(outside, true).is_ok() && !token.is("guess"));
//!
//! let feed = Feed::new(true);
//! let states = feed.states();
//! feed.publish(State::default());
//! assert!(states.borrow().value.is_some());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod address;
pub mod feed;
#[cfg(feature = "server")]
pub mod foxglove;
pub mod guard;
pub mod guesses;
#[cfg(feature = "server")]
pub mod jpeg;
pub mod metrics;
pub mod page;
pub mod picture;
pub mod places;
#[cfg(feature = "server")]
pub mod server;
pub mod site;
pub mod state;
pub mod token;

pub use address::{DEFAULT_ADDRESS, LiveError, check_address};
pub use feed::Feed;
pub use picture::Picture;
#[cfg(feature = "server")]
pub use server::Server;
pub use site::{Reply, Site};
pub use state::State;
pub use token::Token;
