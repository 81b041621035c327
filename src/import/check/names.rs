//! Columns named like another channel than the one they are mapped to.

use hydroline_core::run::Channel;

use super::{Finding, FindingList, name as name_of};
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
            .or_else(|| Channel::named(&name).map(Channel::index));
        let known = known.or_else(|| WORDS.iter().find(|(w, _)| *w == name).map(|w| w.1));
        if let Some(known) = known.filter(|k| *k != place) {
            findings.warning(
                "column_name",
                format!(
                    "column '{column}' is mapped to {} though it is named like {}",
                    name_of(place),
                    name_of(known)
                ),
            );
        }
    }
}

/// An sd's use: a channel's least noise, a covariance of the pose where all six channels of it have one, nothing of a companion.
pub(super) fn sds(map: &Map, findings: &mut Vec<Finding>) {
    let given = |range: std::ops::Range<usize>| -> Vec<&'static str> {
        let own = |p: &usize| map.channels.iter().any(|c| c.place == *p && c.sd.is_some());
        range.filter(own).map(name_of).collect()
    };
    let (channels, companions) = (
        given(0..Channel::ALL.len()),
        given(Channel::ALL.len()..PLACES),
    );
    if !channels.is_empty() {
        let pose = match given(0..6).len() {
            6 => "the pose's covariance is written with every sample",
            _ => {
                "no covariance is written with the samples: a log holds that of all six pose channels or none"
            }
        };
        findings.info(
            "instrument_sd",
            format!(
                "sd of {}: the least noise that diagnose takes for the channel; {pose}",
                channels.join(", "),
            ),
        );
    }
    if !companions.is_empty() {
        findings.warning(
            "sd_ignored",
            format!(
                "sd of {}: not written, what is measured beside the motion drives it and has no noise",
                companions.join(", "),
            ),
        );
    }
}
