//! Medium that the light of a run goes through, and whether a calibration may be used for it.

use hydroline_calib::calibration::MapParameters;
use hydroline_calib::calibration::usage::UseError;
use hydroline_calib::map::refractive::Known;
use hydroline_calib::{Calibration, Medium};
use hydroline_core::session::Conditions;
use hydroline_core::water::refractive_index;
use hydroline_log::MetadataMap;
use hydroline_rigs::Rig;

/// Below this index there is no water in front of the camera.
const N_AIR: f64 = 1.1;
/// Half way between the fresh and the sea water of rig files (1.333 and 1.340).
const N_SALT: f64 = 1.3365;
/// Half way between fresh and sea water \[g/kg\].
const SALT_GPKG: f64 = 17.5;

/// The medium of that name.
///
/// # Errors
/// Words with the names there are.
pub fn from_name(name: &str) -> Result<Medium, String> {
    [Medium::Air, Medium::Fresh, Medium::Salt]
        .into_iter()
        .find(|m| m.name() == name)
        .ok_or_else(|| format!("'{name}' is not air, fresh or salt"))
}

/// The medium a rig file speaks of (`tank.n_water`).
pub fn of_rig(rig: &Rig) -> Medium {
    match rig.tank.n_water {
        n if n < N_AIR => Medium::Air,
        n if n < N_SALT => Medium::Fresh,
        _ => Medium::Salt,
    }
}

fn of_water(temperature_c: Option<f64>, salinity_gpkg: Option<f64>) -> Option<Medium> {
    match (temperature_c, salinity_gpkg) {
        (None, None) => None,
        (_, Some(s)) if s >= SALT_GPKG => Some(Medium::Salt),
        _ => Some(Medium::Fresh),
    }
}

/// The medium of a run: as the person says, else as the water they measured says, else the rig's.
pub fn of_run(rig: &Rig, conditions: &Conditions) -> Medium {
    conditions
        .medium
        .or_else(|| of_water(conditions.water_temperature_c, conditions.salinity_gpkg))
        .unwrap_or_else(|| of_rig(rig))
}

/// The medium of a recorded run, from its log's session and rig; `None` where neither says.
pub fn of_log(session: Option<&MetadataMap>, rig: Option<&Rig>) -> Option<Medium> {
    let text = |key: &str| session.and_then(|s| s.get(key));
    let number = |key: &str| text(key).and_then(|v| v.parse().ok());
    text("medium")
        .and_then(|name| from_name(name).ok())
        .or_else(|| of_water(number("water.temperature_c"), number("water.salinity_gpkg")))
        .or_else(|| rig.map(of_rig))
}

/// Refractive index of a medium at the laser's 532 nm, as far as its name says.
pub fn index(medium: Medium) -> Known {
    match medium {
        Medium::Air => Known::new(1.0003, 0.0003),
        Medium::Fresh => Known::new(1.3350, 0.0015), // 532 nm, 0-30 degC (Quan and Fry 1995)
        Medium::Salt => Known::new(1.3415, 0.0020),
    }
}

/// Index of a run's water: measured temperature and salinity say it ten times better than the name.
pub fn index_of(medium: Medium, temperature_c: Option<f64>, salinity_gpkg: Option<f64>) -> Known {
    let measured = || refractive_index(temperature_c?, salinity_gpkg?, 532.0);
    match (medium, measured()) {
        (Medium::Fresh | Medium::Salt, Some(n)) => Known::new(n, 0.0002),
        _ => index(medium),
    }
}

/// [`index_of`] a recorded run.
pub fn index_of_log(medium: Medium, session: Option<&MetadataMap>) -> Known {
    let number = |key: &str| session.and_then(|s| s.get(key)?.parse().ok());
    index_of(
        medium,
        number("water.temperature_c"),
        number("water.salinity_gpkg"),
    )
}

/// Whether a calibration may be used: `Ok(Some(warning))` where it is forced, or where the paper's ideal
/// camera looks through water.
///
/// # Errors
/// [`UseError`] when the media differ and nobody forces it.
pub fn check(
    calibration: &Calibration,
    run: Medium,
    forced: bool,
) -> Result<Option<String>, UseError> {
    if matches!(calibration.map, MapParameters::Ideal(_)) {
        return Ok((run != Medium::Air).then(|| {
            format!(
                "no calibration: the ideal camera of Eqs. 11-12 knows no water, and the run is in {} water; `record --calibrate` makes one",
                run.name()
            )
        }));
    }
    calibration.check_use(run, forced)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_person_before_the_thermometer_before_the_rig() {
        let mut rig = Rig::builtin("lshpi").unwrap();
        let mut conditions = Conditions::default();
        assert_eq!(of_run(&rig, &conditions), Medium::Air);
        rig.tank.n_water = 1.34;
        assert_eq!(of_run(&rig, &conditions), Medium::Salt);
        conditions.water_temperature_c = Some(18.0);
        assert_eq!(of_run(&rig, &conditions), Medium::Fresh);
        conditions.salinity_gpkg = Some(33.0);
        assert_eq!(of_run(&rig, &conditions), Medium::Salt);
        conditions.medium = Some(Medium::Air);
        assert_eq!(of_run(&rig, &conditions), Medium::Air);
        let session = MetadataMap::from([("water.temperature_c".into(), "18".into())]);
        assert_eq!(of_log(Some(&session), Some(&rig)), Some(Medium::Fresh));
        assert_eq!(of_log(None, None), None);
        assert!(from_name("oil").unwrap_err().contains("salt"));
    }
}
