//! `hydroline extract`: stripe points of single images.

use super::images::{self, GreyArgs};
use super::output::Output;
use super::print::{self, errln, outln};
use super::{CliError, Outcome, inputs};
use hydroline_core::frame::GreyRule;
use hydroline_stripe::{
    Extractor, ExtractorConfig, Orientation, Profile, StripePoint, annotate, write_csv,
};
use schemars::JsonSchema;
use serde::Serialize;
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  hydroline extract frame.png
  hydroline extract frame.png --csv > stripe.csv
  hydroline extract frame.png --annotate stripe.png
  hydroline extract frames/ --csv --channel green    # all of a folder, by the laser's colour

An image whose data are damaged gives no points, not even from its sound part. Of five images and more of one camera, what \
looks like damage at the same place of a tenth of them is taken for the picture (text over it), and said.

Exit codes: 0 done; 2 bad arguments, an image that is not there, or none that is one and whole; 3 done, but some of \
the given files are no images, or damaged.")]
pub struct Args {
    /// Images (PNG of 8 or 16 bits, JPEG), or folders of them
    #[arg(required = true, value_name = "IMAGE|FOLDER")]
    images: Vec<PathBuf>,
    /// Prints column_px,row_px,peak,sd_px per point; with several images a block per image,
    /// headed by a '# file' line. Without it a summary line per image
    #[arg(long)]
    csv: bool,
    /// Prints one JSON object with every image's figures and points
    #[arg(long, conflicts_with = "csv")]
    json: bool,
    /// Writes the image with its stripe drawn in (green; yellow near steps, red saturated, blue other candidates) here; one image only
    #[arg(long, value_name = "PNG")]
    annotate: Option<PathBuf>,
    /// The whole-pixel stripe of the paper (central pixel) instead of the sub-pixel one
    #[arg(long)]
    whole_pixel: bool,
    /// Direction of the line: horizontal = one point per column, row_px at sub-pixel; vertical = one
    /// point per row, column_px at sub-pixel (sd_px is of the one at sub-pixel)
    #[arg(long, value_enum, default_value = "horizontal")]
    orientation: LineOrientation,
    #[command(flatten)]
    grey: GreyArgs,
    #[command(flatten)]
    output: Output,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum LineOrientation {
    /// Along the image's rows: one point per column
    Horizontal,
    /// Along the image's columns: one point per row
    Vertical,
}

pub fn run(args: &Args) -> Result<Outcome, CliError> {
    let images = images::files(&args.images)?;
    if args.annotate.is_some() && images.len() > 1 {
        return Err(CliError::Config(
            "--annotate takes one image; name one".to_owned(),
        ));
    }
    if let Some(path) = &args.annotate {
        args.output.file("--annotate", path)?;
    }
    for path in &images {
        inputs::readable_file(path, "name a PNG or JPEG image")?;
    }
    let config = ExtractorConfig {
        whole_pixel: args.whole_pixel,
        orientation: match args.orientation {
            LineOrientation::Horizontal => Orientation::Horizontal,
            LineOrientation::Vertical => Orientation::Vertical,
        },
        ..ExtractorConfig::default()
    };
    let mut extractor = Extractor::new(config);
    let [mut failed, mut damaged] = [0; 2];
    let mut objects = Vec::new();
    let rule = args.grey.over(GreyRule::default());
    let picture = images::picture(&images, &rule);
    for path in &images {
        let image = match images::load_with(path, &rule, &picture) {
            Ok(image) => image,
            Err(words) => {
                errln!("hydroline: {}: {words}", path.display());
                failed += 1;
                damaged += usize::from(words.is_damage());
                continue;
            }
        };
        let profile = extractor.extract(&image);
        if args.json {
            objects.push(object(path, &profile));
        } else if args.csv {
            csv(images.len() > 1, path, &profile).map_err(CliError::run)?;
        } else {
            summary(path, &profile, args.orientation);
        }
        if let Ok(Some(hidden)) = images::hidden(path, &rule) {
            errln!("hydroline: {}: {hidden}; here: --channel", path.display());
        }
        if let Some(fault) = &profile.fault {
            errln!("hydroline: {}: {fault}", path.display());
        }
        if let Some(out) = &args.annotate {
            args.output.image(out, annotate(&image, &profile))?;
        }
    }
    if args.json {
        print::json(&Printed { images: objects })?;
    }
    let given = images.len();
    let others = failed - damaged;
    if others > 0 && failed < given {
        errln!("hydroline: {others} of {given} files are no images and were left out");
    }
    if damaged > 0 {
        errln!("hydroline: {damaged} of {given} images are damaged and were left out");
    }
    match failed {
        0 => Ok(Outcome::Done),
        n if n < given => Ok(Outcome::Lossy),
        _ if damaged > 0 => Err(CliError::Config(
            "no image is whole; take them anew, or copy them again from where they were sound"
                .to_owned(),
        )),
        _ => Err(CliError::Config(
            "no image was given; name PNG or JPEG images (of a log's frames: `hydroline export LOG --frames-only`)"
                .to_owned(),
        )),
    }
}

fn csv(several: bool, path: &Path, profile: &Profile) -> std::io::Result<()> {
    if several {
        outln!("# {}", path.display());
    }
    let mut table = Vec::new();
    write_csv(profile, &mut table)?;
    print::bytes(&table);
    Ok(())
}

/// Output of `--json`.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct Printed {
    /// The images that could be read, in the order given.
    images: Vec<Stripe>,
}

