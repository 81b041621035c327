//! Fixtures of the effects' unit tests: entries, a vehicle without friction, forces at one state.

use crate::effect::{EffectStack, Optics};
use crate::fixture::lshpi_rig;
use crate::model::{Model, ModelState};
use crate::scene::{ColumnTruth, Pose6, Renderer};
use crate::trajectory::Trajectory;
use crate::vehicle::Hydrodynamics;
use crate::world::World;
use hydroline_rigs::{ParameterValue, PhysicsEntry, Rig, Wrench};

pub(in crate::effect) fn entry(effect: &str, parameters: &[(&str, f64)]) -> PhysicsEntry {
    let numbers = parameters
        .iter()
        .map(|(n, v)| ((*n).to_owned(), ParameterValue::Number(*v)));
    PhysicsEntry {
        effect: effect.to_owned(),
        parameters: numbers.collect(),
    }
}

pub(in crate::effect) fn with_word(mut e: PhysicsEntry, name: &str, word: &str) -> PhysicsEntry {
    e.parameters
        .push((name.to_owned(), ParameterValue::Word(word.to_owned())));
    e
}

pub(in crate::effect) fn stack(entries: &[PhysicsEntry]) -> EffectStack {
    EffectStack::build(entries).unwrap()
}

pub(in crate::effect) fn surge(x_n: f64) -> [f64; 6] {
    [x_n, 0.0, 0.0, 0.0, 0.0, 0.0]
}

/// Surge alone, without drag: M u' = thrust, so u shows the thrust's integral. With M.
pub(in crate::effect) fn frictionless(entries: &[PhysicsEntry]) -> (Trajectory, f64) {
    let mut v = lshpi_rig().vehicle;
    for c in &mut v.coefficients {
        (c.linear, c.quadratic) = (0.0, 0.0);
    }
    let hydrodynamics = Hydrodynamics::new(&v);
    let mass = hydrodynamics.mass()[0];
    let model = Model {
        hydrodynamics,
        effects: stack(entries),
    };
    let start = ModelState::at_rest([0.0; 6]);
    (Trajectory::new(model, start, 0.005).unwrap(), mass)
}

/// The rig at the tank's origin with these effects.
pub(in crate::effect) fn world(entries: &[PhysicsEntry]) -> World {
    let mut rig = lshpi_rig();
    rig.physics = entries.to_vec();
    World::new(&rig, [0.0; 6]).unwrap()
}

/// 8 N ahead and astern by turns, a second each.
pub(in crate::effect) fn drive(w: &mut World, until_s: f64) {
    let mut t_s = 0.1;
    let mut surge_n = 8.0;
    while t_s < until_s {
        let wrench = Wrench {
            surge_n,
            ..Wrench::default()
        };
        w.command(t_s, &wrench).unwrap();
        (t_s, surge_n) = (t_s + 1.0, -surge_n);
    }
}

#[derive(Debug, Clone, Copy, Default)]
pub(in crate::effect) struct State {
    pub eta: [f64; 6],
    pub nu: [f64; 6],
}

/// Acceleration at a state at t = 0, own states 0.
pub(in crate::effect) fn acceleration(
    entries: &[PhysicsEntry],
    state: State,
    wrench: [f64; 6],
) -> [f64; 6] {
    let model = Model {
        hydrodynamics: Hydrodynamics::new(&lshpi_rig().vehicle),
        effects: stack(entries),
    };
    let mut s = ModelState::at_rest(state.eta);
    s.vehicle.nu = state.nu;
    model.rate(0.0, 0.0, &s, &wrench).vehicle.nu
}

/// Mass (without effects) times acceleration.
pub(in crate::effect) fn force(
    entries: &[PhysicsEntry],
    state: State,
    wrench: [f64; 6],
) -> [f64; 6] {
    let mass = Hydrodynamics::<f64>::new(&lshpi_rig().vehicle).mass();
    let a = acceleration(entries, state, wrench);
    std::array::from_fn(|i| a[i] * mass[i])
}

/// Force that the effects add.
pub(in crate::effect) fn extra(
    entries: &[PhysicsEntry],
    state: State,
    wrench: [f64; 6],
) -> [f64; 6] {
    let (with, without) = (force(entries, state, wrench), force(&[], state, wrench));
    std::array::from_fn(|i| with[i] - without[i])
}

pub(in crate::effect) fn optics(entries: &[PhysicsEntry]) -> Optics {
    stack(entries).optics(Optics::new(&lshpi_rig()))
}

/// A bare floor, and a column whose middle lies on the axis.
const MIDDLE: usize = 360;

fn bare_rig(entries: &[PhysicsEntry]) -> Rig {
    let mut rig = lshpi_rig();
    rig.target = None;
    rig.camera.cx_px = MIDDLE as f64;
    rig.laser.peak = 200.0;
    rig.physics = entries.to_vec();
    rig
}

