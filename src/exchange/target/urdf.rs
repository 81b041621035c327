//! A robot of URDF with the plugins of UUV Simulator (and its ports), which hold added mass, damping, buoyancy, and thrusters with their
//! curve and lag.

use hydroline_rigs::Rig;
use hydroline_sim::effect::{CheckedEffect, check};

use super::body::{Body, DENSITY_KGPM3};
use super::xml::{Xml, spaced};
use crate::formula::number;
use crate::lost::Lost;
use crate::model::{ModelError, name_of};

/// Load of a newton in a DOF above which a thruster makes it \[N, N m\].
const SPANNED: f64 = 1e-9;

/// The lag of all thrusters where one number says it \[s\]: `thruster_lag` with the same constant in every DOF that they make.
///
/// A lag of a DOF's load is that of its thrusters where these share no other DOF, or all DOFs have the same.
fn lag_s(effects: &[CheckedEffect], dofs: usize) -> Option<f64> {
    let lags: Vec<f64> = effects
        .iter()
        .filter(|e| e.info.id == "thruster_lag" && e.trend.is_none())
        .filter_map(|e| e.numbers.first().copied())
        .collect();
    let first = *lags.first()?;
    (lags.len() == dofs && lags.iter().all(|l| *l == first)).then_some(first)
}

/// The lag that the thrusters hold instead of the load; what is lost says so.
pub(super) fn with_lag(rig: &Rig, body: &mut Body) -> Result<Option<f64>, ModelError> {
    let effects = check(&rig.physics)?;
    let made = (0..6).filter(|d| {
        let mut each = rig.thrusters.thrusters.iter();
        each.any(|t| wrench(t.position_m, t.direction)[*d].abs() > SPANNED)
    });
    let lag_s = lag_s(&effects, made.count());
    if lag_s.is_some() {
        for lost in &mut body.lost {
            let is_lag =
                |e: &&CheckedEffect| e.info.id == "thruster_lag" && name_of(e) == lost.what;
            if effects.iter().find(is_lag).is_some() {
                lost.why = "held as a lag of the thrusters' pulses, before their curve: the same only where the curve is a straight line".to_owned();
            }
        }
    }
    Ok(lag_s)
}

/// Wrench of a newton at a place, our frame.
fn wrench(r: [f64; 3], d: [f64; 3]) -> [f64; 6] {
    [
        d[0],
        d[1],
        d[2],
        r[1] * d[2] - r[2] * d[1],
        r[2] * d[0] - r[0] * d[2],
        r[0] * d[1] - r[1] * d[0],
    ]
}

/// What these files cannot hold of any rig.
pub(super) fn lost() -> Vec<Lost> {
    vec![Lost::new(
        "added mass in one step",
        "UUV Simulator takes it from the filtered acceleration of the step before: large added masses need small steps",
    )]
}

pub(super) fn text(rig: &Rig, body: &Body, lag_s: Option<f64>, head: &[String]) -> String {
    let mut xml = Xml::new(head);
    xml.begin(&format!("robot name=\"{}\"", body.name));
    let inertia = |xml: &mut Xml, centre: &[f64], mass_kg: f64, i: [f64; 6]| {
        xml.begin("inertial");
        xml.empty(&format!("origin xyz=\"{}\" rpy=\"0 0 0\"", spaced(centre)));
        xml.empty(&format!("mass value=\"{}\"", number(mass_kg)));
        let i = i.map(|v| number(v + 0.0));
        xml.empty(&format!(
            "inertia ixx=\"{}\" ixy=\"{}\" ixz=\"{}\" iyy=\"{}\" iyz=\"{}\" izz=\"{}\"",
            i[0], i[1], i[2], i[3], i[4], i[5]
        ));
        xml.end();
    };
    xml.begin("link name=\"base_link\"");
    inertia(&mut xml, &body.centre_m, body.mass_kg, body.inertia_kgm2);
    xml.end();
    for jet in &body.jets {
        let (mass_kg, i) = body.link;
        xml.begin(&format!("link name=\"{}\"", jet.name));
        inertia(&mut xml, &[0.0; 3], mass_kg, [i, 0.0, 0.0, i, 0.0, i]);
        xml.end();
        let [x, y, z] = jet.direction;
        // Its own x axis is the direction of thrust.
        let turn = [0.0, -z.clamp(-1.0, 1.0).asin(), y.atan2(x)];
        xml.begin(&format!(
            "joint name=\"{}_joint\" type=\"continuous\"",
            jet.name
        ));
        xml.empty(&format!(
            "origin xyz=\"{}\" rpy=\"{}\"",
            spaced(&jet.position_m),
            spaced(&turn)
        ));
        xml.empty("axis xyz=\"1 0 0\"");
        xml.empty("parent link=\"base_link\"");
        xml.empty(&format!("child link=\"{}\"", jet.name));
        xml.end();
    }
    xml.begin("gazebo");
    xml.begin("plugin name=\"uuv_plugin\" filename=\"libuuv_underwater_object_ros_plugin.so\"");
    xml.text("fluid_density", &number(DENSITY_KGPM3));
    xml.begin("link name=\"base_link\"");
    xml.text("neutrally_buoyant", "0");
    xml.text("volume", &number(body.volume_m3));
    xml.numbers("center_of_buoyancy", &body.buoyancy_m);
    xml.begin("hydrodynamic_model");
    xml.text("type", "fossen");
    let mut all = [0.0; 36];
    for (d, mass) in body.added.iter().enumerate() {
        all[7 * d] = *mass;
    }
    xml.numbers("added_mass", &all);
    xml.numbers("linear_damping", &body.linear);
    xml.numbers("quadratic_damping", &body.quadratic);
    xml.end();
    xml.end();
    xml.end();
    for (k, (jet, thruster)) in body.jets.iter().zip(&rig.thrusters.thrusters).enumerate() {
        // From neutral: the lag of a thruster begins at 0.
        let neutral_us = rig.thrusters.neutral_us;
        let points = thruster.curve.points.iter();
        let (pulses, thrusts): (Vec<f64>, Vec<f64>) =
            points.map(|(p, n)| (p - neutral_us, *n)).unzip();
        xml.begin(&format!(
            "plugin name=\"{}_plugin\" filename=\"libuuv_thruster_ros_plugin.so\"",
            jet.name
        ));
        xml.text("linkName", &jet.name);
        xml.text("jointName", &format!("{}_joint", jet.name));
        xml.text("thrusterID", &k.to_string());
        xml.comment("The input is the pulse less the neutral one, in microseconds");
        xml.text("gain", "1");
        xml.text("clampMin", &number(rig.thrusters.min_us - neutral_us));
        xml.text("clampMax", &number(rig.thrusters.max_us - neutral_us));
        xml.text("thrustMin", &number(jet.limits_n[0]));
        xml.text("thrustMax", &number(jet.limits_n[1]));
        xml.begin("dynamics");
        match lag_s {
            Some(lag_s) => {
                xml.text("type", "FirstOrder");
                xml.text("timeConstant", &number(lag_s));
            }
            None => xml.text("type", "ZeroOrder"),
        }
        xml.end();
        xml.begin("conversion");
        xml.text("type", "LinearInterp");
        xml.numbers("inputValues", &pulses);
        xml.numbers("outputValues", &thrusts);
        xml.end();
        xml.end();
    }
    xml.finish()
}
