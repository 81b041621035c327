//! From views to a camera and a sheet.

use nalgebra::{DMatrix, Vector2, Vector3};

use super::adjust::{self, Free, Solved};
use super::bundle::{SHARED, State, ViewTerms};
use super::camera::{CAMERA, FOCAL, Lens};
use super::checks::{self, FreeError, LeftOut, Reservation};
use super::map::SheetMap;
use super::sheet::{CONE, LaserSurface};
use super::{FreeOptions, Seen, residuals, start};
use crate::map::lm::LmError;
use crate::map::refractive::Known;

/// What one view was worth.
#[derive(Debug, Clone, PartialEq)]
pub struct ViewReport {
    /// Name of the image.
    pub name: String,
    /// Pixel and residual of each node, seen minus predicted \[px\].
    pub nodes: Vec<[[f64; 2]; 2]>,
    /// Root mean square of a coordinate \[px\].
    pub rms_px: f64,
    /// Pixel of each piece of the line, its distance from the sheet \[m\] and across the line \[px\].
    pub line: Vec<([f64; 2], f64, f64)>,
    /// Distance of the board's origin from the camera \[m\].
    pub far_m: f64,
    /// Angle between the board's normal and the optical axis \[rad\].
    pub tilt_rad: f64,
    /// Why it was not used.
    pub left_out: Option<LeftOut>,
}

/// Boards that were predicted from the others.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Held {
    /// Boards.
    pub boards: usize,
    /// Their nodes, posed by every other one: rms of a coordinate of the rest \[px\].
    pub rms_px: f64,
    /// Their line's distance from the sheet, rms \[m\].
    pub line_m: f64,
    /// The same in the image, across the line \[px\].
    pub line_px: f64,
}

/// A camera and a sheet, and how well they fit.
#[derive(Debug, Clone)]
pub struct Fitted {
    /// The map.
    pub map: SheetMap,
    /// Views, in the order given.
    pub views: Vec<ViewReport>,
    /// Root mean square of a coordinate of all nodes used \[px\].
    pub rms_px: f64,
    /// The same of the line, across it \[px\].
    pub line_px: f64,
    /// Its distance from the sheet \[m\].
    pub line_m: f64,
    /// Scatter of nodes and of the line over their stated sds; at least 1.
    pub noise_scale: [f64; 2],
    /// Terms of the likeliest model, in words.
    pub terms: Vec<&'static str>,
    /// Boards that were predicted.
    pub held: Option<Held>,
    /// What must be known.
    pub reservations: Vec<Reservation>,
}

/// Views that are in use, with their state.
struct Work<'a> {
    views: Vec<&'a Seen>,
    terms: Vec<ViewTerms>,
    index: Vec<usize>,
    state: State,
}

impl Work<'_> {
    fn drop(&mut self, gone: &[usize]) {
        for k in gone.iter().rev() {
            self.views.remove(*k);
            self.terms.remove(*k);
            self.index.remove(*k);
            self.state.poses.remove(*k);
        }
    }
}

/// Camera, board poses and laser sheet from views of boards in the hand.
///
/// # Errors
/// [`FreeError`]: what is missing or wrong, and what to do.
pub fn calibrate(seen: &[Seen], options: &FreeOptions) -> Result<Fitted, FreeError> {
    let mut reasons: Vec<Option<LeftOut>> = vec![None; seen.len()];
    let mut work = begin(seen, options, &mut reasons)?;
    let camera = cameras(&mut work, options, &mut reasons)?;
    let mut reservations = Vec::new();
    let sheet = sheets(&mut work, options, &mut reservations)?;
    work.state = State {
        sheet: Some(sheet),
        ..camera
    };
    let far_m = median_far_m(&work);
    let prior = adjust::priors(&options.camera, far_m);
    let no_camera = |source| FreeError::NoCamera { source };
    let full = adjust::fullest(&options.camera, true);
    let solved = adjust::settle(&work.state, &mut work.terms, &prior, full).map_err(no_camera)?;
    let solved = line_misfits(&mut work, solved, options, &mut reservations, &prior, full)
        .map_err(no_camera)?;
    let noise_scale = rescale(&mut work, &solved);
    let models = models(&work, &solved.state, options, &prior);
    let (state, covariance, likeliest, free) =
        adjust::average(models).ok_or(no_camera(LmError::NotFinite))?;
    work.state = likeliest.state;
    finish(
        seen,
        options,
        &work,
        (state, covariance, free),
        noise_scale,
        reasons,
        reservations,
        &prior,
    )
}

