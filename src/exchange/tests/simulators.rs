//! Files for simulators of bodies, read again: their numbers, integrated as such a simulator does, move as our model.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use hydroline_exchange::target::{About, Target, export};
use hydroline_identify::predict::predict;
use hydroline_plan::setpoint::setpoint;
use hydroline_rigs::{ParameterValue, PhysicsEntry, Plan, Rig};
use hydroline_sim::Allocation;
use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};
use roxmltree::{Document, Node};

const ABOUT: About<'static> = About {
    made_by: "a test",
    ranges: &[],
    function: "model",
    library: None,
};
const STEP_S: f64 = 0.02;

/// A body as such a simulator holds it: x forward, y to port, z up.
#[derive(Debug)]
struct Body {
    start: Vec<f64>,
    mass: f64,
    inertia: Matrix3<f64>,
    centre: Vector3<f64>,
    added: Vec<f64>,
    linear: Vec<f64>,
    quadratic: Vec<f64>,
    volume: f64,
    buoyancy: Vector3<f64>,
    jets: Vec<(Vector3<f64>, Vector3<f64>)>,
}

fn numbers(text: &str) -> Vec<f64> {
    text.split_whitespace()
        .map(|v| v.parse().unwrap())
        .collect()
}

fn child<'a>(node: Node<'a, 'a>, path: &str) -> Node<'a, 'a> {
    path.split('/').fold(node, |node, name| {
        node.children()
            .find(|c| c.has_tag_name(name))
            .unwrap_or_else(|| panic!("no {name} in {node:?}"))
    })
}

fn text(node: Node<'_, '_>, path: &str) -> String {
    child(node, path).text().unwrap().to_owned()
}

fn value(node: Node<'_, '_>, path: &str) -> f64 {
    text(node, path).trim().parse().unwrap()
}

fn arm(mass: f64, r: Vector3<f64>) -> Matrix3<f64> {
    (Matrix3::identity() * r.norm_squared() - r * r.transpose()) * mass
}

/// Mass, centre and inertia of several links together: (mass, centre, inertia about the centre).
fn together(links: &[(f64, Vector3<f64>, Matrix3<f64>)]) -> (f64, Vector3<f64>, Matrix3<f64>) {
    let mass: f64 = links.iter().map(|l| l.0).sum();
    let centre: Vector3<f64> = links.iter().map(|l| l.1 * l.0).sum::<Vector3<f64>>() / mass;
    let inertia = links.iter().map(|l| l.2 + arm(l.0, l.1 - centre)).sum();
    (mass, centre, inertia)
}

fn tensor(i: [f64; 6]) -> Matrix3<f64> {
    Matrix3::new(i[0], i[1], i[2], i[1], i[3], i[4], i[2], i[4], i[5])
}

fn of_sdf(text_of: &str) -> Body {
    let document = Document::parse(text_of).unwrap();
    let model = child(document.root_element(), "model");
    let links: Vec<Node<'_, '_>> = model
        .children()
        .filter(|c| c.has_tag_name("link"))
        .collect();
    let link = |node: Node<'_, '_>| {
        let inertial = child(node, "inertial");
        let of = |name: &str| value(inertial, &format!("inertia/{name}"));
        let own = numbers(&text(inertial, "pose"));
        let at = node.children().find(|c| c.has_tag_name("pose"));
        let at = at.map_or(vec![0.0; 6], |p| numbers(p.text().unwrap()));
        let centre = Vector3::new(at[0] + own[0], at[1] + own[1], at[2] + own[2]);
        let inertia = tensor(["ixx", "ixy", "ixz", "iyy", "iyz", "izz"].map(of));
        (value(inertial, "mass"), centre, inertia)
    };
    let all: Vec<_> = links.iter().map(|l| link(*l)).collect();
    let (mass, centre, inertia) = together(&all);
    let base = links
        .iter()
        .find(|l| l.attribute("name") == Some("base_link"))
        .unwrap();
    let added = child(child(*base, "inertial"), "fluid_added_mass");
    let plugin = model
        .children()
        .find(|c| c.attribute("filename") == Some("gz-sim-hydrodynamics-system"))
        .unwrap();
    assert_eq!(text(plugin, "disable_added_mass"), "true");
    assert_eq!(text(plugin, "disable_coriolis"), "true");
    let displaced = child(*base, "collision");
    let size = numbers(&text(displaced, "geometry/box/size"));
    let at = numbers(&text(displaced, "pose"));
    let mut jets = Vec::new();
    for joint in model.children().filter(|c| c.has_tag_name("joint")) {
        let name = text(joint, "child");
        let of = links
            .iter()
            .find(|l| l.attribute("name") == Some(&name))
            .unwrap();
        let place = numbers(&text(*of, "pose"));
        let axis = numbers(&text(joint, "axis/xyz"));
        jets.push((
            Vector3::new(place[0], place[1], place[2]),
            Vector3::new(axis[0], axis[1], axis[2]),
        ));
    }
    Body {
        start: numbers(&text(model, "pose")),
        mass,
        inertia,
        centre,
        added: ["xx", "yy", "zz", "pp", "qq", "rr"]
            .map(|n| value(added, n))
            .to_vec(),
        linear: ["xU", "yV", "zW", "kP", "mQ", "nR"]
            .map(|n| value(plugin, n))
            .to_vec(),
        quadratic: ["xUabsU", "yVabsV", "zWabsW", "kPabsP", "mQabsQ", "nRabsR"]
            .map(|n| value(plugin, n))
            .to_vec(),
        volume: size.iter().product(),
        buoyancy: Vector3::new(at[0], at[1], at[2]),
        jets,
    }
}

