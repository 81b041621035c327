//! `hydroline plan design`: plans for one's own vehicle.

use super::output::Output;
use super::plan::loads;
use super::print::{self, errln, outln};
use super::progress::Stages;
use super::remembered::SeenArgs;
use super::{CliError, inputs};
use clap::ValueEnum;
use hydroline_design::{Designed, Options, Purpose, Separation, Set, design};
use hydroline_rigs::Dof;
use schemars::JsonSchema;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Purpose of the runs.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum For {
    /// The vehicle's coefficients
    Identify,
    /// Physics that the rig leaves out
    Diagnose,
}

#[derive(Debug, clap::Args)]
#[command(after_help = "\
Plans are sized to the thrusters, the tank, [limits] and the lit target, and chosen by the information to expect from \
their runs: of the vehicle's coefficients (--for identify), or of the effects that the rig may leave out, the \
coefficients unknown beside them (--for diagnose; a minute or two per plan). The vehicle may be lighter and less damped than its \
data sheet says: plans leave room for that. Information counts in nats: one nat is a factor of e in odds or in the volume of \
what is open. The first one says most; each further one is the best beside those \
before it. For every plan it is said what it excites; at the end, what all runs together do not distinguish.

Examples:
  hydroline plan design --rig my.toml --out plans
  hydroline plan design --rig my.toml --for diagnose --dof surge,yaw --length 20s --out plans

Exit codes: 0 done; 2 there is no such rig, it is not sound, or no plan fits it.")]
pub struct Args {
    /// Rig file or built-in name
    #[arg(long, value_name = "RIG")]
    rig: String,
    /// Purpose of the runs
    #[arg(
        long = "for",
        value_enum,
        value_name = "PURPOSE",
        default_value = "identify"
    )]
    purpose: For,
    /// Number of plans (1 to 20)
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u8).range(1..=20), allow_negative_numbers = true, value_name = "N")]
    plans: u8,
    /// Length of each (5 s to 10 min)
    #[arg(long, value_parser = length, allow_hyphen_values = true, default_value = "30s", value_name = "TIME")]
    length: Duration,
    /// DOFs to drive, with commas between; default: all that the thrusters can
    #[arg(long, value_name = "DOF", value_delimiter = ',', value_parser = super::diagnose::dof)]
    dof: Vec<Dof>,
    #[command(flatten)]
    seen: SeenArgs,
    /// Writes DIR/design-1.toml, ...
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    #[command(flatten)]
    output: Output,
    /// Prints one JSON object
    #[arg(long)]
    json: bool,
    /// Seed of the search: another one may find other plans that say as much
    #[arg(
        long,
        default_value_t = 1,
        value_name = "N",
        allow_negative_numbers = true
    )]
    seed: u64,
}

/// Shortest and longest plan \[s\]: one shorter than a vehicle's time constants says little, one longer is two plans.
const LENGTHS_S: [f64; 2] = [5.0, 600.0];

fn length(text: &str) -> Result<Duration, String> {
    let length = inputs::some_duration(text)?;
    match length.as_secs_f64() {
        s if (LENGTHS_S[0]..=LENGTHS_S[1]).contains(&s) => Ok(length),
        s => Err(format!("{s} s; allowed 5s to 10m, e.g. 30s")),
    }
}

pub fn run(args: &Args) -> Result<(), CliError> {
    let rig = inputs::rig(&args.rig)?;
    let names: Vec<String> = (1..=args.plans)
        .map(|k| format!("design-{k}.toml"))
        .collect();
    if let Some(dir) = &args.out {
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        args.output.folder("--out", dir, &names)?;
    }
    let options = Options {
        purpose: match args.purpose {
            For::Identify => Purpose::Identify,
            For::Diagnose => Purpose::Diagnose,
        },
        plans: usize::from(args.plans),
        length_s: args.length.as_secs_f64(),
        dofs: args.dof.clone(),
        calibration: args.seen.load(&rig)?,
        seed: args.seed,
        ..Options::default()
    };
    let stages = Stages::begin("designing");
    let set = design(&rig, &options, &|stage| stages.tell(stage));
    drop(stages);
    let set = set.map_err(CliError::config)?;
    if let Some(dir) = &args.out {
        std::fs::create_dir_all(dir).map_err(|e| CliError::writing(dir, &e))?;
        for p in &set.plans {
            let path = dir.join(format!("{}.toml", p.plan.name));
            let words = format!(
                "# Made by hydroline plan design for {}: {}.\n{}",
                rig.name,
                known(&set, p).join(", "),
                p.plan.source_toml
            );
            args.output.write(&path, words)?;
        }
    }
    if args.json {
        print::json(&Found::of(&set))?;
    } else {
        print(&set, &args.rig, args.out.as_deref());
    }
    Ok(())
}

/// Relative sd of the least known coefficient of each driven DOF by a run of this plan alone, in words \[%\].
fn known(set: &Set, p: &Designed) -> Vec<String> {
    let keys = ["x_", "y_", "z_", "k_", "m_", "n_"];
    let driven = (0..6).filter(|d| p.largest[*d] > 0.0);
    driven
        .map(|d| {
            let own = set.own.iter().zip(&p.sd_alone);
            let worst = own
                .filter(|(name, _)| name.starts_with(keys[d]))
                .fold(0.0_f64, |worst, (_, sd)| worst.max(*sd));
            format!("{} to {} %", Dof::ALL[d].name(), share(worst))
        })
        .collect()
}