/// Boards posed by the camera's prior and homographies.
fn begin<'a>(
    seen: &'a [Seen],
    options: &FreeOptions,
    reasons: &mut [Option<LeftOut>],
) -> Result<Work<'a>, FreeError> {
    let all: Vec<&Seen> = seen.iter().collect();
    let homographies = start::homographies(&all);
    let mut index = Vec::new();
    for (k, h) in homographies.iter().enumerate() {
        match h {
            Some(_) => index.push(k),
            None => reasons[k] = Some(LeftOut::NoPose),
        }
    }
    let views: Vec<&Seen> = index.iter().map(|k| &seen[*k]).collect();
    if views.len() < options.fewest_boards {
        return Err(FreeError::TooFewBoards {
            found: views.len(),
            needed: options.fewest_boards,
        });
    }
    let lens = Lens {
        numbers: options.camera.numbers.map(|k| k.value),
        plate: options.camera.plate,
    };
    let state = start::state(&views, lens, options.camera.imported).ok_or(FreeError::NoCamera {
        source: LmError::NotFinite,
    })?;
    Ok(Work {
        terms: adjust::terms(&views),
        views,
        index,
        state,
    })
}

/// Camera and poses from nodes alone; views that do not fit are left out.
fn cameras(
    work: &mut Work<'_>,
    options: &FreeOptions,
    reasons: &mut [Option<LeftOut>],
) -> Result<State, FreeError> {
    let no_camera = |source| FreeError::NoCamera { source };
    let prior = adjust::priors(&options.camera, 1.0);
    let full = adjust::fullest(&options.camera, false);
    if !options.camera.imported {
        checks::parallel(&work.state)?;
    }
    // Perspective and k₁ first: from far away a free lens turns to what is no lens.
    let simple = adjust::lens_models(&options.camera, false)[0];
    let first = adjust::settle(&work.state, &mut work.terms, &prior, simple);
    if let Ok(solved) = &first {
        work.state = solved.state.clone();
    }
    for round in 0..6 {
        let solved =
            adjust::settle(&work.state, &mut work.terms, &prior, full).map_err(no_camera)?;
        work.state = solved.state;
        if round == 0 {
            if !options.camera.imported {
                checks::parallel(&work.state)?;
            }
            let names: Vec<&str> = work.views.iter().map(|v| v.name.as_str()).collect();
            checks::zoom(&work.state, &work.terms, &names)?;
        }
        let mut gone: Vec<(usize, LeftOut)> = misfits(work, options);
        if gone.is_empty() && round < 5 {
            gone = (checks::sheared(&work.state, &work.terms).into_iter())
                .map(|(k, shear_px)| (k, LeftOut::Sheared { shear_px }))
                .collect();
        }
        if gone.is_empty() {
            break;
        }
        for (k, why) in &gone {
            reasons[work.index[*k]] = Some(why.clone());
        }
        work.drop(&gone.iter().map(|g| g.0).collect::<Vec<_>>());
        if work.views.len() < options.fewest_boards {
            return Err(FreeError::TooFewBoards {
                found: work.views.len(),
                needed: options.fewest_boards,
            });
        }
    }
    Ok(work.state.clone())
}

/// Less than this is as good as nodes get: no view is left out for it \[px\].
const GOOD_PX: f64 = 0.1;

