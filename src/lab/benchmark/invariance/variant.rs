//! Variants of a case that tell a diagnosis nothing else.

use hydroline_rigs::{Rig, Vehicle};

use super::base::{Base, Given};
use crate::benchmark::error::ProveError;

/// Factor of masses, damping and forces: from a vehicle of 30 kg to one of 1.8 t, which moves alike.
pub const SCALE: f64 = 60.0;

/// A variant.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    PartialOrd,
    Ord,
    serde::Serialize,
    schemars::JsonSchema,
    serde::Deserialize,
)]
#[serde(rename_all = "snake_case")]
pub enum Variant {
    /// Mass, inertia, added mass, damping and all forces sixty times as large: the same motion.
    Scaled,
    /// One run cut in two at half its length.
    Cut,
    /// The runs given in the reverse order.
    Reordered,
}

impl Variant {
    /// All of them.
    pub const ALL: [Variant; 3] = [Variant::Scaled, Variant::Cut, Variant::Reordered];

    /// Name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Variant::Scaled => "rig scaled by 60",
            Variant::Cut => "a run cut in two",
            Variant::Reordered => "runs reordered",
        }
    }

    /// Factor of forces.
    pub fn scale(self) -> f64 {
        match self {
            Variant::Scaled => SCALE,
            Variant::Cut | Variant::Reordered => 1.0,
        }
    }
}

fn scale_vehicle(vehicle: &mut Vehicle) {
    vehicle.mass_kg *= SCALE;
    vehicle.net_weight_n *= SCALE;
    let numbers = vehicle.inertia_kgm2.iter_mut();
    numbers
        .chain(&mut vehicle.stiffness)
        .for_each(|v| *v *= SCALE);
    for c in &mut vehicle.coefficients {
        for v in [&mut c.added, &mut c.linear, &mut c.quadratic] {
            *v *= SCALE;
        }
    }
}

/// A rig whose forces are scaled, its thrusters' too.
fn scaled(rig: &Rig) -> Rig {
    let mut made = rig.clone();
    scale_vehicle(&mut made.vehicle);
    for thruster in &mut made.thrusters.thrusters {
        for point in &mut thruster.curve.points {
            point.1 *= SCALE;
        }
    }
    made
}

/// A run under scaled forces: the same pulses, the same motion.
fn scaled_run(mut given: Given, rig: &Rig) -> Result<Given, ProveError> {
    if let Some(recorded) = &mut given.recorded {
        for command in &mut recorded.commands {
            command.thrust_n *= SCALE;
        }
        given.source = recorded.source(rig)?;
        return Ok(given);
    }
    for command in &mut given.source.run.commands {
        command.wrench = command.wrench.map(|v| v * SCALE);
    }
    Ok(given)
}

/// Both halves of a run, each with all of its commands: the past acts on.
fn halves(whole: &Given) -> [Given; 2] {
    let run = &whole.source.run;
    let middle = run.samples.len() / 2;
    let around = run.samples.get(middle.saturating_sub(1)..=middle);
    // Between two stamps, so that no sample is in both.
    let at_s = around.map_or(0.0, |s| {
        s.iter().map(|s| s.t_s).sum::<f64>() / s.len() as f64
    });
    [(f64::NEG_INFINITY, at_s), (at_s, f64::INFINITY)].map(|(from_s, to_s)| {
        let mut half = whole.clone();
        half.recorded = None;
        half.source.run = run.clone().window(from_s, to_s);
        half.source.run.name = match from_s.is_finite() {
            true => format!("{}@{at_s:.3}..", run.name),
            false => format!("{}@0..{at_s:.3}", run.name),
        };
        half
    })
}

impl Base {
    /// The case in a variant.
    ///
    /// # Errors
    /// [`ProveError`].
    pub fn varied(&self, variant: Variant) -> Result<Base, ProveError> {
        let mut made = self.clone();
        match variant {
            Variant::Scaled => {
                made.rig = scaled(&self.rig);
                let each = self.given.iter().cloned();
                let each = each.map(|g| scaled_run(g, &made.rig));
                made.given = each.collect::<Result<_, _>>()?;
            }
            Variant::Cut => {
                let place = self.index % made.given.len().max(1);
                if let Some(whole) = self.given.get(place) {
                    made.given.splice(place..=place, halves(whole));
                }
            }
            Variant::Reordered => made.given.reverse(),
        }
        Ok(made)
    }
}

#[cfg(test)]
mod tests {
    use super::super::make;
    use super::*;
    use hydroline_identify::data::memory_s;
    use hydroline_sim::model::{Model, ModelState};
    use hydroline_sim::trajectory::Trajectory;

    /// The same pulses move the scaled vehicle alike, under loads that are sixty times as large; nothing but the scale is changed.
    #[test]
    fn a_scaled_vehicle_moves_alike() {
        for index in [0, 2] {
            let base = make(1, index).unwrap();
            let other = base.varied(Variant::Scaled).unwrap();
            assert_eq!(memory_s(&base.rig.vehicle), memory_s(&other.rig.vehicle));
            for (a, b) in base.given.iter().zip(&other.given) {
                let [a, b] = [a, b].map(|g| &g.source.run);
                assert!(a.same_recording(b));
                let [a_n, b_n] = [a, b].map(|r| r.largest_wrench()[0]);
                assert!((b_n / a_n - SCALE).abs() < 1e-9, "{a_n} {b_n}");
            }
            let moved = |base: &Base| {
                let model = Model::from_rig(&base.rig).unwrap();
                let start = ModelState::at_rest(base.rig.tank.start_pose);
                let mut path = Trajectory::new(model, start, 0.01).unwrap();
                for c in &base.given[0].source.run.commands {
                    path.command(c.t_s, c.wrench).unwrap();
                }
                path.state_at(12.0).unwrap().vehicle.eta
            };
            for (a, b) in moved(&base).iter().zip(moved(&other)) {
                assert!((a - b).abs() < 1e-9, "{a} {b}");
            }
        }
    }

    #[test]
    fn a_run_that_is_cut_has_the_same_samples_once() {
        let base = make(1, 1).unwrap();
        let cut = base.varied(Variant::Cut).unwrap();
        assert_eq!(cut.given.len(), base.given.len() + 1);
        let samples =
            |b: &Base| -> usize { b.given.iter().map(|g| g.source.run.samples.len()).sum() };
        assert_eq!(samples(&cut), samples(&base));
        let runs = [1, 2].map(|k| &cut.given[k].source.run);
        assert!(runs[0].end_s() < runs[1].samples[0].t_s);
        assert_eq!(runs[0].commands, runs[1].commands);
        assert_ne!(runs[0].name, runs[1].name);
        let back = base.varied(Variant::Reordered).unwrap();
        assert_eq!(back.given[0].source.run.name, base.given[3].source.run.name);
    }
}
