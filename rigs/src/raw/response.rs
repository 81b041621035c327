//! `[camera.response]` as typed.

use super::{Section, quantity};
use crate::StatedResponse;

/// Longest text that says where a response comes from.
const SOURCE_MOST: usize = 400;

/// `Some(None)`: the rig does not state it. `None`: reported.
pub(super) fn read_response(camera: &Section<'_>) -> Option<Option<StatedResponse>> {
    if !camera.has("response") {
        camera.item("response");
        return Some(None);
    }
    let s = camera.table("response");
    let gamma = s.number(
        "gamma",
        quantity(0.2, 5.0, "").hint("1 leaves light as it is; sRGB is about 0.42"),
    );
    let gamma_sd = s.number(
        "gamma_sd",
        quantity(0.0, 1.0, "").hint("0 says that gamma is known for certain"),
    );
    let black = s.number_opt("black_levels", quantity(-64.0, 64.0, "grey levels"));
    let black_sd = s.number_opt("black_levels_sd", quantity(0.0, 64.0, "grey levels"));
    let correlation = s.number_or("gamma_black_correlation", quantity(-0.999, 0.999, ""), 0.0);
    let ceiling = s.integer_opt("ceiling_levels", 64, 255, "grey levels");
    let source = read_source(&s);
    s.finish();
    let mut sound = true;
    for (key, there, other, stated) in [
        ("black_levels_sd", black_sd, "black_levels", black),
        ("black_levels", black, "black_levels_sd", black_sd),
    ] {
        if there.is_none() && stated.is_some() && !s.has(key) {
            s.missing(
                key,
                format!("`{key} = …`: it goes with {other}, which says nothing without it"),
            );
            sound = false;
        }
    }
    let uncertain = gamma_sd.is_some_and(|sd| sd > 0.0) && black_sd.is_some_and(|sd| sd > 0.0);
    if correlation != 0.0 && !uncertain {
        s.rule(
            "gamma_black_correlation",
            format!("{correlation}, but gamma_sd and black_levels_sd are not both above 0"),
            "Leave it out, or enter both standard deviations",
        );
        sound = false;
    }
    let stated = StatedResponse {
        gamma: gamma?,
        gamma_sd: gamma_sd?,
        black_levels: black.zip(black_sd).map(|(level, sd)| [level, sd]),
        gamma_black_correlation: correlation,
        ceiling_levels: ceiling.map(|level| level as u8),
        source: source?,
    };
    // What was typed and refused is none.
    let refused = [
        ("black_levels", black.is_none()),
        ("black_levels_sd", black_sd.is_none()),
        ("ceiling_levels", ceiling.is_none()),
    ];
    let refused = refused.iter().any(|(key, none)| *none && s.has(key));
    (sound && !refused).then_some(Some(stated))
}

fn read_source(s: &Section<'_>) -> Option<String> {
    let expected = format!(
        "a text of 1 to {SOURCE_MOST} letters that says where these numbers come from, like \"data sheet\" or \"hydroline flat, 2026-11-26\""
    );
    s.asks_for("source", "text", &expected);
    s.requires("source");
    if !s.has("source") {
        s.item("source");
        s.missing("source", format!("`source = \"…\"`, {expected}"));
        return None;
    }
    let (text, item) = s.text_opt("source", &expected)?;
    let length = text.chars().count();
    if text.trim().is_empty() || length > SOURCE_MOST || text.chars().any(char::is_control) {
        s.wrong_type(&item, expected);
        return None;
    }
    Some(text)
}
