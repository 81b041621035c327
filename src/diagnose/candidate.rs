//! Candidates: every effect of the registry that a measured motion can show, with points to start from.
//!
//! Nothing here knows an effect: stage, parameters, plausible range and words come from its info.

use std::f64::consts::TAU;

use hydroline_rigs::Dof;
use hydroline_sim::effect::{ALL, CheckedEffect, EffectInfo, ParameterInfo};

use super::fit::is_phase;
use hydroline_inference::prior::nothing;
use hydroline_inference::term::{by_ratio, in_images_only, point, radical};

/// An effect that may have been left out.
#[derive(Debug, Clone, PartialEq)]
pub struct Candidate {
    /// The effect.
    pub info: &'static EffectInfo,
    /// Index per word; `dof` words stand on the DOF diagnosed.
    pub words: Vec<usize>,
    /// Points to start from, each one number per parameter.
    pub starts: Vec<Vec<f64>>,
    /// Bounds of a fit per parameter: the plausible range and twice its width beyond, within the limits.
    pub bounds: Vec<(f64, f64)>,
    /// Width of the prior per parameter.
    pub widths: Vec<f64>,
    /// Range in which the prior is flat per parameter: the plausible one and "not there". A point where it is normal.
    pub flat: Vec<(f64, f64)>,
    /// How large it is, by its first parameter.
    pub size: Option<Size>,
}

/// Every effect that is not already switched on and that a measured pose can show.
pub fn vocabulary(dof: Dof, on: &[CheckedEffect]) -> Vec<Candidate> {
    ALL.iter()
        .filter(|info| !in_images_only(info) && !info.is_written())
        .filter_map(|info| Candidate::new(info, dof))
        .filter(|c| {
            !on.iter()
                .any(|o| o.info.id == c.info.id && o.words == c.words)
        })
        .collect()
}

impl Candidate {
    fn new(info: &'static EffectInfo, dof: Dof) -> Option<Candidate> {
        if info.parameters.is_empty() {
            return None;
        }
        let words = info
            .words
            .iter()
            .map(|w| {
                let named = |name: &str| w.allowed.iter().position(|a| *a == name);
                let own = if w.name == "dof" {
                    named(dof.name())
                } else {
                    None
                };
                own.or_else(|| w.absent.and_then(named)).unwrap_or(0)
            })
            .collect();
        let bound = |p: &ParameterInfo| {
            let span = p.plausible.1 - p.plausible.0;
            (
                (p.plausible.0 - 2.0 * span).max(p.limits.0),
                (p.plausible.1 + 2.0 * span).min(p.limits.1),
            )
        };
        Some(Candidate {
            info,
            words,
            starts: starts(info),
            bounds: info.parameters.iter().map(bound).collect(),
            widths: info.parameters.iter().enumerate().map(width).collect(),
            flat: info
                .parameters
                .iter()
                .enumerate()
                .map(|(i, p)| mostly(i, p).map_or_else(|| flat(p), |v| (v, v)))
                .collect(),
            size: info.parameters.first().and_then(Size::of),
        })
    }
}

impl Candidate {
    /// sd of a parameter's prior where that is normal, about the value that a rig file need not give.
    pub fn normal_sd(&self, i: usize) -> Option<f64> {
        let (low, high) = self.flat[i];
        (low == high).then(|| self.widths[i] / TAU.sqrt())
    }
}

/// What the first parameter says about how large an effect is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Size {
    /// Its value where the effect is not there.
    pub nothing: f64,
    /// How far from there the largest is that a tank run may show.
    pub largest: f64,
}

impl Size {
    /// `None` where the parameter is a limit: what that does depends on what it limits.
    fn of(p: &ParameterInfo) -> Option<Size> {
        let (low, high) = flat(p);
        let nothing = nothing(p);
        (!p.bounds_load).then(|| Size {
            nothing,
            largest: (high - nothing).max(nothing - low).max(1e-12),
        })
    }

    /// Log of the prior density over that of a flat one at a value known to `sd`. Sizes are spread
    /// over decades (physics.md: every effect is there at once, most of them small), so the density
    /// falls as one over the share of the largest size, and is flat below [`LEAST_SHARE`] of it.
    pub fn log_prior(&self, value: f64, sd: f64) -> f64 {
        let share = (value - self.nothing).abs() / self.largest;
        let floor = LEAST_SHARE.max((sd / self.largest).min(1.0));
        -((share + floor) * (1.0 / LEAST_SHARE).ln_1p()).ln()
    }
}

/// Share of the largest size below which all sizes are alike.
const LEAST_SHARE: f64 = 0.02;

/// Where a limit on the load begins, over the largest load.
const LIMITS: [f64; 6] = [0.97, 0.88, 0.76, 0.64, 0.52, 0.4];

/// A limit on the load only does something below the largest load commanded: that one is where the
/// effect is not there, and half of it is as small as the limit of a thruster that passed for sound.
pub fn limit(vocabulary: &mut [Candidate], largest_load: f64) {
    if largest_load <= 0.0 {
        return;
    }
    for candidate in vocabulary {
        if candidate
            .info
            .parameters
            .first()
            .is_some_and(|p| p.bounds_load)
        {
            let width = 0.5 * largest_load;
            candidate.flat[0].0 = candidate.flat[0].0.min(width);
            candidate.flat[0].1 = candidate.flat[0].1.max(largest_load);
            candidate.widths[0] = width;
            // Between loads a limit clips other steps of the command, and no fit finds from one of these
            // stretches into the next: begin in all of them.
            let plain = candidate.starts[0].clone();
            candidate.starts = LIMITS
                .iter()
                .map(|share| {
                    let (low, high) = candidate.bounds[0];
                    let mut start = plain.clone();
                    start[0] = (share * largest_load).clamp(low, high);
                    start
                })
                .collect();
            candidate.size = Some(Size {
                nothing: largest_load,
                largest: width,
            });
        }
    }
}