/// The stripe of an image; its lists have one entry per point.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct Stripe {
    /// Path of the image.
    image: PathBuf,
    /// Width of the image \[px\].
    width_px: usize,
    /// Height of the image \[px\].
    height_px: usize,
    /// Noise of the image, standard deviation \[grey levels\].
    noise_sd: f64,
    /// Level of the scattering halo about the line \[grey levels\].
    haze_level: f64,
    /// Why the stripe is not to be trusted, in words; `None` = nothing is known against it.
    fault: Option<String>,
    /// Columns of the points \[px\].
    column_px: Vec<f64>,
    /// Rows of the points \[px\].
    row_px: Vec<f64>,
    /// Peaks over the background \[grey levels\].
    peak: Vec<f64>,
    /// Standard deviations of the place across the line \[px\].
    sd_px: Vec<f64>,
    /// Widths of the line: standard deviation of its cross-section \[px\].
    sigma_px: Vec<f64>,
    /// Flags of the points, as `StripeProfile.quality` in the log has them.
    quality: Vec<u32>,
}

/// One image's figures, and its points as columns of numbers.
pub(super) fn object(path: &Path, profile: &Profile) -> Stripe {
    let column =
        |value: fn(&StripePoint) -> f64| -> Vec<f64> { profile.points.iter().map(value).collect() };
    Stripe {
        image: path.to_owned(),
        width_px: profile.size_px.0,
        height_px: profile.size_px.1,
        noise_sd: profile.noise_sd,
        haze_level: profile.haze_level,
        fault: profile.fault.as_ref().map(ToString::to_string),
        column_px: column(|p| p.column_px),
        row_px: column(|p| p.row_px),
        peak: column(|p| p.peak),
        sd_px: column(|p| p.sd_px),
        sigma_px: column(|p| p.sigma_px),
        quality: profile.points.iter().map(|p| p.quality).collect(),
    }
}

fn summary(path: &Path, profile: &Profile, orientation: LineOrientation) {
    let (columns, across, along) = match orientation {
        LineOrientation::Horizontal => ("columns", "row", profile.size_px.0),
        LineOrientation::Vertical => ("rows", "column", profile.size_px.1),
    };
    let median = |mut values: Vec<f64>| {
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
    };
    outln!(
        "{}: {} points in {along} {columns}, peak {:.0}, width {:.2} px sd, {across} sd {:.3} px, noise {:.1}, haze {:.1} %",
        path.display(),
        profile.points.len(),
        median(profile.points.iter().map(|p| p.peak).collect()),
        median(profile.points.iter().map(|p| p.sigma_px).collect()),
        median(profile.points.iter().map(|p| p.sd_px).collect()),
        profile.noise_sd,
        100.0 * profile.haze_level,
    );
}
