//! Forms of a force of no known effect: a piece, or a sum of two, over its covariate.
//!
//! A piece is a form of the simulator's with priors of its numbers. They are given by the covariate's range alone, so that
//! nothing here knows of metres or radians.

use hydroline_sim::effect::covariate_table::COVARIATES;
use hydroline_sim::effect::form::{FORMS, NUMBERS, Parity, Shape, form};

use crate::prior::{Density, Scale};

/// sd of a number that a form holds: as good as none; its limits hold it.
const HELD: f64 = 1e-6;
/// Degrees of freedom of a place, a width, an exponent: where nine in ten lie is said, and beyond it anything may.
const FREEDOM: f64 = 4.0;
/// Student's t with four degrees: 95 % point over the scale.
const T95: f64 = 2.132;
/// Widths of bumps and steps, over the range: from what a table's points still distinguish to a law over all of it.
const WIDTHS: (f64, f64) = (0.02, 0.6);
/// Lengths of waves, over the range: two points of a table to a wave that shows half of itself.
const LENGTHS: (f64, f64) = (0.1, 2.0);
/// Lengths over which something dies away, over the range.
const DECAYS: (f64, f64) = (0.05, 2.0);
/// Exponents of a power, and those that theory gives: they are held, and cost no number.
const EXPONENTS: (f64, f64) = (0.4, 4.0);
const USUAL: [f64; 4] = [0.5, 1.0, 2.0, 3.0];
/// Points of a grid to begin from, per place, width and phase.
const PLACES: usize = 20;
const SIZES: usize = 6;
const PHASES: usize = 8;

/// A piece that may be a part of a form.
#[derive(Debug, Clone, PartialEq)]
pub struct Piece {
    /// Place among the simulator's forms.
    pub form: usize,
    /// Scale and prior of force, place and width; limits that meet hold a number.
    pub scales: [Scale; NUMBERS],
    /// Places and widths to begin from.
    pub grid: Vec<[f64; 2]>,
}

impl Piece {
    pub fn none() -> Piece {
        Piece {
            form: FORMS.len() - 1,
            scales: [held(0.0), held(0.0), held(1.0)],
            grid: Vec::new(),
        }
    }

    /// Whether a number is searched.
    pub fn is_free(&self, number: usize) -> bool {
        let (low, high) = self.scales[number].limits;
        low < high
    }
}

/// A number that is not searched.
pub fn held(value: f64) -> Scale {
    Scale {
        logarithmic: false,
        sign: 1.0,
        density: Density::normal(value, HELD),
        limits: (value, value),
    }
}

/// A place, most likely between two; never farther out than their distance.
fn between((low, high): (f64, f64)) -> Scale {
    let half = 0.5 * (high - low);
    Scale {
        logarithmic: false,
        sign: 1.0,
        density: Density::Student {
            centre: low + half,
            scale: half / T95,
            freedom: FREEDOM,
        },
        limits: (low - half, high + half),
    }
}

/// A positive number, most likely between two; never farther out than their ratio's root.
fn by_ratio((low, high): (f64, f64)) -> Scale {
    let half = 0.5 * (high / low).ln();
    Scale {
        logarithmic: true,
        sign: 1.0,
        density: Density::Student {
            centre: low.ln() + half,
            scale: half / T95,
            freedom: FREEDOM,
        },
        limits: (low / half.exp(), high * half.exp()),
    }
}

fn evenly((low, high): (f64, f64), count: usize) -> impl Iterator<Item = f64> + Clone {
    let step = (high - low) / (count - 1) as f64;
    (0..count).map(move |k| low + step * k as f64)
}

fn evenly_by_ratio((low, high): (f64, f64), count: usize) -> impl Iterator<Item = f64> + Clone {
    evenly((low.ln(), high.ln()), count).map(f64::exp)
}

