//! Grey levels of the frames, pooled: across the stripe, and in blocks of the background.

use super::forward::Fields;
use super::options::LightOptions;
use crate::profiles::geometry::Geometry;
use crate::profiles::observe::{ImageRun, Seen, line, stretches};
use hydroline_core::frame::GreyImage;
use hydroline_stripe::{StripePoint, quality};
use nalgebra::Vector3;

/// Some pixels of a frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sample {
    /// Their middle \[px\].
    pub column_px: f64,
    /// See there.
    pub row_px: f64,
    /// sd of their rows about it \[px\].
    pub half_px: f64,
    /// Their mean grey level.
    pub grey: f64,
    /// Variance of that mean by the pixels' noise \[grey levels²\].
    pub variance: f64,
    /// Rows below the stripe's middle; `None`: background \[px\].
    pub below_px: Option<f64>,
    /// Rows per column of the stripe.
    pub slope: f64,
    /// Distance ahead of the sheet \[m\].
    pub off_m: f64,
    /// Metres that its ray gains ahead of the sheet per metre that it comes down.
    pub run: f64,
    /// Distance ahead of the sheet that one row adds at the stripe's middle \[m\], and the run of that ray. Over a stripe's rows
    /// both change: a Gaussian sheet is no Gaussian stripe.
    pub middle: (f64, f64),
    /// Tangent of the angle from the fan's middle, starboard positive.
    pub fan_tan: f64,
    /// From the laser to the surface and on to the camera \[m\].
    pub way_m: f64,
    /// Basis functions of the fields there.
    pub fields: Fields,
}

/// Samples of some columns across the stripe, or of the background between.
#[derive(Debug, Clone)]
pub(super) struct Bin {
    pub samples: Vec<Sample>,
    /// Whether its row and its brightness are its own.
    pub on_line: bool,
}

/// One frame's.
#[derive(Debug, Clone)]
pub(super) struct LightFrame {
    pub bins: Vec<Bin>,
    /// Pixel noise in the dark \[grey levels\].
    pub noise_sd: f64,
}

/// Where the sheet is seen at a pixel: in the body frame, distances.
#[derive(Debug, Clone, Copy)]
struct Place {
    at_m: Vector3<f64>,
    /// Fall of the surface per metre to starboard: as the stripe runs there.
    fall: f64,
    fan_tan: f64,
    way_m: f64,
}

/// Of a stripe that runs by so many rows per column.
fn place(g: &Geometry, column_px: f64, row_px: f64, slope: f64) -> Option<Place> {
    let on_sheet = |columns: f64| g.on_sheet(&g.ray(column_px + columns, row_px + slope * columns));
    let (port, p, starboard) = (on_sheet(-APART_PX)?, on_sheet(0.0)?, on_sheet(APART_PX)?);
    let o = g.optics();
    let (apex, eye) = (
        Vector3::new(o.l_laser_m, 0.0, 0.0),
        Vector3::from(o.camera_m),
    );
    (p.z > 0.0).then(|| Place {
        at_m: p,
        fall: (starboard.z - port.z) / (starboard.y - port.y),
        fan_tan: p.y / p.z,
        way_m: (p - apex).norm() + (p - eye).norm(),
    })
}

/// Columns to either side over which a surface's fall is taken \[px\].
const APART_PX: f64 = 2.0;

/// (ahead of the sheet \[m\], per row \[m\], the ray's run) of a pixel on the surface at a place.
fn ahead(g: &Geometry, column_px: f64, row_px: f64, at: &Place) -> Option<(f64, f64, f64)> {
    let on = |row: f64| g.ahead(&g.ray(column_px, row), &at.at_m, at.fall);
    let (up, down) = (on(row_px - 0.5)?, on(row_px + 0.5)?);
    let middle = |a: f64, b: f64| 0.5 * (a + b);
    Some((
        middle(up.off_m, down.off_m),
        down.off_m - up.off_m,
        middle(up.run, down.run),
    ))
}

/// Pixels summed.
#[derive(Debug, Clone, Copy, Default)]
struct Sum {
    n: f64,
    column: f64,
    below: f64,
    below2: f64,
    grey: f64,
    grey2: f64,
}

impl Sum {
    fn add(&mut self, column: f64, below: f64, grey: f64) {
        self.n += 1.0;
        self.column += column;
        self.below += below;
        self.below2 += below * below;
        self.grey += grey;
        self.grey2 += grey * grey;
    }
}

