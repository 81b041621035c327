//! Orientation from quaternions, and velocities from the tank's frame to the body's.

use crate::map::Axes;

/// Largest distance of a quaternion's length from 1 that rounding explains.
const LENGTH_TOLERANCE: f64 = 0.01;

/// φ, θ, ψ of a quaternion body to tank, order ZYX (Fossen 2011, eq. 2.75 ff.); `None` = its length is not 1.
pub(crate) fn euler([w, x, y, z]: [f64; 4], axes: Axes) -> Option<[f64; 3]> {
    let length = (w * w + x * x + y * y + z * z).sqrt();
    if length.is_nan() || (length - 1.0).abs() > LENGTH_TOLERANCE {
        return None;
    }
    let [w, x, y, z] = [w, x, y, z].map(|v| v / length);
    // The axis of the turn, along our axes: both frames are rotated about x together.
    let (y, z) = match axes {
        Axes::ZDown => (y, z),
        Axes::ZUp => (-y, -z),
        Axes::YUp => (z, -y),
    };
    Some([
        (2.0 * (w * x + y * z)).atan2(1.0 - 2.0 * (x * x + y * y)),
        (2.0 * (w * y - z * x)).clamp(-1.0, 1.0).asin(),
        (2.0 * (w * z + x * y)).atan2(1.0 - 2.0 * (y * y + z * z)),
    ])
}

/// Rows are the tank's axes, columns the body's: R(ψ) R(θ) R(φ) (Fossen 2011, eq. 2.18).
fn rotation([phi, theta, psi]: [f64; 3]) -> [[f64; 3]; 3] {
    let ((sp, cp), (st, ct), (ss, cs)) = (phi.sin_cos(), theta.sin_cos(), psi.sin_cos());
    [
        [cs * ct, cs * st * sp - ss * cp, cs * st * cp + ss * sp],
        [ss * ct, ss * st * sp + cs * cp, ss * st * cp - cs * sp],
        [-st, ct * sp, ct * cp],
    ]
}

/// A vector along the tank's axes, along the body's.
pub(crate) fn to_body(angles: [f64; 3], tank: [f64; 3]) -> [f64; 3] {
    let r = rotation(angles);
    std::array::from_fn(|j| (0..3).map(|i| r[i][j] * tank[i]).sum())
}

/// A vector along the body's axes, along the tank's.
pub(crate) fn to_tank(angles: [f64; 3], body: [f64; 3]) -> [f64; 3] {
    let r = rotation(angles);
    std::array::from_fn(|i| (0..3).map(|j| r[i][j] * body[j]).sum())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Half-angle product of the three turns.
    fn quaternion([phi, theta, psi]: [f64; 3]) -> [f64; 4] {
        let ((sp, cp), (st, ct), (ss, cs)) = (
            (phi / 2.0).sin_cos(),
            (theta / 2.0).sin_cos(),
            (psi / 2.0).sin_cos(),
        );
        [
            cp * ct * cs + sp * st * ss,
            sp * ct * cs - cp * st * ss,
            cp * st * cs + sp * ct * ss,
            cp * ct * ss - sp * st * cs,
        ]
    }

    proptest! {
        #[test]
        fn angles_come_back_from_their_quaternion(phi in -3.1..3.1_f64, theta in -1.5..1.5_f64, psi in -3.1..3.1_f64, flip: bool) {
            let q = quaternion([phi, theta, psi]).map(|v| if flip { -v } else { v });
            let back = euler(q, Axes::ZDown).unwrap();
            for (a, b) in back.iter().zip([phi, theta, psi]) {
                prop_assert!((a - b).abs() < 1e-9);
            }
            // Seen with z up, pitch and yaw have the other sign.
            let up = euler(quaternion([phi, -theta, -psi]), Axes::ZUp).unwrap();
            for (a, b) in up.iter().zip([phi, theta, psi]) {
                prop_assert!((a - b).abs() < 1e-9);
            }
            // With y up, our y is the file's z and our z the file's -y.
            let [w, x, y, z] = quaternion([phi, theta, psi]);
            let up = euler([w, x, -z, y], Axes::YUp).unwrap();
            for (a, b) in up.iter().zip([phi, theta, psi]) {
                prop_assert!((a - b).abs() < 1e-9);
            }
        }

        #[test]
        fn turning_there_and_back_is_nothing(a in prop::array::uniform3(-3.0..3.0_f64), v in prop::array::uniform3(-2.0..2.0_f64)) {
            let back = to_tank(a, to_body(a, v));
            for (x, y) in back.iter().zip(v) {
                prop_assert!((x - y).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn what_is_no_unit_quaternion_is_none() {
        assert_eq!(euler([0.0; 4], Axes::ZDown), None);
        assert_eq!(euler([f64::NAN, 0.0, 0.0, 1.0], Axes::ZDown), None);
        assert_eq!(euler([1.1, 0.0, 0.0, 0.0], Axes::ZDown), None);
        assert!(euler([0.999, 0.0, 0.0, 0.001], Axes::ZDown).is_some());
    }
}
