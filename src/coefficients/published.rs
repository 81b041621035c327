//! Published vehicles whose primed numbers have dimensional ones beside them: the conversions give the one from the other, to
//! the digits that are printed.

use super::dimension::{Load, Motion};
use super::froude::Scale;
use super::{Dimension, Particulars, Prime};
use nalgebra::Matrix6;

const FORCE_BY_ACCELERATION: Dimension = Dimension::MASS;

fn coupling() -> Dimension {
    Dimension::derivative(Load::Force, &[Motion::RateOfRate])
}

/// NPS AUV II: Healey, A. J. and Lienard, D. (1993), IEEE J. Oceanic Eng. 18(3):327-339, as in MSS, `npsauv.m` (Fossen and
/// Lauvdal): derivatives in prime system I, L = 5.3 m, rho = 1000 kg/m3, and beside them the inverse of the dimensional mass
/// matrix, printed to four digits.
#[test]
fn nps_auv_ii_has_the_mass_matrix_that_is_printed_beside_its_primed_derivatives() {
    let units = Prime::I
        .units(&Particulars {
            speed_mps: Some(1.0),
            ..Particulars::of_length(5.3)
        })
        .unwrap();
    let (force, cross, moment) = (
        units.of(FORCE_BY_ACCELERATION),
        units.of(coupling()),
        units.of(Dimension::INERTIA),
    );
    let (m, z_g) = (5454.54, 0.061);
    let [ix, iy, iz] = [2038.0, 13587.0, 13587.0];
    let product = -13.58;
    let [x_udot, y_vdot, z_wdot] = [-7.6e-3, -5.5e-2, -2.4e-1].map(|d| force * d);
    let [y_pdot, y_rdot, z_qdot] = [1.2e-4, 1.2e-3, -6.8e-3].map(|d| cross * d);
    let [k_vdot, m_wdot, n_vdot] = [1.2e-4, -6.8e-3, 1.2e-3].map(|d| cross * d);
    let [k_pdot, k_rdot] = [-1.0e-3, -3.4e-5].map(|d| moment * d);
    let m_qdot = moment * -1.7e-2;
    let [n_pdot, n_rdot] = [-3.4e-5, -3.4e-3].map(|d| moment * d);
    #[rustfmt::skip]
    let mass = Matrix6::new(
        m - x_udot, 0.0, 0.0, 0.0, m * z_g, 0.0,
        0.0, m - y_vdot, 0.0, -m * z_g - y_pdot, 0.0, -y_rdot,
        0.0, 0.0, m - z_wdot, 0.0, -z_qdot, 0.0,
        0.0, -m * z_g - k_vdot, 0.0, ix - k_pdot, -product, -product - k_rdot,
        m * z_g, 0.0, -m_wdot, -product, iy - m_qdot, -product,
        0.0, -n_vdot, 0.0, -product - n_pdot, -product, iz - n_rdot,
    );
    #[rustfmt::skip]
    let printed = [
        (0, 0, 1.662e-4), (1, 1, 1.052e-4), (2, 2, 4.315e-5),
        (3, 3, 2.431e-4), (4, 4, 2.049e-5), (5, 5, 4.838e-5),
        (0, 4, -1.132e-6), (1, 3, 9.638e-6), (1, 5, 2.368e-6), (2, 4, -2.357e-6),
    ];
    let inverse = mass.try_inverse().unwrap();
    for (i, j, value) in printed {
        let off = (inverse[(i, j)] / value - 1.0).abs();
        println!("{i} {j}: {:.4e} printed {value:.3e}", inverse[(i, j)]);
        // Half of the last of four digits.
        let digit = 10f64.powi(f64::log10(f64::abs(value)).floor() as i32 - 3);
        assert!(
            (inverse[(i, j)] - value).abs() <= 0.5 * digit,
            "{i} {j}: {off:.1e}"
        );
    }
}

