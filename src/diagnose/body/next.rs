//! The next run: the plan that best separates the verdict from its nearest rival that matters.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicBool, Ordering};

use hydroline_calib::calibration::Calibration;
use hydroline_design::Admission;
use hydroline_design::library::{Watched, library, run_of};
use hydroline_inference::fit::Fit;
use hydroline_inference::limit::Limit;
use hydroline_numerics::{cancel, parallel};
use hydroline_plan::size::scaled;
use hydroline_rigs::{Dof, Plan, Rig};
use hydroline_sim::Allocation;

use super::found::{Judged, LISTED};
use crate::verdict::NextExperiment;

/// Shares of the largest load of the runs at hand.
const SHARES: [f64; 2] = [1.0, 0.5];
/// Shares of these at which a plan is tried until the rig runs it.
const SMALLER: [f64; 8] = [1.0, 0.8, 0.65, 0.5, 0.4, 0.3, 0.2, 0.1];
/// Models looked at for a rival in which something else matters.
const MODELS: usize = 40;
/// Plans offered beside the best one.
const OFFERS: usize = 5;
/// Rivals that one plan has to separate.
const RIVALS: usize = 4;

/// A plan that may be run next.
#[derive(Debug, Clone)]
pub struct Offer {
    /// The plan, at a size that the rig runs.
    pub plan: Plan,
    /// Log Bayes factor to expect between the verdict and its nearest rival \[nats\].
    pub gain_nats: f64,
}

