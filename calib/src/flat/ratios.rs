//! Black level and ratios of the exposures from the levels alone: g_jp = b + s_j y_p + d(g_jp), each place's y_p free.
//!
//! Variable projection (Golub and Pereyra 1973): y_p is linear and drops out place by place. d(g) is a line over knots with
//! a normal prior whose size is not known: it is integrated over, and so what is left of the curve is in the covariance.

use super::exposure::{Cell, Field};
use super::{Deviation, FlatError, Options};
use hydroline_numerics::cholesky::ScaledCholesky;
use hydroline_numerics::statistics::median;
use nalgebra::{DMatrix, DVector};

/// Knots of the deviation.
const KNOTS: usize = 10;
/// Of these so many are one with the black level, the places and the power: a constant, a slope, a change of γ.
const FREE_OF_KNOTS: f64 = 3.0;
/// Sizes that the deviation may have \[grey levels\]: from, to, and each by so much larger.
const SIZES: [f64; 3] = [0.003, 10.0, 1.25];
/// Half-Cauchy scale of the size beforehand \[grey levels\]: a table of 8 bits rounds by 0.29.
const SIZE_USUAL: f64 = 0.1;
/// Powers that are tried to begin with.
const POWERS: [f64; 3] = [0.15, 5.0, 1.08];
/// Steps in which the choice of cells follows the curve, and steps after that.
const CHOOSING: usize = 5;
const SETTLING: usize = 12;
/// A step of less than this share of an sd ends it.
const SETTLED: f64 = 1e-3;
/// Beyond this many usual deviations, squared, a place has changed between exposures.
const CHANGED: f64 = 25.0;
/// Powers by which cells are chosen: exposures that do not follow their times show none.
const GATES: [f64; 2] = [0.3, 4.0];
/// Variance of rounding: it comes after the curve, and is not distorted by it.
const ROUNDING: f64 = 1.0 / 12.0;
/// Share of χ² that a deviation of the curve explains where it is the curve that is off, and not the scene.
const EXPLAINED: f64 = 0.5;

/// The estimate from the levels.
#[derive(Debug, Clone)]
pub(super) struct Ratios {
    /// b, then ln s of each exposure but the one that the others are counted from.
    pub mean: DVector<f64>,
    pub covariance: DMatrix<f64>,
    /// That one.
    pub reference: usize,
    pub levels: [f64; 2],
    pub deviation: Deviation,
    pub chi2: f64,
    pub blocks: [usize; 2],
}

/// A block under an exposure that is used.
#[derive(Debug, Clone, Copy)]
struct Seen {
    exposure: usize,
    level: f64,
    variance: f64,
}

/// The curve so far.
#[derive(Debug, Clone)]
struct Curve {
    black: f64,
    gamma: f64,
    ln_ratio: Vec<f64>,
}

impl Curve {
    /// A block's level without what noise before the curve adds to its mean; `None` where it is of no use.
    fn level(&self, cell: &Cell, field: &Field, ends: [f64; 2], options: &Options) -> Option<f64> {
        let [dark, bright] = cell.range;
        let sd = |level: f64| field.noise.at(level).sqrt();
        let clear = |level: f64| options.clear_sds * sd(level);
        // Half a level: a mean that rounds to it.
        let whole = dark - clear(dark) > field.floor + 0.5
            && bright + clear(bright) < field.clip_level() - 0.5;
        if !whole || dark < ends[0] || bright > ends[1] {
            return None;
        }
        let above = dark - self.black;
        // Cameras cut off what is darker than none, straight ones too: near it the mean of noisy light is none of the curve's.
        if self.gamma * above < options.light_sds * sd(dark) {
            return None;
        }
        // E f(L + n) = f(L) + f″ σ² / 2, with σ from the levels' own noise: f′² σ² = v.
        let second_order = (self.gamma - 1.0) / self.gamma;
        let noise = (cell.noise - ROUNDING).max(0.0);
        Some(cell.mean - 0.5 * second_order * noise / (cell.mean - self.black))
    }

    fn seen(&self, field: &Field, ends: [f64; 2], options: &Options) -> Vec<Vec<Seen>> {
        let blocks = field.cells.first().map_or(0, Vec::len);
        (0..blocks)
            .map(|k| {
                let of = |(exposure, cells): (usize, &Vec<Option<Cell>>)| {
                    let cell = cells.get(k).copied().flatten()?;
                    Some(Seen {
                        exposure,
                        level: self.level(&cell, field, ends, options)?,
                        variance: cell.variance,
                    })
                };
                field.cells.iter().enumerate().filter_map(of).collect()
            })
            .map(|seen: Vec<Seen>| if seen.len() < 2 { Vec::new() } else { seen })
            .collect()
    }
}

