//! A page asks nobody but us, and puts nothing into itself as markup.

/// Fails where a page's own text could fetch something from elsewhere.
pub fn assert_none(ours: &str) {
    for fetched in [
        "http://",
        "https://",
        "//cdn",
        "url(",
        "@import",
        "src=",
        "href=",
        "eval(",
        "innerHTML",
    ] {
        assert!(!ours.contains(fetched), "{fetched}");
    }
}
