//! `[[physics]]` entries: which effects are switched on, with their parameters.
//!
//! This crate does not know the effects; the `sim` crate checks ids, parameter
//! names and ranges when it builds the effect.

/// A parameter as typed.
#[derive(Debug, Clone, PartialEq)]
pub enum ParameterValue {
    /// A number in the unit its name carries.
    Number(f64),
    /// A word, e.g. `dof = "surge"`.
    Word(String),
}

/// One switched-on effect.
#[derive(Debug, Clone, PartialEq)]
pub struct PhysicsEntry {
    /// Effect id, e.g. `thruster_lag`.
    pub effect: String,
    /// Parameters by name, in the order typed.
    pub parameters: Vec<(String, ParameterValue)>,
}
