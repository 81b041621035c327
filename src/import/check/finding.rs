//! Findings about a table: severity, kind, line and message.

/// Severity of a finding, the least first.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, serde::Serialize, schemars::JsonSchema,
)]
#[serde(rename_all = "snake_case")]
pub enum Severity {
    /// Good to know.
    Info,
    /// Looks wrong; nothing is lost.
    Warning,
    /// Is wrong, or would lose data: stops the import unless accepted.
    Fault,
}

/// One finding.
#[derive(Debug, Clone, PartialEq, serde::Serialize, schemars::JsonSchema)]
pub struct Finding {
    /// Severity of the finding.
    pub severity: Severity,
    /// Stable machine word.
    pub kind: &'static str,
    /// First line of the file it concerns, as an editor counts them.
    pub line: Option<u64>,
    /// For a person: what, where, what to do.
    pub message: String,
}

impl Finding {
    pub(crate) fn fault(kind: &'static str, line: Option<u64>, message: String) -> Self {
        Finding {
            severity: Severity::Fault,
            kind,
            line,
            message,
        }
    }
    pub(crate) fn warning(kind: &'static str, line: Option<u64>, message: String) -> Self {
        Finding {
            severity: Severity::Warning,
            kind,
            line,
            message,
        }
    }
    pub(crate) fn info(kind: &'static str, message: String) -> Self {
        Finding {
            severity: Severity::Info,
            kind,
            line: None,
            message,
        }
    }

    /// Subject of the message: the words before the first colon, or none.
    pub(crate) fn subject(&self) -> &str {
        self.message.split_once(':').map_or("", |(s, _)| s)
    }
}

pub(crate) trait FindingList {
    fn add(&mut self, finding: Finding);

    /// A fault of the file as a whole.
    fn fault(&mut self, kind: &'static str, message: String) {
        self.add(Finding::fault(kind, None, message));
    }

    fn fault_at(&mut self, kind: &'static str, line: Option<u64>, message: String) {
        self.add(Finding::fault(kind, line, message));
    }

    /// A warning about the file as a whole.
    fn warning(&mut self, kind: &'static str, message: String) {
        self.add(Finding::warning(kind, None, message));
    }

    fn warning_at(&mut self, kind: &'static str, line: Option<u64>, message: String) {
        self.add(Finding::warning(kind, line, message));
    }

    fn info(&mut self, kind: &'static str, message: String) {
        self.add(Finding::info(kind, message));
    }
}

impl FindingList for Vec<Finding> {
    fn add(&mut self, finding: Finding) {
        self.push(finding);
    }
}
