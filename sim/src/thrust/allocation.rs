//! Wrench to thrusters by the minimum-norm pseudo-inverse (Fossen 2011, 12.3.2), and back.

use super::ThrustError;
use hydroline_rigs::{Dof, ThrusterSet, Wrench};
use nalgebra::{DMatrix, DVector};

/// A load above this share of the asked wrench that stays unmade counts as "not spanned".
const SPAN_TOLERANCE: f64 = 1e-6;

/// A thruster asked for more than its curve has.
#[derive(Debug, Clone, PartialEq)]
pub struct Saturation {
    /// Name of the thruster.
    pub thruster: String,
    /// Thrust asked \[N\].
    pub asked_n: f64,
    /// Thrust it gives \[N\].
    pub limit_n: f64,
}

/// Result of an allocation.
#[derive(Debug, Clone, PartialEq)]
pub struct Allocated {
    /// Thrust per thruster \[N\], rig order, within the curves.
    pub thrust_n: Vec<f64>,
    /// Thrusters that were cut; empty = the wrench is made exactly.
    pub saturated: Vec<Saturation>,
    /// Wrench really made.
    pub wrench: Wrench,
}

/// Geometry and curves of all thrusters, ready to use.
#[derive(Debug, Clone)]
pub struct Allocation {
    set: ThrusterSet,
    /// 6 x n: wrench per newton.
    matrix: DMatrix<f64>,
    /// n x 6, minimum norm.
    inverse: DMatrix<f64>,
}

impl Allocation {
    /// Prepares a layout. Any number of thrusters; which DOFs they span shows on use.
    ///
    /// # Errors
    /// [`ThrustError::Curve`], [`ThrustError::NotFinite`], [`ThrustError::Singular`].
    pub fn new(set: &ThrusterSet) -> Result<Self, ThrustError> {
        let n = set.thrusters.len();
        for t in &set.thrusters {
            let points = &t.curve.points;
            if points.len() < 2
                || points
                    .windows(2)
                    .any(|w| w[0].0 >= w[1].0 || w[0].1 > w[1].1)
            {
                return Err(ThrustError::Curve {
                    thruster: t.name.clone(),
                    points: points.len(),
                });
            }
            for v in t.position_m.iter().chain(&t.direction) {
                finite(|| format!("thruster {}: position or direction", t.name), *v)?;
            }
        }
        let matrix = DMatrix::from_fn(6, n, |row, col| {
            let t = &set.thrusters[col];
            let (r, d) = (t.position_m, t.direction);
            match row {
                0..3 => d[row],
                // M = r x F
                3 => r[1] * d[2] - r[2] * d[1],
                4 => r[2] * d[0] - r[0] * d[2],
                _ => r[0] * d[1] - r[1] * d[0],
            }
        });
        let inverse = if n == 0 {
            DMatrix::zeros(0, 6)
        } else {
            matrix
                .clone()
                .pseudo_inverse(1e-9)
                .map_err(|reason| ThrustError::Singular {
                    thrusters: n,
                    reason,
                })?
        };
        Ok(Allocation {
            set: set.clone(),
            matrix,
            inverse,
        })
    }

    /// Number of thrusters.
    pub fn len(&self) -> usize {
        self.set.thrusters.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.set.thrusters.is_empty()
    }

    /// Thrusts of least norm that make `wrench`; cut to the curves, each cut reported.
    ///
    /// # Errors
    /// [`ThrustError::NotSpanned`] when the layout cannot make a component, [`ThrustError::NotFinite`].
    pub fn allocate(&self, wrench: &Wrench) -> Result<Allocated, ThrustError> {
        let asked = wrench.to_array();
        for (dof, v) in Dof::ALL.iter().zip(asked) {
            finite(|| format!("commanded {}", dof.name()), v)?;
        }
        let asked_vector = DVector::from_column_slice(&asked);
        let free = &self.inverse * &asked_vector;
        let reached = &self.matrix * &free;
        let size = asked_vector.amax();
        for (i, dof) in Dof::ALL.iter().enumerate() {
            if (reached[i] - asked[i]).abs() > SPAN_TOLERANCE * size {
                return Err(ThrustError::NotSpanned {
                    dof: dof.name(),
                    asked: asked[i],
                    reached: reached[i],
                });
            }
        }
        let mut saturated = Vec::new();
        let mut thrust_n = Vec::with_capacity(self.len());
        for (thruster, &asked_n) in self.set.thrusters.iter().zip(free.iter()) {
            let limit_n = asked_n.clamp(
                thruster.curve.thrust_n(self.set.min_us),
                thruster.curve.thrust_n(self.set.max_us),
            );
            if limit_n != asked_n {
                saturated.push(Saturation {
                    thruster: thruster.name.clone(),
                    asked_n,
                    limit_n,
                });
            }
            thrust_n.push(limit_n);
        }
        let wrench = self.wrench(&thrust_n)?;
        Ok(Allocated {
            thrust_n,
            saturated,
            wrench,
        })
    }

    /// Wrench of given thrusts \[N\], one per thruster.
    ///
    /// # Errors
    /// [`ThrustError::Count`], [`ThrustError::NotFinite`].
    pub fn wrench(&self, thrust_n: &[f64]) -> Result<Wrench, ThrustError> {
        self.count(thrust_n)?;
        let w = &self.matrix * DVector::from_column_slice(thrust_n);
        Ok(Wrench::from_array([w[0], w[1], w[2], w[3], w[4], w[5]]))
    }

    /// Thrusts \[N\] of given pulses \[us\], cut to the rig's pulse range as its controller would.
    ///
    /// # Errors
    /// [`ThrustError::Count`], [`ThrustError::NotFinite`].
    pub fn thrusts_of_pulses(&self, pulses_us: &[f64]) -> Result<Vec<f64>, ThrustError> {
        self.count(pulses_us)?;
        let cut = |p: f64| p.clamp(self.set.min_us, self.set.max_us);
        Ok(self
            .set
            .thrusters
            .iter()
            .zip(pulses_us)
            .map(|(t, &p)| t.curve.thrust_n(cut(p)))
            .collect())
    }

    fn count(&self, values: &[f64]) -> Result<(), ThrustError> {
        if values.len() != self.len() {
            return Err(ThrustError::Count {
                given: values.len(),
                thrusters: self.len(),
            });
        }
        for (t, &v) in self.set.thrusters.iter().zip(values) {
            finite(|| format!("thruster {}", t.name), v)?;
        }
        Ok(())
    }
}

fn finite(what: impl Fn() -> String, value: f64) -> Result<(), ThrustError> {
    if value.is_finite() {
        Ok(())
    } else {
        Err(ThrustError::NotFinite {
            what: what(),
            value,
        })
    }
}

#[cfg(test)]
mod tests;
