use super::*;
use crate::fixture::lshpi_rig;
use hydroline_rigs::ThrustCurve;
use proptest::prelude::*;

proptest! {
    #[test]
    fn a_small_wrench_is_made_exactly_and_with_least_norm(w in proptest::array::uniform6(-3.0..3.0f64), null in -1.0..1.0f64) {
        let a = Allocation::new(&lshpi_rig().thrusters).unwrap();
        let made = a.allocate(&Wrench::from_array(w)).unwrap();
        prop_assert!(made.saturated.is_empty());
        for (got, asked) in made.wrench.to_array().iter().zip(w) {
            prop_assert!((got - asked).abs() < 1e-9);
        }
        // Any other solution (add a null-space vector) costs more.
        let projector = DMatrix::identity(a.len(), a.len()) - &a.inverse * &a.matrix;
        let other = DVector::from_column_slice(&made.thrust_n) + projector.column(0) * null;
        prop_assert!(other.norm() + 1e-12 >= DVector::from_column_slice(&made.thrust_n).norm());
    }
}

#[test]
fn a_layout_that_does_not_span_says_which_dof() {
    let mut set = lshpi_rig().thrusters;
    set.thrusters.retain(|t| t.direction[2] == 0.0); // no vertical thrusters left
    let a = Allocation::new(&set).unwrap();
    assert!(
        a.allocate(&Wrench {
            surge_n: 4.0,
            ..Wrench::default()
        })
        .is_ok()
    );
    let error = a
        .allocate(&Wrench {
            heave_n: 4.0,
            ..Wrench::default()
        })
        .unwrap_err();
    assert!(
        matches!(
            error,
            ThrustError::NotSpanned {
                dof: "heave",
                asked: 4.0,
                ..
            }
        ),
        "{error}"
    );
}

#[test]
fn saturation_is_cut_and_reported() {
    let a = Allocation::new(&lshpi_rig().thrusters).unwrap();
    let made = a
        .allocate(&Wrench {
            surge_n: -500.0,
            ..Wrench::default()
        })
        .unwrap();
    assert_eq!(made.saturated.len(), 4, "all four horizontal thrusters");
    assert!(
        made.saturated
            .iter()
            .all(|s| s.limit_n == -39.9 || s.limit_n == 51.5)
    );
    assert!(made.wrench.surge_n > -500.0);
}

#[test]
fn pulses_go_to_thrusts_and_back() {
    let a = Allocation::new(&lshpi_rig().thrusters).unwrap();
    let made = a
        .allocate(&Wrench {
            surge_n: 8.0,
            yaw_nm: 0.5,
            ..Wrench::default()
        })
        .unwrap();
    let pulses = a.pulses_of_thrusts(&made.thrust_n).unwrap();
    let back = a.thrusts_of_pulses(&pulses).unwrap();
    for (x, y) in back.iter().zip(&made.thrust_n) {
        assert!((x - y).abs() < 1e-9);
    }
    assert!(matches!(
        a.wrench(&[1.0]),
        Err(ThrustError::Count {
            given: 1,
            thrusters: 8
        })
    ));
    assert!(matches!(
        a.thrusts_of_pulses(&[f64::NAN; 8]),
        Err(ThrustError::NotFinite { .. })
    ));
}

impl Allocation {
    /// Pulses \[us\] for given thrusts \[N\], within the rig's pulse range.
    ///
    /// # Errors
    /// [`ThrustError::Count`], [`ThrustError::NotFinite`].
    pub(crate) fn pulses_of_thrusts(&self, thrust_n: &[f64]) -> Result<Vec<f64>, ThrustError> {
        self.count(thrust_n)?;
        let set = &self.set;
        // Beyond the curve the end's pulse; the rig's range holds in any case.
        let pulse = |curve: &ThrustCurve, x: f64| {
            let ends = |p: Option<&(f64, f64)>| p.map_or(0.0, |p| p.1);
            let reached = x.clamp(ends(curve.points.first()), ends(curve.points.last()));
            let pulse_us = curve.pulse_us(reached, set.neutral_us);
            pulse_us
                .unwrap_or(set.neutral_us)
                .clamp(set.min_us, set.max_us)
        };
        Ok(set
            .thrusters
            .iter()
            .zip(thrust_n)
            .map(|(t, &x)| pulse(&t.curve, x))
            .collect())
    }
}
