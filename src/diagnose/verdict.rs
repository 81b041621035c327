//! The verdict, as `diagnose --json` prints it (reference/interfaces.md, verdict). A field that has nothing to say is absent.

mod contradiction;
mod effect;
mod implausible;
mod mismatch;
mod posterior;
mod prediction;
mod truncated;
mod unexplained;
mod vehicle;

pub use contradiction::Contradiction;
pub use effect::{AblationStep, Alternative, Candidate, Effect, Law, Value};
pub use implausible::Implausible;
pub use mismatch::{DataFault, NoiseFound, Test, Where};
pub use posterior::PosteriorModel;
pub use prediction::{BeforeAfter, FitTable, LeaveOneRunOut, Predicted, PredictedRun, Predictive};
pub use truncated::{Truncated, TruncatedBy};
pub use unexplained::{ClosedForm, Piece, Unexplained, WrittenForm};
pub use vehicle::{AtLimit, Parameters};

use std::collections::BTreeMap;

use hydroline_identify::model_test::ModelTest;

use serde::Serialize;

/// Probability from which an effect is established, and goes into a rig.
pub const ESTABLISHED: f64 = 0.95;

/// Word of a verdict. Ordered: of two verdicts on the same logs the later one holds.
#[derive(
    Debug,
    Clone,
    Copy,
    Default,
    PartialEq,
    Eq,
    PartialOrd,
    Ord,
    Serialize,
    schemars::JsonSchema,
    serde::Deserialize,
)]
#[serde(rename_all = "snake_case")]
pub enum Word {
    /// Nothing established, or nothing that matters.
    #[default]
    None,
    /// The list is the best explanation by far.
    Named,
    /// Sets that this data cannot distinguish.
    Ambiguous,
    /// Something matters and nothing in the library explains it.
    Unknown,
    /// The data are wrong before any physics.
    DataFault,
}

impl Word {
    /// As JSON and tables have it.
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Named => "named",
            Self::Ambiguous => "ambiguous",
            Self::Unknown => "unknown",
            Self::DataFault => "data_fault",
        }
    }
}

/// Run that would say most next.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct NextExperiment {
    /// Name of the plan.
    pub plan: String,
    /// The plan file.
    pub plan_toml: String,
    /// Sets of effects that it separates: the verdict's, then its rivals.
    pub separates: Vec<Vec<String>>,
    /// Expected log Bayes factor between the two closest of them.
    pub expected_log_bayes_factor: f64,
    /// All plans asked, with the same figure.
    pub considered: BTreeMap<String, f64>,
    /// Why this one, in a sentence; empty where the figure says it.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub reason: String,
}

/// Verdict of a diagnosis.
#[derive(Debug, Clone, PartialEq, Default, Serialize, schemars::JsonSchema)]
pub struct Verdict {
    /// The verdict in one word.
    pub verdict: Word,
    /// The verdict in one sentence.
    pub sentence: String,
    /// The effects that the model left out, together; largest effect size first.
    pub effects: Vec<Effect>,
    /// Complete sets of what matters that this data cannot distinguish, most probable first.
    pub equivalent: Vec<Vec<String>>,
    /// Every effect with a probability of a hundredth and more, listed above or not.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub candidates: Vec<Candidate>,
    /// Effects that are not offered, since their size would have to be implausible for this vehicle; likeliest first.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub implausible: Vec<Implausible>,
    /// Where the mismatch acts.
    #[serde(rename = "where")]
    pub place: Where,
    /// Test of whether there is a mismatch at all.
    pub test: Test,
    /// Test of whether the vehicle alone explains the runs, to within the tolerance: the same as in `identify`.
    pub vehicle_alone: ModelTest,
    /// How well the model fits and predicts, without and with the effects.
    pub fit: FitTable,
    /// The vehicle's coefficients, without and with the effects.
    pub parameters: Parameters,
    /// Coefficients at a physical limit or far from the rig's, with their factor over the rig's.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub at_limit: Vec<AtLimit>,
    /// End by a time limit or by Ctrl-C, and the work that was still open; absent = the search came to its end.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub truncated: Option<Truncated>,
    /// Per DOF that moves the probability that a force of no known effect is worth more than the tolerance.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub unnamed: BTreeMap<String, f64>,
    /// Each run predicted with the model refitted to the others; absent of one run alone.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub leave_one_run_out: Option<LeaveOneRunOut>,
    /// Channels of runs held out that miss their prediction by more than the likeliest model's band, the furthest off first; absent where
    /// each run held out is predicted.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub contradicted_by: Vec<Contradiction>,
    /// Effects that these runs cannot show, since they leave their size open, as `EFFECT`, or `EFFECT in surge, sway` where it acts in
    /// a DOF by name.
    pub blind_spots: Vec<String>,
    /// The run that would say most next; `None` = none is needed, or none would.
    pub next_experiment: Option<NextExperiment>,
    /// Noise of the measurement, per channel.
    pub noise: BTreeMap<String, NoiseFound>,
    /// Faults of the data.
    pub data_faults: Vec<DataFault>,
    /// The likeliest sets of effects that were looked at, the verdict's first.
    pub alternatives: Vec<Alternative>,
    /// Models of the posterior with the joint distribution of their numbers, for draws; most probable first.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub posterior: Vec<PosteriorModel>,
    /// The heavy effects one after the other, by what each gains in prediction.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub ablation: Vec<AblationStep>,
    /// Motion that nothing in the library explains.
    pub unexplained: Vec<Unexplained>,
    /// DOFs whose measured motion drove the others instead of being explained.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub given: Vec<String>,
    /// Remarks, in words.
    pub notes: Vec<String>,
    /// Sets of effects looked at.
    pub sets_looked_at: usize,
}

impl Verdict {
    /// Predictions, channel by channel: runs and frames held out, and of the other channels each run by the others.
    pub fn predicted(&self) -> impl Iterator<Item = Predicted<'_>> {
        let held_out = &self.fit.held_out;
        let others = self.leave_one_run_out.iter();
        let others = others.flat_map(LeaveOneRunOut::rows);
        held_out
            .rows(&self.fit.held_out_by)
            .chain(others.filter(|p| !held_out.before.contains_key(p.channel)))
    }

    /// Ids of the effects that matter, in their order.
    pub fn mattering(&self) -> Vec<&str> {
        let mattering = self.effects.iter().filter(|e| e.matters);
        mattering.map(|e| e.effect.as_str()).collect()
    }

    /// Puts an effect among what these runs cannot show, once.
    pub fn cannot_show(&mut self, spot: &str) {
        if !self.blind_spots.iter().any(|known| known == spot) {
            self.blind_spots.push(spot.to_owned());
        }
    }
}
