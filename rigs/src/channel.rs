//! The twelve channels of a vehicle's motion, and arrays that are indexed by them.

use std::collections::BTreeMap;
use std::ops::{Deref, DerefMut, Index, IndexMut};

use crate::Dof;

/// A measured channel: the pose of a DOF in the tank frame, or its rate in the body frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[allow(missing_docs, reason = "SNAME's own letters")]
pub enum Channel {
    X,
    Y,
    Z,
    Phi,
    Theta,
    Psi,
    U,
    V,
    W,
    P,
    Q,
    R,
}

use Channel::{P, Phi, Psi, Q, R, Theta, U, V, W, X, Y, Z};

impl Channel {
    /// All twelve: poses, then rates, each in the order of [`Dof`].
    pub const ALL: [Channel; 12] = [X, Y, Z, Phi, Theta, Psi, U, V, W, P, Q, R];
    /// Pose of each DOF, in the order of [`Dof`].
    pub const POSES: [Channel; 6] = [X, Y, Z, Phi, Theta, Psi];
    /// Rate of each DOF, in the order of [`Dof`].
    pub const RATES: [Channel; 6] = [U, V, W, P, Q, R];

    /// Pose and rate of a DOF, by its place in SNAME order.
    pub fn of(dof: usize) -> [Channel; 2] {
        [Channel::POSES[dof], Channel::RATES[dof]]
    }

    /// Name in logs, tables and JSON, which ends in the unit.
    pub fn name(self) -> &'static str {
        match self {
            X => "x_m",
            Y => "y_m",
            Z => "z_m",
            Phi => "phi_rad",
            Theta => "theta_rad",
            Psi => "psi_rad",
            U => "u_mps",
            V => "v_mps",
            W => "w_mps",
            P => "p_radps",
            Q => "q_radps",
            R => "r_radps",
        }
    }

    /// The channel of this name.
    pub fn named(name: &str) -> Option<Channel> {
        Channel::ALL.into_iter().find(|c| c.name() == name)
    }

    /// Unit of its values, SI.
    pub fn unit(self) -> &'static str {
        match (self.is_rate(), self.is_angular()) {
            (false, false) => "m",
            (false, true) => "rad",
            (true, false) => "m/s",
            (true, true) => "rad/s",
        }
    }

    /// Place among [`Channel::ALL`], 0..12.
    pub fn index(self) -> usize {
        self as usize
    }

    /// DOF that it belongs to.
    pub fn dof(self) -> Dof {
        Dof::ALL[self.index() % 6]
    }

    /// A rate in the body frame, not a pose in the tank frame.
    pub fn is_rate(self) -> bool {
        self >= U
    }

    /// An angle or its rate, not a position or a velocity.
    pub fn is_angular(self) -> bool {
        self.dof() >= Dof::Roll
    }
}

/// One value per channel.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, serde::Serialize)]
#[serde(transparent)]
pub struct PerChannel<T>([T; 12]);

impl<T> PerChannel<T> {
    /// The value of each channel by a function.
    pub fn from_fn(mut of: impl FnMut(Channel) -> T) -> PerChannel<T> {
        PerChannel(Channel::ALL.map(&mut of))
    }

    /// Poses and rates, each in the order of [`Dof`].
    pub fn of_state([x, y, z, phi, theta, psi]: [T; 6], [u, v, w, p, q, r]: [T; 6]) -> Self {
        PerChannel([x, y, z, phi, theta, psi, u, v, w, p, q, r])
    }

    /// Every value through a function.
    pub fn map<S>(self, of: impl FnMut(T) -> S) -> PerChannel<S> {
        PerChannel(self.0.map(of))
    }

    /// The values, in the order of [`Channel::ALL`].
    pub fn into_array(self) -> [T; 12] {
        self.0
    }

    /// Channels with their values.
    pub fn each(&self) -> impl Iterator<Item = (Channel, &T)> {
        Channel::ALL.into_iter().zip(&self.0)
    }
}

impl<T: Copy> PerChannel<T> {
    /// The same value for each.
    pub fn splat(value: T) -> PerChannel<T> {
        PerChannel([value; 12])
    }

    /// The pose.
    pub fn pose(&self) -> [T; 6] {
        Channel::POSES.map(|c| self[c])
    }

    /// The rates.
    pub fn rates(&self) -> [T; 6] {
        Channel::RATES.map(|c| self[c])
    }
}

impl PerChannel<f64> {
    /// NaN in every channel: no measurement.
    pub const NAN: PerChannel<f64> = PerChannel([f64::NAN; 12]);

    /// Finite values by the channel's name in logs, as `--json` prints them; NaN is left out.
    pub fn by_name(&self) -> BTreeMap<String, f64> {
        let finite = self.each().filter(|(_, v)| v.is_finite());
        finite.map(|(c, v)| (c.name().to_owned(), *v)).collect()
    }
}

impl<T> From<[T; 12]> for PerChannel<T> {
    fn from(values: [T; 12]) -> PerChannel<T> {
        PerChannel(values)
    }
}

impl<T> Index<Channel> for PerChannel<T> {
    type Output = T;

    fn index(&self, channel: Channel) -> &T {
        &self.0[channel.index()]
    }
}

impl<T> IndexMut<Channel> for PerChannel<T> {
    fn index_mut(&mut self, channel: Channel) -> &mut T {
        &mut self.0[channel.index()]
    }
}

impl<T> Deref for PerChannel<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        &self.0
    }
}

impl<T> DerefMut for PerChannel<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        &mut self.0
    }
}

impl<T> IntoIterator for PerChannel<T> {
    type Item = T;
    type IntoIter = std::array::IntoIter<T, 12>;

    fn into_iter(self) -> Self::IntoIter {
        self.0.into_iter()
    }
}

impl<'a, T> IntoIterator for &'a PerChannel<T> {
    type Item = &'a T;
    type IntoIter = std::slice::Iter<'a, T>;

    fn into_iter(self) -> Self::IntoIter {
        self.0.iter()
    }
}

impl<'a, T> IntoIterator for &'a mut PerChannel<T> {
    type Item = &'a mut T;
    type IntoIter = std::slice::IterMut<'a, T>;

    fn into_iter(self) -> Self::IntoIter {
        self.0.iter_mut()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_channel_is_a_dof_and_a_kind() {
        for (i, c) in Channel::ALL.into_iter().enumerate() {
            assert_eq!(c.index(), i);
            assert_eq!(Channel::of(c.dof().index())[usize::from(c.is_rate())], c);
            assert_eq!(Channel::named(c.name()), Some(c));
            let unit = c.unit().replace("/s", "ps");
            assert!(c.name().ends_with(&format!("_{unit}")), "{}", c.name());
        }
    }
}
