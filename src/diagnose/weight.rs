//! Weight of an effect: what it leaves in the motion after the vehicle's coefficients are refitted.

use hydroline_sim::effect::Stage;
use nalgebra::{DMatrix, DVector};

use super::bank::{basis, motion, outside};
use super::family::FamilyFit;
use super::fit::Fit;
use super::setting::{COEFFICIENTS, Setting};

/// Span of the raw derivatives of the motion without effects to the DOF's own coefficients: those that
/// the rig's model has. One that it says is exactly 0 it lacks, and cannot do an effect's work.
pub fn own_span(setting: &Setting, fit: &Fit) -> DMatrix<f64> {
    let has: Vec<bool> = setting.coefficients().iter().map(|c| *c != 0.0).collect();
    span(setting, fit, &[], &fit.at[..COEFFICIENTS], &has)
}

/// Span of the raw derivatives of the motion under a set to those of its coefficients and parameters
/// that `has` says.
fn span(
    setting: &Setting,
    fit: &Fit,
    set: &[usize],
    globals: &[f64],
    has: &[bool],
) -> DMatrix<f64> {
    let kept: Vec<usize> = (0..globals.len()).filter(|i| has[*i]).collect();
    let columns = kept.len();
    let blocks: Vec<DMatrix<f64>> = (0..setting.tracks.len())
        .map(|run| {
            setting
                .sensitivities(run, set, globals, fit.start(setting, run))
                .1
                .select_columns(&kept)
        })
        .collect();
    let rows: usize = blocks.iter().map(DMatrix::nrows).sum();
    let mut all = DMatrix::zeros(rows, columns);
    let mut first = 0;
    for block in &blocks {
        all.view_mut((first, 0), (block.nrows(), columns))
            .copy_from(block);
        first += block.nrows();
    }
    basis(&all)
}

/// Root mean square of a column.
pub fn rms(column: &DVector<f64>) -> f64 {
    column.norm() / (column.len().max(1) as f64).sqrt()
}

/// Weight of each member of a fit \[m, rad\] (interfaces.md): rms over all stamps of motion with
/// this effect alone minus motion with none, at the fitted vehicle, outside of the span of the
/// derivatives to the DOF's own coefficients.
pub fn weights(setting: &Setting, fit: &Fit) -> Vec<f64> {
    let alone = Alone::new(setting, fit);
    (0..fit.set.len()).map(|m| alone.weight(m..m + 1)).collect()
}

/// The same of all copies of a candidate together.
pub fn weight_of_all(setting: &Setting, fit: &Fit, candidate: usize) -> f64 {
    let first = fit.set.partition_point(|c| *c < candidate);
    let end = fit.set.partition_point(|c| *c <= candidate);
    Alone::new(setting, fit).weight(first..end)
}

/// The same of a candidate whose law bends, as it bends.
pub fn weight_of_bent(
    setting: &Setting,
    fit: &Fit,
    candidate: usize,
    function: &FamilyFit,
) -> Option<f64> {
    let member = fit.set.iter().position(|c| *c == candidate)?;
    let alone = Alone::new(setting, fit);
    let globals = alone.globals(member..member + 1);
    let with = function.motion(setting, &[candidate], &globals, &alone.starts);
    let weight = alone.left(&[candidate], with);
    weight.is_finite().then_some(weight)
}

/// The same of all members together, one of them bent where a function bends it: less than each weighs where they cancel.
pub fn weight_together(setting: &Setting, fit: &Fit, function: Option<&FamilyFit>) -> f64 {
    let alone = Alone::new(setting, fit);
    let Some(function) = function else {
        return alone.weight(0..fit.set.len());
    };
    let globals = alone.globals(0..fit.set.len());
    let with = function.motion(setting, &fit.set, &globals, &alone.starts);
    alone.left(&fit.set, with)
}

/// The vehicle of a fit with few of its members.
struct Alone<'a> {
    setting: &'a Setting,
    fit: &'a Fit,
    span: DMatrix<f64>,
    starts: Vec<(f64, f64)>,
    none: DVector<f64>,
}

