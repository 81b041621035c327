//! One-sided haze: the sheet lights the water it crosses, and the camera sees that light on one
//! side of the stripe only (theory/noise.md, rows of the stripe; effect `backscatter_haze`).
//!
//! `light = fraction * peak * exp(-d / length)`, d = distance beyond the stripe on that side.
//! One column cannot distinguish it from the stripe's own shift; all columns together can, from the
//! pixels outside the stripe: their mean, aligned on the stripe, is fitted with a constant, a
//! slope (uneven light) and the haze, on either side and with several lengths.

use super::fit::{Fit, HazeShape};
use super::kernel::{Kernel, LANES, PHASES, parted, phase_offset};
use hydroline_core::frame::GreyView;
use nalgebra::{Matrix3, Vector3};
use wide::{f32x4, i16x8, i32x4, u8x16};

/// Farthest pixel looked at \[px\].
const REACH_PX: usize = 56;
const SIZE: usize = 2 * REACH_PX + 1;
/// Columns looked at first, and all in all where the first show a sign of haze.
const FIRST_COLUMNS: usize = 80;
const MAX_COLUMNS: usize = 360;
/// Farthest that the stripe may be from a group's first column to another \[px\].
const MAX_LEAD_PX: f64 = 8.0;
/// Decay lengths tried \[px\].
const LENGTHS_PX: [f64; 5] = [20.0, 30.0, 50.0, 90.0, 300.0];
/// A shorter length must explain the data better by this much chi², else the longest that does:
/// the level at the stripe is extrapolated, the more the shorter the length.
const CHI2_FOR_SHORTER: f64 = 4.0;
/// Significance that the first columns must show for a closer look.
const SIGN_SIGNIFICANCE: f64 = 1.5;
/// Least significance and least level at which a correction is worth its own noise.
const MIN_SIGNIFICANCE: f64 = 3.5;
const MIN_FRACTION: f64 = 0.002;

/// Variance of the groups' light over that of noise from which the rows are looked at: chance makes
/// 1.14 at three sds.
const RESTLESS: f64 = 1.25;
/// Fewest groups for an estimate; of fewer, other lines stand everywhere, which may be bands.
const MIN_GROUPS: usize = 3;
/// Smallest such variance that is looked into: waves of 0.3 grey levels.
const MIN_RESTLESS: f64 = 0.05;

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Haze {
    /// Level at the stripe as a fraction of the peak.
    pub fraction: f64,
    /// Its standard deviation.
    pub fraction_sd: f64,
    /// Decay length \[px\], positive = above the stripe.
    pub length_px: f64,
}

/// Shapes of the haze tried, by distance from the stripe.
#[derive(Debug, Clone)]
pub(super) struct HazeTable {
    shapes: Vec<(f64, [f64; SIZE])>,
}

/// Mean light beside the stripe, aligned on it, in units of the peak.
struct Surroundings {
    /// Distance below the stripe \[px\], light over peak, columns it is the mean of.
    samples: Vec<(isize, f64, f64)>,
    mean_peak: f64,
    /// Light of every group of [`LANES`] columns, in sixteenths of a grey level, by distance.
    groups: Vec<[i32; SIZE]>,
}

impl Surroundings {
    /// Whether the groups' light varies along the rows by more than noise explains.
    fn restless(&self, noise_sd: f64) -> bool {
        if self.groups.len() < MIN_GROUPS {
            return true;
        }
        let places = || {
            self.samples
                .iter()
                .map(|s| (s.0 + REACH_PX as isize) as usize)
        };
        let count = self.samples.len() as f64;
        let scale = 1.0 / (16.0 * LANES as f64);
        let mut square = 0.0;
        for group in &self.groups {
            // A group's background, and with it the mean of its light, is known badly.
            let light = places().map(|i| scale * f64::from(group[i]));
            let (sum, squares) = light.fold((0.0, 0.0), |(s, q), v| (s + v, q + v * v));
            square += squares - sum * sum / count;
        }
        let noise = (noise_sd * noise_sd / LANES as f64).max(MIN_RESTLESS);
        square > RESTLESS * noise * (count - 1.0) * self.groups.len() as f64
    }
}

