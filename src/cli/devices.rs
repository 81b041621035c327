//! `hydroline devices`: cameras and serial ports by stable id, and what stands in the way.

use super::print::{self, outln};
use super::{CliError, Outcome};
use hydroline_capture::devices::{CameraListing, cameras, formats};
use hydroline_thruster::ports::{Port, Roots};
use schemars::JsonSchema;
use serde::Serialize;
use std::path::Path;

#[derive(Debug, clap::Args)]
#[command(after_help = "\
Put the printed 'device' or 'port' line into the rig file. Names under by-id follow the device from socket to socket; \
by-path follows the socket; /dev/videoN and /dev/ttyUSBN follow nothing.

Examples:
  hydroline devices
  hydroline devices --long    # every format, size, rate and control of each camera

Video nodes that are no camera, or offer no format that is read, are listed with the reason.")]
pub struct Args {
    /// Prints one JSON object
    #[arg(long)]
    json: bool,
    /// Also every format, size and rate, and every control
    #[arg(long)]
    long: bool,
}

/// Output of `--json`.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct Listed<'a> {
    /// Cameras, and nodes that look like one.
    cameras: &'a [CameraListing],
    /// Serial ports.
    serial: &'a [Port],
}

pub fn run(args: &Args) -> Result<Outcome, CliError> {
    let cameras = cameras();
    let ports = Roots::default().ports();
    if args.json {
        print::json(&Listed {
            cameras: &cameras,
            serial: &ports,
        })?;
        return Ok(Outcome::Done);
    }
    if !cameras.iter().any(|camera| camera.no_camera.is_empty()) {
        outln!("no camera; plug one in, or use backend = \"sim\"");
    }
    for camera in &cameras {
        print_camera(camera, args.long);
    }
    if ports.is_empty() {
        outln!("no serial port; plug the controller in, or use port = \"sim\"");
    }
    for port in &ports {
        print_port(port);
    }
    Ok(Outcome::Done)
}

fn print_camera(camera: &CameraListing, long: bool) {
    let known = [
        camera.card.clone(),
        prefixed("driver ", &camera.driver),
        camera.bus_info.clone(),
    ];
    let known: Vec<String> = known.into_iter().filter(|word| !word.is_empty()).collect();
    let (node, known) = (camera.node.display(), known.join(", "));
    if !camera.no_camera.is_empty() {
        outln!("no camera {node} ({known})");
        outln!("  {}", camera.no_camera);
        return;
    }
    outln!("camera {node} ({known})");
    for (folder, names) in [("by-id", &camera.by_id), ("by-path", &camera.by_path)] {
        for name in names {
            outln!(
                "  device = \"{}\"",
                Path::new("/dev/v4l").join(folder).join(name).display()
            );
        }
    }
    if !camera.problem.is_empty() {
        outln!("  PROBLEM: {}", camera.problem);
    }
    let (read, unread) = formats(&camera.offers);
    if !read.is_empty() {
        let unread = prefixed("; not read: ", &unread.join(", "));
        outln!("  pixel_format: {}{unread}", read.join(", "));
    }
    if long {
        for offer in &camera.offers {
            outln!("  {offer}");
        }
        for control in &camera.controls {
            let value = control
                .value
                .map_or_else(|| "-".to_owned(), |v| v.to_string());
            outln!(
                "  {} = {value} ({} .. {} step {}, default {})",
                control.name,
                control.min,
                control.max,
                control.step,
                control.default
            );
        }
    }
}

/// A word behind a prefix, or nothing.
fn prefixed(prefix: &str, word: &str) -> String {
    if word.is_empty() {
        String::new()
    } else {
        format!("{prefix}{word}")
    }
}

/// Description and driver, as far as they are known: a port on the board has no description.
fn serial_words(port: &Port) -> String {
    let driver = match port.driver.as_str() {
        // Since Linux 6.5 a port of the serial core stands between the node and its driver.
        "" | "port" => None,
        driver => Some(format!("driver {driver}")),
    };
    let description = Some(port.description.clone()).filter(|d| !d.is_empty());
    let words: Vec<String> = [description, driver].into_iter().flatten().collect();
    if words.is_empty() {
        "on the board".to_owned()
    } else {
        words.join(", ")
    }
}

fn print_port(port: &Port) {
    outln!("serial {} ({})", port.node.display(), serial_words(port));
    for (folder, name) in [("by-id", &port.by_id), ("by-path", &port.by_path)] {
        if let Some(name) = name {
            outln!(
                "  port = \"{}\"",
                Path::new("/dev/serial").join(folder).join(name).display()
            );
        }
    }
    if let Some(problem) = &port.problem {
        outln!("  PROBLEM: {problem}");
    }
}
