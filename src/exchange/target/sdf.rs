//! A model of Gazebo (Garden and later): added mass in the inertia, where the engine integrates it; damping by the hydrodynamics plugin;
//! thrusters by theirs.
//!
//! The hydrodynamics plugin can hold added mass as well, but takes the acceleration of the step before for it, which is not stable for a
//! body that weighs as much as its water (gz-sim, issues 1462 and 1923); its own added mass and Coriolis terms stay off, the engine has
//! both with `<fluid_added_mass>`. SDF 1.9: what the parsers of Debian and of Gazebo read alike.

use hydroline_rigs::Dof;

use super::body::{Body, DENSITY_KGPM3};
use super::xml::{Xml, spaced};
use crate::formula::number;
use crate::lost::Lost;

/// Least length of an edge of the collision box \[m\].
const EDGE_M: f64 = 1e-3;
/// Diameter of the propellers that are shown \[m\]: it moves no thrust.
const PROPELLER_M: f64 = 0.1;

/// Letters of the axes in SNAME order: those of loads and of speeds.
const LOADS: [char; 6] = ['x', 'y', 'z', 'k', 'm', 'n'];
const SPEEDS: [char; 6] = ['U', 'V', 'W', 'P', 'Q', 'R'];

/// What Gazebo's plugins cannot hold of any rig.
pub(super) fn lost() -> Vec<Lost> {
    vec![Lost::new(
        "thrust curves",
        "Gazebo's thrusters take newtons: turn pulses into thrust by the table in this file's comments; their limits are in",
    )]
}

/// `xDotU`, `xU`, `xUabsU` ... of a DOF.
fn names(dof: usize) -> [String; 2] {
    let (load, speed) = (LOADS[dof], SPEEDS[dof]);
    [format!("{load}{speed}"), format!("{load}{speed}abs{speed}")]
}

fn inertial(xml: &mut Xml, mass_kg: f64, centre: &[f64], inertia: [f64; 6]) {
    xml.text("pose", &format!("{} 0 0 0", spaced(centre)));
    xml.text("mass", &number(mass_kg));
    xml.begin("inertia");
    for (name, value) in ["ixx", "ixy", "ixz", "iyy", "iyz", "izz"]
        .iter()
        .zip(inertia)
    {
        xml.text(name, &number(value + 0.0));
    }
    xml.end();
}

pub(super) fn text(body: &Body, head: &[String]) -> String {
    let mut xml = Xml::new(head);
    xml.begin("sdf version=\"1.9\"");
    xml.begin(&format!("model name=\"{}\"", body.name));
    xml.text("pose", &spaced(&body.start));
    xml.begin("link name=\"base_link\"");
    xml.begin("inertial");
    inertial(&mut xml, body.mass_kg, &body.centre_m, body.inertia_kgm2);
    xml.comment("Integrated by DART, Gazebo's default engine; another engine leaves it out: give the plugin below -xx .. -rr as xDotU .. nDotR there");
    xml.begin("fluid_added_mass");
    let axes = ["x", "y", "z", "p", "q", "r"];
    for (i, a) in axes.iter().enumerate() {
        for (j, b) in axes.iter().enumerate().skip(i) {
            let value = if i == j { body.added[i] } else { 0.0 };
            xml.text(&format!("{a}{b}"), &number(value + 0.0));
        }
    }
    xml.end();
    xml.end();
    if body.volume_m3 > 0.0 {
        xml.comment("Displaces the water: the world needs gz-sim-buoyancy-system with uniform_fluid_density 1000");
        let edge = body.volume_m3.cbrt().max(EDGE_M);
        let size = [body.volume_m3 / (edge * edge), edge, edge];
        xml.begin("collision name=\"displaced\"");
        xml.text("pose", &format!("{} 0 0 0", spaced(&body.buoyancy_m)));
        xml.begin("geometry");
        xml.begin("box");
        xml.numbers("size", &size);
        xml.end();
        xml.end();
        xml.end();
    }
    xml.end();
    for jet in &body.jets {
        let (mass_kg, inertia) = body.link;
        xml.begin(&format!("link name=\"{}\"", jet.name));
        xml.text("pose", &format!("{} 0 0 0", spaced(&jet.position_m)));
        xml.begin("inertial");
        inertial(
            &mut xml,
            mass_kg,
            &[0.0; 3],
            [inertia, 0.0, 0.0, inertia, 0.0, inertia],
        );
        xml.end();
        xml.end();
        xml.begin(&format!(
            "joint name=\"{}_joint\" type=\"revolute\"",
            jet.name
        ));
        xml.text("parent", "base_link");
        xml.text("child", &jet.name);
        xml.begin("axis");
        xml.numbers("xyz", &jet.direction);
        xml.end();
        xml.end();
    }
    xml.begin(
        "plugin filename=\"gz-sim-hydrodynamics-system\" name=\"gz::sim::systems::Hydrodynamics\"",
    );
    xml.text("link_name", "base_link");
    xml.text("disable_added_mass", "true");
    xml.text("disable_coriolis", "true");
    for dof in Dof::ALL {
        let d = dof.index();
        let [linear, quadratic] = names(d);
        xml.text(&linear, &number(body.linear[d]));
        xml.text(&quadratic, &number(body.quadratic[d]));
    }
    xml.end();
    for jet in &body.jets {
        xml.begin("plugin filename=\"gz-sim-thruster-system\" name=\"gz::sim::systems::Thruster\"");
        xml.text("namespace", &body.name);
        xml.text("joint_name", &format!("{}_joint", jet.name));
        xml.text("fluid_density", &number(DENSITY_KGPM3));
        xml.text("propeller_diameter", &number(PROPELLER_M));
        xml.text("velocity_control", "true");
        xml.text("min_thrust_cmd", &number(jet.limits_n[0]));
        xml.text("max_thrust_cmd", &number(jet.limits_n[1]));
        xml.end();
    }
    xml.finish()
}
