//! `--live [ADDR]`: where the page may listen.

use super::token::{TOKEN_MAX, TOKEN_MIN};
use std::net::SocketAddr;

/// Where the page listens unless said otherwise: this computer alone.
pub const DEFAULT_ADDRESS: &str = "127.0.0.1:8080";

/// Arguments of a command that opens a page, as its errors name them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Flags {
    /// Address to listen on.
    pub listen: &'static str,
    /// Token.
    pub token: &'static str,
    /// Deeds of whoever reaches an open page.
    pub could: &'static str,
}

/// The live page of a run.
pub const LIVE_FLAGS: Flags = Flags {
    listen: "--live",
    token: "--live-token",
    could: "see the page and stop the thrusters",
};

/// The page of finished logs.
pub const VIEW_FLAGS: Flags = Flags {
    listen: "--listen",
    token: "--live-token",
    could: "see the logs",
};

/// Why there is no live page.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum LiveError {
    #[error(
        "{listen} {address}: every computer that reaches this address could {could}; give it a \
         token ({token} WORD, or HYDROLINE_LIVE_TOKEN, {TOKEN_MIN} to {TOKEN_MAX} letters, digits, - or _), or \
         leave it on this computer ({listen} {DEFAULT_ADDRESS}) and come through `ssh -L 8080:{DEFAULT_ADDRESS}`",
        listen = flags.listen,
        could = flags.could,
        token = flags.token
    )]
    Open { flags: Flags, address: SocketAddr },
    /// A token that could be guessed, or that no address could carry.
    #[error(
        "--live-token: {length} characters; {TOKEN_MIN} to {TOKEN_MAX} letters, digits, - or _ are taken, e.g. {example}"
    )]
    Token { length: usize, example: String },
    /// The address is taken, or not this computer's.
    #[error(
        "{flag} {address}: {source}; another port ({flag} 127.0.0.1:8081) or any free one ({flag} 127.0.0.1:0) may do"
    )]
    Listen {
        flag: &'static str,
        address: SocketAddr,
        source: std::io::Error,
    },
    /// The kernel gave no randomness, or no thread.
    #[error("the live page does not start: {0}")]
    Start(#[from] std::io::Error),
}

/// Whether the live page may listen there: on this computer alone, or anywhere with a token.
pub fn check_address(address: SocketAddr, has_token: bool) -> Result<(), LiveError> {
    check_address_of(LIVE_FLAGS, address, has_token)
}

/// The same of any page.
pub fn check_address_of(
    flags: Flags,
    address: SocketAddr,
    has_token: bool,
) -> Result<(), LiveError> {
    if address.ip().is_loopback() || has_token {
        Ok(())
    } else {
        Err(LiveError::Open { flags, address })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn off_this_computer_only_with_a_token() {
        for inside in ["127.0.0.1:8080", "127.8.0.1:1", "[::1]:8080"] {
            assert!(check_address(inside.parse().unwrap(), false).is_ok());
        }
        for outside in ["0.0.0.0:8080", "[::]:80", "192.168.1.7:8080", "[fe80::1]:1"] {
            let address = outside.parse().unwrap();
            let error = check_address(address, false).unwrap_err().to_string();
            assert!(
                error.contains(outside) && error.contains("--live-token"),
                "{error}"
            );
            assert!(check_address(address, true).is_ok());
        }
    }
}
