//! The forces of paper Eq. 1, one function per group of terms, and those of a hull that floats or weighs.

use super::{Hydrodynamics, Hydrostatics};
use crate::real::Real;
use crate::vehicle::kinematics::rotation;

/// Adds the Coriolis and centripetal terms of Eq. 1 (rigid body plus added mass) of the DOFs that are asked for \[N, N m\].
///
/// Eq. 1 holds them with `mass`, M_x = m - X_udot etc., e.g. surge (Z_wdot - m) w q + (m - Y_vdot) v r.
pub fn add_coriolis<T: Real>(
    h: &Hydrodynamics<T>,
    mass: &[T; 6],
    nu: &[T; 6],
    is_asked: &[bool; 6],
    force: &mut [T; 6],
) {
    let [u, v, w, p, q, r] = nu;
    let [mx, my, mz, ..] = mass;
    let [xu, yv, zw, kp, mq, nr] = &h.added;
    let [_, _, _, ix, iy, iz] = &h.rigid;
    for (i, force) in force.iter_mut().enumerate().filter(|(i, _)| is_asked[*i]) {
        let cross = match i {
            0 => *my * *v * *r - *mz * *w * *q,
            1 => *mz * *w * *p - *mx * *u * *r,
            2 => *mx * *u * *q - *my * *v * *p,
            3 => (*zw - *yv) * *w * *v + (*iy - *iz + *nr - *mq) * *r * *q,
            4 => (*xu - *zw) * *u * *w + (*iz - *ix + *kp - *nr) * *p * *r,
            _ => (*yv - *xu) * *v * *u + (*ix - *iy + *mq - *kp) * *p * *q,
        };
        *force = *force + cross;
    }
}

/// All of these terms by themselves \[N, N m\].
pub fn coriolis<T: Real>(h: &Hydrodynamics<T>, nu: &[T; 6]) -> [T; 6] {
    let mut force = [T::zero(); 6];
    add_coriolis(h, &h.mass(), nu, &[true; 6], &mut force);
    force
}

/// Linear and quadratic damping (X_u + X_u|u| |u|) u of the velocity through the water \[N, N m\].
pub fn damping<T: Real>(h: &Hydrodynamics<T>, nu_r: &[T; 6]) -> [T; 6] {
    std::array::from_fn(|i| (h.linear[i] + h.quadratic[i] * nu_r[i].abs()) * nu_r[i])
}

/// Restoring moments, W = B, of the sines of phi and theta: r_Bz m g tilt sin(phi) in roll, r_Bz m g sin(theta) in pitch (Eq. 1).
/// `tilt` = cos(theta), and 1 in the one-DOF roll equation, which knows no pitch.
pub fn restoring<T: Real>(h: &Hydrodynamics<T>, [sin_phi, sin_theta]: [T; 2], tilt: T) -> [T; 6] {
    let zero = T::zero();
    [
        zero,
        zero,
        zero,
        h.restoring_nm * tilt * sin_phi,
        h.restoring_nm * sin_theta,
        zero,
    ]
}

/// Net weight, and stiffness of the water about the place where the hull floats, upright \[N, N m\]: W - B - C_33 (z - z_0)
/// straight down at the CG, -C_44 phi in roll, -C_55 theta in pitch (Fossen 2011, 4.1 and 4.2).
///
/// Straight down is turned into the body, R^T (0, 0, 1), where the equations are coupled; else it acts in heave alone, which knows
/// no other angle.
pub fn hydrostatics<T: Real>(s: &Hydrostatics<T>, eta: &[T; 6], coupled: bool) -> [T; 6] {
    let (phi, theta) = (eta[3], eta[4]);
    let zero = T::zero();
    let down_n = s.net_weight_n - s.stiffness[0] * (eta[2] - s.float_z_m);
    let [x_n, y_n, z_n] = if coupled {
        let [_, _, down] = rotation(phi, theta, zero);
        down.map(|share| share * down_n)
    } else {
        [zero, zero, down_n]
    };
    [
        x_n,
        y_n,
        z_n,
        -(s.stiffness[1] * phi),
        -(s.stiffness[2] * theta),
        zero,
    ]
}

#[cfg(test)]
mod tests {
    use crate::effect::EffectStack;
    use crate::fixture::lshpi_rig;
    use crate::model::{Model, ModelState};
    use crate::trajectory::Trajectory;
    use crate::vehicle::Hydrodynamics;
    use hydroline_rigs::{Vehicle, VehicleModel};

