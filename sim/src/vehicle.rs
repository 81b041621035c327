//! The vehicle: state, coefficients, equations of motion.
//!
//! Conventions (theory/geometry.md, frames): tank frame Z down, floor at Z = 0; body frame at the CG,
//! x forward, y starboard, z down; Euler angles ZYX; W = B unless the rig says what weighs more, or floats.

pub mod equations;
pub mod kinematics;

use crate::real::Real;
use hydroline_rigs::channel::Channel;
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

    /// One of the twelve.
    pub fn channel(&mut self, channel: Channel) -> &mut T {
        let dof = channel.dof().index();
        if channel.is_rate() {
            &mut self.nu[dof]
        } else {
            &mut self.eta[dof]
        }
    }
}

/// Weight that buoyancy leaves, and stiffness of the water where the hull cuts its surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hydrostatics<T = f64> {
    /// Weight minus buoyancy \[N\], positive down.
    pub net_weight_n: T,
    /// Stiffness in heave \[N/m\], roll and pitch \[N m/rad\]; positive restores.
    pub stiffness: [T; 3],
    /// z of the CG, tank frame, at which the stiffness in heave makes no force \[m\].
    pub float_z_m: T,
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
    /// Floating and net weight, where the rig states any; `None` = W = B, under water.
    pub hydrostatics: Option<Hydrostatics<T>>,
}

impl<T: Real> Hydrodynamics<T> {
    /// Takes a checked vehicle over, every number a constant.
    pub fn new(vehicle: &Vehicle) -> Self {
        let c = |v: f64| T::from_f64(v);
        let m = vehicle.mass_kg;
        let [ix, iy, iz] = vehicle.inertia_kgm2;
        let is_said = vehicle.net_weight_n != 0.0 || vehicle.stiffness.iter().any(|k| *k != 0.0);
        Hydrodynamics {
            model: vehicle.model,
            rigid: [c(m), c(m), c(m), c(ix), c(iy), c(iz)],
            added: std::array::from_fn(|i| c(vehicle.coefficients[i].added)),
            linear: std::array::from_fn(|i| c(vehicle.coefficients[i].linear)),
            quadratic: std::array::from_fn(|i| c(vehicle.coefficients[i].quadratic)),
            restoring_nm: c(vehicle.r_bz_m * m * vehicle.gravity_mps2),
            hydrostatics: is_said.then(|| Hydrostatics {
                net_weight_n: c(vehicle.net_weight_n),
                stiffness: vehicle.stiffness.map(c),
                float_z_m: c(vehicle.float_z_m.unwrap_or(0.0)),
            }),
        }
    }

    /// Force or moment per metre or radian that brings a DOF back to where it rests, upright \[N/m, N m/rad\]; 0 where none
    /// does, negative where it tips over.
    pub fn stiffness(&self, dof: usize) -> T {
        let water = match (&self.hydrostatics, dof) {
            (Some(statics), 2..=4) => statics.stiffness[dof - 2],
            _ => T::zero(),
        };
        match dof {
            3 | 4 => water - self.restoring_nm,
            _ => water,
        }
    }

    /// Rigid plus added mass per DOF: m - X_udot, .., I_z - N_rdot.
    pub fn mass(&self) -> [T; 6] {
        std::array::from_fn(|i| self.rigid[i] - self.added[i])
    }
}
