//! Forms by what a table's posterior says of them: no simulation is asked.
//!
//! All that the data say of a table's points, the other numbers integrated out, is a normal density about where the model
//! is. A form is a curve through these points: its numbers by least squares from the best of a grid, its evidence by
//! Laplace. What is likeliest here is then fitted to the data themselves.

use hydroline_sim::effect::covariate_table::POINTS;
use hydroline_sim::effect::form::{NUMBERS, piece};
use hydroline_sim::effect::written_force::{PIECES, is_a_rate};
use nalgebra::{DMatrix, DVector};

use super::curve::{Likelihood, refined};
use super::grammar::{Along, Piece};

/// Numbers of a form.
pub const COUNT: usize = NUMBERS * PIECES;
/// Single pieces that are refined, per piece: its best places.
const SINGLES: usize = 3;
/// Pairs of pieces that are refined.
const PAIRS: usize = 48;
/// A second piece that does as the first does: less of it than this is its own.
const OWN: f64 = 1e-6;
/// A form and how it does.
#[derive(Debug, Clone)]
pub struct Ranked {
    pub pieces: [Piece; PIECES],
    /// Scaled numbers, piece by piece.
    pub scaled: [f64; COUNT],
    /// Log evidence under the table's likelihood.
    pub ln_evidence: f64,
    /// Log prior probability among all forms.
    pub ln_prior: f64,
}

impl Ranked {
    /// Evidence with the prior.
    pub fn ln_score(&self) -> f64 {
        self.ln_evidence + self.ln_prior
    }

    /// Natural numbers.
    pub fn numbers(&self) -> [f64; COUNT] {
        let scales = self.pieces.iter().flat_map(|p| p.scales);
        let mut made = [0.0; COUNT];
        for ((v, s), out) in self.scaled.iter().zip(scales).zip(&mut made) {
            *out = s.natural(*v).0;
        }
        made
    }
}

/// A piece of unit force at one place of its grid.
struct Atom {
    piece: usize,
    start: [f64; 2],
    along: f64,
    forces: DVector<f64>,
}

/// Forms along a covariate, likeliest first.
///
/// `second` = probability of a second piece.
pub fn ranked(along: &Along, likelihood: &Likelihood, second: f64) -> Vec<Ranked> {
    let pieces = along.pieces();
    let none = Piece::none();
    let (from, to) = along.range;
    let knots: Vec<f64> = (0..POINTS)
        .map(|k| from + (to - from) * k as f64 / (POINTS - 1) as f64)
        .collect();
    let of_a_rate = is_a_rate(along.covariate);
    let atoms: Vec<Atom> = pieces
        .iter()
        .enumerate()
        .flat_map(|(k, p)| p.grid.iter().map(move |start| (k, p, start)))
        .map(|(k, p, start)| {
            let at = |c: &f64| piece(p.form, [1.0, start[0], start[1]], *c, of_a_rate);
            let forces = DVector::from_iterator(POINTS, knots.iter().map(at));
            Atom {
                piece: k,
                start: *start,
                along: forces.dot(&likelihood.slope),
                forces,
            }
        })
        .collect();
    let all = DMatrix::from_fn(POINTS, atoms.len(), |i, k| atoms[k].forces[i]);
    let square = all.tr_mul(&(&likelihood.information * &all));
    // The prior of a force keeps what data do not say from being anything.
    let least = along.force.powi(-2);
    let n = (pieces.len() as f64).ln();
    let mut starts: Vec<Start> = singles(&atoms, &square, least, pieces.len());
    starts.extend(pairs(&atoms, &square, least, pieces.len()));
    let mut made: Vec<Ranked> = starts
        .into_iter()
        .filter_map(|s| {
            let first = &pieces[s.pieces.0];
            let other = s.pieces.1.map_or(&none, |k| &pieces[k]);
            let ln_prior = match s.pieces.1 {
                None => (1.0 - second).ln() - n,
                // Two of a kind are one pair, two others are one in either order.
                Some(k) if k == s.pieces.0 => second.ln() - 2.0 * n,
                Some(_) => second.ln() - 2.0 * n + 2f64.ln(),
            };
            refined([first, other], &s.numbers, likelihood, &knots, of_a_rate).map(
                |(scaled, ln_evidence)| Ranked {
                    pieces: [first.clone(), other.clone()],
                    scaled,
                    ln_evidence,
                    ln_prior,
                },
            )
        })
        .collect();
    made.sort_by(|a, b| b.ln_score().total_cmp(&a.ln_score()));
    // Of the same pieces the best place.
    let mut best: Vec<Ranked> = Vec::new();
    for r in made {
        if !best.iter().any(|b| b.pieces == r.pieces) {
            best.push(r);
        }
    }
    best
}

/// Where a refinement begins.
struct Start {
    pieces: (usize, Option<usize>),
    numbers: [f64; COUNT],
}

fn singles(atoms: &[Atom], square: &DMatrix<f64>, least: f64, pieces: usize) -> Vec<Start> {
    let gain = |k: &usize| atoms[*k].along.powi(2) / (square[(*k, *k)] + least);
    let of_piece = |p: usize| {
        let mut own: Vec<usize> = (0..atoms.len()).filter(|k| atoms[*k].piece == p).collect();
        own.sort_by(|a, b| gain(b).total_cmp(&gain(a)));
        own.into_iter().take(SINGLES)
    };
    (0..pieces)
        .flat_map(of_piece)
        .map(|k| {
            let [b, w] = atoms[k].start;
            let a = atoms[k].along / (square[(k, k)] + least);
            Start {
                pieces: (atoms[k].piece, None),
                numbers: [a, b, w, 0.0, 0.0, 1.0],
            }
        })
        .collect()
}

/// Gain of two atoms together, which, and their forces.
type Pair = (f64, [usize; 2], [f64; 2]);

