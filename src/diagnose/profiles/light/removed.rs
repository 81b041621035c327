//! The frames without what lights them: as an even light and a linear camera would show them.
//!
//! grey -> light (the camera's curve turned about; where it was clipped, what the model predicts), lens, lamps, background's
//! rise and haze taken off, the line as bright everywhere. What moves the stripe stays.

use super::camera::Response;
use super::equations::{OWN, State};
use super::forward::{Forward, Own};
use super::samples::{LightFrame, Sample, frames};
use super::search::Looked;
use crate::profiles::geometry::Geometry;
use crate::profiles::observe::{ImageRun, Seen};
use hydroline_core::frame::GreyImage;
use hydroline_sim::effect::Optics;
use hydroline_sim::scene::Exposure;

/// Level that nothing exceeds afterwards: a stripe that had been clipped is as high as it was \[grey levels\].
const TOP_GREY: f64 = 250.0;
/// Least share of the light that a lens or a line may leave: less cannot be brought back.
const SHARE_LEAST: f64 = 0.05;
/// Steps of a frame's own numbers.
const STEPS: usize = 8;

impl Looked<'_> {
    /// The runs without the effects of the likeliest model but for one (by its id), which stays in the picture.
    pub fn removed(
        &self,
        runs: &[ImageRun],
        geometry: &Geometry,
        but: Option<&str>,
    ) -> Option<Vec<ImageRun>> {
        let state = &self.best().state;
        let forward = self.data.forward(state, None)?;
        let kept = |t: &usize| Some(self.data.candidates[*t].info.id) == but;
        let (mut some, mut k) = (state.clone(), 0);
        while k < some.terms.len() {
            if kept(&some.terms[k]) {
                some.terms.remove(k);
                some.numbers.remove(k);
            } else {
                k += 1;
            }
        }
        let taken = Taken {
            looked: self,
            geometry,
            forward: &forward,
            removed: self.data.forward(&some, None)?.optics(),
            plain: self.data.base.optics_of(&[])?,
        };
        let change = |_: f64, image: &GreyImage, seen: Option<&Seen>| taken.without(image, seen);
        Some(
            runs.iter()
                .map(|r| r.again(&change, self.data.rig))
                .collect(),
        )
    }
}