fn misfits(work: &Work<'_>, options: &FreeOptions) -> Vec<(usize, LeftOut)> {
    let rms: Vec<f64> = (work.terms.iter().zip(&work.state.poses))
        .map(|(view, pose)| residuals::rms(&residuals::nodes_px(&work.state.lens, pose, view)))
        .collect();
    let mut sorted = rms.clone();
    sorted.sort_by(f64::total_cmp);
    let usual_px = sorted[sorted.len() / 2];
    let limit = options.misfit * usual_px.max(GOOD_PX);
    (rms.iter().enumerate())
        .filter(|(_, r)| r.is_nan() || **r > limit)
        .map(|(k, r)| {
            (
                k,
                LeftOut::Misfit {
                    rms_px: *r,
                    usual_px,
                },
            )
        })
        .collect()
}

/// Extent of the line's places across it, as a share of their distance: below it two lines are one.
const ACROSS_SHARE: f64 = 0.02;

/// The plane that most lines lie in.
fn sheets(
    work: &mut Work<'_>,
    options: &FreeOptions,
    reservations: &mut Vec<Reservation>,
) -> Result<LaserSurface, FreeError> {
    let points = start::line_points(&work.state, &work.views);
    let with_line = points.iter().filter(|p| p.len() >= 4).count();
    let first = work
        .views
        .iter()
        .find_map(|v| v.no_line.as_ref().map(|w| format!("{}: {w}", v.name)));
    let boards = work.views.len();
    let few = |found| FreeError::TooFewLines {
        found,
        boards,
        needed: options.fewest_lines,
        first: first.clone(),
    };
    if with_line < options.fewest_lines {
        return Err(few(with_line));
    }
    let far_m = median_far_m(work);
    let one = |across: f64| FreeError::OneDistance {
        across_mm: 1e3 * across,
        far_m,
    };
    let sheet = start::plane(&points).ok_or(one(0.0))?;
    let middle = |line: &Vec<Vector3<f64>>| {
        let mean = line.iter().sum::<Vector3<f64>>() / line.len() as f64;
        (mean - Vector3::from(sheet.origin_m)).dot(&Vector3::from(sheet.axes[1]))
    };
    let places = points.iter().filter(|p| p.len() >= 4).map(middle);
    let (low, high) = places.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), s| {
        (a.min(s), b.max(s))
    });
    // Lines that cross each other span the sheet from one place.
    let directions: Vec<Vector3<f64>> = (points.iter())
        .filter_map(|l| (l.last()? - l.first()?).try_normalize(1e-6))
        .collect();
    let turn = directions
        .iter()
        .map(|d| d.dot(&Vector3::from(sheet.axes[1])).abs())
        .fold(0.0, f64::max);
    if high - low < ACROSS_SHARE * far_m && turn < 0.2 {
        return Err(one(high - low));
    }
    drop_lines(work, &sheet, reservations);
    let left = work.terms.iter().filter(|v| v.line.len() >= 4).count();
    if left < options.fewest_lines {
        return Err(few(left));
    }
    Ok(sheet)
}

/// A line further off than so many times what lines are off is another line.
const LINE_TIMES: f64 = 6.0;
/// Less than this is no other line: a curved board does it \[px\].
const LINE_PX: f64 = 1.0;

/// Leaves out lines that are off the sheet as a whole.
fn drop_lines(
    work: &mut Work<'_>,
    sheet: &LaserSurface,
    reservations: &mut Vec<Reservation>,
) -> bool {
    let state = State {
        sheet: Some(*sheet),
        ..work.state.clone()
    };
    let off: Vec<f64> = (work.terms.iter().zip(&state.poses))
        .map(|(view, pose)| {
            let line = residuals::line(&state, pose, view);
            let sum: f64 = line.iter().map(|(_, px)| px * px).sum();
            (sum / line.len().max(1) as f64).sqrt()
        })
        .collect();
    let usual = adjust::scale(off.iter().copied().filter(|o| *o > 0.0).collect(), 1.0);
    let mut dropped = false;
    for (k, off_px) in off.into_iter().enumerate() {
        if off_px > LINE_PX && off_px > LINE_TIMES * usual {
            work.terms[k].line.clear();
            reservations.push(Reservation::LineOff {
                name: work.views[k].name.clone(),
                off_px,
            });
            dropped = true;
        }
    }
    dropped
}

