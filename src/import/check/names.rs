//! Columns named like another channel than the one they are mapped to.

use hydroline_identify::data::CHANNELS;

use super::{Finding, name as name_of};
use crate::map::{Column, Map, Origin, PLACES};

/// A column named like another channel than the one it is mapped to.
pub(super) fn check(map: &Map, findings: &mut Vec<Finding>) {
    const PLAIN: [&str; 12] = [
        "x", "y", "z", "phi", "theta", "psi", "u", "v", "w", "p", "q", "r",
    ];
    const WORDS: [(&str, usize); 3] = [("roll", 3), ("pitch", 4), ("yaw", 5)];
    for channel in &map.channels {
        let (place, Origin::Column(Column::Name { name: column, .. })) =
            (channel.place, &channel.origin)
        else {
            continue;
        };
        let name = column.to_ascii_lowercase();
        let known = PLAIN
            .iter()
            .position(|p| *p == name)
            .or_else(|| CHANNELS.iter().position(|c| *c == name));
        let known = known.or_else(|| WORDS.iter().find(|(w, _)| *w == name).map(|w| w.1));
        if let Some(known) = known.filter(|k| *k != place) {
            findings.push(Finding::warning(
                "column_name",
                None,
                format!(
                    "column '{column}' is mapped to {} though it is named like {}",
                    name_of(place),
                    CHANNELS[known]
                ),
            ));
        }
    }
}

/// An sd that a log cannot hold: its covariance is one of all six numbers of the pose.
pub(super) fn sds(map: &Map, findings: &mut Vec<Finding>) {
    let given = |range: std::ops::Range<usize>| -> Vec<usize> {
        let own = |p: &usize| map.channels.iter().any(|c| c.place == *p && c.sd.is_some());
        range.filter(own).collect()
    };
    let (mut ignored, pose) = (given(6..PLACES), given(0..6));
    if pose.len() < 6 {
        ignored.extend(pose);
    }
    if !ignored.is_empty() {
        let names: Vec<&str> = ignored.into_iter().map(name_of).collect();
        findings.push(Finding::warning(
            "sd_ignored",
            None,
            format!(
                "sd of {}: not written, a log holds the covariance of all six pose channels or none; identify estimates the noise from a run at rest or the residuals",
                names.join(", ")
            ),
        ));
    }
}
