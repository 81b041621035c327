//! Reach of a vehicle's DOFs: the largest loads that thrusters give and that tank, limits and target allow.

use hydroline_calib::calibration::Calibration;
use hydroline_calib::plane::PlaneMap;
use hydroline_inference::prior::PriorTable;
use hydroline_plan::preflight::passes;
use hydroline_plan::size::scaled;
use hydroline_rigs::{Dof, Identified, Plan, PlanStep, Rig, Shape, StepLoad, Wrench};
use hydroline_sim::Allocation;

/// Steps of the plan by which a DOF's reach is found \[s\]: as long as one of a plan.
const THERE_S: f64 = 3.0;
/// Shares of what the thrusters give that are tried, each this times the one before: a design changes sizes by more.
const FINER: f64 = 0.8;
/// Smallest share that is tried: a thousandth of a thruster's force is lost in its deadband.
const SMALLEST_SHARE: f64 = 1e-3;
/// Halvings by which the load is found at which a thruster saturates: to the last bit, which costs nothing here.
const HALVINGS: usize = 60;

/// Largest loads per DOF \[N, N m\]; 0 = not driven.
pub type Reach = [f64; 6];

/// Long edges of the target that have to be in sight all the while: with one an estimator that has lost the pose does not find
/// it again.
const EDGES: u8 = 2;

/// Test of plans against a rig: which of them may be run.
pub struct Admission {
    /// The vehicle as the rig has it, and one that goes further.
    rigs: Vec<Rig>,
    map: Option<Box<dyn PlaneMap>>,
}

impl std::fmt::Debug for Admission {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Admission").finish_non_exhaustive()
    }
}

impl Admission {
    /// For this rig, seen through this calibration or the ideal camera.
    ///
    /// Where its coefficients were identified it moves as they say. Where they are a data sheet's, or published ones, a plan has
    /// to run as well on a vehicle that is lighter and less damped by one standard deviation of what is known of such coefficients.
    pub fn new(rig: &Rig, calibration: Option<&Calibration>) -> Admission {
        let mut made = Admission::of_known(rig, calibration);
        if !rig.identified.as_ref().is_some_and(Identified::is_measured) {
            let share = (-PriorTable::default().coefficient_ln).exp();
            // First: what it refuses need not be simulated again.
            made.rigs.insert(0, lighter(rig, share));
        }
        made
    }

    /// The same for a rig whose vehicle was fitted to runs at hand.
    pub fn of_known(rig: &Rig, calibration: Option<&Calibration>) -> Admission {
        Admission {
            rigs: vec![rig.clone()],
            map: calibration.map(Calibration::to_map),
        }
    }

    /// Whether the rig runs a plan, and sees both of its target's long edges all the while.
    pub fn admits(&self, plan: &Plan) -> bool {
        let passes = |rig: &Rig| passes(rig, plan, self.map.as_deref(), EDGES);
        self.rigs.iter().all(|rig| passes(rig).unwrap_or(false))
    }
}

/// The same vehicle with all masses and damping times `share`.
fn lighter(rig: &Rig, share: f64) -> Rig {
    let mut made = rig.clone();
    let v = &mut made.vehicle;
    v.mass_kg *= share;
    v.inertia_kgm2 = v.inertia_kgm2.map(|i| share * i);
    for c in &mut v.coefficients {
        c.added *= share;
        c.linear *= share;
        c.quadratic *= share;
    }
    made
}

fn there_and_back(dof: usize, load: f64) -> Plan {
    let step = |for_s: f64, share: f64| PlanStep {
        for_s,
        load: StepLoad::Wrench(Wrench::from_array(std::array::from_fn(|d| {
            if d == dof { share * load } else { 0.0 }
        }))),
        shape: Shape::Hold,
    };
    Plan {
        name: "reach".to_owned(),
        steps: vec![step(THERE_S, 1.0), step(THERE_S, -1.0)],
        source_toml: String::new(),
    }
}