/// Normal equations of b, ln s and the knots.
struct Equations {
    matrix: DMatrix<f64>,
    right: DVector<f64>,
    chi2: f64,
    /// χ² of each block, over one less than the exposures that it is seen under.
    of_blocks: Vec<f64>,
    cells: usize,
    blocks: usize,
}

#[derive(Debug, Clone, Copy)]
struct Knots {
    levels: [f64; 2],
}

impl Knots {
    fn place(&self, k: usize) -> f64 {
        let [low, high] = self.levels;
        low + (high - low) * k as f64 / (KNOTS - 1) as f64
    }

    /// The two knots about a level and their shares.
    fn about(&self, level: f64) -> [(usize, f64); 2] {
        let [low, high] = self.levels;
        let at = ((level - low) / (high - low).max(1e-9)).clamp(0.0, 1.0) * (KNOTS - 1) as f64;
        let k = (at as usize).min(KNOTS - 2);
        let t = at - k as f64;
        [(k, 1.0 - t), (k + 1, t)]
    }
}

fn equations(
    seen: &[Vec<Seen>],
    curve: &Curve,
    reference: usize,
    knots: Option<&Knots>,
) -> Equations {
    let exposures = curve.ln_ratio.len();
    let ratios: Vec<f64> = curve.ln_ratio.iter().map(|a| a.exp()).collect();
    let size = exposures + knots.map_or(0, |_| KNOTS);
    // b stands at 0, ln s of the others behind it in their order.
    let place = |j: usize| (j != reference).then_some(if j < reference { j + 1 } else { j });
    let mut all = Equations {
        matrix: DMatrix::zeros(size, size),
        right: DVector::zeros(size),
        chi2: 0.0,
        of_blocks: Vec::with_capacity(seen.len()),
        cells: 0,
        blocks: 0,
    };
    let mut row = Vec::with_capacity(4);
    let mut by_place = DVector::zeros(size);
    for block in seen {
        if block.len() < 2 {
            all.of_blocks.push(0.0);
            continue;
        }
        let (mut ss, mut sg) = (0.0, 0.0);
        for s in block {
            let (ratio, weight) = (ratios[s.exposure], 1.0 / s.variance);
            ss += weight * ratio * ratio;
            sg += weight * ratio * (s.level - curve.black);
        }
        let y = sg / ss;
        by_place.fill(0.0);
        let mut chi2 = 0.0;
        for s in block {
            let (ratio, weight) = (ratios[s.exposure], 1.0 / s.variance);
            let residual = s.level - curve.black - ratio * y;
            chi2 += weight * residual * residual;
            row.clear();
            row.push((0, 1.0));
            row.extend(place(s.exposure).map(|at| (at, ratio * y)));
            row.extend(knots.iter().flat_map(|knots| {
                // At the level of the curve: the seen one has its own noise in it, which would look like a slope.
                let about = knots.about(curve.black + ratio * y);
                about.map(|(k, share)| (exposures + k, share))
            }));
            for (i, a) in &row {
                all.right[*i] += weight * a * residual;
                by_place[*i] += weight * a * ratio;
                for (j, b) in &row {
                    all.matrix[(*i, *j)] += weight * a * b;
                }
            }
        }
        all.matrix.ger(-1.0 / ss, &by_place, &by_place, 1.0);
        all.chi2 += chi2;
        all.of_blocks.push(chi2 / (block.len() as f64 - 1.0));
        all.cells += block.len();
        all.blocks += 1;
    }
    all
}

/// Whether every exposure is seen together with the others; else one that is not.
fn apart(seen: &[Vec<Seen>], exposures: usize, reference: usize) -> Option<usize> {
    let mut joined = vec![false; exposures];
    joined[reference] = true;
    loop {
        let mut more = false;
        for block in seen {
            if block.iter().any(|s| joined[s.exposure]) {
                for s in block {
                    more |= !std::mem::replace(&mut joined[s.exposure], true);
                }
            }
        }
        if !more {
            return joined.iter().position(|j| !j);
        }
    }
}

