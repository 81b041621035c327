//! Mass, inertia and hydrodynamic coefficients (paper Eq. 1, Table 6).

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

/// Which equations of motion.
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

/// A checked vehicle.
#[derive(Debug, Clone, PartialEq)]
pub struct Vehicle {
    /// Equations of motion.
    pub model: VehicleModel,
    /// m \[kg\].
    pub mass_kg: f64,
    /// I_x, I_y, I_z \[kg m2\].
    pub inertia_kgm2: [f64; 3],
    /// r_Bz, CB relative to CG, z down \[m\].
    pub r_bz_m: f64,
    /// g \[m/s2\].
    pub gravity_mps2: f64,
    /// Coefficients in the order of [`Dof`].
    pub coefficients: [AxisCoefficients; 6],
}

/// What an identification left behind: how well coefficients of `[vehicle]` are known.
#[derive(Debug, Clone, PartialEq)]
pub struct Identified {
    /// Names as identification writes them, e.g. `x_udot`.
    pub coefficients: Vec<String>,
    /// Values that the covariance belongs to, SI. Where `[vehicle]` says other ones it is not theirs.
    pub values: Vec<f64>,
    /// Standard deviations, for people: the square roots of the covariance's diagonal, and checked to be.
    pub sd: Vec<f64>,
    /// Covariance, one row per coefficient, SI.
    pub covariance: Vec<Vec<f64>>,
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
        match self {
            Dof::Surge => "surge",
            Dof::Sway => "sway",
            Dof::Heave => "heave",
            Dof::Roll => "roll",
            Dof::Pitch => "pitch",
            Dof::Yaw => "yaw",
        }
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
