//! Information of a run by a plan: on the vehicle's coefficients, and on what the rig may leave out.

use hydroline_core::run::{Command, PerChannel};
use hydroline_inference::fit::Problem;
use hydroline_inference::planned::{Typical, without_last};
use hydroline_inference::prior::PriorTable;
use hydroline_inference::term::{Candidate, Kind};
use hydroline_rigs::{Plan, Rig};
use hydroline_sim::Allocation;
use hydroline_sim::effect::EffectError;
use nalgebra::{Cholesky, DMatrix};

use super::library::{Watched, run_of};
use super::options::{Instruments, Options, Purpose};

/// An effect whose law holds this many words and more is a product of rates: there are a hundred of them, and what excites
/// them is that both rates are there.
const WORDS: usize = 2;
/// A log Bayes factor to expect from which two effects are distinguished: odds of 20 to 1.
const DISCRIMINATED: f64 = 3.0;
/// Share of that below which a run has missed what its plan was to show: a few poses less, or a command a few milliseconds
/// later, are no reason for another run.
const BY_FAR: f64 = 0.5;
/// Share of a typical number at which an effect is looked at once more: what a delay or a threshold does at another size is
/// not what it does at this one, times a factor.
const NEAR: f64 = 0.7;

/// An effect that may be left out, with its columns among those of the information.
#[derive(Debug, Clone)]
struct Asked {
    name: String,
    /// DOF that its words name.
    dof: Option<usize>,
    /// Column of its response at a typical size.
    lead: usize,
    /// Columns of its responses near that.
    more: std::ops::Range<usize>,
}

/// Log Bayes factor by which a set of runs distinguishes two effects.
#[derive(Debug, Clone, PartialEq)]
pub struct Separation {
    /// One, of typical size, that is there.
    pub of: String,
    /// The other, of any size, that is taken for it.
    pub from: String,
    /// Log Bayes factor to expect, to first order; the smaller of both directions.
    pub nats: f64,
}

impl Separation {
    /// Whether they are distinguished.
    pub fn discriminated(&self) -> bool {
        self.nats >= DISCRIMINATED
    }
}

/// Judges plans for one rig.
#[derive(Debug)]
pub struct Judge<'a> {
    rig: &'a Rig,
    allocation: &'a Allocation,
    base: Problem,
    /// Of each effect the typical size.
    leads: Vec<Typical>,
    /// Near it, one number after the other: what else it may look like.
    more: Vec<Typical>,
    asked: Vec<Asked>,
    purpose: Purpose,
    watched: Watched,
}

/// Expected noise per channel: poses are measured, rates are not.
fn noise(of: Instruments) -> PerChannel<Option<hydroline_numerics::noise::Noise>> {
    PerChannel::from_fn(|c| match (c.is_rate(), c.is_angular()) {
        (false, false) => Some(of.position),
        (false, true) => Some(of.attitude),
        (true, _) => None,
    })
}

