//! The stripe sorted into levels, and the points where it steps from one to the next.
//!
//! In the laser plane every flat face is a straight line, all parallel (theory/geometry.md, laser plane): at roll φ and
//! pitch θ the line of height h is η = η₀ + ξ slope + h / (cos θ cos φ). Stretches of the stripe
//! are given to the heights that the target has; the step between two of them is measured on the
//! UPPER one, because only its end is the target's edge: the lower one may be hidden behind it.

use super::sheet::SheetTable;
use hydroline_calib::plane::PlaneMap;
use hydroline_core::frame::GreyImage;
use hydroline_stripe::{Profile, quality};

/// Fewest points of a stretch from which levels are taken.
const LONG_STRETCH: usize = 10;
/// A column gap this wide ends a stretch.
const GAP_COLUMNS: f64 = 4.5;
/// A step is only measured where both sides meet within this many columns.
const STEP_GAP_COLUMNS: f64 = 40.0;
/// Columns hidden behind an upper face per metre of its height: it hides no more than its own height times
/// 0.4 of tan 22°, at up to 1.2 columns per millimetre.
const HIDDEN_COLUMNS_PER_M: f64 = 400.0;
/// Columns on either side over which the light of an ending stretch is summed.
const END_REACH: i64 = 10;
/// Steps closer than this to the fan's or the image's end are the end of the light, not of an upper face.
const BORDER_COLUMNS: f64 = 6.0;

/// A stripe point in the laser plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlanePoint {
    /// Column \[px\].
    pub column_px: f64,
    /// Row \[px\].
    pub row_px: f64,
    /// ξ, to port \[m\].
    pub xi_m: f64,
    /// η, up \[m\].
    pub eta_m: f64,
    /// Standard deviation of η \[m\].
    pub sd_m: f64,
    /// Width of the stripe \[px\].
    pub sigma_px: f64,
    /// Not cut by a step.
    pub sound: bool,
}

/// A stretch of stripe on one level.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Segment {
    /// Its height above the floor \[m\].
    pub height_m: f64,
    /// First and last column \[px\].
    pub columns_px: [f64; 2],
    /// ξ there \[m\].
    pub xi_m: [f64; 2],
}

/// Where the stripe steps from an upper face down to the next lower surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Step {
    /// Height of the upper face that ends \[m\].
    pub upper_m: f64,
    /// Height of what follows \[m\].
    pub lower_m: f64,
    /// The upper face ends towards greater columns (starboard).
    pub to_starboard: bool,
    /// Where \[px\].
    pub column_px: f64,
    /// ξ \[m\].
    pub xi_m: f64,
    /// η on the upper level \[m\].
    pub eta_m: f64,
    /// Standard deviation of ξ \[m\].
    pub sd_m: f64,
}

/// Reservation about a sorted stripe: a part discarded, or a quantity not determined.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum Caveat {
    #[error(
        "part of the stripe lies on none of the target's heights: particles, or another target than the rig's"
    )]
    Stray,
    #[error("an edge of the target is outside the light or the image")]
    EdgeMissing,
    #[error("the stripe shows one level only, taken for the floor")]
    OneLevel,
    #[error("steps are known to whole pixels only")]
    WholePixel,
}

/// A stripe sorted.
#[derive(Debug, Clone, PartialEq)]
pub struct Levels {
    /// η of the floor line at ξ = 0 \[m\].
    pub eta0_m: f64,
    /// Its slope dη/dξ.
    pub slope: f64,
    /// Standard deviations of the two.
    pub eta0_sd_m: f64,
    /// Standard deviation of the slope.
    pub slope_sd: f64,
    /// Residual of the points about their lines, rms \[m\].
    pub rms_m: f64,
    /// Points used.
    pub points: usize,
    /// By column.
    pub segments: Vec<Segment>,
    /// By column.
    pub steps: Vec<Step>,
    /// Reservations: parts discarded, quantities not determined.
    pub caveats: Vec<Caveat>,
}

/// Failure to sort a stripe.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum SegmentError {
    #[error(
        "{points} stripe points with plane coordinates, at least {needed} are needed: is the stripe inside the calibrated region?"
    )]
    TooFew { points: usize, needed: usize },
    #[error(
        "{points} stripe points, but no {columns} columns of sound ones in a row: is a lamp, a window, a bar or a reflection taken for the line, or the line clipped? Darken it, or lower the exposure"
    )]
    NoLine { points: usize, columns: usize },
}

