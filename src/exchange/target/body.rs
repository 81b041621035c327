//! The rigid body and its water as simulators of jointed bodies take them: x forward, y to port, z up.
//!
//! A thruster is a link of its own there, with a mass that an engine asks for. The base gives that mass away, so that all links together
//! have the rig's mass, centre of gravity and inertia.

use hydroline_rigs::{Rig, Thruster, VehicleModel};
use hydroline_sim::effect::{CheckedEffect, check};
use nalgebra::{Matrix3, Vector3};

use crate::lost::Lost;
use crate::model::{ModelError, name_of};

/// Mass of a thruster's link \[kg\]: as little as engines bear.
const LINK_MASS_KG: f64 = 1e-3;
/// Its moment of inertia about each axis \[kg m2\].
const LINK_INERTIA_KGM2: f64 = 1e-6;
/// Density of the water \[kg/m3\]; only the product with the volume counts.
pub const DENSITY_KGPM3: f64 = 1000.0;

/// A vector of our body frame in theirs, and the other way round.
pub fn turned([x, y, z]: [f64; 3]) -> [f64; 3] {
    [x, -y + 0.0, -z + 0.0]
}

/// A thruster's link.
#[derive(Debug, Clone, PartialEq)]
pub struct Jet {
    /// Name of the link.
    pub name: String,
    /// Position, their frame \[m\].
    pub position_m: [f64; 3],
    /// Direction of positive thrust, their frame.
    pub direction: [f64; 3],
    /// Least and largest thrust \[N\].
    pub limits_n: [f64; 2],
}

/// The body.
#[derive(Debug, Clone, PartialEq)]
pub struct Body {
    /// Name of the rig.
    pub name: String,
    /// Pose of the start: position \[m\], roll, pitch, yaw \[rad\]; world x as ours, z up.
    pub start: [f64; 6],
    /// Mass of the base \[kg\].
    pub mass_kg: f64,
    /// Its centre of gravity \[m\].
    pub centre_m: [f64; 3],
    /// Its inertia about that: xx, xy, xz, yy, yz, zz \[kg m2\].
    pub inertia_kgm2: [f64; 6],
    /// Mass and inertia of each thruster's link.
    pub link: (f64, f64),
    /// Added mass by DOF, positive \[kg, kg m2\].
    pub added: [f64; 6],
    /// Linear damping by DOF, SNAME signs.
    pub linear: [f64; 6],
    /// Quadratic damping by DOF, SNAME signs.
    pub quadratic: [f64; 6],
    /// Volume of the water that it displaces \[m3\].
    pub volume_m3: f64,
    /// Centre of buoyancy \[m\].
    pub buoyancy_m: [f64; 3],
    /// Gravitational acceleration \[m/s2\].
    pub gravity_mps2: f64,
    /// Thrusters.
    pub jets: Vec<Jet>,
    /// Effects that are in these numbers.
    pub held: Vec<String>,
    /// What is not, by the effect's name.
    pub lost: Vec<Lost>,
    /// Numbers that are not the rig's.
    pub changed: Vec<String>,
}

fn tensor(mass_kg: f64, arm_m: Vector3<f64>) -> Matrix3<f64> {
    (Matrix3::identity() * arm_m.norm_squared() - arm_m * arm_m.transpose()) * mass_kg
}

fn jet(rig: &Rig, thruster: &Thruster) -> Jet {
    let set = &rig.thrusters;
    let (least, most) = thruster.curve.thrust_range_n(set.min_us, set.max_us);
    Jet {
        name: format!("thruster_{}", thruster.name),
        position_m: turned(thruster.position_m),
        direction: turned(thruster.direction),
        limits_n: [least, most],
    }
}