impl<'a> Judge<'a> {
    /// For the DOFs that are driven; `first` = a plan by which effects get their typical size.
    ///
    /// # Errors
    /// [`EffectError`] for a bad `[[physics]]` entry of the rig.
    pub fn new(
        rig: &'a Rig,
        allocation: &'a Allocation,
        dofs: &[usize],
        first: &Plan,
        options: &Options,
    ) -> Result<Judge<'a>, EffectError> {
        let watched = Watched {
            tail_s: options.tail_s,
            rate_hz: options.instruments.rate_hz,
        };
        let (commands, times_s) = run_of(rig, allocation, first, watched).unwrap_or_default();
        let base = Problem::of_rig(rig, dofs, &commands, &times_s, noise(options.instruments))?;
        let own = base.body.own.len();
        let (mut leads, mut more, mut asked) = (Vec::new(), Vec::new(), Vec::<Asked>::new());
        for (candidate, c) in base.body.candidates.iter().enumerate() {
            if c.kind != Kind::Effect || c.own || c.words.len() >= WORDS {
                continue;
            }
            let Some(numbers) = c.starts.first() else {
                continue;
            };
            let lead = own + leads.len();
            let near = near(c)
                .into_iter()
                .map(|numbers| Typical { candidate, numbers });
            let from = more.len();
            more.extend(near);
            leads.push(Typical {
                candidate,
                numbers: numbers.clone(),
            });
            asked.push(Asked {
                name: c.name(),
                dof: c.dof(),
                lead,
                more: from..more.len(),
            });
        }
        for a in &mut asked {
            let behind = own + leads.len();
            a.more = behind + a.more.start..behind + a.more.end;
        }
        Ok(Judge {
            rig,
            allocation,
            base,
            leads,
            more,
            asked,
            purpose: options.purpose,
            watched,
        })
    }

    /// Number of effects that are asked.
    pub fn asked(&self) -> usize {
        self.asked.len()
    }

    /// Names of the vehicle's own numbers.
    pub fn own(&self) -> Vec<&'static str> {
        self.base.body.own.iter().map(|o| o.name()).collect()
    }

    /// Information of a run: about the vehicle's numbers, and behind them the effects' amplitudes. `None` where it cannot be
    /// commanded, or does not stay finite.
    pub fn whole(&self, plan: &Plan) -> Option<DMatrix<f64>> {
        self.of(plan, &self.all())
    }

    /// The same as far as the purpose asks for it.
    pub fn information(&self, plan: &Plan) -> Option<DMatrix<f64>> {
        match self.purpose {
            Purpose::Identify => self.of(plan, &[]),
            Purpose::Diagnose => self.of(plan, &self.leads),
        }
    }

    /// [`Judge::whole`] of a run that was made, by what was sent in it.
    pub fn whole_of_run(&self, commands: &[Command], times_s: &[f64]) -> Option<DMatrix<f64>> {
        self.of_run("made", commands.to_vec(), times_s, &self.all())
    }

    /// Every response that is asked.
    fn all(&self) -> Vec<Typical> {
        [&self.leads[..], &self.more].concat()
    }

    fn of(&self, plan: &Plan, typical: &[Typical]) -> Option<DMatrix<f64>> {
        let (commands, times_s) = run_of(self.rig, self.allocation, plan, self.watched)?;
        self.of_run(&plan.name, commands, &times_s, typical)
    }

    fn of_run(
        &self,
        name: &str,
        commands: Vec<Command>,
        times_s: &[f64],
        typical: &[Typical],
    ) -> Option<DMatrix<f64>> {
        let planned = self.base.planned(name, commands, times_s, self.rig);
        planned.ok()?.expected(typical)
    }

    /// Precision of the numbers before any run: coefficients of similar hulls, an effect's amplitude as large as typical.
    fn with_prior(&self, information: &DMatrix<f64>) -> DMatrix<f64> {
        let (own, prior) = (&self.base.body.own, PriorTable::default());
        let mut made = information.clone();
        for i in 0..made.nrows() {
            made[(i, i)] += own.get(i).map_or(1.0, |o| o.prior_scale(&prior).powi(-2));
        }
        made
    }

    /// Expected information of runs that say this together \[nats\], up to what is known before: of the coefficients, or of the
    /// effects with the coefficients unknown.
    pub fn value(&self, information: &DMatrix<f64>) -> f64 {
        let ln_det = |m: DMatrix<f64>| -> f64 {
            Cholesky::new(m).map_or(f64::NEG_INFINITY, |root| {
                root.l_dirty().diagonal().iter().map(|v| v.ln()).sum()
            })
        };
        let own = self.base.body.own.len();
        let part = (own + self.leads.len()).min(information.nrows());
        let all = self.with_prior(&information.view((0, 0), (part, part)).into_owned());
        match self.purpose {
            Purpose::Identify => ln_det(all.view((0, 0), (own, own)).into_owned()),
            Purpose::Diagnose => {
                ln_det(all.clone()) - ln_det(all.view((0, 0), (own, own)).into_owned())
            }
        }
    }

    /// Relative sd of each of the vehicle's numbers behind runs that say this together; no effect left out.
    pub fn sd(&self, information: &DMatrix<f64>) -> Vec<f64> {
        let own = self.base.body.own.len();
        let part = self.with_prior(information);
        let part = part.view((0, 0), (own, own)).into_owned();
        let known = Cholesky::new(part).map(|root| root.inverse());
        (0..own)
            .map(|i| known.as_ref().map_or(f64::NAN, |c| c[(i, i)].sqrt()))
            .collect()
    }

    /// Every two effects that act in one DOF, or in none by name: how far runs whose [`Judge::whole`] sums up to this tell them
    /// apart.
    pub fn separations(&self, whole: &DMatrix<f64>) -> Vec<Separation> {
        let together = |a: &Asked, b: &Asked| match (a.dof, b.dof) {
            (Some(a), Some(b)) => a == b,
            _ => true,
        };
        let mut all = Vec::new();
        for (i, a) in self.asked.iter().enumerate() {
            for b in self.asked[i + 1..].iter().filter(|b| together(a, b)) {
                all.push(Separation {
                    of: a.name.clone(),
                    from: b.name.clone(),
                    nats: self
                        .apart(whole, a, Some(b))
                        .min(self.apart(whole, b, Some(a))),
                });
            }
        }
        all
    }

    /// Effects of which runs tell a typical size from nothing, the coefficients unknown.
    pub fn shown(&self, whole: &DMatrix<f64>) -> Vec<String> {
        self.seen(|a| self.apart(whole, a, None) >= DISCRIMINATED)
    }

    /// Those of which they do not.
    pub fn unseen(&self, whole: &DMatrix<f64>) -> Vec<String> {
        self.seen(|a| self.apart(whole, a, None) < DISCRIMINATED)
    }

    /// Effects of which a plan tells a typical size from nothing, and runs that were made do not by far.
    pub fn missing(&self, planned: &DMatrix<f64>, made: &DMatrix<f64>) -> Vec<String> {
        let by = |whole: &DMatrix<f64>, a: &Asked| self.apart(whole, a, None);
        self.seen(|a| by(planned, a) >= DISCRIMINATED && by(made, a) < BY_FAR * DISCRIMINATED)
    }

    fn seen(&self, which: impl Fn(&Asked) -> bool) -> Vec<String> {
        let of = self.asked.iter().filter(|a| which(a));
        of.map(|a| a.name.clone()).collect()
    }

    /// Half square of what of `a` at typical size neither the coefficients nor `b` follow.
    fn apart(&self, whole: &DMatrix<f64>, a: &Asked, b: Option<&Asked>) -> f64 {
        let own = self.base.body.own.len();
        let known = self.with_prior(whole);
        let order: Vec<usize> = std::iter::once(a.lead)
            .chain(0..own)
            .chain(
                b.into_iter()
                    .flat_map(|b| std::iter::once(b.lead).chain(b.more.clone())),
            )
            .collect();
        let n = order.len();
        let mut part = DMatrix::from_fn(n, n, |i, j| known[(order[i], order[j])]);
        part[(0, 0)] = whole[(a.lead, a.lead)];
        without_last(&part, 1).map_or(0.0, |left| 0.5 * left[(0, 0)].max(0.0))
    }
}

/// Typical numbers of an effect with one of them nearer to nothing.
fn near(c: &Candidate) -> Vec<Vec<f64>> {
    let Some(numbers) = c.starts.first() else {
        return Vec::new();
    };
    let each = c.scales.iter().enumerate().map(|(i, scale)| {
        let mut there = numbers.clone();
        let nothing = if i == 0 { c.nothing } else { 0.0 };
        there[i] = nothing + NEAR * (numbers[i] - nothing);
        there[i] = there[i].clamp(scale.limits.0, scale.limits.1);
        there
    });
    // One that is linear looks the same at any size.
    let alike = |i: usize| c.linear.contains(&i);
    let each = each.enumerate().filter(|(i, _)| !alike(*i));
    each.map(|(_, numbers)| numbers).collect()
}
