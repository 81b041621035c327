//! Coordinates in which the weak direction of a frame is straight.

use super::super::photometric::{Column, PARAMETERS, Square, State, Sums};
use hydroline_calib::Pose;
use hydroline_numerics::cholesky::ScaledCholesky;
use hydroline_rigs::Mounts;
use nalgebra::{Matrix6, Vector3, Vector6};

/// Coordinates in which the weak direction is straight: where the sheet's middle meets the floor,
/// X and Y, its range ρ below the CG, and the angles. Turning θ alone then leaves the line in the
/// image and the target under it, where in x, z and θ the weak direction is curved and a step along its
/// tangent leaves it.
pub(super) struct WeakDirection {
    contact_m: [f64; 2],
    range_m: f64,
    lever_m: f64,
    /// d pose / d coordinates; all else stays as it is.
    slopes: Matrix6<f64>,
}

impl WeakDirection {
    pub fn new(pose: &Pose, mounts: &Mounts) -> Self {
        let lever_m = mounts.l_laser_m;
        let r = pose.body_to_tank_rotation();
        // Height 0: z + r31 l + r33 ρ = 0.
        let range_m = -(pose.z_m + r[(2, 0)] * lever_m) / r[(2, 2)];
        let arm = Self::arm(pose, lever_m, range_m);
        let mut slopes = Matrix6::identity();
        let mut put = |column: usize, d: Vector3<f64>| {
            for row in 0..3 {
                slopes[(row, column)] = d[row];
            }
        };
        put(2, -r.column(2).into_owned());
        let h = 1e-6;
        for k in 3..6 {
            let arm_at = |by: f64| {
                let mut p = pose.to_array();
                p[k] += by;
                Self::arm(&Pose::from_array(p), lever_m, range_m)
            };
            put(k, (arm_at(-h) - arm_at(h)) / (2.0 * h));
        }
        WeakDirection {
            contact_m: [pose.x_m + arm.x, pose.y_m + arm.y],
            range_m,
            lever_m,
            slopes,
        }
    }

    fn arm(pose: &Pose, lever_m: f64, range_m: f64) -> Vector3<f64> {
        pose.body_to_tank_rotation() * Vector3::new(lever_m, 0.0, range_m)
    }

    /// Information and gradient in these coordinates.
    pub fn transformed(&self, sums: &Sums) -> (Square, Column) {
        let transposed = self.slopes.transpose();
        let (mut information, mut gradient) = (sums.information, sums.gradient);
        let pose = sums.information.fixed_view::<6, 6>(0, 0);
        let with_light = transposed * sums.information.fixed_view::<6, { PARAMETERS - 6 }>(0, 6);
        information
            .fixed_view_mut::<6, 6>(0, 0)
            .copy_from(&(transposed * pose * self.slopes));
        information
            .fixed_view_mut::<6, { PARAMETERS - 6 }>(0, 6)
            .copy_from(&with_light);
        information
            .fixed_view_mut::<{ PARAMETERS - 6 }, 6>(6, 0)
            .copy_from(&with_light.transpose());
        let of_pose = transposed * sums.gradient.fixed_rows::<6>(0);
        gradient.fixed_rows_mut::<6>(0).copy_from(&of_pose);
        (information, gradient)
    }

    /// The state a step on, exact along the weak direction.
    pub fn moved(&self, state: &State, step: &Column) -> State {
        let mut next = state.moved(step);
        let range_m = self.range_m + step[2];
        let arm = Self::arm(&next.pose, self.lever_m, range_m);
        next.pose.x_m = self.contact_m[0] + step[0] - arm.x;
        next.pose.y_m = self.contact_m[1] + step[1] - arm.y;
        next.pose.z_m = -arm.z;
        next
    }
}

/// Squared distance of `truth` from an estimate in units of its covariance, along the curve on which
/// x, z and θ trade against each other: a step along its tangent leaves the curve by
/// H δθ² / 2, which after 0.1° is already more than the sd across it.
pub fn squared_distance(
    estimate: &Pose,
    covariance: &Matrix6<f64>,
    truth: &Pose,
    mounts: &Mounts,
) -> Option<f64> {
    let here = WeakDirection::new(estimate, mounts);
    let there = WeakDirection::new(truth, mounts);
    let (a, b) = (estimate.to_array(), truth.to_array());
    let difference = Vector6::new(
        there.contact_m[0] - here.contact_m[0],
        there.contact_m[1] - here.contact_m[1],
        there.range_m - here.range_m,
        b[3] - a[3],
        b[4] - a[4],
        b[5] - a[5],
    );
    let slopes: Matrix6<f64> = here.slopes.fixed_view::<6, 6>(0, 0).into();
    let back = slopes.try_inverse()?;
    let own = back * covariance * back.transpose();
    // Lengths and angles: no jitter, a covariance that is none has no distance.
    Some(ScaledCholesky::new(&own, 0.0)?.squared_norm(&difference))
}
