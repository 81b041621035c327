//! Effects that light the picture: those whose law changes what the frames' samples are predicted to be.

use super::forward::{Forward, Own, Uncertain};
use super::options::LightOptions;
use super::samples::LightFrame;
use crate::profiles::candidate::Base;
use hydroline_inference::prior::{Density, Scale};
use hydroline_rigs::Rig;
use hydroline_sim::effect::{ALL, CheckedEffect, EffectInfo, Stage};

/// Places in the plausible range of an effect's size at which a search begins, and the one where it has a length or a
/// time beside its size.
const SIZES: [f64; 3] = [0.1, 0.5, 0.9];
const SIZE: [f64; 1] = [0.5];
/// Lengths and times from which a search begins, evenly up to half beyond what is plausible: a band's phase over the image is
/// lost from half a period off.
const PLACES: usize = 8;
const BEYOND: f64 = 1.6;

/// An effect that may light the picture, in one of its ways to do it.
#[derive(Debug, Clone)]
pub struct LightCandidate {
    /// The effect.
    pub info: &'static EffectInfo,
    /// Its words.
    pub words: Vec<usize>,
    /// Search scale and prior of each number: the motion level's.
    pub scales: Vec<Scale>,
    /// Natural numbers from which a search begins.
    pub starts: Vec<Vec<f64>>,
}

impl LightCandidate {
    /// With these natural numbers.
    pub fn effect(&self, numbers: &[f64]) -> CheckedEffect {
        CheckedEffect {
            numbers: numbers.to_vec(),
            words: self.words.clone(),
            ..CheckedEffect::typical(self.info)
        }
    }

    fn new(info: &'static EffectInfo, words: Vec<usize>) -> Self {
        let scales: Vec<Scale> = (info.parameters.iter().enumerate())
            .map(|(k, p)| Scale::of(p, k))
            .collect();
        let mut starts: Vec<Vec<f64>> = vec![Vec::new()];
        let placed = info.parameters.iter().skip(1).any(|p| p.absent.is_none());
        for (k, (p, scale)) in info.parameters.iter().zip(&scales).enumerate() {
            let (low, high) = p.plausible;
            let within = |share: f64| {
                let ends = [scale.scaled(low), scale.scaled(high)];
                scale.natural(ends[0] + share * (ends[1] - ends[0])).0
            };
            let values: Vec<f64> = match (p.absent, scale.density) {
                (Some(usual), Density::Circle(_)) => vec![usual],
                (Some(usual), _) if usual == p.typical => vec![usual],
                (Some(usual), _) => vec![p.typical, usual],
                (None, _) if k == 0 && placed => SIZE.map(within).to_vec(),
                (None, _) if k == 0 => SIZES.map(within).to_vec(),
                (None, _) => {
                    let step = (BEYOND * high - low) / (PLACES - 1) as f64;
                    (0..PLACES).map(|n| low + n as f64 * step).collect()
                }
            };
            let longer = |s: &Vec<f64>| {
                let s = s.clone();
                values.iter().map(move |v| {
                    let mut s = s.clone();
                    s.push(*v);
                    s
                })
            };
            starts = starts.iter().flat_map(longer).collect::<Vec<_>>();
        }
        // Where every number is as when it is not given, there is no effect.
        let absent =
            |s: &Vec<f64>| (s.iter().zip(info.parameters)).all(|(v, p)| p.absent == Some(*v));
        starts.retain(|s| !absent(s));
        LightCandidate {
            info,
            words,
            scales,
            starts,
        }
    }
}

/// All combinations of an effect's words.
fn ways(info: &EffectInfo) -> Vec<Vec<usize>> {
    info.words.iter().fold(vec![Vec::new()], |all, word| {
        let longer = |w: &Vec<usize>| {
            let w = w.clone();
            (0..word.allowed.len()).map(move |k| [w.as_slice(), &[k]].concat())
        };
        all.iter().flat_map(longer).collect()
    })
}

/// Every effect that changes a sample of these frames at one of its starts and that the rig does not know of.
pub(super) fn library(
    rig: &Rig,
    base: &Base,
    frames: &[LightFrame],
    o: &LightOptions,
) -> Vec<LightCandidate> {
    let Some(plain) = base.optics_of(&[]) else {
        return Vec::new();
    };
    let own = Own {
        brightness: 0.0,
        background: rig.camera.noise.ambient,
        rise: 0.0,
        lamp_s: 0.0,
    };
    let samples = || frames.iter().flat_map(|f| &f.bins).flat_map(|b| &b.samples);
    let predicted =
        |forward: &Forward| -> Vec<f64> { samples().map(|s| forward.grey(s, &own, 0.0)).collect() };
    let before = Forward::new(rig, plain, Uncertain::default(), None);
    let dark = predicted(&before);
    let lights = |effect: CheckedEffect| {
        let optics = base.optics_of(&[effect])?;
        let after = Forward::new(rig, optics, Uncertain::default(), Some(&before));
        let after = predicted(&after);
        let change = after.iter().zip(&dark).map(|(a, b)| (a - b).abs());
        Some(change.fold(0.0, f64::max) > o.lights_grey)
    };
    (ALL.iter().copied())
        .filter(|info| info.stage == Stage::Measurement && !base.knows(info))
        .flat_map(|info| ways(info).into_iter().map(|w| LightCandidate::new(info, w)))
        .filter(|c| c.starts.iter().any(|s| lights(c.effect(s)) == Some(true)))
        .collect()
}
