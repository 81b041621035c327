//! Measurements in a log's frames: stripe points, their widths, and where tops end.
//!
//! Everything here is measured in the image and knows no pose, target or effect. Where the log
//! names a calibration, pixels are first brought to where the rig's ideal camera would see the
//! same point of the sheet, so that effects count from the calibration in force.

use hydroline_calib::plane::PlaneMap;
use hydroline_calib::{Calibration, IdealMap};
use hydroline_core::frame::{BlockAccount, FrameFault, GreyImage};
use hydroline_core::run::Command;
use hydroline_identify::data::{LoadError, load_messages};
use hydroline_log::messages::pb;
use hydroline_log::{LogReader, Record};
use hydroline_numerics::cancel;
use hydroline_rigs::Rig;
use hydroline_stripe::{Extractor, ExtractorConfig, Profile, StripePoint, quality};
use std::path::Path;

/// Columns per bin: neighbours share what little the extractor's pooling shares.
const BIN_COLUMNS: usize = 12;
/// Fewest columns of a bin that counts.
const BIN_LEAST: usize = 6;
/// A jump of this many rows, or a gap of this many columns, ends a stretch.
const JUMP_PX: f64 = 3.0;
const GAP_COLUMNS: f64 = 4.5;
/// Rows between two stretches that are two surfaces.
const STEP_PX: f64 = 5.0;
/// Columns about an end over which light is summed.
const END_REACH: i64 = 10;
/// Columns between the ends of two stretches that are one step.
const STEP_GAP_COLUMNS: f64 = 60.0;

/// The mean of neighbouring stripe points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bin {
    /// Mean column \[px\].
    pub column_px: f64,
    /// Mean row \[px\].
    pub row_px: f64,
    /// Its standard deviation by the extractor \[px\].
    pub sd_px: f64,
    /// Mean width (standard deviation of the vertical profile) \[px\].
    pub sigma_px: f64,
    /// Standard deviation of that mean, from the scatter \[px\].
    pub sigma_sd_px: f64,
    /// Rows per column along the stripe.
    pub slope: f64,
}

/// Where a top ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Edge {
    /// Column \[px\].
    pub column_px: f64,
    /// Row on the top \[px\].
    pub row_px: f64,
    /// Standard deviation of the column \[px\].
    pub sd_px: f64,
    /// Rows per column along the stripe.
    pub slope: f64,
    /// The top ends towards greater columns.
    pub to_starboard: bool,
}

/// One frame.
#[derive(Debug, Clone)]
pub struct Seen {
    /// Since the run's first stamp \[s\].
    pub t_s: f64,
    /// The frame.
    pub image: GreyImage,
    /// Its stripe as extracted.
    pub profile: Profile,
    /// Points, binned.
    pub bins: Vec<Bin>,
    /// Ends of tops.
    pub edges: Vec<Edge>,
}

/// Frames of a log that are not among those taken, and why.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct LeftOut {
    /// Frames that the log marks as damaged.
    pub marked: usize,
    /// Frames that nothing marks and that cannot be read, of those that were to be taken.
    pub unread: usize,
    /// Reason of the first of these.
    pub first: Option<String>,
    /// Blocks that look like damage and were taken for the picture, in words; `None` = there are none.
    pub picture: Option<String>,
}

impl LeftOut {
    fn count_unread(&mut self, why: &impl std::fmt::Display) {
        self.unread += 1;
        self.first.get_or_insert_with(|| why.to_string());
    }

    /// Remarks for a person; empty where nothing is left out.
    pub fn words(&self) -> Vec<String> {
        let mut words = Vec::new();
        if self.marked > 0 {
            words.push(format!(
                "{} frames are marked as damaged in the log and left out",
                self.marked
            ));
        }
        if let Some(first) = &self.first {
            words.push(format!(
                "{} frames cannot be read and are left out, the first: {first}",
                self.unread
            ));
        }
        words.extend(self.picture.clone());
        words
    }
}