fn of_urdf(text_of: &str, start: Vec<f64>) -> Body {
    let document = Document::parse(text_of).unwrap();
    let robot = document.root_element();
    let attribute = |node: Node<'_, '_>, name: &str| numbers(node.attribute(name).unwrap());
    let joints: Vec<Node<'_, '_>> = robot
        .children()
        .filter(|c| c.has_tag_name("joint"))
        .collect();
    let mut links = Vec::new();
    for node in robot.children().filter(|c| c.has_tag_name("link")) {
        let inertial = child(node, "inertial");
        let mass = attribute(child(inertial, "mass"), "value")[0];
        let i = child(inertial, "inertia");
        let i = ["ixx", "ixy", "ixz", "iyy", "iyz", "izz"].map(|n| attribute(i, n)[0]);
        let own = attribute(child(inertial, "origin"), "xyz");
        let joint = joints
            .iter()
            .find(|j| child(**j, "child").attribute("link") == node.attribute("name"));
        let at = joint.map_or(vec![0.0; 3], |j| attribute(child(*j, "origin"), "xyz"));
        // Isotropic where the link is turned.
        let centre = Vector3::new(at[0] + own[0], at[1] + own[1], at[2] + own[2]);
        links.push((mass, centre, tensor(i)));
    }
    let (mass, centre, inertia) = together(&links);
    let jets = joints.iter().map(|j| {
        let at = attribute(child(*j, "origin"), "xyz");
        let turn = attribute(child(*j, "origin"), "rpy");
        assert_eq!(attribute(child(*j, "axis"), "xyz"), [1.0, 0.0, 0.0]);
        // x axis of Rz(yaw) Ry(pitch).
        let axis = Vector3::new(
            turn[2].cos() * turn[1].cos(),
            turn[2].sin() * turn[1].cos(),
            -turn[1].sin(),
        );
        (Vector3::new(at[0], at[1], at[2]), axis)
    });
    let jets = jets.collect();
    let of = document
        .descendants()
        .find(|n| n.has_tag_name("hydrodynamic_model"))
        .unwrap();
    let link = of.parent().unwrap();
    let added = numbers(&text(of, "added_mass"));
    assert_eq!(added.len(), 36);
    assert_eq!(added.iter().filter(|v| **v != 0.0).count(), 6);
    let at = numbers(&text(link, "center_of_buoyancy"));
    Body {
        start,
        mass,
        inertia,
        centre,
        added: (0..6).map(|d| added[7 * d]).collect(),
        linear: numbers(&text(of, "linear_damping")),
        quadratic: numbers(&text(of, "quadratic_damping")),
        volume: value(link, "volume"),
        buoyancy: Vector3::new(at[0], at[1], at[2]),
        jets,
    }
}

