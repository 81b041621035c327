//! Mean grey level that a camera shows of some light: noise, saturation, tone curve and range together.
//!
//! g(L) = E[grey(min(L + s n, saturation))], n normal, s² = read² + shot L. A sensor shows nothing below zero and nothing
//! above its ceiling, so that the mean is not the level of the mean; it is integrated once per model.

use hydroline_rigs::ImageNoise;
use hydroline_sim::effect::Optics;
use hydroline_sim::scene::Exposure;

/// Light at the table's ends and between its entries \[grey levels\].
const FROM: f64 = -20.0;
const TO: f64 = 620.0;
const STEP: f64 = 0.5;
/// Nodes of the integral over the noise, and how far they reach in sds.
const NODES: usize = 25;
const REACH_SDS: f64 = 4.2;

/// Numbers that the integral depends on: tone curve, range of grey levels, saturation, read noise.
type Key = [f64; 7];

/// A camera's mean levels.
#[derive(Debug, Clone)]
pub(super) struct Response {
    key: Key,
    grey: Vec<f64>,
}

fn key(optics: &Optics, read_sd: f64) -> Key {
    let b = &optics.brightness;
    [
        b.gamma,
        b.scaled_grey[0],
        b.scaled_grey[1],
        b.clipped_grey[0],
        b.clipped_grey[1],
        optics.saturation,
        read_sd,
    ]
}

impl Response {
    /// Of a camera with this read noise.
    pub fn new(optics: &Optics, exposure: &Exposure, noise: &ImageNoise, read_sd: f64) -> Self {
        let nodes: Vec<(f64, f64)> = (0..NODES)
            .map(|k| {
                let x = REACH_SDS * ((2 * k + 1) as f64 / NODES as f64 - 1.0);
                (x, (-0.5 * x * x).exp())
            })
            .collect();
        let all: f64 = nodes.iter().map(|n| n.1).sum();
        let levels = ((TO - FROM) / STEP) as usize + 1;
        let mean = |k: usize| {
            let light = FROM + STEP * k as f64;
            let sd = (read_sd * read_sd + noise.shot_gain * light.max(0.0)).sqrt();
            let each = nodes.iter().map(|(x, weight)| {
                let seen = (light + sd * x).min(optics.saturation);
                weight * exposure.grey(seen).clamp(0.0, 255.0)
            });
            each.sum::<f64>() / all
        };
        Response {
            key: key(optics, read_sd),
            grey: (0..levels).map(mean).collect(),
        }
    }

    /// Whether another camera would show the same.
    pub fn is_of(&self, optics: &Optics, read_sd: f64) -> bool {
        self.key == key(optics, read_sd)
    }

    /// Mean grey level of some light.
    pub fn grey(&self, light: f64) -> f64 {
        let at = ((light - FROM) / STEP).clamp(0.0, (self.grey.len() - 2) as f64);
        let below = at.floor();
        let (a, b) = (self.grey[below as usize], self.grey[below as usize + 1]);
        a + (at - below).min(1.0) * (b - a)
    }

    /// The most light that still shows the least level.
    pub fn foot(&self) -> f64 {
        let least = self.grey.first().copied().unwrap_or(0.0);
        let above = self.grey.partition_point(|g| *g <= least + 1e-9);
        FROM + STEP * above.saturating_sub(1) as f64
    }

    /// The light of a mean grey level; `None` where it is at an end of the range and could be more or less.
    pub fn light(&self, grey: f64) -> Option<f64> {
        let above = self.grey.partition_point(|g| *g < grey);
        if above == 0 || above >= self.grey.len() {
            return None;
        }
        let (a, b) = (self.grey[above - 1], self.grey[above]);
        let slope = (b - a) / STEP;
        (slope > SLOPE_LEAST).then(|| FROM + STEP * (above - 1) as f64 + (grey - a) / slope)
    }
}

/// Grey levels per level of light below which a camera is at an end of its range.
const SLOPE_LEAST: f64 = 0.05;

#[cfg(test)]
mod tests {
    use super::*;
    use hydroline_rigs::Rig;

    fn response(change: impl Fn(&mut Optics), read_sd: f64) -> Response {
        let rig = Rig::builtin("lshpi").unwrap();
        let mut optics = Optics::new(&rig);
        change(&mut optics);
        let exposure = Exposure::of(&optics, &rig.camera);
        Response::new(&optics, &exposure, &rig.camera.noise, read_sd)
    }

    /// Of no light a camera shows the mean of the noise's positive half, s / √(2π).
    #[test]
    fn darkness_is_not_zero_where_noise_is_cut_off() {
        let plain = response(|_| (), 2.0);
        let half = 2.0 / std::f64::consts::TAU.sqrt();
        assert!((plain.grey(0.0) - half).abs() < 0.01, "{}", plain.grey(0.0));
        assert!((plain.grey(100.0) - 100.0).abs() < 1e-6);
        let video = response(|o| o.brightness.clipped_grey = [16.0, 235.0], 2.0);
        let ends = (video.grey(2.0) - 16.0, video.grey(400.0) - 235.0);
        assert!(ends.0.abs() < 1e-9 && ends.1.abs() < 1e-9, "{ends:?}");
    }

    #[test]
    fn light_and_level_are_each_others_inverse_within_the_range() {
        let curved = response(|o| o.brightness.gamma = 0.5, 1.5);
        for light in [10.0, 55.5, 180.0] {
            let back = curved.light(curved.grey(light)).unwrap();
            assert!((back - light).abs() < 1e-6, "{light}: {back}");
        }
        assert_eq!(curved.light(255.0), None);
        // Without noise what is cut off below shows from where the curve leaves it.
        assert_eq!(response(|_| (), 0.0).foot(), 0.0);
        let video = response(|o| o.brightness.clipped_grey = [16.0, 235.0], 0.0);
        assert_eq!(video.foot(), 16.0);
    }
}