impl HazeTable {
    pub fn new() -> Self {
        let shape = |length: f64| {
            let at = |i: usize| haze_over_pixel(i as f64 - REACH_PX as f64, length);
            (length, std::array::from_fn(at))
        };
        Self {
            shapes: LENGTHS_PX
                .iter()
                .flat_map(|l| [*l, -*l])
                .map(shape)
                .collect(),
        }
    }

    /// Estimates the haze from columns `(column, fit)` that are free of steps and rivals, and says
    /// whether the light beside the stripe varies by more than noise explains.
    pub fn estimate(
        &self,
        image: GreyView<'_>,
        columns: &[(usize, &Fit)],
        noise_sd: f64,
    ) -> (Option<Haze>, bool) {
        let Some(first) = surroundings(image, columns, FIRST_COLUMNS, noise_sd) else {
            // Other lines everywhere: bands may be what they are.
            return (None, true);
        };
        let sign = self.fit(&first, noise_sd);
        let haze = sign.and_then(|sign| self.established(sign, image, columns, noise_sd));
        (haze, haze.is_some() || first.restless(noise_sd))
    }

    /// The haze of which the first columns show this sign.
    fn established(
        &self,
        sign: Haze,
        image: GreyView<'_>,
        columns: &[(usize, &Fit)],
        noise_sd: f64,
    ) -> Option<Haze> {
        if sign.fraction < SIGN_SIGNIFICANCE * sign.fraction_sd {
            return None;
        }
        let haze = self.fit(
            &surroundings(image, columns, MAX_COLUMNS, noise_sd)?,
            noise_sd,
        )?;
        let significant =
            haze.fraction > MIN_FRACTION && haze.fraction > MIN_SIGNIFICANCE * haze.fraction_sd;
        significant.then_some(Haze {
            fraction: haze.fraction.min(0.5),
            ..haze
        })
    }

    /// Best side and length. Noise in units of one pixel's over the peak: the larger of what the
    /// camera gives and what the best fit leaves, so that uneven light does not pass for haze.
    fn fit(&self, light: &Surroundings, noise_sd: f64) -> Option<Haze> {
        let common = Common::of(&light.samples);
        let fits: Vec<(f64, LevelFit)> = self
            .shapes
            .iter()
            .filter_map(|(length, shape)| {
                Some((*length, fit_level(&light.samples, &common, shape)?))
            })
            // A lack of light on one side is an excess on the other.
            .filter(|f| f.1.fraction > 0.0)
            .collect();
        let best = fits.iter().min_by(|a, b| a.1.chi2.total_cmp(&b.1.chi2))?;
        let (side, least) = (best.0.signum(), best.1.chi2);
        let scatter = least / (light.samples.len() as f64 - 4.0).max(1.0);
        let unit = scatter.max((noise_sd / light.mean_peak).powi(2));
        let (length_px, level) = fits
            .into_iter()
            .filter(|f| f.0.signum() == side && f.1.chi2 <= least + CHI2_FOR_SHORTER * unit)
            .max_by(|a, b| {
                a.0.abs()
                    .total_cmp(&b.0.abs())
                    .then(b.1.chi2.total_cmp(&a.1.chi2))
            })?;
        Some(Haze {
            fraction: level.fraction,
            fraction_sd: (level.unit_variance * unit).sqrt(),
            length_px,
        })
    }
}

