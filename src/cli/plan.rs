//! `hydroline plan`: what is built in, what of it runs on a rig, and a plan at the size that fits.

use super::print::{self, out, outln};
use super::remembered::SeenArgs;
use super::{CliError, Outcome, design, inputs};
use clap::Subcommand;
use hydroline_calib::Calibration;
use hydroline_calib::plane::PlaneMap;
use hydroline_plan::preflight::{PreflightError, Repeats, preflight_runs};
use hydroline_plan::size::{largest, refusal, scaled, share_that_fits};
use hydroline_rigs::{Plan, Rig, Wrench};
use serde::Serialize;

#[derive(Debug, Subcommand)]
pub enum Command {
    /// The built-in plans, and which of them run on a rig
    #[command(after_help = "\
Each plan is simulated with the rig's model, as `record` does before it starts. Of one that is refused \
the largest share of its loads that fits is said: `plan show` writes it at that size.

Examples:
  hydroline plan list
  hydroline plan list --rig my.toml
  hydroline plan list --rig my.toml --json

Exit codes: 0 done; 2 there is no such rig, or it is not sound.")]
    List {
        /// Rig file or built-in name to try them on
        #[arg(long, value_name = "RIG")]
        rig: Option<String>,
        #[command(flatten)]
        seen: SeenArgs,
        /// Prints one JSON array
        #[arg(long)]
        json: bool,
    },
    /// Makes plans for a rig: sized to it, chosen by what their runs will say
    Design(design::Args),
    /// A plan's steps, and what it does on a rig; at another size, as a file to edit
    #[command(after_help = "\
Examples:
  hydroline plan show reversals
  hydroline plan show reversals --rig my.toml
  hydroline plan show reversals --scale 0.42 --toml > smaller.toml

Exit codes: 0 done, also for a plan that the rig refuses; 2 there is no such plan or rig, or they do not go together.")]
    Show {
        /// Plan file or built-in name
        #[arg(value_name = "PLAN")]
        plan: String,
        /// Rig file or built-in name to try it on
        #[arg(long, value_name = "RIG")]
        rig: Option<String>,
        #[command(flatten)]
        seen: SeenArgs,
        /// All loads times this (above 0)
        #[arg(long, value_name = "SHARE", default_value_t = 1.0, value_parser = share)]
        scale: f64,
        /// Prints the plan as a file, nothing else
        #[arg(long, conflicts_with = "rig")]
        toml: bool,
    },
}

/// A share of a plan's loads.
fn share(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(v) if v > 0.0 && f64::is_finite(v) => Ok(v),
        _ => Err("a number above 0, e.g. 0.42".to_owned()),
    }
}

/// A plan as `plan list --json` says it.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub(super) struct Listed {
    /// Name of the plan.
    plan: &'static str,
    /// Its length \[s\].
    duration_s: f64,
    /// Largest load per DOF, SNAME order; `null` where single thrusters are commanded \[N, N m\].
    largest: Option<[f64; 6]>,
    /// Whether it runs on the rig; `null` without one.
    runs: Option<bool>,
    /// Why it does not run on the rig; `null` where it does, or without one.
    refused: Option<String>,
    /// Largest share of its loads that runs on the rig; `null` where it runs as it is, or where it is not its size.
    share_that_fits: Option<f64>,
}

pub fn run(command: &Command) -> Result<Outcome, CliError> {
    match command {
        Command::Design(args) => design::run(args)?,
        Command::List { rig, seen, json } => list(rig.as_deref(), seen, *json)?,
        Command::Show {
            plan,
            rig,
            seen,
            scale,
            toml,
        } => show(plan, rig.as_deref(), seen, *scale, *toml)?,
    }
    Ok(Outcome::Done)
}