/// The plausible range down to where the effect is not there.
fn flat(p: &ParameterInfo) -> (f64, f64) {
    let nothing = nothing(p);
    (p.plausible.0.min(nothing), p.plausible.1.max(nothing))
}

/// The value that a parameter beside the first mostly has: the one of which a rig file says nothing. The runs of one DOF
/// hardly show it (a current across the heading), and a flat prior leaves it anywhere.
fn mostly(i: usize, p: &ParameterInfo) -> Option<f64> {
    p.absent.filter(|_| i > 0 && !is_phase(p))
}

/// Width of the prior: of a normal one that of the flat one as high, whose sd is that of the plausible range.
fn width((i, p): (usize, &ParameterInfo)) -> f64 {
    let (low, high) = flat(p);
    let flat = (high - low).max(1e-12);
    mostly(i, p).map_or(flat, |_| flat * (TAU / 12.0).sqrt())
}

/// The share of the plausible range at which a value lies, as [`point`] has it.
pub fn share(p: &ParameterInfo, value: f64) -> f64 {
    let (low, high) = p.plausible;
    if by_ratio(p.plausible) {
        (value.max(1e-12) / low).ln() / (high / low).ln()
    } else {
        (value - low) / (high - low).max(1e-300)
    }
}

fn starts(info: &EffectInfo) -> Vec<Vec<f64>> {
    const BASES: [usize; 5] = [2, 3, 5, 7, 11];
    let typical: Vec<f64> = info.parameters.iter().map(|p| p.typical).collect();
    let mut points = vec![typical];
    // Two ends and the middle of a line, more the more corners there are.
    let count = match info.parameters.len() {
        1 => {
            points.extend([0.05, 0.95, 0.3, 0.7].map(|s| vec![point(&info.parameters[0], s)]));
            return points;
        }
        2 => 12,
        _ => 48,
    };
    for k in 1..=count {
        points.push(
            info.parameters
                .iter()
                .enumerate()
                .map(|(i, p)| point(p, radical(k, BASES[i % BASES.len()])))
                .collect(),
        );
    }
    points
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn most_sizes_are_small_and_a_limit_is_nothing_at_the_largest_load() {
        let mut all = vocabulary(Dof::Surge, &[]);
        limit(&mut all, 8.0);
        let size = |id: &str| all.iter().find(|c| c.info.id == id).unwrap().size.unwrap();
        let gain = size("thrust_asymmetry");
        assert_eq!(gain.nothing, 1.0);
        assert!(gain.log_prior(0.99, 0.0) > gain.log_prior(0.8, 0.0) + 1.0);
        // A size that nobody knows gains nothing from being small.
        assert!(gain.log_prior(0.99, 1.0) < 0.0);
        assert_eq!(size("thruster_saturation").nothing, 8.0);
        // The density is one over the range.
        let bias = size("constant_force");
        let total: f64 = (0..10_000)
            .map(|k| {
                bias.log_prior(bias.largest * (f64::from(k) + 0.5) / 1e4, 0.0)
                    .exp()
                    / 1e4
            })
            .sum();
        assert!((total - 1.0).abs() < 0.01, "{total}");
    }

    /// A current across the heading came out at an end of its range, sure to a third of it, where no run showed it.
    #[test]
    fn what_a_rig_file_need_not_say_is_mostly_not_there() {
        let all = vocabulary(Dof::Surge, &[]);
        let current = all.iter().find(|c| c.info.id == "current").unwrap();
        assert_eq!(current.normal_sd(0), None);
        assert_eq!(current.flat[1], (0.0, 0.0));
        let sd = current.normal_sd(1).unwrap();
        assert!((sd - 0.04 / 12.0_f64.sqrt()).abs() < 1e-12, "{sd}");
        // A phase is anywhere on its circle.
        let seiche = all.iter().find(|c| c.info.id == "seiche").unwrap();
        assert!((0..3).all(|i| seiche.normal_sd(i).is_none()));
    }

    #[test]
    fn every_start_is_plausible_and_every_effect_of_the_registry_that_moves_a_pose_is_asked() {
        let all = vocabulary(Dof::Roll, &[]);
        let left_out: Vec<&str> = ALL
            .iter()
            .filter(|i| !all.iter().any(|c| c.info.id == i.id))
            .map(|i| i.id)
            .collect();
        // The first has no parameter to find, the next two are what data wrote, the others show in images alone.
        assert_eq!(
            left_out,
            [
                "added_mass_coupling",
                "free_force",
                "written_force",
                "refraction",
                "lens_distortion",
                "camera_shift",
                "laser_plane_tilt",
                "laser_cone",
                "board_offset",
                "target_scale",
                "floor_slope",
                "backscatter_haze",
                "image_saturation",
                "speckle",
                "attenuation",
                "line_profile",
                "lens_shading",
                "ambient_gradient",
                "mains_banding",
                "tone_curve",
                "range_clipping"
            ]
        );
        for c in &all {
            for start in &c.starts {
                for ((v, p), (low, high)) in start.iter().zip(c.info.parameters).zip(&c.bounds) {
                    assert!((*low..=*high).contains(v), "{} {} = {v}", c.info.id, p.name);
                }
            }
            for (w, i) in c.info.words.iter().zip(&c.words) {
                assert!(
                    w.name != "dof" || w.allowed[*i] == "roll" || !w.allowed.contains(&"roll"),
                    "{}",
                    c.info.id
                );
            }
        }
    }
}