/// Class of a distance below the stripe in rows, signed; `None` farther off.
fn class(below_px: f64, o: &LightOptions) -> Option<i64> {
    let rows = below_px.round() as i64;
    if rows.abs() <= o.near_rows {
        return Some(rows);
    }
    let k = o.far_rows.iter().position(|end| rows.abs() <= *end)? as i64;
    Some(rows.signum() * (o.near_rows + 1 + k))
}

/// Frames evenly over all runs.
pub(super) fn frames(runs: &[ImageRun], g: &Geometry, o: &LightOptions) -> Vec<LightFrame> {
    let all: Vec<&Seen> = runs.iter().flat_map(|r| &r.frames).collect();
    let n = o.frames.min(all.len()).max(1);
    let frames: Vec<LightFrame> = (0..n)
        .filter_map(|k| all.get((2 * k + 1) * all.len() / (2 * n)))
        .map(|seen| frame(seen, g, o))
        .collect();
    thinned(&frames, o.most)
}

/// Some of the samples, evenly: so many bins across the stripe and blocks of background in all.
pub(super) fn thinned(frames: &[LightFrame], [bins, blocks]: [usize; 2]) -> Vec<LightFrame> {
    let on_line = |f: &LightFrame| f.bins.iter().filter(|b| b.on_line).count();
    let dark = |f: &LightFrame| -> usize {
        let own = f.bins.iter().filter(|b| !b.on_line);
        own.map(|b| b.samples.len()).sum()
    };
    let every = |all: usize, most: usize| all.div_ceil(most.max(1)).max(1);
    let bins = every(frames.iter().map(on_line).sum(), bins);
    let blocks = every(frames.iter().map(dark).sum(), blocks);
    let thin = |(n, f): (usize, &LightFrame)| {
        // Other columns and rows from frame to frame.
        let line = f.bins.iter().filter(|b| b.on_line);
        let line = line.skip(n % bins).step_by(bins).cloned();
        let dark = f.bins.iter().filter(|b| !b.on_line).map(|b| Bin {
            samples: b
                .samples
                .iter()
                .skip(n % blocks)
                .step_by(blocks)
                .copied()
                .collect(),
            on_line: false,
        });
        LightFrame {
            bins: line.chain(dark).collect(),
            ..f.clone()
        }
    };
    frames.iter().enumerate().map(thin).collect()
}

fn frame(seen: &Seen, g: &Geometry, o: &LightOptions) -> LightFrame {
    // Close to a step the profile is cut; a clipped one is what the light is asked about.
    let sound = |p: &&StripePoint| p.quality & (quality::NEAR_STEP | quality::RIVAL) == 0;
    let mut lines: Vec<Course> = Vec::new();
    let mut bins = Vec::new();
    for stretch in stretches(&seen.profile.points) {
        let points: Vec<StripePoint> = stretch.iter().filter(sound).copied().collect();
        for some in points
            .chunks(o.columns)
            .filter(|c| 2 * c.len() >= o.columns)
        {
            let [c, r, slope] = line(some.iter());
            bins.extend(across(seen, some, [c, r, slope], g, o));
        }
        lines.extend(Course::of(stretch));
    }
    bins.push(background(seen, &lines, g, o));
    LightFrame {
        bins,
        noise_sd: seen.profile.noise_sd,
    }
}

fn across(
    seen: &Seen,
    points: &[StripePoint],
    [c, r, slope]: [f64; 3],
    g: &Geometry,
    o: &LightOptions,
) -> Option<Bin> {
    let reach = *o.far_rows.last()?;
    let classes = o.near_rows + 1 + o.far_rows.len() as i64;
    let mut sums = vec![Sum::default(); (2 * classes + 1) as usize];
    let image = &seen.image;
    for p in points {
        let column = p.column_px.round();
        let middle = r + slope * (column - c);
        let first = (middle.round() as i64 - reach).max(0) as usize;
        let last = ((middle.round() as i64 + reach).max(0) as usize)
            .min(image.height_px.saturating_sub(1));
        for row in first..=last {
            let below = row as f64 - middle;
            let Some(pixel) = image.pixels.get(row * image.width_px + column as usize) else {
                continue;
            };
            if let Some(k) = class(below, o) {
                sums[(k + classes) as usize].add(column, below, f64::from(*pixel));
            }
        }
    }
    let at = place(g, c, r, slope)?;
    let (_, per_row_m, run) = ahead(g, c, r, &at)?;
    let middle = (per_row_m, run);
    let samples = sums
        .iter()
        .filter(|s| 2.0 * s.n >= points.len() as f64)
        .filter_map(|s| {
            let (column_px, below) = (s.column / s.n, s.below / s.n);
            let row_px = r + slope * (column_px - c) + below;
            let (off_m, _, run) = ahead(g, column_px, row_px, &at)?;
            Some(Sample {
                column_px,
                row_px,
                half_px: (s.below2 / s.n - below * below).max(0.0).sqrt(),
                grey: s.grey / s.n,
                variance: 1.0 / s.n,
                below_px: Some(below),
                slope,
                off_m,
                run,
                middle,
                fan_tan: at.fan_tan,
                way_m: at.way_m,
                fields: Fields::at(column_px, row_px, size_px(image)),
            })
        });
    Some(Bin {
        samples: samples.collect(),
        on_line: true,
    })
}