/// Stripe points of a profile in the laser plane, by column; those off the map are discarded.
pub fn plane_points(profile: &Profile, map: &dyn PlaneMap) -> Vec<PlanePoint> {
    let point = |p: &hydroline_stripe::StripePoint| {
        let at = map.to_plane(p.column_px, p.row_px)?;
        let slope = map.jacobian(p.column_px, p.row_px)?;
        Some(PlanePoint {
            column_px: p.column_px,
            row_px: p.row_px,
            xi_m: at.xi_m,
            eta_m: at.eta_m,
            sd_m: (slope[(1, 1)] * p.sd_px)
                .hypot(at.covariance_m2[(1, 1)].sqrt())
                .max(1e-6),
            sigma_px: p.sigma_px,
            sound: p.quality & quality::NEAR_STEP == 0,
        })
    };
    profile.points.iter().filter_map(point).collect()
}

/// Points `from..to` without a jump.
#[derive(Debug, Clone, Copy)]
struct Stretch {
    from: usize,
    to: usize,
    offset_m: f64,
    /// Index into the heights; `None` = none of them.
    level: Option<usize>,
}

/// Sorts a stripe. `heights_m` = those of floor and target, ascending, floor (0) first. With the
/// `image` the steps are measured from the fading light (sub-pixel), without it to whole pixels
/// as in the paper.
///
/// # Errors
/// [`SegmentError`] for too little stripe.
pub fn sort(
    points: &[PlanePoint],
    heights_m: &[f64],
    image: Option<&GreyImage>,
    map: &dyn PlaneMap,
) -> Result<Levels, SegmentError> {
    const NEEDED: usize = 16;
    if points.len() < NEEDED {
        return Err(SegmentError::TooFew {
            points: points.len(),
            needed: NEEDED,
        });
    }
    let no_line = SegmentError::NoLine {
        points: points.len(),
        columns: LONG_STRETCH,
    };
    let least_gap = heights_m
        .windows(2)
        .map(|w| w[1] - w[0])
        .fold(0.02, f64::min);
    let mut stretches = split(points, 0.3 * least_gap);
    let slope = common_slope(points, &stretches).ok_or(no_line)?;
    for s in &mut stretches {
        let (sum, n) = points[s.from..s.to].iter().fold((0.0, 0.0), |(a, n), p| {
            (a + p.eta_m - slope * p.xi_m, n + 1.0)
        });
        s.offset_m = sum / n;
    }
    let eta0_m = floor_offset(&stretches, heights_m, 0.25 * least_gap).ok_or(no_line)?;
    for s in &mut stretches {
        let nearest = heights_m
            .iter()
            .enumerate()
            .map(|(k, h)| (k, (s.offset_m - eta0_m - h).abs()))
            .min_by(|a, b| a.1.total_cmp(&b.1));
        s.level = nearest
            .filter(|(_, d)| *d < 0.35 * least_gap)
            .map(|(k, _)| k);
    }
    let mut levels = fit_lines(points, &stretches, heights_m, eta0_m, slope).ok_or(no_line)?;
    if stretches.iter().any(|s| s.level.is_none()) {
        levels.caveats.push(Caveat::Stray);
    }
    let runs = runs(&stretches);
    levels.segments = runs.iter().map(|r| segment(points, r, heights_m)).collect();
    if heights_m.len() > 1
        && levels
            .segments
            .iter()
            .all(|s| s.height_m == levels.segments[0].height_m)
    {
        levels.caveats.push(Caveat::OneLevel);
    }
    let background = image.map(background_level);
    for pair in runs.windows(2) {
        levels
            .steps
            .extend(step(points, pair, heights_m, image.zip(background), map));
    }
    if heights_m.len() > 1 && levels.steps.len() < 2 * (heights_m.len() - 1) {
        levels.caveats.push(Caveat::EdgeMissing);
    }
    if image.is_none() {
        levels.caveats.push(Caveat::WholePixel);
    }
    Ok(levels)
}