/// Largest load in a DOF, either way, that no thruster cuts; `None` where the layout cannot make it alone.
fn saturates_at(allocation: &Allocation, dof: usize) -> Option<f64> {
    let whole = |load: f64| -> Option<bool> {
        let both = [load, -load].map(|load| {
            let wrench = std::array::from_fn(|d| if d == dof { load } else { 0.0 });
            let made = allocation.allocate(&Wrench::from_array(wrench)).ok()?;
            Some(made.saturated.is_empty())
        });
        Some(both[0]? && both[1]?)
    };
    let (mut low, mut high) = (0.0, 1.0);
    while whole(high)? {
        low = high;
        high *= 2.0;
    }
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if whole(middle)? {
            low = middle;
        } else {
            high = middle;
        }
    }
    (low > 0.0).then_some(low)
}

/// Largest load of each DOF, all others at neutral \[N, N m\].
pub fn reach(admission: &Admission, allocation: &Allocation, asked: &[Dof]) -> Reach {
    let mut reach = [0.0_f64; 6];
    for (d, dof) in Dof::ALL.iter().enumerate() {
        if !asked.is_empty() && !asked.contains(dof) {
            continue;
        }
        // A hair below saturation: what is asked for is rounded to the wire's grid.
        let Some(most) = saturates_at(allocation, d).map(|v| 0.98 * v) else {
            continue;
        };
        // Where it begins at one end of the target, one way is longer than the other.
        for load in [most, -most] {
            let plan = there_and_back(d, load);
            let mut share: f64 = 1.0;
            while share > SMALLEST_SHARE && !admission.admits(&scaled(&plan, share)) {
                share *= FINER;
            }
            if share > SMALLEST_SHARE {
                reach[d] = reach[d].max(most * share);
            }
        }
    }
    reach
}

#[cfg(test)]
mod tests {
    use super::*;

    fn heave(newton: f64) -> Plan {
        let text = format!(
            "name = \"heave\"\n[[step]]\nfor_s = 6.0\nwrench = {{ heave_n = {newton} }}\n[[step]]\nfor_s = 6.0\nwrench = {{ heave_n = -{newton} }}\n"
        );
        Plan::from_toml(&text, "heave.toml").unwrap()
    }

    #[test]
    fn a_plan_has_to_stay_where_the_calibration_holds() {
        let rig = Rig::builtin("lshpi").unwrap();
        let path = format!(
            "{}/../../tests/data/sample/calibration.toml",
            env!("CARGO_MANIFEST_DIR")
        );
        let calibration = Calibration::load(std::path::Path::new(&path)).unwrap();
        let ideal = Admission::of_known(&rig, None);
        let seen = Admission::of_known(&rig, Some(&calibration));
        // 4 N lift the floor by some 0.16 m: inside the image, above the board that was seen.
        let sizes = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0];
        let largest = |a: &Admission| {
            let fits = sizes.into_iter().filter(|n| a.admits(&heave(*n)));
            fits.fold(0.0, f64::max)
        };
        let (by_image, by_board) = (largest(&ideal), largest(&seen));
        assert!(
            0.0 < by_board && by_board < by_image,
            "{by_board} {by_image}"
        );
    }

    #[test]
    fn a_data_sheets_vehicle_leaves_room_that_an_identified_one_does_not() {
        let mut rig = Rig::builtin("lshpi").unwrap();
        rig.identified = None;
        let known = Admission::of_known(&rig, None);
        let sheet = Admission::new(&rig, None);
        let largest = |a: &Admission| {
            let mut share = 0.05;
            while a.admits(&heave(share * 1.05)) {
                share *= 1.05;
            }
            share
        };
        let (known, sheet) = (largest(&known), largest(&sheet));
        let ratio = sheet / known;
        // The lighter vehicle goes about e^0.3 times as far.
        assert!((0.6..0.95).contains(&ratio), "{sheet} of {known}");
    }
}
