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

/// Stiffness of the water where the hull cuts its surface.
const fn stiffness(unit: &'static str) -> Quantity {
    number(0.0, 1e9, unit).hint(
        "Positive: a hull that is pushed down, or heeled, comes back; 0 where it is under water",
    )
}

table! {
    /// Hydrodynamic coefficients of surge and sway, SNAME signs: negative for a real hull.
    struct Translation as TranslationTyped {
        /// Added mass: X_udot, Y_vdot.
        pub added_kg: f64 = negative("kg"),
        /// Linear damping: X_u, Y_v.
        pub linear_kgps: f64 = negative("kg/s"),
        /// Quadratic damping: X_u|u|, Y_v|v|.
        pub quadratic_kgpm: f64 = negative("kg/m"),
    }
}

table! {
    /// Hydrodynamic coefficients of heave, SNAME signs: negative for a real hull; and what a hull has that floats.
    struct Heave as HeaveTyped {
        /// Added mass Z_wdot.
        pub added_kg: f64 = negative("kg"),
        /// Linear damping Z_w.
        pub linear_kgps: f64 = negative("kg/s"),
        /// Quadratic damping Z_w|w|.
        pub quadratic_kgpm: f64 = negative("kg/m"),
        /// Hydrostatic stiffness: force up per metre that the hull lies deeper than `float_z_m`; water's density times gravity times
        /// the area of its waterplane. 0 = under water.
        pub stiffness_npm: f64 = stiffness("N/m").or(0.0).quiet(),
        /// z of the CG at which the stiffness makes no force. Omitted: that of `tank.start_m`, where there is a stiffness.
        pub float_z_m: Option<f64> = number(-1000.0, 1000.0, "m").optional(),
    }
}

table! {
    /// Hydrodynamic coefficients of roll and pitch, SNAME signs: negative for a real hull; and what a hull has that floats.
    struct Tilt as TiltTyped {
        /// Added moment of inertia: K_pdot, M_qdot.
        pub added_kgm2: f64 = negative("kg m2"),
        /// Linear damping: K_p, M_q.
        pub linear_kgm2ps: f64 = negative("kg m2/s"),
        /// Quadratic damping: K_p|p|, M_q|q|.
        pub quadratic_kgm2: f64 = negative("kg m2"),
        /// Hydrostatic stiffness: righting moment of the waterplane per radian, beside that of `r_bz_m`. 0 = under water.
        pub stiffness_nmprad: f64 = stiffness("N m/rad").or(0.0).quiet(),
    }
}

