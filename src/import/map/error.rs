//! Errors of a map.

/// Error in a map, with the key and what to do.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum MapError {
    #[error("{path}: {source}; check the path and permissions")]
    Unreadable {
        path: String,
        source: std::io::Error,
    },
    #[error(
        "{file}: {source}\nhydroline import --help shows a map; mend the line, or give another --map"
    )]
    Toml {
        file: String,
        source: Box<toml::de::Error>,
    },
    #[error("{file}: {key} is {value}; {allowed}")]
    Value {
        file: String,
        key: String,
        value: String,
        allowed: String,
    },
}