    /// The paper's vehicle without damping, in six independent equations.
    fn frictionless() -> Vehicle {
        let mut vehicle = lshpi_rig().vehicle;
        vehicle.model = VehicleModel::Decoupled;
        for c in &mut vehicle.coefficients {
            (c.linear, c.quadratic) = (0.0, 0.0);
        }
        vehicle
    }

    fn model(vehicle: &Vehicle) -> Model {
        Model {
            hydrodynamics: Hydrodynamics::new(vehicle),
            effects: EffectStack::empty(),
        }
    }

    fn path(vehicle: &Vehicle, eta: [f64; 6]) -> Trajectory {
        Trajectory::new(model(vehicle), ModelState::at_rest(eta), 0.005).unwrap()
    }

    /// z - z_0 = a cos(sqrt(C_33 / (m - Z_wdot)) t); in roll both stiffnesses act, for a small angle.
    #[test]
    fn a_hull_that_floats_swings_at_its_natural_frequency() {
        let mut vehicle = frictionless();
        vehicle.stiffness = [900.0, 12.0, 20.0];
        vehicle.float_z_m = Some(-1.2);
        let h: Hydrodynamics = Hydrodynamics::new(&vehicle);
        let of_water = [900.0, 12.0 - h.restoring_nm, 20.0 - h.restoring_nm];
        let start = [0.0, 0.0, -1.19, 1e-3, -1e-3, 0.0];
        let mut swinging = path(&vehicle, start);
        let rest = [0.0, 0.0, -1.2, 0.0, 0.0, 0.0];
        for t_s in [0.4, 1.3, 5.0] {
            let state = swinging.state_at(t_s).unwrap().vehicle;
            for d in 2..5 {
                assert_eq!(h.stiffness(d), of_water[d - 2]);
                let turn = (h.stiffness(d) / h.mass()[d]).sqrt() * t_s;
                let away = (start[d] - rest[d]) * turn.cos();
                // The sine of a thousandth is its angle to a millionth.
                let off = (state.eta[d] - rest[d] - away).abs();
                assert!(
                    off < 1e-5 * (start[d] - rest[d]).abs(),
                    "{d} at {t_s}: {off}"
                );
            }
        }
        assert_eq!(h.stiffness(0), 0.0);
    }

    /// It falls at (W - B) / (m - Z_wdot), and where the hull is tilted along its own axes.
    #[test]
    fn what_weighs_more_than_its_water_falls() {
        let mut vehicle = frictionless();
        vehicle.net_weight_n = 25.0;
        let mass = model(&vehicle).hydrodynamics.mass();
        let fallen = path(&vehicle, [0.0; 6]).state_at(3.0).unwrap().vehicle;
        assert!((fallen.eta[2] - 0.5 * 25.0 / mass[2] * 9.0).abs() < 1e-9);
        assert_eq!([fallen.eta[0], fallen.eta[1]], [0.0; 2]);
        vehicle.model = VehicleModel::Eq1;
        let (phi, theta) = (0.3_f64, -0.2_f64);
        let tilted = ModelState::at_rest([0.0, 0.0, 0.0, phi, theta, 1.1]);
        let rate = model(&vehicle).rate(0.0, 0.0, &tilted, &[0.0; 6]).vehicle;
        // -g(eta) of Fossen 2011, eq. 4.6.
        let force = [
            -25.0 * theta.sin(),
            25.0 * theta.cos() * phi.sin(),
            25.0 * theta.cos() * phi.cos(),
        ];
        for d in 0..3 {
            assert!((rate.nu[d] * mass[d] - force[d]).abs() < 1e-12, "{d}");
        }
    }

    #[test]
    fn a_vehicle_that_says_nothing_of_it_moves_as_before_to_the_last_bit() {
        let vehicle = lshpi_rig().vehicle;
        let plain = model(&vehicle);
        assert_eq!(plain.hydrodynamics.hydrostatics, None);
        let mut zero = model(&vehicle);
        zero.hydrodynamics.hydrostatics = Some(crate::vehicle::Hydrostatics {
            net_weight_n: 0.0,
            stiffness: [0.0; 3],
            float_z_m: 0.0,
        });
        let mut state = ModelState::at_rest([0.1, 0.2, -0.8, 0.2, -0.1, 0.4]);
        state.vehicle.nu = [0.2, -0.1, 0.05, 0.1, -0.2, 0.3];
        let wrench = [8.0, -3.0, 2.0, 0.3, -0.4, 0.5];
        let rate = |model: &Model| model.rate(1.0, 1.0, &state, &wrench);
        assert_eq!(rate(&plain), rate(&zero));
    }
}