fn split(points: &[PlanePoint], jump_m: f64) -> Vec<Stretch> {
    let mut stretches = Vec::new();
    let mut from = 0;
    for i in 1..=points.len() {
        let broken = i == points.len() || {
            let (a, b) = (&points[i - 1], &points[i]);
            b.column_px - a.column_px > GAP_COLUMNS || (b.eta_m - a.eta_m).abs() > jump_m
        };
        if broken {
            stretches.push(Stretch {
                from,
                to: i,
                offset_m: 0.0,
                level: None,
            });
            from = i;
        }
    }
    stretches
}

/// Slope that all long stretches share, each with its own offset.
fn common_slope(points: &[PlanePoint], stretches: &[Stretch]) -> Option<f64> {
    let mut slopes: Vec<(f64, f64)> = Vec::new();
    for s in stretches.iter().filter(|s| s.to - s.from >= LONG_STRETCH) {
        let own = || points[s.from..s.to].iter().filter(|p| p.sound);
        let n = own().count() as f64;
        if n < 5.0 {
            continue;
        }
        let (mx, me) = own().fold((0.0, 0.0), |(a, b), p| (a + p.xi_m / n, b + p.eta_m / n));
        let (sxx, sxy) = own().fold((0.0, 0.0), |(a, b), p| {
            (
                a + (p.xi_m - mx).powi(2),
                b + (p.xi_m - mx) * (p.eta_m - me),
            )
        });
        if sxx > 0.0 {
            slopes.push((sxy / sxx, sxx));
        }
    }
    // Weighted median: one odd stretch (a particle cloud) must not turn the rest.
    slopes.sort_by(|a, b| a.0.total_cmp(&b.0));
    let half = 0.5 * slopes.iter().map(|s| s.1).sum::<f64>();
    let mut seen = 0.0;
    let middle = slopes.iter().find(|s| {
        seen += s.1;
        seen >= half
    })?;
    let near = || slopes.iter().filter(|s| (s.0 - middle.0).abs() < 0.02);
    let weight: f64 = near().map(|s| s.1).sum();
    Some(near().map(|s| s.0 * s.1).sum::<f64>() / weight)
}

/// η of the floor at ξ = 0: the offset under which most of the stripe lies on some height. Where
/// two do equally well (a target whose steps are alike, seen in part) the lowest stretch is floor.
fn floor_offset(stretches: &[Stretch], heights_m: &[f64], within_m: f64) -> Option<f64> {
    let mut best: Option<(usize, f64)> = None;
    for s in stretches.iter().filter(|s| s.to - s.from >= LONG_STRETCH) {
        for h in heights_m {
            let floor = s.offset_m - h;
            let on_some = |t: &&Stretch| {
                heights_m
                    .iter()
                    .any(|h| (t.offset_m - floor - h).abs() < within_m)
            };
            let score: usize = stretches
                .iter()
                .filter(on_some)
                .map(|t| t.to - t.from)
                .sum();
            let better = match best {
                None => true,
                Some((most, at)) => score > most || (score == most && floor > at),
            };
            if better {
                best = Some((score, floor));
            }
        }
    }
    best.map(|b| b.1)
}

/// Weighted least squares of η = η₀ + slope ξ + h over all sound points, twice, without outliers the second time.
fn fit_lines(
    points: &[PlanePoint],
    stretches: &[Stretch],
    heights_m: &[f64],
    eta0_m: f64,
    slope: f64,
) -> Option<Levels> {
    let (mut eta0_m, mut slope) = (eta0_m, slope);
    let mut rms_m = f64::INFINITY;
    let mut out = None;
    for _ in 0..3 {
        let (mut w0, mut w1, mut w2, mut e0, mut e1) = (0.0, 0.0, 0.0, 0.0, 0.0);
        let (mut square, mut n) = (0.0, 0usize);
        let mut chi = 0.0;
        for (p, h) in on_levels(points, stretches, heights_m).filter(|(p, _)| p.sound) {
            let residual = p.eta_m - h - eta0_m - slope * p.xi_m;
            if residual.abs() > (4.0 * rms_m).max(3e-4) && rms_m.is_finite() {
                continue;
            }
            let w = 1.0 / (p.sd_m * p.sd_m);
            w0 += w;
            w1 += w * p.xi_m;
            w2 += w * p.xi_m * p.xi_m;
            e0 += w * residual;
            e1 += w * residual * p.xi_m;
            square += residual * residual;
            chi += w * residual * residual;
            n += 1;
        }
        let det = w0 * w2 - w1 * w1;
        if n < 5 || det.is_nan() || det <= 0.0 {
            break;
        }
        eta0_m += (w2 * e0 - w1 * e1) / det;
        slope += (w0 * e1 - w1 * e0) / det;
        rms_m = (square / n as f64).sqrt();
        // Scatter of the points beyond their own sds is in the lines as well.
        let excess = (chi / n as f64).max(1.0);
        out = Some(Levels {
            eta0_m,
            slope,
            eta0_sd_m: (excess * w2 / det).sqrt(),
            slope_sd: (excess * w0 / det).sqrt(),
            rms_m,
            points: n,
            segments: Vec::new(),
            steps: Vec::new(),
            caveats: Vec::new(),
        });
    }
    out
}