/// Once more without the lines that the common fit shows to be others.
fn line_misfits(
    work: &mut Work<'_>,
    solved: Solved,
    options: &FreeOptions,
    reservations: &mut Vec<Reservation>,
    prior: &[Known; SHARED],
    full: Free,
) -> Result<Solved, LmError> {
    let mut solved = solved;
    for _ in 0..3 {
        work.state = solved.state.clone();
        let Some(sheet) = work.state.sheet else { break };
        let lines = work.terms.iter().filter(|v| !v.line.is_empty()).count();
        if lines <= options.fewest_lines || !drop_lines(work, &sheet, reservations) {
            break;
        }
        solved = adjust::settle(&work.state, &mut work.terms, prior, full)?;
    }
    Ok(solved)
}

fn median_far_m(work: &Work<'_>) -> f64 {
    adjust::scale(
        work.state
            .poses
            .iter()
            .map(|p| p.translation.norm())
            .collect(),
        1.0,
    )
}

/// Sds of nodes and line brought to what they scatter by under the fullest model, neighbours that are alike counted as
/// fewer; by which factors.
fn rescale(work: &mut Work<'_>, full: &Solved) -> [f64; 2] {
    let sizes = adjust::sizes(&work.terms, &full.residuals, true);
    let shared = SHARED as f64;
    let (mut nodes, mut count, mut runs) = (0.0, -shared, Vec::new());
    for (view, (of_nodes, _)) in work.terms.iter().zip(&sizes) {
        let weighted: Vec<Vector2<f64>> = (view.nodes.iter().zip(of_nodes))
            .map(|(n, r)| Vector2::from(*r) * n.weight)
            .collect();
        nodes += weighted.iter().map(Vector2::norm_squared).sum::<f64>();
        count += 2.0 * view.nodes.len() as f64 - 6.0;
        runs.extend(residuals::runs(view, &weighted));
    }
    let node_scale = (nodes / count.max(1.0) * residuals::alike(&runs))
        .sqrt()
        .max(1.0);
    // A board that is curved, or an edge that fools the line, shifts all of a board's line: its mean and its slope scatter
    // by more than the pieces do.
    let (mut pieces, mut n, mut boards, mut groups) = (0.0, -5.0, 0.0, -3.0);
    for (view, (_, line)) in work.terms.iter().zip(&sizes) {
        let r: Vec<f64> = view
            .line
            .iter()
            .zip(line)
            .map(|(l, r)| r * l.weight)
            .collect();
        if r.len() < 3 {
            continue;
        }
        pieces += r.iter().map(|r| r * r).sum::<f64>();
        n += r.len() as f64;
        let len = r.len() as f64;
        let mean = r.iter().sum::<f64>() / len;
        let x = |k: usize| k as f64 - 0.5 * (len - 1.0);
        let (xx, xr) = r
            .iter()
            .enumerate()
            .fold((0.0, 0.0), |(a, b), (k, r)| (a + x(k) * x(k), b + x(k) * r));
        boards += mean * mean * len + xr * xr / xx;
        groups += 2.0;
    }
    let line_scale = (pieces / f64::max(n, 1.0))
        .max(boards / f64::max(groups, 1.0))
        .sqrt()
        .max(1.0);
    for view in &mut work.terms {
        view.nodes.iter_mut().for_each(|n| n.whitener /= node_scale);
        view.line.iter_mut().for_each(|l| l.sd_px *= line_scale);
    }
    [node_scale, line_scale]
}