pub(super) fn fit(
    field: &Field,
    times: &[(String, f64)],
    ends: [f64; 2],
    options: &Options,
) -> Result<Ratios, FlatError> {
    let exposures = times.len();
    let ln_times: Vec<f64> = times.iter().map(|(_, t)| t.ln()).collect();
    let mut curve = begin(field, &ln_times, ends, options);
    let [least, most, _] = POWERS;
    if !(least * 1.01..most / 1.1).contains(&curve.gamma) {
        return Err(FlatError::NoCamera { gamma: curve.gamma });
    }
    let mut seen = curve.seen(field, ends, options);
    let mut reference = most_seen(&seen, exposures);
    let mut changed = None;
    for step in 0..CHOOSING + SETTLING {
        if step < CHOOSING {
            seen = curve.seen(field, ends, options);
            reference = most_seen(&seen, exposures);
            let off = curve.ln_ratio[reference];
            curve.ln_ratio.iter_mut().for_each(|a| *a -= off);
            if let Err(error) = enough(&seen, options) {
                // Enough was seen at first and is lost: the levels lead to no curve at all.
                return Err(changed.map_or(error, |share| FlatError::Moved {
                    share,
                    most: options.moved_most_share,
                }));
            }
            if let Some(k) = apart(&seen, exposures, reference) {
                return Err(FlatError::Apart {
                    name: times[k].0.clone(),
                });
            }
            if step > 1 {
                leave_changed(&mut seen, &curve, reference);
            }
        }
        let all = equations(&seen, &curve, reference, None);
        if changed.is_none() {
            let off = all.of_blocks.iter().filter(|chi2| **chi2 > CHANGED).count();
            changed = Some(off as f64 / all.blocks.max(1) as f64);
        }
        let factor = ScaledCholesky::new(&all.matrix, 0.0).ok_or(FlatError::Undetermined)?;
        let move_by = factor.solve(&all.right);
        curve.black += move_by[0];
        for (j, a) in curve.ln_ratio.iter_mut().enumerate() {
            if j != reference {
                *a += move_by[if j < reference { j + 1 } else { j }].clamp(-1.0, 1.0);
            }
        }
        curve.gamma = slope(&ln_times, &curve.ln_ratio).clamp(GATES[0], GATES[1]);
        if step > CHOOSING && move_by.dot(&all.right) < SETTLED * SETTLED {
            break;
        }
    }
    let before = curve.seen(field, ends, options);
    let count = |seen: &[Vec<Seen>]| seen.iter().filter(|s| !s.is_empty()).count();
    let blocks = [count(&seen), count(&before).saturating_sub(count(&seen))];
    let moved = blocks[1] as f64 / (blocks[0] + blocks[1]).max(1) as f64;
    if moved > options.moved_most_share {
        return Err(FlatError::Moved {
            share: moved,
            most: options.moved_most_share,
        });
    }
    widened(&seen, &curve, reference, blocks, options)
}

/// Leaves out what changed between exposures: places that deviate far more than is usual.
fn leave_changed(seen: &mut [Vec<Seen>], curve: &Curve, reference: usize) {
    let of_blocks = equations(seen, curve, reference, None).of_blocks;
    let mut there: Vec<f64> = seen
        .iter()
        .zip(&of_blocks)
        .filter(|(block, _)| !block.is_empty())
        .map(|(_, chi2)| *chi2)
        .collect();
    let usual = median(&mut there).unwrap_or(1.0).max(1.0);
    for (block, chi2) in seen.iter_mut().zip(of_blocks) {
        if chi2 > CHANGED * usual {
            block.clear();
        }
    }
}

fn most_seen(seen: &[Vec<Seen>], exposures: usize) -> usize {
    let mut counts = vec![0usize; exposures];
    for s in seen.iter().flatten() {
        counts[s.exposure] += 1;
    }
    (0..exposures).max_by_key(|k| counts[*k]).unwrap_or(0)
}

fn levels(seen: &[Vec<Seen>]) -> [f64; 2] {
    seen.iter()
        .flatten()
        .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], s| {
            [low.min(s.level), high.max(s.level)]
        })
}

fn enough(seen: &[Vec<Seen>], options: &Options) -> Result<(), FlatError> {
    let blocks = seen.iter().filter(|s| !s.is_empty()).count();
    let [low, high] = levels(seen);
    let span = (high - low).max(0.0);
    if blocks < options.blocks_least || span < options.span_least_levels {
        return Err(FlatError::Little {
            blocks,
            blocks_least: options.blocks_least,
            span,
            span_least: options.span_least_levels,
        });
    }
    Ok(())
}