fn on_levels<'a>(
    points: &'a [PlanePoint],
    stretches: &'a [Stretch],
    heights_m: &'a [f64],
) -> impl Iterator<Item = (&'a PlanePoint, f64)> {
    stretches
        .iter()
        .filter_map(|s| s.level.map(|k| (s, heights_m[k])))
        .flat_map(|(s, h)| points[s.from..s.to].iter().map(move |p| (p, h)))
}

/// Consecutive stretches of one level, as (from, to, level): gaps left by particles are bridged.
fn runs(stretches: &[Stretch]) -> Vec<(usize, usize, usize)> {
    let mut runs: Vec<(usize, usize, usize)> = Vec::new();
    for s in stretches.iter().filter(|s| s.to - s.from >= 4) {
        let Some(level) = s.level else { continue };
        match runs.last_mut() {
            Some(last) if last.2 == level => last.1 = s.to,
            _ => runs.push((s.from, s.to, level)),
        }
    }
    runs
}

fn segment(points: &[PlanePoint], run: &(usize, usize, usize), heights_m: &[f64]) -> Segment {
    let (first, last) = (&points[run.0], &points[run.1 - 1]);
    Segment {
        height_m: heights_m[run.2],
        columns_px: [first.column_px, last.column_px],
        xi_m: [first.xi_m, last.xi_m],
    }
}

/// The step between two runs, measured on the upper one.
fn step(
    points: &[PlanePoint],
    pair: &[(usize, usize, usize)],
    heights_m: &[f64],
    image: Option<(&GreyImage, f64)>,
    map: &dyn PlaneMap,
) -> Option<Step> {
    let [left, right] = pair else { return None };
    let gap = points[right.0].column_px - points[left.1 - 1].column_px;
    // Behind a tall slab the camera sees nothing for a while.
    let tall_m = (heights_m[left.2] - heights_m[right.2]).abs();
    if gap > STEP_GAP_COLUMNS + HIDDEN_COLUMNS_PER_M * tall_m {
        return None;
    }
    let to_starboard = left.2 > right.2;
    let upper = if to_starboard { left } else { right };
    let end = if to_starboard {
        points[upper.1 - 1]
    } else {
        points[upper.0]
    };
    let (column_px, row_px, sd_px) = match image {
        Some((image, background)) => {
            fading_end(&points[upper.0..upper.1], image, background, to_starboard)?
        }
        None => {
            // Half way between the last column of one level and the first of the other.
            let column = if gap <= 2.5 {
                0.5 * (points[right.0].column_px + points[left.1 - 1].column_px)
            } else {
                end.column_px
            };
            (column, end.row_px, 12f64.sqrt().recip())
        }
    };
    if column_px < BORDER_COLUMNS {
        return None;
    }
    let at = map.to_plane(column_px, row_px)?;
    let slope = map.jacobian(column_px, row_px)?;
    Some(Step {
        upper_m: heights_m[upper.2],
        lower_m: heights_m[if to_starboard { right.2 } else { left.2 }],
        to_starboard,
        column_px,
        xi_m: at.xi_m,
        eta_m: at.eta_m,
        sd_m: (slope[(0, 0)] * sd_px).abs(),
    })
}