/// Lenses under a plane, then cones under the likeliest lens, each at its minimum.
fn models(
    work: &Work<'_>,
    full: &State,
    options: &FreeOptions,
    prior: &[Known; SHARED],
) -> Vec<(Free, Solved)> {
    let mut solved: Vec<(Free, Solved)> = Vec::new();
    let fit = |free: Free, from: &State| {
        adjust::solve(from, &work.terms, prior, free)
            .ok()
            .map(|s| (free, s))
    };
    for free in adjust::lens_models(&options.camera, true) {
        solved.extend(fit(free, full));
    }
    let best = (solved.iter())
        .max_by(|a, b| a.1.ln_evidence.total_cmp(&b.1.ln_evidence))
        .map_or(adjust::fullest(&options.camera, true), |m| m.0);
    let mut cone = best;
    for k in [CONE, CONE + 1] {
        cone[CAMERA + k] = true;
        solved.extend(fit(cone, full));
    }
    solved
}

/// Names of the optional terms.
const TERMS: [(usize, &str); 8] = [
    (super::camera::ASPECT, "pixel aspect"),
    (super::camera::LENS, "k1"),
    (super::camera::LENS + 1, "k2"),
    (super::camera::LENS + 2, "p1 p2"),
    (super::camera::LENS + 4, "k3"),
    (super::camera::PORT, "port"),
    (CAMERA + CONE, "cone"),
    (CAMERA + CONE + 1, "cone's growth"),
];

#[allow(clippy::too_many_arguments)]
fn finish(
    seen: &[Seen],
    options: &FreeOptions,
    work: &Work<'_>,
    (state, covariance, free): (State, DMatrix<f64>, Free),
    noise_scale: [f64; 2],
    reasons: Vec<Option<LeftOut>>,
    mut reservations: Vec<Reservation>,
    prior: &[Known; SHARED],
) -> Result<Fitted, FreeError> {
    let sheet = state.sheet.ok_or(FreeError::NoCamera {
        source: LmError::NotFinite,
    })?;
    let mut met = Vec::new();
    let mut views: Vec<ViewReport> = Vec::with_capacity(seen.len());
    let (mut nodes, mut lines) = (Vec::new(), Vec::new());
    for ((k, view), why) in seen.iter().enumerate().zip(&reasons) {
        let at = work.index.iter().position(|i| *i == k);
        let mut report = ViewReport {
            name: view.name.clone(),
            nodes: Vec::new(),
            rms_px: f64::NAN,
            line: Vec::new(),
            far_m: f64::NAN,
            tilt_rad: f64::NAN,
            left_out: why.clone(),
        };
        if let Some(at) = at {
            let (pose, terms) = (&work.state.poses[at], &work.terms[at]);
            let off = residuals::nodes_px(&work.state.lens, pose, terms);
            report.rms_px = residuals::rms(&off);
            report.nodes = view
                .nodes
                .iter()
                .zip(&off)
                .map(|(n, e)| [n.pixel, (*e).into()])
                .collect();
            let line = residuals::line(&work.state, pose, terms);
            report.line = (terms.line.iter().zip(&line))
                .map(|(l, r)| (l.pixel.into(), r.0, r.1))
                .collect();
            report.far_m = pose.translation.norm();
            report.tilt_rad = pose.rotation[(2, 2)].abs().min(1.0).acos();
            nodes.extend(off);
            lines.extend(line);
            met.extend(terms.line.iter().filter_map(|l| {
                let (from, along) = state.lens.ray(&l.pixel)?;
                sheet.meet(&from, &along)
            }));
        }
        views.push(report);
    }
    let focal_sd = covariance[(FOCAL, FOCAL)].sqrt() / state.lens.numbers[FOCAL];
    let angle_deg = checks::widest_angle_rad(&work.state).to_degrees();
    if focal_sd > 0.01 {
        reservations.push(Reservation::FewTilts {
            angle_deg,
            focal_sd,
        });
    }
    let sheared: Vec<f64> = (reasons.iter().flatten())
        .filter_map(|r| match r {
            LeftOut::Sheared { shear_px } => Some(*shear_px),
            _ => None,
        })
        .collect();
    if !sheared.is_empty() {
        reservations.push(Reservation::RollingShutter {
            sheared: sheared.len(),
            boards: seen.len(),
            shear_px: sheared.iter().copied().fold(0.0, f64::max),
        });
    }
    let square = |f: fn(&(f64, f64)) -> f64| -> f64 {
        (lines.iter().map(|l| f(l).powi(2)).sum::<f64>() / lines.len().max(1) as f64).sqrt()
    };
    let (line_m, line_px) = (square(|l| l.0), square(|l| l.1));
    Ok(Fitted {
        map: SheetMap::new(state.lens, sheet, covariance, &met),
        views,
        rms_px: residuals::rms(&nodes),
        line_px,
        line_m,
        noise_scale,
        terms: TERMS.iter().filter(|t| free[t.0]).map(|t| t.1).collect(),
        held: held(work, options, prior, free),
        reservations,
    })
}

