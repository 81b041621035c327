//! The page of finished logs and its answers.
//!
//! | path | answer |
//! |---|---|
//! | `/` | the page |
//! | `/info` | the logs: names, times, topics, fields with their numbers, images, notes (JSON) |
//! | `/series?log=&of=1,2&from=&to=&pixels=` | numbers over time, the least and greatest of each pixel (JSON) |
//! | `/events?log=` | events (JSON) |
//! | `/frame?log=&topic=&t=` or `at=`, `step=next` or `previous`, `stripe=1`, `full=1` | a frame: length of the words (u32, little endian), words (JSON), JPEG |
//! | `/picture?log=&topic=&at=` | the same frame as it is, PNG |
//! | `/table?log=&of=1,2&from=&to=` | all samples of a stretch (CSV) |
//!
//! Times are seconds since the log's zero; `at` the same in whole nanoseconds.

use crate::frames::{Shown, Wanted};
use crate::query::{BadQuery, Query};
use crate::series::Stretch;
use crate::viewed::{Viewed, Zero};
use hydroline_core::frame::{Frame, GreyImage};
use hydroline_core::lock::Lock;
use hydroline_live::guard::Guard;
use hydroline_live::jpeg::{halved, write_jpeg};
use hydroline_live::page::{self, Page};
use hydroline_live::picture::{Overlay, points};
use hydroline_live::site::{Reply, Site};
use hydroline_log::messages::pb::StripeProfile;
use serde_json::{Value, json};
use std::io;
use std::sync::Mutex;
use std::time::{Duration, Instant};

const TITLE: &str = "hydroline view";
const BODY: &str = include_str!("page/view.html");
const STYLE: &str = include_str!("page/view.css");
const SCRIPT: &str = include_str!("page/view.js");

/// A request reads numbers for so long; then it answers with what there is.
const READS_FOR: Duration = Duration::from_millis(200);
/// Fields of one request.
const FIELDS_MAX: usize = 40;
/// Widest plot; no screen is wider.
const PIXELS_MAX: usize = 8000;
const JSON: &str = "application/json";

/// Stripe of a frame, and the frame's grey levels where they were read for it.
#[derive(Debug, Clone, Default)]
pub struct Found {
    /// The stripe, or why there is none.
    pub profile: StripeProfile,
    /// `None` = the frame has none, or was not read.
    pub grey: Option<GreyImage>,
}

/// Finds the stripe of a frame of a log.
pub type Finder = Box<dyn FnMut(&Frame) -> Found + Send>;

/// A log as it was named.
pub struct NamedLog {
    /// As the command line has it, without a window.
    pub path: String,
    /// Window that was named \[s since the first command or motion\].
    pub window_s: Option<(f64, f64)>,
    /// Words on it: rig, plan.
    pub about: String,
    /// The log.
    pub viewed: Viewed,
    /// Finds the stripe in its frames.
    pub finder: Mutex<Finder>,
}

impl std::fmt::Debug for NamedLog {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("NamedLog")
            .field("path", &self.path)
            .finish_non_exhaustive()
    }
}

/// The logs that are looked at.
#[derive(Debug)]
pub struct LogSite {
    logs: Vec<NamedLog>,
}