/// DOF, covariate and range of a table, with the usual size of its force.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Along {
    /// DOF in which the force acts.
    pub dof: usize,
    /// Covariate, by its place.
    pub covariate: usize,
    /// That at both ends.
    pub range: (f64, f64),
    /// Force that half of all unnamed ones exceed \[N, N m\].
    pub force: f64,
}

impl Along {
    /// Whether 0 of the covariate is a place of its own: rest, no load, upright. That of a tank's coordinates and of time is
    /// where somebody put it.
    fn has_a_zero(&self) -> bool {
        let name = COVARIATES.get(self.covariate).copied().unwrap_or("");
        !["x", "y", "z", "psi", "t"].contains(&name) && self.range.0 < 0.0 && self.range.1 > 0.0
    }

    /// Whether a power of it, with its sign, is one of the vehicle's own laws: damping of the DOF's rate, restoring of its
    /// angle. Its coefficient is fitted beside every form.
    fn is_own(&self, exponent: f64) -> bool {
        let rate = self.covariate == 6 + self.dof && [1.0, 2.0].contains(&exponent);
        let angle = [3, 4].contains(&self.dof) && self.covariate == self.dof && exponent == 1.0;
        rate || angle
    }

    /// Pieces that may act along it.
    pub fn pieces(&self) -> Vec<Piece> {
        (0..FORMS.len())
            .flat_map(|place| self.of_form(place))
            .collect()
    }

