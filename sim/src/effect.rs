//! The mechanism of `[[physics]]`: effects that a model may leave out.
//!
//! **One effect is one file** under `effect/`: its [`EffectInfo`] (id, law in words,
//! parameters with unit, range and default, stage, order, confusable, source) and its law in
//! code, a type generic over [`Real`](crate::Real) that implements [`Law`]. The registry
//! (`effect/registry.rs`) holds one line per effect, this file its `mod` line; no other code names an effect.
//!
//! How the generic laws are stored: [`Law<T>`] is object-safe for each fixed `T`, so a
//! stack is a `Vec<Box<dyn Law<T>>>`; only the constructor must be generic over `T`, and
//! the registry's macro writes that `match`. `f64` stacks simulate, dual stacks give
//! exact sensitivities to effect parameters, from the same law.
//!
//! Adding one: write `effect/<id>.rs` with `INFO` and `pub(super) fn law`, its `mod` line here, its line in the
//! registry and its row in theory/physics.md; `cargo test -p hydroline-sim` names what is missing. The guide's chapter
//! adding-an-effect.md goes through it. (The registry's macro could write the `mod` lines, but rustfmt does not look into
//! modules that a macro declares.)

mod added_mass_coupling;
mod advance_loss;
mod ambient_gradient;
mod astern_drag;
mod attenuation;
mod attitude_disturbance;
mod backscatter_haze;
mod battery_sag;
mod board_offset;
mod brightness;
mod camera_latency;
mod camera_shift;
mod check;
mod clock_drift;
mod command_latency;
mod constant_force;
mod coulomb_friction;
pub mod covariate_table;
mod cross_flow_coupling;
mod cubic_damping;
mod current;
mod error;
mod fin_force;
mod floor_slope;
mod fluid_memory;
pub mod form;
pub mod free_force;
mod image_saturation;
mod info;
mod interlace;
mod laser_cone;
mod laser_plane_tilt;
mod law;
mod lens_distortion;
mod lens_shading;
mod lift_damping;
mod line_profile;
mod linear_damping;
mod mains_banding;
mod nonlinear_restoring;
mod optics;
mod position_scale;
mod quadratic_damping;
mod range_clipping;
mod refraction;
mod registry;
mod rolling_shutter;
mod seiche;
mod shaft_thrust;
mod speckle;
mod stack;
mod table;
mod target_scale;
mod tether_spring;
mod thrust_asymmetry;
mod thrust_line_offset;
mod thrust_scale;
mod thruster_deadband;
mod thruster_lag;
mod thruster_saturation;
mod tone_curve;
mod varying;
mod wall_added_mass;
mod wave_force;
pub mod written_force;

pub use brightness::Brightness;
pub use check::{CheckedEffect, Trend, check};
pub use error::EffectError;
pub use info::{EffectInfo, ParameterInfo, Stage, WordInfo};
pub use law::{Law, Moment, Values};
pub use optics::Optics;
pub use registry::{ALL, find};
pub use stack::EffectStack;
pub use table::markdown_table;

#[cfg(test)]
mod tests;
