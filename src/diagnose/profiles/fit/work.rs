//! A fit under way: its state in units of the priors, and steps of it.

use super::super::candidate::Candidate;
use super::{Free, Problem, State, UNIT};
use hydroline_calib::Pose;
use nalgebra::{DVector, Vector3};

/// A fit under way.
pub(super) struct Work<'p, 'a> {
    pub(super) problem: &'p Problem<'a>,
    pub(super) chosen: Vec<&'p Candidate>,
    pub(super) free: Free,
    pub(super) state: State,
}

impl Work<'_, '_> {
    pub(super) fn frames(&self) -> usize {
        self.state.poses.iter().map(Vec::len).sum()
    }

    pub(super) fn numbers(&self) -> usize {
        self.chosen.iter().map(|c| c.neutral.len()).sum()
    }

    pub(super) fn size(&self) -> usize {
        let more = match self.free {
            Free::All => self.problem.shared.len() + self.numbers(),
            Free::Poses => 0,
        };
        6 * self.frames() + more
    }

    /// The state in the fit's units: poses off the rig's motion, the rest in units of their priors.
    pub(super) fn x(&self) -> DVector<f64> {
        let mut x = Vec::with_capacity(self.size());
        for (poses, motion) in self.state.poses.iter().zip(&self.problem.motions) {
            for (pose, mean) in poses.iter().zip(&motion.mean) {
                x.extend((0..6).map(|d| (pose[d] - mean[d]) / UNIT));
            }
        }
        if self.free == Free::All {
            x.extend(&self.state.shared);
            for (c, numbers) in self.chosen.iter().zip(&self.state.numbers) {
                let scaled = numbers.iter().zip(&c.neutral).zip(&c.prior_sd);
                x.extend(scaled.map(|((v, n), s)| (v - n) / s));
            }
        }
        DVector::from_vec(x)
    }

    /// Moves the state, poses along the weakly observable direction of a frame.
    pub(super) fn step(&mut self, by: &DVector<f64>) {
        let mut values = by.iter().copied();
        let lever_m = self.problem.rig.mounts.l_laser_m;
        for pose in self.state.poses.iter_mut().flatten() {
            let own: [f64; 6] = std::array::from_fn(|_| UNIT * values.next().unwrap_or(0.0));
            *pose = along_the_weak_direction(pose, &own, lever_m);
        }
        if self.free == Free::All {
            for s in &mut self.state.shared {
                *s += values.next().unwrap_or(0.0);
            }
            for (c, numbers) in self.chosen.iter().zip(&mut self.state.numbers) {
                for (k, number) in numbers.iter_mut().enumerate() {
                    let limits = c.info.parameters[k].limits;
                    let v = *number + c.prior_sd[k] * values.next().unwrap_or(0.0);
                    *number = v.clamp(limits.0, limits.1);
                }
            }
        }
    }
}

/// A pose moved by a step that is linear in where the sheet's middle meets the floor (X, Y), its
/// range there, and the angles. Turning θ alone leaves the line in the image; in x, z and θ it
/// follows a curve, which a straight step leaves by H δθ²/2: many row sds after a tenth of a degree.
fn along_the_weak_direction(pose: &[f64; 6], by: &[f64; 6], lever_m: f64) -> [f64; 6] {
    let seen = |p: &[f64; 6]| {
        let pose = Pose::from_array(*p);
        let r = pose.body_to_tank_rotation();
        // Height 0: z + r31 l + r33 ρ = 0.
        let range_m = -(pose.z_m + r[(2, 0)] * lever_m) / r[(2, 2)];
        let foot = pose.position_m() + r * Vector3::new(lever_m, 0.0, range_m);
        [foot.x, foot.y, range_m]
    };
    let here = seen(pose);
    let h = 1e-3;
    let (mut ahead, mut behind) = (*pose, *pose);
    for d in 0..6 {
        ahead[d] += h * by[d];
        behind[d] -= h * by[d];
    }
    let (a, b) = (seen(&ahead), seen(&behind));
    let there: [f64; 3] = std::array::from_fn(|i| here[i] + (a[i] - b[i]) / (2.0 * h));
    let mut next = *pose;
    for d in 3..6 {
        next[d] += by[d];
    }
    let arm = Pose::from_array(next).body_to_tank_rotation() * Vector3::new(lever_m, 0.0, there[2]);
    [next[0], next[1], next[2]] = [there[0] - arm.x, there[1] - arm.y, -arm.z];
    next
}
