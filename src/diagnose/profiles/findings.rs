//! What the profiles say, as part of the verdict.

use super::candidate::{Base, Candidate, vocabulary};
use super::fit::{Fitted, Free, Problem, State};
use super::haze::{Haze, skirt};
use super::model::Kind;
use super::observe::{self, ImageRun};
use super::picture;
use super::prior::Motion;
use super::search::{ANY_PX, ASTRAY_PX, Searched, search, visibility};
use crate::diagnose::Diagnosis;
use crate::diagnose::verdict::{
    Alternative, BeforeAfter, Effect, FitTable, Law, Test, Value, Verdict, Where, Word,
};
use crate::identify::data::LoadError;
use hydroline_rigs::{Dof, ParameterValue, PhysicsEntry, Rig};
use hydroline_sim::SimError;
use hydroline_sim::effect::{EffectError, EffectInfo, find};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Frames looked at in all.
pub const FRAMES: usize = 52;
/// Fewest frames that say anything.
const LEAST_FRAMES: usize = 5;
/// Channels of a pose.
const CHANNELS: [&str; 6] = ["x_m", "y_m", "z_m", "phi_rad", "theta_rad", "psi_rad"];
/// Mean residual of a part of the image that no explanation takes away \[px\], and in its own sds.
const UNEXPLAINED_PX: f64 = 0.08;
const UNEXPLAINED_SDS: f64 = 6.0;
/// What a typical size of an effect must at least be worth, or these frames cannot show it.
const BLIND: f64 = 3.0;

/// Share by which haze must pull otherwise than was allowed for, and all is fitted anew.
const PULL_SHARE: f64 = 0.3;

/// Why there is no finding.
#[derive(Debug, thiserror::Error)]
pub enum ImageError {
    /// A log.
    #[error(transparent)]
    Load(#[from] LoadError),
    /// The rig's motion.
    #[error("image level: {0}")]
    Sim(#[from] SimError),
    /// The rig's `[[physics]]`.
    #[error("image level: {0}")]
    Effect(#[from] EffectError),
    /// Too few frames.
    #[error(
        "image level: {found} of {frames} frames show a stripe, at least {LEAST_FRAMES} are needed: is the laser on, is it the rig's camera?"
    )]
    Few {
        /// With a stripe.
        found: usize,
        /// In the logs.
        frames: usize,
    },
    /// No pose.
    #[error(
        "image level: no frame lies on the rig's floor and target, whatever effect is assumed: is it the rig's target?"
    )]
    NoPose,
}

/// What the profiles say.
#[derive(Debug, Clone)]
pub struct Findings {
    /// One word.
    pub word: Word,
    /// Heaviest first.
    pub effects: Vec<Effect>,
    /// Complete sets that the frames cannot tell apart; empty where one stands out.
    pub equivalent: Vec<Vec<String>>,
    /// Entries for the rig file.
    pub entries: Vec<PhysicsEntry>,
    /// Log odds of the best explanation over nothing.
    pub log_odds: f64,
    /// log posterior without effects \[nat\].
    pub score_of_nothing: f64,
    /// Rows by which haze was allowed to pull the stripe \[px\].
    pub pull_px: f64,
    /// Fit and prediction \[px\].
    pub fit: FitTable,
    /// Other explanations.
    pub alternatives: Vec<Alternative>,
    /// Effects of typical size that these frames would not show.
    pub blind_spots: Vec<String>,
    /// Largest mean residual of a part of the image, before and after \[px\], and where it is.
    pub worst_px: [f64; 2],
    /// Part of the image in words.
    pub part: String,
    /// Poses per run with the effects: (t, pose).
    pub poses: Vec<Vec<(f64, [f64; 6])>>,
    /// The light beside the stripe.
    pub haze: Option<Haze>,
    /// Pictures for the report.
    pub html: String,
    /// Remarks.
    pub notes: Vec<String>,
    /// Sets of effects looked at.
    pub sets_looked_at: usize,
}