/// The frames taken of one log.
#[derive(Debug, Clone)]
pub struct ImageRun {
    /// File name.
    pub name: String,
    /// Wrenches commanded.
    pub commands: Vec<Command>,
    /// Frames with a stripe, by time.
    pub frames: Vec<Seen>,
    /// The run's first stamp \[ns, UNIX\].
    pub start_ns: u64,
    /// Frames in the log.
    pub in_log: usize,
    /// Frames without a stripe: (since the run's first stamp \[s\], the frame).
    pub dark: Vec<(f64, GreyImage)>,
    /// Frames that were not taken.
    pub left_out: LeftOut,
    /// The log's own calibration.
    pub(super) calibration: Option<Calibration>,
}

impl ImageRun {
    /// A run of one frame.
    pub(super) fn of_one(seen: &Seen) -> ImageRun {
        ImageRun {
            name: String::new(),
            commands: Vec::new(),
            frames: vec![seen.clone()],
            start_ns: 0,
            in_log: 1,
            dark: Vec::new(),
            left_out: LeftOut::default(),
            calibration: None,
        }
    }

    /// Remarks on frames that were not taken, behind the run's name.
    pub fn remarks(&self) -> Vec<String> {
        let words = self.left_out.words().into_iter();
        words
            .map(|words| format!("{}: {words}", self.name))
            .collect()
    }

    /// The same frames after `change` of each, those without a stripe too, looked at anew.
    pub fn again(
        &self,
        change: &(dyn Fn(f64, &GreyImage, Option<&Seen>) -> GreyImage + Sync),
        rig: &Rig,
    ) -> ImageRun {
        let with = self.frames.iter().map(|s| (s.t_s, &s.image, Some(s)));
        let without = self.dark.iter().map(|(t_s, image)| (*t_s, image, None));
        let mut images: Vec<(f64, GreyImage)> = with
            .chain(without)
            .map(|(t_s, image, seen)| (t_s, change(t_s, image, seen)))
            .collect();
        images.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (frames, dark) = looked_at(images, rig, self.calibration.as_ref());
        ImageRun {
            frames,
            dark,
            ..self.clone()
        }
    }
}

/// Frames with a stripe, and those without; `images` by time \[s\].
fn looked_at(
    images: Vec<(f64, GreyImage)>,
    rig: &Rig,
    calibration: Option<&Calibration>,
) -> (Vec<Seen>, Vec<(f64, GreyImage)>) {
    let mut extractor = Extractor::new(ExtractorConfig::default());
    let ideal = IdealMap::of(rig);
    let map = calibration.map(Calibration::to_map);
    let (mut frames, mut dark) = (Vec::new(), Vec::new());
    for (t_s, image) in images {
        cancel::check();
        let profile = extractor.extract(&image);
        match seen(t_s, image, profile, map.as_deref().map(|m| (m, &ideal))) {
            Ok(seen) => frames.push(seen),
            Err(image) => dark.push((t_s, image)),
        }
    }
    (frames, dark)
}

/// Whether a log holds frames.
///
/// # Errors
/// [`LoadError`].
pub fn has_images(path: &Path) -> Result<bool, LoadError> {
    for message in LogReader::open(path)? {
        if matches!(message?.record, Record::Frame(_)) {
            return Ok(true);
        }
    }
    Ok(false)
}

/// Reads `most` frames spread evenly over a log.
///
/// # Errors
/// [`LoadError`].
pub fn read(path: &Path, rig: &Rig, most: usize) -> Result<ImageRun, LoadError> {
    let name = path.file_stem().map_or_else(
        || path.display().to_string(),
        |s| s.to_string_lossy().into_owned(),
    );
    let (mut in_log, mut left_out) = (0, LeftOut::default());
    for message in LogReader::open(path)? {
        if let Record::Frame(frame) = message?.record {
            in_log += usize::from(frame.meta.fault.is_none());
            let is_damaged = frame.meta.fault.is_some_and(FrameFault::is_damage);
            left_out.marked += usize::from(is_damaged);
        }
    }
    let keep = |k: usize| {
        let n = most.clamp(1, in_log.max(1));
        // The middle of each of n equal parts.
        (k * n) / in_log != ((k + 1) * n) / in_log
    };
    let (mut commands, mut inspected, mut index) = (Vec::new(), Vec::new(), 0);
    let mut blocks = BlockAccount::default();
    let rule = rig.grey_rule();
    let mut reader = LogReader::open(path)?;
    for message in reader.by_ref() {
        match message?.record {
            Record::Command(command) => commands.push(command),
            Record::Frame(frame) if frame.meta.fault.is_none() => {
                if keep(index) {
                    match frame.inspect(&rule) {
                        Ok(image) => {
                            blocks.see(&image.seams);
                            inspected.push((frame.meta.mid_exposure_ns, image));
                        }
                        Err(error) => left_out.count_unread(&error),
                    }
                }
                index += 1;
            }
            _ => {}
        }
    }
    let calibration = reader
        .calibration_toml()
        .and_then(|text| Calibration::from_toml(text, "the log's calibration").ok());
    let picture = blocks.picture();
    left_out.picture = picture.words();
    let mut images = Vec::with_capacity(inspected.len());
    for (stamp_ns, image) in inspected {
        match image.sound(&picture) {
            Ok(image) => images.push((stamp_ns, image)),
            Err(damage) => left_out.count_unread(&format!("damaged JPEG: {damage}")),
        }
    }
    let run = from_images(&name, &commands, images, rig, calibration, in_log)?;
    Ok(ImageRun { left_out, ..run })
}

