//! `hydroline calibrate`: images of a board become the map from image to laser plane.

mod collect;
mod free;
pub(super) mod json;
mod picture;
mod report;

use super::images::{self, GreyArgs};
use super::many::{self, Many};
use super::output::Output;
use super::print::{self, errln, out};
use super::remembered::Memory;
use super::{CliError, Outcome, inputs};
use collect::{Collected, Source};
use hydroline_calib::calibration::board_map::Placement;
use hydroline_calib::calibration::compare::compare;
use hydroline_calib::map::Method;
use hydroline_calib::{Calibration, ImageSize, Medium};
use hydroline_capture::ImageFolder;
use hydroline_core::clock::{Clock, SystemClock};
use hydroline_core::frame::GreyRule;
use hydroline_daemon::calibrate::{Setup, medium, rfc3339};
use hydroline_log::LogReader;
use hydroline_rigs::{Board, FlatPort, Rig};
use report::{Against, Report};
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
#[command(after_help = "\
The board stands in the laser sheet and does not move; images of another pose are fitted apart and compared. \
Methods: homography (lens and perspective; the default), refractive (flat port by Snell's law), and the literal \
Wang-Cheng maps graticule, bilinear, affine, and rectified-graticule; `hydroline reproduce calibration` compares them.

With --free the board is held in the hand instead, 15 times or so, near and far and tilted to all sides, so that the laser line \
crosses it: chessboards and ChArUco boards (OpenCV's dictionaries) of any size, whole or in part. Camera, port (in water, or where one is named), board poses and \
laser sheet are fitted together; images that do not fit are named and left out.

An accepted one is remembered, too ($XDG_DATA_HOME/hydroline/calibrations): `record` uses the latest for its camera, \
medium and board, and says so. That needs the camera: the log's rig, or --rig.

Examples:
  hydroline calibrate calib.mcap --board dots-50 --out calib.toml
  hydroline calibrate board.png --board chess-25 --rig my.toml --medium fresh --out calib.toml
  hydroline calibrate calib.mcap --board dots-50 --out calib.toml --against last-week.toml
  hydroline calibrate boards/ --board dots-50 --channel green --out calib.toml
  hydroline calibrate --free hand/ --board chess-25 --out desk.toml
  hydroline calibrate --free hand/ --board charuco-25 --out desk.toml
  hydroline calibrate logs/ --board dots-50 --out calib.toml --update    # all logs below

A folder of images stands for them, one without images for all logs in it and below it. A file of several that cannot be used \
is reported, and the others are used.

Exit codes: 0 done; 1 no board was found, or its nodes make no map; 2 bad arguments or files, or none of them is an \
image or log; 3 done, but some of the given images or logs were refused, frames of a log are damaged, or the calibration is \
off from another of the board or of --against by more than is allowed: then it is not remembered.")]
pub struct Args {
    /// Logs (.mcap), images (PNG of 8 or 16 bits, JPEG) of the board, or folders of them
    #[arg(required = true, value_name = "LOG|IMAGE|FOLDER")]
    inputs: Vec<PathBuf>,
    /// Board file or built-in name; default: the rig's [board]
    #[arg(long, value_name = "BOARD")]
    board: Option<String>,
    /// Boards held in the hand, the line across them: fits camera, port and laser sheet together
    #[arg(long, conflicts_with_all = ["method", "at", "accept_unknown_gap", "annotate", "json"])]
    free: bool,
    /// For --free: camera that OpenCV or ROS (YAML), Kalibr or MATLAB (JSON) calibrated in air; taken as good to 0.3 %
    #[arg(long, requires = "free", value_name = "FILE")]
    intrinsics: Option<PathBuf>,
    /// Calibration to write
    #[arg(long, value_name = "CALIB.toml")]
    out: PathBuf,
    /// Map to fit
    #[arg(long, default_value = "homography", value_parser = method, value_name = "METHOD")]
    method: Method,
    /// Rig file or built-in name: where the camera stands, thickness of the sheet, tolerance; default: the log's
    #[arg(long, value_name = "RIG")]
    rig: Option<String>,
    /// Medium that the light went through: air, fresh or salt; default: what log or rig say
    #[arg(long, value_parser = medium::from_name, value_name = "MEDIUM")]
    medium: Option<Medium>,
    /// Where the board's middle stood in the sheet [m], turned by [deg]; default: from the rig's mounts
    #[arg(long, value_parser = placement, allow_hyphen_values = true, value_name = "XI,ETA[,DEG]")]
    at: Option<Placement>,
    /// For refractive and --free: entrance pupil to the port's inner face [m]; default: the rig's [port], else 0.03
    #[arg(long, value_parser = inputs::not_negative, value_name = "M")]
    port_distance_m: Option<f64>,
    /// For refractive and --free: thickness of the port [m]; default: the rig's [port], else 0.01
    #[arg(long, value_parser = inputs::not_negative, value_name = "M")]
    port_glass_m: Option<f64>,
    /// Counts a board without gauge blocks as accepted; the claim stays withdrawn
    #[arg(long)]
    accept_unknown_gap: bool,
    /// Topic of the logs' images; default: /camera/image, else the only one with images (of ROS 2 or Foxglove)
    #[arg(long, value_name = "TOPIC")]
    image_topic: Option<String>,
    #[command(flatten)]
    grey: GreyArgs,
    /// Takes every N-th frame of a log
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..), value_name = "N")]
    every: u32,
    /// Leaves a calibration that is no older than its logs and images, and replaces one that is
    #[arg(long, conflicts_with = "force")]
    update: bool,
    /// Older calibration to compare with: drift, or another board or pose; may be repeated
    #[arg(long, value_name = "OLD.toml")]
    against: Vec<PathBuf>,
    /// Writes the first image used with its nodes drawn in (green; red: not found)
    #[arg(long, value_name = "PNG")]
    annotate: Option<PathBuf>,
    /// Prints one JSON object
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    output: Output,
}