/// Where the light of a run ends: column, row, sd of the column \[px\].
///
/// Along the run's own line, continued, each column's light is summed with the stripe's profile as
/// weight; inside the upper face that sum is its plateau, outside zero, and whatever the fading between
/// them looks like, if it is symmetric the area under it puts the edge where the sheet's middle
/// meets it. So neither blur nor thickness nor a slanting edge shifts the point.
fn fading_end(
    run: &[PlanePoint],
    image: &GreyImage,
    background: f64,
    to_starboard: bool,
) -> Option<(f64, f64, f64)> {
    let near = |k: usize| {
        if to_starboard {
            &run[run.len() - 1 - k]
        } else {
            &run[k]
        }
    };
    let end = near(0).column_px;
    let sound: Vec<&PlanePoint> = (0..run.len())
        .map(near)
        .filter(|p| p.sound)
        .take(60)
        .collect();
    if sound.len() < 6 {
        return None;
    }
    let n = sound.len() as f64;
    let (mc, mr) = sound.iter().fold((0.0, 0.0), |(c, r), p| {
        (c + p.column_px / n, r + p.row_px / n)
    });
    let (scc, scr) = sound.iter().fold((0.0, 0.0), |(a, b), p| {
        (
            a + (p.column_px - mc).powi(2),
            b + (p.column_px - mc) * (p.row_px - mr),
        )
    });
    let line = |column: f64| {
        mr + if scc > 0.0 {
            scr / scc * (column - mc)
        } else {
            0.0
        }
    };
    let sigma = sound.iter().map(|p| p.sigma_px).sum::<f64>() / n;
    let light = |column: i64| -> Option<f64> {
        let middle = line(column as f64);
        let column = usize::try_from(column)
            .ok()
            .filter(|c| *c < image.width_px)?;
        let half = (2.5 * sigma).ceil();
        let (mut sum, mut norm) = (0.0, 0.0);
        for row in (middle - half).ceil() as i64..=(middle + half).floor() as i64 {
            let row_at = usize::try_from(row).ok().filter(|r| *r < image.height_px)?;
            let w = (-0.5 * ((row as f64 - middle) / sigma).powi(2)).exp();
            sum += w * (f64::from(image.pixels[row_at * image.width_px + column]) - background);
            norm += w * w;
        }
        Some(sum / norm)
    };
    let sign = if to_starboard { 1 } else { -1 };
    let end = end as i64;
    let inside: Vec<f64> = (END_REACH..END_REACH + 16)
        .filter_map(|k| light(end - sign * k))
        .collect();
    // Short faces (a joint seen aslant) have less than that; then what there is.
    let available = run
        .len()
        .saturating_sub(END_REACH as usize + 2)
        .min(inside.len());
    if available < 4 {
        return None;
    }
    let mut plateau: Vec<f64> = inside[..available].to_vec();
    plateau.sort_by(f64::total_cmp);
    let level = plateau[available / 2];
    if level.is_nan() || level <= 4.0 {
        return None;
    }
    let mut area = 0.0;
    for k in -END_REACH + 1..=END_REACH {
        area += light(end + sign * k)? / level;
    }
    let column = (end + sign * (1 - END_REACH)) as f64 + f64::from(sign as i32) * (area - 0.5);
    if (column - end as f64).abs() > END_REACH as f64 {
        return None;
    }
    // Noise of 20 sums and of the plateau they are compared with.
    let spread = inside[..available]
        .iter()
        .map(|v| (v / level - 1.0).powi(2))
        .sum::<f64>()
        / (available as f64 - 1.0);
    let sd = (spread
        * (2.0 * END_REACH as f64 + (END_REACH * END_REACH) as f64 / available as f64))
        .sqrt()
        .max(0.01);
    Some((column, line(column), sd))
}

/// Grey level without laser: the median of a grid of pixels (the stripe covers a few hundredths of the image).
pub(crate) fn background_level(image: &GreyImage) -> f64 {
    let mut counts = [0u32; 256];
    let every = (image.pixels.len() / 8192).max(1) | 1;
    for p in image.pixels.iter().step_by(every) {
        counts[usize::from(*p)] += 1;
    }
    let total: u32 = counts.iter().sum();
    let mut below = 0;
    for (level, n) in counts.iter().enumerate() {
        if 2 * (below + n) >= total && *n > 0 {
            // Inside the median's own level, by the share on either side.
            return level as f64 - 0.5
                + (0.5 * f64::from(total) - f64::from(below)) / f64::from(*n);
        }
        below += n;
    }
    0.0
}

impl SheetTable {
    /// The body-frame tank attitude is not needed here: ξ, η as the map has them.
    pub(super) fn holds(&self, image: &GreyImage) -> bool {
        image.width_px == self.width_px && image.height_px == self.height_px
    }
}
