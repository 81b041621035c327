//! A page: one HTML file with its style, its script and the plotting library in it. Nothing else is fetched.

use super::guard::Guard;
use super::token::random_hex;
use std::io;

/// Document of every page, with places for its title, its body, its styles and its scripts.
const SHELL: &str = include_str!("page/shell.html");
/// First part of every page's script.
const COMMON: &str = include_str!("page/common.js");
const TITLE: &str = "hydroline live";
const BODY: &str = include_str!("page/page.html");
const STYLE: &str = include_str!("page/page.css");
const SCRIPT: &str = include_str!("page/page.js");
/// uPlot 1.6.32 by Leon Sorokin, under MIT (`page/LICENSE-uPlot`), from npm as it is.
const PLOT: &str = include_str!("page/uPlot.iife.min.js");
const PLOT_STYLE: &str = include_str!("page/uPlot.min.css");
/// Its licence goes with it.
const PLOT_LICENCE: &str = include_str!("page/LICENSE-uPlot");

/// The page and the policy that it is sent with.
#[derive(Debug, Clone)]
pub struct Page {
    /// The whole file.
    pub html: String,
    /// `Content-Security-Policy`: only what carries this page's nonce runs, and only we are asked for anything.
    pub policy: String,
}

/// The live page of a session, with a nonce of its own.
pub fn page(guard: &Guard) -> io::Result<Page> {
    filled(guard, TITLE, BODY, STYLE, SCRIPT)
}

/// Another page in the live page's style, with its plots, from the inner HTML of its body, its own style and its own script.
///
/// # Errors
/// Where the kernel gives no randomness.
pub fn another(
    guard: &Guard,
    title: &str,
    body: &str,
    style: &str,
    script: &str,
) -> io::Result<Page> {
    filled(guard, title, body, &[STYLE, style].concat(), script)
}

fn filled(guard: &Guard, title: &str, body: &str, style: &str, script: &str) -> io::Result<Page> {
    let nonce = random_hex(16)?;
    let html = SHELL
        .replace("{{title}}", title)
        .replace("{{body}}", body)
        .replace("{{nonce}}", &nonce)
        .replace("{{session}}", guard.session().text())
        .replace("{{style}}", style)
        .replace("{{plot-style}}", PLOT_STYLE)
        .replace("{{plot-licence}}", PLOT_LICENCE)
        .replace("{{plot}}", PLOT)
        .replace("{{script}}", &[COMMON, script].concat());
    let policy = format!(
        "default-src 'none'; script-src 'nonce-{nonce}'; style-src 'nonce-{nonce}'; img-src blob: data:; connect-src 'self'; \
         base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    );
    Ok(Page { html, policy })
}

#[cfg(test)]
#[path = "../../tests/support/no_fetch.rs"]
mod no_fetch;

#[cfg(test)]
mod tests {
    use super::super::guard::SESSION_HEADER;
    use super::super::token::Token;
    use super::*;

    fn made() -> Page {
        let guard = Guard::new(None, Token::random().unwrap(), "");
        page(&guard).unwrap()
    }

    #[test]
    fn the_page_is_small_and_whole() {
        let Page { html, policy } = made();
        assert!(html.len() <= 300_000, "{} bytes", html.len());
        assert!(!html.contains("{{"), "a place was not filled");
        let nonce = policy
            .split("nonce-")
            .nth(1)
            .unwrap()
            .split('\'')
            .next()
            .unwrap();
        let script = format!("<script nonce=\"{nonce}\">");
        assert_eq!(
            html.matches("<script").count(),
            html.matches(&script).count()
        );
        assert!(
            html.contains("Leon Sorokin"),
            "the library goes with its licence"
        );
    }

    #[test]
    fn nothing_is_fetched_from_anywhere() {
        no_fetch::assert_none(&[SHELL, COMMON, BODY, STYLE, SCRIPT].concat());
        // Names of namespaces are no addresses to fetch; the library has one address, of its home, in a comment.
        assert!(
            !PLOT
                .replace("https://github.com/leeoniya/uPlot", "")
                .contains("http")
        );
    }

    /// Polls without it counted as guesses: while somebody else at the same address guessed, the page stood still.
    #[test]
    fn every_request_of_the_page_has_the_key_of_its_session() {
        let script = [COMMON, SCRIPT].concat();
        let mut lines = script.lines().map(str::trim);
        let headers = lines.find(|l| l.starts_with("const headers = ")).unwrap();
        assert!(headers.to_ascii_lowercase().contains(SESSION_HEADER));
        let fetches: Vec<&str> = lines.filter(|l| l.contains("fetch(")).collect();
        assert!(fetches.len() >= 2, "{fetches:?}");
        assert!(
            fetches.iter().all(|l| l.contains(" headers, ")),
            "{fetches:?}"
        );
    }

    #[test]
    fn no_two_pages_share_a_nonce() {
        assert_ne!(made().policy, made().policy);
    }
}
