//! Inputs that were not explained but drove the rest: DOFs that moved as they were measured, and companions.

use hydroline_core::run::{COMPANIONS, Channel};
use hydroline_inference::body::Body;
use hydroline_rigs::Dof;

use crate::verdict::Unexplained;

/// Companions that move a hull by themselves.
const FINS: [usize; 2] = [0, 1];

pub struct Inputs<'a> {
    body: &'a Body,
    /// DOFs that the user said are inputs.
    asked: &'a [usize],
    companions: [bool; COMPANIONS.len()],
}

impl Inputs<'_> {
    pub fn new<'a>(body: &'a Body, asked: &'a [usize]) -> Inputs<'a> {
        Inputs {
            companions: body.recording.companions_moving(),
            body,
            asked,
        }
    }

    /// DOFs whose motion is given, by name.
    pub fn names(&self) -> Vec<String> {
        let each = self.body.given.iter().map(|d| Dof::ALL[*d].name());
        each.map(str::to_owned).collect()
    }

    /// Cause of a given DOF's motion, in words; `None` = nobody knows.
    fn cause(&self, dof: usize) -> Option<String> {
        if self.asked.contains(&dof) {
            return Some("as asked".to_owned());
        }
        let fin = FINS.into_iter().find(|c| self.companions[*c])?;
        Some(format!("{} is measured and moves it", COMPANIONS[fin]))
    }

    /// DOFs that move although nothing is known to move them: never passed over.
    pub fn unexplained(&self) -> Vec<Unexplained> {
        let nobody = self.body.given.iter().filter(|d| self.cause(**d).is_none());
        nobody
            .map(|d| {
                let channel = self.body.recording.channel_of(*d);
                let moves = self.extent(channel);
                Unexplained {
                    channel: channel.name().to_owned(),
                    weight: Some(moves),
                    term: format!(
                        "{} moves ({} by {moves:.3} rms) though nothing commanded it, and no model follows: its measured motion was taken as given (--given {} says that it is an input)",
                        Dof::ALL[*d].name(),
                        channel.name(),
                        Dof::ALL[*d].name()
                    ),
                    ..Unexplained::default()
                }
            })
            .collect()
    }

    /// rms of a channel about its mean, the largest of all runs \[SI\].
    fn extent(&self, channel: Channel) -> f64 {
        let runs = self.body.recording.runs.iter().map(|r| {
            let seen: Vec<f64> = r.seen(channel).collect();
            let n = seen.len().max(1) as f64;
            let mean = seen.iter().sum::<f64>() / n;
            (seen.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt()
        });
        runs.fold(0.0, f64::max)
    }

    pub fn notes(&self) -> Vec<String> {
        let mut notes: Vec<String> = self
            .body
            .given
            .iter()
            .map(|d| {
                let why = self.cause(*d);
                let why = why.as_deref().unwrap_or("nothing is known to move it");
                let name = Dof::ALL[*d].name();
                format!(
                    "{name} moves as measured and drives the others, itself unexplained ({why})"
                )
            })
            .collect();
        for d in (0..6).filter(|d| !self.body.given.contains(d)) {
            let steady = |i: &Option<hydroline_sim::Given>| {
                let rate = i.as_ref()?.rates[d].as_ref()?;
                Some(rate.at(0.0))
            };
            let rates: Vec<String> = self
                .body
                .inputs
                .iter()
                .map(|i| steady(i).map_or_else(|| "0".to_owned(), |v| format!("{v:.4}")))
                .collect();
            if rates.iter().any(|r| r != "0") {
                notes.push(format!(
                    "{} is steady and given: {} {} by run",
                    Channel::RATES[d].name(),
                    rates.join(", "),
                    Channel::RATES[d].unit()
                ));
            }
        }
        notes
    }
}