/// The likeliest of some powers, exposures by their times.
fn begin(field: &Field, ln_times: &[f64], ends: [f64; 2], options: &Options) -> Curve {
    let of = |gamma: f64| Curve {
        black: 0.0,
        gamma,
        ln_ratio: ln_times.iter().map(|t| gamma * (t - ln_times[0])).collect(),
    };
    let seen = of(1.0).seen(field, ends, options);
    let [from, to, by] = POWERS;
    let mut best = (f64::INFINITY, of(1.0));
    let mut gamma = from;
    while gamma < to {
        let mut curve = of(gamma);
        let all = equations(&seen, &curve, 0, None);
        let weight = all.matrix[(0, 0)];
        if weight > 0.0 {
            let chi2 = all.chi2 - all.right[0] * all.right[0] / weight;
            if chi2 < best.0 {
                curve.black = all.right[0] / weight;
                best = (chi2, curve);
            }
        }
        gamma *= by;
    }
    best.1
}

fn slope(x: &[f64], y: &[f64]) -> f64 {
    let n = x.len() as f64;
    let (mx, my) = (x.iter().sum::<f64>() / n, y.iter().sum::<f64>() / n);
    let (mut xx, mut xy) = (0.0, 0.0);
    for (x, y) in x.iter().zip(y) {
        xx += (x - mx) * (x - mx);
        xy += (x - mx) * (y - my);
    }
    xy / xx.max(1e-12)
}

/// Mean and covariance with the deviation integrated over, and what it is.
fn widened(
    seen: &[Vec<Seen>],
    curve: &Curve,
    reference: usize,
    blocks: [usize; 2],
    options: &Options,
) -> Result<Ratios, FlatError> {
    let levels = levels(seen);
    let knots = Knots { levels };
    let all = equations(seen, curve, reference, Some(&knots));
    let own = curve.ln_ratio.len();
    let of_size = |size: f64, noise: f64| {
        let mut matrix = &all.matrix / noise;
        for k in own..own + KNOTS {
            matrix[(k, k)] += 1.0 / (size * size);
        }
        let factor = ScaledCholesky::new(&matrix, 0.0)?;
        let right = &all.right / noise;
        let found = factor.solve(&right);
        let gain = found.dot(&right);
        Some((factor, found, gain))
    };
    let [from, to, by] = SIZES;
    let (_, _, gain) = of_size(to, 1.0).ok_or(FlatError::Undetermined)?;
    let free = all.cells as f64 - all.blocks as f64 - own as f64 - (KNOTS as f64 - FREE_OF_KNOTS);
    let chi2 = (all.chi2 - gain) / free.max(1.0);
    // Misfit that another curve explains is the camera's; misfit that none explains, the scene's.
    if chi2 > CHANGED && gain < EXPLAINED * all.chi2 {
        let off = all.of_blocks.iter().filter(|chi2| **chi2 > CHANGED).count();
        return Err(FlatError::Moved {
            share: off as f64 / all.blocks.max(1) as f64,
            most: options.moved_most_share,
        });
    }
    let noise = chi2.max(1.0);
    let (mut found, mut size) = (Vec::new(), from);
    while size <= to {
        let (factor, mean, gain) = of_size(size, noise).ok_or(FlatError::Undetermined)?;
        let beforehand = size / (1.0 + (size / SIZE_USUAL).powi(2));
        let ln_evidence =
            0.5 * gain - 0.5 * factor.ln_determinant() - KNOTS as f64 * size.ln() + beforehand.ln();
        found.push((ln_evidence, mean, factor.inverse()));
        size *= by;
    }
    let best = found.iter().map(|f| f.0).fold(f64::NEG_INFINITY, f64::max);
    let sum: f64 = found.iter().map(|f| (f.0 - best).exp()).sum();
    let n = own + KNOTS;
    let mut mean = DVector::zeros(n);
    for (ln, of, _) in &found {
        mean += of * ((ln - best).exp() / sum);
    }
    let mut covariance = DMatrix::zeros(n, n);
    for (ln, of, inverse) in &found {
        let apart = of - &mean;
        covariance += (inverse + &apart * apart.transpose()) * ((ln - best).exp() / sum);
    }
    let mut here = DVector::zeros(own);
    here[0] = curve.black;
    for (j, a) in curve.ln_ratio.iter().enumerate() {
        if j != reference {
            here[if j < reference { j + 1 } else { j }] = *a;
        }
    }
    let left = mean.rows(own, KNOTS);
    let (at, most) = left
        .iter()
        .copied()
        .enumerate()
        .max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))
        .unwrap_or((0, 0.0));
    Ok(Ratios {
        mean: here + mean.rows(0, own),
        covariance: covariance.view((0, 0), (own, own)).into_owned(),
        reference,
        levels,
        deviation: Deviation {
            rms_levels: (left.norm_squared() / KNOTS as f64).sqrt(),
            most_levels: most,
            at_levels: knots.place(at),
            chi2: [gain / noise, KNOTS as f64 - FREE_OF_KNOTS],
        },
        chi2,
        blocks,
    })
}
