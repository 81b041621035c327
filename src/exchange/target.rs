//! Files for other programs.

mod body;
mod casadi;
mod fmu;
mod header;
mod mss;
mod python;
mod sdf;
mod urdf;
mod xml;

use hydroline_coefficients::regime::Range;
use hydroline_rigs::{Rig, VehicleModel};
use hydroline_sim::effect::{CheckedEffect, Stage, check};
use schemars::JsonSchema;
use serde::Serialize;

use super::lost::{Difference, Lost, differences, of_formulas, without};
use super::model::{Absent, ModelError, Written, name_of, written};

/// Name of the library that an FMU holds, without the system's prefix and ending.
pub const FMU_LIBRARY: &str = hydroline_fmu::IDENTIFIER;

/// A language or a simulator.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Target {
    /// An FMU for co-simulation, FMI 3.0.
    Fmu,
    /// A Python function without dependencies.
    Python,
    /// A CasADi function, in Python.
    Casadi,
    /// A function for MATLAB and Octave in the form of the MSS toolbox.
    Mss,
    /// A model of Gazebo, with its plugins.
    Sdf,
    /// A robot of URDF with the plugins of UUV Simulator.
    Urdf,
}

impl Target {
    /// All of them.
    pub const ALL: [Target; 6] = [
        Target::Fmu,
        Target::Sdf,
        Target::Urdf,
        Target::Mss,
        Target::Python,
        Target::Casadi,
    ];

    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Target::Fmu => "fmu",
            Target::Python => "python",
            Target::Casadi => "casadi",
            Target::Mss => "mss",
            Target::Sdf => "sdf",
            Target::Urdf => "urdf",
        }
    }
}

/// A written model.
#[derive(Debug, Clone, PartialEq)]
pub struct Export {
    /// Contents of the file.
    pub bytes: Vec<u8>,
    /// Effects that it holds.
    pub held: Vec<String>,
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
    /// The library of an FMU; `None` = it was not found.
    pub library: Option<&'a [u8]>,
}

/// Writes a rig's model for a target.
///
/// # Errors
/// [`ModelError`].
pub fn export(rig: &Rig, target: Target, about: &About<'_>) -> Result<Export, ModelError> {
    match target {
        Target::Fmu => co_simulation(rig, about),
        Target::Python | Target::Casadi | Target::Mss => formulas(rig, target, about),
        Target::Sdf | Target::Urdf => simulator(rig, target, about),
    }
}

/// Our own simulator in another's hands.
fn co_simulation(rig: &Rig, about: &About<'_>) -> Result<Export, ModelError> {
    let (held, lost): (Vec<String>, Vec<Lost>) = match written(rig) {
        Ok(model) => {
            let mut lost = of_formulas(&model);
            // The library holds commands back itself.
            let delays = model.absent.iter().filter(|a| a.1 == Absent::Delay);
            let delays: Vec<String> = delays.map(|a| a.0.clone()).collect();
            lost.retain(|l| !delays.contains(&l.what));
            let mut held = model.held;
            held.extend(delays);
            (held, lost)
        }
        // A law that cannot be a formula runs in the library all the same.
        Err(ModelError::Branches { .. }) => {
            let effects = check(&rig.physics)?;
            let of_motion = |e: &&CheckedEffect| e.info.stage != Stage::Measurement;
            let (held, others): (Vec<_>, Vec<_>) = effects.iter().partition(of_motion);
            let others = others
                .into_iter()
                .map(|e| (name_of(e), Absent::OfMeasurement));
            let lost = others.map(|(name, why)| Lost::new(name, why.words()));
            (held.into_iter().map(name_of).collect(), lost.collect())
        }
        Err(other) => return Err(other),
    };
    let mut head = header::lines(rig, &held, &lost, &[], about);
    head.extend(curves(rig));
    Ok(Export {
        bytes: fmu::bytes(rig, about, &head)?,
        held,
        lost,
        differences: Vec::new(),
        changed: Vec::new(),
    })
}

/// A language, in which the laws are formulas.
fn formulas(rig: &Rig, target: Target, about: &About<'_>) -> Result<Export, ModelError> {
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
        Target::Casadi => casadi::text(rig, &model, &head),
        Target::Mss => mss::text(rig, &model, &head, about.function),
        _ => python::text(rig, &model, &head),
    };
    Ok(Export {
        bytes: text.into_bytes(),
        held: model.held,
        lost,
        differences,
        changed: Vec::new(),
    })
}

/// A simulator of bodies, which has laws of its own.
fn simulator(rig: &Rig, target: Target, about: &About<'_>) -> Result<Export, ModelError> {
    let mut body = body::body(rig)?;
    let lag_s = match target {
        Target::Urdf => urdf::with_lag(rig, &mut body)?,
        _ => None,
    };
    let names: Vec<String> = body.lost.iter().map(|l| l.what.clone()).collect();
    let mut of_target = without(rig, &names);
    of_target.vehicle.model = VehicleModel::Eq1;
    of_target.vehicle.stiffness = [0.0; 3];
    let differences = differences(rig, &of_target);
    body.lost.extend(match target {
        Target::Urdf => urdf::lost(),
        _ => sdf::lost(),
    });
    let mut head = header::lines(rig, &body.held, &body.lost, &differences, about);
    head.push(String::new());
    head.push("Here: body frame x forward, y to port, z up; world z up.".to_owned());
    head.push(format!(
        "The world needs gravity 0 0 -{} and water of {} kg/m3: with others net weight and restoring moment are other ones.",
        body.gravity_mps2,
        body::DENSITY_KGPM3
    ));
    head.extend(
        body.changed
            .iter()
            .map(|words| format!("Changed: {words}.")),
    );
    head.extend(curves(rig));
    let text = match target {
        Target::Urdf => urdf::text(rig, &body, lag_s, &head),
        _ => sdf::text(&body, &head),
    };
    Ok(Export {
        bytes: text.into_bytes(),
        held: body.held,
        lost: body.lost,
        differences,
        changed: body.changed,
    })
}

/// Thrust curves in lines.
fn curves(rig: &Rig) -> Vec<String> {
    let mut lines =
        vec!["Pulse [us] and thrust [N] of each thruster, linear between the points:".to_owned()];
    for thruster in &rig.thrusters.thrusters {
        let points = thruster.curve.points.iter();
        let points: Vec<String> = points.map(|(p, n)| format!("{p} {n}")).collect();
        lines.push(format!("  {}: {}", thruster.name, points.join(", ")));
    }
    lines
}

/// The start of the rig: pose at rest, then the effects' own states at 0.
fn start(rig: &Rig, model: &Written) -> Vec<f64> {
    let mut start = rig.tank.start_pose.to_vec();
    start.resize(model.states.len(), 0.0);
    start
}
