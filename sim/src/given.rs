//! Series given instead of simulated: DOFs whose motion was measured, and companions measured beside the motion.
//!
//! Series are curves that a smoother made; here they are only looked up. A curve takes any scalar as its time, so that what
//! is seen at a delayed instant carries the delay's derivative.

use crate::real::Real;

/// Angle of the rudder, angle of elevator or fins \[rad\], shaft speed \[rad/s\], height of the water's surface \[m\]: the
/// places of the companions.
pub const COMPANIONS: usize = 4;
/// Place of the shaft speed \[rad/s\].
pub(crate) const SHAFT: usize = 2;
/// Place of the height of the water's surface at the vehicle \[m\], positive up.
pub(crate) const WAVE: usize = 3;

/// A cubic piece from a knot on: value, slope, and what the cubic needs to meet the next knot's value and slope.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Piece {
    t_s: f64,
    by_power: [f64; 4],
}

impl Piece {
    fn at<T: Real>(&self, t_s: T) -> T {
        let [a, b, c, d] = self.by_power;
        // Before the first knot there is no time since the last one.
        if b == 0.0 && c == 0.0 && d == 0.0 {
            return T::from_f64(a);
        }
        let s = t_s - T::from_f64(self.t_s);
        ((s * d + T::from_f64(c)) * s + T::from_f64(b)) * s + T::from_f64(a)
    }
}

/// A smooth curve over time: cubic between knots of given value and slope (Hermite); beyond its ends it stays where it ends.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    pieces: Vec<Piece>,
}

impl Curve {
    /// The same value always.
    pub fn constant(value: f64) -> Curve {
        Curve::new(&[(0.0, value, 0.0)])
    }

    /// Of knots (time \[s\], value, slope), ascending in time; 0 without any.
    pub fn new(knots: &[(f64, f64, f64)]) -> Curve {
        let mut pieces = Vec::with_capacity(knots.len() + 1);
        let stands = |t_s: f64, value: f64| Piece {
            t_s,
            by_power: [value, 0.0, 0.0, 0.0],
        };
        let Some((first, last)) = knots.first().zip(knots.last()) else {
            return Curve {
                pieces: vec![stands(0.0, 0.0)],
            };
        };
        pieces.push(stands(f64::NEG_INFINITY, first.1));
        for w in knots.windows(2) {
            let ((t0, v0, s0), (t1, v1, s1)) = (w[0], w[1]);
            let h = (t1 - t0).max(1e-12);
            let mean = (v1 - v0) / h;
            let by_power = [
                v0,
                s0,
                (3.0 * mean - 2.0 * s0 - s1) / h,
                (s0 + s1 - 2.0 * mean) / (h * h),
            ];
            pieces.push(Piece { t_s: t0, by_power });
        }
        pieces.push(stands(last.0, last.1));
        Curve { pieces }
    }

    /// Piece in which a time lies. Knots are all but evenly spaced: the walk begins where an even spacing would have it.
    fn piece_at(&self, t_s: f64) -> Option<&Piece> {
        let last = self.pieces.len().checked_sub(1)?;
        if last < 2 || t_s.is_nan() {
            let after = self.pieces.partition_point(|p| p.t_s <= t_s);
            return self.pieces.get(after.saturating_sub(1));
        }
        let (begin_s, end_s) = (self.pieces[1].t_s, self.pieces[last].t_s);
        let share = (t_s - begin_s) / (end_s - begin_s);
        let mut at = 1 + (share * (last - 1) as f64).clamp(0.0, (last - 1) as f64) as usize;
        while at > 0 && self.pieces[at].t_s > t_s {
            at -= 1;
        }
        while at < last && self.pieces[at + 1].t_s <= t_s {
            at += 1;
        }
        self.pieces.get(at)
    }

    /// The value at a time.
    pub fn at<T: Real>(&self, t_s: T) -> T {
        let Some(piece) = self.piece_at(t_s.value()) else {
            return T::zero();
        };
        match t_s.constant() {
            Some(t_s) => T::from_f64(piece.at(t_s)),
            None => piece.at(t_s),
        }
    }

    /// First and second derivative at a time; 0 where the curve stays.
    pub fn slopes_at<T: Real>(&self, t_s: T) -> [T; 2] {
        let Some(piece) = self.piece_at(t_s.value()) else {
            return [T::zero(); 2];
        };
        let [_, b, c, d] = piece.by_power;
        // Before the first knot there is no time since the last one.
        if b == 0.0 && c == 0.0 && d == 0.0 {
            return [T::zero(); 2];
        }
        let s = t_s - T::from_f64(piece.t_s);
        let first = (s * (3.0 * d) + T::from_f64(2.0 * c)) * s + T::from_f64(b);
        [first, s * (6.0 * d) + T::from_f64(2.0 * c)]
    }
}

