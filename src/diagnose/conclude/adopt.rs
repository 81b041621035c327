//! The explanation into a rig.

use hydroline_rigs::{ParameterValue, PhysicsEntry, Rig};
use hydroline_sim::effect::ALL;

use crate::fit::Fit;
use crate::setting::{COEFFICIENTS, Setting};
use crate::verdict::Effect;
use hydroline_identify::parameter::Coefficient;

/// Puts the explanation into a rig.
pub fn adopt(rig: &mut Rig, setting: &Setting, fit: &Fit, effects: &[Effect]) {
    for (c, value) in Coefficient::of(setting.dof)
        .iter()
        .zip(&fit.at[..COEFFICIENTS])
    {
        c.put(&mut rig.vehicle, *value);
    }
    // The set's own fit, not the average over sets: coefficients and effects belong together.
    let fitted = |name: &str, e: &Effect| -> Option<f64> {
        let member = fit
            .set
            .iter()
            .position(|c| setting.vocabulary[*c].info.id == e.effect)?;
        let i = setting.vocabulary[fit.set[member]]
            .info
            .parameter_index(name)?;
        Some(fit.member(setting, member)[i])
    };
    for e in effects {
        let mut parameters: Vec<(String, ParameterValue)> = e
            .words
            .iter()
            .map(|(n, w)| (n.clone(), ParameterValue::Word(w.clone())))
            .collect();
        if let Some(info) = ALL.iter().find(|i| i.id == e.effect) {
            for p in info.parameters {
                if let Some(v) = fitted(p.name, e) {
                    parameters.push((p.name.to_owned(), ParameterValue::Number(v)));
                }
            }
        }
        let entry = PhysicsEntry {
            effect: e.effect.clone(),
            parameters,
        };
        if !rig.physics.iter().any(|o| o.effect == entry.effect) {
            rig.physics.push(entry);
        }
    }
}
