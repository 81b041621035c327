//! The mechanism of `[[physics]]`: effects that a model may leave out.
//!
//! **One effect is one file** under `effect/`: its [`EffectInfo`] (id, law in words,
//! parameters with unit, range and default, stage, order, kin, source) and its law in
//! code, a type generic over [`Real`](crate::Real) that implements [`Law`]. The registry
//! (`effect/registry.rs`) holds one line per effect; nothing else names an effect.
//!
//! How the generic laws are stored: [`Law<T>`] is object-safe for each fixed `T`, so a
//! stack is a `Vec<Box<dyn Law<T>>>`; only the constructor must be generic over `T`, and
//! the registry's macro writes that `match`. `f64` stacks simulate, dual stacks give
//! exact sensitivities to effect parameters, from the same law.
//!
//! Adding one: write `effect/<id>.rs` with `INFO` and `pub(super) fn law`, add its line.

mod check;
mod current;
mod error;
mod info;
mod law;
mod optics;
mod registry;
mod stack;
mod thrust_asymmetry;
mod thruster_deadband;
mod thruster_lag;

pub use check::{CheckedEffect, check};
pub use error::EffectError;
pub use info::{EffectInfo, ParameterInfo, Stage, WordInfo};
pub use law::{Law, Moment, Values};
pub use optics::Optics;
pub use registry::{ALL, find};
pub use stack::EffectStack;

#[cfg(test)]
mod tests;
