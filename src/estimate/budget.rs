//! Uncertainty budget of coefficients: what their values hold beside the scatter of samples.
//!
//! Type A is the posterior of the fit: samples, their colour, the random force, joined clocks. Type B are numbers that the fit takes as
//! known and that are not: each is a consider parameter, whose error moves the estimate by the estimator's own gain and is not estimated
//! itself (Schmidt 1966). With C the covariance of the fit and I_k the information that its numbers share with the consider parameter,
//! the estimate moves by −C I_k for each unit of it. An effect that these runs cannot show is one as well, as large as is typical, less
//! what the runs do say of it.
//! References: JCGM 100:2008 (GUM), 5.1; ITTC 7.5-02-01-01; Bierman 1977, ch. 8 (consider parameters).

use std::collections::BTreeMap;

use hydroline_core::run::{Channel, PerChannel};
use hydroline_identify::{BudgetLine, Estimate, Identification};
use hydroline_inference::body::Body;
use hydroline_inference::fit::Problem;
use hydroline_inference::prior::PriorTable;
use hydroline_numerics::parallel;
use hydroline_rigs::{Dof, Rig};
use nalgebra::DMatrix;

use super::asked::Asked;
use super::fitted::Fitted;
use super::numbers::Numbers;

/// sd of the thrust's scale where neither a bollard pull nor the rig says it: what makers' curves are worth.
const THRUST_SCALE_SD: f64 = 0.05;
/// sd of the mass, as a share: a vehicle on a crane balance, with what water its frame holds.
const MASS_SHARE: f64 = 0.01;
/// sd of a moment of inertia, of the centre of buoyancy and of hydrostatics, as a share: mostly computed from a drawing.
const COMPUTED_SHARE: f64 = 0.05;
/// sd of the length scale of positions: a board measured with a steel rule.
const POSITION_SCALE_SD: f64 = 0.002;
/// What all poses of a run share: of the calibration, of the camera's response, of where the target lies \[m\].
const SHARED_M: f64 = 1e-4;
/// The same of angles: 0.05 deg \[rad\].
const SHARED_RAD: f64 = 8.7e-4;
/// Share of a number by which derivatives are taken.
const STEP: f64 = 1e-3;
/// Coverage factor of the expanded uncertainty (GUM, 6.2): about 95 %.
const COVERAGE: f64 = 2.0;
/// Effects that stand in the budget by another name.
const ELSEWHERE: [&str; 2] = ["thrust_scale", "position_scale"];

/// Motion that one sd of a consider parameter makes, per run and sample.
type Moved = Vec<Vec<PerChannel<f64>>>;

/// A number that the fit takes as known.
struct Consider {
    source: String,
    /// sd in the unit; `None` = in units of what is typical.
    sd: Option<f64>,
    unit: &'static str,
    basis: String,
    reduce: String,
    moved: Moved,
    /// Amplitude in typical sizes, of which the runs say something.
    is_effect: bool,
}

/// Adds the budget to a result: lines, combined and expanded uncertainty, the largest share of each coefficient.
pub(crate) fn add_budget(
    result: &mut Identification,
    (fitted, numbers): (&Fitted, &Numbers),
    asked: &Asked,
    rig: &Rig,
) {
    let whole = Sources { fitted, rig };
    let all = whole.all(asked);
    let Some(changes) = changes(fitted, numbers, &all) else {
        return;
    };
    let own = &fitted.problem.body.own;
    let places: Vec<Option<usize>> = asked
        .coefficients
        .iter()
        .map(|c| own.iter().position(|o| o.coefficient() == Some(*c)))
        .collect();
    let n = places.len();
    let mut combined = DMatrix::from_fn(n, n, |i, j| {
        result.covariance[i][j].unwrap_or(if i == j { f64::INFINITY } else { 0.0 })
    });
    let keys = result.order.clone();
    let type_a = keys
        .iter()
        .filter_map(|k| Some((k.clone(), result.parameters.get(k)?.sd?)));
    let mut lines = vec![BudgetLine {
        source: "samples, their colour, the random force".to_owned(),
        kind: "A".to_owned(),
        sd: None,
        unit: String::new(),
        basis: "the fit".to_owned(),
        contributions: type_a.collect(),
        reduce: "longer runs, or more of them".to_owned(),
    }];
    for (consider, change) in all.iter().zip(changes) {
        let by: Vec<f64> = places
            .iter()
            .map(|p| p.map_or(0.0, |p| change[p]))
            .collect();
        for i in 0..n {
            for j in 0..n {
                combined[(i, j)] += by[i] * by[j];
            }
        }
        let of = keys.iter().cloned().zip(by.iter().map(|v| v.abs()));
        let of: BTreeMap<String, f64> = of.filter(|(_, v)| *v > 0.0).collect();
        // Runs and channels of one source are one line.
        match lines.iter_mut().find(|l| l.source == consider.source) {
            Some(line) => {
                for (key, v) in of {
                    let sum = line.contributions.entry(key).or_default();
                    *sum = sum.hypot(v);
                }
            }
            None => lines.push(BudgetLine {
                source: consider.source.clone(),
                kind: "B".to_owned(),
                sd: consider.sd,
                unit: consider.unit.to_owned(),
                basis: consider.basis.clone(),
                contributions: of,
                reduce: consider.reduce.clone(),
            }),
        }
    }
    // What moves no coefficient is no source of their uncertainty.
    lines.retain(|l| l.contributions.values().any(|v| *v > 0.0));
    for (i, key) in keys.iter().enumerate() {
        let Some(p) = result.parameters.get_mut(key) else {
            continue;
        };
        conclude(p, combined[(i, i)].sqrt(), key, &lines);
    }
    let finite = |v: f64| v.is_finite().then_some(v);
    result.covariance_combined = (0..n)
        .map(|i| (0..n).map(|j| finite(combined[(i, j)])).collect())
        .collect();
    let assumed: Vec<String> = lines
        .iter()
        .filter(|l| l.basis.starts_with("assumed"))
        .map(|l| l.source.clone())
        .collect();
    if !assumed.is_empty() {
        result.notes.push(format!(
            "assumed until measured, and in the combined uncertainty: {} (budget)",
            assumed.join(", ")
        ));
    }
    result.budget = lines;
}

