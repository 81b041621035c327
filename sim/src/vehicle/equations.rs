//! The forces of paper Eq. 1, one function per group of terms.

use super::Hydrodynamics;
use crate::real::Real;

/// Coriolis and centripetal terms of Eq. 1 (rigid body plus added mass) \[N, N m\].
///
/// Eq. 1 holds them with M_x = m - X_udot etc., e.g. surge (Z_wdot - m) w q + (m - Y_vdot) v r.
pub fn coriolis<T: Real>(h: &Hydrodynamics<T>, nu: &[T; 6]) -> [T; 6] {
    let [u, v, w, p, q, r] = *nu;
    let [mx, my, mz, ..] = h.mass();
    let [xu, yv, zw, kp, mq, nr] = h.added;
    let [_, _, _, ix, iy, iz] = h.rigid;
    [
        my * v * r - mz * w * q,
        mz * w * p - mx * u * r,
        mx * u * q - my * v * p,
        (zw - yv) * w * v + (iy - iz + nr - mq) * r * q,
        (xu - zw) * u * w + (iz - ix + kp - nr) * p * r,
        (yv - xu) * v * u + (ix - iy + mq - kp) * p * q,
    ]
}

/// Linear and quadratic damping (X_u + X_u|u| |u|) u of the velocity through the water \[N, N m\].
pub fn damping<T: Real>(h: &Hydrodynamics<T>, nu_r: &[T; 6]) -> [T; 6] {
    std::array::from_fn(|i| (h.linear[i] + h.quadratic[i] * nu_r[i].abs()) * nu_r[i])
}

/// Restoring moments, W = B: r_Bz m g cos(theta) sin(phi) in roll, r_Bz m g sin(theta) in pitch (Eq. 1).
pub fn restoring<T: Real>(h: &Hydrodynamics<T>, eta: &[T; 6], coupled: bool) -> [T; 6] {
    let (phi, theta) = (eta[3], eta[4]);
    // The one-DOF roll equation knows no pitch: cos(theta) belongs to Eq. 1 only.
    let tilt = if coupled { theta.cos() } else { T::one() };
    let zero = T::zero();
    [
        zero,
        zero,
        zero,
        h.restoring_nm * tilt * phi.sin(),
        h.restoring_nm * theta.sin(),
        zero,
    ]
}
