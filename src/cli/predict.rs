//! `hydroline predict`: the motion a plan will make, with its band.

use std::path::PathBuf;

use super::print::{errln, outln};
use super::{CliError, Outcome, inputs};
use hydroline_identify::predict::{Identified, predict};

#[derive(Debug, clap::Args)]
#[command(after_help = "\
The band comes from the uncertainty of the coefficients: of --identified, or of a rig that `identify --write-rig` wrote.

Examples:
  hydroline predict --rig lshpi --plan surge-4n
  hydroline predict --rig my.toml --plan reversals --identified found.json --tail 5 > motion.csv

Exit codes: 0 done; 1 the motion runs away; 2 bad arguments, rig, plan or identification.")]
pub struct Args {
    /// Rig file or built-in name
    #[arg(long, value_name = "RIG")]
    rig: String,
    /// Plan file or built-in name
    #[arg(long, value_name = "PLAN")]
    plan: String,
    /// Output of `identify --json`: its coefficients replace the rig's, its covariance makes the band
    /// (a rig that `identify --write-rig` wrote has both in it)
    #[arg(long, value_name = "IDENTIFIED.json")]
    identified: Option<PathBuf>,
    /// Rows per second
    #[arg(long, default_value = "25", value_parser = inputs::not_negative, value_name = "HZ")]
    rate: f64,
    /// Goes on for this long after the plan's last step (coasting) [s]
    #[arg(long, default_value = "0", value_parser = inputs::not_negative, value_name = "S")]
    tail: f64,
    /// Prints one JSON object instead of CSV
    #[arg(long)]
    json: bool,
}

pub fn run(args: &Args) -> Result<Outcome, CliError> {
    let rig = inputs::rig(&args.rig)?;
    let plan = inputs::plan(&args.plan, &rig)?;
    if args.rate == 0.0 || args.rate > 10_000.0 {
        return Err(CliError::Config(format!(
            "--rate {}: give more than 0 and at most 10000",
            args.rate
        )));
    }
    let identified = match &args.identified {
        None => Identified::of_rig(&rig)?,
        Some(path) => {
            let text = inputs::text(path, "give the output of `hydroline identify --json`")?;
            Some(Identified::from_json(&text, &path.display().to_string())?)
        }
    };
    for words in identified.iter().flat_map(Identified::implausible) {
        errln!("WARNING {words}");
    }
    let made = predict(&rig, &plan, identified.as_ref(), args.rate, args.tail)?;
    if identified.is_none() {
        errln!(
            "no band: the rig's coefficients carry no uncertainty; give --identified (hydroline identify LOG... --json), or a rig that identify --write-rig wrote"
        );
    }
    if !made.without_doubt.is_empty() {
        errln!(
            "note: the band is too narrow where {} are not as the rig says: they carry no uncertainty, and this plan moves their degrees of freedom; identify runs that excite them",
            made.without_doubt.join(", ")
        );
    }
    if args.json {
        outln!("{}", serde_json::to_string(&made)?);
        return Ok(Outcome::Done);
    }
    let mut header = format!("t_s,{}", made.channels.join(","));
    if !made.sd.is_empty() {
        header += &made
            .channels
            .iter()
            .map(|c| format!(",{c}_sd"))
            .collect::<String>();
    }
    outln!("{header}");
    for (k, (t_s, row)) in made.t_s.iter().zip(&made.motion).enumerate() {
        let cells = row
            .iter()
            .chain(made.sd.get(k).into_iter().flatten())
            .map(|v| format!(",{v}"))
            .collect::<String>();
        outln!("{t_s}{cells}");
    }
    Ok(Outcome::Done)
}
