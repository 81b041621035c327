//! Files for other programs.

mod casadi;
mod header;
mod mss;
mod python;

use hydroline_coefficients::regime::Range;
use hydroline_rigs::Rig;
use schemars::JsonSchema;
use serde::Serialize;

use super::lost::{Difference, Lost, differences, of_formulas, without};
use super::model::{Absent, ModelError, Written, written};

/// A language or a simulator.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Target {
    /// A Python function without dependencies.
    Python,
    /// A CasADi function, in Python.
    Casadi,
    /// A function for MATLAB and Octave in the form of the MSS toolbox.
    Mss,
}

impl Target {
    /// All of them.
    pub const ALL: [Target; 3] = [Target::Python, Target::Casadi, Target::Mss];

    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Target::Python => "python",
            Target::Casadi => "casadi",
            Target::Mss => "mss",
        }
    }
}

/// A written model.
#[derive(Debug, Clone, PartialEq)]
pub struct Export {
    /// Contents of the file.
    pub bytes: Vec<u8>,
    /// What the target cannot hold.
    pub lost: Vec<Lost>,
    /// By how far the motion of what was written is another one, over plans that fit the rig; empty where nothing is lost.
    pub differences: Vec<Difference>,
    /// Numbers that are not the rig's, with the reason.
    pub changed: Vec<String>,
}

/// Summary of a written model.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct Summary<'a> {
    /// Effects of `[[physics]]` that it holds.
    pub held: &'a [String],
    /// What it cannot hold.
    pub lost: &'a [Lost],
    /// Distances to the rig's own motion.
    pub differences: &'a [Difference],
    /// Numbers that are not the rig's.
    pub changed: &'a [String],
}

/// What a file says of itself.
#[derive(Debug, Clone, Copy)]
pub struct About<'a> {
    /// What made it: program and version.
    pub made_by: &'a str,
    /// Ranges in which the coefficients were seen; empty = not known.
    pub ranges: &'a [Range],
    /// Name of a function, where the target's file has to have one.
    pub function: &'a str,
}

/// Writes a rig's model for a target.
///
/// # Errors
/// [`ModelError`].
pub fn export(rig: &Rig, target: Target, about: &About<'_>) -> Result<Export, ModelError> {
    let model = written(rig)?;
    let lost = of_formulas(&model);
    // Effects on the measurement change no motion.
    let gone: Vec<String> = model
        .absent
        .iter()
        .filter(|(_, reason)| *reason == Absent::Delay)
        .map(|(name, _)| name.clone())
        .collect();
    let differences = differences(rig, &without(rig, &gone));
    let head = header::lines(rig, &model.held, &lost, &differences, about);
    let text = match target {
        Target::Python => python::text(rig, &model, &head),
        Target::Casadi => casadi::text(rig, &model, &head),
        Target::Mss => mss::text(rig, &model, &head, about.function),
    };
    Ok(Export {
        bytes: text.into_bytes(),
        lost,
        differences,
        changed: Vec::new(),
    })
}

/// The start of the rig: pose at rest, then the effects' own states at 0.
fn start(rig: &Rig, model: &Written) -> Vec<f64> {
    let mut start = rig.tank.start_pose.to_vec();
    start.resize(model.states.len(), 0.0);
    start
}
