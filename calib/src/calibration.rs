//! A map with its provenance, as it stands in logs (`hydroline.PlaneCalibration`) and files.

use std::path::Path;

pub mod board_map;
pub mod compare;
pub mod usage;

use serde::{Deserialize, Serialize};

use crate::IdealMap;
use crate::board::coplanarity::Coplanarity;
use crate::free::SheetMap;
use crate::map::{FittedMap, HomographyMap, RefractiveMap};
use crate::plane::{Fan, ImageSize, PlaneMap};
use board_map::{BoardMap, NoMap};
pub use board_map::{NodeResidual, Placement};

/// Error of a calibration file.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum CalibError {
    #[error("{file}: {reason}; check the path, or write a calibration with `hydroline calibrate`")]
    NoFile { file: String, reason: String },
    #[error("{file}: not a calibration file: {reason}. Write a new one with `hydroline calibrate`")]
    Unreadable {
        file: String,
        /// The parser's words, with line.
        reason: String,
    },
    #[error(
        "{file}: {key} is {value}, but must be {allowed}. Calibrate again, or restore the file"
    )]
    OutOfRange {
        file: String,
        key: &'static str,
        value: f64,
        allowed: &'static str,
    },
    #[error("the calibration cannot be written: {reason}")]
    Unwritable { reason: String },
}

/// Medium that the light passed through when the map was made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Medium {
    /// In air, or an ideal camera without water.
    Air,
    /// In fresh water (n about 1.333).
    Fresh,
    /// In sea water (n about 1.340).
    Salt,
}

impl Medium {
    /// Name in files and messages.
    pub fn name(self) -> &'static str {
        match self {
            Medium::Air => "air",
            Medium::Fresh => "fresh",
            Medium::Salt => "salt",
        }
    }
}

/// Fit of a map to the nodes it was made from.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Residuals {
    /// Nodes used.
    pub nodes: u32,
    /// Root mean square in ξ \[m\].
    pub rms_xi_m: f64,
    /// Root mean square in η \[m\].
    pub rms_eta_m: f64,
    /// Largest in either \[m\].
    pub max_m: f64,
}

/// Parameters of [`IdealMap`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct IdealParameters {
    /// Focal length along columns \[px\].
    pub fx_px: f64,
    /// Focal length along rows \[px\].
    pub fy_px: f64,
    /// Principal point, column \[px\].
    pub cx_px: f64,
    /// Principal point, row \[px\].
    pub cy_px: f64,
    /// η of the camera \[m\].
    pub eta_c_m: f64,
    /// ζ of the camera, negative behind the sheet \[m\].
    pub zeta_c_m: f64,
    /// α, optical axis from the vertical \[rad\].
    pub camera_tilt_rad: f64,
    /// Image the map holds for.
    pub image: ImageSize,
    /// Lit part of the sheet.
    pub fan: Fan,
}

/// Method and parameters of a map.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "method")]
#[non_exhaustive]
pub enum MapParameters {
    /// The paper's Eqs. 11–12.
    #[serde(rename = "eq11-12")]
    Ideal(IdealParameters),
    /// A literal Wang-Cheng map, rectified or not (`kind`).
    #[serde(rename = "grid")]
    #[cfg(feature = "lab")]
    Grid(Box<crate::map::GridMap>),
    /// Homography and Brown distortion.
    #[serde(rename = "homography")]
    Homography(Box<HomographyMap>),
    /// Flat port.
    #[serde(rename = "refractive")]
    Refractive(Box<RefractiveMap>),
    /// Camera and sheet from boards held in the hand.
    #[serde(rename = "free")]
    Free(Box<SheetMap>),
}

impl MapParameters {
    /// Name of the method in files, logs and `--method`.
    pub fn method(&self) -> &'static str {
        match self {
            MapParameters::Ideal(_) => "eq11-12",
            #[cfg(feature = "lab")]
            MapParameters::Grid(map) => map.kind().name(),
            MapParameters::Homography(_) => "homography",
            MapParameters::Refractive(_) => "refractive",
            MapParameters::Free(_) => "free",
        }
    }

    /// The map fitted to a board; `None` for the analytic map.
    pub fn fitted(&self) -> Option<FittedMap> {
        match self {
            MapParameters::Ideal(_) => None,
            #[cfg(feature = "lab")]
            MapParameters::Grid(map) => Some(FittedMap::Grid((**map).clone())),
            MapParameters::Homography(map) => Some(FittedMap::Homography((**map).clone())),
            MapParameters::Refractive(map) => Some(FittedMap::Refractive((**map).clone())),
            MapParameters::Free(map) => Some(FittedMap::Free((**map).clone())),
        }
    }
}

/// A calibration: a map and where it comes from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Calibration {
    /// Medium of the calibration; a run in another medium is refused unless forced.
    pub medium: Medium,
    /// When it was made, RFC 3339; none for a map that follows from the rig alone.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub date: Option<String>,
    /// Board it was made with.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub board: Option<String>,
    /// Requirements not yet met when it was written, in words; empty = it was accepted.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub missing: Vec<String>,
    /// Images it holds for: a map of another size or crop is another map. `None`: from before sizes were kept.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub image: Option<ImageSize>,
    /// Fit at the board's nodes; none for a map that follows from the rig alone.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub residuals: Option<Residuals>,
    /// Where the board's middle stood in the sheet's coordinates.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub placement: Option<Placement>,
    /// Board against sheet; none for a map that follows from the rig alone.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub coplanarity: Option<Coplanarity>,
    /// Method and parameters.
    pub map: MapParameters,
    /// Residual of the map at each node.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub nodes: Vec<NodeResidual>,
}