/// A share in per cent with two digits.
fn share(of: f64) -> String {
    let v = 100.0 * of;
    match v {
        v if v >= 10.0 => format!("{v:.0}"),
        v if v >= 1.0 => format!("{v:.1}"),
        _ => format!("{v:.2}"),
    }
}

/// Pairs that are printed, the least discriminated first.
const ALIKE: usize = 12;

fn print(set: &Set, rig: &str, out: Option<&Path>) {
    outln!("reach of each DOF by itself: {}", loads(set.reach));
    for p in &set.plans {
        outln!(
            "{:<10} {:>5.1} s  largest loads {}",
            p.plan.name,
            p.plan.duration_s(),
            loads(p.largest)
        );
        outln!(
            "           expected sd of each DOF's least known coefficient, by this run alone: {}",
            known(set, p).join(", ")
        );
        outln!(
            "           expected information, beside the plans before it: {:.1} nats; shows {} of {} effects (DOFs counted one by one) by itself",
            p.gain_nats,
            p.shows.len(),
            set.asked
        );
    }
    if !set.unseen.is_empty() {
        outln!("not shown by all of them: {}", set.unseen.join(", "));
    }
    let seen = |name: &String| !set.unseen.contains(name);
    let separations = set.separations.iter();
    let mut alike: Vec<_> = separations
        .filter(|s| !s.discriminated() && seen(&s.of) && seen(&s.from))
        .collect();
    alike.sort_by(|a, b| a.nats.total_cmp(&b.nats));
    match alike.is_empty() {
        true => outln!("all others are discriminated (3 nats, odds of 20, and more)"),
        false => outln!("not discriminated (less than 3 nats, odds of 20):"),
    }
    for s in alike.iter().take(ALIKE) {
        outln!("  {} and {} ({:.1} nats)", s.of, s.from, s.nats);
    }
    if alike.len() > ALIKE {
        outln!(
            "  and {} pairs more (--json lists them)",
            alike.len() - ALIKE
        );
    }
    match out {
        Some(dir) => outln!(
            "written; next: hydroline record --rig {rig} --plan {} --out run-1.mcap",
            dir.join("design-1.toml").display()
        ),
        None => errln!("hydroline: nothing written: --out DIR writes the plans as files"),
    }
}

/// Output of `--json`.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct Found<'a> {
    /// Largest load of each DOF driven by itself, SNAME order \[N, N m\]; 0 = not driven.
    reach: [f64; 6],
    /// Plans in the order in which they say most.
    plans: Vec<FoundPlan<'a>>,
    /// Effects that are asked, one by one in each DOF that they act in.
    effects_asked: usize,
    /// Effects that all runs together do not tell from nothing.
    unseen: &'a [String],
    /// Every two effects, by all runs together.
    separations: Vec<FoundSeparation<'a>>,
}

/// A plan.
#[derive(Debug, Serialize, JsonSchema)]
struct FoundPlan<'a> {
    /// Name of the plan.
    plan: &'a str,
    /// Its length \[s\].
    duration_s: f64,
    /// Largest load per DOF, SNAME order \[N, N m\].
    largest: [f64; 6],
    /// Information to expect from it beside those before it \[nats\].
    gain_nats: f64,
    /// Standard deviation of each coefficient by this run alone, as a share of its size.
    relative_sd_alone: BTreeMap<&'a str, f64>,
    /// The same by this run and all before it.
    relative_sd: BTreeMap<&'a str, f64>,
    /// Effects of which it tells a typical size from nothing, the coefficients unknown.
    shows: &'a [String],
    /// The plan file.
    plan_toml: &'a str,
}

/// Two effects.
#[derive(Debug, Serialize, JsonSchema)]
struct FoundSeparation<'a> {
    /// The effect that is there, of typical size.
    of: &'a str,
    /// The other, of any size, that is taken for it.
    from: &'a str,
    /// Log Bayes factor to expect, to first order; the smaller of both directions \[nats\].
    nats: f64,
    /// Whether that discriminates them.
    discriminated: bool,
}

impl<'a> Found<'a> {
    fn of(set: &'a Set) -> Self {
        let sd = |of: &[f64]| set.own.iter().copied().zip(of.iter().copied()).collect();
        let plan = |p: &'a Designed| FoundPlan {
            plan: &p.plan.name,
            duration_s: p.plan.duration_s(),
            largest: p.largest,
            gain_nats: p.gain_nats,
            relative_sd_alone: sd(&p.sd_alone),
            relative_sd: sd(&p.sd),
            shows: &p.shows,
            plan_toml: &p.plan.source_toml,
        };
        let separation = |s: &'a Separation| FoundSeparation {
            of: &s.of,
            from: &s.from,
            nats: s.nats,
            discriminated: s.discriminated(),
        };
        Found {
            reach: set.reach,
            plans: set.plans.iter().map(plan).collect(),
            effects_asked: set.asked,
            unseen: &set.unseen,
            separations: set.separations.iter().map(separation).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_length_out_of_range_says_the_range() {
        assert!(length("30s").is_ok());
        for text in ["1s", "11m"] {
            assert!(length(text).unwrap_err().contains("5s to 10m"));
        }
    }
}