/// Reads the logs that hold frames and says what they show; `None` where none does.
///
/// # Errors
/// [`ImageError`].
pub fn level(
    logs: &[PathBuf],
    rig: &Rig,
    progress: &(dyn Fn(&str) + Sync),
) -> Result<Option<Findings>, ImageError> {
    let mut with = Vec::new();
    for path in logs {
        if observe::has_images(path)? {
            with.push(path);
        }
    }
    if with.is_empty() {
        return Ok(None);
    }
    let most = FRAMES.div_ceil(with.len()).max(LEAST_FRAMES);
    let mut runs = Vec::new();
    for path in with {
        progress(&path.display().to_string());
        runs.push(observe::read(path, rig, most)?);
    }
    explain(&runs, rig, progress).map(Some)
}

/// The same for frames in memory.
///
/// # Errors
/// [`ImageError`].
pub fn explain(
    runs: &[ImageRun],
    rig: &Rig,
    progress: &(dyn Fn(&str) + Sync),
) -> Result<Findings, ImageError> {
    let runs = moving(runs);
    let frames: usize = runs.iter().map(|r| r.frames.len()).sum();
    if frames < LEAST_FRAMES {
        let all = runs.iter().map(|r| r.in_log).sum();
        return Err(ImageError::Few {
            found: frames,
            frames: all,
        });
    }
    let base = Base::new(rig)?;
    let candidates = vocabulary(&base);
    let mut problem = problem(&runs, rig, base)?;
    let beside = |problem: &Problem<'_>, fit: &Fitted| {
        skirt(problem, &candidates, fit).and_then(|s| s.haze(rig.laser.sigma_m))
    };
    let pull = |haze: Option<&Haze>| haze.filter(|h| h.found).map_or(0.0, |h| h.pull_px.abs());
    // Haze pulls rows and broadens the line. Its light is seen wherever about the stripe lies, so it
    // is measured first: geometry found without it would have to be found all over again.
    progress("light beside the stripe");
    let rough = problem
        .placed(&[], Vec::new(), false)
        .and_then(|s| problem.glance(&candidates, &[], s));
    problem.pull_px = pull(rough.and_then(|f| beside(&problem, &f)).as_ref());
    let mut found = search(&problem, &candidates, progress).ok_or(ImageError::NoPose)?;
    let mut haze = beside(&problem, found.best());
    let (now_px, was_px) = (pull(haze.as_ref()), problem.pull_px);
    let other = (now_px - was_px).abs() > PULL_SHARE * now_px.max(was_px);
    if other && (now_px < was_px || !found.best().effects.is_empty()) {
        problem.pull_px = now_px;
        found = search(&problem, &candidates, progress).ok_or(ImageError::NoPose)?;
        haze = beside(&problem, found.best());
    }
    let best = found.best();
    let tied = found.tied();
    let mut effects: Vec<Effect> = best
        .effects
        .iter()
        .enumerate()
        .map(|(k, e)| Effect {
            or: instead(&candidates, best, &tied, *e),
            ..effect(&problem, &candidates, &found, best, k, *e)
        })
        .collect();
    let mut entries: Vec<PhysicsEntry> = best
        .effects
        .iter()
        .zip(&best.state.numbers)
        .map(|(e, n)| entry(candidates[*e].info, n))
        .collect();
    if let Some((info, own)) = haze.as_ref().and_then(|h| hazy(&problem, best, h)) {
        effects.push(own);
        if let Some(h) = &haze {
            entries.push(entry(info, &[h.fraction, h.length_m]));
        }
    }
    effects.sort_by(|a, b| heaviness(b, rig).total_cmp(&heaviness(a, rig)));
    let matters = |f: &Fitted| -> Vec<String> {
        f.effects
            .iter()
            .map(|e| candidates[*e].info.id.to_owned())
            .collect()
    };
    let important = effects.iter().any(|e| e.matters);
    let haze_ids: Vec<String> = effects
        .iter()
        .filter(|e| {
            e.matters
                && !best
                    .effects
                    .iter()
                    .any(|k| candidates[*k].info.id == e.effect)
        })
        .map(|e| e.effect.clone())
        .collect();
    let equivalent = if tied.len() > 1 && important {
        tied.iter()
            .take(6)
            .map(|f| matters(f).into_iter().chain(haze_ids.clone()).collect())
            .collect()
    } else {
        Vec::new()
    };
    let (worst, part) = worst(&found.nothing, best, rig);
    let unexplained = worst[1].0 > UNEXPLAINED_PX && worst[1].1 > UNEXPLAINED_SDS;
    let word = if unexplained {
        Word::Unknown
    } else if !important {
        Word::None
    } else if equivalent.is_empty() {
        Word::Named
    } else {
        Word::Ambiguous
    };
    let mut notes = vec![format!(
        "image level: {frames} frames of {} run(s)",
        runs.len()
    )];
    if unexplained {
        notes.push(format!(
            "no effect of the vocabulary takes away {:.2} px about {part}",
            worst[1].0
        ));
    }
    let blind_spots = found
        .all
        .iter()
        .filter(|f| f.effects.len() == 1)
        .filter(|f| visibility(&candidates[f.effects[0]], f) < BLIND)
        .map(|f| candidates[f.effects[0]].info.id.to_owned())
        .collect();
    progress("frames held out");
    let fit = FitTable {
        train: BeforeAfter {
            before: rms(&found.nothing),
            after: rms(best),
            noise: noise(best),
        },
        held_out: held_out(&runs, rig, &candidates, &found)?,
        held_out_by: "every other frame, its pose alone fitted".to_owned(),
        held_out_written: BTreeMap::new(),
    };
    let html = picture::section(rig, &found.nothing, best, &effects);
    let zero = Searched::score(&found.nothing);
    let top = Searched::score(best);
    Ok(Findings {
        word,
        equivalent,
        entries,
        log_odds: top - zero,
        score_of_nothing: zero,
        pull_px: problem.pull_px,
        fit,
        alternatives: found
            .all
            .iter()
            .take(8)
            .map(|f| Alternative {
                effects: matters(f),
                log_evidence: Searched::score(f) - top,
                probability: found
                    .all
                    .iter()
                    .map(|o| (Searched::score(o) - Searched::score(f)).exp())
                    .sum::<f64>()
                    .recip(),
                train: BTreeMap::new(),
                held_out: BTreeMap::new(),
            })
            .collect(),
        blind_spots,
        worst_px: [worst[0].0, worst[1].0],
        part,
        poses: runs
            .iter()
            .zip(&best.state.poses)
            .map(|(r, p)| r.frames.iter().zip(p).map(|(f, p)| (f.t_s, *p)).collect())
            .collect(),
        haze,
        html,
        notes,
        sets_looked_at: found.all.len(),
        effects,
    })
}

