//! Euler ZYX kinematics (Fossen 1994, Eqs 2.12-2.19).

use crate::real::Real;

/// Sines and cosines of phi, theta and psi, once for all that needs them at an instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Attitude<T = f64> {
    /// (sin, cos) of phi.
    pub phi: (T, T),
    /// (sin, cos) of theta.
    pub theta: (T, T),
    /// (sin, cos) of psi.
    pub psi: (T, T),
}

impl<T: Real> Attitude<T> {
    /// Of three angles \[rad\].
    pub fn new(phi: T, theta: T, psi: T) -> Self {
        Attitude {
            phi: phi.sin_cos(),
            theta: theta.sin_cos(),
            psi: psi.sin_cos(),
        }
    }

    /// Of a pose in SNAME order.
    pub fn of(eta: &[T; 6]) -> Self {
        Self::new(eta[3], eta[4], eta[5])
    }

    /// Rotation body -> tank, R = Rz(psi) Ry(theta) Rx(phi), row-major.
    pub fn rotation(&self) -> [[T; 3]; 3] {
        let ((sf, cf), (st, ct), (sp, cp)) = (self.phi, self.theta, self.psi);
        [
            [cp * ct, cp * st * sf - sp * cf, cp * st * cf + sp * sf],
            [sp * ct, sp * st * sf + cp * cf, sp * st * cf - cp * sf],
            [-st, ct * sf, ct * cf],
        ]
    }

    /// d(eta)/dt from the body rates.
    ///
    /// Euler rates divide by cos(theta): the pose is undefined at theta = +-90 deg, where the
    /// result is not finite; [`crate::world::World`] turns that into an error.
    pub fn eta_rate(&self, nu: &[T; 6]) -> [T; 6] {
        let mut rate = [T::zero(); 6];
        self.put_eta_rate(nu, &mut rate);
        rate
    }

    /// The same in place.
    pub(crate) fn put_eta_rate(&self, nu: &[T; 6], rate: &mut [T; 6]) {
        let [u, v, w, p, q, r] = *nu;
        let m = self.rotation();
        let ((sf, cf), (st, ct)) = (self.phi, self.theta);
        let turn = q * sf + r * cf; // psi_dot cos(theta)
        for (rate, row) in rate.iter_mut().zip(&m) {
            *rate = row[0] * u + row[1] * v + row[2] * w;
        }
        rate[3] = p + turn * st / ct;
        rate[4] = q * cf - r * sf;
        rate[5] = turn / ct;
    }
}

/// Rotation body -> tank of three angles ([`Attitude::rotation`]).
pub fn rotation<T: Real>(phi: T, theta: T, psi: T) -> [[T; 3]; 3] {
    Attitude::new(phi, theta, psi).rotation()
}

/// d(eta)/dt of a pose from the body rates ([`Attitude::eta_rate`]).
pub fn eta_rate<T: Real>(eta: &[T; 6], nu: &[T; 6]) -> [T; 6] {
    Attitude::of(eta).eta_rate(nu)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn rotation_is_orthonormal_and_right_handed(phi in -3.0..3.0f64, theta in -1.5..1.5f64, psi in -3.0..3.0f64) {
            let m = nalgebra::Matrix3::from_fn(|i, j| rotation(phi, theta, psi)[i][j]);
            prop_assert!((m * m.transpose() - nalgebra::Matrix3::identity()).norm() < 1e-12);
            prop_assert!((m.determinant() - 1.0).abs() < 1e-12);
        }

        /// dR/dt = R [omega]x: the Euler rates belong to the body rates.
        #[test]
        fn euler_rates_belong_to_body_rates(
            phi in -1.0..1.0f64, theta in -1.2..1.2f64, psi in -3.0..3.0f64,
            p in -1.0..1.0f64, q in -1.0..1.0f64, r in -1.0..1.0f64,
        ) {
            let rate = eta_rate(&[0.0, 0.0, 0.0, phi, theta, psi], &[0.0, 0.0, 0.0, p, q, r]);
            let h = 1e-6;
            let at = |s: f64| {
                let m = rotation(phi + s * rate[3], theta + s * rate[4], psi + s * rate[5]);
                nalgebra::Matrix3::from_fn(|i, j| m[i][j])
            };
            let numeric = (at(h) - at(-h)) / (2.0 * h);
            let omega = nalgebra::Vector3::new(p, q, r).cross_matrix();
            prop_assert!((numeric - at(0.0) * omega).norm() < 1e-7);
        }
    }

    #[test]
    fn nose_up_and_yaw_to_starboard_are_positive() {
        let up = rotation(0.0, 0.1, 0.0);
        assert!(
            up[2][0] < 0.0,
            "theta > 0 lifts the nose: body x points to -Z"
        );
        let right = rotation(0.0, 0.0, 0.1);
        assert!(
            right[1][0] > 0.0,
            "psi > 0 turns the nose to +Y (starboard)"
        );
    }
}