/// Container ship of 175 m: Son, K. and Nomoto, K. (1982), as in MSS, `container.m`: m' = 0.00792 in prime system I beside a
/// displaced volume of 21222 m3.
#[test]
fn the_container_ship_has_the_displacement_of_its_primed_mass() {
    let hull = Particulars {
        speed_mps: Some(7.0),
        density_kgpm3: 1025.0,
        ..Particulars::of_length(175.0)
    };
    let units = Prime::I.units(&hull).unwrap();
    let primed = 1025.0 * 21222.0 / units.of(Dimension::MASS);
    assert_eq!(format!("{primed:.5}"), "0.00792");
}

/// The same ship: the linear model of MSS, `Lcontainer.m` (Fossen), prints the primed stiffness of roll at 7 m/s, 0.0004966. That is
/// the restoring moment rho g nabla GM of GM = 0.3 m in the particulars of `container.m`, less its K_phi' = -0.000021; within one of its
/// last digit.
#[test]
fn the_container_ship_has_the_restoring_moment_that_its_linear_model_prints() {
    let hull = Particulars {
        speed_mps: Some(7.0),
        density_kgpm3: 1025.0,
        ..Particulars::of_length(175.0)
    };
    let units = Prime::I.units(&hull).unwrap();
    let moment = units.of(Dimension::derivative(Load::Moment, &[]));
    let primed = 1025.0 * 9.81 * 21222.0 * 0.3 / moment + 0.000021;
    assert!((primed - 0.0004966).abs() < 1e-7, "{primed}");
}

/// KVLCC2: Yasukawa, H. and Yoshimura, Y. (2015), J. Mar. Sci. Technol. 20:37-52, principal particulars of the ship (SIMMAN's list;
/// displacement 312622 m3) and of the model of 7 m beside it: lengths, displaced volume, speed.
#[test]
fn kvlcc2_at_7_metres_is_the_ship_by_froudes_law() {
    let scale = Scale::by(7.0 / 320.0);
    let length = Dimension {
        mass: 0,
        length: 1,
        time: 0,
    };
    let volume = Dimension {
        length: 3,
        ..Dimension::NONE
    };
    let speed = Dimension { time: -1, ..length };
    let knot_mps = 1852.0 / 3600.0;
    for (ship, dimension, printed, half_digit) in [
        (58.0, length, 1.27, 0.005),
        (20.8, length, 0.46, 0.005),
        (312_622.0, volume, 3.27, 0.005),
        (15.5 * knot_mps, speed, 1.179, 0.0005),
    ] {
        let model = ship * scale.of(dimension);
        assert!(
            (model - printed).abs() <= half_digit + 1e-9,
            "{model} {printed}"
        );
    }
}

/// Supply vessel of 76.2 m: Fossen, Sagatun and Soerensen (1996), Control Eng. Practice 4(3):369-376, in the bis system (MSS,
/// `supply.m`, L = 76.2 m, m = 6000 t, g = 9.8 m/s2): the file's own similarity, m T^-2 (sqrt(g/L) T D T^-1) with T = diag(1, 1, 1/L),
/// written out by hand beside ours.
#[test]
fn the_supply_vessel_in_bis_is_that_of_its_own_similarity() {
    let hull = Particulars {
        mass_kg: Some(6.0e6),
        gravity_mps2: 9.8,
        ..Particulars::of_length(76.2)
    };
    let units = Prime::Bis.units(&hull).unwrap();
    let by = |load, motion: &[Motion]| units.of(Dimension::derivative(load, motion));
    let root = (9.8f64 / 76.2).sqrt();
    for (ours, by_hand) in [
        (by(Load::Force, &[Motion::Acceleration]), 6.0e6),
        (by(Load::Force, &[Motion::RateOfRate]), 6.0e6 * 76.2),
        (by(Load::Moment, &[Motion::RateOfRate]), 6.0e6 * 76.2 * 76.2),
        (by(Load::Force, &[Motion::Velocity]), 6.0e6 * root),
        (
            by(Load::Moment, &[Motion::Rate]),
            6.0e6 * root * 76.2 * 76.2,
        ),
    ] {
        assert!((ours / by_hand - 1.0).abs() < 1e-12, "{ours} {by_hand}");
    }
}
