//! Requests to the live page: whatever a head holds, only the session's key stops and only the token opens.
#![no_main]

use hydroline::live::Token;
use hydroline::live::guard::{Asked, Guard, Header, Route};
use libfuzzer_sys::fuzz_target;

#[path = "support/memory.rs"]
mod memory;
use memory::bounded;

const TOKEN: &str = "a-token-for-tests-0123";
const KEY: &str = "a-session-key-012345";

fuzz_target!(|bytes: &[u8]| bounded(bytes.len(), 1 << 16, 64, || requests(bytes)));

fn requests(bytes: &[u8]) {
    let text = String::from_utf8_lossy(bytes);
    let mut parts = text.split('\n');
    let mut part = || parts.next().unwrap_or_default();
    let (method, path, query) = (part(), part(), part());
    let given: Vec<&str> = (0..6).map(|_| part()).collect();
    let (has_body, authority) = (part() == "body", part());
    let of = |i: usize| match given[i] {
        "" => Header::Absent,
        "?" => Header::Unclear,
        text => Header::Once(text),
    };
    let asked = Asked {
        method,
        path,
        query,
        authority: (!authority.is_empty()).then_some(authority),
        host: of(0),
        origin: of(1),
        fetch_site: of(2),
        fetch_mode: of(3),
        authorization: of(4),
        session: of(5),
        has_body,
    };
    let key = Token::chosen(KEY).expect("long enough");
    let token = Token::chosen(TOKEN).expect("long enough");
    for token in [None, Some(token)] {
        let opens = token.is_none() || query.contains(TOKEN) || given[4].contains(TOKEN);
        let guard = Guard::new(token, key.clone(), "tank-pc");
        if let Ok(route) = guard.check(&asked) {
            assert!(opens, "{asked:?}");
            assert_eq!(route == Route::Stop, method == "POST", "{asked:?}");
            assert!(route != Route::Stop || given[5] == KEY, "{asked:?}");
        }
    }
}
