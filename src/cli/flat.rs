//! `hydroline flat`: the camera's response from an exposure series of its own.

use super::images::{self, GreyArgs};
use super::output::Output;
use super::print::{self, errln, out};
use super::{CliError, Outcome, inputs, progress};
use hydroline_calib::flat::{self, Exposure, Flat};
use hydroline_capture::ImageFolder;
use hydroline_core::frame::{GreyImage, GreyRule};
use hydroline_log::{LogReader, Record};
use hydroline_rigs::{Rig, StatedResponse};
use schemars::JsonSchema;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Exposure times that differ by less than this share are one.
const SAME_TIME: f64 = 1e-3;
/// Longest exposure time that is believed \[us\].
const LONGEST_US: f64 = 1e8;

#[derive(Debug, clap::Args)]
#[command(after_help = "\
Point the camera at something that stands still and has many brightnesses (a grey card, the empty tank floor, a desk), \
fix it, set exposure, gain and white balance to manual, and record 10 to 20 frames each at 5 to 8 exposure times, each \
twice the one before, from nearly black to partly clipped. One more at the first time at the end shows whether the lamp \
held. Gain and tone controls must be those of the runs. Prints the table [camera.response] of a rig: gamma, black level \
and ceiling with their standard deviations, or says why the frames do not show them.

Examples:
  hydroline flat e1.mcap e2.mcap e4.mcap e8.mcap      # logs say their exposure times
  hydroline flat --exposure-us 500:a/ --exposure-us 1000:b/ --exposure-us 2000:c/ > table.toml
  hydroline flat e*.mcap --dark dark.mcap --rig my.toml --write-rig measured.toml

Exit codes: 0 done; 1 the frames show no curve (light, scene or gain changed; a curve that is no power; too little between \
black and clipped); 2 bad arguments, a log or folder that cannot be read, too few exposures or frames; 3 done, but some \
frames cannot be read and were left out.")]
pub struct Args {
    /// Logs of the series; each frame's exposure time is as the log states it
    #[arg(value_name = "LOG", required_unless_present = "exposure_us")]
    logs: Vec<PathBuf>,
    /// A log or folder of images at this exposure time, in microseconds; give it once for each
    #[arg(long, value_name = "US:LOG|FOLDER", value_parser = timed, allow_hyphen_values = true)]
    exposure_us: Vec<(f64, PathBuf)>,
    /// A log or folder of images with the lens covered
    #[arg(long, value_name = "LOG|FOLDER")]
    dark: Option<PathBuf>,
    /// Rig file or built-in name: how grey levels are read (laser.channel, camera.bits), and what --write-rig starts from
    #[arg(long, value_name = "RIG")]
    rig: Option<String>,
    /// Writes the rig with this response as a new rig file here
    #[arg(long, value_name = "FILE", requires = "rig")]
    write_rig: Option<PathBuf>,
    /// Topic of the images in logs that others wrote; default: the only one there is
    #[arg(long, value_name = "TOPIC")]
    image_topic: Option<String>,
    /// Prints one JSON object with all figures
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    grey: GreyArgs,
    #[command(flatten)]
    output: Output,
}

/// `500:PATH`.
fn timed(text: &str) -> Result<(f64, PathBuf), String> {
    let parts = text.split_once(':').filter(|(_, path)| !path.is_empty());
    let (time, path) = parts.ok_or_else(|| {
        format!("'{text}' is not US:PATH; write the exposure time in microseconds before the path, as in 500:dim/")
    })?;
    match time.parse::<f64>() {
        Ok(us) if us > 0.0 && us <= LONGEST_US => Ok((us, PathBuf::from(path))),
        _ => Err(format!(
            "'{time}' is not an exposure time above 0 and up to {LONGEST_US} us"
        )),
    }
}

