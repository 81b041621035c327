//! The conditions of a session, as only the person at the tank knows them.

use crate::water::refractive_index;
use hydroline_calib::Medium;
use serde::Serialize;
use std::collections::BTreeMap;

/// Laser wavelength for the refractive index \[nm\]: the green line lasers of the field.
const WAVELENGTH_NM: f64 = 532.0;

/// Beginning of the names that free keys have in a log's session: none is taken for something that hydroline writes or reads.
pub const FREE_KEY: &str = "set.";

/// Conditions that only the person at the tank knows.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Conditions {
    /// Free text.
    pub note: Option<String>,
    /// Water temperature \[degC\].
    pub water_temperature_c: Option<f64>,
    /// Salinity \[g/kg\].
    pub salinity_gpkg: Option<f64>,
    /// Extra ballast on the vehicle \[kg\].
    pub ballast_kg: Option<f64>,
    /// Who records.
    pub operator: Option<String>,
    /// Whatever else is to be noted, by key.
    pub set: BTreeMap<String, String>,
    /// Air, fresh or salt water; `None` = as temperature, salinity and rig say.
    pub medium: Option<Medium>,
}

impl Conditions {
    /// Refractive index of the water at 532 nm, when the temperature is known (salinity 0 unless given).
    ///
    /// # Errors
    /// Words, when temperature or salinity are outside what the equation was fitted to.
    pub fn n_water(&self) -> Result<Option<f64>, String> {
        let Some(temperature_c) = self.water_temperature_c else {
            return match self.salinity_gpkg {
                Some(salinity) if !(0.0..=35.0).contains(&salinity) => Err(format!(
                    "{salinity} g/kg: the refractive index is known for 0..35 g/kg; check --salinity"
                )),
                _ => Ok(None),
            };
        };
        let salinity = self.salinity_gpkg.unwrap_or(0.0);
        refractive_index(temperature_c, salinity, WAVELENGTH_NM).map(Some).ok_or_else(|| {
            format!(
                "water at {temperature_c} degC and {salinity} g/kg: the refractive index is known for 0..30 degC and 0..35 g/kg; check --water-temp and --salinity"
            )
        })
    }
}