/// The same from images and commands in memory; `images` by UNIX stamp \[ns\].
///
/// # Errors
/// [`LoadError`].
pub fn from_images(
    name: &str,
    commands: &[pb::ThrusterCommand],
    images: Vec<(u64, GreyImage)>,
    rig: &Rig,
    calibration: Option<Calibration>,
    in_log: usize,
) -> Result<ImageRun, LoadError> {
    // Frames as motion without a value: they only put t = 0 where motion of the same log has it.
    let stamps: Vec<pb::VehicleMotion> = images
        .iter()
        .map(|(ns, _)| pb::VehicleMotion::of_pose(*ns, [None; 6]))
        .collect();
    let run = load_messages(name, commands, &stamps, rig)?;
    let images = (images.into_iter())
        .map(|(ns, image)| (ns.saturating_sub(run.start_ns) as f64 * 1e-9, image))
        .collect();
    let (frames, dark) = looked_at(images, rig, calibration.as_ref());
    Ok(ImageRun {
        name: name.to_owned(),
        commands: run.commands,
        start_ns: run.start_ns,
        frames,
        in_log,
        dark,
        left_out: LeftOut::default(),
        calibration,
    })
}

/// One frame taken apart; the image back without a stripe.
fn seen(
    t_s: f64,
    image: GreyImage,
    profile: Profile,
    map: Option<(&dyn PlaneMap, &IdealMap)>,
) -> Result<Seen, GreyImage> {
    if profile.fault.is_some() {
        return Err(image);
    }
    let stretches = stretches(&profile.points);
    let mut bins: Vec<Bin> = stretches.iter().flat_map(|s| binned(s)).collect();
    let mut edges: Vec<Edge> = stretches
        .windows(2)
        .filter_map(|pair| step(pair, &image))
        .collect();
    if let Some((map, ideal)) = map {
        let to_ideal = |column: f64, row: f64| {
            let p = map.to_plane(column, row)?;
            ideal.to_image(p.xi_m, p.eta_m)
        };
        bins.retain_mut(|b| match to_ideal(b.column_px, b.row_px) {
            Some((c, r)) => {
                (b.column_px, b.row_px) = (c, r);
                true
            }
            None => false,
        });
        edges.retain_mut(|e| match to_ideal(e.column_px, e.row_px) {
            Some((c, r)) => {
                (e.column_px, e.row_px) = (c, r);
                true
            }
            None => false,
        });
    }
    if bins.len() < 4 {
        return Err(image);
    }
    Ok(Seen {
        t_s,
        image,
        profile,
        bins,
        edges,
    })
}

/// Points without a jump.
pub(super) fn stretches(points: &[StripePoint]) -> Vec<&[StripePoint]> {
    points
        .chunk_by(|a, b| {
            b.column_px - a.column_px < GAP_COLUMNS
                && (b.row_px - a.row_px).abs() < JUMP_PX * (b.column_px - a.column_px).max(1.0)
        })
        .filter(|s| s.len() >= BIN_LEAST)
        .collect()
}

fn sound(p: &StripePoint) -> bool {
    p.quality & (quality::NEAR_STEP | quality::SATURATED) == 0
}

