//! Colours of an instrument's noise about the likeliest one.

use hydroline_numerics::noise::Noise;

/// Least and largest size of the coloured part over the white one: a minute of samples does not see less.
const RATIOS: [f64; 2] = [0.07, 4.5];
/// Size from which the doublings go where the likeliest noise has no colour.
const RATIO: f64 = 0.1;
/// Shortest and longest of its correlation times \[s\]: as far as an instrument's colour is looked for.
const TIMES_S: [f64; 2] = [0.088, 2.83];
/// Most that the whole noise is over its white part: beside none at all a colour has no size.
const WHITE_LEAST: f64 = 1e3;
/// Doublings on either side of the likeliest at the most.
const DOUBLINGS: i32 = 6;
/// Size and time of a channel's colour, each in doublings from the likeliest; `None` = no colour.
pub(super) type Colour = Option<(i32, i32)>;

/// Colours of one channel: doublings from where they begin, so that the likeliest noise is one of them.
#[derive(Debug, Clone, Copy)]
pub(super) struct Grid {
    white_sd: f64,
    ratio: f64,
    time_s: f64,
    /// Where the doublings begin, or none.
    pub likeliest: Colour,
}

impl Grid {
    pub fn of(noise: Noise) -> Grid {
        let white_sd = noise.white_sd.max(noise.total_sd() / WHITE_LEAST);
        let ratio = noise.coloured_sd / white_sd;
        let has_colour = ratio >= RATIOS[0];
        Grid {
            white_sd,
            ratio: if has_colour { ratio } else { RATIO },
            time_s: noise.correlation_s.clamp(TIMES_S[0], TIMES_S[1]),
            likeliest: has_colour.then_some((0, 0)),
        }
    }

    /// Size over the white part, and correlation time \[s\].
    pub fn at(&self, (ratio, time): (i32, i32)) -> (f64, f64) {
        (
            self.ratio * f64::from(ratio).exp2(),
            self.time_s * f64::from(time).exp2(),
        )
    }

    /// The noise of a colour.
    pub fn noise(&self, colour: Colour) -> Noise {
        let (ratio, correlation_s) = colour.map_or((0.0, self.time_s), |c| self.at(c));
        Noise {
            white_sd: self.white_sd,
            coloured_sd: ratio * self.white_sd,
            correlation_s,
        }
    }

    /// Those one step away.
    pub fn neighbours(&self, colour: Colour) -> Vec<Colour> {
        let is_there = |c: &(i32, i32)| {
            let (ratio, time_s) = self.at(*c);
            let within = |v: f64, of: [f64; 2]| v >= of[0] && v <= of[1];
            *c == (0, 0) || within(ratio, RATIOS) && within(time_s, TIMES_S)
        };
        let range = || -DOUBLINGS..=DOUBLINGS;
        let Some((ratio, time)) = colour else {
            // Every time at the least size.
            let least = |t: i32| range().map(move |r| (r, t)).find(|c| is_there(c));
            return range().filter_map(least).map(Some).collect();
        };
        let around = [
            (ratio - 1, time),
            (ratio + 1, time),
            (ratio, time - 1),
            (ratio, time + 1),
        ];
        let mut made: Vec<Colour> = around.into_iter().filter(is_there).map(Some).collect();
        if !is_there(&(ratio - 1, time)) {
            made.push(None);
        }
        made
    }
}
