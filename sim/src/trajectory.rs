//! Integration along time: RK4 on a fixed grid, every step split at every edge.
//!
//! A step that spans a command edge is only first order, and its derivative with respect
//! to a delay is zero, so that a fit never moves (theory/physics.md, integration). Here an edge is a node of
//! its own; with a dual `T` the edge's time carries its derivative through the step's length.
//!
//! Nodes (grid points and edges) depend on the commands alone. A query takes a partial step
//! from the last node and commits nothing: asking often or seldom changes no bit. A command
//! that arrives late rolls back to the node before it.

use std::collections::VecDeque;

use crate::given::Given;
use crate::model::{Model, ModelState};
use crate::real::Real;
use crate::vehicle::VehicleState;

/// Default grid \[s\]: 1/5 of the shortest lag allowed is not needed, RK4 at 5 ms is exact to ~1e-10 m here.
pub const GRID_STEP_S: f64 = 0.005;
/// Nodes kept for late commands and for looking back (camera latency): 10 s of grid and more.
const NODES_KEPT: usize = 4096;

/// Error along a trajectory.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum TrajectoryError {
    #[error("{what} is {value}; it must be finite")]
    NotFinite { what: &'static str, value: f64 },
    #[error(
        "{what} at {t_s:.3} s lies before the oldest kept state at {oldest_s:.3} s; ask or command in (roughly) increasing time"
    )]
    TooOld {
        /// `query` or `command`.
        what: &'static str,
        t_s: f64,
        oldest_s: f64,
    },
    #[error(
        "the simulated state is not finite at t = {t_s:.3} s (theta was {theta_rad:.3} rad before): check coefficients (all negative), effects and loads; Euler angles end at +-pi/2"
    )]
    Diverged { t_s: f64, theta_rad: f64 },
    #[error("integration step {step_s} s; it must lie in 1e-5 .. 0.1 s")]
    Step { step_s: f64 },
}

#[derive(Debug, Clone, Copy)]
struct Edge<T> {
    t_s: T,
    /// `None`: an effect's own discontinuity, the command goes on.
    command: Option<[T; 6]>,
}

#[derive(Debug, Clone, Copy)]
struct Node<T> {
    t_s: T,
    state: ModelState<T>,
    command: [T; 6],
    /// Edges already behind this node.
    edges_done: usize,
    /// Grid points already behind this node: the next is `grid_done + 1` steps from 0.
    grid_done: u64,
}

/// A trajectory from rest at t = 0, growing with its commands.
#[derive(Debug)]
pub struct Trajectory<T: Real = f64> {
    model: Model<T>,
    step_s: f64,
    edges: Vec<Edge<T>>,
    nodes: VecDeque<Node<T>>,
    delay_s: T,
    given: Option<Given>,
}

impl<T: Real> Trajectory<T> {
    /// Starts from `initial` at t = 0 with no command; grid in 1e-5 .. 0.1 s.
    ///
    /// # Errors
    /// [`TrajectoryError::Step`], [`TrajectoryError::NotFinite`].
    pub fn new(
        model: Model<T>,
        initial: ModelState<T>,
        step_s: f64,
    ) -> Result<Self, TrajectoryError> {
        if !(1e-5..=0.1).contains(&step_s) {
            return Err(TrajectoryError::Step { step_s });
        }
        if let Some(bad) = initial
            .vehicle
            .eta
            .iter()
            .chain(&initial.vehicle.nu)
            .find(|v| !v.value().is_finite())
        {
            return Err(TrajectoryError::NotFinite {
                what: "start state",
                value: bad.value(),
            });
        }
        let mut edges: Vec<Edge<T>> = model
            .effects
            .time_edges_s()
            .into_iter()
            .map(|t_s| Edge { t_s, command: None })
            .collect();
        edges.sort_by(|a, b| a.t_s.value().total_cmp(&b.t_s.value()));
        let first = Node {
            t_s: T::zero(),
            state: initial,
            command: [T::zero(); 6],
            edges_done: edges.partition_point(|e| e.t_s.value() < 0.0),
            grid_done: 0,
        };
        let delay_s = model.effects.command_delay_s();
        Ok(Trajectory {
            model,
            step_s,
            edges,
            nodes: VecDeque::from([first]),
            delay_s,
            given: None,
        })
    }

    /// The same beside DOFs and companions that are given instead of simulated, from its start on.
    #[must_use]
    pub fn beside(mut self, given: Given) -> Self {
        self.given = Some(given);
        self
    }

    /// The model that moves.
    pub fn model(&self) -> &Model<T> {
        &self.model
    }

