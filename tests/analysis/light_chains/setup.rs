//! Random setup of a chain: a vehicle that is not quite the rig's, its plans, a light and a camera.

use hydroline::identify::parameter::Coefficient;
use hydroline_rigs::{ParameterValue, PhysicsEntry, Rig};
use rand::{RngExt, SeedableRng, rngs::StdRng};
use std::f64::consts::PI;
use std::fmt::Write;

/// Runs from which one DOF's coefficients are found.
#[derive(Debug, Clone, Copy)]
pub struct Group {
    /// Model of `identify`.
    pub model: &'static str,
    /// Name and steps of each plan: how long \[s\], and the rest of the step.
    pub plans: &'static [(&'static str, &'static [(f64, &'static str)])],
}

impl Group {
    pub const fn first_run(&self) -> Group {
        let (first, _) = self.plans.split_at(1);
        Group {
            model: self.model,
            plans: first,
        }
    }
}

/// Short runs that stay over the target.
pub const GROUPS: &[Group] = &[
    Group {
        model: "surge",
        plans: &[
            (
                "reversals",
                &[
                    (4.0, "wrench = { surge_n = 9.0 }"),
                    (6.0, "wrench = { surge_n = -9.0 }"),
                    (4.0, "wrench = { surge_n = 9.0 }"),
                ],
            ),
            (
                "two-tone",
                &[
                    (
                        8.0,
                        "wrench = { surge_n = 11.0 }\nshape = \"sine\"\nperiod_s = 8.0\nphase_deg = 75",
                    ),
                    (
                        6.0,
                        "wrench = { surge_n = 13.0 }\nshape = \"sine\"\nperiod_s = 3.0\nphase_deg = 75",
                    ),
                ],
            ),
        ],
    },
    Group {
        model: "heave",
        plans: &[(
            "heave",
            &[(
                12.0,
                "wrench = { heave_n = 24.0 }\nshape = \"sine\"\nperiod_s = 4.0\nphase_deg = 90",
            )],
        )],
    },
    Group {
        model: "yaw",
        plans: &[(
            "yaw",
            &[(
                12.0,
                "wrench = { yaw_nm = 1.2 }\nshape = \"sine\"\nperiod_s = 4.0\nphase_deg = 85",
            )],
        )],
    },
];

/// Frames per second: few, the motion is slow.
pub const RATE_FPS: f64 = 2.5;
/// At rest first: the frames in which a run learns its camera.
const REST_S: f64 = 3.2;

/// A plan as text.
pub fn plan(steps: &[(f64, &str)]) -> String {
    let mut text = format!("[[step]]\nfor_s = {REST_S}\nwrench = {{}}\n");
    for (for_s, rest) in steps {
        writeln!(text, "[[step]]\nfor_s = {for_s:?}\n{rest}").unwrap();
    }
    text
}

/// A chain.
#[derive(Debug, Clone)]
pub struct Drawn {
    pub chain: u64,
    /// Rig that the user has.
    pub rig: Rig,
    /// The vehicle as it is.
    pub world: Rig,
    /// Its light and camera.
    pub light: Vec<PhysicsEntry>,
}

fn entry(effect: &str, numbers: &[(&str, f64)]) -> PhysicsEntry {
    PhysicsEntry {
        effect: effect.to_owned(),
        parameters: numbers
            .iter()
            .map(|(name, value)| ((*name).to_owned(), ParameterValue::Number(*value)))
            .collect(),
    }
}

