//! May this request be answered? A function of the request's head alone.
//!
//! | who asks | kept out by |
//! |---|---|
//! | another computer | the address that is listened on; off loopback, the token |
//! | another site in the same browser | `Sec-Fetch-Site`, `Origin`; for STOP the session's key in a header of its own, which makes a browser ask first, and it is refused |
//! | another site as a Foxglove viewer | the token, or where there is none the list of those that are viewers |
//! | another site under a name that it points at us (DNS rebinding) | `Host`, and the target where it names a computer, has to be this computer |
//!
//! A browser without `Sec-Fetch-Site` (before 2020-2023) still reads nothing across sites: no answer of ours says that
//! it may.

use super::token::Token;

/// A header of a request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Header<'a> {
    /// Not there.
    Absent,
    /// There once.
    Once(&'a str),
    /// There several times, or not text: never trusted.
    Unclear,
}

impl<'a> Header<'a> {
    fn text(self) -> Option<&'a str> {
        match self {
            Header::Once(text) => Some(text),
            Header::Absent | Header::Unclear => None,
        }
    }

    fn is_absent_or(self, allowed: impl FnOnce(&str) -> bool) -> bool {
        match self {
            Header::Absent => true,
            Header::Once(text) => allowed(text),
            Header::Unclear => false,
        }
    }
}

/// The head of a request, as far as it decides anything.
#[derive(Debug, Clone, Copy)]
pub struct Asked<'a> {
    /// GET, POST, ...
    pub method: &'a str,
    /// Path without the query.
    pub path: &'a str,
    /// Query: the part after the question mark.
    pub query: &'a str,
    /// Computer that the target names, as in `GET http://COMPUTER/path`; `None` = it is a path alone.
    pub authority: Option<&'a str>,
    /// Header `Host`.
    pub host: Header<'a>,
    /// Header `Origin`.
    pub origin: Header<'a>,
    /// Sec-Fetch-Site.
    pub fetch_site: Header<'a>,
    /// Sec-Fetch-Mode.
    pub fetch_mode: Header<'a>,
    /// Header `Authorization`.
    pub authorization: Header<'a>,
    /// The session's key ([`SESSION_HEADER`]).
    pub session: Header<'a>,
    /// Something follows the head.
    pub has_body: bool,
}

/// Sites whose scripts may connect as a viewer without a token: Foxglove's app in the browser. `file://` is none of them: any
/// page that was ever saved to a disk comes under that name.
const VIEWERS: [&str; 1] = ["https://app.foxglove.dev"];

/// The header in which the page sends its session's key with every request.
pub const SESSION_HEADER: &str = "x-hydroline-session";

/// Target of a request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Route {
    /// The page.
    Page,
    /// The state newer than this one.
    State {
        /// Number of the state that the viewer has; 0 = none.
        after: u64,
    },
    /// The picture newer than this one.
    Picture {
        /// Number of the picture that the viewer has; 0 = none.
        after: u64,
    },
    /// The state for Prometheus.
    Metrics,
    /// A Foxglove viewer.
    Foxglove,
    /// The layout for it.
    FoxgloveLayout,
    /// Thrusters to neutral.
    Stop,
}

/// Why a request is not answered.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum Refusal {
    #[error("this page is asked for by this computer's address, not by that name")]
    Host,
    /// No token, or another.
    #[error("this page opens with its token: use the whole address that hydroline has printed")]
    Token,
    #[error(
        "too many wrong tokens from this address: wait a minute, then use the whole address that hydroline has printed"
    )]
    Guesses,
    #[error("another site has no business here")]
    OtherSite,
    #[error("the page is older than the run: load it again")]
    Session,
    #[error("only GET, and POST /stop")]
    Method,
    #[error("only GET: nothing is changed from here")]
    OnlyGet,
    #[error("no request here has a body")]
    Body,
    #[error(
        "there is /, /state, /picture, /metrics, /foxglove, /foxglove-layout.json and POST /stop"
    )]
    Unknown,
    #[error("there is no such thing here: load the page / again")]
    Nothing,
}

impl Refusal {
    /// The HTTP status.
    pub fn status(self) -> u16 {
        match self {
            Refusal::Host => 421,
            Refusal::Token => 401,
            Refusal::OtherSite | Refusal::Session => 403,
            Refusal::Unknown | Refusal::Nothing => 404,
            Refusal::Method | Refusal::OnlyGet => 405,
            Refusal::Body => 413,
            Refusal::Guesses => 429,
        }
    }
}

/// Who may see the page and press STOP.
#[derive(Debug, Clone)]
pub struct Guard {
    token: Option<Token>,
    session: Token,
    /// Names of this computer beside its addresses.
    names: Vec<String>,
}

impl Guard {
    /// `token` = what opens the page; `None` only on loopback. `session` = the key for STOP. `hostname` = this
    /// computer's name, by which others may call it where there is a token.
    pub fn new(token: Option<Token>, session: Token, hostname: &str) -> Self {
        let mut names = vec!["localhost".to_owned()];
        let name = hostname.trim().to_ascii_lowercase();
        if token.is_some() && !name.is_empty() {
            names.push(format!("{name}.local"));
            names.push(name);
        }
        Self {
            token,
            session,
            names,
        }
    }

    /// The session's key, for the page.
    pub fn session(&self) -> &Token {
        &self.session
    }

    /// Target of a request that may have it.
    ///
    /// # Errors
    /// [`Refusal`]; without the right token nothing else about the request is reported.
    pub fn check(&self, asked: &Asked<'_>) -> Result<Route, Refusal> {
        let named = self.entered(asked)?;
        let route = route(asked);
        let from_viewer = route == Ok(Route::Foxglove) && self.is_viewer(asked);
        if !from_viewer && !same_site(asked, named) {
            return Err(Refusal::OtherSite);
        }
        let route = route?;
        if asked.has_body {
            return Err(Refusal::Body);
        }
        if route == Route::Stop && !self.has_key(asked) {
            return Err(Refusal::Session);
        }
        Ok(route)
    }