table! {
    /// Hydrodynamic coefficients of yaw, SNAME signs: negative for a real hull.
    struct Rotation as RotationTyped {
        /// Added moment of inertia N_rdot.
        pub added_kgm2: f64 = negative("kg m2"),
        /// Linear damping N_r.
        pub linear_kgm2ps: f64 = negative("kg m2/s"),
        /// Quadratic damping N_r|r|.
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
    fn of(vehicle: &Vehicle) -> Option<Self> {
        let axis = vehicle.coefficients[Dof::Yaw.index()];
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

impl Heave {
    fn of(vehicle: &Vehicle) -> Option<Self> {
        let axis = vehicle.coefficients[Dof::Heave.index()];
        Some(Heave {
            added_kg: axis.added,
            linear_kgps: axis.linear,
            quadratic_kgpm: axis.quadratic,
            stiffness_npm: vehicle.stiffness[0],
            float_z_m: vehicle.float_z_m,
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

impl Tilt {
    fn of(vehicle: &Vehicle, dof: Dof) -> Option<Self> {
        let axis = vehicle.coefficients[dof.index()];
        Some(Tilt {
            added_kgm2: axis.added,
            linear_kgm2ps: axis.linear,
            quadratic_kgm2: axis.quadratic,
            stiffness_nmprad: vehicle.stiffness[dof.index() - Dof::Heave.index()],
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
        /// Standard deviation of the mass. Omitted: `identify` assumes 1 % of it.
        pub mass_kg_sd: Option<f64> = number(0.0, 1e6, "kg").optional(),
        /// Moments of inertia I_x, I_y, I_z about the CG.
        pub inertia_kgm2: [f64; 3] = numbers(number(0.0, 1e9, "kg m2").above()),
        /// Standard deviations of the moments of inertia. Omitted: `identify` assumes 5 % of each.
        pub inertia_kgm2_sd: Option<[f64; 3]> = numbers(number(0.0, 1e9, "kg m2")).optional(),
        /// Centre of buoyancy from the CG, z down: negative = above = stable.
        pub r_bz_m: f64 =
            number(-10.0, 10.0, "m").hint("Negative: centre of buoyancy above the centre of gravity"),
        /// Standard deviation of the centre of buoyancy. Omitted: `identify` assumes 5 % of its distance.
        pub r_bz_m_sd: Option<f64> = number(0.0, 10.0, "m").optional(),
        /// Gravitational acceleration.
        pub gravity_mps2: f64 = number(0.0, 30.0, "m/s2").above().or(9.81),
        /// Weight minus buoyancy, positive down: 0 = it hangs in the water or floats on it; in air its whole weight.
        pub net_weight_n: f64 = number(-1e7, 1e7, "N").or(0.0).quiet(),
        key surge: Translation = table() => |v| Translation::of(v, Dof::Surge),
        key sway: Translation = table() => |v| Translation::of(v, Dof::Sway),
        key heave: Heave = table() => Heave::of,
        key roll: Tilt = table() => |v| Tilt::of(v, Dof::Roll),
        key pitch: Tilt = table() => |v| Tilt::of(v, Dof::Pitch),
        key yaw: Rotation = table() => Rotation::of,
        /// Coefficients in the order of [`Dof`].
        made coefficients: [AxisCoefficients; 6],
        /// Hydrostatic stiffness in heave \[N/m\], roll and pitch \[N m/rad\]; positive restores, 0 = under water.
        made stiffness: [f64; 3],
        /// z of the CG, tank frame, at which the stiffness in heave makes no force \[m\]; `None` = no stiffness and none stated.
        made float_z_m: Option<f64>,
    }
}

fn six_axes(typed: &mut VehicleTyped, _: &Section<'_>) {
    let (Some(u), Some(v), Some(w)) = (&typed.surge, &typed.sway, &typed.heave) else {
        return;
    };
    let (Some(p), Some(q), Some(r)) = (&typed.roll, &typed.pitch, &typed.yaw) else {
        return;
    };
    typed.coefficients = Some([u.axis(), v.axis(), w.axis(), p.axis(), q.axis(), r.axis()]);
    typed.stiffness = Some([w.stiffness_npm, p.stiffness_nmprad, q.stiffness_nmprad]);
    typed.float_z_m = Some(w.float_z_m);
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

#[cfg(test)]
mod tests {
    use crate::Rig;

    /// The built-in rig with these lines below the heads of three of its tables.
    fn floating(vehicle: &str, heave: &str, roll: &str) -> Rig {
        let mut text = include_str!("../lshpi.toml").to_owned();
        let lines = [
            ("gravity_mps2 = 9.81\n", vehicle),
            ("added_kg = -360\n", heave),
            ("added_kgm2 = -4\n", roll),
        ];
        for (head, more) in lines {
            assert_eq!(text.matches(head).count(), 1, "{head}");
            text = text.replace(head, &format!("{head}{more}\n"));
        }
        Rig::from_toml(&text, "floating.toml", None).unwrap()
    }

    #[test]
    fn a_rig_that_says_nothing_of_floating_keeps_its_text() {
        let rig = Rig::builtin("lshpi").unwrap();
        assert_eq!(rig.vehicle.net_weight_n, 0.0);
        assert_eq!(rig.vehicle.stiffness, [0.0; 3]);
        assert_eq!(rig.vehicle.float_z_m, None);
        for key in [
            "net_weight_n",
            "stiffness_npm",
            "stiffness_nmprad",
            "float_z_m",
        ] {
            assert!(!rig.effective_toml.contains(key), "{key}");
        }
    }

    #[test]
    fn what_floats_is_read_back_and_floats_where_it_starts_unless_said_otherwise() {
        let rig = floating(
            "net_weight_n = -2.5",
            "stiffness_npm = 900",
            "stiffness_nmprad = 12",
        );
        assert_eq!(rig.vehicle.net_weight_n, -2.5);
        assert_eq!(rig.vehicle.stiffness, [900.0, 12.0, 0.0]);
        assert_eq!(rig.vehicle.float_z_m, Some(rig.tank.start_pose[2]));
        let again = Rig::from_toml(&rig.effective_toml, "again.toml", None).unwrap();
        assert_eq!(again, rig);
        let said = floating("", "stiffness_npm = 900\nfloat_z_m = -1.1", "");
        assert_eq!(said.vehicle.float_z_m, Some(-1.1));
        let again = Rig::from_toml(&said.effective_toml, "again.toml", None).unwrap();
        assert_eq!(again, said);
    }
}
