//! What is wrong with a map.

/// What is wrong with a map.
#[derive(Debug, thiserror::Error)]
pub enum MapError {
    /// The file.
    #[error("{path}: {source}; check the path and permissions")]
    Unreadable {
        /// Path.
        path: String,
        /// Why.
        source: std::io::Error,
    },
    /// TOML or its keys.
    #[error(
        "{file}: {source}\nhydroline import --help shows a map; mend the line, or give another --map"
    )]
    Toml {
        /// File.
        file: String,
        /// Where and what.
        source: Box<toml::de::Error>,
    },
    /// A value.
    #[error("{file}: {key} is {value}; {allowed}")]
    Value {
        /// File.
        file: String,
        /// Key.
        key: String,
        /// As given.
        value: String,
        /// What it may be.
        allowed: String,
    },
}