    fn of_form(&self, place: usize) -> Vec<Piece> {
        let (parity, shape) = form(place);
        let plain = parity == Parity::Plain;
        let time = COVARIATES.get(self.covariate) == Some(&"t");
        // A straight line goes through any zero with a constant beside it.
        let line = (parity, shape) == (Parity::Odd, Shape::Power);
        if !(plain || self.has_a_zero() || line) || shape == Shape::None {
            return Vec::new();
        }
        let size = self.range.0.abs().max(self.range.1.abs());
        let reach = if plain { self.range } else { (0.0, size) };
        let span = reach.1 - reach.0;
        let over = |(low, high): (f64, f64)| (low * span, high * span);
        // A force may be of any size about the one that such forces have: half of it lies beyond.
        let force = Scale {
            logarithmic: false,
            sign: 1.0,
            density: Density::Student {
                centre: 0.0,
                scale: self.force,
                freedom: 1.0,
            },
            limits: (-1e6, 1e6),
        };
        let piece = |at: Scale, width: Scale, grid: Vec<[f64; 2]>| Piece {
            form: place,
            scales: [force, at, width],
            grid,
        };
        let crossed = |places: Vec<f64>, widths: Vec<f64>| -> Vec<[f64; 2]> {
            let all = places.iter();
            all.flat_map(|b| widths.iter().map(|w| [*b, *w])).collect()
        };
        let within: Vec<f64> = evenly(reach, PLACES).collect();
        match shape {
            Shape::None => Vec::new(),
            Shape::Constant => vec![piece(held(0.0), held(1.0), vec![[0.0, 1.0]])],
            Shape::Power => {
                let usual = USUAL.into_iter().filter(|n| {
                    let even_one = parity == Parity::Even && *n == 0.5;
                    let own = parity == Parity::Odd && self.is_own(*n);
                    !even_one && !own && (self.has_a_zero() || *n == 1.0)
                });
                let mut made: Vec<Piece> = usual
                    .map(|n| piece(held(n), held(size), vec![[n, size]]))
                    .collect();
                if self.has_a_zero() {
                    let grid = evenly_by_ratio(EXPONENTS, SIZES).map(|n| [n, size]);
                    made.push(piece(by_ratio(EXPONENTS), held(size), grid.collect()));
                }
                made
            }
            Shape::Beyond | Shape::Below => {
                let inner = &within[1..PLACES - 1];
                let grid = crossed(inner.to_vec(), vec![span]);
                vec![piece(between(reach), held(span), grid)]
            }
            Shape::Wave => {
                let phase = Scale {
                    logarithmic: false,
                    sign: 1.0,
                    density: Density::Circle(std::f64::consts::TAU),
                    limits: (-1e6, 1e6),
                };
                let turn = std::f64::consts::PI;
                // Either sign of the force: half a turn is enough.
                let phases = evenly((0.0, turn), PHASES + 1).take(PHASES).collect();
                let lengths = evenly_by_ratio(over(LENGTHS), 3 * SIZES).collect();
                let grid = crossed(phases, lengths);
                vec![piece(phase, by_ratio(over(LENGTHS)), grid)]
            }
            Shape::Bump | Shape::Step => {
                let widths: Vec<f64> = evenly_by_ratio(over(WIDTHS), SIZES).collect();
                let grid = crossed(within, widths);
                vec![piece(between(reach), by_ratio(over(WIDTHS)), grid)]
            }
            Shape::Saturation => {
                let widths = evenly_by_ratio(over(WIDTHS), 2 * SIZES);
                let grid = widths.map(|w| [0.0, w]).collect();
                vec![piece(held(0.0), by_ratio(over(WIDTHS)), grid)]
            }
            Shape::Decay => {
                // From the zero on; of a place there is none to die away from.
                if plain && !time {
                    return Vec::new();
                }
                let lengths = evenly_by_ratio(over(DECAYS), 2 * SIZES);
                let grid = lengths.map(|w| [0.0, w]).collect();
                vec![piece(held(0.0), by_ratio(over(DECAYS)), grid)]
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn along(dof: usize, covariate: &str, range: (f64, f64)) -> Along {
        let covariate = COVARIATES.iter().position(|c| *c == covariate).unwrap();
        Along {
            dof,
            covariate,
            range,
            force: 0.5,
        }
    }

    fn names(along: &Along) -> Vec<&'static str> {
        along.pieces().iter().map(|p| FORMS[p.form]).collect()
    }

    #[test]
    fn a_place_has_no_sign_and_a_rate_has() {
        let place = names(&along(0, "x", (-0.4, 1.2)));
        assert!(place.contains(&"bump") && place.contains(&"wave"));
        // A straight line, and nothing else, goes through a zero that means nothing.
        assert_eq!(place.iter().filter(|n| **n == "odd_power").count(), 1);
        assert!(!place.iter().any(|n| n.starts_with("even")));
        let rate = names(&along(0, "u", (-0.3, 0.3)));
        assert!(rate.contains(&"odd_bump") && rate.contains(&"odd_decay"));
        let time = names(&along(0, "t", (0.0, 24.0)));
        assert!(time.contains(&"decay") && !time.contains(&"odd_decay"));
    }

    #[test]
    fn what_the_vehicle_has_already_is_no_piece() {
        let powers = |form: &str, a: &Along| -> Vec<f64> {
            let all = a.pieces();
            let own = all.iter().filter(|p| FORMS[p.form] == form);
            own.filter(|p| !p.is_free(1))
                .map(|p| p.grid[0][0])
                .collect()
        };
        let rate = along(0, "u", (-0.3, 0.3));
        assert_eq!(powers("odd_power", &rate), [0.5, 3.0]);
        // A drag that does not turn with the rate is no law of the vehicle's.
        assert_eq!(powers("even_power", &rate), [1.0, 2.0, 3.0]);
        assert_eq!(powers("odd_power", &along(5, "u", (-0.3, 0.3))), USUAL);
        assert_eq!(
            powers("odd_power", &along(3, "phi", (-0.3, 0.3))),
            [0.5, 2.0, 3.0]
        );
    }

    #[test]
    fn every_start_lies_within_its_limits() {
        for a in [along(0, "u", (-0.2, 0.3)), along(0, "x", (0.2, 1.1))] {
            for p in a.pieces() {
                assert!(!p.grid.is_empty(), "{}", FORMS[p.form]);
                for start in &p.grid {
                    for (v, s) in start.iter().zip(&p.scales[1..]) {
                        let (low, high) = s.limits;
                        assert!((low..=high).contains(v), "{} {v}", FORMS[p.form]);
                    }
                }
            }
        }
    }
}