pub(super) fn method(name: &str) -> Result<Method, String> {
    Method::from_name(name).ok_or_else(|| {
        let names: Vec<_> = Method::ALL.iter().map(|m| m.name()).collect();
        format!("'{name}' is none of {}", names.join(", "))
    })
}

pub(super) fn placement(text: &str) -> Result<Placement, String> {
    let numbers: Vec<f64> = text
        .split(',')
        .map(|v| v.trim().parse().ok().filter(|v: &f64| v.is_finite()))
        .collect::<Option<_>>()
        .unwrap_or_default();
    let (xi_m, eta_m, turn_deg) = match numbers[..] {
        [xi, eta] => (xi, eta, 0.0),
        [xi, eta, turn] => (xi, eta, turn),
        _ => {
            return Err(format!(
                "'{text}' is not XI,ETA or XI,ETA,DEG, e.g. 0.0,-0.12"
            ));
        }
    };
    if xi_m.abs() > 40.0 || eta_m.abs() > 40.0 {
        return Err(format!("'{text}': metres, within 40 m"));
    }
    Ok(Placement {
        xi_m,
        eta_m,
        turn_rad: turn_deg.to_radians(),
        is_by_rig: false,
    })
}

pub fn run(args: &Args) -> Result<Outcome, CliError> {
    let named = args
        .board
        .as_deref()
        .map(Board::load_or_builtin)
        .transpose()?;
    let old: Vec<(&Path, Calibration)> = args
        .against
        .iter()
        .map(|path| Ok((path.as_path(), Calibration::load(path)?)))
        .collect::<Result<_, CliError>>()?;
    let files = files(&args.inputs)?;
    if args.update && files.iter().all(|f| many::is_up_to_date(&args.out, f)) {
        errln!("hydroline: {}: up to date", args.out.display());
        return Ok(Outcome::Done);
    }
    let output = match args.update {
        true => Output::replacing(true),
        false => args.output,
    };
    output.file("--out", &args.out)?;
    if let Some(path) = &args.annotate {
        output.file("--annotate", path)?;
    }
    let sources = collect::sources(&files)?;
    let (rig, medium) = circumstances(args, &sources)?;
    let Some(board) = named.or_else(|| rig.as_ref().and_then(|r| r.board.clone())) else {
        return Err(CliError::Config(
            "no board: give --board (dots-50, wc-lines-50, chess-25, charuco-25 or a file), or --rig with a [board]"
                .to_owned(),
        ));
    };
    let setup = Setup::new(board, medium, rig);
    let setup = Setup {
        method: args.method,
        at: args.at,
        port: FlatPort {
            distance_m: args.port_distance_m.unwrap_or(setup.port.distance_m),
            glass_m: args.port_glass_m.unwrap_or(setup.port.glass_m),
        },
        frames: 1,
        accept_unknown_gap: args.accept_unknown_gap,
        ..setup
    };
    if let Some(rig) = &setup.rig {
        let image = ImageSize::of(&rig.camera);
        for (path, old) in &old {
            old.check_image(image)
                .map_err(|e| CliError::Config(format!("--against {}: {e}", path.display())))?;
        }
    }
    let rule = setup
        .rig
        .as_ref()
        .map_or_else(GreyRule::default, Rig::grey_rule);
    let reading = collect::Reading {
        every: args.every,
        image_topic: args.image_topic.as_deref(),
        rule: args.grey.over(rule),
    };
    if args.free {
        return free::run(args, output, &setup, &sources, &reading, &old);
    }
    let collected = collect::collect(&setup, &sources, &reading)?;
    finish(args, output, &setup, &collected, &old)
}

/// Files named, images of folders, and logs of folders without images.
fn files(inputs: &[PathBuf]) -> Result<Vec<PathBuf>, CliError> {
    let has_images = |folder: &Path| ImageFolder::open(folder).is_ok();
    let many = Many::but(inputs, many::LOG, has_images)?;
    images::files(&many.logs)
}