/// Runs of more than one frame: one alone has no motion.
pub(super) fn moving(runs: &[ImageRun]) -> Vec<ImageRun> {
    runs.iter()
        .filter(|r| r.frames.len() > 1)
        .cloned()
        .collect()
}

pub(super) fn problem<'a>(
    runs: &'a [ImageRun],
    rig: &'a Rig,
    base: Base,
) -> Result<Problem<'a>, ImageError> {
    let motions: Result<Vec<Motion>, SimError> = runs.iter().map(|r| Motion::new(r, rig)).collect();
    Ok(Problem::new(rig, base, runs, motions?))
}

/// Effects that do as well in the place of the best's effect `e`, all others as they are.
fn instead(candidates: &[Candidate], best: &Fitted, tied: &[&Fitted], e: usize) -> Vec<String> {
    let rest = || best.effects.iter().filter(|o| **o != e);
    tied.iter()
        .filter(|t| t.effects.len() == best.effects.len() && !t.effects.contains(&e))
        .filter(|t| rest().all(|r| t.effects.contains(r)))
        .filter_map(|t| t.effects.iter().find(|o| !best.effects.contains(o)))
        .map(|o| candidates[*o].info.id.to_owned())
        .collect()
}

/// What matters most about an effect: its heaviest channel in units of the tolerance.
fn heaviness(e: &Effect, rig: &Rig) -> f64 {
    e.weight
        .iter()
        .map(|(c, w)| w / tolerance(c, rig))
        .fold(0.0, f64::max)
}