/// Everything at once: shading to 20 %, a line 20 % dimmer at its ends and 15 % aslant, a background that rises by 8 levels,
/// a curve of .5 to 2, a range that ends at 235 to 255, bands of 4 levels.
fn light(rng: &mut StdRng) -> Vec<PhysicsEntry> {
    let mut within = |low: f64, high: f64| rng.random_range(low..high);
    let (rise, about) = (within(0.0, 8.0), within(0.0, 2.0 * PI));
    // The corners of the image are at most this far apart.
    let share = rise / (about.cos().abs() + about.sin().abs());
    vec![
        entry("lens_shading", &[("corner_loss", within(0.0, 0.2))]),
        entry(
            "line_profile",
            &[
                ("end_loss", within(0.0, 0.2)),
                ("tilt", within(-0.15, 0.15)),
            ],
        ),
        entry(
            "ambient_gradient",
            &[
                ("columns_grey", share * about.cos()),
                ("rows_grey", share * about.sin()),
            ],
        ),
        entry(
            "mains_banding",
            &[
                ("levels_grey", within(0.0, 4.0)),
                ("mains_hz", within(49.95, 50.05)),
                ("row_time_s", within(50e-6, 200e-6)),
                ("phase_rad", within(-PI, PI)),
            ],
        ),
        entry("tone_curve", &[("gamma", within(-1.0, 1.0).exp2())]),
        entry("range_clipping", &[("ceiling_grey", within(235.0, 255.0))]),
    ]
}

impl Drawn {
    pub fn new(chain: u64) -> Self {
        let mut rng = StdRng::seed_from_u64(0x11_6417 ^ (chain << 32));
        let mut table: toml::Table =
            toml::from_str(&Rig::builtin("lshpi").unwrap().effective_toml).unwrap();
        let camera = table["camera"].as_table_mut().unwrap();
        camera["rate_fps"] = toml::Value::Float(RATE_FPS);
        // Longer than two frames.
        camera["frozen_after_s"] = toml::Value::Float(5.0 / RATE_FPS);
        // Noise and background of the independent renderer's frames.
        camera["noise"]["read_sd"] = toml::Value::Float(1.5);
        camera["noise"]["ambient"] = toml::Value::Float(12.0);
        let text = toml::to_string(&table).unwrap();
        let rig = Rig::from_toml(&text, "chain.toml", None).unwrap();
        let mut vehicle = rig.vehicle.clone();
        for key in GROUPS.iter().flat_map(|g| keys(g.model)) {
            let coefficient = Coefficient::find(&key).unwrap();
            let off = 1.0 + rng.random_range(-0.15..0.15);
            coefficient.put(&mut vehicle, off * coefficient.of_vehicle(&rig.vehicle));
        }
        let mut world = rig.clone();
        world.vehicle = vehicle;
        Drawn {
            chain,
            rig,
            world,
            light: light(&mut rng),
        }
    }

    /// The rig that is simulated.
    pub fn simulated(&self, lit: bool) -> Rig {
        let mut rig = self.world.clone();
        if lit {
            rig.physics.clone_from(&self.light);
        }
        rig
    }

    pub fn light_in_words(&self) -> String {
        let words = self.light.iter().map(|e| {
            let numbers = e.parameters.iter().map(|(name, value)| match value {
                ParameterValue::Number(v) => format!("{name} {v:.3}"),
                ParameterValue::Word(w) => format!("{name} {w}"),
            });
            numbers.collect::<Vec<_>>().join(", ")
        });
        words.collect::<Vec<_>>().join("; ")
    }

    /// Key of a result: the chain, and the binary that made it.
    pub fn key(&self, lit: bool, groups: &[Group]) -> String {
        let program = crate::support::hydroline();
        let made = std::fs::metadata(program.get_program()).unwrap();
        let rig = self.simulated(lit);
        format!(
            "{:?} {} {:?} {:?} {groups:?}",
            made.modified().unwrap(),
            made.len(),
            rig.vehicle,
            rig.physics
        )
    }
}

/// Keys of a DOF's coefficients.
pub fn keys(model: &str) -> Vec<String> {
    let dof = hydroline_rigs::Dof::ALL
        .into_iter()
        .find(|d| d.name() == model);
    Coefficient::of(dof.unwrap())
        .iter()
        .map(|c| c.key().to_owned())
        .collect()
}