/// Damping that an effect adds: DOF, whether quadratic, coefficient.
fn damping(effect: &CheckedEffect) -> Option<(usize, bool, f64)> {
    let is_quadratic = match effect.info.id {
        "linear_damping" => false,
        "quadratic_damping" => true,
        _ => return None,
    };
    let dofs = hydroline_rigs::Dof::ALL.map(|d| d.name());
    let word = effect.words.first().and_then(|w| {
        let named = effect.info.words.first()?.allowed.get(*w)?;
        dofs.iter().position(|d| d == named)
    })?;
    // A number that varies is no coefficient.
    let constant = effect.trend.is_none().then_some(effect.numbers.first()?)?;
    Some((word, is_quadratic, *constant))
}

/// The body of a rig.
///
/// # Errors
/// [`ModelError::Effect`].
pub fn body(rig: &Rig) -> Result<Body, ModelError> {
    let v = &rig.vehicle;
    let jets: Vec<Jet> = rig
        .thrusters
        .thrusters
        .iter()
        .map(|t| jet(rig, t))
        .collect();
    let mass_kg = v.mass_kg - LINK_MASS_KG * jets.len() as f64;
    let arms: Vec<Vector3<f64>> = jets.iter().map(|j| Vector3::from(j.position_m)).collect();
    let moment: Vector3<f64> = arms.iter().map(|a| a * LINK_MASS_KG).sum();
    let centre = -moment / mass_kg;
    let mut inertia = Matrix3::from_diagonal(&Vector3::from(v.inertia_kgm2));
    for arm in &arms {
        inertia -= tensor(LINK_MASS_KG, *arm) + Matrix3::identity() * LINK_INERTIA_KGM2;
    }
    inertia -= tensor(mass_kg, centre);
    let [mut linear, mut quadratic] = [[0.0; 6]; 2];
    let mut added = [0.0; 6];
    for (d, c) in v.coefficients.iter().enumerate() {
        (added[d], linear[d], quadratic[d]) = (-c.added, c.linear, c.quadratic);
    }
    let (mut held, mut lost) = (Vec::new(), Vec::new());
    for effect in check(&rig.physics)? {
        let name = name_of(&effect);
        match damping(&effect) {
            Some((dof, true, c)) => quadratic[dof] += c,
            Some((dof, false, c)) => linear[dof] += c,
            None => {
                let why = "these files have no law for it";
                lost.push(Lost::new(name, why));
                continue;
            }
        }
        held.push(name);
    }
    if v.model == VehicleModel::Decoupled {
        lost.push(Lost::new(
            "model = decoupled",
            "a simulator of bodies has the Coriolis terms of Eq. 1 always",
        ));
    }
    if v.stiffness.iter().any(|k| *k != 0.0) {
        lost.push(Lost::new(
            "hydrostatic stiffness",
            "a hull that cuts the surface needs the simulator's own graded buoyancy",
        ));
    }
    let weight_n = v.mass_kg * v.gravity_mps2;
    let buoyancy_n = (weight_n - v.net_weight_n).max(0.0);
    let arm_m = if buoyancy_n > 0.0 {
        v.r_bz_m * weight_n / buoyancy_n
    } else {
        0.0
    };
    let [x, y, z, phi, theta, psi] = rig.tank.start_pose;
    let changed = vec![format!(
        "each thruster is a link of {LINK_MASS_KG} kg, which the base gives away: all links together have the rig's mass, centre of gravity and inertia"
    )];
    Ok(Body {
        name: rig.name.clone(),
        start: [x, -y, -z, phi, -theta, -psi],
        mass_kg,
        centre_m: centre.into(),
        inertia_kgm2: [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)].map(|p| inertia[p]),
        link: (LINK_MASS_KG, LINK_INERTIA_KGM2),
        added,
        linear,
        quadratic,
        volume_m3: buoyancy_n / (v.gravity_mps2 * DENSITY_KGPM3),
        buoyancy_m: turned([0.0, 0.0, arm_m]),
        gravity_mps2: v.gravity_mps2,
        jets,
        held,
        lost,
        changed,
    })
}