pub fn run(args: &Args) -> Result<Outcome, CliError> {
    let rig = args.rig.as_deref().map(inputs::rig).transpose()?;
    if let Some(path) = &args.write_rig {
        args.output.file("--write-rig", path)?;
    }
    let given = args.exposure_us.iter().map(|(_, path)| path);
    let all: Vec<&PathBuf> = args.logs.iter().chain(given).chain(&args.dark).collect();
    for (k, path) in all.iter().enumerate() {
        if all[..k].contains(path) {
            return Err(CliError::Config(format!(
                "{}: given twice: counted twice its noise would look like light; give each log or folder once",
                path.display()
            )));
        }
        if path.is_dir() {
            ImageFolder::open(path)?;
        } else {
            inputs::readable_file(path, "name a log (.mcap) with images, or a folder of them")?;
            LogReader::open(path)?;
        }
    }
    let mut series = Series {
        args,
        rig: rig.as_ref(),
        exposures: Vec::new(),
        lost: 0,
        bar: progress::bar(0, "frames"),
    };
    let exposures = series.exposures();
    series.bar.finish_and_clear();
    let dark = exposures?;
    let Series {
        exposures, lost, ..
    } = series;
    let found = flat::response(&exposures, dark.as_ref(), &flat::Options::default())?;
    for remark in &found.remarks {
        errln!("hydroline: {remark}");
    }
    let stated = found.stated(source(&exposures));
    print_found(&exposures, &found);
    if args.json {
        print::json(&printed(&exposures, &found, &stated))?;
    } else {
        out!("{}", stated.to_toml());
    }
    if let (Some(path), Some(mut rig)) = (&args.write_rig, rig) {
        rig.camera.response = Some(stated);
        args.output.write(path, rig.to_toml())?;
        errln!("{}", path.display());
    }
    if lost > 0 {
        errln!("hydroline: {lost} frames cannot be read and were left out");
        return Ok(Outcome::Lossy);
    }
    Ok(Outcome::Done)
}

/// The frames as they are gathered.
struct Series<'a> {
    args: &'a Args,
    rig: Option<&'a Rig>,
    exposures: Vec<Exposure>,
    lost: usize,
    bar: indicatif::ProgressBar,
}

impl Series<'_> {
    /// All exposures; returns the dark frames.
    fn exposures(&mut self) -> Result<Option<Exposure>, CliError> {
        let args = self.args;
        for (us, path) in &args.exposure_us {
            let mut exposure = Exposure::new(format!("{us} us ({})", path.display()), us * 1e-6);
            self.read(path, &mut |_, image| Ok(add(&mut exposure, image)?))?;
            self.exposures.push(exposure);
        }
        for path in &args.logs {
            if path.is_dir() {
                return Err(CliError::Config(format!(
                    "{0}: a folder does not say its exposure time: give --exposure-us US:{0}",
                    path.display()
                )));
            }
            // A log is one exposure for each time that its frames state.
            let mut own: Vec<Exposure> = Vec::new();
            self.read(path, &mut |time_s, image| {
                if time_s.is_nan() || time_s <= 0.0 {
                    return Err(CliError::Config(format!(
                        "{0}: its frames do not state their exposure time: give --exposure-us US:{0}",
                        path.display()
                    )));
                }
                let same = |e: &Exposure| (e.time_s / time_s - 1.0).abs() < SAME_TIME;
                let at = own.iter().position(same).unwrap_or_else(|| {
                    let name = format!("{:.6} us ({})", time_s * 1e6, path.display());
                    own.push(Exposure::new(name, time_s));
                    own.len() - 1
                });
                Ok(add(&mut own[at], image)?)
            })?;
            self.exposures.append(&mut own);
        }
        let Some(path) = &args.dark else {
            return Ok(None);
        };
        let mut dark = Exposure::new(format!("dark ({})", path.display()), 0.0);
        self.read(path, &mut |_, image| Ok(add(&mut dark, image)?))?;
        Ok(Some(dark))
    }

    /// The sound frames of a log or folder, each with the exposure time that it states \[s\].
    fn read(
        &mut self,
        path: &Path,
        take: &mut dyn FnMut(f64, &GreyImage) -> Result<(), CliError>,
    ) -> Result<(), CliError> {
        let of_rig = self.rig.map(Rig::grey_rule);
        if path.is_dir() {
            let rule = self.args.grey.over(of_rig.unwrap_or_default());
            for file in images::files(&[path.to_owned()])? {
                self.bar.inc(1);
                match images::load(&file, &rule) {
                    Ok(image) => take(f64::NAN, &image)?,
                    Err(error) => self.leave(&file, &error.to_string()),
                }
            }
            return Ok(());
        }
        let topic = images::topic(path, self.args.image_topic.as_deref())?;
        let reader = LogReader::open(path)?;
        let rule: GreyRule = self
            .args
            .grey
            .over(of_rig.unwrap_or_else(|| reader.grey_rule()));
        let mut frames = 0;
        for message in reader.with_images_of(topic.as_deref()) {
            let Record::Frame(frame) = message?.record else {
                continue;
            };
            self.bar.inc(1);
            frames += 1;
            if frame.meta.fault.is_some() {
                continue;
            }
            match frame.to_grey(&rule) {
                Ok(image) => take(frame.meta.exposure_s, &image)?,
                Err(error) => self.leave(path, &error.to_string()),
            }
        }
        if frames == 0 {
            return Err(CliError::Config(format!(
                "{}: holds no image; name a log with images (`hydroline info` shows what is in it)",
                path.display()
            )));
        }
        Ok(())
    }

    fn leave(&mut self, path: &Path, words: &str) {
        errln!("hydroline: {}: {words}", path.display());
        self.lost += 1;
    }
}

