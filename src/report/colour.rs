//! The colours of every report.
//!
//! Eight colours that people with any of the common forms of colour blindness can distinguish:
//! M. Okabe and K. Ito, "Color Universal Design", 2008; B. Wong, Nature Methods 8 (2011) 441.
//!
//! A shape carries its colour twice: as an attribute, which every viewer reads and which suits white paper, and as
//! a class, by which [`dark_rules`] gives it another lightness where the reader's screen is dark.

use std::fmt::{self, Write as _};

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

    /// Background of a figure.
    pub(crate) const PAPER: Colour = Colour([0xff; 3]);
    /// Lines of the grid.
    pub(crate) const GRID: Colour = Colour([0xe4; 3]);
    /// The grid's line at zero.
    pub(crate) const ZERO: Colour = Colour([0xaa; 3]);
    /// Frame about the axes.
    pub(crate) const FRAME: Colour = Colour([0x99; 3]);
    /// Where a heat map has no cell.
    pub(crate) const NO_CELL: Colour = Colour([0xec; 3]);
    /// Ends of the diverging scale: ColorBrewer's RdBu (C. Brewer, 2003), which stays two hues to all eyes.
    pub(crate) const BELOW: Colour = Colour([0x21, 0x66, 0xac]);
    pub(crate) const ABOVE: Colour = Colour([0xb2, 0x18, 0x2b]);

    /// Class, colour on white and colour on a dark screen. The dark ones keep the hue and are light enough for 3:1
    /// against [`Colour::DARK_PAPER`] (WCAG 2.2, 1.4.11).
    const PALETTE: [(&'static str, Colour, Colour); 15] = [
        ("grey", Colour::GREY, Colour([0xb8, 0xb8, 0xb8])),
        ("blue", Colour::BLUE, Colour([0x3d, 0x9f, 0xe0])),
        ("vermillion", Colour::VERMILLION, Colour([0xee, 0x74, 0x20])),
        ("green", Colour::GREEN, Colour([0x1f, 0xbf, 0x92])),
        ("purple", Colour::PURPLE, Colour([0xd9, 0x8c, 0xb8])),
        ("orange", Colour::ORANGE, Colour([0xf0, 0xb4, 0x2a])),
        ("sky", Colour::SKY, Colour([0x9a, 0xd4, 0xf5])),
        ("ink", Colour::BLACK, Colour([0xe8, 0xea, 0xec])),
        ("paper", Colour::PAPER, Colour::DARK_PAPER),
        ("grid", Colour::GRID, Colour([0x2f, 0x34, 0x39])),
        ("zero", Colour::ZERO, Colour([0x6a, 0x72, 0x79])),
        ("frame", Colour::FRAME, Colour([0x7c, 0x84, 0x8b])),
        ("none", Colour::NO_CELL, Colour([0x36, 0x3c, 0x42])),
        ("below", Colour::BELOW, Colour([0x67, 0xa9, 0xcf])),
        ("above", Colour::ABOVE, Colour([0xef, 0x8a, 0x62])),
    ];
    /// The page on a dark screen; page.css has the same.
    pub(crate) const DARK_PAPER: Colour = Colour([0x16, 0x19, 0x1c]);

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

    /// Tint of a share on the scale from −1 (blue) by 0 (nothing) to +1 (red), and how opaque it lies on the paper;
    /// beyond, the ends. NaN is nothing.
    pub fn diverging(share: f64) -> (Colour, f64) {
        let end = if share < 0.0 {
            Colour::BELOW
        } else {
            Colour::ABOVE
        };
        let size = if share.is_nan() { 0.0 } else { share.abs() };
        (end, size.min(1.0))
    }

    /// Class of a colour of the palette, after `f-` for what is filled and `s-` for what is stroked.
    pub(crate) fn class(self) -> Option<&'static str> {
        let of = Colour::PALETTE.iter().find(|(_, light, _)| *light == self);
        of.map(|(class, ..)| *class)
    }
}

/// Rules of CSS that turn the palette for a dark screen. Paper stays white: they hold for screens alone.
pub(crate) fn dark_rules() -> String {
    let mut rules = "@media screen and (prefers-color-scheme:dark){".to_owned();
    for (class, _, dark) in Colour::PALETTE {
        // Writing to a String cannot fail.
        let _ = write!(
            rules,
            ".f-{class}{{fill:{dark}}}.s-{class}{{stroke:{dark}}}"
        );
    }
    rules + "}"
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
    fn the_diverging_scale_is_nothing_at_zero_and_ends_at_its_ends() {
        assert_eq!(Colour::diverging(0.0).1, 0.0);
        assert_eq!(Colour::diverging(f64::NAN).1, 0.0);
        assert_eq!(Colour::diverging(-1.0), (Colour::BELOW, 1.0));
        assert_eq!(Colour::diverging(7.0), (Colour::ABOVE, 1.0));
    }

    /// Relative luminance and contrast: WCAG 2.2.
    fn contrast(a: Colour, b: Colour) -> f64 {
        let luminance = |c: Colour| {
            let linear = c.0.map(|v| {
                let v = f64::from(v) / 255.0;
                if v <= 0.04045 {
                    v / 12.92
                } else {
                    ((v + 0.055) / 1.055).powf(2.4)
                }
            });
            0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
        };
        let (a, b) = (luminance(a) + 0.05, luminance(b) + 0.05);
        a.max(b) / a.min(b)
    }

    #[test]
    fn every_colour_has_one_class_and_series_stand_out_on_a_dark_screen() {
        for (k, (class, light, dark)) in Colour::PALETTE.into_iter().enumerate() {
            assert_eq!(light.class(), Some(class));
            assert!(Colour::PALETTE[..k].iter().all(|other| other.0 != class));
            if k < 8 {
                let stands_out = contrast(dark, Colour::DARK_PAPER);
                assert!(stands_out >= 3.0, "{class}: {stands_out}");
            }
        }
        assert!(dark_rules().contains(".s-blue{stroke:#3d9fe0}"));
        assert_eq!(Colour([1, 2, 3]).class(), None);
    }

    #[test]
    fn neighbouring_series_differ() {
        for k in 0..12 {
            assert_ne!(Colour::series(k), Colour::series(k + 1));
        }
    }
}
