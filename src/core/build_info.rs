//! Build of hydroline that is at work: printed by `--version`, written at the head of every log.
//!
//! The binary knows (its build script asks git) and hands it down; a room used as a library by someone else's program
//! knows its version and no commit.

use std::fmt;

/// Version of the workspace: all its crates carry the same.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");

/// Value that a build script writes where it knows nothing.
const UNKNOWN: &str = "unknown";

/// Version, commit and state of the sources that a binary was built from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BuildInfo {
    /// Semantic version.
    pub version: &'static str,
    /// First 12 hexadecimal digits of the git commit; `None` = unknown (built outside a checkout).
    pub commit: Option<&'static str>,
    /// Whether the sources differed from that commit; `None` = unknown.
    pub dirty: Option<bool>,
}

impl Default for BuildInfo {
    fn default() -> Self {
        Self {
            version: VERSION,
            commit: None,
            dirty: None,
        }
    }
}

impl BuildInfo {
    /// From what the build script of the binary sets: a commit or `unknown`, and `true`, `false` or `unknown`.
    pub fn from_build_script(commit: &'static str, dirty: &'static str) -> Self {
        let commit = Some(commit).filter(|c| !c.is_empty() && *c != UNKNOWN);
        Self {
            version: VERSION,
            commit,
            dirty: commit.and_then(|_| dirty.parse().ok()),
        }
    }

    /// The same as keys of a log's `session`: `version`, `commit` and `dirty`, each after `prefix`.
    pub fn session_keys(&self, prefix: &str) -> [(String, String); 3] {
        let dirty = self.dirty.map_or(UNKNOWN.to_owned(), |d| d.to_string());
        [
            ("version", self.version.to_owned()),
            ("commit", self.commit.unwrap_or(UNKNOWN).to_owned()),
            ("dirty", dirty),
        ]
        .map(|(key, value)| (format!("{prefix}{key}"), value))
    }
}

/// `0.1.0 (4042f4f1a2b3)`, `0.1.0 (4042f4f1a2b3, dirty)`, `0.1.0 (commit unknown)`.
impl fmt::Display for BuildInfo {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let version = self.version;
        match (self.commit, self.dirty) {
            (None, _) => write!(f, "{version} (commit unknown)"),
            (Some(commit), Some(true)) => write!(f, "{version} ({commit}, dirty)"),
            (Some(commit), Some(false)) => write!(f, "{version} ({commit})"),
            (Some(commit), None) => write!(f, "{version} ({commit}, perhaps dirty)"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_known_is_said_and_what_is_not_is_not_guessed() {
        let words = |commit, dirty| BuildInfo::from_build_script(commit, dirty).to_string();
        assert_eq!(
            words("4042f4f1a2b3", "false"),
            format!("{VERSION} (4042f4f1a2b3)")
        );
        assert_eq!(
            words("4042f4f1a2b3", "true"),
            format!("{VERSION} (4042f4f1a2b3, dirty)")
        );
        assert_eq!(
            words("4042f4f1a2b3", "unknown"),
            format!("{VERSION} (4042f4f1a2b3, perhaps dirty)")
        );
        // Without a commit there is nothing that the sources could differ from.
        for dirty in ["unknown", "true"] {
            assert_eq!(
                words("unknown", dirty),
                format!("{VERSION} (commit unknown)")
            );
        }
        let keys = BuildInfo::from_build_script("4042f4f1a2b3", "true").session_keys("replay.");
        let keys = keys.map(|(k, v)| format!("{k}={v}")).join(" ");
        assert_eq!(
            keys,
            format!("replay.version={VERSION} replay.commit=4042f4f1a2b3 replay.dirty=true")
        );
        let keys = BuildInfo::default().session_keys("").map(|(_, v)| v);
        assert_eq!(keys, [VERSION, "unknown", "unknown"]);
    }
}
