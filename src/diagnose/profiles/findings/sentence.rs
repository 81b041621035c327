//! Findings as a sentence, as a verdict, and as a part of the motion's.

use super::{CHANNELS, Findings};
use crate::Diagnosis;
use crate::verdict::{Effect, Test, Verdict, Where, Word};
use hydroline_inference::limit::Account;
use hydroline_rigs::{Dof, Rig};

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
            Word::Unknown if self.unnamed_light.is_some() => format!(
                "Light that no effect of the library makes: {}{}.",
                self.unnamed_light.as_deref().unwrap_or_default(),
                if self.effects.is_empty() {
                    String::new()
                } else {
                    format!("; besides {}", list())
                }
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
            blind_spots: self.blind_spots.clone(),
            alternatives: self.alternatives.clone(),
            notes: self.notes.clone(),
            sets_looked_at: self.sets_looked_at,
            ..Verdict::default()
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
    pub fn alone(self, rig: &Rig) -> Diagnosis {
        let mut rig = rig.clone();
        let verdict = self.verdict();
        rig.physics.extend(self.entries);
        Diagnosis {
            verdict,
            rig,
            shown: Vec::new(),
            // Its effects have probabilities of their own; no plan is asked for.
            probability: 1.0,
            by_motion: Word::None,
            images: Some(self.section),
            offers: Vec::new(),
            account: Account::default(),
        }
    }

    /// A diagnosis from the motion of the same logs, with what the frames show.
    #[must_use]
    pub fn join(self, mut found: Diagnosis) -> Diagnosis {
        self.join_verdict(&mut found.verdict);
        found.rig.physics.extend(self.entries);
        found.images = Some(self.section);
        found
    }

    fn join_verdict(&self, v: &mut Verdict) {
        let says = !self.effects.is_empty() || self.word != Word::None;
        if says {
            let says_nothing = v.effects.is_empty() && v.contradicted_by.is_empty();
            v.sentence = if v.verdict == Word::None && says_nothing {
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
        if !self.fit.held_out.is_empty() {
            let by = &self.fit.held_out_by;
            v.fit.held_out_by = match v.fit.held_out_by.as_str() {
                "" => by.clone(),
                runs => format!("{runs}; of the image {by}"),
            };
        }
        for spot in &self.blind_spots {
            v.cannot_show(spot);
        }
        v.notes.extend(self.notes.clone());
        v.sets_looked_at += self.sets_looked_at;
    }
}