/// Rig and medium, from the arguments, else from the first log.
fn circumstances(args: &Args, sources: &[Source]) -> Result<(Option<Rig>, Medium), CliError> {
    let mut rig = args.rig.as_deref().map(inputs::rig).transpose()?;
    let mut medium = args.medium;
    let mut logs = sources.iter().filter_map(|s| match s {
        Source::Log(path) => Some((path, LogReader::open(path))),
        Source::Image(_) => None,
    });
    // Of several logs the first that can be read speaks.
    let first = match sources {
        [_] => logs.next(),
        _ => logs.find(|(_, reader)| reader.is_ok()),
    };
    if let Some((path, reader)) = first {
        let reader = reader?;
        if rig.is_none()
            && let Some(text) = reader.rig_toml()
        {
            let name = format!("rig in {}", path.display());
            rig = Some(Rig::from_toml(text, &name, None)?);
        }
        medium = medium.or_else(|| medium::of_log(reader.metadata().get("session"), rig.as_ref()));
    }
    let medium = medium.or_else(|| rig.as_ref().map(medium::of_rig));
    let medium = medium.unwrap_or_else(|| {
        errln!(
            "hydroline: nobody said what the light went through: air is assumed; --medium fresh or salt says otherwise"
        );
        Medium::Air
    });
    Ok((rig, medium))
}

/// Fits, compares, writes and reports.
fn finish(
    args: &Args,
    output: Output,
    setup: &Setup,
    collected: &Collected,
    old: &[(&Path, Calibration)],
) -> Result<Outcome, CliError> {
    let poses = &collected.poses;
    let Some(best) = poses.best() else {
        if collected.unreadable_images > 0 && collected.unreadable_images == collected.looked {
            return Err(CliError::Config(format!(
                "none of the {} given files is an image or a log; name PNG or JPEG images of the board, or a log (.mcap)",
                collected.looked
            )));
        }
        return Err(CliError::Run(format!(
            "no board '{}' in {} images{}; is it this board (--board), whole in the picture, sharp and lit?",
            setup.board.name,
            collected.looked,
            collected.reasons()
        )));
    };
    let at_ns = collected
        .last_ns
        .unwrap_or_else(|| SystemClock.triple().realtime_ns);
    let date = rfc3339(at_ns);
    let (Some((calibration, placed_by)), Some(status)) = (
        poses.poses[best].calibration(setup, date.clone()),
        poses.poses[best].status(),
    ) else {
        let missing = poses.poses[best]
            .status()
            .map(|s| s.missing.join("; "))
            .unwrap_or_default();
        return Err(CliError::Run(format!(
            "the nodes make no {} map: {missing}",
            setup.method.name()
        )));
    };
    let others = (0..poses.poses.len()).filter(|&k| k != best).map(|k| {
        let other = poses.poses[k].calibration(setup, date.clone());
        Against {
            name: format!("pose {} of the board", k + 1),
            made: String::new(),
            as_is: None,
            // Two poses hang at two places: only their shapes can be compared.
            aligned: other.and_then(|(other, _)| compare(&calibration, &other, true)),
        }
    });
    let mut against: Vec<Against> = others.collect();
    against.extend(old.iter().map(|(path, old)| Against {
        name: path.display().to_string(),
        made: report::provenance(old),
        as_is: compare(old, &calibration, false),
        aligned: compare(old, &calibration, true),
    }));
    let report = Report {
        out: &args.out,
        setup,
        collected,
        best,
        calibration: &calibration,
        placed_by,
        status,
        against: &against,
    };
    output.write(&args.out, report.file()?)?;
    let apart = report.apart();
    if report.is_accepted() {
        Memory::of_user().keep_and_say(setup.rig.as_ref(), &calibration);
    } else if status.accepted {
        errln!(
            "hydroline: the calibration is not remembered: it is off from {} by more than is allowed",
            apart.join(", ")
        );
    }
    if let (Some(path), Some(image)) = (&args.annotate, collected.shown.get(best)) {
        output.image(path, picture::annotate(setup, image, &calibration))?;
    }
    if args.json {
        print::json(&json::Printed::of(&report))?;
    } else {
        out!("{report}");
    }
    if collected.lost_frames > 0 {
        errln!(
            "hydroline: {} of {} frames and images cannot be read and were left out",
            collected.lost_frames,
            collected.looked
        );
    }
    Ok(Outcome::of(
        collected.refused_images > 0 || collected.lost_frames > 0 || !apart.is_empty(),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_read_as_people_write_them() {
        let p = placement("0.01, -0.12,3").unwrap();
        assert_eq!((p.xi_m, p.eta_m), (0.01, -0.12));
        assert!((p.turn_rad - 3f64.to_radians()).abs() < 1e-15);
        for bad in ["", "1", "1,2,3,4", "a,b", "nan,0", "100,0"] {
            assert!(placement(bad).is_err(), "{bad}");
        }
        assert!(method("graticula").unwrap_err().contains("graticule"));
    }
}
