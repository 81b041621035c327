//! Mass, inertia and hydrodynamic coefficients (paper Eq. 1, Table 6).

use crate::raw::{Kind, Quantity, Section, number, numbers, table, words};

/// Degree of freedom, SNAME order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Dof {
    /// x, u, X
    Surge,
    /// y, v, Y
    Sway,
    /// z, w, Z
    Heave,
    /// phi, p, K
    Roll,
    /// theta, q, M
    Pitch,
    /// psi, r, N
    Yaw,
}

/// Equations of motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum VehicleModel {
    /// The full Eq. 1 with its Coriolis terms.
    Eq1,
    /// Six independent equations (Eq. 7 and its likes).
    Decoupled,
}

/// The three coefficients of one DOF (Table 1), SNAME signs (all negative for a real hull).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisCoefficients {
    /// Added mass, e.g. X_udot \[kg\] or K_pdot \[kg m2\].
    pub added: f64,
    /// Linear damping, e.g. X_u \[kg/s\] or K_p \[kg m2/s\].
    pub linear: f64,
    /// Quadratic damping, e.g. X_u|u| \[kg/m\] or K_p|p| \[kg m2\].
    pub quadratic: f64,
}

/// Added mass and damping.
const fn negative(unit: &'static str) -> Quantity {
    number(-1e7, 0.0, unit).hint("SNAME signs: added mass and damping are negative (X_udot = -250)")
}

table! {
    /// Hydrodynamic coefficients of the translations, SNAME signs: negative for a real hull.
    struct Translation as TranslationTyped {
        /// Added mass: X_udot, Y_vdot, Z_wdot.
        pub added_kg: f64 = negative("kg"),
        /// Linear damping: X_u, Y_v, Z_w.
        pub linear_kgps: f64 = negative("kg/s"),
        /// Quadratic damping: X_u|u|, Y_v|v|, Z_w|w|.
        pub quadratic_kgpm: f64 = negative("kg/m"),
    }
}

table! {
    /// Hydrodynamic coefficients of the rotations, SNAME signs: negative for a real hull.
    struct Rotation as RotationTyped {
        /// Added moment of inertia: K_pdot, M_qdot, N_rdot.
        pub added_kgm2: f64 = negative("kg m2"),
        /// Linear damping: K_p, M_q, N_r.
        pub linear_kgm2ps: f64 = negative("kg m2/s"),
        /// Quadratic damping: K_p|p|, M_q|q|, N_r|r|.
        pub quadratic_kgm2: f64 = negative("kg m2"),
    }
}

impl Translation {
    fn of(vehicle: &Vehicle, dof: Dof) -> Option<Self> {
        let axis = vehicle.coefficients[dof.index()];
        Some(Translation {
            added_kg: axis.added,
            linear_kgps: axis.linear,
            quadratic_kgpm: axis.quadratic,
        })
    }

    fn axis(&self) -> AxisCoefficients {
        AxisCoefficients {
            added: self.added_kg,
            linear: self.linear_kgps,
            quadratic: self.quadratic_kgpm,
        }
    }
}

impl Rotation {
    fn of(vehicle: &Vehicle, dof: Dof) -> Option<Self> {
        let axis = vehicle.coefficients[dof.index()];
        Some(Rotation {
            added_kgm2: axis.added,
            linear_kgm2ps: axis.linear,
            quadratic_kgm2: axis.quadratic,
        })
    }

    fn axis(&self) -> AxisCoefficients {
        AxisCoefficients {
            added: self.added_kgm2,
            linear: self.linear_kgm2ps,
            quadratic: self.quadratic_kgm2,
        }
    }
}

table! {
    /// The vehicle's equations of motion.
    pub struct Vehicle as VehicleTyped, checked by six_axes {
        /// Equations: Eq. 1 of the paper with its Coriolis terms, or six independent equations of one degree of freedom.
        pub model: VehicleModel = words([("eq1", VehicleModel::Eq1), ("decoupled", VehicleModel::Decoupled)])
            .or_said(VehicleModel::Eq1, "eq1"),
        /// Mass of the vehicle.
        pub mass_kg: f64 = number(0.0, 1e6, "kg").above(),
        /// Moments of inertia I_x, I_y, I_z about the CG.
        pub inertia_kgm2: [f64; 3] = numbers(number(0.0, 1e9, "kg m2").above()),
        /// Centre of buoyancy from the CG, z down: negative = above = stable.
        pub r_bz_m: f64 =
            number(-10.0, 10.0, "m").hint("Negative: centre of buoyancy above the centre of gravity"),
        /// Gravitational acceleration.
        pub gravity_mps2: f64 = number(0.0, 30.0, "m/s2").above().or(9.81),
        key surge: Translation = table() => |v| Translation::of(v, Dof::Surge),
        key sway: Translation = table() => |v| Translation::of(v, Dof::Sway),
        key heave: Translation = table() => |v| Translation::of(v, Dof::Heave),
        key roll: Rotation = table() => |v| Rotation::of(v, Dof::Roll),
        key pitch: Rotation = table() => |v| Rotation::of(v, Dof::Pitch),
        key yaw: Rotation = table() => |v| Rotation::of(v, Dof::Yaw),
        /// Coefficients in the order of [`Dof`].
        made coefficients: [AxisCoefficients; 6],
    }
}

fn six_axes(typed: &mut VehicleTyped, _: &Section<'_>) {
    let translations = [&typed.surge, &typed.sway, &typed.heave].map(|t| Some(t.as_ref()?.axis()));
    let rotations = [&typed.roll, &typed.pitch, &typed.yaw].map(|r| Some(r.as_ref()?.axis()));
    if let ([Some(u), Some(v), Some(w)], [Some(p), Some(q), Some(r)]) = (translations, rotations) {
        typed.coefficients = Some([u, v, w, p, q, r]);
    }
}

impl Dof {
    /// All six in SNAME order.
    pub const ALL: [Dof; 6] = [
        Dof::Surge,
        Dof::Sway,
        Dof::Heave,
        Dof::Roll,
        Dof::Pitch,
        Dof::Yaw,
    ];

    /// Name in files.
    pub fn name(self) -> &'static str {
        ["surge", "sway", "heave", "roll", "pitch", "yaw"][self.index()]
    }

    /// Names of its three coefficients in identifications: added mass, linear and quadratic damping.
    pub fn coefficient_names(self) -> [&'static str; 3] {
        match self {
            Dof::Surge => ["x_udot", "x_u", "x_uu"],
            Dof::Sway => ["y_vdot", "y_v", "y_vv"],
            Dof::Heave => ["z_wdot", "z_w", "z_ww"],
            Dof::Roll => ["k_pdot", "k_p", "k_pp"],
            Dof::Pitch => ["m_qdot", "m_q", "m_qq"],
            Dof::Yaw => ["n_rdot", "n_r", "n_rr"],
        }
    }

    /// Position in SNAME order, 0..6.
    pub fn index(self) -> usize {
        self as usize
    }
}
