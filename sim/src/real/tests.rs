//! The laws run on a dual number: exact sensitivities, also with respect to a delay.

use super::*;
use crate::effect::check;
use crate::fixture::lshpi_rig;
use crate::model::{Model, ModelState};
use crate::trajectory::Trajectory;
use crate::vehicle::Hydrodynamics;
use hydroline_rigs::{ParameterValue, PhysicsEntry};

/// value + derivative * epsilon, epsilon^2 = 0.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Dual(f64, f64);

impl PartialOrd for Dual {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        self.0.partial_cmp(&other.0)
    }
}
impl Add for Dual {
    type Output = Dual;
    fn add(self, o: Dual) -> Dual {
        Dual(self.0 + o.0, self.1 + o.1)
    }
}
impl Sub for Dual {
    type Output = Dual;
    fn sub(self, o: Dual) -> Dual {
        Dual(self.0 - o.0, self.1 - o.1)
    }
}
impl Mul for Dual {
    type Output = Dual;
    fn mul(self, o: Dual) -> Dual {
        Dual(self.0 * o.0, self.1 * o.0 + self.0 * o.1)
    }
}
impl Div for Dual {
    type Output = Dual;
    fn div(self, o: Dual) -> Dual {
        Dual(self.0 / o.0, (self.1 * o.0 - self.0 * o.1) / (o.0 * o.0))
    }
}
impl Neg for Dual {
    type Output = Dual;
    fn neg(self) -> Dual {
        Dual(-self.0, -self.1)
    }
}
impl Mul<f64> for Dual {
    type Output = Dual;
    fn mul(self, o: f64) -> Dual {
        Dual(self.0 * o, self.1 * o)
    }
}
impl Real for Dual {
    fn from_f64(value: f64) -> Self {
        Dual(value, 0.0)
    }
    fn value(self) -> f64 {
        self.0
    }
    fn sin(self) -> Self {
        Dual(self.0.sin(), self.1 * self.0.cos())
    }
    fn cos(self) -> Self {
        Dual(self.0.cos(), -self.1 * self.0.sin())
    }
    fn exp(self) -> Self {
        Dual(self.0.exp(), self.1 * self.0.exp())
    }
    fn ln(self) -> Self {
        Dual(self.0.ln(), self.1 / self.0)
    }
    fn sqrt(self) -> Self {
        Dual(self.0.sqrt(), self.1 / (2.0 * self.0.sqrt()))
    }
    fn tanh(self) -> Self {
        let t = self.0.tanh();
        Dual(t, self.1 * (1.0 - t * t))
    }
}

/// x after 6.3 s of surge with reversals under lag, asymmetry and current; every input moved by its `shift`.
fn x_end<T: Real>(lag_s: T, reverse_gain: T, vx_mps: T, x_u: T, delay_s: T) -> T {
    let entry = |effect: &str, name: &str, value: f64| PhysicsEntry {
        effect: effect.into(),
        parameters: vec![(name.into(), ParameterValue::Number(value))],
    };
    let effects = check(&[
        entry("thruster_lag", "lag_s", lag_s.value()),
        entry("thrust_asymmetry", "reverse_gain", reverse_gain.value()),
        entry("current", "vx_mps", vx_mps.value()),
    ])
    .unwrap();
    let lifted = [lag_s, reverse_gain, vx_mps];
    let mut hydrodynamics = Hydrodynamics::<T>::new(&lshpi_rig().vehicle);
    hydrodynamics.linear[0] = x_u;
    let lift = |e: usize, p: usize, v: f64| if p == 0 { lifted[e] } else { T::from_f64(v) };
    let model = Model::assemble(hydrodynamics, &effects, lift).unwrap();
    let start = ModelState::at_rest([T::zero(); 6]);
    let mut run = Trajectory::new(model, start, 0.005).unwrap();
    for (k, x_n) in [8.0, -6.0, 4.0, -8.0].into_iter().enumerate() {
        let mut wrench = [T::zero(); 6];
        wrench[0] = T::from_f64(x_n);
        run.command(T::from_f64(1.5 * k as f64) + delay_s, wrench)
            .unwrap();
    }
    run.state_at(T::from_f64(6.3)).unwrap().vehicle.eta[0]
}

#[test]
fn sensitivities_are_exact_also_to_a_delay_on_a_grid_point() {
    // 0.1 s: every command edge falls on the integrator's grid, the case where splitting matters most.
    let at = [0.3, 0.85, 0.01, -20.0, 0.1];
    for which in 0..5 {
        let dual: [Dual; 5] = std::array::from_fn(|i| Dual(at[i], f64::from(i == which)));
        let exact = x_end(dual[0], dual[1], dual[2], dual[3], dual[4]).1;
        let shifted = |h: f64| {
            let mut p = at;
            p[which] += h;
            x_end(p[0], p[1], p[2], p[3], p[4])
        };
        let h = 1e-4 * at[which].abs();
        let numeric = (shifted(h) - shifted(-h)) / (2.0 * h);
        assert!(exact.abs() > 1e-6, "input {which} matters");
        assert!(
            (exact / numeric - 1.0).abs() < 1e-4,
            "input {which}: {exact} against {numeric}"
        );
    }
}
