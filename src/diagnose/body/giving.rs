//! Choice of the DOFs that are explained and of those that are inputs.
//!
//! A DOF that moves although no run commanded it, and that no model follows, drives the others as it was measured. What
//! couples to it looks no better at first: each one given up is asked once more beside the others, and explained where the
//! vehicle alone follows it then.

use hydroline_core::run::{PerChannel, Run};
use hydroline_inference::body::Body;
use hydroline_inference::fit::Problem;
use hydroline_inference::limit::Watch;
use hydroline_inference::prior::PriorTable;
use hydroline_inference::recording::Recording;
use hydroline_inference::search::{Found, Options, search};
use hydroline_numerics::noise::Noise;
use hydroline_rigs::{Dof, Rig};

use crate::conclude::DiagnoseError;

/// Runs, rig, progress and limit that every search is given.
pub struct Asking<'a> {
    pub runs: &'a [Run],
    /// Noise of each channel at rest: the least that it has in motion.
    pub at_rest: PerChannel<Option<Noise>>,
    pub rig: &'a Rig,
    pub watch: Watch<'a>,
}

impl Asking<'_> {
    fn search(
        &self,
        dofs: &[usize],
        given: &[usize],
        options: Options,
    ) -> Result<Found, DiagnoseError> {
        self.watch.tell("noise");
        let prior = PriorTable::default();
        let recording = Recording::new(self.runs, self.rig.tank.start_pose[5]);
        let body = Body::new(recording, self.rig, dofs, given, prior)?;
        let problem = Problem::of(body, self.at_rest);
        let first = dofs.first().map_or("surge", |d| Dof::ALL[*d].name());
        search(problem, options, self.watch).ok_or(DiagnoseError::NoFit { dof: first })
    }

    /// Searches the models of what moves; `given` are inputs from the beginning.
    ///
    /// # Errors
    /// [`DiagnoseError`].
    pub fn explained(
        &self,
        recording: &Recording,
        dofs: &[usize],
        given: &[usize],
    ) -> Result<Found, DiagnoseError> {
        let driven = recording.driven();
        let options = Options {
            may_give_up: std::array::from_fn(|d| !driven.contains(&d)),
            ..Options::default()
        };
        let mut found = self.search(dofs, given, options)?;
        if found.given_up.is_empty() {
            return Ok(found);
        }
        let names: Vec<&str> = found.given_up.iter().map(|d| Dof::ALL[*d].name()).collect();
        let what = format!(
            "the other DOFs with the motion of {} given",
            names.join(", ")
        );
        let given_up = found.given_up.clone();
        let without = |all: &[usize], out: &[usize]| -> Vec<usize> {
            all.iter().copied().filter(|d| !out.contains(d)).collect()
        };
        let mut inputs: Vec<usize> = [given, &given_up].concat();
        for d in &given_up {
            if inputs.len() == given.len() + 1 {
                break;
            }
            let others = without(&inputs, &[*d]);
            let asked = without(dofs, &others);
            let only = Options { cost: 0, ..options };
            if self.leaves_open(&mut found, &what) {
                return Ok(found);
            }
            // A model that gives no finite motion does not follow the DOF.
            let again = self.search(&asked, &others, only);
            if self.leaves_open(&mut found, &what) {
                return Ok(found);
            }
            if again.is_ok_and(|found| !found.given_up.contains(d)) {
                inputs = others;
            }
        }
        inputs.sort_unstable();
        if self.leaves_open(&mut found, &what) {
            return Ok(found);
        }
        self.search(&without(dofs, &inputs), &inputs, Options::default())
    }

    /// Whether the searches end with what the first one found, since the limit is over.
    fn leaves_open(&self, found: &mut Found, what: &str) -> bool {
        found.account.leaves_open(self.watch.limit, what)
    }
}