/// Combined and expanded uncertainty of a coefficient, and its largest share.
fn conclude(p: &mut Estimate, combined: f64, key: &str, lines: &[BudgetLine]) {
    let finite = combined.is_finite().then_some(combined);
    p.combined_sd = finite;
    p.u95 = finite.map(|sd| COVERAGE * sd);
    let of = |l: &&BudgetLine| l.contributions.get(key).copied().unwrap_or(0.0);
    let largest = lines.iter().max_by(|a, b| of(a).total_cmp(&of(b)));
    p.largest_share = largest.filter(|l| of(l) > 0.0).map(|l| l.source.clone());
}

/// Change of each natural number of the fit by one sd of each consider parameter.
fn changes(fitted: &Fitted, numbers: &Numbers, all: &[Consider]) -> Option<Vec<Vec<f64>>> {
    let (problem, fit) = (&fitted.problem, &fitted.fit);
    let n = fit.point.len();
    let mut simulated = problem.simulate(&[], &fit.point)?;
    for (k, consider) in all.iter().enumerate() {
        for (s, moved) in simulated.iter_mut().zip(&consider.moved) {
            s.columns.push((n + k, moved.clone()));
        }
    }
    let size = n + all.len();
    let mut information = DMatrix::<f64>::zeros(size, size);
    for d in &problem.body.dofs {
        let of = problem.normal(&simulated, *d, fit.cells.misfit[*d], size);
        information += of.information;
    }
    let known = numbers
        .covariance
        .map(|v| if v.is_finite() { v } else { 0.0 });
    let each = all.iter().enumerate().map(|(k, consider)| {
        let shared = (0..n).map(|i| information[(i, n + k)] / numbers.slopes[i]);
        let shared = nalgebra::DVector::from_iterator(n, shared);
        let moved = -(&known * &shared);
        // What is left of the effect's own response beside the fit's numbers tells how large it may still be.
        let seen = (information[(n + k, n + k)] + shared.dot(&moved)).max(0.0);
        let sd = if consider.is_effect {
            (1.0 + seen).recip().sqrt()
        } else {
            1.0
        };
        moved.iter().map(|v| v * sd).collect()
    });
    Some(each.collect())
}

/// Sources of a fit's budget.
struct Sources<'a> {
    fitted: &'a Fitted,
    rig: &'a Rig,
}

