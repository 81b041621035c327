//! Which of several places on the target a frame shows.

use super::super::photometric::{
    Choice, EdgeModelError, PARAMETERS, Picture, Plan, RunParameters, State, TONE, Weighting,
};
use super::lm_loop::{Convergence, first_step, plausible};
use super::solve::{equations, in_si};
use super::weak_direction::WeakDirection;
use super::{PoseCaveat, PoseFitter};
use hydroline_stripe::Profile;

/// Cost by which the best guess must beat a different one: log-likelihood ratio.
const CLEAR_COST: f64 = 12.0;
/// Places are distinguished, and a pose is first fitted, on some of the columns.
const TO_CHOOSE: Choice = Choice {
    step: 7,
    keep: 3,
    room_m: 0.003,
};
/// Upper faces far apart in height offer many places that differ little.
const TO_CHOOSE_TALL: Choice = Choice {
    step: 3,
    keep: 4,
    room_m: 0.003,
};
/// Poses that differ by more than this are two places \[m\].
const ELSEWHERE_M: f64 = 0.002;
/// A start whose cost is this many times the best one's is none.
const BEHIND: f64 = 3.0;

impl PoseFitter {
    /// A few steps of the fit from every start: the places that they come to, the likeliest first.
    pub(super) fn choose(
        &self,
        picture: &Picture<'_>,
        profile: &Profile,
        starts: Vec<State>,
        free: &[bool; PARAMETERS],
        caveats: &mut Vec<PoseCaveat>,
    ) -> Vec<State> {
        if starts.len() < 2 {
            return starts;
        }
        let weighting = Weighting {
            noise_sd: profile.noise_sd.max(1.0),
            cut: 8.0,
            redescending: true,
            response: self.response(picture.ceiling),
            run_parameters: RunParameters::Known,
            even: true,
        };
        // θ is fitted later, and does not distinguish flanks; unless the upper faces are so far apart in
        // height that a degree moves their edges by millimetres against each other.
        let tall = self.tall();
        let mut held = *free;
        held[4] = free[4] && tall;
        held[TONE..].fill(false);
        let (choice, tries) = if tall {
            (TO_CHOOSE_TALL, (6, Convergence::All(4e-4)))
        } else {
            (TO_CHOOSE, (2, Convergence::All(0.04)))
        };
        let huber = Weighting {
            cut: 4.0,
            redescending: false,
            ..weighting
        };
        // A start is judged by the cost that it would come down to if the light were linear in what
        // is free: half the gradient's way (Gauss–Newton) below its own.
        let judged = |start: State| {
            let plan = self.model.plan(&start, choice);
            let none = &mut EdgeModelError::default();
            let mut sums = self
                .model
                .compare(&plan, picture, &start, &huber, none, true);
            self.add_priors(&mut sums, &start);
            let weak_direction = WeakDirection::new(&start.pose, &self.mounts);
            let equations = equations(&sums, &weak_direction);
            let step = first_step(&equations, &held);
            let gain = step.map_or(0.0, |s| -0.5 * s.dot(&equations.gradient));
            // The way there is known: it need not be found again, unless it is far.
            let next = step.map_or(start, |s| weak_direction.moved(&start, &in_si(&s)));
            let near = plausible(&next) && self.shift_m(&start.pose, &next.pose) <= choice.room_m;
            let start = if near { next } else { start };
            let least = 0.1 * sums.cost;
            let pixels = sums.tally.pixels.max(1) as f64;
            ((sums.cost - gain).max(least) / pixels, start, plan)
        };
        let mut first: Vec<(f64, State, Plan)> = starts.into_iter().map(judged).collect();
        first.sort_by(|a, b| a.0.total_cmp(&b.0));
        // Near a corner of the hexagons the steps are off by up to a millimetre and so are all
        // guesses: those that do not fall far behind make a few steps before they are compared.
        let limit = first.first().map_or(0.0, |f| BEHIND * f.0);
        first.retain(|f| f.0 <= limit);
        if let [(_, only, _)] = first.as_slice() {
            return vec![*only];
        }
        let mut tried: Vec<(f64, State, f64)> = first
            .into_iter()
            .filter_map(|(_, start, plan)| {
                let none = &mut EdgeModelError::default();
                let (state, _) = self.converge(
                    &self.model,
                    &plan,
                    picture,
                    start,
                    &held,
                    &huber,
                    none,
                    tries,
                )?;
                let sums = self
                    .model
                    .compare(&plan, picture, &state, &weighting, none, false);
                let pixels = sums.tally.pixels.max(1) as f64;
                Some((sums.cost / pixels, state, pixels))
            })
            .collect();
        tried.sort_by(|a, b| a.0.total_cmp(&b.0));
        // Several guesses may have come to the same place: the rival is the best of another one.
        if let Some((best, rest)) = tried.split_first() {
            let elsewhere =
                |t: &&(f64, State, f64)| (best.1.pose.x_m - t.1.pose.x_m).abs() > ELSEWHERE_M;
            let rival = rest.iter().find(elsewhere);
            if rival
                .is_some_and(|next| (next.0 - best.0) * best.2 * (choice.step as f64) < CLEAR_COST)
            {
                caveats.push(PoseCaveat::Ambiguous);
            }
        }
        let mut places: Vec<State> = Vec::new();
        for (_, state, _) in &tried {
            let new = |p: &State| self.shift_m(&p.pose, &state.pose) > ELSEWHERE_M;
            if places.iter().all(new) {
                places.push(*state);
            }
        }
        places
    }
}