impl<'a> Alone<'a> {
    fn new(setting: &'a Setting, fit: &'a Fit) -> Alone<'a> {
        // A stretch of a decay that begins as the angle crosses zero moves by its rate alone.
        let starts: Vec<(f64, f64)> = setting
            .tracks
            .iter()
            .enumerate()
            .map(|(run, track)| match fit.start(setting, run) {
                start if track.starts_under_way(setting.tolerance) => start,
                (position, _) => (position, 0.0),
            })
            .collect();
        Alone {
            setting,
            fit,
            span: own_span(setting, fit),
            none: motion(setting, &[], &fit.at[..COEFFICIENTS], &starts),
            starts,
        }
    }

    fn globals(&self, members: std::ops::Range<usize>) -> Vec<f64> {
        let mut globals = self.fit.at[..COEFFICIENTS].to_vec();
        for member in members {
            globals.extend_from_slice(self.fit.member(self.setting, member));
        }
        globals
    }

    fn weight(&self, members: std::ops::Range<usize>) -> f64 {
        let globals = self.globals(members.clone());
        let set = &self.fit.set[members];
        self.left(set, motion(self.setting, set, &globals, &self.starts))
    }

    /// What a motion with these members differs from that of the vehicle alone by.
    fn left(&self, set: &[usize], with: DVector<f64>) -> f64 {
        let setting = self.setting;
        let mut apart = with - &self.none;
        // Where a run at rest begins is read off the run: what reads that place otherwise (a scale of the position) moves
        // the start along.
        let reads = |c: &usize| setting.vocabulary[*c].info.stage == Stage::Measurement;
        if set.iter().any(reads) {
            let mut first = 0;
            for track in &setting.tracks {
                let rows = track.times_s.len();
                if !track.starts_under_way(setting.tolerance) {
                    let start = apart[first];
                    apart.rows_mut(first, rows).add_scalar_mut(-start);
                }
                first += rows;
            }
        }
        rms(&outside(&self.span, &apart))
    }
}

/// Weight of an additional motion (a free force's response) as effects are weighed: what the DOF's own
/// coefficients leave of it \[m, rad\].
pub fn weight_of(setting: &Setting, fit: &Fit, response: &DVector<f64>) -> f64 {
    rms(&outside(&own_span(setting, fit), response))
}

/// What an additional motion (the response to a bent law) leaves that neither the coefficients nor
/// the parameters of the named effects can take over: only that is unexplained.
pub fn weight_beyond(setting: &Setting, fit: &Fit, response: &DVector<f64>) -> f64 {
    let globals = fit.globals(setting);
    let mut has = vec![true; globals.len()];
    for (h, c) in has.iter_mut().zip(setting.coefficients()) {
        *h = c != 0.0;
    }
    let taken = span(setting, fit, &fit.set, globals, &has);
    rms(&outside(&taken, response))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::family::{Acts, Variable};
    use crate::search::Search;
    use crate::testing::{candidate, hats, setting, surge};

    /// Runs that began off the rig's zero made a scale of the position weigh a constant offset.
    #[test]
    fn a_scale_of_the_position_does_not_weigh_more_where_runs_begin_off_zero() {
        let weight = |at_m: f64| {
            let mut made = setting(&[surge(0, &[]), surge(1, &[])]);
            for track in &mut made.tracks {
                track.measured.iter_mut().for_each(|x| *x += at_m);
            }
            let scale = candidate(&made, "position_scale");
            let mut search = Search::still(&made, &|_| {});
            search.nothing();
            let mut fit = search.get(&[]).unwrap().clone();
            fit.set = vec![scale];
            fit.at.insert(COEFFICIENTS, 1.01);
            weights(&made, &fit)[0]
        };
        let (at_zero, off) = (weight(0.0), weight(0.4));
        assert!((off / at_zero - 1.0).abs() < 0.05, "{at_zero} {off}");
    }

    /// A law bent by the same factor everywhere weighs what the same law with that parameter does; it weighed as if nothing
    /// bent it, half as much again as the truth where the bend did most of the work.
    #[test]
    fn a_bent_law_weighs_what_it_does_as_it_bends() {
        let made = setting(&[surge(0, &[("current", &[("vx_mps", 0.02)])]), surge(1, &[])]);
        let current = candidate(&made, "current");
        let mut search = Search::still(&made, &|_| {});
        search.nothing();
        search.singles();
        let fit = search.finished(&[current]).unwrap();
        let place = made.places(&fit.set)[0];
        let bent_by = |factor: f64| {
            let law = Acts::Bends(current);
            let amplitudes = vec![factor.ln(); 3];
            let function = hats(law, Variable::Place, vec![-1.0, 0.0, 1.0], amplitudes, 0.1);
            weight_of_bent(&made, &fit, current, &function).unwrap()
        };
        for factor in [1.0, 0.6] {
            let mut like = fit.clone();
            like.at[place] *= factor;
            let plain = weights(&made, &like)[0];
            let apart = (bent_by(factor) / plain - 1.0).abs();
            assert!(plain > 0.0 && apart < 1e-9, "{factor}: {apart}");
        }
    }
}
