//! `hydroline calibrate --free`: boards held in the hand, with the laser line across them.

use super::collect::{Reading, Source};
use super::{Args, CliError, Outcome, Output, report};
use crate::print::{errln, outln};
use crate::remembered::Memory;
use crate::{images, progress};
use hydroline_calib::calibration::board_map::Placement;
use hydroline_calib::calibration::compare::compare;
use hydroline_calib::calibration::{Calibration, MapParameters};
use hydroline_calib::detect::{Grey, detect_in_hand, find_line};
use hydroline_calib::free::camera::{MEDIUM, PORT, Plate};
use hydroline_calib::free::intrinsics::Intrinsics;
use hydroline_calib::free::{self, CameraPrior, Fitted, FreeOptions, Reservation, Seen, SheetMap};
use hydroline_calib::map::refractive::Known;
use hydroline_calib::{ImageSize, Medium};
use hydroline_core::clock::{Clock, SystemClock};
use hydroline_core::frame::{Frame, GreyImage};
use hydroline_daemon::calibrate::{Setup, medium, rfc3339};
use hydroline_log::{LogReader, Record};
use hydroline_numerics::{cancel, parallel};
use hydroline_rigs::bounded;
use std::path::Path;

/// Images looked at together.
const BATCH: usize = 16;
/// Acrylic.
const N_GLASS: f64 = 1.49;
/// A port's distance from the pupil that somebody measured from outside is good to this share.
const PORT_SD: f64 = 0.15;

/// Boards seen, and where they come from.
#[derive(Default)]
struct Boards {
    seen: Vec<Seen>,
    size: Option<ImageSize>,
    looked: usize,
    refused: usize,
    last_ns: Option<u64>,
}

impl Boards {
    fn take(&mut self, name: &str, looked: Result<(ImageSize, Seen), String>) {
        self.looked += 1;
        let sized = looked.and_then(|(size, seen)| {
            let first = *self.size.get_or_insert(size);
            if first == size {
                return Ok(seen);
            }
            Err(format!(
                "it has {} x {} px, the first image with a board has {} x {}: another size or crop is another camera",
                size.width_px, size.height_px, first.width_px, first.height_px
            ))
        });
        match sized {
            Ok(seen) => {
                if let Some(why) = &seen.no_line {
                    errln!("hydroline: {name}: its board is used, its line is not: {why}");
                }
                self.seen.push(seen);
            }
            Err(why) => {
                errln!("hydroline: {name}: left out: {why}");
                self.refused += 1;
            }
        }
    }
}

fn look(setup: &Setup, name: &str, image: &GreyImage) -> Result<(ImageSize, Seen), String> {
    let size = ImageSize {
        width_px: image.width_px as u32,
        height_px: image.height_px as u32,
    };
    let grey = Grey::new(image.width_px, image.height_px, &image.pixels)
        .ok_or_else(|| "the image is not whole".to_owned())?;
    let found = detect_in_hand(&grey, &setup.board).map_err(|e| e.to_string())?;
    let line = find_line(&grey, &setup.board, &found);
    Ok((size, Seen::new(name.to_owned(), &setup.board, &found, line)))
}

fn collect(setup: &Setup, sources: &[Source], reading: &Reading<'_>) -> Result<Boards, CliError> {
    let mut boards = Boards::default();
    let bar = progress::bar(sources.len() as u64, "files");
    let mut files: Vec<&Path> = Vec::new();
    let flush = |files: &mut Vec<&Path>, boards: &mut Boards| {
        let looked = parallel::map_slice(files, |path| {
            cancel::check();
            let image = images::load(path, &reading.rule).map_err(|e| e.to_string())?;
            look(setup, &path.display().to_string(), &image)
        });
        for (path, looked) in files.drain(..).zip(looked) {
            bar.suspend(|| boards.take(&path.display().to_string(), looked));
            bar.inc(1);
        }
    };
    for source in sources {
        match source {
            Source::Image(path) => files.push(path),
            Source::Log(path) => {
                flush(&mut files, &mut boards);
                log(setup, path, reading, &mut boards)?;
                bar.inc(1);
            }
        }
        if files.len() == BATCH {
            flush(&mut files, &mut boards);
        }
    }
    flush(&mut files, &mut boards);
    bar.finish_and_clear();
    Ok(boards)
}

