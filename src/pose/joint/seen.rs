//! Light and camera of a frame in words, for a person whose frame has no pose.

use super::super::photometric::{Picture, State, line_range};
use std::fmt;

/// Along the line its brightness may vary by this share without being worth a word.
const LINE_SHARE: f64 = 0.1;
/// The background, along the line, by rows or under a lamp \[grey levels\].
const DARK_LEVELS: f64 = 2.0;
/// Share of columns whose stripe is clipped.
const CLIPPED_SHARE: f64 = 0.05;
/// ln γ.
const TONE: f64 = 0.02;

/// Light and camera as a fit found them.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LightSeen {
    /// Brightest over dimmest part of the line, less one: shading of the lens, or a line that is uneven itself.
    pub line_share: f64,
    /// Most less least of the background along the line \[grey levels of light\].
    pub background_levels: f64,
    /// Half of what rows differ by: mains light through a rolling shutter \[grey levels\].
    pub flicker_levels: f64,
    /// Most less least of what lamps, windows and reflections light \[grey levels\].
    pub lamp_levels: f64,
    /// Share of the stripe's columns that are clipped, and the level at which they are.
    pub clipped: (f64, u8),
    /// ln γ of the camera's response.
    pub tone: f64,
}

impl LightSeen {
    pub(super) fn of(picture: &Picture<'_>, state: &State) -> LightSeen {
        let [[dim, bright], [low, high]] = line_range(state);
        let (flicker_levels, lamp_levels) = picture.uneven_levels();
        LightSeen {
            line_share: bright / dim.max(0.05) - 1.0,
            background_levels: high - low,
            flicker_levels,
            lamp_levels,
            clipped: (picture.clipped_share, picture.ceiling),
            tone: state.tone,
        }
    }
}

impl fmt::Display for LightSeen {
    /// Lists all that is worth a word, each with its remedy; nothing where nothing is.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (clipped, level) = self.clipped;
        let words = [
            (clipped > CLIPPED_SHARE).then(|| {
                format!(
                    "{:.0} % of the columns are clipped at {level}: lower exposure or gain",
                    100.0 * clipped
                )
            }),
            (self.flicker_levels > DARK_LEVELS).then(|| {
                format!(
                    "rows flicker by {:.1} grey levels: expose for a multiple of half the mains' period (10 ms at 50 Hz)",
                    self.flicker_levels
                )
            }),
            (self.lamp_levels > DARK_LEVELS).then(|| {
                format!(
                    "lamp, window or reflection of {:.1} grey levels: darken it",
                    self.lamp_levels
                )
            }),
            (self.background_levels > DARK_LEVELS).then(|| {
                format!(
                    "background uneven by {:.1} grey levels along the line: darken the room",
                    self.background_levels
                )
            }),
            (self.line_share > LINE_SHARE).then(|| {
                format!(
                    "line brighter by {:.0} % in one place than in another: shading of the lens (open the view or move nearer the middle), or the laser's own (focus it)",
                    100.0 * self.line_share
                )
            }),
            (self.tone.abs() > TONE).then(|| {
                format!(
                    "the camera's tone curve has gamma {:.2}: switch it off where the driver can",
                    self.tone.exp()
                )
            }),
        ];
        let words: Vec<String> = words.into_iter().flatten().collect();
        f.write_str(&words.join("; "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_as_it_should_be_is_not_worth_a_word() {
        assert_eq!(LightSeen::default().to_string(), "");
        let seen = LightSeen {
            clipped: (0.43, 235),
            flicker_levels: 5.0,
            ..LightSeen::default()
        };
        let words = seen.to_string();
        assert!(words.contains("43 %") && words.contains("235"), "{words}");
        assert!(words.contains("5.0 grey levels"), "{words}");
        assert!(!words.contains("gamma"), "{words}");
    }
}
