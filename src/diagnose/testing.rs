//! Runs made in memory for the tests of the diagnosis.

use hydroline_rigs::{Dof, ParameterValue, PhysicsEntry, Rig};
use hydroline_sim::model::{Model, ModelState};
use hydroline_sim::trajectory::Trajectory;
use nalgebra::DVector;

use super::family::{Acts, Family, FamilyFit, Prior, Variable};
use super::search::Search;
use super::setting::Setting;
use hydroline_identify::data::{Command, Run, Sample};

/// rms of the roughness that stands for noise \[m\].
pub const NOISE_M: f64 = 1.5e-4;

/// Evenly spread over +-1, the same at every call.
fn rough(i: u32) -> f64 {
    f64::from((i.wrapping_mul(2_654_435_761) >> 16) % 2001) / 1000.0 - 1.0
}

/// A surge run of 16 s at 12.5 Hz of the built-in rig with these effects at work; `k` varies the commands.
pub fn surge(k: usize, effects: &[(&str, &[(&str, f64)])]) -> Run {
    pulled(k, effects, None)
}

/// The same with a force \[N\] from and to these times \[s\] (between 7 s and 11 s) that no command shows.
pub fn pulled(k: usize, effects: &[(&str, &[(&str, f64)])], pull: Option<(f64, f64, f64)>) -> Run {
    let mut rig = Rig::builtin("lshpi").unwrap();
    rig.physics.extend(effects.iter().map(|(effect, numbers)| {
        PhysicsEntry {
            effect: (*effect).to_owned(),
            parameters: numbers
                .iter()
                .map(|(n, v)| ((*n).to_owned(), ParameterValue::Number(*v)))
                .collect(),
        }
    }));
    let model = Model::from_rig(&rig).unwrap();
    let mut path = Trajectory::new(model, ModelState::at_rest([0.0; 6]), 0.01).unwrap();
    let mut made = Run {
        name: format!("run{k}"),
        ..Run::default()
    };
    let step_s = k as f64;
    let surge = |load: f64| [load, 0.0, 0.0, 0.0, 0.0, 0.0];
    for (t_s, load) in [
        (0.0, 4.0 + 2.0 * k as f64),
        (5.0 + step_s, -6.0),
        (11.0, 0.0),
    ] {
        if let Some((from_s, to_s, force)) = pull.filter(|p| t_s == 11.0 && p.0 >= 7.0) {
            path.command(from_s, surge(-6.0 + force)).unwrap();
            path.command(to_s, surge(-6.0)).unwrap();
        }
        let wrench = surge(load);
        path.command(t_s, wrench).unwrap();
        made.commands.push(Command { t_s, wrench });
    }
    for i in 0..200u32 {
        let t_s = 0.006 + 0.08 * f64::from(i);
        let mut values = [f64::NAN; 12];
        let noise = NOISE_M * 3.0_f64.sqrt() * rough(i + 1000 * k as u32);
        values[0] = path.state_at(t_s).unwrap().vehicle.eta[0] + noise;
        made.samples.push(Sample {
            t_s,
            values,
            covariance: None,
        });
    }
    made
}

/// The same, made by the equation of surge alone, with any force \[N\] of the speed \[m/s\].
pub fn forced(k: usize, force_n: impl Fn(f64) -> f64) -> Run {
    let mut made = surge(k, &[]);
    let rig = Rig::builtin("lshpi").unwrap();
    let own = rig.vehicle.coefficients[Dof::Surge.index()];
    let inertia = rig.vehicle.mass_kg - own.added;
    let load = |t_s: f64| {
        let until = made.commands.partition_point(|c| c.t_s <= t_s);
        made.commands[until - 1].wrench[0]
    };
    let (mut x, mut u, mut t_s) = (0.0, 0.0, 0.0);
    let step_s = 5e-4;
    for i in 0..200u32 {
        let at_s = 0.006 + 0.08 * f64::from(i);
        while t_s < at_s - 0.5 * step_s {
            let drag = own.linear * u + own.quadratic * u.abs() * u;
            u += step_s * (load(t_s) + drag + force_n(u)) / inertia;
            x += step_s * u;
            t_s += step_s;
        }
        let noise = NOISE_M * 3.0_f64.sqrt() * rough(i + 1000 * k as u32);
        made.samples[i as usize].values[0] = x + noise;
    }
    made
}

/// A free function of these amplitudes, each with this sd.
pub fn hats(
    acts: Acts,
    variable: Variable,
    knots: Vec<f64>,
    amplitudes: Vec<f64>,
    sd: f64,
) -> FamilyFit {
    FamilyFit {
        sds: vec![sd; amplitudes.len()],
        amplitudes,
        family: Family {
            acts,
            variable,
            knots,
            measured: false,
            quiet: Vec::new(),
        },
        gain: 0.0,
        prior: Prior {
            sd: 0.5,
            length: 0.0,
        },
        response: DVector::zeros(0),
    }
}

/// What is diagnosed of such runs.
pub fn setting(runs: &[Run]) -> Setting {
    Setting::new(runs, &Rig::builtin("lshpi").unwrap(), Dof::Surge).unwrap()
}

/// Index of an effect among the candidates.
pub fn candidate(setting: &Setting, id: &str) -> usize {
    let found = setting.vocabulary.iter().position(|c| c.info.id == id);
    found.unwrap()
}

/// A search that has fitted nothing and every candidate by itself.
pub fn searched(setting: &Setting) -> Search<'_> {
    let mut search = Search::new(setting, &|_| {});
    search.nothing();
    search.singles();
    search
}