impl Sources<'_> {
    fn all(&self, asked: &Asked) -> Vec<Consider> {
        let mut all = self.of_the_rig();
        all.extend(self.fixed(asked));
        all.extend(self.of_the_poses());
        all.extend(self.unseen());
        all
    }

    fn body(&self) -> &Body {
        &self.fitted.problem.body
    }

    fn base(&self) -> Moved {
        self.fitted.problem.predicted(&[], &self.fitted.fit.point)
    }

    /// Motion that a change of the body makes, over the step.
    fn by(&self, step: f64, change: impl Fn(&mut Body, f64)) -> Moved {
        let mut other = self.fitted.problem.clone();
        change(&mut other.body, step);
        let moved = other.predicted(&[], &self.fitted.fit.point);
        minus(&moved, &self.base(), step.recip())
    }

    /// Numbers of the rig that are held: thrust, mass, inertia, buoyancy, hydrostatics.
    fn of_the_rig(&self) -> Vec<Consider> {
        let (rig, vehicle) = (self.rig, &self.rig.vehicle);
        let mut all = Vec::new();
        let mut add = |source: &str,
                       (stated, assumed): (Option<f64>, f64),
                       unit,
                       moved: Moved,
                       reduce: &str| {
            let sd = stated.unwrap_or(assumed);
            if sd <= 0.0 {
                return;
            }
            all.push(Consider {
                source: source.to_owned(),
                sd: Some(sd),
                unit,
                basis: match stated {
                    Some(_) => "the rig".to_owned(),
                    None => "assumed".to_owned(),
                },
                reduce: reduce.to_owned(),
                moved: scaled(moved, sd),
                is_effect: false,
            });
        };
        let commands = self.body().recording.runs.iter().flat_map(|r| &r.commands);
        let commanded = commands.into_iter().any(|c| c.1.iter().any(|w| *w != 0.0));
        if commanded && rig.bollard.is_none() {
            let moved = self.by(STEP, |body, step| {
                let runs = body.recording.runs.iter_mut();
                for (_, wrench) in runs.flat_map(|r| r.commands.iter_mut()) {
                    *wrench = wrench.map(|w| w * (1.0 + step));
                }
            });
            let known = (rig.thrusters.scale_sd, THRUST_SCALE_SD);
            add(
                "thrust scale",
                known,
                "1",
                moved,
                "a bollard pull (identify --bollard)",
            );
        }
        let dofs = &self.body().dofs;
        if dofs.iter().any(|d| *d < 3) {
            let step = STEP * vehicle.mass_kg;
            let moved = self.by(step, |body, step| body.vehicle.mass_kg += step);
            let known = (vehicle.mass_kg_sd, MASS_SHARE * vehicle.mass_kg);
            add(
                "mass",
                known,
                "kg",
                moved,
                "weighing the vehicle (vehicle.mass_kg_sd)",
            );
        }
        for d in dofs.iter().filter(|d| **d >= 3) {
            let i = d - 3;
            let said = vehicle.inertia_kgm2[i];
            let moved = self.by(STEP * said, |body, step| {
                body.vehicle.inertia_kgm2[i] += step
            });
            let known = (
                vehicle.inertia_kgm2_sd.map(|sd| sd[i]),
                COMPUTED_SHARE * said,
            );
            let source = format!("moment of inertia in {}", Dof::ALL[*d].name());
            add(
                &source,
                known,
                "kg m2",
                moved,
                "a bifilar pendulum (vehicle.inertia_kgm2_sd)",
            );
        }
        if dofs.iter().any(|d| matches!(d, 3 | 4)) && vehicle.r_bz_m != 0.0 {
            let step = STEP * vehicle.r_bz_m.abs();
            let moved = self.by(step, |body, step| body.vehicle.r_bz_m += step);
            let known = (vehicle.r_bz_m_sd, COMPUTED_SHARE * vehicle.r_bz_m.abs());
            add(
                "centre of buoyancy",
                known,
                "m",
                moved,
                "an inclining test (vehicle.r_bz_m_sd)",
            );
        }
        for (i, said) in vehicle.stiffness.into_iter().enumerate() {
            if said == 0.0 || !dofs.contains(&(i + 2)) {
                continue;
            }
            let moved = self.by(STEP * said, |body, step| body.vehicle.stiffness[i] += step);
            let source = format!("stiffness in {}", Dof::ALL[i + 2].name());
            add(
                &source,
                (None, COMPUTED_SHARE * said.abs()),
                "N/m, N m/rad",
                moved,
                "a known weight laid on",
            );
        }
        if vehicle.net_weight_n != 0.0 && dofs.contains(&2) {
            let step = STEP * vehicle.net_weight_n.abs();
            let moved = self.by(step, |body, step| body.vehicle.net_weight_n += step);
            let known = (None, COMPUTED_SHARE * vehicle.net_weight_n.abs());
            add("net weight", known, "N", moved, "weighing it in water");
        }
        all
    }

    /// Coefficients that were fixed, as well as an identification before knows them.
    fn fixed(&self, asked: &Asked) -> Vec<Consider> {
        let of = |c: hydroline_identify::parameter::Coefficient| {
            let sd = c.identified_sd(self.rig)?;
            let value = c.of_vehicle(&self.rig.vehicle);
            let step = STEP * value.abs().max(sd);
            let moved = self.by(step, |body, step| c.put(&mut body.vehicle, value + step));
            Some(Consider {
                source: format!("{} (fixed)", c.key()),
                sd: Some(sd),
                unit: c.unit(),
                basis: "[identified] of the rig".to_owned(),
                reduce: "a run that determines it".to_owned(),
                moved: scaled(moved, sd),
                is_effect: false,
            })
        };
        asked.fixed.iter().filter_map(|c| of(*c)).collect()
    }

    /// Scale of the positions, and what all poses of a run share.
    fn of_the_poses(&self) -> Vec<Consider> {
        let base = self.base();
        let measured = |c: Channel| self.fitted.problem.noises.channels[c].is_some();
        let consider = |source: &str, sd: f64, unit, reduce: &str, moved: Moved| Consider {
            source: source.to_owned(),
            sd: Some(sd),
            unit,
            basis: "assumed".to_owned(),
            reduce: reduce.to_owned(),
            moved,
            is_effect: false,
        };
        let mut all = Vec::new();
        let lengths = [Channel::X, Channel::Y, Channel::Z];
        if lengths.into_iter().any(measured) {
            let of = |v: &PerChannel<f64>| {
                PerChannel::from_fn(|c| match lengths.contains(&c) {
                    true => POSITION_SCALE_SD * v[c],
                    false => 0.0,
                })
            };
            let moved = base
                .iter()
                .map(|run| run.iter().map(of).collect())
                .collect();
            all.push(consider(
                "length scale of the positions",
                POSITION_SCALE_SD,
                "1",
                "moving the vehicle by a known distance",
                moved,
            ));
        }
        for run in 0..base.len() {
            for c in Channel::POSES.into_iter().filter(|c| measured(*c)) {
                let (sd, unit) = match c.is_angular() {
                    true => (SHARED_RAD, "rad"),
                    false => (SHARED_M, "m"),
                };
                let one = PerChannel::from_fn(|other| if other == c { sd } else { 0.0 });
                let of = |r: usize, v: &Vec<PerChannel<f64>>| match r == run {
                    true => vec![one; v.len()],
                    false => vec![PerChannel::splat(0.0); v.len()],
                };
                let moved = base.iter().enumerate().map(|(r, v)| of(r, v)).collect();
                let source = match c.is_angular() {
                    true => "angles that all poses of a run share",
                    false => "offset that all poses of a run share",
                };
                all.push(consider(
                    source,
                    sd,
                    unit,
                    "a calibration with less left over",
                    moved,
                ));
            }
        }
        all
    }

    /// Effects that these runs would not show at their typical size, each at the place where it moves the vehicle most.
    fn unseen(&self) -> Vec<Consider> {
        let Fitted { problem, fit, .. } = self.fitted;
        let body = &problem.body;
        let asked = Body::new(
            body.recording.clone(),
            self.rig,
            &body.dofs,
            &[],
            PriorTable::default(),
        );
        let Ok(asked) = asked else {
            return Vec::new();
        };
        let with = Problem {
            body: Body {
                candidates: asked.candidates,
                ..body.clone()
            },
            noises: problem.noises.clone(),
            worth: problem.worth.clone(),
        };
        let base = self.base();
        let unseen: Vec<usize> = with
            .unseen(fit)
            .into_iter()
            .filter(|c| !ELSEWHERE.contains(&with.body.candidates[*c].info.id))
            .collect();
        let made = parallel::map_slice(&unseen, |c| {
            let candidate = &with.body.candidates[*c];
            let numbers = candidate.starts.first()?;
            let (terms, point) = with.with(fit, *c, numbers);
            let moved = minus(&with.predicted(&terms, &point), &base, 1.0);
            let finite = moved.iter().flatten().flatten().all(|v| v.is_finite());
            finite.then(|| (candidate.info.id, moved))
        });
        let mut largest: BTreeMap<&str, (f64, Moved)> = BTreeMap::new();
        for (id, moved) in made.into_iter().flatten() {
            let size: f64 = moved.iter().flatten().flatten().map(|v| v * v).sum();
            if largest.get(id).is_none_or(|(most, _)| size > *most) {
                largest.insert(id, (size, moved));
            }
        }
        let each = largest.into_iter();
        each.map(|(id, (_, moved))| Consider {
            source: id.to_owned(),
            sd: None,
            unit: "typical size",
            basis: "blind spot: these runs cannot show it".to_owned(),
            reduce: "a run that shows it (hydroline diagnose names the plan)".to_owned(),
            moved,
            is_effect: true,
        })
        .collect()
    }
}

fn minus(moved: &Moved, base: &Moved, by: f64) -> Moved {
    let each = moved.iter().zip(base);
    each.map(|(a, b)| {
        let pairs = a.iter().zip(b);
        pairs
            .map(|(a, b)| PerChannel::from_fn(|c| by * (a[c] - b[c])))
            .collect()
    })
    .collect()
}

fn scaled(mut moved: Moved, by: f64) -> Moved {
    moved.iter_mut().flatten().flatten().for_each(|v| *v *= by);
    moved
}