/// Every so many boards predicted from a fit without them.
fn held(
    work: &Work<'_>,
    options: &FreeOptions,
    prior: &[Known; SHARED],
    free: Free,
) -> Option<Held> {
    let every = options.hold_out_every;
    let n = work.views.len();
    let out: Vec<usize> = (0..n)
        .filter(|k| every > 0 && k % every == every - 1)
        .collect();
    let with_line = |k: &usize| work.terms[*k].line.len() >= 4;
    let rest: Vec<usize> = (0..n).filter(|k| !out.contains(k)).collect();
    if out.is_empty()
        || rest.len() < options.fewest_boards
        || rest.iter().filter(|k| with_line(k)).count() < options.fewest_lines
    {
        return None;
    }
    let pick = |some: &[usize]| -> Vec<ViewTerms> {
        some.iter().map(|k| work.terms[*k].clone()).collect()
    };
    let mut start = work.state.clone();
    start.poses = rest.iter().map(|k| work.state.poses[*k]).collect();
    let fitted = adjust::solve(&start, &pick(&rest), prior, free).ok()?;
    // Their poses by every other node, the camera held.
    let mut halves = pick(&out);
    for view in &mut halves {
        let mut k = 0;
        view.nodes.retain(|_| {
            k += 1;
            k % 2 == 0
        });
        view.line.clear();
    }
    let mut posed = State {
        sheet: None,
        ..fitted.state.clone()
    };
    posed.poses = out.iter().map(|k| work.state.poses[*k]).collect();
    let mut fixed = *prior;
    (0..CAMERA).for_each(|k| fixed[k].value = fitted.state.lens.numbers[k]);
    let posed = adjust::solve(&posed, &halves, &fixed, [false; SHARED]).ok()?;
    let state = State {
        sheet: fitted.state.sheet,
        ..posed.state
    };
    let (mut nodes, mut lines) = (Vec::new(), Vec::new());
    for (k, pose) in out.iter().zip(&state.poses) {
        let off = residuals::nodes_px(&state.lens, pose, &work.terms[*k]);
        nodes.extend(off.into_iter().step_by(2));
        lines.extend(residuals::line(&state, pose, &work.terms[*k]));
    }
    let square = |f: fn(&(f64, f64)) -> f64| -> f64 {
        (lines.iter().map(|l| f(l).powi(2)).sum::<f64>() / lines.len().max(1) as f64).sqrt()
    };
    Some(Held {
        boards: out.len(),
        rms_px: residuals::rms(&nodes),
        line_m: square(|l| l.0),
        line_px: square(|l| l.1),
    })
}