fn tolerance(channel: &str, rig: &Rig) -> f64 {
    if channel.ends_with("_rad") {
        rig.tolerance.attitude_rad
    } else {
        rig.tolerance.position_m
    }
}

/// rms by which poses differ, per channel.
fn shift(with: &State, without: &State) -> [f64; 6] {
    let pairs = || {
        with.poses
            .iter()
            .flatten()
            .zip(without.poses.iter().flatten())
    };
    let n = pairs().count().max(1) as f64;
    std::array::from_fn(|d| (pairs().map(|(a, b)| (a[d] - b[d]).powi(2)).sum::<f64>() / n).sqrt())
}

/// The best explanation's effect number `k`, candidate `e`.
fn effect(
    problem: &Problem<'_>,
    candidates: &[Candidate],
    found: &Searched,
    best: &Fitted,
    k: usize,
    e: usize,
) -> Effect {
    let rest: Vec<usize> = best.effects.iter().copied().filter(|o| *o != e).collect();
    let without = found
        .all
        .iter()
        .find(|f| f.effects.len() == rest.len() && rest.iter().all(|r| f.effects.contains(r)));
    let moved = match without.filter(|f| f.rms_px(Kind::Row) < ASTRAY_PX) {
        Some(f) => shift(&best.state, &f.state),
        None => {
            // Without it the stripe is so far off that most of it would pass for stray: to begin
            // with, nothing is.
            let mut begin = best.state.clone();
            begin.numbers.remove(k);
            begin.floors = ANY_PX;
            let fit = problem.fit(candidates, &rest, begin, Free::All);
            fit.map_or([f64::NAN; 6], |f| shift(&best.state, &f.state))
        }
    };
    let info = candidates[e].info;
    let numbers = best.state.numbers.get(k).map_or(&[][..], Vec::as_slice);
    let sds = best.sds.get(k).map_or(&[][..], Vec::as_slice);
    described(problem.rig, info, numbers, sds, moved, found.probability(e))
}

fn described(
    rig: &Rig,
    info: &EffectInfo,
    numbers: &[f64],
    sds: &[f64],
    moved: [f64; 6],
    probability: f64,
) -> Effect {
    let weight: BTreeMap<String, f64> = CHANNELS
        .iter()
        .zip(moved)
        .filter(|(_, w)| w.is_finite())
        .map(|(c, w)| ((*c).to_owned(), w))
        .collect();
    let notes = info
        .parameters
        .iter()
        .zip(numbers)
        .filter(|(p, v)| **v < p.plausible.0 || **v > p.plausible.1)
        .map(|(p, v)| {
            format!(
                "{} = {v:.5} lies outside of {} .. {}",
                p.name, p.plausible.0, p.plausible.1
            )
        })
        .collect();
    Effect {
        effect: info.id.to_owned(),
        words: BTreeMap::new(),
        probability,
        matters: weight.iter().any(|(c, w)| *w > tolerance(c, rig)),
        weight,
        law: Law::Exact,
        law_note: None,
        or: Vec::new(),
        parameters: info
            .parameters
            .iter()
            .zip(numbers.iter().zip(sds))
            .map(|(p, (v, s))| {
                (
                    p.name.to_owned(),
                    Value {
                        value: *v,
                        sd: Some(*s).filter(|s| s.is_finite()),
                    },
                )
            })
            .collect(),
        notes,
    }
}

fn entry(info: &EffectInfo, numbers: &[f64]) -> PhysicsEntry {
    PhysicsEntry {
        effect: info.id.to_owned(),
        parameters: info
            .parameters
            .iter()
            .zip(numbers)
            .map(|(p, v)| (p.name.to_owned(), ParameterValue::Number(*v)))
            .collect(),
    }
}

