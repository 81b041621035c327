//! `--live [ADDR]`, the same for every command that has it.

use super::CliError;
use super::print::errln;
use hydroline_daemon::live::Live;
use hydroline_live::{DEFAULT_ADDRESS, Feed, LiveError, Server, Token, check_address};
use std::net::{SocketAddr, ToSocketAddrs};
use std::path::Path;
use std::sync::Arc;

/// The page's flags.
#[derive(Debug, clap::Args)]
pub struct LiveArgs {
    /// Shows the run on a page in the browser, image to STOP button, and to Foxglove; on this computer alone unless there is a token
    #[arg(long, value_parser = address, num_args = 0..=1, default_missing_value = DEFAULT_ADDRESS, value_name = "ADDR")]
    live: Option<SocketAddr>,
    /// Opens the page to other computers; without it --live stays on this one (also HYDROLINE_LIVE_TOKEN)
    #[arg(long, value_name = "WORD")]
    live_token: Option<String>,
}

/// Where the token may stand instead: a command line can be read by everybody on the computer.
const TOKEN_VARIABLE: &str = "HYDROLINE_LIVE_TOKEN";

/// ADDRESS:PORT.
pub(super) fn address(text: &str) -> Result<SocketAddr, String> {
    let words = || {
        format!(
            "'{text}' is no ADDRESS:PORT, like {DEFAULT_ADDRESS}; where something else follows, write --live={DEFAULT_ADDRESS}"
        )
    };
    let mut found = text.to_socket_addrs().map_err(|_| words())?;
    found.next().ok_or_else(words)
}

/// The token that a flag names, else the environment.
pub(super) fn token(named: Option<&str>) -> Result<Option<Token>, LiveError> {
    let text = match named {
        Some(text) => Some(text.to_owned()),
        None => std::env::var(TOKEN_VARIABLE).ok(),
    };
    text.as_deref().map(Token::chosen).transpose()
}

/// A page that is being shown.
#[derive(Debug)]
pub struct Shown {
    /// Feed that the run publishes to.
    pub feed: Arc<Feed>,
    _server: Server,
}

impl LiveArgs {
    /// The token, from the flag or the environment.
    fn token(&self) -> Result<Option<Token>, LiveError> {
        token(self.live_token.as_deref())
    }

    /// Whether these can be used, before any work is done.
    ///
    /// # Errors
    /// [`CliError::Config`] for an open address without a token, or a token that could be guessed.
    pub fn check(&self) -> Result<(), CliError> {
        let Some(address) = self.live else {
            return match self.live_token {
                Some(_) => Err(CliError::Config(format!(
                    "--live-token without --live: nothing is shown; --live 0.0.0.0:8080 shows the run to other computers, --live {DEFAULT_ADDRESS} to this one"
                ))),
                None => Ok(()),
            };
        };
        let token = self.token()?;
        Ok(check_address(address, token.is_some())?)
    }

    /// Starts the page and says where it is; `None` when it was not asked for. `stops` = there are thrusters.
    ///
    /// # Errors
    /// As [`Self::check`], and when the address is taken.
    pub fn start(&self, stops: bool) -> Result<Option<Shown>, CliError> {
        let Some(address) = self.live else {
            return Ok(None);
        };
        let feed = Arc::new(Feed::new(stops));
        let server = Server::start(address, self.token()?, feed.clone())?;
        errln!("hydroline: live page: {}", server.url());
        errln!("hydroline: for Foxglove: {}", server.foxglove_url());
        Ok(Some(Shown {
            feed,
            _server: server,
        }))
    }
}

impl Shown {
    /// A run's own view of the page.
    pub fn run(&self, title: String, log: &Path) -> Live {
        Live {
            feed: self.feed.clone(),
            title,
            log: log.to_owned(),
        }
    }

    /// STOP was pressed: no run follows.
    pub fn stopped(&self) -> bool {
        self.feed.pressed()
    }
}

/// Title of the page: the rig, and the file or the plan.
pub fn title(parts: &[&str]) -> String {
    parts.join(" \u{b7} ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_is_one_and_a_log_is_not() {
        assert_eq!(address(DEFAULT_ADDRESS).unwrap().port(), 8080);
        assert!(address("[::1]:80").unwrap().ip().is_loopback());
        let words = address("run.mcap").unwrap_err();
        assert!(words.contains("--live=127.0.0.1:8080"), "{words}");
        assert!(address("127.0.0.1").is_err());
    }

    #[test]
    fn an_open_address_wants_a_token() {
        let args = |live: &str, token: Option<&str>| LiveArgs {
            live: Some(live.parse().unwrap()),
            live_token: token.map(str::to_owned),
        };
        assert!(matches!(
            args("0.0.0.0:8080", Some("short")).check(),
            Err(CliError::Config(_))
        ));
        assert!(
            args("0.0.0.0:8080", Some("long-enough-for-a-token"))
                .check()
                .is_ok()
        );
        assert!(args(DEFAULT_ADDRESS, None).check().is_ok());
    }
}
