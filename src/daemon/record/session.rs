//! Head of a recording: who, where, with what, under which conditions.

use hydroline_capture::SourceDescription;
use hydroline_core::build_info::BuildInfo;
use hydroline_core::session::{Conditions, FREE_KEY};
use hydroline_log::{Head, MetadataMap};
use hydroline_rigs::{Plan, Rig};

/// Inputs of a recording's head.
#[derive(Debug, Clone)]
pub struct SessionInput<'a> {
    /// The rig.
    pub rig: &'a Rig,
    /// The plan, if one runs.
    pub plan: Option<&'a Plan>,
    /// Planned length \[s\], if there is one.
    pub planned_s: Option<f64>,
    /// The camera as set up.
    pub source: &'a SourceDescription,
    /// Conditions that the person at the tank states.
    pub conditions: &'a Conditions,
    /// The calibration in force, TOML.
    pub calibration_toml: Option<String>,
    /// Run k of n, from 1.
    pub run: (u32, u32),
    /// The recording program.
    pub build: BuildInfo,
}

/// The head of the log.
///
/// # Errors
/// As [`Conditions::n_water`].
pub fn head(input: &SessionInput<'_>) -> Result<Head, String> {
    let mut session = MetadataMap::new();
    let mut put = |key: &str, value: String| session.insert(key.to_owned(), value);
    put("kind", "record".to_owned());
    put("host", read("/proc/sys/kernel/hostname"));
    put("kernel", read("/proc/sys/kernel/osrelease"));
    put("boot_id", read("/proc/sys/kernel/random/boot_id"));
    put(
        "source",
        serde_json::to_string(input.source).unwrap_or_default(),
    );
    put("source.driver", input.source.driver.clone());
    put("source.identity", input.source.identity.clone());
    for (name, value) in &input.source.module_parameters {
        put(&format!("module.{name}"), value.clone());
    }
    if let Some(planned_s) = input.planned_s {
        put("planned_s", planned_s.to_string());
    }
    if let Some(plan) = input.plan {
        put("plan.name", plan.name.clone());
        put("plan", plan.source_toml.clone());
    }
    let [x, y, z, phi, theta, psi] = input.rig.tank.start_pose;
    // Of this run: a repeated one starts where the one before has left the vehicle, not where the rig says.
    put(
        "start_pose",
        format!("[{x}, {y}, {z}, {phi}, {theta}, {psi}]"),
    );
    put("run", format!("{} of {}", input.run.0, input.run.1));
    let conditions = input.conditions;
    if let Some(note) = &conditions.note {
        put("note", note.clone());
    }
    if let Some(operator) = &conditions.operator {
        put("operator", operator.clone());
    }
    for (key, value) in &conditions.set {
        put(&format!("{FREE_KEY}{key}"), value.clone());
    }
    if let Some(medium) = conditions.medium {
        put("medium", medium.name().to_owned());
    }
    let numbers = [
        ("water.temperature_c", conditions.water_temperature_c),
        ("water.salinity_gpkg", conditions.salinity_gpkg),
        ("water.n_532nm", conditions.n_water()?),
        ("ballast_kg", conditions.ballast_kg),
    ];
    for (key, value) in numbers {
        if let Some(value) = value {
            put(key, value.to_string());
        }
    }
    Ok(Head {
        rig_toml: input.rig.effective_toml.clone(),
        calibration_toml: input.calibration_toml.clone(),
        session,
        build: input.build,
    })
}

/// One line of /proc; empty where the kernel does not state it.
fn read(path: &str) -> String {
    std::fs::read_to_string(path)
        .map(|s| s.trim().to_owned())
        .unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_head_says_what_was_known_and_nothing_else() {
        let rig = Rig::builtin("lshpi").unwrap();
        let conditions = Conditions {
            water_temperature_c: Some(18.0),
            ballast_kg: Some(0.35),
            operator: Some("Ada".to_owned()),
            set: [("plan".to_owned(), "none".to_owned())].into(),
            ..Conditions::default()
        };
        let source = SourceDescription::default();
        let input = SessionInput {
            rig: &rig,
            plan: None,
            planned_s: Some(10.0),
            source: &source,
            conditions: &conditions,
            calibration_toml: None,
            run: (1, 3),
            build: BuildInfo::default(),
        };
        let head = head(&input).unwrap();
        assert!(head.session["water.n_532nm"].starts_with("1.33"));
        assert_eq!(head.session["run"], "1 of 3");
        assert_eq!(head.session["operator"], "Ada");
        assert_eq!(head.session["set.plan"], "none");
        assert!(!head.session.contains_key("note") && !head.session.contains_key("plan"));
        assert_eq!(Rig::from_toml(&head.rig_toml, "log", None).unwrap(), rig);
    }

    #[test]
    fn water_beyond_the_equation_is_refused_with_the_range() {
        let conditions = Conditions {
            water_temperature_c: Some(60.0),
            ..Conditions::default()
        };
        assert!(conditions.n_water().unwrap_err().contains("0..30"));
        let only = |salinity_gpkg| Conditions {
            salinity_gpkg: Some(salinity_gpkg),
            ..Conditions::default()
        };
        assert!(only(60.0).n_water().unwrap_err().contains("0..35"));
        assert!(only(f64::NAN).n_water().is_err());
        assert_eq!(only(10.0).n_water(), Ok(None));
    }
}