fn size_px(image: &GreyImage) -> [f64; 2] {
    [image.width_px as f64, image.height_px as f64]
}

/// The straight line that a stretch of the stripe runs along.
struct Course {
    columns_px: [f64; 2],
    /// Its points' mean column and row, rows per column.
    line: [f64; 3],
}

impl Course {
    fn of(stretch: &[StripePoint]) -> Option<Course> {
        Some(Course {
            columns_px: [stretch.first()?.column_px, stretch.last()?.column_px],
            line: line(stretch.iter()),
        })
    }

    /// Row at a column, and on from the nearer end as that end has it.
    fn row_px(&self, column_px: f64) -> f64 {
        let [first, last] = self.columns_px;
        let [c, r, slope] = self.line;
        r + slope * (column_px.clamp(first, last) - c)
    }

    /// Columns from a column to the nearest of its own.
    fn away_px(&self, column_px: f64) -> f64 {
        let [first, last] = self.columns_px;
        (first - column_px).max(column_px - last).max(0.0)
    }

    /// Whether its light falls on rows between columns, `reach` rows to either side.
    fn lights(&self, columns_px: [f64; 2], rows_px: [f64; 2], reach: f64) -> bool {
        let [a, b] = columns_px.map(|c| self.row_px(c));
        rows_px[1] > a.min(b) - reach && rows_px[0] < a.max(b) + reach
    }
}

/// Blocks farther from any stripe than the classes across it reach.
fn background(seen: &Seen, lines: &[Course], g: &Geometry, o: &LightOptions) -> Bin {
    let image = &seen.image;
    let reach = o.far_rows.last().map_or(0.0, |r| *r as f64);
    let [wide, high] = o.block_px;
    let mut samples = Vec::new();
    for left in (0..image.width_px.saturating_sub(wide - 1)).step_by(wide) {
        let middle = left as f64 + 0.5 * (wide as f64 - 1.0);
        let columns = [left as f64, (left + wide) as f64];
        let over = |l: &&Course| l.columns_px[0] < columns[1] && l.columns_px[1] > columns[0];
        let away = |l: &&Course| l.away_px(middle);
        let nearest = lines.iter().min_by(|a, b| away(a).total_cmp(&away(b)));
        let at = nearest.and_then(|l| place(g, middle, l.row_px(middle), l.line[2]));
        let Some(at) = at else { continue };
        for top in (0..image.height_px.saturating_sub(high - 1)).step_by(high) {
            let rows = [top as f64, (top + high) as f64];
            let lit = |l: &Course| l.lights(columns, rows, reach);
            let hit = lines.iter().filter(over).any(lit) || nearest.is_some_and(lit);
            if hit {
                continue;
            }
            let mut sum = Sum::default();
            for row in top..top + high {
                let from = row * image.width_px + left;
                for pixel in image.pixels.get(from..from + wide).unwrap_or_default() {
                    sum.add(0.0, 0.0, f64::from(*pixel));
                }
            }
            let row_px = top as f64 + 0.5 * (high as f64 - 1.0);
            if let Some((off_m, off_per_row_m, run)) = ahead(g, middle, row_px, &at) {
                samples.push(Sample {
                    column_px: middle,
                    row_px,
                    half_px: high as f64 / 12f64.sqrt(),
                    grey: sum.grey / sum.n,
                    variance: 1.0 / sum.n,
                    below_px: None,
                    slope: 0.0,
                    off_m,
                    run,
                    middle: (off_per_row_m, run),
                    fan_tan: at.fan_tan,
                    way_m: at.way_m,
                    fields: Fields::at(middle, row_px, size_px(image)),
                });
            }
        }
    }
    Bin {
        samples,
        on_line: false,
    }
}