/// Gathers the light beside the stripe from about `most` columns, eight neighbours at a time.
fn surroundings(
    image: GreyView<'_>,
    columns: &[(usize, &Fit)],
    most: usize,
    noise_sd: f64,
) -> Option<Surroundings> {
    // A group adds 8 x 16 x 255 at most to a row's sum: 32 bits hold 65 000 groups.
    let mut sums = [i32x4::ZERO; SIZE];
    let mut counts = [i16x8::ZERO; SIZE];
    let mut groups = Vec::with_capacity(FIRST_COLUMNS / LANES + 1);
    let mut widths = Vec::with_capacity(most + LANES);
    let (mut peaks, mut seen, mut used, mut spread_px) = (0.0, 0, 0, 0.0f64);
    let mut rest = columns;
    while let Some((first, lead)) = rest.first().copied() {
        let near = |(column, fit): &&(usize, &Fit)| {
            column - first < LANES && (fit.row_px - lead.row_px).abs() < MAX_LEAD_PX
        };
        let length = rest.iter().take(LANES).take_while(near).count().max(1);
        let (group, after) = rest.split_at(length);
        rest = after;
        // As many as wanted, evenly from all of them.
        if used * columns.len() <= seen * most {
            used += length;
            peaks += group.iter().map(|(_, fit)| fit.peak).sum::<f64>();
            widths.extend(group.iter().map(|(_, fit)| fit.sigma_px));
            let mut light = [0; SIZE];
            let spread = add_group(image, group, noise_sd, &mut sums, &mut counts, &mut light);
            spread_px = spread_px.max(spread);
            if length == LANES && groups.len() < groups.capacity() {
                groups.push(light);
            }
        }
        seen += length;
    }
    if used < 8 {
        return None;
    }
    let middle = widths.len() / 2;
    let width = *widths.select_nth_unstable_by(middle, f64::total_cmp).1;
    // Beyond 4.5 sigma nothing of the stripe is left (4e-5 of its peak).
    let guard = (4.5 * width + 2.0 + 0.5 * spread_px) as isize;
    let mean_peak = peaks / used as f64;
    let samples: Vec<(isize, f64, f64)> = sums
        .iter()
        .zip(&counts)
        .enumerate()
        .map(|(i, (sum, count))| {
            (
                i as isize - REACH_PX as isize,
                f64::from(sum.reduce_add()) / 16.0,
                f64::from(count.dot(i16x8::ONE).reduce_add()),
            )
        })
        .filter(|(d, _, count)| d.abs() > guard && *count > 0.5 * used as f64)
        .map(|(d, sum, count)| (d, sum / (count * mean_peak), count))
        .collect();
    let above = samples.iter().filter(|s| s.0 < 0).count();
    (above >= 6 && samples.len() - above >= 6).then_some(Surroundings {
        samples,
        mean_peak,
        groups,
    })
}

/// Adds what lies around one group of columns, aligned on the middle of their stripe; returns how
/// far its rows are apart \[px\]. Next to the decay of haze (20 px or more) that blurs nothing.
fn add_group(
    image: GreyView<'_>,
    group: &[(usize, &Fit)],
    noise_sd: f64,
    sums: &mut [i32x4; SIZE],
    counts: &mut [i16x8; SIZE],
    own: &mut [i32; SIZE],
) -> f64 {
    let start = group.first().map_or(0, |(column, _)| *column);
    let start = start.min(image.width_px.saturating_sub(LANES));
    // In sixteenths of a grey level. A lane without a column keeps nothing.
    let (mut background, mut clip) = ([0i16; LANES], [-1i16; LANES]);
    let (mut low, mut high) = (f64::MAX, 0.0f64);
    for (column, fit) in group {
        if let (Some(background), Some(clip)) = (
            background.get_mut(column - start),
            clip.get_mut(column - start),
        ) {
            *background = (16.0 * fit.background) as i16;
            *clip = (16.0 * (4.0 * noise_sd + 0.25 * fit.peak.min(255.0))) as i16;
        }
        low = low.min(fit.row_px);
        high = high.max(fit.row_px);
    }
    let (background, clip) = (i16x8::new(background), i16x8::new(clip));
    let middle = (0.5 * (low + high) + 0.5) as usize;
    let first = middle.saturating_sub(REACH_PX);
    let offset = first + REACH_PX - middle;
    let rows = (middle + REACH_PX + 1).min(image.height_px) - first;
    let mut place = first * image.width_px + start;
    let places = sums[offset..]
        .iter_mut()
        .zip(&mut counts[offset..])
        .zip(&mut own[offset..]);
    for ((sum, count), own) in places.take(rows) {
        let Some(rest) = image.pixels.get(place..) else {
            break;
        };
        // Sixteen bytes for the sake of eight; lanes beyond the image keep nothing.
        let pixels = rest.first_chunk().copied().unwrap_or_else(|| {
            let mut padded = [0; 2 * LANES];
            for (to, from) in padded.iter_mut().zip(rest) {
                *to = *from;
            }
            padded
        });
        // Particles, ghosts and other segments are brighter than haze can be.
        let light: i16x8 = i16x8::from_u8x16_low(u8x16::new(pixels)) << 4;
        let above = light - background;
        let kept = !above.max(-above).simd_gt(clip);
        let light = (above & kept).dot(i16x8::ONE);
        *sum += light;
        *own = light.reduce_add();
        *count -= kept;
        place += image.width_px;
    }
    high - low
}

