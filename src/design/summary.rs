//! Summary of a set of plans, plan by plan.

use nalgebra::DMatrix;

use super::judge::Judge;
use super::pattern::Pattern;
use super::search::{Designed, Set};
use super::sized::Reach;

/// The set of these patterns, in their order.
pub fn set(judge: &Judge<'_>, reach: Reach, patterns: Vec<Pattern>) -> Set {
    let mut sum: Option<DMatrix<f64>> = None;
    let mut plans = Vec::with_capacity(patterns.len());
    for (k, pattern) in patterns.iter().enumerate() {
        let plan = pattern.plan(&format!("design-{}", k + 1));
        let Some(whole) = judge.whole(&plan) else {
            continue;
        };
        let before = sum.clone().unwrap_or_else(|| whole.clone() * 0.0);
        let after = &before + &whole;
        plans.push(Designed {
            gain_nats: judge.value(&after) - judge.value(&before),
            largest: hydroline_plan::size::largest(&plan).unwrap_or_default(),
            sd_alone: judge.sd(&whole),
            sd: judge.sd(&after),
            shows: judge.shown(&whole),
            plan,
        });
        sum = Some(after);
    }
    let (separations, unseen) = sum.map_or_else(Default::default, |sum| {
        (judge.separations(&sum), judge.unseen(&sum))
    });
    Set {
        own: judge.own(),
        reach,
        plans,
        separations,
        asked: judge.asked(),
        unseen,
    }
}