    /// A body wrench \[N, N m\] stamped `t_s`; acts from `t_s` + command latency until the next one.
    ///
    /// Among equal times the last one appended holds.
    ///
    /// # Errors
    /// [`TrajectoryError::TooOld`] beyond the kept history, [`TrajectoryError::NotFinite`].
    pub fn command(&mut self, t_s: T, wrench: [T; 6]) -> Result<(), TrajectoryError> {
        finite("command time", t_s.value())?;
        for load in wrench {
            finite("commanded load", load.value())?;
        }
        // A command of before the run is the one in force at its start.
        let acts_s = (t_s + self.delay_s).max(T::zero());
        let at = self
            .edges
            .partition_point(|e| e.t_s.value() <= acts_s.value());
        let oldest = self.nodes.front().map_or(0.0, |n| n.t_s.value());
        let keep = self
            .nodes
            .partition_point(|n| n.edges_done <= at && n.t_s.value() <= acts_s.value());
        if keep == 0 {
            return Err(TrajectoryError::TooOld {
                what: "command",
                t_s: acts_s.value(),
                oldest_s: oldest,
            });
        }
        self.nodes.truncate(keep);
        self.edges.insert(
            at,
            Edge {
                t_s: acts_s,
                command: Some(wrench),
            },
        );
        Ok(())
    }

    /// The state at `t_s`; before 0 the start state. Times may go back within the kept history.
    ///
    /// # Errors
    /// [`TrajectoryError::TooOld`], [`TrajectoryError::Diverged`], [`TrajectoryError::NotFinite`].
    pub fn state_at(&mut self, t_s: T) -> Result<ModelState<T>, TrajectoryError> {
        finite("query time", t_s.value())?;
        while let Some(next) = self.next_node(t_s)? {
            if self.nodes.len() >= NODES_KEPT {
                self.nodes.pop_front();
            }
            self.nodes.push_back(next);
        }
        let after = self.nodes.partition_point(|n| n.t_s.value() <= t_s.value());
        let Some(node) = after.checked_sub(1).and_then(|i| self.nodes.get(i)) else {
            let oldest = self.nodes.front();
            return match oldest {
                Some(first) if first.t_s.value() == 0.0 => Ok(self.as_given(t_s, first.state)),
                _ => Err(TrajectoryError::TooOld {
                    what: "query",
                    t_s: t_s.value(),
                    oldest_s: oldest.map_or(0.0, |n| n.t_s.value()),
                }),
            };
        };
        let state = self.model.rk4_beside(
            node.t_s,
            t_s - node.t_s,
            &node.state,
            &node.command,
            self.given.as_ref(),
        );
        check(&state, t_s.value(), node)?;
        Ok(self.as_given(t_s, state))
    }

    /// A state with what is given in it.
    fn as_given(&self, t_s: T, mut state: ModelState<T>) -> ModelState<T> {
        if let Some(given) = &self.given {
            let VehicleState { eta, nu } = &mut state.vehicle;
            given.put(t_s, eta, nu, false);
        }
        state
    }

    /// The node after the last one, if it lies at or before `until`.
    fn next_node(&self, until: T) -> Result<Option<Node<T>>, TrajectoryError> {
        let Some(last) = self.nodes.back() else {
            return Ok(None);
        };
        let grid_s = (last.grid_done + 1) as f64 * self.step_s;
        let edge = self
            .edges
            .get(last.edges_done)
            .filter(|e| e.t_s.value() <= grid_s);
        let stop = edge.map_or(T::from_f64(grid_s), |e| e.t_s);
        if stop.value() > until.value() {
            return Ok(None);
        }
        let state = self.model.rk4_beside(
            last.t_s,
            stop - last.t_s,
            &last.state,
            &last.command,
            self.given.as_ref(),
        );
        check(&state, stop.value(), last)?;
        Ok(Some(Node {
            t_s: stop,
            state,
            command: edge.and_then(|e| e.command).unwrap_or(last.command),
            edges_done: last.edges_done + usize::from(edge.is_some()),
            grid_done: last.grid_done + u64::from(edge.is_none()),
        }))
    }
}

fn finite(what: &'static str, value: f64) -> Result<(), TrajectoryError> {
    if value.is_finite() {
        Ok(())
    } else {
        Err(TrajectoryError::NotFinite { what, value })
    }
}

fn check<T: Real>(
    state: &ModelState<T>,
    t_s: f64,
    before: &Node<T>,
) -> Result<(), TrajectoryError> {
    if state.is_finite() {
        Ok(())
    } else {
        Err(TrajectoryError::Diverged {
            t_s,
            theta_rad: before.state.vehicle.eta[4].value(),
        })
    }
}

#[cfg(test)]
mod tests;