/// A haze level for one length and side.
struct LevelFit {
    fraction: f64,
    unit_variance: f64,
    chi2: f64,
}

/// Sums that the fits of all shapes share: weight w times products of 1, the distance x (in
/// units of the reach) and the light v.
#[derive(Default)]
struct Common {
    w: f64,
    wx: f64,
    wxx: f64,
    wv: f64,
    wxv: f64,
    wvv: f64,
}

impl Common {
    fn of(samples: &[(isize, f64, f64)]) -> Self {
        let mut sums = Self::default();
        for &(d, v, w) in samples {
            let x = d as f64 / REACH_PX as f64;
            sums.w += w;
            sums.wx += w * x;
            sums.wxx += w * x * x;
            sums.wv += w * v;
            sums.wxv += w * x * v;
            sums.wvv += w * v * v;
        }
        sums
    }
}

/// Weighted fit of constant, slope and haze.
fn fit_level(
    samples: &[(isize, f64, f64)],
    common: &Common,
    shape: &[f64; SIZE],
) -> Option<LevelFit> {
    let [mut wh, mut wxh, mut whh, mut whv] = [0.0; 4];
    for &(d, v, w) in samples {
        let h = *shape.get((d + REACH_PX as isize) as usize)?;
        let weighted = w * h;
        wh += weighted;
        wxh += weighted * (d as f64 / REACH_PX as f64);
        whh += weighted * h;
        whv += weighted * v;
    }
    let n = Matrix3::new(
        common.w, common.wx, wh, common.wx, common.wxx, wxh, wh, wxh, whh,
    );
    let right = Vector3::new(common.wv, common.wxv, whv);
    let covariance = n.try_inverse()?;
    let s = covariance * right;
    Some(LevelFit {
        fraction: s[2],
        unit_variance: covariance[(2, 2)],
        // At the minimum the sum of squares has lost the solution times the right side.
        chi2: (common.wvv - s.dot(&right)).max(0.0),
    })
}

impl Haze {
    /// This haze under the taps of a kernel.
    pub fn shape(&self, kernel: &Kernel) -> HazeShape {
        let mut shape = Vec::with_capacity(PHASES * kernel.stride / LANES);
        let mut solved = Vec::with_capacity(PHASES);
        for (p, phase) in kernel.phases.iter().enumerate() {
            let mut line = vec![0.0f32; kernel.stride];
            for (k, h) in line.iter_mut().enumerate().take(kernel.taps()) {
                let distance_px = k as f64 - kernel.half as f64 - phase_offset(p);
                *h = haze_over_pixel(distance_px, self.length_px) as f32;
            }
            solved.push(f32x4::new([0, 1, 2, 3].map(|i| phase.solve_line(i, &line))));
            shape.extend(line.as_chunks().0.iter().map(parted));
        }
        HazeShape {
            length_px: self.length_px,
            shape,
            solved,
        }
    }
}

/// Haze integrated over the pixel at `distance_px` below the stripe: exp(-d/length) on one side.
pub(super) fn haze_over_pixel(distance_px: f64, length_px: f64) -> f64 {
    let along = distance_px * -length_px.signum();
    let length = length_px.abs().max(1e-9);
    let (from, to) = ((along - 0.5).max(0.0), (along + 0.5).max(0.0));
    length * ((-from / length).exp() - (-to / length).exp())
}
