use super::*;
use crate::edit::{change, put};
use crate::target::{About, Target, export};
use hydroline_coefficients::{Particulars, Prime};
use hydroline_rigs::Rig;

fn value(found: &Foreign, key: &str) -> f64 {
    let number = Number::Coefficient(Coefficient::find(key).unwrap());
    found.numbers.iter().find(|(n, _)| *n == number).unwrap().1
}

#[test]
fn every_way_to_write_a_coefficient_is_known() {
    for (name, key) in [
        ("Xudot", "x_udot"),
        ("X_udot", "x_udot"),
        ("xDotU", "x_udot"),
        ("X_u", "x_u"),
        ("xU", "x_u"),
        ("Xuu", "x_uu"),
        ("X_u|u|", "x_uu"),
        ("xUabsU", "x_uu"),
        ("Nrabsr", "n_rr"),
        ("M_q|q|", "m_qq"),
        ("k_pdot", "k_pdot"),
    ] {
        assert_eq!(named(name).unwrap().unwrap().key(), key, "{name}");
    }
    for crossed in ["Yrdot", "Xvr", "Nv", "Zuq", "Xuuu"] {
        assert_eq!(named(crossed), Some(Err(())), "{crossed}");
    }
    for other in ["rho", "L", "m", "Ixx", "xG", "U0", "Cdy"] {
        assert_eq!(named(other), None, "{other}");
    }
}

/// Assignments as the vessels of MSS have them, in prime system I: numbers of the NPS AUV II (Healey and Lienard 1993).
const NPS: &str = "\
L   = 5.3;    g   = 9.8;  % m, m/s2
rho = 1000;   m   = 5454.54/(rho/2*L^3);
Ix  = 2038;   Iy  = 13587;  Iz  = 13587;
Xudot = -7.6e-3; Xwq    = -2.0e-1; % a comment with Xu = 5
Yvdot = -5.5e-2; Yp     =  3.0e-3;
Zwdot = -2.4e-1; Kpdot = -1.0e-3; Mqdot = -1.7e-2; Nrdot  = -3.4e-3;
";

#[test]
fn a_vessel_of_mss_is_read_and_made_dimensional() {
    let found = read(NPS, "npsauv.m").unwrap();
    assert_eq!(value(&found, "x_udot"), -7.6e-3);
    let left = found.left.join("\n");
    assert!(left.contains("Xwq") && left.contains("Yp"), "{left}");
    assert!(
        !found.numbers.iter().any(|(n, _)| *n == Number::Mass),
        "computed, not written"
    );
    let hull = Particulars {
        speed_mps: Some(1.0),
        ..Particulars::of_length(5.3)
    };
    let found = found.dimensional(&Prime::I.units(&hull).unwrap());
    assert!((value(&found, "x_udot") + 7.6e-3 * 500.0 * 5.3f64.powi(3)).abs() < 1e-9);
}

#[test]
fn a_table_has_units_and_what_is_no_coefficient_is_left() {
    let text = "# Fossen\nname,value,unit\nX_udot,-5500,g\nX_u,-4.03\nX_u|u|, -18.18, N s2/m2\nmass,11.5\nN_v,-0.3\ncolour,3\n";
    let found = read(text, "t.csv").unwrap();
    assert!((value(&found, "x_udot") + 5.5).abs() < 1e-12);
    assert_eq!(value(&found, "x_u"), -4.03);
    assert!(found.numbers.contains(&(Number::Mass, 11.5)));
    assert_eq!(found.left.len(), 2, "{:?}", found.left);
    let words = read("X_u,-4,m\n", "t.csv").unwrap_err().to_string();
    assert!(words.contains("row 1") && words.contains("kg/s"), "{words}");
}

/// What we write for Gazebo and UUV Simulator comes back as it was, linear and quadratic damping that effects add included.
#[test]
fn what_is_exported_is_read_back() {
    let rig = Rig::builtin("lshpi").unwrap();
    let about = About {
        made_by: "a test",
        ranges: &[],
        function: "m",
        library: None,
    };
    for (target, file) in [
        (Target::Sdf, "m.sdf"),
        (Target::Urdf, "m.urdf"),
        (Target::Mss, "m.m"),
    ] {
        let text = String::from_utf8(export(&rig, target, &about).unwrap().bytes).unwrap();
        let found = read(&text, file).unwrap();
        for c in Dof::ALL.into_iter().flat_map(Coefficient::of) {
            assert_eq!(
                value(&found, c.key()),
                c.of_vehicle(&rig.vehicle),
                "{file} {}",
                c.key()
            );
        }
    }
}

/// The plugins of a published model (clydemcqueen/bluerov2_gz, models/bluerov2_heavy/model.sdf) in its form.
const GAZEBO: &str = r#"<sdf version="1.6"><model name="m"><link name="base_link"><inertial><mass>13.0</mass><inertia><ixx>0.26</ixx><iyy>0.23</iyy><izz>0.37</izz></inertia></inertial></link>
<link name="thruster1"><inertial><mass>0.002</mass></inertial></link>
<plugin filename="gz-sim-hydrodynamics-system" name="gz::sim::systems::Hydrodynamics"><link_name>base_link</link_name>
<xDotU>0</xDotU><xU>0</xU><xUabsU>-58.42</xUabsU><yVabsV>-55.137</yVabsV><zWabsW>-124.818</zWabsW><kPabsP>-4.0</kPabsP><xUU>-3</xUU><yR>-1</yR></plugin></model></sdf>"#;

#[test]
fn a_model_of_gazebo_changes_a_rig_and_says_what_it_leaves() {
    let found = read(GAZEBO, "model.sdf").unwrap();
    assert_eq!(value(&found, "x_uu"), -58.42);
    let left = found.left.join("\n");
    assert!(left.contains("xUU") && left.contains("yR"), "{left}");
    let rig = Rig::builtin("lshpi").unwrap();
    let changes = found
        .changes("model.sdf", rig.vehicle.inertia_kgm2)
        .unwrap();
    let text = changes.iter().fold(rig.effective_toml.clone(), |t, c| {
        put(&t, &change(c).unwrap()).unwrap()
    });
    let made = Rig::from_toml(&text, "made.toml", None).unwrap();
    assert_eq!(made.vehicle.mass_kg, 13.0);
    assert_eq!(made.vehicle.inertia_kgm2, [0.26, 0.23, 0.37]);
    assert_eq!(made.vehicle.coefficients[2].quadratic, -124.818);
    // What the file does not say stays.
    assert_eq!(made.vehicle.coefficients[5], rig.vehicle.coefficients[5]);
}

#[test]
fn signs_macros_and_other_files_are_refused_with_the_way_out() {
    let positive = read("X_udot,5.5\n", "t.csv").unwrap();
    let words = positive.changes("t.csv", [1.0; 3]).unwrap_err().to_string();
    assert!(words.contains("--positive"), "{words}");
    assert!(positive.turned().changes("t.csv", [1.0; 3]).is_ok());
    let macros = "<link name='b'><hydrodynamic_model><added_mass>${a} 0</added_mass></hydrodynamic_model></link>";
    let words = read(macros, "m.xacro").unwrap_err().to_string();
    assert!(words.contains("macro"), "{words}");
    assert!(
        read("<a/>", "m.sdf")
            .unwrap_err()
            .to_string()
            .contains("hydrodynamic_model")
    );
    assert!(read("x", "m.bin").unwrap_err().to_string().contains(".csv"));
    assert!(
        read("a = 3;", "m.m")
            .unwrap_err()
            .to_string()
            .contains("Xudot = -7.6e-3")
    );
}
