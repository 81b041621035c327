//! Numbers that a fit takes as known by the rig: thrust, mass and inertia, buoyancy, hydrostatics, coefficients that were fixed.

use hydroline_core::run::PerChannel;
use hydroline_inference::body::Body;
use hydroline_rigs::{Dof, Rig};

use crate::asked::Asked;
use crate::fitted::Fitted;

/// sd of the thrust's scale where neither a bollard pull nor the rig says it: what makers' curves are worth.
const THRUST_SCALE_SD: f64 = 0.05;
/// sd of the mass, as a share: a vehicle on a crane balance, with what water its frame holds.
const MASS_SHARE: f64 = 0.01;
/// sd of a moment of inertia, of the centre of buoyancy and of hydrostatics, as a share: mostly computed from a drawing.
const COMPUTED_SHARE: f64 = 0.05;
/// Share of a number by which derivatives are taken.
const STEP: f64 = 1e-3;

/// Motion that one sd of a consider parameter makes, per run and sample.
pub(super) type Moved = Vec<Vec<PerChannel<f64>>>;

/// A number that the fit takes as known.
pub(super) struct Consider {
    pub source: String,
    /// sd in the unit; `None` = in units of what is typical.
    pub sd: Option<f64>,
    pub unit: &'static str,
    pub basis: String,
    pub reduce: String,
    pub moved: Moved,
    /// Of an effect, whose amplitude is in typical sizes and of which the runs say something: log prior odds that it acts.
    pub prior_ln_odds: Option<f64>,
}

/// Sources of a fit's budget.
pub(super) struct Sources<'a> {
    pub fitted: &'a Fitted,
    pub rig: &'a Rig,
    /// The covariance of a bollard pull is added by who has the runs' pulses: no other sd of the thrust counts.
    pub has_measured_curve: bool,
}

impl Sources<'_> {
    pub fn all(&self, asked: &Asked) -> Vec<Consider> {
        let mut all = self.of_the_rig();
        all.extend(self.fixed(asked));
        all.extend(self.of_the_poses());
        all.extend(self.unseen());
        all
    }

    pub fn body(&self) -> &Body {
        &self.fitted.problem.body
    }

    pub fn base(&self) -> Moved {
        let Fitted { problem, fit, .. } = self.fitted;
        problem.predicted(&[], &fit.point)
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
                prior_ln_odds: None,
            });
        };
        let commands = self.body().recording.runs.iter().flat_map(|r| &r.commands);
        let commanded = commands.into_iter().any(|c| c.1.iter().any(|w| *w != 0.0));
        if commanded && !self.has_measured_curve {
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
        // Roll and pitch are restored by the weight.
        let is_restored = vehicle.r_bz_m != 0.0 && dofs.iter().any(|d| matches!(d, 3 | 4));
        if is_restored || dofs.iter().any(|d| *d < 3) {
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
        if is_restored {
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
                prior_ln_odds: None,
            })
        };
        asked.fixed.iter().filter_map(|c| of(*c)).collect()
    }
}

/// Difference of two motions, times a factor.
pub(super) fn minus(moved: &Moved, base: &Moved, by: f64) -> Moved {
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
