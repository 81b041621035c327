//! Where floor and target should be seen from a pose: a line in the laser plane, and the same in the image.

use hydroline_calib::plane::{Fan, ImageSize, PlaneMap};
use hydroline_calib::{Pose, frames};
use hydroline_live::picture::rounded;
use hydroline_pose::outline::Surfaces;
use hydroline_rigs::{Mounts, Rig};
use std::sync::Arc;

/// Places across the fan at which the line is looked up.
const PLACES: u32 = 240;

/// The line; `None` in it breaks it.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Outline {
    /// Column, row \[px\].
    pub image_px: Vec<Option<[f32; 2]>>,
    /// xi, eta \[m\].
    pub plane_m: Vec<Option<[f32; 2]>>,
}

/// A rig's floor and target under its laser sheet.
#[derive(Clone)]
pub struct Scene {
    surfaces: Surfaces,
    mounts: Mounts,
    fan: Fan,
    size: ImageSize,
    map: Arc<dyn PlaneMap>,
}

impl Scene {
    /// Of a rig, seen through `map`.
    pub fn new(rig: &Rig, map: Arc<dyn PlaneMap>) -> Self {
        Self {
            surfaces: Surfaces::new(rig.target.as_ref()),
            mounts: rig.mounts,
            fan: Fan::of(&rig.laser, &rig.mounts),
            size: ImageSize::of(&rig.camera),
            map,
        }
    }

    /// Height above the floor and eta of what the sheet meets at `xi_m`: the highest upper face that is there, else the floor.
    fn met(&self, pose: &Pose, xi_m: f64) -> Option<(f64, f64)> {
        let at = |height_m: f64| {
            let line = pose.level_in_plane(&self.mounts, height_m)?;
            Some(line.eta_at_zero_m + line.slope * xi_m)
        };
        for face in &self.surfaces.faces {
            let eta_m = at(face.height_m)?;
            let body = frames::plane_to_body(&self.mounts, xi_m, eta_m);
            let tank = pose.body_to_tank(&body);
            if face.outline.contains([tank.x, tank.y]) {
                return Some((face.height_m, eta_m));
            }
        }
        Some((0.0, at(0.0)?))
    }

    /// The line as it should be at a pose.
    pub fn outline(&self, pose: &Pose) -> Outline {
        let reach_m = self.reach_m(pose);
        let mut outline = Outline::default();
        let mut last_m = None;
        for k in 0..=PLACES {
            let xi_m = reach_m * (2.0 * f64::from(k) / f64::from(PLACES) - 1.0);
            let met = self.met(pose, xi_m);
            let lit = met.filter(|(_, eta_m)| self.fan.contains(xi_m, *eta_m));
            let seen = lit.and_then(|(_, eta_m)| {
                let (column, row) = self.map.to_image(xi_m, eta_m)?;
                let point = [rounded(column, 0.1), rounded(row, 0.1)];
                self.size.contains(column, row).then_some(point)
            });
            let height_m = lit.map(|(height_m, _)| height_m);
            if height_m != last_m {
                outline.image_px.push(None);
                outline.plane_m.push(None);
            }
            last_m = height_m;
            let plane = lit.map(|(_, eta_m)| [rounded(xi_m, 1e-4), rounded(eta_m, 1e-4)]);
            outline.image_px.push(seen);
            outline.plane_m.push(plane);
        }
        outline
    }

    /// Half the width that the fan lights at the floor \[m\].
    fn reach_m(&self, pose: &Pose) -> f64 {
        let floor = pose.level_in_plane(&self.mounts, 0.0);
        let below_m = floor.map_or(1.0, |line| self.fan.apex_eta_m - line.eta_at_zero_m);
        below_m.max(0.05) * (0.5 * self.fan.angle_rad).tan()
    }

    /// Of stripe points in the laser plane \[m\]: the share that lies nearer to an upper face than to the floor, and the share
    /// that should. `None` without a target, or without points.
    pub fn on_target(&self, pose: &Pose, profile_m: &[(f64, f64)]) -> Option<(f64, f64)> {
        let lowest_m = self.surfaces.faces.last()?.height_m;
        let floor = pose.level_in_plane(&self.mounts, 0.0)?;
        if profile_m.is_empty() {
            return None;
        }
        let raised = |xi_m: f64, eta_m: f64| {
            eta_m - floor.eta_at_zero_m - floor.slope * xi_m > 0.5 * lowest_m
        };
        let found = profile_m
            .iter()
            .filter(|(xi, eta)| raised(*xi, *eta))
            .count();
        let expected = profile_m
            .iter()
            .filter(|(xi, _)| self.met(pose, *xi).is_some_and(|(_, eta)| raised(*xi, eta)))
            .count();
        let all = profile_m.len() as f64;
        Some((found as f64 / all, expected as f64 / all))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hydroline_calib::analytic::IdealMap;
    use hydroline_core::frame::GreyImage;
    use hydroline_sim::{Pose6, Renderer};
    use hydroline_stripe::{Extractor, ExtractorConfig};

    #[test]
    fn the_line_lies_on_the_stripe_of_a_rendered_frame() {
        let rig = Rig::builtin("lshpi").unwrap();
        let start = rig.tank.start_pose;
        let [x_m, y_m, z_m, phi_rad, theta_rad, psi_rad] = start;
        let pose = Pose6 {
            x_m: x_m + 0.3,
            y_m,
            z_m,
            phi_rad,
            theta_rad,
            psi_rad,
        };
        let pixels = Renderer::new(&rig).unwrap().render(&pose, 0).0;
        let image = GreyImage {
            width_px: rig.camera.width_px as usize,
            height_px: rig.camera.height_px as usize,
            pixels,
        };
        let found = Extractor::new(ExtractorConfig::default()).extract(&image);
        let map = Arc::new(IdealMap::of(&rig));
        let scene = Scene::new(&rig, map.clone());
        let outline = scene.outline(&Pose::from_array(pose.to_array()));
        let line: Vec<[f32; 2]> = outline.image_px.iter().flatten().copied().collect();
        assert!(line.len() > 100, "{} points", line.len());
        let near = |column: f64| {
            let by = |a: &&[f32; 2], b: &&[f32; 2]| {
                (f64::from(a[0]) - column)
                    .abs()
                    .total_cmp(&(f64::from(b[0]) - column).abs())
            };
            f64::from(line.iter().min_by(by).unwrap()[1])
        };
        let mut off: Vec<f64> = found
            .points
            .iter()
            .map(|p| (p.row_px - near(p.column_px)).abs())
            .collect();
        off.sort_by(f64::total_cmp);
        assert!(
            off[off.len() * 9 / 10] < 1.5,
            "nine of ten within 1.5 px, got {:?}",
            off[off.len() * 9 / 10]
        );
        let plane: Vec<(f64, f64)> = found
            .points
            .iter()
            .filter_map(|p| map.to_plane(p.column_px, p.row_px))
            .map(|p| (p.xi_m, p.eta_m))
            .collect();
        let (share, expected) = scene
            .on_target(&Pose::from_array(pose.to_array()), &plane)
            .unwrap();
        assert!(
            expected > 0.2 && (share - expected).abs() < 0.05,
            "{share} {expected}"
        );
    }
}
