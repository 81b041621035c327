//! An explanation: a set, what acts twice or bends beside it, and what it weighs.

use super::SLIGHT;
use crate::choosing::Choosing;
use crate::family::{Acts, FamilyFit, Variable};
use crate::fit::Fit;
use crate::search::Search;
use crate::weight::{weight_beyond, weight_of, weight_of_all, weight_of_bent, weights};

/// A set, and what is left beside it.
#[derive(Debug, Clone)]
pub struct Explanation {
    /// The set, fitted.
    pub fit: Fit,
    /// Weight of each member \[m, rad\].
    pub weights: Vec<f64>,
    /// A free function that gains beside it.
    pub family: Option<FamilyFit>,
    /// Without such a function: the member (candidate) that acts twice, with the fit of both.
    pub twice: Option<(usize, Fit)>,
    /// Weight of the function's response \[m, rad\]: of a force as of an effect, of a bend beyond what the set's
    /// own numbers could do.
    pub family_weight: f64,
    /// The member (candidate) whose law lacks what the function does, a force of the load.
    pub shoulder: Option<usize>,
    /// Log evidence of both.
    pub log_evidence: f64,
    /// Its members were chosen by what they gain in prediction: no law reaches the noise here.
    pub by_prediction: bool,
    /// Members (candidates) with what the best explanation without them lacks in log evidence.
    pub needed: Vec<(usize, f64)>,
    /// Candidates that would have gained in prediction where another one gained more.
    pub also: Vec<usize>,
}

impl Explanation {
    /// A set as it is.
    pub(super) fn plain(search: &Search<'_>, fit: &Fit) -> Explanation {
        Explanation {
            fit: fit.clone(),
            weights: weights(search.setting, fit),
            family: None,
            twice: None,
            family_weight: 0.0,
            shoulder: None,
            log_evidence: fit.log_evidence,
            by_prediction: false,
            needed: Vec::new(),
            also: Vec::new(),
        }
    }

    /// A set fitted together with a function.
    pub(super) fn with(search: &Search<'_>, joint: Fit, family: FamilyFit) -> Explanation {
        // A force is weighed as the effects are; of a bend counts what no other number of the set could do.
        let weight = match family.family.acts {
            Acts::Force => weight_of,
            Acts::Bends(_) => weight_beyond,
        };
        let mut made = Explanation::plain(search, &joint);
        // An effect weighs what its law does, as it bends.
        if let Acts::Bends(candidate) = family.family.acts
            && let Some(member) = joint.set.iter().position(|c| *c == candidate)
            && let Some(own) = weight_of_bent(search.setting, &joint, candidate, &family)
        {
            made.weights[member] = own;
        }
        Explanation {
            family_weight: weight(search.setting, &joint, &family.response),
            family: Some(family),
            ..made
        }
    }

    /// A mechanism that acts twice; `once` = what a rig file can hold of it.
    pub(super) fn doubled(
        search: &Search<'_>,
        candidate: usize,
        two: Fit,
        once: &Fit,
    ) -> Explanation {
        let setting = search.setting;
        let mut made = Explanation::plain(search, once);
        let member = once.set.iter().position(|c| *c == candidate);
        if let Some(member) = member
            && setting.vocabulary[candidate].info.parameters[0].corner
        {
            made.weights[member] = weight_of_all(setting, &two, candidate);
        }
        Explanation {
            log_evidence: two.log_evidence,
            twice: Some((candidate, two)),
            ..made
        }
    }

    /// What its function acts on, and of what kind of variable.
    pub(super) fn kind(&self) -> Option<(Acts, Variable)> {
        self.family
            .as_ref()
            .map(|f| (f.family.acts, f.family.variable.kind()))
    }

    /// The member (candidate index) whose law bends.
    pub fn bent(&self) -> Option<usize> {
        if self.shoulder.is_some() {
            return self.shoulder;
        }
        if let Some((candidate, _)) = &self.twice {
            return Some(*candidate);
        }
        match self.family.as_ref()?.family.acts {
            Acts::Bends(candidate) => Some(candidate),
            Acts::Force => None,
        }
    }

    /// Half chi-square of all of it.
    pub(super) fn cost(&self) -> f64 {
        self.twice
            .as_ref()
            .map_or(self.fit.cost, |(_, two)| two.cost)
    }

    /// What all of it leaves, predicted minus measured, run by run \[m, rad\].
    pub fn residuals(&self, search: &Search<'_>) -> Vec<Vec<f64>> {
        let setting = search.setting;
        match (&self.family, &self.twice) {
            (Some(f), _) => f.residuals(setting, &search.weights, &self.fit),
            (None, Some((_, two))) => two.residuals(setting),
            (None, None) => self.fit.residuals(setting),
        }
    }

    /// Log density of runs held out under all of it; `None` where that cannot be asked.
    pub fn told(&self, search: &Search<'_>, by: &Choosing) -> Option<f64> {
        let (setting, weights) = (search.setting, &search.weights);
        match (&self.family, &self.twice) {
            (Some(f), _) if f.family.lasts() => by.beside(setting, weights, &self.fit, f),
            (Some(_), _) => None,
            (None, Some((_, two))) => by.said(setting, weights, two),
            (None, None) => by.said(setting, weights, &self.fit),
        }
    }

    /// Whether all of it foretells runs held out; a force in time foretells nothing.
    pub fn foretells(&self, search: &Search<'_>, by: &Choosing) -> bool {
        let (setting, weights) = (search.setting, &search.weights);
        match (&self.family, &self.twice) {
            (Some(f), _) => f.family.lasts() && by.foretold_beside(setting, weights, &self.fit, f),
            (None, Some((_, two))) => by.foretold(setting, weights, two),
            (None, None) => by.foretold(setting, weights, &self.fit),
        }
    }

    /// Whether it is a set among the sets of the search, by their posterior.
    pub fn simple(&self) -> bool {
        self.family.is_none() && self.twice.is_none() && !self.by_prediction
    }

    /// Members (candidates) heavier than this.
    pub fn matters(&self, tolerance: f64) -> Vec<usize> {
        self.fit
            .set
            .iter()
            .zip(&self.weights)
            .filter(|(_, w)| **w > tolerance)
            .map(|(c, _)| *c)
            .collect()
    }

    /// Whether a law bends by so little that small effects which no set holds leave as much.
    pub fn bends_slightly(&self, tolerance: f64) -> bool {
        !self.unnamed() && self.family.is_some() && self.family_weight <= SLIGHT * tolerance
    }

    /// Whether an unnamed force is part of it.
    pub fn unnamed(&self) -> bool {
        let force = |f: &FamilyFit| f.family.acts == Acts::Force;
        self.shoulder.is_none() && self.family.as_ref().is_some_and(force)
    }
}