/// Given series of one run.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Given {
    /// Rate in the body frame of each DOF that is given.
    pub rates: [Option<Curve>; 6],
    /// Its position, tank frame. x and y are integrated where the whole body is simulated, and looked up along one line.
    pub places: [Option<Curve>; 6],
    /// Companions that were measured.
    pub companions: [Option<Curve>; COMPANIONS],
}

impl Given {
    /// Whether nothing is given.
    pub fn is_empty(&self) -> bool {
        let curves = self.rates.iter().chain(&self.places);
        curves.chain(&self.companions).all(Option::is_none)
    }

    /// Companions at a time; 0 where not measured.
    pub(crate) fn companions_at<T: Real>(&self, t_s: T) -> [T; COMPANIONS] {
        std::array::from_fn(|c| self.companions[c].as_ref().map_or(T::zero(), |k| k.at(t_s)))
    }

    /// Puts given rates and positions into a state; x and y only where `all`.
    pub(crate) fn put<T: Real>(&self, t_s: T, eta: &mut [T; 6], nu: &mut [T; 6], all: bool) {
        for (d, (rate, place)) in self.rates.iter().zip(&self.places).enumerate() {
            if let Some(rate) = rate {
                nu[d] = rate.at(t_s);
            }
            if let Some(place) = place.as_ref().filter(|_| all || d > 1) {
                eta[d] = place.at(t_s);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Dual;

    #[test]
    fn a_cubic_is_met_exactly_and_carries_its_slope() {
        let cubic = |t: f64| 1.0 - 2.0 * t + 0.5 * t * t - 0.1 * t * t * t;
        let slope = |t: f64| -2.0 + t - 0.3 * t * t;
        let knots: Vec<_> = [0.0, 0.7, 1.1, 3.0].map(|t| (t, cubic(t), slope(t))).into();
        let curve = Curve::new(&knots);
        for k in 0..=60 {
            let t = 0.05 * f64::from(k);
            assert!((curve.at(t) - cubic(t)).abs() < 1e-12, "{t}");
        }
        let seen = curve.at(Dual::<2>::pass(&[0.9], 0)[0]);
        assert!((seen.slope[0] - slope(0.9)).abs() < 1e-12);
    }

    #[test]
    fn the_slopes_of_a_curve_are_its_derivatives_and_0_beyond_its_ends() {
        let knots = [(0.0, 1.0, -2.0), (0.7, 0.1, 0.4), (1.5, 0.3, 0.0)];
        let curve = Curve::new(&knots);
        for k in 1..30 {
            let t = 0.05 * f64::from(k) + 0.01;
            let h = 1e-4;
            let [first, second] = curve.slopes_at(t);
            let [before, here, after] = [t - h, t, t + h].map(|t| curve.at(t));
            assert!((first - (after - before) / (2.0 * h)).abs() < 1e-6, "{t}");
            let curvature = (after - 2.0 * here + before) / (h * h);
            assert!(
                (second - curvature).abs() < 1e-5,
                "{t}: {second} {curvature}"
            );
        }
        assert_eq!([curve.slopes_at(-1.0), curve.slopes_at(2.0)], [[0.0; 2]; 2]);
        assert_eq!(Curve::constant(3.0).slopes_at(0.5), [0.0; 2]);
    }

    /// Gaps in a recording leave the even spacing far off.
    #[test]
    fn the_piece_of_a_time_is_found_however_the_knots_lie() {
        let times = [0.0, 0.1, 0.2, 5.0, 5.0, 5.1, 9.0, 9.01, 9.02];
        let knots: Vec<_> = times.map(|t| (t, t * t, 2.0 * t)).into();
        let curve = Curve::new(&knots);
        for k in -20..200 {
            let t_s = 0.05 * f64::from(k);
            let after = curve.pieces.partition_point(|p| p.t_s <= t_s);
            let sought = curve.pieces.get(after.saturating_sub(1));
            assert_eq!(curve.piece_at(t_s), sought, "{t_s}");
        }
    }

    #[test]
    fn beyond_its_ends_a_curve_stays() {
        let curve = Curve::new(&[(1.0, 2.0, 5.0), (2.0, 3.0, -5.0)]);
        assert_eq!((curve.at(0.0), curve.at(9.0)), (2.0, 3.0));
        assert_eq!(Curve::constant(0.4).at(-7.0), 0.4);
        assert_eq!(Curve::new(&[]).at(1.0), 0.0);
    }
}