/// Dither added to a level before its fraction is cut off, 0…1, another at each pixel. Rounding would not do: where the
/// light changes by a per cent over hundreds of columns it makes the same level of the same level along the line, whole
/// stripes half a level off at some levels, and so wider or narrower by five times what their poses' sds allow.
fn dither(pixel: usize) -> f64 {
    // SplitMix64 (Steele, Lea, Flood 2014), its upper 53 bits.
    let mut z = (pixel as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
}

struct Taken<'a, 'b> {
    looked: &'a Looked<'b>,
    geometry: &'a Geometry,
    /// All effects found.
    forward: &'a Forward,
    /// Optics with the effects that are taken off.
    removed: Optics,
    /// The rig's own.
    plain: Optics,
}

impl Taken<'_, '_> {
    /// A frame's own numbers, all frames' held.
    fn own(&self, seen: &Seen) -> (Own, Vec<LightFrame>) {
        let data = &self.looked.data;
        let best = self.looked.best();
        let run = ImageRun::of_one(seen);
        let frame = frames(&[run], self.geometry, &data.options);
        let mut x = [0.0; OWN];
        // Brightness and background of the others to begin with.
        let n = best.state.own.len().max(1) as f64;
        for own in &best.state.own {
            for k in 0..OWN - 1 {
                x[k] += own[k] / n;
            }
        }
        let state = State {
            own: vec![x; frame.len()],
            ..best.state.clone()
        };
        let found = data.alone(&frame, &state, STEPS);
        (data.own(&found), frame)
    }

    fn without(&self, image: &GreyImage, seen: Option<&Seen>) -> GreyImage {
        let data = &self.looked.data;
        let mut camera = data.rig.camera.clone();
        camera.noise.ambient = 0.0;
        let exposure = Exposure::of(&self.removed, &camera);
        // One pixel's level is no mean over the noise: without it.
        camera.noise.shot_gain = 0.0;
        let curve = Response::new(&self.removed, &exposure, &camera.noise, 0.0);
        let levels: Vec<Option<f64>> = (0..=u8::MAX).map(|g| curve.light(f64::from(g))).collect();
        let (least, most) = (
            curve.foot(),
            levels.iter().flatten().copied().fold(0.0, f64::max),
        );
        let (own, samples) = match seen {
            Some(seen) => self.own(seen),
            None => (data.own(&mean(&self.looked.best().state.own)), Vec::new()),
        };
        let lines = Lines::new(&samples, image.width_px);
        let brightest = self.plain.peak * own.brightness.exp() + own.background.max(0.0);
        let scale = (TOP_GREY / brightest).min(1.0);
        let mut out = image.clone();
        for row in 0..image.height_px {
            let lamps = exposure.row_at(own.lamp_s, row as f64);
            for column in 0..image.width_px {
                let at = row * image.width_px + column;
                let Some(grey) = image.pixels.get(at) else {
                    continue;
                };
                let sample = lines.sample(column, row);
                let light = levels[usize::from(*grey)].unwrap_or_else(|| {
                    let predicted = sample.map(|s| self.forward.light(&s, &own));
                    if *grey < 128 {
                        least
                    } else {
                        predicted.unwrap_or(most).max(most)
                    }
                });
                let dark = exposure.light(&lamps, column as f64, own.background);
                let share = exposure.light(&lamps, column as f64, own.background + 1.0) - dark;
                let mut laser = (light - dark) / share.max(SHARE_LEAST);
                if let Some(s) = sample {
                    let haze = self.forward.haze(&self.removed, &s, &own, 0.0);
                    if haze > 0.0 {
                        laser -= haze * self.forward.brightness(&s, &own);
                    }
                    let line =
                        self.removed.line_profile(s.fan_tan) / self.plain.line_profile(s.fan_tan);
                    laser /= line.max(SHARE_LEAST);
                }
                let level = scale * (laser + own.background.max(0.0));
                let level = (level + dither(at)).floor();
                out.pixels[at] = level.clamp(0.0, 255.0) as u8;
            }
        }
        out
    }
}

fn mean(own: &[[f64; OWN]]) -> [f64; OWN] {
    let n = own.len().max(1) as f64;
    std::array::from_fn(|k| own.iter().map(|o| o[k]).sum::<f64>() / n)
}

/// The nearest bin of each column, for what depends on where the stripe is.
struct Lines(Vec<Option<Sample>>);

impl Lines {
    fn new(frames: &[LightFrame], width_px: usize) -> Self {
        let middle = |b: &super::samples::Bin| {
            let near = |s: &&Sample| s.below_px.map_or(f64::INFINITY, f64::abs);
            b.samples
                .iter()
                .min_by(|a, c| near(a).total_cmp(&near(c)))
                .copied()
        };
        let bins: Vec<Sample> = (frames.iter().flat_map(|f| &f.bins))
            .filter(|b| b.on_line)
            .filter_map(middle)
            .collect();
        let nearest = |column: usize| {
            let away = |s: &&Sample| (s.column_px - column as f64).abs();
            bins.iter()
                .min_by(|a, b| away(a).total_cmp(&away(b)))
                .copied()
        };
        Lines((0..width_px).map(nearest).collect())
    }

    /// A pixel as a sample.
    fn sample(&self, column: usize, row: usize) -> Option<Sample> {
        let near = (*self.0.get(column)?)?;
        let stripe_px =
            near.row_px - near.below_px? + near.slope * (column as f64 - near.column_px);
        let below = row as f64 - stripe_px;
        let more = below - near.below_px?;
        Some(Sample {
            column_px: column as f64,
            row_px: row as f64,
            half_px: 0.0,
            below_px: Some(below),
            off_m: near.off_m + more * near.middle.0,
            ..near
        })
    }
}

#[cfg(test)]
mod tests {
    use super::dither;

    /// A level's mean stays what it is.
    #[test]
    fn dithered_levels_have_the_right_mean() {
        for level in [54.0 * 1.009, 56.0 * 1.009, 100.5, 12.0] {
            let sum: f64 = (0..40_000).map(|k| (level + dither(k)).floor()).sum();
            // sd of the mean: at most 1/2 / 200.
            assert!((sum / 40_000.0 - level).abs() < 0.01, "{level}");
        }
    }
}