/// Boards of a log's frames; a frame without one is the rule, and is not named.
fn log(
    setup: &Setup,
    path: &Path,
    reading: &Reading<'_>,
    boards: &mut Boards,
) -> Result<(), CliError> {
    let topic = images::topic(path, reading.image_topic)?;
    let mut frames: Vec<(u64, Frame)> = Vec::new();
    let mut index = 0u64;
    let flush = |frames: &mut Vec<(u64, Frame)>, boards: &mut Boards| {
        let looked = parallel::map_slice(frames, |(k, frame)| {
            cancel::check();
            let name = format!("{} frame {k}", path.display());
            let grey = frame.to_grey(&reading.rule).map_err(|e| e.to_string());
            (name.clone(), grey.and_then(|g| look(setup, &name, &g)))
        });
        for ((_, frame), (name, looked)) in frames.drain(..).zip(looked) {
            match looked {
                Ok(found) => {
                    boards.last_ns = boards.last_ns.max(Some(frame.meta.mid_exposure_ns));
                    boards.take(&name, Ok(found));
                }
                Err(_) => boards.looked += 1,
            }
        }
    };
    for message in LogReader::open(path)?.with_images_of(topic.as_deref()) {
        if let Record::Frame(frame) = message?.record {
            if index.is_multiple_of(u64::from(reading.every)) && frame.meta.fault.is_none() {
                frames.push((index, frame));
            }
            index += 1;
            if frames.len() == BATCH {
                flush(&mut frames, boards);
            }
        }
    }
    flush(&mut frames, boards);
    Ok(())
}

/// Prior of the camera: in air nothing but its image's size; in water behind the port that arguments or rig name.
fn prior(args: &Args, setup: &Setup, image: ImageSize) -> CameraPrior {
    let prior = CameraPrior::unknown(image, medium::index(setup.medium));
    let named = args.port_distance_m.is_some()
        || args.port_glass_m.is_some()
        || setup.rig.as_ref().is_some_and(|r| r.port.is_some());
    if setup.medium == Medium::Air && !named {
        return prior;
    }
    let plate = Plate {
        glass_m: setup.port.glass_m,
        n_glass: N_GLASS,
    };
    let sd = if named { PORT_SD } else { 0.5 };
    prior.behind(
        plate,
        Known::new(setup.port.distance_m, sd * setup.port.distance_m),
    )
}

/// Largest standard deviation over the sheet \[m\].
fn worst_sd_m(map: &SheetMap, image: ImageSize) -> f64 {
    let mut worst = 0.0f64;
    for r in (0..image.height_px).step_by((image.height_px as usize / 24).max(1)) {
        for c in (0..image.width_px).step_by((image.width_px as usize / 24).max(1)) {
            if let Some(p) = map.to_plane(f64::from(c), f64::from(r)) {
                let c = p.covariance_m2;
                worst = worst.max(c[(0, 0)].max(c[(1, 1)]).sqrt());
            }
        }
    }
    worst
}

/// The sheet's coordinates as the rig counts them: its camera stands at ξ = 0, η_c.
fn placement(setup: &Setup, map: &SheetMap) -> Placement {
    let Some(rig) = &setup.rig else {
        return Placement::default();
    };
    let [xi, eta] = map.camera_m();
    Placement {
        xi_m: -xi,
        eta_m: rig.mounts.h_centre_m - rig.mounts.h_camera_m - eta,
        turn_rad: 0.0,
        is_by_rig: false,
    }
}

