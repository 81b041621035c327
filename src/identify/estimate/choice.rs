//! Choice of the equations that these runs call for, and of the coefficients that are free.

use super::{ModelChoice, Options};
use crate::parameter::Coefficient;
use hydroline_core::run::{Channel, Run};
use hydroline_numerics::statistics::{difference_sd, extent, median, robust_sd};
use hydroline_rigs::{Dof, Rig, VehicleModel};

/// One DOF if only one is driven; without commands the one that moves most for its noise.
pub(super) fn choose(runs: &[Run], rig: &Rig) -> ModelChoice {
    let driven: Vec<Dof> = Dof::ALL
        .into_iter()
        .filter(|d| {
            let all = runs.iter().fold([0.0_f64; 6], |m, r| {
                std::array::from_fn(|i| m[i].max(r.largest_wrench()[i]))
            });
            // Rounding of pulses leaves traces in the other components.
            all[d.index()] > 0.01 * all.iter().copied().fold(0.0, f64::max)
        })
        .collect();
    match driven.as_slice() {
        [one] => ModelChoice::Axis(*one),
        [] => {
            let moved = |i: usize| -> f64 {
                runs.iter()
                    .map(|r| {
                        let measured = r.measured(measured_by(r, i));
                        let (low, high) = extent(measured.clone());
                        if measured.count() > 8 {
                            (high - low) / rig.tolerance.channels()[Channel::POSES[i]]
                        } else {
                            0.0
                        }
                    })
                    .fold(0.0, f64::max)
            };
            let best = Dof::ALL
                .into_iter()
                .max_by(|a, b| moved(a.index()).total_cmp(&moved(b.index())));
            ModelChoice::Axis(best.unwrap_or(Dof::Surge))
        }
        _ => ModelChoice::Coupled,
    }
}

/// Coefficients that are free, the DOFs they belong to, and the model's name.
pub(super) fn what_is_free(
    choice: ModelChoice,
    runs: &[Run],
    rig: &Rig,
    options: &Options<'_>,
) -> (Vec<Coefficient>, Vec<Dof>, String) {
    let dofs: Vec<Dof> = match choice {
        ModelChoice::Axis(dof) => vec![dof],
        _ => Dof::ALL
            .into_iter()
            .filter(|d| {
                let any = |c: &Channel| runs.iter().any(|r| r.has(*c));
                Channel::of(d.index()).iter().any(any)
            })
            .collect(),
    };
    let name = match choice {
        ModelChoice::Axis(dof) => dof.name().to_owned(),
        _ if rig.vehicle.model == VehicleModel::Eq1 => "eq1".to_owned(),
        _ => "decoupled".to_owned(),
    };
    let all = dofs
        .iter()
        .flat_map(|d| Coefficient::of(*d))
        .filter(|c| !options.fixed.contains(c))
        .collect();
    (all, dofs, name)
}

/// Whether a DOF neither is driven nor moves in any run beyond its noise: sinusoids fitted to noise
/// would pass for a well determined period. Slow noise may be three times what differences show.
pub(super) fn rests(runs: &[Run], dof: Dof) -> bool {
    let i = dof.index();
    runs.iter().all(|r| {
        let quiet = |channel: Channel| {
            let values: Vec<f64> = r.measured(channel).collect();
            let middle = median(&mut values.clone()).unwrap_or(0.0);
            let away: Vec<f64> = values.iter().map(|v| v - middle).collect();
            values.is_empty() || robust_sd(&away) < 3.0 * difference_sd(&values)
        };
        r.largest_wrench()[i] == 0.0 && Channel::of(i).into_iter().all(quiet)
    })
}

/// The channel that shows how a DOF moved: its position or angle, else its rate (over a second).
fn measured_by(run: &Run, dof: usize) -> Channel {
    let [place, rate] = Channel::of(dof);
    if run.has(place) { place } else { rate }
}