fn add(exposure: &mut Exposure, image: &GreyImage) -> Result<(), flat::FlatError> {
    exposure.add(&image.pixels, image.width_px, image.height_px)
}

/// Where the numbers come from.
fn source(exposures: &[Exposure]) -> String {
    let times_us = exposures.iter().map(|e| e.time_s * 1e6);
    let least = times_us.clone().fold(f64::INFINITY, f64::min);
    let most = times_us.fold(0.0, f64::max);
    let frames: usize = exposures.iter().map(Exposure::frames).sum();
    format!(
        "hydroline flat: {} exposures of {least:.0} to {most:.0} us, {frames} frames",
        exposures.len()
    )
}

fn print_found(exposures: &[Exposure], found: &Flat) {
    let [gamma, gamma_sd] = found.gamma;
    let [black, black_sd] = found.black_levels;
    errln!(
        "gamma {gamma:.4} (sd {gamma_sd:.4}), black level {black:.2} (sd {black_sd:.2}), from {} exposures, {} places of the picture, levels {:.0} to {:.0}",
        exposures.len(),
        found.blocks[0],
        found.levels[0],
        found.levels[1]
    );
    let d = &found.deviation;
    errln!(
        "a power of light fits to {:.3} grey levels rms, to {:+.3} at {:.0} (chi2 {:.0} of {:.0}); places about it: chi2 {:.2} per degree of freedom",
        d.rms_levels,
        d.most_levels,
        d.at_levels,
        d.chi2[0],
        d.chi2[1],
        found.chi2
    );
    errln!(
        "the exposures' light scatters by {:.2} % about their times",
        100.0 * found.scatter
    );
    if found.blocks[1] > 0 {
        errln!(
            "{} places changed between exposures and were left out",
            found.blocks[1]
        );
    }
}

/// Output of `--json`.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct Printed<'a> {
    /// γ of g = b + 255 (L/255)^γ, and its standard deviation.
    gamma: [f64; 2],
    /// Black level b, and its standard deviation \[grey levels\].
    black_levels: [f64; 2],
    /// Correlation of γ and b.
    gamma_black_correlation: f64,
    /// Level from which on light is clipped; `None` = none is \[grey levels\].
    ceiling_levels: Option<u8>,
    /// Levels between which the curve was looked at \[grey levels\].
    levels: [f64; 2],
    /// Smooth deviation of the levels from the curve.
    deviation: flat::Deviation,
    /// Scatter of the exposures about their times, as a share of the light.
    scatter_share: f64,
    /// χ² per degree of freedom of the places about the curve.
    chi2_per_freedom: f64,
    /// Places (blocks of pixels) used, and those discarded since they changed between exposures.
    places: [usize; 2],
    /// The exposures in the order given.
    exposures: Vec<PrintedExposure<'a>>,
    /// Remarks on the result for a person.
    remarks: &'a [String],
    /// The table `[camera.response]` for the rig file.
    toml: String,
}

/// An exposure.
#[derive(Debug, Serialize, JsonSchema)]
struct PrintedExposure<'a> {
    /// Name, as it was given.
    name: &'a str,
    /// Exposure time \[us\].
    exposure_us: f64,
    /// Number of frames.
    frames: usize,
    /// Share by which it is brighter than its time says; `None` = it was not used.
    light_off_share: Option<f64>,
}

fn printed<'a>(exposures: &'a [Exposure], found: &'a Flat, stated: &StatedResponse) -> Printed<'a> {
    let exposure = |e: &'a Exposure| PrintedExposure {
        name: &e.name,
        exposure_us: e.time_s * 1e6,
        frames: e.frames(),
        light_off_share: found
            .off_times
            .iter()
            .find(|(name, _)| *name == e.name)
            .map(|(_, share)| *share),
    };
    Printed {
        gamma: found.gamma,
        black_levels: found.black_levels,
        gamma_black_correlation: found.correlation,
        ceiling_levels: found.ceiling_levels,
        levels: found.levels,
        deviation: found.deviation,
        scatter_share: found.scatter,
        chi2_per_freedom: found.chi2,
        places: found.blocks,
        exposures: exposures.iter().map(exposure).collect(),
        remarks: &found.remarks,
        toml: stated.to_toml(),
    }
}
