//! The vehicle: state, coefficients, equations of motion.
//!
//! Conventions (theory/geometry.md, frames): tank frame Z down, floor at Z = 0; body frame at the CG,
//! x forward, y starboard, z down; Euler angles ZYX; W = B.

pub mod equations;
pub mod kinematics;

use crate::real::Real;
use hydroline_rigs::{Vehicle, VehicleModel};

/// Pose and body rates in SNAME order.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VehicleState<T = f64> {
    /// x, y, z of the CG in the tank frame \[m\]; phi, theta, psi \[rad\].
    pub eta: [T; 6],
    /// u, v, w \[m/s\]; p, q, r \[rad/s\], body frame, over ground.
    pub nu: [T; 6],
}

impl<T: Real> VehicleState<T> {
    /// At rest at a pose.
    pub fn at_rest(eta: [T; 6]) -> Self {
        VehicleState {
            eta,
            nu: [T::zero(); 6],
        }
    }
}

/// The vehicle's numbers as the equations need them, in the scalar `T`.
#[derive(Debug, Clone, PartialEq)]
pub struct Hydrodynamics<T = f64> {
    /// Full Eq. 1 or six independent equations.
    pub model: VehicleModel,
    /// m, m, m \[kg\], I_x, I_y, I_z \[kg m2\].
    pub rigid: [T; 6],
    /// X_udot .. N_rdot (SNAME sign, negative) \[kg, kg m2\].
    pub added: [T; 6],
    /// X_u .. N_r (negative) \[kg/s, kg m2/s\].
    pub linear: [T; 6],
    /// X_u|u| .. N_r|r| (negative) \[kg/m, kg m2\].
    pub quadratic: [T; 6],
    /// r_Bz m g \[N m\]: restoring moment per unit sine (negative: stable).
    pub restoring_nm: T,
}

impl<T: Real> Hydrodynamics<T> {
    /// Takes a checked vehicle over, every number a constant.
    pub fn new(vehicle: &Vehicle) -> Self {
        let c = |v: f64| T::from_f64(v);
        let m = vehicle.mass_kg;
        let [ix, iy, iz] = vehicle.inertia_kgm2;
        Hydrodynamics {
            model: vehicle.model,
            rigid: [c(m), c(m), c(m), c(ix), c(iy), c(iz)],
            added: std::array::from_fn(|i| c(vehicle.coefficients[i].added)),
            linear: std::array::from_fn(|i| c(vehicle.coefficients[i].linear)),
            quadratic: std::array::from_fn(|i| c(vehicle.coefficients[i].quadratic)),
            restoring_nm: c(vehicle.r_bz_m * m * vehicle.gravity_mps2),
        }
    }

    /// Rigid plus added mass per DOF: m - X_udot, .., I_z - N_rdot.
    pub fn mass(&self) -> [T; 6] {
        std::array::from_fn(|i| self.rigid[i] - self.added[i])
    }
}
