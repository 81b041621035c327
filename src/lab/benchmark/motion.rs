//! The true motion: surge of the whole six-DOF model with its effects, plus a law the model has not.
//!
//! RK4 (the paper's integrator) on steps of at most 10 ms, split at every command edge, at every
//! jump of a law and at every instant that a stamp shows.

use hydroline_rigs::{PhysicsEntry, Vehicle, VehicleModel};
use hydroline_sim::EffectStack;
use hydroline_sim::model::{Model, ModelState};
use hydroline_sim::vehicle::Hydrodynamics;

use super::error::ProveError;
use super::external_law::{ExternalLaw, Here};

/// Longest step \[s\]: lags of 50 ms and friction of 0.5 N at 4 mm/s are far inside RK4's region.
const STEP_MAX_S: f64 = 0.01;

/// Vehicle that moves, with its effects and start.
#[derive(Debug, Clone, Copy)]
pub struct Mover<'a> {
    /// Its coefficients.
    pub vehicle: &'a Vehicle,
    /// Effects of the library.
    pub entries: &'a [PhysicsEntry],
    /// A law outside of it.
    pub external_law: Option<&'a ExternalLaw>,
    /// Pose at rest at t = 0.
    pub start: [f64; 6],
}

#[derive(Clone, Copy)]
struct State {
    model: ModelState,
    own: [f64; 2],
}

impl Mover<'_> {
    /// x as an instrument reports it at each stamp \[m\]; `edges` = (time, surge load \[N\]), ascending.
    ///
    /// # Errors
    /// [`ProveError::Effect`], [`ProveError::Diverged`].
    pub fn positions(
        &self,
        run: usize,
        edges: &[(f64, f64)],
        stamps_s: &[f64],
    ) -> Result<Vec<f64>, ProveError> {
        let mut vehicle = self.vehicle.clone();
        // Surge alone is driven: the Coriolis terms are zero.
        vehicle.model = VehicleModel::Decoupled;
        let model = Model {
            hydrodynamics: Hydrodynamics::new(&vehicle),
            effects: EffectStack::build(self.entries)?,
        };
        let delay_s = model.effects.command_delay_s();
        let mut jumps: Vec<(f64, Option<f64>)> = edges
            .iter()
            .map(|(t, load)| ((t + delay_s).max(0.0), Some(*load)))
            .collect();
        jumps.extend(model.effects.time_edges_s().into_iter().map(|t| (t, None)));
        if let Some(s) = self.external_law {
            jumps.extend(s.jumps_s(run).into_iter().map(|t| (t, None)));
        }
        jumps.retain(|j| j.0 >= 0.0);
        jumps.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut jumps = jumps.into_iter().peekable();
        let mut state = State {
            model: ModelState::at_rest(self.start),
            own: [0.0; 2],
        };
        let (mut now_s, mut load_n) = (0.0, 0.0);
        let mut shown = Vec::with_capacity(stamps_s.len());
        for stamp_s in stamps_s {
            let seen_s = model.effects.scene_time_s(*stamp_s, 0.0);
            while let Some((t_s, new)) = jumps.next_if(|j| j.0 <= seen_s) {
                state = self.advance(&model, run, state, now_s, t_s, load_n);
                now_s = t_s;
                load_n = new.unwrap_or(load_n);
            }
            if seen_s > now_s {
                state = self.advance(&model, run, state, now_s, seen_s, load_n);
                now_s = seen_s;
            }
            let seen = model.effects.scene_pose(seen_s, state.model.vehicle.eta);
            let x = model.effects.reported_pose(seen_s, seen)[0];
            if !x.is_finite() {
                return Err(ProveError::Diverged { t_s: seen_s });
            }
            shown.push(x);
        }
        Ok(shown)
    }

    fn advance(
        &self,
        model: &Model,
        run: usize,
        mut state: State,
        from_s: f64,
        to_s: f64,
        load_n: f64,
    ) -> State {
        let count = ((to_s - from_s) / STEP_MAX_S - 1e-9).ceil().max(1.0);
        let step = (to_s - from_s) / count;
        for k in 0..count as usize {
            let t = from_s + step * k as f64;
            // A law that jumps in time is asked inside of the step, never at its ends.
            let inside = |share: f64| t + step * share.clamp(1e-6, 1.0 - 1e-6);
            let rate = |share: f64, s: &State| self.rate(model, run, inside(share), t, s, load_n);
            let k1 = rate(0.0, &state);
            let k2 = rate(0.5, &stepped(&state, &k1, 0.5 * step));
            let k3 = rate(0.5, &stepped(&state, &k2, 0.5 * step));
            let k4 = rate(1.0, &stepped(&state, &k3, step));
            for (r, share) in [(k1, 1.0), (k2, 2.0), (k3, 2.0), (k4, 1.0)] {
                state = stepped(&state, &r, share * step / 6.0);
            }
        }
        state
    }

    fn rate(
        &self,
        model: &Model,
        run: usize,
        t_s: f64,
        begin_s: f64,
        state: &State,
        load_n: f64,
    ) -> State {
        let mut own = [0.0; 2];
        let mut load = load_n;
        let mut force = 0.0;
        if let Some(law) = self.external_law {
            let here = Here {
                t_s,
                x_m: state.model.vehicle.eta[0],
                u_mps: state.model.vehicle.nu[0],
                drag: [
                    model.hydrodynamics.linear[0],
                    model.hydrodynamics.quadratic[0],
                ],
                run,
                load_n,
            };
            load = law.thrust(&here, &state.own, &mut own);
            force = law.force(&here);
        }
        let wrench = [load, 0.0, 0.0, 0.0, 0.0, 0.0];
        let mut rate = model.rate(t_s, begin_s, &state.model, &wrench);
        rate.vehicle.nu[0] += force / model.hydrodynamics.mass()[0];
        State { model: rate, own }
    }
}

