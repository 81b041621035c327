//! The whole way from runs to parameters with their uncertainty.

use hydroline_core::run::{Channel, Run};
use hydroline_identify::Identification;
use hydroline_identify::blind::blind_spots;
use hydroline_identify::data::{before_the_first_load, is_still, stretched};
use hydroline_identify::parameter::Coefficient;
use hydroline_inference::at_rest::AtRest;
use hydroline_inference::recording::Recording;
use hydroline_rigs::{Dof, Rig};

use super::asked::Asked;
use super::budget::add_budget;
use super::conclude::Concluding;
use super::fitted::fitted;
use super::held_out::cross_validate;
use super::numbers::Numbers;
use super::options::{EstimateError, Options};
use super::repeats::add_repeats;

/// Identifies from runs; runs at rest (no load, >= 20 s, no motion) measure the noise instead. A gap that is longer than
/// the vehicle remembers begins another run.
///
/// # Errors
/// [`EstimateError`].
pub fn identify(
    runs: &[Run],
    rig: &Rig,
    options: &Options<'_>,
) -> Result<Identification, EstimateError> {
    let runs = stretched(runs, rig)?;
    let tolerance = [rig.tolerance.position_m, rig.tolerance.attitude_rad];
    let count = runs.len();
    let (still, moving): (Vec<Run>, Vec<Run>) =
        runs.into_iter().partition(|r| is_still(r, tolerance));
    if moving.is_empty() {
        return Err(match count {
            0 => EstimateError::NoRun,
            n => EstimateError::OnlyStill(n),
        });
    }
    let recording = Recording::new(&moving, rig.tank.start_pose[5]);
    let at_rest = AtRest::of(&still, &moving, rig, &recording);
    let moving = without_openings(moving, tolerance);
    let recording = Recording::new(&moving, rig.tank.start_pose[5]);
    let asked = Asked::of(&moving, rig, &recording, options);
    let body = asked.body(recording, rig, options)?;
    let fitted = fitted(body, at_rest.least(), (rig, &asked.name), options.progress)?;
    (options.progress)("intervals");
    let numbers =
        Numbers::of(&fitted, rig).ok_or_else(|| EstimateError::NoFit(asked.name.clone()))?;
    let concluding = Concluding {
        fitted: &fitted,
        numbers: &numbers,
        asked: &asked,
        at_rest: &at_rest,
        rig,
    };
    let mut result = concluding.result(&moving);
    note_covariances(&moving, &mut result);
    note_rest(&at_rest, &asked.dofs, &mut result);
    if options.budget {
        add_repeats(&mut result, (&fitted, &numbers), &asked);
        (options.progress)("uncertainty budget");
        add_budget(&mut result, (&fitted, &numbers), &asked, (rig, &moving));
    }
    if options.cross_validate && moving.len() > 1 {
        (options.progress)("each run by the others");
        result.cross_validation = cross_validate(&fitted, rig);
        result.fits += result.cross_validation.len();
    }
    let undetermined: Vec<Coefficient> = asked
        .coefficients
        .iter()
        .copied()
        .filter(|c| result.parameters.get(c.key()).is_some_and(|p| !p.excited))
        .collect();
    let restored: Vec<Dof> = asked
        .dofs
        .iter()
        .copied()
        .filter(|d| is_restored(rig, *d))
        .collect();
    result.blind_spots = blind_spots(
        &moving,
        &asked.dofs,
        &asked.resting(),
        &undetermined,
        &restored,
    );
    result.held_effects = rig.physics.iter().map(|p| p.effect.clone()).collect();
    Ok(result)
}

/// Time before a run's first load that is left of a long rest there \[s\].
const LEAD_S: f64 = 2.0;

/// Runs without what measured the noise before their first load, but for its end: it would be counted twice, and hide louder noise
/// in motion.
fn without_openings(moving: Vec<Run>, tolerance: [f64; 2]) -> Vec<Run> {
    let each = moving.into_iter();
    each.map(|r| match before_the_first_load(&r, tolerance) {
        Some((_, load_s)) => r.window(load_s - LEAD_S, f64::INFINITY),
        None => r,
    })
    .collect()
}

/// Whether weight or water bring a DOF back.
fn is_restored(rig: &Rig, dof: Dof) -> bool {
    match dof {
        Dof::Roll | Dof::Pitch => true,
        Dof::Heave => rig.vehicle.stiffness[0] != 0.0,
        Dof::Surge | Dof::Sway | Dof::Yaw => false,
    }
}

/// Says how many samples carry no covariance beside others that do.
fn note_covariances(moving: &[Run], result: &mut Identification) {
    let all = moving.iter().flat_map(|r| &r.samples);
    let (count, known) = all.fold((0usize, 0usize), |(n, k), s| {
        (n + 1, k + usize::from(s.covariance.is_some()))
    });
    if known > 0 && known < count {
        result.notes.push(format!(
            "{} of {count} samples carry no covariance of the pose: they count like the median of the others",
            count - known
        ));
    }
}

/// Says which stretches at rest measured the noise of a channel of these DOFs.
fn note_rest(at_rest: &AtRest, dofs: &[Dof], result: &mut Identification) {
    for r in &at_rest.stretches {
        let mut channels = dofs.iter().flat_map(|d| Channel::of(d.index()));
        let is_used = channels.any(|c| r.measures[c]);
        result.notes.push(format!(
            "{}: at rest for {:.0} s{}, {}",
            r.run,
            r.length_s,
            if r.is_opening {
                " before its first load"
            } else {
                ""
            },
            if is_used {
                "used as the measurement of the noise: the least that it is in motion"
            } else {
                "not used: it measured nothing that these equations are fitted to"
            }
        ));
    }
}