/// The registry's effect for what was found beside the stripe.
const HAZE: &str = "backscatter_haze";

/// Haze as an effect: its weight is what a stripe finder that knows nothing of it makes of z.
fn hazy(
    problem: &Problem<'_>,
    best: &Fitted,
    haze: &Haze,
) -> Option<(&'static EffectInfo, Effect)> {
    let info = find(HAZE).filter(|_| haze.found)?;
    if problem.rig.physics.iter().any(|e| e.effect == HAZE) {
        return None;
    }
    let mut moved = [0.0; 6];
    moved[2] = haze.pull_px.abs() * per_row(problem, best);
    let sds = [haze.fraction_sd, haze.length_sd_m];
    let numbers = [haze.fraction, haze.length_m];
    Some((
        info,
        described(problem.rig, info, &numbers, &sds, moved, 1.0),
    ))
}

/// Metres of z per row of the stripe, in the middle of the first frame.
fn per_row(problem: &Problem<'_>, best: &Fitted) -> f64 {
    let per = || {
        let seen = problem.runs.first()?.frames.first()?;
        let pose = *best.state.poses.first()?.first()?;
        let g = problem.geometry(&[], &[])?;
        let bin = seen.bins.get(seen.bins.len() / 2)?;
        let off = |z: f64, row: f64| {
            let mut p = pose;
            p[2] += z;
            let placed = super::geometry::Placed::from(&hydroline_calib::Pose::from_array(p));
            g.meet(&placed, &g.ray(bin.column_px, row), 0.0)
                .map(|m| m.off_m)
        };
        let here = off(0.0, bin.row_px)?;
        let (by_row, by_z) = (
            off(0.0, bin.row_px + 0.5)? - here,
            (off(1e-4, bin.row_px)? - here) / 1e-4,
        );
        Some((2.0 * by_row / by_z).abs())
    };
    per().unwrap_or(0.001)
}

fn rms(fit: &Fitted) -> BTreeMap<String, f64> {
    [
        ("row_px", Kind::Row),
        ("width_px", Kind::Width),
        ("edge_column_px", Kind::End),
    ]
    .into_iter()
    .map(|(name, kind)| (name.to_owned(), fit.rms_px(kind)))
    .collect()
}

fn noise(fit: &Fitted) -> BTreeMap<String, f64> {
    [
        ("row_px", Kind::Row),
        ("width_px", Kind::Width),
        ("edge_column_px", Kind::End),
    ]
    .into_iter()
    .map(|(name, kind)| {
        let own = fit.left.iter().filter(|l| l.kind == kind);
        let (sum, n) = own.fold((0.0, 0usize), |(s, n), l| (s + l.sd_px.powi(2), n + 1));
        (name.to_owned(), (sum / n.max(1) as f64).sqrt())
    })
    .collect()
}

/// Every other frame predicted by what the rest gives: shared numbers and effects are held, only
/// each frame's own pose is fitted.
fn held_out(
    runs: &[ImageRun],
    rig: &Rig,
    candidates: &[Candidate],
    found: &Searched,
) -> Result<BeforeAfter, ImageError> {
    let part = |odd: usize| -> Vec<ImageRun> {
        runs.iter()
            .map(|r| ImageRun {
                frames: r.frames.iter().skip(odd).step_by(2).cloned().collect(),
                ..r.clone()
            })
            .collect()
    };
    let (even, odd) = (part(0), part(1));
    let (train, test) = (
        problem(&even, rig, Base::new(rig)?)?,
        problem(&odd, rig, Base::new(rig)?)?,
    );
    let half = |state: &State, from: usize| State {
        poses: state
            .poses
            .iter()
            .map(|p| p.iter().skip(from).step_by(2).copied().collect())
            .collect(),
        ..state.clone()
    };
    let predicted = |fit: &Fitted| {
        let learnt = train.fit(candidates, &fit.effects, half(&fit.state, 0), Free::All)?;
        let begin = State {
            poses: half(&fit.state, 1).poses,
            ..learnt.state
        };
        test.fit(candidates, &fit.effects, begin, Free::Poses)
    };
    let best = found.best();
    let after = predicted(best);
    Ok(BeforeAfter {
        before: if best.effects.is_empty() {
            after.as_ref().map(rms)
        } else {
            predicted(&found.nothing).as_ref().map(rms)
        }
        .unwrap_or_default(),
        noise: after.as_ref().map(noise).unwrap_or_default(),
        after: after.as_ref().map(rms).unwrap_or_default(),
    })
}