fn stepped(state: &State, rate: &State, step: f64) -> State {
    let mut next = *state;
    for i in 0..6 {
        next.model.vehicle.eta[i] += step * rate.model.vehicle.eta[i];
        next.model.vehicle.nu[i] += step * rate.model.vehicle.nu[i];
    }
    for (a, b) in next.model.own.iter_mut().zip(&rate.model.own) {
        *a += step * b;
    }
    for (a, b) in next.own.iter_mut().zip(&rate.own) {
        *a += step * b;
    }
    next
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::benchmark::magnitudes;
    use hydroline_rigs::Rig;
    use hydroline_sim::model::ModelState;
    use hydroline_sim::trajectory::Trajectory;
    use rand::{SeedableRng, rngs::StdRng};

    /// This integrator and the simulator's own agree for every effect that a case may hold.
    #[test]
    fn the_motion_is_the_simulators() {
        let rig = Rig::builtin("lshpi").unwrap();
        let edges = [(0.0, 8.0), (3.017, -6.0), (6.0, 0.0)];
        let stamps: Vec<f64> = (0..250).map(|k| 0.006 + 0.04 * f64::from(k)).collect();
        let mut rng = StdRng::seed_from_u64(3);
        for id in magnitudes::EFFECTS {
            let entries = [magnitudes::entry(id, 0.6, 8.0, &mut rng).unwrap()];
            let mover = Mover {
                vehicle: &rig.vehicle,
                entries: &entries,
                external_law: None,
                start: rig.tank.start_pose,
            };
            let ours = mover.positions(0, &edges, &stamps).unwrap();
            let mut with = rig.clone();
            with.physics = entries.to_vec();
            let start = ModelState::at_rest(rig.tank.start_pose);
            let mut path = Trajectory::new(Model::from_rig(&with).unwrap(), start, 0.005).unwrap();
            for (t, x) in edges {
                path.command(t, [x, 0.0, 0.0, 0.0, 0.0, 0.0]).unwrap();
            }
            for (t, x) in stamps.iter().zip(&ours) {
                let seen = path.model().effects.scene_time_s(*t, 0.0);
                let theirs = path.state_at(seen).unwrap().vehicle.eta[0];
                assert!((x - theirs).abs() < 2e-6, "{id} at {t}: {x} {theirs}");
            }
        }
    }
}
