//! A log on one screen.

use super::Info;
use hydroline_core::plain::Lines;
use std::fmt;

/// Lines of a log's short form: a screen.
const BRIEF_LINES: usize = 40;
/// Metadata that the short form leaves out: what identifies a file, a machine or a build, what other lines say already, and matrices
/// that nobody reads.
const ONLY_LONG: [&str; 16] = [
    "boot_id",
    "camera.response.",
    "commit",
    "dirty",
    "kernel",
    "frames.analysed",
    "frames.period_s",
    "messages.",
    "module.",
    "part",
    "planned_s",
    "queue.",
    "sha256",
    "source",
    "start_pose",
    "version",
];

/// A log on one screen, see [`Info::brief`].
#[derive(Debug, Clone, Copy)]
pub struct Brief<'a>(&'a Info);

impl Info {
    /// The same on at most forty lines: topics, damage, what is known of run and conditions, counts other than zero. What is left
    /// out is counted.
    pub fn brief(&self) -> Brief<'_> {
        Brief(self)
    }
}

/// Whether a key of metadata is on the short form: none of [`ONLY_LONG`], and no count of nothing.
pub(super) fn is_brief(key: &str, value: &str) -> bool {
    let left_out = |own: &&str| {
        let is_group = own.ends_with('.');
        key == *own
            || key
                .strip_prefix(*own)
                .is_some_and(|rest| is_group || rest.starts_with('.'))
    };
    let is_line = value.lines().count() == 1;
    value != "0" && is_line && !ONLY_LONG.iter().any(left_out)
}

impl fmt::Display for Brief<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut f = Lines(f);
        let info = self.0;
        let names: Vec<&str> = info.metadata.keys().map(String::as_str).collect();
        let carries = (!names.is_empty()).then(|| format!("  carries      {}", names.join(", ")));
        // What is damaged is said before what fills the screen.
        let lines = [
            info.head(),
            carries.into_iter().collect(),
            info.damage_lines(),
            info.topic_lines(),
            info.metadata_lines(false),
        ];
        let lines = lines.concat();
        let fits = lines.len() < BRIEF_LINES;
        let shown = if fits { lines.len() } else { BRIEF_LINES - 1 };
        for line in &lines[..shown] {
            writeln!(f, "{line}")?;
        }
        let all = info.head().len()
            + info.damage.len()
            + info.topics.len()
            + info.metadata_lines(true).len();
        // The line of names stands in for none of them.
        match all.saturating_sub(shown - usize::from(!names.is_empty())) {
            0 => Ok(()),
            more => writeln!(f, "  {more} more lines: --long"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::info::{Ending, TopicInfo, utc};
    use crate::part::MetadataMap;
    use std::collections::BTreeMap;
    use std::path::PathBuf;

    fn with(metadata: &[(&str, &str, &str)], topics: usize) -> Info {
        let mut maps: BTreeMap<String, MetadataMap> = BTreeMap::new();
        for (name, key, value) in metadata {
            let map = maps.entry((*name).to_owned()).or_default();
            map.insert((*key).to_owned(), (*value).to_owned());
        }
        Info {
            path: PathBuf::from("a.mcap"),
            bytes: 1,
            library: "x".to_owned(),
            profile: String::new(),
            ending: Ending::Whole,
            messages: 0,
            chunks: 0,
            attachments: 0,
            compression: BTreeMap::new(),
            start_ns: 0,
            start_utc: utc(0),
            end_ns: 0,
            duration_s: 0.0,
            topics: (0..topics)
                .map(|k| TopicInfo {
                    topic: format!("/t{k}"),
                    schema: String::new(),
                    encoding: "json".to_owned(),
                    messages: 1,
                    first_ns: 0,
                    last_ns: 0,
                    rate_hz: None,
                    bytes: 0,
                })
                .collect(),
            metadata: maps,
            damage: vec![(7, "bad".to_owned())],
        }
    }

    #[test]
    fn the_short_form_is_a_screen_and_says_what_it_leaves_out() {
        let metadata = [
            ("session", "operator", "Ada"),
            ("session", "sha256", "12ab"),
            ("session", "source.driver", "uvc"),
            ("summary", "frames.lost", "0"),
            ("summary", "frames.received", "192"),
            (
                "summary",
                "camera.response.line_variance",
                "0.0000000000012",
            ),
            ("summary", "noise", "-0.0000000000012"),
        ];
        let info = with(&metadata, 3);
        let brief = info.brief().to_string();
        for (words, is_there) in [
            ("operator = Ada", true),
            ("frames.received = 192", true),
            ("noise = -1.2e-12", true),
            ("DAMAGE at byte 7", true),
            ("sha256", false),
            ("source.driver", false),
            ("frames.lost", false),
            ("camera.response", false),
            ("  4 more lines: --long", true),
        ] {
            assert_eq!(brief.contains(words), is_there, "{words}: {brief}");
        }
        let long = info.to_string();
        assert!(
            long.contains("camera.response.line_variance = 1.2e-12"),
            "{long}"
        );
        // Whatever is in it, it is no longer than a screen, and nothing is lost unsaid.
        let many = with(&metadata, 200);
        let brief = many.brief().to_string();
        assert_eq!(brief.lines().count(), BRIEF_LINES);
        let left = many.to_string().lines().count() - (BRIEF_LINES - 2);
        assert!(
            brief.ends_with(&format!("  {left} more lines: --long\n")),
            "{brief}"
        );
    }
}
