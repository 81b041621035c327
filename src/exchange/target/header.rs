//! What every written file says at its head.

use hydroline_coefficients::regime::Range;
use hydroline_report::significant;
use hydroline_rigs::{Dof, Rig};

use super::About;
use crate::lost::{Difference, Lost};

/// Lines without the language's comment signs; empty lines between the parts.
pub fn lines(
    rig: &Rig,
    held: &[String],
    lost: &[Lost],
    differences: &[Difference],
    about: &About<'_>,
) -> Vec<String> {
    let mut lines = vec![
        format!("Model of {}, written by {}.", rig.name, about.made_by),
        String::new(),
        "SI units, angles in radians. Tank frame z down; body frame x forward, y starboard, z down, origin at the centre of gravity;".to_owned(),
        "Euler angles ZYX. Rates in the body frame, over ground.".to_owned(),
        String::new(),
    ];
    lines.push(if held.is_empty() {
        "Effects: none.".to_owned()
    } else {
        format!("Effects: {}.", held.join(", "))
    });
    lines.push(String::new());
    lines.extend(validity(rig, about.ranges));
    lines.push(String::new());
    lines.extend(loss(lost, differences));
    lines
}

/// Ranges of validity, in words.
pub fn validity(rig: &Rig, ranges: &[Range]) -> Vec<String> {
    let mut lines = vec!["Ranges of validity:".to_owned()];
    let limits = &rig.limits;
    let degrees = significant(limits.attitude_rad.to_degrees());
    lines.push(format!(
        "- attitude: roll and pitch up to {degrees} deg (the rig's [limits])"
    ));
    if ranges.is_empty() {
        lines.push("- speeds: not known; the result of `hydroline identify --json` says them (--seen RESULT.json)".to_owned());
    }
    for range in ranges {
        let is_turn = Dof::ALL
            .iter()
            .any(|d| d.name() == range.dof && d.index() > 2);
        let (speed, way) = if is_turn {
            ("rad/s", "rad")
        } else {
            ("m/s", "m")
        };
        let two = |[low, high]: [f64; 2]| format!("{} .. {}", significant(low), significant(high));
        let mut line = format!(
            "- {}: runs of up to {} {speed}",
            range.dof,
            two(range.speed)
        );
        if let Some(amplitude) = range.amplitude {
            line += &format!(", amplitudes {} {way}", two(amplitude));
        }
        if let Some(frequency) = range.frequency_hz {
            line += &format!(", frequencies {} Hz", two(frequency));
        }
        lines.push(line);
    }
    lines
}

/// The list of what is lost.
fn loss(lost: &[Lost], differences: &[Difference]) -> Vec<String> {
    let mut lines = vec!["Lost in export:".to_owned()];
    if lost.is_empty() {
        lines.push("- nothing".to_owned());
    }
    lines.extend(lost.iter().map(|l| format!("- {}: {}", l.what, l.why)));
    for d in differences {
        lines.push(format!(
            "- over the plan {} the motion is another one by up to {} mm and {} deg",
            d.plan,
            significant(d.position_mm),
            significant(d.attitude_deg)
        ));
    }
    lines
}
