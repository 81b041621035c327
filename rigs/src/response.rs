//! `[camera.response]`: what is known of a camera's response before a run.

use crate::raw::{Kind, Section, Writer, number, text, whole};

/// Longest text that says where numbers come from.
const SOURCE_MOST: usize = 400;

/// Whether a text says where numbers come from: one line, not empty, not too long.
pub(crate) fn is_source(text: &str) -> bool {
    let plain = !text.trim().is_empty() && !text.chars().any(char::is_control);
    plain && text.chars().count() <= SOURCE_MOST
}

table! {
    /// Response of the camera, where it is known: g = b + 255 (L/255)^γ with L = light and g = grey level; `hydroline flat`
    /// measures it. Omitted: the first frames of each run over the target find it.
    ///
    /// Shading is not part of it: along the line it looks like a laser whose fan is uneven, which no flat frame shows, so a
    /// pose leaves both free together whatever is known of the one.
    pub struct StatedResponse as ResponseTyped, checked by goes_together {
        /// Exponent γ; 1 = the camera is linear.
        pub gamma: f64 = number(0.2, 5.0, "").hint("1 leaves light as it is; sRGB is about 0.42"),
        /// Standard deviation of γ; 0 = known for certain.
        pub gamma_sd: f64 = number(0.0, 1.0, "").hint("0 says that gamma is known for certain"),
        /// Black level b. Omitted: one with the background; needs `black_levels_sd`.
        key black as "black_levels": Option<f64> = number(-64.0, 64.0, "grey levels").optional()
            => |r| Some(r.black_levels.map(|[level, _]| level)),
        /// Standard deviation of b; needs `black_levels`.
        key black_levels_sd: Option<f64> = number(0.0, 64.0, "grey levels").optional()
            => |r| Some(r.black_levels.map(|[_, sd]| sd)),
        /// Black level b and its standard deviation \[grey levels\]; `None` = not stated.
        made black_levels: Option<[f64; 2]>,
        /// Correlation of γ and b; needs both standard deviations above 0.
        ///
        /// An exposure series knows one by the other.
        pub gamma_black_correlation: f64 = number(-0.999, 0.999, "").or(0.0).quiet(),
        /// Grey level from which on light is clipped. Omitted: the frames show it themselves.
        pub ceiling_levels: Option<u8> = whole(64, 255, "grey levels").optional(),
        /// Where these numbers come from, in words.
        pub source: String = text(
            "a text of 1 to 400 letters that says where these numbers come from, like \"data sheet\" or \"hydroline flat, 2026-11-26\"",
            is_source,
        ),
    }
}

fn goes_together(typed: &mut ResponseTyped, s: &Section<'_>) {
    for (key, there, other, stated) in [
        (
            "black_levels_sd",
            typed.black_levels_sd,
            "black_levels",
            typed.black,
        ),
        (
            "black_levels",
            typed.black,
            "black_levels_sd",
            typed.black_levels_sd,
        ),
    ] {
        if there == Some(None) && matches!(stated, Some(Some(_))) {
            s.missing(
                key,
                format!("`{key} = …`: it goes with {other}, which says nothing without it"),
            );
        }
    }
    let uncertain = typed.gamma_sd.is_none_or(|sd| sd > 0.0)
        && typed
            .black_levels_sd
            .is_none_or(|sd| sd.is_some_and(|sd| sd > 0.0));
    if let Some(correlation) = typed
        .gamma_black_correlation
        .filter(|c| *c != 0.0 && !uncertain)
    {
        s.rule(
            "gamma_black_correlation",
            format!("{correlation}, but gamma_sd and black_levels_sd are not both above 0"),
            "Leave it out, or enter both standard deviations",
        );
    }
    let black = typed.black.zip(typed.black_levels_sd);
    typed.black_levels = black.map(|(level, sd)| level.zip(sd).map(|(level, sd)| [level, sd]));
}

impl StatedResponse {
    /// The table of a rig file that states it.
    pub fn to_toml(&self) -> String {
        Writer::text_of("camera", |w| w.table("response", self))
    }
}
