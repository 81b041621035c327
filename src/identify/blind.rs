//! Effects and parameters that no fit of these runs can show, each with the experiment that would.

use hydroline_rigs::Dof;

use super::outcome::NotIdentifiable;
use super::parameter::{Coefficient, Term};
use hydroline_core::run::{Channel, Run};

fn spot(what: &str, why: String, experiment: &str) -> NotIdentifiable {
    NotIdentifiable {
        what: what.to_owned(),
        why,
        experiment: experiment.to_owned(),
    }
}

/// Effects and parameters not identifiable from runs fitted in these DOFs, of which some rest and some are restored by weight and
/// water; `undetermined` are the coefficients they do not excite.
pub fn blind_spots(
    runs: &[Run],
    dofs: &[Dof],
    resting: &[Dof],
    undetermined: &[Coefficient],
    restored: &[Dof],
) -> Vec<NotIdentifiable> {
    let mut spots = Vec::new();
    let largest = runs.iter().fold([0.0_f64; 6], |m, r| {
        std::array::from_fn(|i| m[i].max(r.largest_wrench()[i]))
    });
    let commanded = dofs.iter().any(|d| largest[d.index()] > 0.0);
    if commanded {
        spots.push(spot(
            "thrust_scale",
            "a factor on the thrust multiplies mass and damping and leaves the motion as it is".to_owned(),
            "bollard pull: identify --bollard DATA.csv (pulse, thrust), or a run with known ballast",
        ));
    }
    if !restored.is_empty() && !commanded {
        let by = if restored.iter().any(|d| *d != Dof::Heave) {
            "restoring moment r_Bz m g"
        } else {
            "water's stiffness"
        };
        spots.push(spot(
            "restoring_scale",
            format!("without a known load only ratios to the {by} move the hull: all three coefficients scale with it"),
            "inclining test: heel under a known weight, or a run with a known roll or pitch moment",
        ));
    }
    // Roll and pitch have the restoring moment to compare with, a hull that floats its stiffness.
    let scaled = |d: &Dof| largest[d.index()] == 0.0 && !restored.contains(d);
    let free_scale: Vec<&str> = dofs
        .iter()
        .filter(|d| scaled(d) && !resting.contains(d))
        .map(|d| d.name())
        .collect();
    if !free_scale.is_empty() {
        let names = free_scale.join(", ");
        spots.push(spot(
            "mass_scale",
            format!("nothing pushed {names}: a factor on mass and damping together leaves a free motion as it is, only their ratios show"),
            &format!("a run with a known load in {names} (thrusters with a bollard pull, a falling weight), or --fix the added mass; another coast-down shows the same ratios"),
        ));
    }
    let translation = dofs.iter().any(|d| d.index() < 3);
    let velocities = [Channel::U, Channel::V, Channel::W];
    let rated = runs.iter().any(|r| velocities.iter().any(|c| r.has(*c)));
    if translation {
        let why = "a factor on measured positions looks like lighter mass and weaker damping (X_u|u| twice)";
        let rate_words = if rated {
            "; velocities from the same instrument scale along"
        } else {
            ""
        };
        spots.push(spot(
            "position_scale",
            format!("{why}{rate_words}"),
            "move the vehicle by a known distance (gauge blocks, carriage) and compare",
        ));
    }
    for dof in dofs {
        let i = dof.index();
        let loads: Vec<f64> = runs
            .iter()
            .flat_map(|r| r.commands.iter().map(move |c| c.wrench[i]))
            .collect();
        if largest[i] > 0.0 && !(loads.iter().any(|l| *l > 0.0) && loads.iter().any(|l| *l < 0.0)) {
            spots.push(spot(
                "thrust_asymmetry, astern_drag",
                format!("{} was pushed one way only", dof.name()),
                "plan reversals: ahead and astern in turns",
            ));
        }
        let mut sizes: Vec<f64> = loads.iter().map(|l| l.abs()).filter(|l| *l > 0.0).collect();
        sizes.sort_by(f64::total_cmp);
        sizes.dedup_by(|a, b| (*a - *b).abs() < 0.02 * b.abs());
        let coasts = runs.iter().any(|r| {
            r.commands
                .windows(2)
                .any(|w| w[0].wrench[i] != 0.0 && w[1].wrench[i] == 0.0)
        });
        if largest[i] > 0.0 && sizes.len() < 3 && !coasts {
            spots.push(spot(
                "thruster_deadband = constant_force = coulomb_friction = current",
                format!("{} saw {} constant load(s) and never coasted: these effects leave the same residual", dof.name(), sizes.len()),
                "plans coast-down and two-tone",
            ));
        }
    }
    for c in undetermined {
        let experiment = match c.term {
            _ if scaled(&c.dof) => format!("a run with a known load in {}", c.dof.name()),
            Term::Added => format!(
                "a run with quick reversals in {} (plan two-tone, period 3 s)",
                c.dof.name()
            ),
            Term::Linear => format!("a slow run or a coast-down in {}", c.dof.name()),
            Term::Quadratic => format!("a run at twice the load in {}", c.dof.name()),
        };
        spots.push(spot(
            c.key(),
            format!(
                "these runs hardly move it: its sd is above half of its size and of the rig's number ({})",
                c.dof.name()
            ),
            &experiment,
        ));
    }
    spots
}