impl Body {
    /// Rates of pose and body rates: Kirchhoff's equations of the whole 6 x 6 mass (Fossen 2011, 6.43), buoyancy and weight.
    fn rates(&self, state: &[f64], thrust: &[f64], gravity: f64) -> Vec<f64> {
        let (phi, theta, psi) = (state[3], state[4], state[5]);
        let nu = Vector6::from_column_slice(&state[6..12]);
        let (v, w) = (
            Vector3::new(nu[0], nu[1], nu[2]),
            Vector3::new(nu[3], nu[4], nu[5]),
        );
        let turn = nalgebra::Rotation3::from_euler_angles(phi, theta, psi);
        // The origin is the centre of gravity of all links, to rounding.
        assert!(self.centre.norm() < 1e-12, "{}", self.centre);
        let mut mass = Matrix6::zeros();
        mass.fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&(Matrix3::identity() * self.mass));
        mass.fixed_view_mut::<3, 3>(3, 3).copy_from(&self.inertia);
        for d in 0..6 {
            mass[(d, d)] += self.added[d];
        }
        let momentum = mass * nu;
        let (linear, angular) = (
            Vector3::new(momentum[0], momentum[1], momentum[2]),
            Vector3::new(momentum[3], momentum[4], momentum[5]),
        );
        let (mut force, mut moment) = (linear.cross(&w), angular.cross(&w) + linear.cross(&v));
        for d in 0..3 {
            force[d] += (self.linear[d] + self.quadratic[d] * nu[d].abs()) * nu[d];
            let r = nu[3 + d];
            moment[d] += (self.linear[3 + d] + self.quadratic[3 + d] * r.abs()) * r;
        }
        let up = turn.inverse() * Vector3::z();
        let lift = up * (1000.0 * self.volume * gravity);
        force += lift - up * (self.mass * gravity);
        moment += self.buoyancy.cross(&lift);
        for ((at, axis), newton) in self.jets.iter().zip(thrust) {
            force += axis * *newton;
            moment += at.cross(&(axis * *newton));
        }
        let load = Vector6::new(
            force[0], force[1], force[2], moment[0], moment[1], moment[2],
        );
        let rate = mass.lu().solve(&load).unwrap();
        let place = turn * v;
        let (sf, cf) = phi.sin_cos();
        let q = w[1] * sf + w[2] * cf;
        let euler = [
            w[0] + q * theta.tan(),
            w[1] * cf - w[2] * sf,
            q / theta.cos(),
        ];
        place
            .iter()
            .chain(&euler)
            .chain(rate.iter())
            .copied()
            .collect()
    }

    fn moved(&self, rig: &Rig, plan: &Plan) -> Vec<Vec<f64>> {
        let allocation = Allocation::new(&rig.thrusters).unwrap();
        let gravity = rig.vehicle.gravity_mps2;
        let mut state = self.start.clone();
        state.resize(12, 0.0);
        let mut rows = Vec::new();
        let mut thrust = Vec::new();
        for k in 0..=(plan.duration_s() / STEP_S).round() as u64 {
            if k % 10 == 0 {
                rows.push(state.clone());
            }
            if k % 2 == 0 {
                let at_s = 0.04 * (k / 2) as f64;
                thrust = setpoint(rig, &allocation, plan, at_s).unwrap().thrust_n;
            }
            let rates = |s: &[f64]| self.rates(s, &thrust, gravity);
            let moved = |r: &[f64], by: f64| -> Vec<f64> {
                state.iter().zip(r).map(|(s, r)| s + r * by).collect()
            };
            let k1 = rates(&state);
            let k2 = rates(&moved(&k1, 0.5 * STEP_S));
            let k3 = rates(&moved(&k2, 0.5 * STEP_S));
            let k4 = rates(&moved(&k3, STEP_S));
            let next = (0..12)
                .map(|i| state[i] + STEP_S / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]));
            state = next.collect();
        }
        rows
    }
}

/// Largest distance of a channel over the largest value it takes; theirs is turned over.
fn distance(rig: &Rig, plan: &Plan, body: &Body) -> f64 {
    let ours = predict(rig, plan, None, 5.0, 0.0).unwrap().motion;
    let theirs = body.moved(rig, plan);
    assert_eq!(ours.len(), theirs.len());
    let signs = [
        1.0, -1.0, -1.0, 1.0, -1.0, -1.0, 1.0, -1.0, -1.0, 1.0, -1.0, -1.0,
    ];
    let mut worst = 0.0_f64;
    for (c, sign) in signs.iter().enumerate() {
        let own: Vec<f64> = ours.iter().map(|m| m.into_array()[c]).collect();
        let size = own.iter().map(|v| v.abs()).fold(1e-6, f64::max);
        let off = own
            .iter()
            .zip(&theirs)
            .map(|(a, b)| (a - sign * b[c]).abs());
        worst = worst.max(off.fold(0.0, f64::max) / size);
    }
    worst
}