impl Judged<'_> {
    /// The plan, with its reason, and the best of the others, it first; nothing where nothing else was found possible, or no
    /// plan fits into the tank. Beside it whether the limit was over before all plans were asked.
    pub fn next(
        &self,
        rig: &Rig,
        calibration: Option<&Calibration>,
        limit: Limit,
    ) -> (Option<(NextExperiment, Vec<Offer>)>, bool) {
        let is_cut = AtomicBool::new(false);
        let next = self.next_within(rig, calibration, &|| {
            let is_over = limit.is_over();
            if is_over {
                is_cut.store(true, Ordering::Relaxed);
            }
            is_over
        });
        (next, is_cut.into_inner())
    }

    fn next_within(
        &self,
        rig: &Rig,
        calibration: Option<&Calibration>,
        is_over: &(dyn Fn() -> bool + Sync),
    ) -> Option<(NextExperiment, Vec<Offer>)> {
        let (set, rivals) = self.rivals();
        let verdict = self.of_set(&set)?;
        if rivals.is_empty() {
            return None;
        }
        let allocation = Allocation::new(&rig.thrusters).ok()?;
        // As these runs have it move.
        let mut fitted = rig.clone();
        self.adopt(&mut fitted);
        let admission = &Admission::of_known(&fitted, calibration);
        let plans: Vec<Plan> = self
            .driven(&set, &rivals)
            .into_iter()
            .flat_map(|(d, size)| SHARES.into_iter().map(move |share| (d, size, share)))
            .flat_map(|(d, size, share)| {
                library(d, size * share).into_iter().filter_map(move |p| {
                    let fits = at_the_size_that_fits(admission, p)?;
                    let (mut plan, fits) = fits;
                    let dof = Dof::ALL[d].name();
                    plan.name = format!("{}-{dof}-{:.0}", plan.name, 100.0 * share * fits);
                    Some(plan)
                })
            })
            .collect();
        let problem = &self.found.problem;
        // The nearest rival, by its place, and how far off it is.
        let gain = |plan: &Plan| -> Option<(usize, f64)> {
            let (commands, times_s) = run_of(rig, &allocation, plan, Watched::default())?;
            let mut planned = problem.planned(&plan.name, commands, &times_s, rig).ok()?;
            let each = rivals.iter().enumerate().map(|(place, (_, rival))| {
                let there = problem.separation(&mut planned, verdict, rival)?;
                let back = problem.separation(&mut planned, rival, verdict)?;
                Some((place, there.min(back)))
            });
            let each = each.collect::<Option<Vec<_>>>()?;
            each.into_iter().min_by(|a, b| a.1.total_cmp(&b.1))
        };
        let scored = parallel::map_owned(plans, |plan| {
            cancel::check();
            if is_over() {
                return None;
            }
            let (nearest, gain) = gain(&plan)?;
            gain.is_finite().then_some((plan, nearest, gain))
        });
        let mut scored: Vec<(Plan, usize, f64)> = scored.into_iter().flatten().collect();
        // Ties go to the first name: the same plan in every run.
        scored.sort_by(|a, b| b.2.total_cmp(&a.2).then_with(|| a.0.name.cmp(&b.0.name)));
        let considered: BTreeMap<String, f64> = scored
            .iter()
            .map(|(p, _, g)| (p.name.clone(), *g))
            .collect();
        let offers = scored.iter().take(OFFERS).map(|(plan, _, gain)| Offer {
            plan: plan.clone(),
            gain_nats: *gain,
        });
        let offers: Vec<Offer> = offers.collect();
        let (plan, nearest, gain) = scored.into_iter().next()?;
        let named =
            |set: &BTreeSet<usize>| -> Vec<String> { set.iter().map(|t| self.id(*t)).collect() };
        let mut separates = vec![named(&set)];
        separates.extend(rivals.iter().map(|r| named(&r.0)));
        let say = |set: &[String]| match set {
            [] => "nothing".to_owned(),
            _ => set.join(" + "),
        };
        let reason = format!(
            "after it {} and {} differ by {gain:.1} nats, the nearest of {} that these runs leave",
            say(&separates[0]),
            say(&separates[1 + nearest]),
            separates.len()
        );
        let next = NextExperiment {
            plan_toml: plan.to_toml(),
            plan: plan.name,
            separates,
            expected_log_bayes_factor: gain,
            considered,
            reason,
        };
        Some((next, offers))
    }

    /// Set that matters by the verdict, and its rivals: sets that tie with it, or else the likeliest in which something else
    /// matters.
    fn rivals(&self) -> (BTreeSet<usize>, Vec<(BTreeSet<usize>, &Fit)>) {
        let Some((set, first)) = self.groups.first().cloned() else {
            return (BTreeSet::new(), Vec::new());
        };
        let tied = self.groups.iter().skip(1).filter(|g| g.1 >= LISTED * first);
        let mut rivals: Vec<(BTreeSet<usize>, &Fit)> = tied
            .take(RIVALS)
            .filter_map(|g| Some((g.0.clone(), self.of_set(&g.0)?)))
            .collect();
        if rivals.is_empty() {
            let models = self.posterior.models.iter().take(MODELS);
            let other = models.filter_map(|(terms, _)| {
                let fit = self.found.models.get(terms)?;
                let heavy = self.heavy(fit);
                (heavy != set).then_some((heavy, fit))
            });
            rivals.extend(other.take(1));
        }
        (set, rivals)
    }

    /// The likeliest model in which just these matter.
    fn of_set(&self, set: &BTreeSet<usize>) -> Option<&Fit> {
        let models = self.posterior.models.iter().take(MODELS);
        let mut fits = models.filter_map(|(terms, _)| self.found.models.get(terms));
        fits.find(|fit| self.heavy(fit) == *set)
    }

    /// DOFs that plans drive, with the largest load of the runs at hand: those that the sets' words name, or all.
    fn driven(
        &self,
        set: &BTreeSet<usize>,
        rivals: &[(BTreeSet<usize>, &Fit)],
    ) -> Vec<(usize, f64)> {
        let body = &self.found.problem.body;
        let mut largest = [0.0_f64; 6];
        for (_, wrench) in body.recording.runs.iter().flat_map(|r| &r.commands) {
            largest = std::array::from_fn(|d| largest[d].max(wrench[d].abs()));
        }
        let named = |t: &usize| -> Option<usize> {
            let word = body.candidates[*t].word("dof")?;
            Dof::ALL.into_iter().position(|d| d.name() == word)
        };
        let apart = set.iter().chain(rivals.iter().flat_map(|r| &r.0));
        let meant: BTreeSet<usize> = apart
            .filter_map(named)
            .filter(|d| largest[*d] > 0.0)
            .collect();
        let all = (0..6).filter(|d| largest[*d] > 0.0);
        let chosen: Vec<usize> = if meant.is_empty() {
            all.collect()
        } else {
            meant.into_iter().collect()
        };
        chosen.into_iter().map(|d| (d, largest[d])).collect()
    }
}

/// A plan at the largest share of its loads with which the rig runs it and sees its target, and that share.
fn at_the_size_that_fits(admission: &Admission, plan: Plan) -> Option<(Plan, f64)> {
    let shares = SMALLER.into_iter();
    let mut sized = shares.map(|share| (scaled(&plan, share), share));
    sized.find(|(plan, _)| admission.admits(plan))
}