fn pairs(atoms: &[Atom], square: &DMatrix<f64>, least: f64, pieces: usize) -> Vec<Start> {
    // Of each two pieces the best places.
    let mut best: Vec<Option<Pair>> = vec![None; pieces * pieces];
    for i in 0..atoms.len() {
        let aa = square[(i, i)] + least;
        for j in 0..i {
            let (bb, ab) = (square[(j, j)] + least, square[(j, i)]);
            let own = aa * bb - ab * ab;
            if own < OWN * aa * bb {
                continue;
            }
            let (x, y) = (atoms[i].along, atoms[j].along);
            let forces = [(bb * x - ab * y) / own, (aa * y - ab * x) / own];
            let gain = forces[0] * x + forces[1] * y;
            let known = &mut best[atoms[i].piece * pieces + atoms[j].piece];
            if known.is_none_or(|k| k.0 < gain) {
                *known = Some((gain, [i, j], forces));
            }
        }
    }
    let mut best: Vec<_> = best.into_iter().flatten().collect();
    best.sort_by(|a, b| b.0.total_cmp(&a.0));
    let start = |(_, [i, j], forces): Pair| {
        let ([b, w], [other_b, other_w]) = (atoms[i].start, atoms[j].start);
        Start {
            pieces: (atoms[i].piece, Some(atoms[j].piece)),
            numbers: [forces[0], b, w, forces[1], other_b, other_w],
        }
    };
    best.into_iter().take(PAIRS).map(start).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use hydroline_numerics::cholesky::ln_determinant;
    use hydroline_sim::effect::covariate_table::COVARIATES;
    use hydroline_sim::effect::form::FORMS;
    use nalgebra::Cholesky;

    /// Points known to `sd` each.
    fn of(law: impl Fn(f64) -> f64, along: &Along, sd: f64) -> Likelihood {
        let information = DMatrix::identity(POINTS, POINTS) / (sd * sd);
        let (from, to) = along.range;
        let f = DVector::from_fn(POINTS, |k, _| {
            let c = from + (to - from) * k as f64 / (POINTS - 1) as f64;
            // Any noise will do that has the size.
            law(c) + sd * (1.3 * (17.0 * k as f64).sin())
        });
        let slope = &information * f;
        Likelihood { information, slope }
    }

    fn along(covariate: &str, range: (f64, f64)) -> Along {
        Along {
            dof: 0,
            covariate: COVARIATES.iter().position(|c| *c == covariate).unwrap(),
            range,
            force: 0.5,
        }
    }

    fn names(r: &Ranked) -> Vec<&'static str> {
        r.pieces.iter().map(|p| FORMS[p.form]).collect()
    }

    #[test]
    fn a_bump_is_a_bump_with_its_numbers() {
        let place = along("x", (-0.2, 1.4));
        let law = |x: f64| 1.2 * (-0.5 * ((x - 0.5) / 0.1f64).powi(2)).exp();
        let all = ranked(&place, &of(law, &place, 0.05), 0.25);
        assert_eq!(names(&all[0]), ["bump", "none"], "{:?}", names(&all[1]));
        let found = all[0].numbers();
        assert!((found[0] - 1.2).abs() < 0.1 && (found[1] - 0.5).abs() < 0.02);
        assert!((found[2] - 0.1).abs() < 0.02, "{found:?}");
    }

    #[test]
    fn an_exponent_that_is_none_of_the_usual_is_found() {
        let rate = along("u", (-0.4, 0.4));
        let law = |u: f64| -3.0 * (u / 0.4).abs().powf(1.4) * u.signum();
        let all = ranked(&rate, &of(law, &rate, 0.01), 0.25);
        assert_eq!(names(&all[0]), ["odd_power", "none"]);
        assert!(all[0].pieces[0].is_free(1));
        let found = all[0].numbers();
        assert!((found[1] - 1.4).abs() < 0.05, "{found:?}");
    }

    #[test]
    fn a_sum_of_two_is_two() {
        let place = along("x", (-0.2, 1.4));
        let law =
            |x: f64| 0.8 * (std::f64::consts::TAU * x / 0.3 + 0.4).sin() + 0.6 * (x - 0.9).max(0.0);
        let all = ranked(&place, &of(law, &place, 0.02), 0.25);
        let mut found = names(&all[0]);
        found.sort_unstable();
        assert_eq!(found, ["beyond", "wave"]);
    }

    /// Log evidence of the table itself under its prior's precision.
    fn ln_evidence_of_table(likelihood: &Likelihood, prior: &DMatrix<f64>) -> f64 {
        let before = Cholesky::new(prior.clone()).unwrap();
        let after = Cholesky::new(&likelihood.information + prior).unwrap();
        let gain = 0.5 * likelihood.slope.dot(&after.solve(&likelihood.slope));
        gain + 0.5 * (ln_determinant(&before) - ln_determinant(&after))
    }

    /// A law of three bumps is none of one or two pieces: the table stands above them all.
    #[test]
    fn what_has_no_form_is_a_table() {
        let place = along("x", (0.0, 1.5));
        let bump = |x: f64, c: f64| (-0.5 * ((x - c) / 0.07f64).powi(2)).exp();
        let law = |x: f64| bump(x, 0.2) - 0.6 * bump(x, 0.55) + 0.8 * bump(x, 1.2);
        let likelihood = of(law, &place, 0.02);
        let best = &ranked(&place, &likelihood, 0.25)[0];
        let kernel = &crate::table::kernels(false)[1].precision;
        let table = ln_evidence_of_table(&likelihood, &(kernel / 0.25));
        assert!(
            table > best.ln_score() + 20.0,
            "{table} {} {:?}",
            best.ln_score(),
            names(best)
        );
    }
}