/// A rig whose thrusters are not arranged alike on all sides, with what the files hold.
fn rig() -> Rig {
    let mut rig = Rig::builtin("lshpi").unwrap();
    rig.thrusters.thrusters[0].position_m = [0.16, 0.12, 0.05];
    rig.thrusters.thrusters[5].position_m[0] = 0.14;
    let effect = |id: &str, dof: &str, coefficient: f64| PhysicsEntry {
        effect: id.to_owned(),
        parameters: vec![
            (
                "coefficient".to_owned(),
                ParameterValue::Number(coefficient),
            ),
            ("dof".to_owned(), ParameterValue::Word(dof.to_owned())),
        ],
    };
    rig.physics = vec![
        effect("linear_damping", "sway", -7.0),
        effect("quadratic_damping", "yaw", -3.0),
    ];
    rig.vehicle.net_weight_n = -0.4;
    rig
}

#[test]
fn the_numbers_of_sdf_and_urdf_move_a_body_as_our_model_does() {
    let rig = rig();
    let written = |target| {
        let made = export(&rig, target, &ABOUT).unwrap();
        assert_eq!(made.held, ["linear_damping_sway", "quadratic_damping_yaw"]);
        assert!(made.differences.is_empty(), "{:?}", made.differences);
        String::from_utf8(made.bytes).unwrap()
    };
    let sdf = of_sdf(&written(Target::Sdf));
    let urdf = of_urdf(&written(Target::Urdf), sdf.start.clone());
    assert!((sdf.mass - rig.vehicle.mass_kg).abs() < 1e-12);
    for target in [Target::Sdf, Target::Urdf] {
        let text = written(target);
        assert!(text.contains("gravity 0 0 -9.81 and water of 1000 kg/m3"));
    }
    for name in ["surge-8n", "reversals", "mixed-6dof"] {
        let plan = Plan::builtin(name).unwrap();
        for (target, body) in [("sdf", &sdf), ("urdf", &urdf)] {
            let off = distance(&rig, &plan, body);
            println!("{target} {name}: {off:.1e}");
            assert!(off < 1e-6, "{target} {name}: {off}");
        }
    }
}

#[test]
fn what_gazebo_cannot_hold_is_in_the_list_with_its_size() {
    let mut rig = rig();
    rig.physics.push(PhysicsEntry {
        effect: "thruster_lag".into(),
        parameters: vec![("lag_s".into(), ParameterValue::Number(0.3))],
    });
    rig.vehicle.model = hydroline_rigs::VehicleModel::Decoupled;
    let made = export(&rig, Target::Sdf, &ABOUT).unwrap();
    let lost: Vec<&str> = made.lost.iter().map(|l| l.what.as_str()).collect();
    assert_eq!(
        lost,
        ["thruster_lag_surge", "model = decoupled", "thrust curves"]
    );
    assert_eq!(made.differences.len(), 3);
    assert!(
        made.differences.iter().all(|d| d.position_mm > 0.1),
        "{:?}",
        made.differences
    );
    let text = String::from_utf8(made.bytes).unwrap();
    Document::parse(&text).unwrap();
    assert!(
        text.contains("thruster_lag_surge: these files have no law for it"),
        "{text}"
    );
}

/// UUV Simulator's thrusters have a curve and a lag of their own.
#[test]
fn urdf_thrusters_have_the_curve_and_a_lag_that_all_degrees_of_freedom_share() {
    let mut rig = rig();
    let lag = |dof: &str| PhysicsEntry {
        effect: "thruster_lag".into(),
        parameters: vec![
            ("lag_s".into(), ParameterValue::Number(0.3)),
            ("dof".into(), ParameterValue::Word(dof.into())),
        ],
    };
    let dofs = ["surge", "sway", "heave", "roll", "pitch", "yaw"];
    rig.physics = dofs.map(lag).to_vec();
    let made = export(&rig, Target::Urdf, &ABOUT).unwrap();
    assert!(
        made.lost[0].why.contains("before their curve"),
        "{:?}",
        made.lost
    );
    let text = String::from_utf8(made.bytes).unwrap();
    let document = Document::parse(&text).unwrap();
    let lags: Vec<&str> = document
        .descendants()
        .filter(|n| n.has_tag_name("timeConstant"))
        .filter_map(|n| n.text())
        .collect();
    assert_eq!(lags, ["0.3"; 8]);
    let inputs = document
        .descendants()
        .find(|n| n.has_tag_name("inputValues"));
    let inputs = numbers(inputs.unwrap().text().unwrap());
    assert_eq!((inputs[0], inputs[inputs.len() - 1]), (-400.0, 400.0));
    // One DOF more or less, and no lag is that of the thrusters.
    rig.physics.pop();
    let made = export(&rig, Target::Urdf, &ABOUT).unwrap();
    assert!(
        !String::from_utf8(made.bytes)
            .unwrap()
            .contains("timeConstant")
    );
}
