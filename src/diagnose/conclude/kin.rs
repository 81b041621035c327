//! Far from the noise: kin of what was named that predict as well.

use crate::bank::{joined, without};
use crate::fit::{Fit, Posed};
use crate::posterior::{Fitted, Group};
use crate::predict::held_out;
use crate::search::Search;
use crate::setting::Track;

/// Half chi-square per sample above which no law is exact; noise leaves 0.5.
const INEXACT: f64 = 1.0;
/// rms of the runs held out over the noise above which no law is exact either.
const FAR_OFF: f64 = 2.0;
/// rms of the runs held out over that of the best explanation up to which another is as good.
const AS_GOOD: f64 = 1.1;
/// Most kin told of.
const MOST: usize = 5;

/// Far from the noise likelihoods compare errors of laws, not laws: there a member's kin that
/// predicts the runs held out as well is as good an explanation (the exponent of a damping, say).
pub fn as_good(search: &Search<'_>, group: &Group, held: &[Track]) -> Vec<(&'static str, Group)> {
    let setting = search.setting;
    let fit = &group.fit;
    let noise = search.weights.noise;
    let Some(own) = held_out(setting, held, fit, noise) else {
        return Vec::new();
    };
    let near = fit.cost < INEXACT * search.weights.samples() as f64;
    if near && own < FAR_OFF * noise.total_sd() {
        return Vec::new();
    }
    let mut found = Vec::new();
    for (member, candidate) in fit.set.iter().enumerate() {
        if !group.matters.contains(candidate) {
            continue;
        }
        let info = setting.vocabulary[*candidate].info;
        let (smaller, at) = without(setting, fit, member);
        let gap = Fit {
            set: smaller,
            at,
            ..fit.clone()
        };
        for (other, kin) in setting.vocabulary.iter().enumerate() {
            let named = info.kin.contains(&kin.info.id) && kin.info.stage == info.stage;
            if !named || fit.set.contains(&other) || search.blind.contains(&other) {
                continue;
            }
            let made = kin
                .starts
                .iter()
                .filter_map(|point| {
                    let (set, from) = joined(setting, &gap, other, point);
                    Posed::new(setting, &search.weights, &set).fit(from).ok()
                })
                .min_by(|a, b| a.cost.total_cmp(&b.cost));
            let Some(made) = made.filter(|f| f.confounded(setting).is_empty()) else {
                continue;
            };
            if let Some(rms) =
                held_out(setting, held, &made, noise).filter(|rms| *rms < AS_GOOD * own)
            {
                let matters = group
                    .matters
                    .iter()
                    .map(|c| if c == candidate { other } else { *c })
                    .collect();
                let group = Group {
                    matters,
                    fit: made,
                    probability: 0.0,
                    told: 0.0,
                    fitted: Fitted::default(),
                };
                found.push((rms, (kin.info.id, group)));
            }
        }
    }
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    found.truncate(MOST);
    found.into_iter().map(|f| f.1).collect()
}
