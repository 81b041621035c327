//! Which degrees of freedom are asked.

use hydroline_rigs::{Dof, Rig};

use crate::setting::Track;
use hydroline_identify::data::Run;
use hydroline_numerics::statistics::difference_sd;

/// Motion below this many noise sd is rest.
const AT_REST_SD: f64 = 8.0;

/// DOFs that are driven, or without any command move.
pub fn active(runs: &[Run], rig: &Rig) -> Vec<Dof> {
    let largest = runs.iter().fold([0.0_f64; 6], |m, r| {
        let w = r.largest_wrench();
        std::array::from_fn(|i| m[i].max(w[i]))
    });
    let top = largest.iter().copied().fold(0.0, f64::max);
    let mut found: Vec<(f64, Dof)> = Dof::ALL
        .into_iter()
        .filter_map(|dof| {
            let i = dof.index();
            let unit = if i < 3 {
                rig.tolerance.position_m
            } else {
                rig.tolerance.attitude_rad
            };
            let moved = runs
                .iter()
                .filter_map(|r| Track::of(r, dof))
                .map(|t| {
                    let sd = difference_sd(&t.measured);
                    let (low, high) = t
                        .measured
                        .iter()
                        .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| {
                            (l.min(*v), h.max(*v))
                        });
                    if high - low > 2.0 * AT_REST_SD * sd {
                        (high - low) / unit
                    } else {
                        0.0
                    }
                })
                .fold(0.0, f64::max);
            let driven = largest[i] > 0.01 * top && top > 0.0;
            (moved > 3.0 && (driven || top == 0.0)).then_some((moved, dof))
        })
        .collect();
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    if top == 0.0 {
        found.truncate(1);
    }
    found.into_iter().map(|f| f.1).collect()
}