fn list(named: Option<&str>, seen: &SeenArgs, json: bool) -> Result<(), CliError> {
    let rig = named.map(inputs::rig).transpose()?;
    let map = map(seen, rig.as_ref())?;
    let mut all = Vec::new();
    for name in Plan::builtin_names() {
        all.push(listed(name, rig.as_ref(), map.as_deref())?);
    }
    if json {
        print::json(&all)?;
        return Ok(());
    }
    for plan in &all {
        let loads = plan.largest.map_or("single thrusters".to_owned(), loads);
        outln!("{:<14} {:>5.1} s  {loads}", plan.plan, plan.duration_s);
        match (plan.runs, &plan.refused, plan.share_that_fits) {
            (Some(true), ..) => outln!("               runs on this rig"),
            (_, Some(why), Some(share)) => {
                outln!("               refused {why}");
                outln!(
                    "               fits at {share} of its loads: hydroline plan show {} --scale {share} --toml > {}-small.toml",
                    plan.plan,
                    plan.plan
                );
            }
            (_, Some(why), None) => outln!("               refused {why}; no size of it fits"),
            _ => {}
        }
    }
    if let Some(named) = named.filter(|_| all.iter().any(|p| p.refused.is_some())) {
        outln!("plans made for this vehicle: hydroline plan design --rig {named} --out plans");
    }
    Ok(())
}

/// The map by which a rig's runs will be seen.
fn map(seen: &SeenArgs, rig: Option<&Rig>) -> Result<Option<Box<dyn PlaneMap>>, CliError> {
    let Some(rig) = rig else { return Ok(None) };
    Ok(seen.load(rig)?.as_ref().map(Calibration::to_map))
}

fn listed(
    name: &'static str,
    rig: Option<&Rig>,
    map: Option<&dyn PlaneMap>,
) -> Result<Listed, CliError> {
    let plan = Plan::load_or_builtin(name)?;
    let mut made = Listed {
        plan: name,
        duration_s: plan.duration_s(),
        largest: largest(&plan),
        runs: None,
        refused: None,
        share_that_fits: None,
    };
    let Some(rig) = rig else { return Ok(made) };
    if let Err(error) = plan.check_against(rig) {
        made.runs = Some(false);
        made.refused = Some(format!("({error})"));
        return Ok(made);
    }
    made.refused = refusal(rig, &plan, Repeats::ONCE, map)?;
    made.runs = Some(made.refused.is_none());
    if made.refused.is_some() {
        made.share_that_fits = share_that_fits(rig, &plan, Repeats::ONCE, map)?;
    }
    Ok(made)
}

/// Advice to add to a refusal: the size that fits, and how to get it.
pub fn size_that_fits(
    rig: &Rig,
    plan: &Plan,
    named: &str,
    repeats: Repeats,
    map: Option<&dyn PlaneMap>,
) -> String {
    match share_that_fits(rig, plan, repeats, map) {
        Ok(Some(share)) => {
            let most = largest(plan).map(|l| loads(l.map(|v| share * v)));
            let most = most.map_or(String::new(), |m| format!(" ({m})"));
            format!(
                "at {share} of its loads{most} it fits: `hydroline plan show {named} --scale {share} --toml > fits.toml`, then --plan fits.toml"
            )
        }
        // The refusal says already why it does not run.
        Ok(None) | Err(_) => {
            "no smaller size of it fits: change the rig's start pose, limits or target".to_owned()
        }
    }
}

/// Loads that are not 0, with their keys.
pub(super) fn loads(largest: [f64; 6]) -> String {
    let each = Wrench::KEYS.iter().zip(largest).filter(|(_, v)| *v > 0.0);
    let each: Vec<String> = each.map(|(key, v)| format!("{key} {v:.3}")).collect();
    match each.is_empty() {
        true => "no load".to_owned(),
        false => each.join(", "),
    }
}

fn show(
    plan: &str,
    rig: Option<&str>,
    seen: &SeenArgs,
    scale: f64,
    toml: bool,
) -> Result<(), CliError> {
    let rig = rig.map(inputs::rig).transpose()?;
    let made = match &rig {
        Some(rig) => inputs::plan(plan, rig)?,
        None => Plan::load_or_builtin(plan)?,
    };
    let made = match scale == 1.0 {
        true => made,
        false => scaled(&made, scale),
    };
    let Some(rig) = rig.filter(|_| !toml) else {
        out!("{}", made.source_toml);
        return Ok(());
    };
    let map = map(seen, Some(&rig))?;
    match preflight_runs(&rig, &made, Repeats::ONCE, map.as_deref()) {
        Ok(report) => {
            out!("{report}");
            if report.violations.is_empty() {
                outln!("  runs on {}", rig.name);
                return Ok(());
            }
        }
        Err(PreflightError::Setpoint(error)) => outln!("  REFUSED: {error}"),
        Err(other) => return Err(other.into()),
    }
    outln!(
        "  {}",
        size_that_fits(&rig, &made, plan, Repeats::ONCE, map.as_deref())
    );
    Ok(())
}