/// Mean residual of the rows in the part of the image where it is largest, and that in its own
/// sds: without effects, and with them; and where the first is.
fn worst(nothing: &Fitted, best: &Fitted, rig: &Rig) -> ([(f64, f64); 2], String) {
    let of = |fit: &Fitted| {
        picture::cells(fit, rig)
            .into_iter()
            .filter(|c| c.count >= 8)
            .map(|c| (c.mean_px.abs(), c.mean_px.abs() / c.sd_px, c))
            .max_by(|a, b| a.0.total_cmp(&b.0))
    };
    let (before, after) = (of(nothing), of(best));
    let part = before.as_ref().map_or_else(String::new, |(.., c)| {
        format!(
            "columns {:.0} to {:.0}, rows {:.0} to {:.0}",
            c.from_px[0], c.to_px[0], c.from_px[1], c.to_px[1]
        )
    });
    let pair = |o: Option<(f64, f64, picture::Cell)>| o.map_or((0.0, 0.0), |(a, b, _)| (a, b));
    ([pair(before), pair(after)], part)
}

impl Findings {
    /// One sentence.
    pub fn sentence(&self) -> String {
        let list = || {
            let of = |e: &Effect| {
                let heavy = e.weight.iter().max_by(|a, b| {
                    let size = |(c, w): &(&String, &f64)| {
                        if c.ends_with("_rad") { **w * 1.15 } else { **w }
                    };
                    size(a).total_cmp(&size(b))
                });
                let moved = heavy.map_or_else(String::new, |(c, w)| {
                    if c.ends_with("_rad") {
                        format!(", {} {:.3} deg", c.trim_end_matches("_rad"), w.to_degrees())
                    } else {
                        format!(", {} {:.2} mm", c.trim_end_matches("_m"), w * 1e3)
                    }
                });
                let numbers: Vec<String> = e
                    .parameters
                    .iter()
                    .map(|(n, p)| format!("{n} = {:.5}", p.value))
                    .collect();
                format!("{} ({}{moved})", e.effect, numbers.join(", "))
            };
            self.effects.iter().map(of).collect::<Vec<_>>().join("; ")
        };
        match self.word {
            Word::None if self.effects.is_empty() => {
                "The stripe lies where the rig's camera, sheet and target put it.".to_owned()
            }
            Word::None => format!("Left out of the image, too small to matter: {}.", list()),
            Word::Ambiguous => format!(
                "Left out of the image: one of {}.",
                self.equivalent
                    .iter()
                    .map(|s| s.join(" + "))
                    .collect::<Vec<_>>()
                    .join(" | ")
            ),
            Word::Unknown => format!(
                "The stripe is {:.2} px off about {} and no effect explains it{}.",
                self.worst_px[1],
                self.part,
                if self.effects.is_empty() {
                    String::new()
                } else {
                    format!("; besides {}", list())
                }
            ),
            _ => format!("Left out of the image: {}.", list()),
        }
    }

