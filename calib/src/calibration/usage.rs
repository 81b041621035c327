//! Whether a calibration may be used, and what it claims.

use super::{Calibration, MapParameters, Medium};
use crate::board::coplanarity::Coplanarity;
use crate::map::refractive::Known;
use crate::plane::ImageSize;

/// Why a calibration is refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum UseError {
    #[error(
        "the calibration was made in {made} (board {board}), the run is in {run}: {cost}. Calibrate in {run}, or force it"
    )]
    Medium {
        made: &'static str,
        run: &'static str,
        board: String,
        cost: &'static str,
    },
    #[error(
        "the calibration was made from images of {} × {} px, the run's have {} × {}: another size or crop is another map. Calibrate with the run's camera settings",
        made.width_px, made.height_px, run.width_px, run.height_px
    )]
    Image { made: ImageSize, run: ImageSize },
}

impl Calibration {
    /// Checks the medium. `Ok(None)`: fits; `Ok(Some(warning))`: does not, but `forced`.
    ///
    /// # Errors
    /// [`UseError::Medium`] when the media differ and nobody forces it. A map that follows
    /// from the rig alone (Eqs. 11–12) claims no medium and is never refused.
    pub fn check_use(&self, run: Medium, forced: bool) -> Result<Option<String>, UseError> {
        if self.medium == run || matches!(self.map, MapParameters::Ideal(_)) {
            return Ok(None);
        }
        let air = self.medium == Medium::Air || run == Medium::Air;
        let cost = if air {
            "behind a flat port everything would be off by a third"
        } else {
            "fresh against sea water costs about 1 mm rms and 2 mm at most"
        };
        let error = UseError::Medium {
            made: self.medium.name(),
            run: run.name(),
            board: self.board.clone().unwrap_or_else(|| "unknown".to_owned()),
            cost,
        };
        if forced {
            Ok(Some(format!("forced: {error}")))
        } else {
            Err(error)
        }
    }

    /// Checks the size of the images. A calibration from before sizes were kept says nothing.
    ///
    /// # Errors
    /// [`UseError::Image`]: no force helps, every coordinate would be wrong.
    pub fn check_image(&self, run: ImageSize) -> Result<(), UseError> {
        let made = match &self.map {
            MapParameters::Ideal(p) => Some(p.image),
            _ => self.image,
        };
        match made {
            Some(made) if made != run => Err(UseError::Image { made, run }),
            _ => Ok(()),
        }
    }

    /// The same camera and port in another medium, of that index: only a map that knows its port
    /// (`refractive`, and `free` with one) can be converted. `None` for all others.
    pub fn in_medium(&self, medium: Medium, index: Known) -> Option<Calibration> {
        let map = match &self.map {
            MapParameters::Refractive(map) => {
                MapParameters::Refractive(Box::new(map.in_water(index)))
            }
            MapParameters::Free(map) => MapParameters::Free(Box::new(map.in_medium(index)?)),
            _ => return None,
        };
        Some(Calibration {
            medium,
            map,
            ..self.clone()
        })
    }

    /// Caveat for its use: that it was never accepted, or claims nothing; `None` = no caveat.
    pub fn caveat(&self) -> Option<String> {
        if !self.missing.is_empty() {
            return Some(format!(
                "the calibration was not accepted when it was made, missing: {}",
                self.missing.join("; ")
            ));
        }
        let withdrawn =
            self.residuals.is_some() && !self.coplanarity.as_ref().is_some_and(Coplanarity::claims);
        withdrawn.then(|| self.claim())
    }

    /// Accuracy that the calibration claims, in words.
    pub fn claim(&self) -> String {
        if matches!(self.map, MapParameters::Free(_)) {
            return "camera and laser sheet from boards held in the hand: each point has its own standard deviation".to_owned();
        }
        let gap = self.coplanarity.as_ref();
        let Some(r) = &self.residuals else {
            return "no nodes: the accuracy is that of the rig's numbers".to_owned();
        };
        let nodes = format!(
            "{} nodes to {:.3} mm in xi and {:.3} mm in eta rms, {:.3} mm at most",
            r.nodes,
            1e3 * r.rms_xi_m,
            1e3 * r.rms_eta_m,
            1e3 * r.max_m
        );
        match gap {
            Some(gap) if gap.claims() => format!("{nodes}; {}", gap.words()),
            Some(gap) => format!(
                "{nodes} ON THE BOARD; accuracy on the sheet withdrawn: {}",
                gap.words()
            ),
            None => format!(
                "{nodes} ON THE BOARD; accuracy on the sheet withdrawn: coplanarity was not looked at"
            ),
        }
    }

    /// The gap between board and sheet, where the calibration has one.
    pub fn gap(&self) -> Option<&Coplanarity> {
        self.coplanarity.as_ref()
    }
}