    /// Whether a request may look at a page that only shows: one by which nothing can be changed, whatever it asks for.
    ///
    /// # Errors
    /// As [`Guard::check`].
    pub fn look(&self, asked: &Asked<'_>) -> Result<(), Refusal> {
        let named = self.entered(asked)?;
        if !same_site(asked, named) {
            return Err(Refusal::OtherSite);
        }
        if asked.method != "GET" {
            return Err(Refusal::OnlyGet);
        }
        match asked.has_body {
            true => Err(Refusal::Body),
            false => Ok(()),
        }
    }

    /// The name by which this computer is asked, where it is one of its own and the token is right.
    fn entered<'a>(&self, asked: &Asked<'a>) -> Result<&'a str, Refusal> {
        let host = asked.host.text().ok_or(Refusal::Host)?;
        // A target that names a computer goes before the header (RFC 9112, 3.2.2): both have to be this one.
        let named = asked.authority.unwrap_or(host);
        if !self.is_this_computer(host) || !self.is_this_computer(named) {
            return Err(Refusal::Host);
        }
        match self.opens(asked) {
            true => Ok(named),
            false => Err(Refusal::Token),
        }
    }

    /// Whether the request has the session's key: then its page was opened before.
    pub fn has_key(&self, asked: &Asked<'_>) -> bool {
        self.session.is(asked.session.text().unwrap_or_default())
    }

    /// The token that the request offers, right or wrong; `None` without one, and where none is needed.
    pub fn offered<'a>(&self, asked: &Asked<'a>) -> Option<&'a str> {
        self.token.as_ref()?;
        let bearer = asked.authorization.text();
        let bearer = bearer.and_then(|a| a.strip_prefix("Bearer "));
        bearer.or_else(|| parameter(asked.query, "token"))
    }

    /// An address as it stands, or a name of this computer: what a rebound name never is. The port may be another one,
    /// as behind `ssh -L`.
    fn is_this_computer(&self, host: &str) -> bool {
        let name = match host.strip_prefix('[') {
            Some(rest) => match rest.split_once(']') {
                Some((name, port)) if port.is_empty() || is_port(port) => {
                    return self
                        .is_address(name.parse::<std::net::Ipv6Addr>().ok().map(Into::into));
                }
                _ => return false,
            },
            None => match host.split_once(':') {
                Some((name, port)) if port.bytes().all(|b| b.is_ascii_digit()) => name,
                Some(_) => return false,
                None => host,
            },
        };
        let address = name.parse::<std::net::Ipv4Addr>().ok().map(Into::into);
        self.is_address(address) || self.names.iter().any(|n| n.eq_ignore_ascii_case(name))
    }

    fn is_address(&self, address: Option<std::net::IpAddr>) -> bool {
        address.is_some_and(|a| a.is_loopback() || self.token.is_some())
    }

    /// Whether a site that connects is a viewer: it has the token, or is one that shows what it is given to nobody else.
    fn is_viewer(&self, asked: &Asked<'_>) -> bool {
        let known = |origin: &str| VIEWERS.contains(&origin);
        self.token.is_some() || asked.origin.text().is_some_and(known)
    }

    fn opens(&self, asked: &Asked<'_>) -> bool {
        let offered = self.offered(asked).unwrap_or_default();
        self.token.as_ref().is_none_or(|token| token.is(offered))
    }
}

fn is_port(text: &str) -> bool {
    text.strip_prefix(':')
        .is_some_and(|p| p.bytes().all(|b| b.is_ascii_digit()))
}

/// Whether the request comes from our own page, from no page at all, or is somebody opening the page.
fn same_site(asked: &Asked<'_>, host: &str) -> bool {
    let own = |origin: &str| origin.strip_prefix("http://") == Some(host);
    let opening = asked.method == "GET"
        && asked.path == "/"
        && asked.fetch_mode == Header::Once("navigate")
        && asked.origin == Header::Absent;
    asked.origin.is_absent_or(own)
        && (opening
            || asked
                .fetch_site
                .is_absent_or(|site| site == "same-origin" || site == "none"))
}

fn route(asked: &Asked<'_>) -> Result<Route, Refusal> {
    let after = || parameter(asked.query, "after").map_or(0, |n| n.parse().unwrap_or(0));
    match (asked.method, asked.path) {
        ("GET", "/") => Ok(Route::Page),
        ("GET", "/state") => Ok(Route::State { after: after() }),
        ("GET", "/picture") => Ok(Route::Picture { after: after() }),
        ("GET", "/metrics") => Ok(Route::Metrics),
        ("GET", "/foxglove") => Ok(Route::Foxglove),
        ("GET", "/foxglove-layout.json") => Ok(Route::FoxgloveLayout),
        ("POST", "/stop") => Ok(Route::Stop),
        ("GET", "/stop")
        | (
            "POST",
            "/" | "/state" | "/picture" | "/metrics" | "/foxglove" | "/foxglove-layout.json",
        ) => Err(Refusal::Method),
        ("GET" | "POST", _) => Err(Refusal::Unknown),
        _ => Err(Refusal::Method),
    }
}

/// A parameter of a query. Nothing is decoded: what we ask for is letters and digits.
fn parameter<'a>(query: &'a str, name: &str) -> Option<&'a str> {
    query.split('&').find_map(|pair| {
        let (key, value) = pair.split_once('=')?;
        (key == name).then_some(value)
    })
}

#[cfg(test)]
mod tests;