impl Calibration {
    /// Reads a calibration file.
    ///
    /// # Errors
    /// [`CalibError`], naming the file.
    pub fn load(path: &Path) -> Result<Self, CalibError> {
        let file = path.display().to_string();
        let text = hydroline_rigs::bounded::read_text(path, hydroline_rigs::bounded::RESULT_BYTES)
            .map_err(|error| CalibError::NoFile {
                file: file.clone(),
                reason: error.to_string(),
            })?;
        Self::from_toml(&text, &file)
    }

    /// Reads a calibration from a text; `file` is for messages.
    ///
    /// # Errors
    /// [`CalibError::Unreadable`] or [`CalibError::OutOfRange`], naming `file`.
    pub fn from_toml(text: &str, file: &str) -> Result<Self, CalibError> {
        let calibration: Calibration =
            toml::from_str(text).map_err(|error| CalibError::Unreadable {
                file: file.to_owned(),
                reason: error.to_string().trim_end().to_owned(),
            })?;
        calibration.check(file)?;
        Ok(calibration)
    }

    /// The calibration as a file that reads back to itself.
    ///
    /// # Errors
    /// [`CalibError::Unwritable`] when TOML cannot hold it.
    pub fn to_toml(&self) -> Result<String, CalibError> {
        toml::to_string(self).map_err(|error| CalibError::Unwritable {
            reason: error.to_string(),
        })
    }

    /// The map, ready to use.
    pub fn to_map(&self) -> Box<dyn PlaneMap> {
        match (&self.map, self.map.fitted()) {
            (_, Some(fitted)) => Box::new(BoardMap::new(self.clone(), fitted)),
            (MapParameters::Ideal(parameters), None) => {
                Box::new(IdealMap::from_parameters(*parameters, self.medium))
            }
            // `fitted` has an answer for every other method; a map that knows nothing is
            // the honest remainder.
            (_, None) => Box::new(NoMap(self.clone())),
        }
    }

    fn check(&self, file: &str) -> Result<(), CalibError> {
        let check = |key, value: f64, sound: bool, allowed| {
            if value.is_finite() && sound {
                Ok(())
            } else {
                Err(CalibError::OutOfRange {
                    file: file.to_owned(),
                    key,
                    value,
                    allowed,
                })
            }
        };
        if let Some(r) = self.residuals {
            let length = "a length of 0 m or more";
            check("residuals.rms_xi_m", r.rms_xi_m, r.rms_xi_m >= 0.0, length)?;
            check(
                "residuals.rms_eta_m",
                r.rms_eta_m,
                r.rms_eta_m >= 0.0,
                length,
            )?;
            check("residuals.max_m", r.max_m, r.max_m >= 0.0, length)?;
        }
        let number = "a sound number";
        if let Some(p) = &self.placement {
            check("placement", p.xi_m + p.eta_m + p.turn_rad, true, number)?;
        }
        let sound = self.coplanarity.as_ref().is_none_or(Coplanarity::is_sound);
        check("coplanarity", 0.0, sound, "finite, its camera off the face")?;
        let p = match &self.map {
            MapParameters::Ideal(p) => p,
            #[cfg(feature = "lab")]
            MapParameters::Grid(_) => return Ok(()), // its nodes were checked while it was built
            MapParameters::Homography(map) => {
                return check(
                    "map.parameters",
                    0.0,
                    map.is_sound(),
                    "as the fit wrote them",
                );
            }
            MapParameters::Free(map) => {
                return check(
                    "map.parameters",
                    0.0,
                    map.is_sound(),
                    "as the fit wrote them",
                );
            }
            MapParameters::Refractive(map) => {
                return check(
                    "map.parameters",
                    0.0,
                    map.is_sound(),
                    "as the fit wrote them",
                );
            }
        };
        let focal = "a focal length from 1 to 1e6 px";
        check("map.fx_px", p.fx_px, (1.0..=1e6).contains(&p.fx_px), focal)?;
        check("map.fy_px", p.fy_px, (1.0..=1e6).contains(&p.fy_px), focal)?;
        let point = "a pixel coordinate within 1e5 px";
        check("map.cx_px", p.cx_px, p.cx_px.abs() <= 1e5, point)?;
        check("map.cy_px", p.cy_px, p.cy_px.abs() <= 1e5, point)?;
        check(
            "map.eta_c_m",
            p.eta_c_m,
            p.eta_c_m.abs() <= 40.0,
            "within 40 m",
        )?;
        let apart = "from 1 mm to 40 m in size, negative behind the sheet";
        check(
            "map.zeta_c_m",
            p.zeta_c_m,
            (1e-3..=40.0).contains(&p.zeta_c_m.abs()),
            apart,
        )?;
        let tilt = p.camera_tilt_rad;
        check(
            "map.camera_tilt_rad",
            tilt,
            tilt.abs() < 1.57,
            "within 1.57 rad",
        )?;
        let size = "from 1 to 16384 px";
        let [w, h] = [p.image.width_px, p.image.height_px];
        check(
            "map.image.width_px",
            f64::from(w),
            (1..=16384).contains(&w),
            size,
        )?;
        check(
            "map.image.height_px",
            f64::from(h),
            (1..=16384).contains(&h),
            size,
        )?;
        check(
            "map.fan.apex_eta_m",
            p.fan.apex_eta_m,
            p.fan.apex_eta_m.abs() <= 40.0,
            "within 40 m",
        )?;
        let angle = p.fan.angle_rad;
        check(
            "map.fan.angle_rad",
            angle,
            angle > 0.0 && angle < 3.0,
            "above 0 and below 3 rad",
        )
    }
}

#[cfg(test)]
mod tests;