/// Straight line through points by least squares: mean column, mean row, slope.
pub(super) fn line<'a>(points: impl Iterator<Item = &'a StripePoint> + Clone) -> [f64; 3] {
    let n = points.clone().count().max(1) as f64;
    let (c, r) = points.clone().fold((0.0, 0.0), |(c, r), p| {
        (c + p.column_px / n, r + p.row_px / n)
    });
    let (cc, cr) = points.fold((0.0, 0.0), |(a, b), p| {
        let d = p.column_px - c;
        (a + d * d, b + d * (p.row_px - r))
    });
    [c, r, if cc > 0.0 { cr / cc } else { 0.0 }]
}

fn binned(stretch: &[StripePoint]) -> Vec<Bin> {
    let points: Vec<StripePoint> = stretch.iter().copied().filter(sound).collect();
    let count = points.len() / BIN_COLUMNS;
    let count = if count == 0 && points.len() >= BIN_LEAST {
        1
    } else {
        count
    };
    if count == 0 {
        return Vec::new();
    }
    let size = points.len().div_ceil(count);
    points
        .chunks(size)
        .filter(|c| c.len() >= BIN_LEAST)
        .map(bin)
        .collect()
}

fn bin(points: &[StripePoint]) -> Bin {
    // A particle's column is far off the line of its neighbours.
    let [c, r, slope] = line(points.iter());
    let off = |p: &&StripePoint| (p.row_px - r - slope * (p.column_px - c)).abs();
    let mut sorted: Vec<f64> = points.iter().map(|p| off(&p)).collect();
    sorted.sort_by(f64::total_cmp);
    let limit = 6.0 * sorted[sorted.len() / 2] + 1e-6;
    let kept = points.iter().filter(|p| off(p) <= limit);
    let n = kept.clone().count() as f64;
    let [column_px, row_px, slope] = line(kept.clone());
    let square = kept.clone().map(|p| p.sd_px * p.sd_px).sum::<f64>();
    let sigma_px = kept.clone().map(|p| p.sigma_px).sum::<f64>() / n;
    let scatter = kept.map(|p| (p.sigma_px - sigma_px).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
    Bin {
        column_px,
        row_px,
        sd_px: square.sqrt() / n,
        sigma_px,
        sigma_sd_px: (scatter / n).sqrt().max(1e-4),
        slope,
    }
}

/// The step between two stretches, measured on the one farther up in the image: the higher surface.
fn step(pair: &[&[StripePoint]], image: &GreyImage) -> Option<Edge> {
    let [left, right] = pair else { return None };
    let (a, b) = (left.last()?, right.first()?);
    if b.column_px - a.column_px > STEP_GAP_COLUMNS || (a.row_px - b.row_px).abs() < STEP_PX {
        return None;
    }
    let to_starboard = a.row_px < b.row_px;
    fading(if to_starboard { left } else { right }, image, to_starboard)
}

/// Where the light of a stretch ends. Along its own line, continued, each column's light is summed
/// with the stripe's profile as weight; if its fading is symmetric the area under it puts the end
/// where the sheet's middle meets the edge, whatever blur, thickness and slant are.
fn fading(run: &[StripePoint], image: &GreyImage, to_starboard: bool) -> Option<Edge> {
    let sign: i64 = if to_starboard { 1 } else { -1 };
    let near: Vec<&StripePoint> = if to_starboard {
        run.iter().rev().filter(|p| sound(p)).take(60).collect()
    } else {
        run.iter().filter(|p| sound(p)).take(60).collect()
    };
    if near.len() < 16 {
        return None;
    }
    let end = if to_starboard {
        run.last()
    } else {
        run.first()
    }?
    .column_px as i64;
    let [c, r, slope] = line(near.iter().copied());
    let row_at = |column: f64| r + slope * (column - c);
    let sigma = near.iter().map(|p| p.sigma_px).sum::<f64>() / near.len() as f64;
    let dark = darkness(image, end as usize);
    let light = |column: i64| -> Option<f64> {
        let at = usize::try_from(column)
            .ok()
            .filter(|c| *c < image.width_px)?;
        let middle = row_at(column as f64);
        let half = (2.5 * sigma).ceil();
        let (mut sum, mut norm) = (0.0, 0.0);
        for row in (middle - half).ceil() as i64..=(middle + half).floor() as i64 {
            let row_index = usize::try_from(row).ok().filter(|r| *r < image.height_px)?;
            let w = (-0.5 * ((row as f64 - middle) / sigma).powi(2)).exp();
            sum += w * (f64::from(*image.pixels.get(row_index * image.width_px + at)?) - dark);
            norm += w * w;
        }
        Some(sum / norm)
    };
    let inside: Vec<f64> = (END_REACH..END_REACH + 24)
        .filter_map(|k| light(end - sign * k))
        .take(near.len().saturating_sub(4))
        .collect();
    if inside.len() < 6 {
        return None;
    }
    let n = inside.len() as f64;
    let mut sorted = inside.clone();
    sorted.sort_by(f64::total_cmp);
    let level = sorted[sorted.len() / 2];
    if level < 8.0 {
        return None;
    }
    let mut area = 0.0;
    for k in 1 - END_REACH..=END_REACH {
        area += light(end + sign * k)? / level;
    }
    let column_px = (end + sign * (1 - END_REACH)) as f64 + sign as f64 * (area - 0.5);
    if (column_px - end as f64).abs() > END_REACH as f64 - 2.0 {
        return None;
    }
    let spread = inside
        .iter()
        .map(|v| (v / level - 1.0).powi(2))
        .sum::<f64>()
        / (n - 1.0);
    let reach = END_REACH as f64;
    Some(Edge {
        column_px,
        row_px: row_at(column_px),
        sd_px: (spread * (2.0 * reach + reach * reach / n))
            .sqrt()
            .max(0.01),
        slope,
        to_starboard,
    })
}

/// Grey level without laser about a column: the mean of the lower half of its pixels.
fn darkness(image: &GreyImage, column: usize) -> f64 {
    let from = column
        .saturating_sub(8)
        .min(image.width_px.saturating_sub(16));
    let mut levels: Vec<u8> = image
        .pixels
        .chunks_exact(image.width_px.max(1))
        .step_by(2)
        .flat_map(|row| row.iter().skip(from).take(16).copied())
        .collect();
    if levels.is_empty() {
        return 0.0;
    }
    levels.sort_unstable();
    let cut = levels.len() * 9 / 10;
    levels[..cut.max(1)]
        .iter()
        .map(|v| f64::from(*v))
        .sum::<f64>()
        / cut.max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use hydroline_core::frame::{Frame, FrameMeta, PixelFormat};
    use hydroline_log::{Entry, FileRecorder, Head, SummaryInput, WriteSettings};

    #[test]
    fn frames_that_are_marked_or_cannot_be_read_are_counted_and_said() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("run.mcap");
        let settings = WriteSettings::offline(Some(PixelFormat::Grey));
        let mut log = FileRecorder::create(&path, false, Head::default(), settings).unwrap();
        let faults = [
            None,
            None,
            None,
            Some(FrameFault::DriverError),
            Some(FrameFault::Stale),
        ];
        for k in 0..7u32 {
            let at_ns = 1_760_000_000_000_000_000 + u64::from(k) * 40_000_000;
            // One has fewer bytes than it says.
            let bytes = if k == 2 { 100 } else { 64 * 48 };
            let frame = Frame {
                format: PixelFormat::Grey,
                width_px: 64,
                height_px: 48,
                stride_bytes: 64,
                data: vec![8u8; bytes].into(),
                meta: FrameMeta {
                    fault: faults.get(k as usize).copied().flatten(),
                    ..FrameMeta::at(k, at_ns)
                },
            };
            log.write(at_ns, &Entry::frame(&frame, u64::from(k)))
                .unwrap();
        }
        log.finish(&SummaryInput::clean("done")).unwrap();
        let run = read(&path, &Rig::builtin("lshpi").unwrap(), 10).unwrap();
        assert_eq!((run.frames.len(), run.dark.len(), run.in_log), (0, 4, 5));
        assert_eq!((run.left_out.marked, run.left_out.unread), (1, 1));
        let words = run.left_out.words().join("; ");
        for part in [
            "1 frames are marked",
            "1 frames cannot be read",
            "frame 2: ",
        ] {
            assert!(words.contains(part), "no '{part}' in: {words}");
        }
    }
}