fn level(height_m: f64) -> Pose6 {
    Pose6 {
        z_m: -height_m,
        ..Pose6::default()
    }
}

/// The stripe of a level vehicle over a bare floor, from port to starboard.
pub(in crate::effect) fn profile(entries: &[PhysicsEntry], height_m: f64) -> Vec<ColumnTruth> {
    let renderer = Renderer::new(&bare_rig(entries)).unwrap();
    renderer.profile_truth(&level(height_m).into())
}

/// The stripe of a level vehicle at x over the hexagon target.
pub(in crate::effect) fn profile_over(entries: &[PhysicsEntry], x_m: f64) -> Vec<ColumnTruth> {
    let mut rig = lshpi_rig();
    rig.physics = entries.to_vec();
    let pose = Pose6 { x_m, ..level(0.83) };
    Renderer::new(&rig).unwrap().profile_truth(&pose.into())
}

#[derive(Debug, Clone, Copy)]
pub(in crate::effect) struct Row {
    pub row_px: f64,
    pub centre_px: f64,
    pub focal_px: f64,
}

/// A bare floor 0.78 m below, seen by one camera.
pub(in crate::effect) struct Bare {
    lit: Renderer,
    dark: Renderer,
    focal_px: f64,
}

impl Bare {
    pub fn new(entries: &[PhysicsEntry]) -> Self {
        Self::of(bare_rig(entries))
    }

    /// Without noise, over this background.
    pub fn quiet(ambient: f64, entries: &[PhysicsEntry]) -> Self {
        Self::noisy(ambient, 0.0, entries)
    }

    /// With read noise, over this background.
    pub fn noisy(ambient: f64, read_sd: f64, entries: &[PhysicsEntry]) -> Self {
        let mut rig = bare_rig(entries);
        rig.camera.noise.read_sd = read_sd;
        rig.camera.noise.shot_gain = 0.0;
        rig.camera.noise.ambient = ambient;
        Self::of(rig)
    }

    fn of(mut rig: Rig) -> Self {
        let lit = Renderer::new(&rig).unwrap();
        rig.laser.peak = 0.0;
        Bare {
            lit,
            dark: Renderer::new(&rig).unwrap(),
            focal_px: rig.camera.fx_px,
        }
    }

    pub fn width_px(&self) -> usize {
        self.lit.width_px()
    }

    pub fn focal_px(&self) -> f64 {
        self.focal_px
    }

    /// Laser light alone.
    pub fn clean(&self, height_m: f64) -> Vec<f32> {
        self.lit.render_clean(&level(height_m))
    }

    /// Grey levels.
    pub fn image(&self) -> Vec<u8> {
        self.lit.render(&level(0.78), 0).0
    }

    /// Grey levels with the laser off.
    pub fn dark(&self) -> Vec<u8> {
        self.dark_frame(0)
    }

    pub fn dark_frame(&self, frame: u64) -> Vec<u8> {
        self.dark.render(&level(0.78), frame).0
    }
}

/// Row of the stripe in the axis' column, without and with the effects.
pub(in crate::effect) fn stripe_rows(entries: &[PhysicsEntry], height_m: f64) -> (Row, Row) {
    let camera = lshpi_rig().camera;
    let of = |entries: &[PhysicsEntry]| {
        let points = profile(entries, height_m);
        let middle = points.iter().find(|p| p.column_px as usize == MIDDLE);
        Row {
            row_px: middle.unwrap().row_px,
            centre_px: camera.cy_px,
            focal_px: camera.fy_px,
        }
    };
    (of(&[]), of(entries))
}

/// Laser light down the axis' column at 0.78 m.
pub(in crate::effect) fn column(entries: &[PhysicsEntry]) -> Vec<f64> {
    let renderer = Renderer::new(&bare_rig(entries)).unwrap();
    let picture = renderer.render_clean(&level(0.78));
    let column = picture.iter().skip(MIDDLE).step_by(renderer.width_px());
    column.map(|v| f64::from(*v)).collect()
}

/// Row of a stripe by a Gaussian window of 2 px that follows its own mean.
pub(in crate::effect) fn centre(column: &[f64]) -> f64 {
    let brightest = column.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1));
    let mut c = brightest.unwrap().0 as f64;
    for _ in 0..200 {
        let (mut moment, mut sum) = (0.0, 0.0);
        for (row, light) in column.iter().enumerate() {
            let d = row as f64 - c;
            let weight = (-0.5 * (d / 2.0).powi(2)).exp() * light;
            (moment, sum) = (moment + weight * d, sum + weight);
        }
        c += moment / sum;
    }
    c
}

/// Grey levels of a frame at 0.78 m.
pub(in crate::effect) fn image(entries: &[PhysicsEntry]) -> Vec<u8> {
    let renderer = Renderer::new(&bare_rig(entries)).unwrap();
    renderer.render(&level(0.78), 0).0
}