/// Why a request has no answer.
#[derive(Debug, thiserror::Error)]
enum Failed {
    #[error("{0}")]
    Query(#[from] BadQuery),
    #[error("there is no such log: {0} are shown, from 0")]
    Log(usize),
    #[error("there is no frame there")]
    Frame,
    #[error("{0}")]
    Image(String),
    #[error("{0}")]
    Table(#[from] crate::table::TooLong),
}

impl Failed {
    fn status(&self) -> u16 {
        match self {
            Failed::Query(_) => 400,
            Failed::Log(_) | Failed::Frame => 404,
            Failed::Image(_) => 422,
            Failed::Table(_) => 413,
        }
    }
}

impl Site for LogSite {
    fn page(&self, guard: &Guard) -> io::Result<Page> {
        page::another(guard, TITLE, BODY, STYLE, SCRIPT)
    }

    fn answer(&self, path: &str, query: &str) -> Option<Reply> {
        let query = Query(query);
        let reply = match path {
            "/info" => Ok(Reply::of(JSON, self.info().to_string().into_bytes())),
            "/series" => self.series(query),
            "/events" => self.events(query),
            "/frame" => self.frame(query),
            "/picture" => self.picture(query),
            "/table" => self.table(query),
            _ => return None,
        };
        Some(reply.unwrap_or_else(|e| Reply::words(e.status(), &e.to_string())))
    }
}

impl LogSite {
    /// A page of these logs.
    pub fn new(logs: Vec<NamedLog>) -> Self {
        Self { logs }
    }

    fn log(&self, query: Query<'_>) -> Result<&NamedLog, Failed> {
        let number: usize = query.whole("log", 0)?;
        self.logs.get(number).ok_or(Failed::Log(self.logs.len()))
    }

    fn info(&self) -> Value {
        let logs: Vec<Value> = self.logs.iter().map(about).collect();
        json!({ "logs": logs })
    }

    fn series(&self, query: Query<'_>) -> Result<Reply, Failed> {
        let log = &self.log(query)?.viewed;
        let of = query.list("of", FIELDS_MAX)?;
        let (from_ns, to_ns) = (query.time_ns("from")?, query.time_ns("to")?);
        let pixels: usize = query.whole("pixels", 800)?;
        let stretch = Stretch {
            from_ns: from_ns.min(to_ns),
            to_ns: to_ns.max(from_ns),
            pixels: pixels.clamp(1, PIXELS_MAX),
        };
        let until = Instant::now() + READS_FOR;
        let series = log.series(&of, stretch, || Instant::now() < until);
        let each = of.iter().zip(&series.samples).zip(&series.not_finite);
        let each: Vec<Value> = each
            .map(|((number, samples), not_finite)| {
                let t: Vec<f64> = samples.iter().map(|s| seconds(s.at_ns)).collect();
                let v: Vec<f64> = samples.iter().map(|s| s.value).collect();
                json!({ "number": number, "t": t, "v": v, "not_finite": not_finite })
            })
            .collect();
        let fields = log.fields_met();
        let body = json!({ "read": series.read, "fields": fields, "series": each });
        Ok(Reply::of(JSON, body.to_string().into_bytes()))
    }

    fn events(&self, query: Query<'_>) -> Result<Reply, Failed> {
        let log = &self.log(query)?.viewed;
        let until = Instant::now() + READS_FOR;
        let (read, events) = log.events(|| Instant::now() < until);
        let body = json!({ "read": read, "events": events });
        Ok(Reply::of(JSON, body.to_string().into_bytes()))
    }

    fn shown(&self, query: Query<'_>) -> Result<(&NamedLog, Shown), Failed> {
        let log = self.log(query)?;
        let topic: usize = query.whole("topic", 0)?;
        let at_ns: i64 = match query.whole("at", i64::MIN)? {
            i64::MIN => query.time_ns("t")?,
            at_ns => at_ns,
        };
        let wanted = match query.word("step", &["next", "previous"]) {
            Some("next") => Wanted::Next,
            Some(_) => Wanted::Previous,
            None => Wanted::Nearest,
        };
        let shown = log.viewed.frame(topic, at_ns, wanted);
        Ok((log, shown.ok_or(Failed::Frame)?))
    }

    fn frame(&self, query: Query<'_>) -> Result<Reply, Failed> {
        let (log, shown) = self.shown(query)?;
        let mut overlay = Overlay::default();
        let mut jpeg = Vec::new();
        match &shown.frame {
            Err(why) => overlay.fault = why.clone(),
            Ok(frame) => {
                let found = query.is("stripe").then(|| (log.finder.held())(frame));
                let found = found.unwrap_or_default();
                overlay = self::overlay(frame, &found.profile);
                // Damage is for eyes to see.
                let grey = found
                    .grey
                    .map_or_else(|| frame.inspect(log.viewed.rule()).map(|i| i.image), Ok);
                match grey {
                    Ok(grey) if query.is("full") => write_jpeg(&grey, &mut jpeg),
                    Ok(grey) => write_jpeg(&halved(grey), &mut jpeg),
                    Err(why) => overlay.fault = why.to_string(),
                }
            }
        }
        let words = json!({
            "at": shown.at_ns.to_string(),
            "t": seconds(shown.at_ns),
            "overlay": overlay,
        });
        let words = words.to_string().into_bytes();
        let mut body = Vec::with_capacity(4 + words.len() + jpeg.len());
        body.extend((words.len() as u32).to_le_bytes());
        body.extend(words);
        body.extend(jpeg);
        Ok(Reply::of("application/octet-stream", body))
    }

    fn picture(&self, query: Query<'_>) -> Result<Reply, Failed> {
        let (log, shown) = self.shown(query)?;
        let frame = shown.frame.map_err(Failed::Image)?;
        let grey = frame.inspect(log.viewed.rule());
        let grey = grey.map_err(|why| Failed::Image(why.to_string()))?.image;
        let (width, height) = (grey.width_px as u32, grey.height_px as u32);
        let mut png = io::Cursor::new(Vec::new());
        image::GrayImage::from_raw(width, height, grey.pixels)
            .ok_or_else(|| Failed::Image("its size is not that of its pixels".to_owned()))?
            .write_to(&mut png, image::ImageFormat::Png)
            .map_err(|why| Failed::Image(why.to_string()))?;
        let mut reply = Reply::of("image/png", png.into_inner());
        let name = stem(&log.path);
        reply.download = Some(format!("{name}-{:.3}s.png", seconds(shown.at_ns)));
        Ok(reply)
    }

    fn table(&self, query: Query<'_>) -> Result<Reply, Failed> {
        let log = self.log(query)?;
        let of = query.list("of", FIELDS_MAX)?;
        let (from_ns, to_ns) = (query.time_ns("from")?, query.time_ns("to")?);
        let table = log.viewed.table(&of, from_ns, to_ns)?;
        let mut reply = Reply::of("text/csv; charset=utf-8", table.into_bytes());
        let name = stem(&log.path);
        let (from_s, to_s) = (seconds(from_ns), seconds(to_ns));
        reply.download = Some(format!("{name}-{from_s:.2}-{to_s:.2}s.csv"));
        Ok(reply)
    }
}

fn stem(path: &str) -> String {
    let stem = std::path::Path::new(path).file_stem();
    stem.map_or_else(|| "log".to_owned(), |s| s.to_string_lossy().into_owned())
}

/// Nanoseconds as seconds, to the microsecond: what a plot shows.
fn seconds(ns: i64) -> f64 {
    (ns as f64 * 1e-3).round() / 1e6
}

fn overlay(frame: &Frame, profile: &StripeProfile) -> Overlay {
    Overlay {
        sequence: frame.meta.sequence,
        // A JPEG says its size itself.
        width_px: frame.width_px.max(profile.width_px),
        height_px: frame.height_px.max(profile.height_px),
        stripe_px: points(&profile.column_px, &profile.row_px, 0.01),
        profile_m: points(&profile.xi_m, &profile.eta_m, 1e-5),
        fault: profile.fault.clone(),
        ..Overlay::default()
    }
}

/// A log as the page lists it.
fn about(log: &NamedLog) -> Value {
    let viewed = &log.viewed;
    let (from_ns, to_ns) = viewed.span();
    let fields: Vec<Value> = (viewed.fields().into_iter())
        .map(|f| json!({ "number": f.number, "topic": f.topic, "path": f.path, "key": f.key }))
        .collect();
    let images: Vec<Value> = (viewed.images().iter())
        .map(|i| json!({ "topic": i.topic, "messages": i.messages }))
        .collect();
    let undecoded: Vec<Value> = (viewed.undecoded().iter())
        .map(|u| json!({ "topic": u.topic, "schema": u.schema, "messages": u.messages, "why": u.why }))
        .collect();
    json!({
        "path": log.path,
        "name": stem(&log.path),
        "about": log.about,
        "zero": match viewed.zero() { Zero::Plan => "start of the plan", Zero::First => "first sample" },
        "zero_unix_ms": viewed.zero_ns() / 1_000_000,
        "window_zero_s": seconds(viewed.window_zero()),
        "window_s": log.window_s,
        "from_s": seconds(from_ns),
        "to_s": seconds(to_ns),
        "messages": viewed.log().channels().map(|c| c.messages).sum::<u64>(),
        "fields": fields,
        "fields_met": viewed.fields_met(),
        "images": images,
        "undecoded": undecoded,
        "notes": viewed.notes(),
    })
}

#[cfg(test)]
#[path = "tests/unit/site.rs"]
mod tests;
