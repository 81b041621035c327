//! The colours of every report.
//!
//! Eight colours that people with any of the common forms of colour blindness can tell apart:
//! M. Okabe and K. Ito, "Color Universal Design", 2008; B. Wong, Nature Methods 8 (2011) 441.

use std::fmt;

/// A colour: red, green, blue.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Colour(pub [u8; 3]);

impl Colour {
    /// Measured data.
    pub const GREY: Colour = Colour([0x59, 0x59, 0x59]);
    /// A model that is found good: fitted, with what was left out.
    pub const BLUE: Colour = Colour([0x00, 0x72, 0xb2]);
    /// A model that is found wanting; a warning.
    pub const VERMILLION: Colour = Colour([0xd5, 0x5e, 0x00]);
    /// A third thing beside the two models.
    pub const GREEN: Colour = Colour([0x00, 0x9e, 0x73]);
    /// Samples that were left out.
    pub const PURPLE: Colour = Colour([0xcc, 0x79, 0xa7]);
    /// A fifth series.
    pub const ORANGE: Colour = Colour([0xe6, 0x9f, 0x00]);
    /// A sixth series.
    pub const SKY: Colour = Colour([0x56, 0xb4, 0xe9]);
    /// Reference lines.
    pub const BLACK: Colour = Colour([0x00, 0x00, 0x00]);

    const WHITE: Colour = Colour([0xff; 3]);
    /// Ends of the diverging scale: ColorBrewer's RdBu (C. Brewer, 2003), which stays two hues to all eyes.
    const BELOW: Colour = Colour([0x21, 0x66, 0xac]);
    const ABOVE: Colour = Colour([0xb2, 0x18, 0x2b]);

    /// The colour of the `index`-th of several series that mean nothing in particular.
    pub fn series(index: usize) -> Colour {
        const CYCLE: [Colour; 6] = [
            Colour::BLUE,
            Colour::VERMILLION,
            Colour::GREEN,
            Colour::PURPLE,
            Colour::ORANGE,
            Colour::SKY,
        ];
        CYCLE[index % CYCLE.len()]
    }

    /// Blue at −1, white at 0, red at +1; beyond, the ends. NaN is white.
    pub fn diverging(share: f64) -> Colour {
        if share < 0.0 {
            Colour::WHITE.towards(Colour::BELOW, -share)
        } else {
            Colour::WHITE.towards(Colour::ABOVE, share)
        }
    }

    /// A part of the way to another colour; 0 is this one, 1 the other.
    pub fn towards(self, other: Colour, part: f64) -> Colour {
        let part = if part.is_nan() {
            0.0
        } else {
            part.clamp(0.0, 1.0)
        };
        Colour(std::array::from_fn(|k| {
            let (from, to) = (f64::from(self.0[k]), f64::from(other.0[k]));
            // Between two bytes.
            (from + part * (to - from)).round() as u8
        }))
    }
}

impl fmt::Display for Colour {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [red, green, blue] = self.0;
        write!(f, "#{red:02x}{green:02x}{blue:02x}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_diverging_scale_is_white_at_zero_and_ends_at_its_ends() {
        assert_eq!(Colour::diverging(0.0).to_string(), "#ffffff");
        assert_eq!(Colour::diverging(-1.0).to_string(), "#2166ac");
        assert_eq!(Colour::diverging(7.0).to_string(), "#b2182b");
        assert_eq!(Colour::diverging(f64::NAN).to_string(), "#ffffff");
        let [red, _, blue] = Colour::diverging(0.5).0;
        assert!(red > blue);
    }

    #[test]
    fn neighbouring_series_differ() {
        for k in 0..12 {
            assert_ne!(Colour::series(k), Colour::series(k + 1));
        }
    }
}
