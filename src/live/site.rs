//! A page that only shows, with what it asks for: nothing can be changed through it.

use super::guard::Guard;
use super::page::Page;
use std::io;

/// Answer to a request that passed the guard.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Reply {
    /// The HTTP status.
    pub status: u16,
    /// Type of the content.
    pub kind: &'static str,
    /// The content.
    pub body: Vec<u8>,
    /// Name under which a browser saves it; `None` = it is shown.
    pub download: Option<String>,
}

impl Reply {
    /// Content that is shown.
    pub fn of(kind: &'static str, body: Vec<u8>) -> Self {
        Self {
            status: 200,
            kind,
            body,
            download: None,
        }
    }

    /// Words instead of content.
    pub fn words(status: u16, words: &str) -> Self {
        Self {
            status,
            ..Self::of(
                "text/plain; charset=utf-8",
                format!("{words}\n").into_bytes(),
            )
        }
    }
}

/// A page and what it asks for.
pub trait Site: Send + Sync + 'static {
    /// The page.
    ///
    /// # Errors
    /// Where the kernel gives no randomness for its nonce.
    fn page(&self, guard: &Guard) -> io::Result<Page>;

    /// Answer to what the page asks for; `None` = there is no such thing. It may take as long as reading a file does.
    fn answer(&self, path: &str, query: &str) -> Option<Reply>;
}