pub fn run(
    args: &Args,
    output: Output,
    setup: &Setup,
    sources: &[Source],
    reading: &Reading<'_>,
    old: &[(&Path, Calibration)],
) -> Result<Outcome, CliError> {
    let boards = collect(setup, sources, reading)?;
    let Some(image) = boards.size else {
        return Err(CliError::Run(format!(
            "no board '{}' in {} images; is it this board (--board), sharp and lit?",
            setup.board.name, boards.looked
        )));
    };
    let mut camera = prior(args, setup, image);
    if let Some(path) = &args.intrinsics {
        let config = |e: String| CliError::Config(format!("--intrinsics {}: {e}", path.display()));
        let text =
            bounded::read_text(path, bounded::RESULT_BYTES).map_err(|e| config(e.to_string()))?;
        camera = Intrinsics::parse(&text)
            .and_then(|read| read.over(camera, image))
            .map_err(|e| config(e.to_string()))?;
    }
    let options = FreeOptions::new(image, camera);
    let fitted =
        free::calibrate(&boards.seen, &options).map_err(|e| CliError::Run(e.to_string()))?;
    let worst_m = worst_sd_m(&fitted.map, image);
    let mut missing = Vec::new();
    if worst_m > setup.tolerance_m() {
        missing.push(format!(
            "the map is known to {:.2} mm where it is worst, {:.2} mm are allowed: more boards, nearer to where that is",
            1e3 * worst_m,
            1e3 * setup.tolerance_m()
        ));
    }
    let at_ns = boards
        .last_ns
        .unwrap_or_else(|| SystemClock.triple().realtime_ns);
    let calibration = Calibration {
        medium: setup.medium,
        date: Some(rfc3339(at_ns)),
        board: Some(setup.board.name.clone()),
        missing,
        image: Some(image),
        residuals: None,
        placement: Some(placement(setup, &fitted.map)),
        coplanarity: None,
        map: MapParameters::Free(Box::new(fitted.map.clone())),
        nodes: Vec::new(),
    };
    let text = calibration.to_toml()?;
    let head = report::provenance(&calibration);
    output.write(
        &args.out,
        format!(
            "# hydroline calibration: {head}\n# {}\n{text}",
            calibration.claim()
        ),
    )?;
    say(&boards, &fitted, setup, worst_m);
    let mut apart = false;
    for (path, old) in old {
        // Each counts its coordinates from its own zero.
        match compare(old, &calibration, true) {
            Some(found) => {
                apart |= found.drifted() && found.max_m > setup.tolerance_m();
                outln!(
                    "against {}, shifted and turned to fit: {}",
                    path.display(),
                    found.words()
                );
            }
            None => outln!(
                "against {}: nothing to compare, they share fewer than 10 points",
                path.display()
            ),
        }
    }
    for words in &calibration.missing {
        outln!("not accepted, missing: {words}");
    }
    if calibration.missing.is_empty() && !apart {
        outln!("accepted: nothing is missing");
        Memory::of_user().keep_and_say(setup.rig.as_ref(), &calibration);
    }
    outln!("{}", args.out.display());
    let left_out = fitted.views.iter().any(|v| v.left_out.is_some());
    Ok(Outcome::of(boards.refused > 0 || left_out || apart))
}

/// The report.
fn say(boards: &Boards, fitted: &Fitted, setup: &Setup, worst_m: f64) {
    let map = &fitted.map;
    let sd = |k: usize| map.covariance()[(k, k)].max(0.0).sqrt();
    let lines = fitted.views.iter().filter(|v| !v.line.is_empty()).count();
    outln!(
        "board {}: in {} of {} images, the line on {lines} of them",
        setup.board.name,
        boards.seen.len(),
        boards.looked
    );
    for view in &fitted.views {
        if let Some(why) = &view.left_out {
            outln!("left out: {}: {why}", view.name);
        }
    }
    let n = map.lens.numbers;
    outln!(
        "camera: focal length {:.2} ± {:.2} px, principal point {:.2} ± {:.2}, {:.2} ± {:.2} px; fitted: {}",
        n[0],
        sd(0),
        n[2],
        sd(2),
        n[3],
        sd(3),
        fitted.terms.join(", ")
    );
    if map.lens.plate.is_some() {
        outln!(
            "port: {:.1} ± {:.1} mm from the pupil, index of the medium {:.4} ± {:.4}",
            1e3 * n[PORT],
            1e3 * sd(PORT),
            n[MEDIUM],
            sd(MEDIUM)
        );
    }
    outln!(
        "nodes: {:.3} px rms; line: {:.3} px, {:.3} mm from the sheet rms{}",
        fitted.rms_px,
        fitted.line_px,
        1e3 * fitted.line_m,
        if map.is_cone() {
            ", which departs from a plane"
        } else {
            ""
        }
    );
    if let Some(h) = &fitted.held {
        outln!(
            "{} boards held out and predicted: nodes {:.3} px, line {:.3} px, {:.3} mm from the sheet rms",
            h.boards,
            h.rms_px,
            h.line_px,
            1e3 * h.line_m
        );
    }
    outln!(
        "map's own uncertainty: {:.3} mm where it is worst, {:.2} mm allowed",
        1e3 * worst_m,
        1e3 * setup.tolerance_m()
    );
    for reservation in &fitted.reservations {
        outln!("note: {reservation}");
    }
    let pitch_m = setup.board.pitch_m;
    outln!("note: {}", Reservation::Scale { pitch_m });
}
