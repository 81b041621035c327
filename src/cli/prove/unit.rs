//! Cases as units of work: by their ids, kept in a folder, on other machines.

use hydroline_lab::benchmark::case::parse;
use hydroline_lab::benchmark::coupled::{self, CoupledJudged};
use hydroline_lab::benchmark::held_out::{self, HeldOutJudged};
use hydroline_lab::benchmark::images::{self, ImageJudged};
use hydroline_lab::benchmark::invariance::{self, InvarianceJudged};
use hydroline_lab::benchmark::score::complaint;
use hydroline_lab::benchmark::{Category, Kept, catalogue, run as prove};

use super::{Args, how};
use crate::print::{errln, outln};
use crate::{CliError, Outcome};

/// Ids of the cases that are asked for, and whether each is kept.
pub fn list(args: &Args, kept: Option<&Kept>) -> Result<Outcome, CliError> {
    let other = |prefix: &str, count: usize| -> Vec<String> {
        (0..count).map(|k| format!("{prefix}-{k}")).collect()
    };
    let others = [
        ("image", args.images),
        ("coupled", args.coupled),
        ("held_out", args.held_out),
        ("invariance", args.invariance),
    ];
    let asked = others
        .into_iter()
        .find_map(|(prefix, n)| Some((prefix, n?)));
    let ids = asked.map_or_else(
        || {
            let ids = catalogue(args.cases, args.category);
            ids.iter()
                .map(|(category, k)| format!("{}-{k}", category.name()))
                .collect()
        },
        |(prefix, count)| other(prefix, count),
    );
    for id in ids {
        let is_there = match (kept, Unit::of(&id)?) {
            (None, _) => false,
            (Some(kept), Unit::Image(_)) => kept.read_other::<ImageJudged>(&id)?.is_some(),
            (Some(kept), Unit::Coupled(_)) => kept.read_other::<CoupledJudged>(&id)?.is_some(),
            (Some(kept), Unit::HeldOut(_)) => kept.read_other::<HeldOutJudged>(&id)?.is_some(),
            (Some(kept), Unit::Invariance(_)) => {
                kept.read_other::<InvarianceJudged>(&id)?.is_some()
            }
            (Some(kept), Unit::Case(..)) => kept.read(&id, !args.no_ideal)?.is_some(),
        };
        if !is_there {
            outln!("{id}");
        }
    }
    Ok(Outcome::Done)
}

/// A case by its id.
#[derive(Debug, Clone, Copy)]
pub enum Unit {
    Image(usize),
    Coupled(usize),
    HeldOut(usize),
    Invariance(usize),
    Case(Category, usize),
}

impl Unit {
    pub fn of(id: &str) -> Result<Self, CliError> {
        let number = |prefix: &str| id.strip_prefix(prefix).and_then(|n| n.parse().ok());
        if let Some(index) = number("image-") {
            return Ok(Self::Image(index));
        }
        if let Some(index) = number("coupled-") {
            return Ok(Self::Coupled(index));
        }
        if let Some(index) = number("held_out-") {
            return Ok(Self::HeldOut(index));
        }
        if let Some(index) = number("invariance-") {
            return Ok(Self::Invariance(index));
        }
        let (category, index) = parse(id)?;
        Ok(Self::Case(category, index))
    }
}

/// Cases for a proof that other processes work at too.
pub fn keep(args: &Args, ids: &[String], kept: &Kept) -> Result<Outcome, CliError> {
    let units: Vec<Unit> = ids
        .iter()
        .map(|id| Unit::of(id))
        .collect::<Result<_, _>>()?;
    for unit in units {
        let line = match unit {
            Unit::Image(index) => {
                let judged = images::run(args.seed, &[index], Some(kept), &|_| ())?;
                judged.first().and_then(images::complaint)
            }
            Unit::Coupled(index) => {
                let judged = coupled::run(args.seed, &[index], Some(kept), &|_| ())?;
                judged.first().and_then(coupled::complaint)
            }
            Unit::HeldOut(index) => {
                let judged = held_out::run(args.seed, &[index], Some(kept), &|_| {})?;
                judged.first().and_then(held_out::complaint)
            }
            Unit::Invariance(index) => {
                let judged = invariance::run(args.seed, &[index], Some(kept), &|_| {})?;
                judged.first().and_then(invariance::complaint)
            }
            Unit::Case(category, index) => {
                let case = [(category, index)];
                let judged = prove(args.seed, &case, how(args), Some(kept), &|_| ())?;
                judged.first().and_then(complaint)
            }
        };
        if let Some(line) = line {
            errln!("{line}");
        }
    }
    Ok(Outcome::Done)
}
