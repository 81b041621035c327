//! `--live [ADDR]`: where the page may listen.

use super::token::{TOKEN_MAX, TOKEN_MIN};
use std::net::SocketAddr;

/// Where the page listens unless said otherwise: this computer alone.
pub const DEFAULT_ADDRESS: &str = "127.0.0.1:8080";

/// Why there is no live page.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum LiveError {
    #[error(
        "--live {address}: every computer that reaches this address could see the page and stop the thrusters; give it a \
         token (--live-token WORD, or HYDROLINE_LIVE_TOKEN, {TOKEN_MIN} to {TOKEN_MAX} letters, digits, - or _), or \
         leave it on this computer (--live {DEFAULT_ADDRESS}) and come through `ssh -L 8080:{DEFAULT_ADDRESS}`"
    )]
    Open { address: SocketAddr },
    /// A token that could be guessed, or that no address could carry.
    #[error(
        "--live-token: {length} characters; {TOKEN_MIN} to {TOKEN_MAX} letters, digits, - or _ are taken, e.g. {example}"
    )]
    Token { length: usize, example: String },
    /// The address is taken, or not this computer's.
    #[error(
        "--live {address}: {source}; another port (--live 127.0.0.1:8081) or any free one (--live 127.0.0.1:0) may do"
    )]
    Listen {
        address: SocketAddr,
        source: std::io::Error,
    },
    /// The kernel gave no randomness, or no thread.
    #[error("the live page does not start: {0}")]
    Start(#[from] std::io::Error),
}

/// Whether the page may listen there: on this computer alone, or anywhere with a token.
pub fn check_address(address: SocketAddr, has_token: bool) -> Result<(), LiveError> {
    if address.ip().is_loopback() || has_token {
        Ok(())
    } else {
        Err(LiveError::Open { address })
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