    /// A verdict of the image level alone, for logs that hold frames and no motion.
    pub fn verdict(&self) -> Verdict {
        let dof = Dof::ALL
            .iter()
            .zip(CHANNELS)
            .filter(|(_, c)| {
                self.effects
                    .iter()
                    .any(|e| e.matters && e.weight.get(*c).is_some_and(|w| *w > 5e-4))
            })
            .map(|(d, _)| d.name().to_owned())
            .collect();
        Verdict {
            verdict: self.word,
            sentence: self.sentence(),
            effects: self.effects.clone(),
            equivalent: self.equivalent.clone(),
            place: Where {
                stage: (!self.effects.is_empty()).then(|| "measurement".to_owned()),
                dof,
                regime: self.regime(),
                ..Where::default()
            },
            test: Test {
                statistic:
                    "log posterior odds of the best explanation over none, from the profiles"
                        .to_owned(),
                value: self.log_odds,
                freedom: self
                    .effects
                    .iter()
                    .map(|e| e.parameters.len())
                    .sum::<usize>() as f64,
                // Odds bound the chance of as much without an effect.
                p_value: (-self.log_odds).exp().min(1.0),
                whiteness_p: Vec::new(),
                noise_rms: self.fit.train.noise.clone(),
            },
            fit: self.fit.clone(),
            parameters: Default::default(),
            blind_spots: self.blind_spots.clone(),
            next_experiment: None,
            noise: BTreeMap::new(),
            data_faults: Vec::new(),
            alternatives: self.alternatives.clone(),
            ladder: Vec::new(),
            unexplained: Vec::new(),
            notes: self.notes.clone(),
            sets_looked_at: self.sets_looked_at,
        }
    }

    fn regime(&self) -> String {
        if self.effects.is_empty() && self.word != Word::Unknown {
            return "nowhere in the image".to_owned();
        }
        format!(
            "in the image: rows off by up to {:.3} px about {} without effects, {:.3} px with them",
            self.worst_px[0], self.part, self.worst_px[1]
        )
    }

    /// A diagnosis of the image level alone.
    pub fn alone(&self, rig: &Rig) -> Diagnosis {
        let mut rig = rig.clone();
        rig.physics.extend(self.entries.iter().cloned());
        Diagnosis {
            verdict: self.verdict(),
            rig,
            explained: Vec::new(),
        }
    }

    /// Adds to a verdict from the motion of the same logs.
    pub fn join(&self, v: &mut Verdict) {
        if v.verdict == Word::DataFault {
            return;
        }
        let says = !self.effects.is_empty() || self.word != Word::None;
        if says {
            v.sentence = if v.verdict == Word::None && v.effects.is_empty() {
                self.sentence()
            } else {
                format!("{} {}", v.sentence, self.sentence())
            };
        }
        // Complete sets: each of one level with each of the other.
        let named = |effects: &[Effect]| -> Vec<String> {
            effects
                .iter()
                .filter(|e| e.matters)
                .map(|e| e.effect.clone())
                .collect()
        };
        if !v.equivalent.is_empty() || !self.equivalent.is_empty() {
            let or = |sets: &[Vec<String>], one: Vec<String>| {
                if sets.is_empty() {
                    vec![one]
                } else {
                    sets.to_vec()
                }
            };
            let (a, b) = (
                or(&v.equivalent, named(&v.effects)),
                or(&self.equivalent, named(&self.effects)),
            );
            v.equivalent = a
                .iter()
                .flat_map(|x| b.iter().map(move |y| x.iter().chain(y).cloned().collect()))
                .take(6)
                .collect();
        }
        v.verdict = v.verdict.max(self.word);
        v.effects.extend(self.effects.clone());
        if says {
            if v.place.stage.is_none() {
                v.place.stage = Some("measurement".to_owned());
            }
            v.place.regime = if v.place.regime.is_empty() {
                self.regime()
            } else {
                format!("{}; {}", v.place.regime, self.regime())
            };
        }
        let tables = [
            (&mut v.fit.train, &self.fit.train),
            (&mut v.fit.held_out, &self.fit.held_out),
        ];
        for (to, from) in tables {
            to.before.extend(from.before.clone());
            to.after.extend(from.after.clone());
            to.noise.extend(from.noise.clone());
        }
        v.blind_spots.extend(
            self.blind_spots
                .iter()
                .filter(|b| !v.blind_spots.contains(b))
                .cloned()
                .collect::<Vec<_>>(),
        );
        v.notes.extend(self.notes.clone());
        v.sets_looked_at += self.sets_looked_at;
    }
}
