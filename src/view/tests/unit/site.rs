#[path = "../../../../tests/support/no_fetch.rs"]
mod no_fetch;

use super::*;
use bytes::Bytes;
use hydroline_core::event::{Event, Severity, kind};
use hydroline_core::frame::{FrameMeta, PixelFormat};
use hydroline_log::messages::{pb, timestamp};
use hydroline_log::{Entry, FileRecorder, Head, SummaryInput, WriteSettings};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;

/// When the recording begins, and when its plan does.
const BEGIN_NS: u64 = 1_700_000_000_000_000_000;
const PLAN_NS: u64 = BEGIN_NS + 1_000_000_000;
const FRAMES: u64 = 20;

fn frame(k: u64) -> Frame {
    let at_ns = BEGIN_NS + 500_000_000 * k;
    Frame {
        format: PixelFormat::Grey,
        width_px: 64,
        height_px: 48,
        stride_bytes: 64,
        data: Bytes::from(vec![10 * k as u8; 64 * 48]),
        meta: FrameMeta::at(k as u32, at_ns),
    }
}

/// Ten seconds: frames at 2 Hz, motion at 100 Hz, commands of two thrusters at 10 Hz, the plan's start after a second.
fn recorded(path: &Path) {
    let head = Head {
        rig_toml: "# none that reads".to_owned(),
        ..Head::default()
    };
    let mut log = FileRecorder::create(path, false, head, WriteSettings::offline(None)).unwrap();
    let mut entries: Vec<(u64, Entry)> = Vec::new();
    for k in 0..FRAMES {
        entries.push((
            BEGIN_NS + 500_000_000 * k + 30_000_000,
            Entry::frame(&frame(k), k),
        ));
    }
    for k in 0..1000u64 {
        let at_ns = BEGIN_NS + 10_000_000 * k;
        let motion = pb::VehicleMotion {
            timestamp: Some(timestamp(at_ns)),
            x_m: (k % 2 == 0).then_some(1e-3 * k as f64),
            psi_rad: Some(if k == 777 { 2.0 } else { 0.25 }),
            ..pb::VehicleMotion::default()
        };
        entries.push((at_ns + 50_000_000, Entry::motion(&motion)));
    }
    for k in 0..100u64 {
        let at_ns = BEGIN_NS + 100_000_000 * k;
        for (thruster, thrust_n) in [("bow", 1.5), ("stern", -0.5)] {
            let command = pb::ThrusterCommand {
                timestamp: Some(timestamp(at_ns)),
                sequence: k as u32,
                thruster: thruster.to_owned(),
                thrust_n: thrust_n * k as f64,
                plan_step: u32::from(k >= 10),
                ..pb::ThrusterCommand::default()
            };
            entries.push((at_ns, Entry::command(&command)));
        }
    }
    let words = "the plan starts".to_owned();
    let event = Event::new(PLAN_NS, Severity::Info, &kind::PLAN_START, words);
    entries.push((PLAN_NS, Entry::event(&event)));
    entries.sort_by_key(|(log_ns, _)| *log_ns);
    for (log_ns, entry) in entries {
        log.write(log_ns, &entry).unwrap();
    }
    log.finish(&SummaryInput::clean("done")).unwrap();
}

fn named(path: &Path) -> NamedLog {
    NamedLog {
        path: path.display().to_string(),
        window_s: None,
        about: String::new(),
        viewed: Viewed::open(path).unwrap(),
        finder: Mutex::new(Box::new(|frame| Found {
            profile: StripeProfile {
                column_px: vec![1.0, 2.0],
                row_px: vec![f32::from(frame.data[0]), 4.0],
                ..StripeProfile::default()
            },
            grey: None,
        })),
    }
}

fn site() -> (tempfile::TempDir, LogSite) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    recorded(&path);
    let site = LogSite::new(vec![named(&path)]);
    (folder, site)
}

fn json_of(site: &LogSite, path: &str, query: &str) -> Value {
    let reply = site.answer(path, query).unwrap();
    let text = String::from_utf8_lossy(&reply.body).into_owned();
    assert_eq!(reply.status, 200, "{text}");
    serde_json::from_str(&text).unwrap()
}

/// Number of a field.
fn number(site: &LogSite, topic: &str, key: &str, path: &str) -> u64 {
    let info = json_of(site, "/info", "");
    let fields = info["logs"][0]["fields"].as_array().unwrap();
    let found = fields
        .iter()
        .find(|f| f["topic"] == topic && f["key"] == key && f["path"] == path);
    let found = found.unwrap_or_else(|| panic!("{topic} {key} {path} in {fields:?}"));
    found["number"].as_u64().unwrap()
}

fn column(series: &Value, k: usize) -> Vec<(f64, f64)> {
    let of = |name: &str| -> Vec<f64> {
        let list = series["series"][k][name].as_array().unwrap();
        list.iter().map(|v| v.as_f64().unwrap()).collect()
    };
    of("t").into_iter().zip(of("v")).collect()
}

#[test]
fn time_is_of_the_plan_and_a_thruster_is_a_field_of_its_own() {
    let (_folder, site) = site();
    let log = &json_of(&site, "/info", "")["logs"][0];
    assert_eq!(log["zero"], "start of the plan");
    assert_eq!(log["zero_unix_ms"], PLAN_NS / 1_000_000);
    assert_eq!(log["window_zero_s"], -1.0);
    assert_eq!(
        (log["from_s"].as_f64(), log["messages"].as_u64()),
        (Some(-1.0), Some(1241))
    );
    let of = [
        number(&site, "/thruster/command", "bow", "thrust_n"),
        number(&site, "/thruster/command", "stern", "thrust_n"),
    ];
    let query = format!("of={},{}&from=-10&to=10&pixels=500", of[0], of[1]);
    let series = json_of(&site, "/series", &query);
    assert_eq!(series["read"], 1.0);
    let (bow, stern) = (column(&series, 0), column(&series, 1));
    assert_eq!((bow.len(), stern.len()), (100, 100));
    assert_eq!((bow[20], stern[20]), ((1.0, 30.0), (1.0, -10.0)));
}

#[test]
fn a_peak_is_in_a_plot_of_few_pixels_and_a_window_has_its_neighbours() {
    let (_folder, site) = site();
    let psi = number(&site, "/vehicle/motion", "", "psi_rad");
    let series = json_of(
        &site,
        "/series",
        &format!("of={psi}&from=-1&to=9&pixels=10"),
    );
    let shown = column(&series, 0);
    assert!(
        shown.len() <= 22 && shown.contains(&(6.77, 2.0)),
        "{shown:?}"
    );
    // What is absent in a message is no sample.
    let x = number(&site, "/vehicle/motion", "", "x_m");
    let series = json_of(
        &site,
        "/series",
        &format!("of={x}&from=0&to=0.1&pixels=500"),
    );
    let shown = column(&series, 0);
    let times: Vec<f64> = shown.iter().map(|s| s.0).collect();
    assert_eq!(times, [-0.02, 0.0, 0.02, 0.04, 0.06, 0.08, 0.1, 0.12]);
    assert_eq!(shown[1].1, 0.1);
}

#[test]
fn a_request_reads_for_a_while_and_the_next_one_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    recorded(&path);
    let viewed = Viewed::open(&path).unwrap();
    let fields = viewed.fields();
    let x = fields
        .iter()
        .find(|f| f.path == "x_m" && f.topic == "/vehicle/motion");
    let x = x.unwrap().number;
    let whole = Stretch {
        from_ns: -1_000_000_000,
        to_ns: 9_000_000_000,
        pixels: 4000,
    };
    let mut shares = Vec::new();
    let last = loop {
        // Not one more place than has to be.
        let series = viewed.series(&[x], whole, || false);
        shares.push(series.read);
        if series.read >= 1.0 {
            break series;
        }
        assert!(shares.len() < 1000);
    };
    assert!(shares.is_sorted());
    assert_eq!(last.samples[0].len(), 500);
}

#[test]
fn the_table_holds_every_sample_of_the_range_as_it_was_logged() {
    let (_folder, site) = site();
    let x = number(&site, "/vehicle/motion", "", "x_m");
    let bow = number(&site, "/thruster/command", "bow", "thrust_n");
    let reply = site
        .answer("/table", &format!("of={x},{bow}&from=0&to=0.1"))
        .unwrap();
    assert_eq!(reply.status, 200);
    assert_eq!(reply.download.as_deref(), Some("run-0.00-0.10s.csv"));
    let text = String::from_utf8(reply.body).unwrap();
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(
        lines[0],
        "time_s,unix_ns,/vehicle/motion.x_m,/thruster/command[bow].thrust_n"
    );
    assert_eq!(lines[1], "0.000000000,1700000001000000000,0.1,15.0");
    // To the last bit.
    let second = format!("0.020000000,1700000001020000000,{:?},", 1e-3 * 102.0);
    assert_eq!(lines[2], second);
    assert_eq!(lines.len(), 7);
}

#[test]
fn frames_are_found_by_time_and_stepped_through() {
    let (_folder, site) = site();
    let shown = |query: &str| -> (Value, Vec<u8>) {
        let reply = site.answer("/frame", query).unwrap();
        assert_eq!(reply.status, 200, "{query}");
        let length = u32::from_le_bytes(reply.body[..4].try_into().unwrap()) as usize;
        let words = serde_json::from_slice(&reply.body[4..4 + length]).unwrap();
        (words, reply.body[4 + length..].to_vec())
    };
    let sequence = |query: &str| shown(query).0["overlay"]["sequence"].as_u64().unwrap();
    // Frame 2 is at the plan's start.
    assert_eq!(sequence("t=0"), 2);
    assert_eq!(sequence("t=0.24"), 2);
    assert_eq!(sequence("t=0.26"), 3);
    assert_eq!((sequence("t=-99"), sequence("t=99")), (0, FRAMES - 1));
    let (words, jpeg) = shown("t=1&stripe=1");
    assert_eq!(jpeg[..2], [0xff, 0xd8]);
    assert_eq!(
        words["overlay"]["stripe_px"][0],
        serde_json::json!([1.0, 40.0])
    );
    let mut at = words["at"].as_str().unwrap().to_owned();
    for k in [5, 6, 7] {
        let words = shown(&format!("at={at}&step=next")).0;
        assert_eq!(words["overlay"]["sequence"], k);
        at = words["at"].as_str().unwrap().to_owned();
    }
    for k in [6, 5, 4] {
        let words = shown(&format!("at={at}&step=previous")).0;
        assert_eq!(words["overlay"]["sequence"], k);
        at = words["at"].as_str().unwrap().to_owned();
    }
    assert_eq!(site.answer("/frame", "t=99&step=next").unwrap().status, 404);
    assert_eq!(
        site.answer("/frame", "t=-99&step=previous").unwrap().status,
        404
    );
    let png = site.answer("/picture", "t=1").unwrap();
    let read = image::load_from_memory(&png.body).unwrap().to_luma8();
    assert_eq!(
        (read.dimensions(), read.get_pixel(3, 3).0),
        ((64, 48), [40])
    );
}

#[test]
fn events_have_their_times() {
    let (_folder, site) = site();
    let events = json_of(&site, "/events", "");
    assert_eq!(events["read"], 1.0);
    assert_eq!(events["events"][0]["kind"], "plan.start");
    assert_eq!(events["events"][0]["t_s"], 0.0);
}

#[test]
fn what_cannot_be_asked_for_is_refused_in_words() {
    let (_folder, site) = site();
    for (path, query, status) in [
        ("/series", "of=x&from=0&to=1", 400),
        ("/series", "of=0&from=0", 400),
        ("/series", "log=7&of=0&from=0&to=1", 404),
        ("/frame", "t=never", 400),
        ("/frame", "topic=9&t=0", 404),
        ("/table", "of=0&from=0&to=1e99", 400),
    ] {
        let reply = site.answer(path, query).unwrap();
        assert_eq!(reply.status, status, "{path}?{query}");
        assert!(!reply.body.is_empty());
    }
    // A field that is not there has no samples.
    let series = json_of(&site, "/series", "of=999999&from=0&to=1");
    assert!(column(&series, 0).is_empty());
    assert!(site.answer("/state", "").is_none());
}

#[test]
fn a_log_that_was_cut_is_shown_as_far_as_it_goes() {
    let folder = tempfile::tempdir().unwrap();
    let whole = folder.path().join("whole.mcap");
    recorded(&whole);
    let bytes = std::fs::read(&whole).unwrap();
    let cut = folder.path().join("cut.mcap");
    std::fs::write(&cut, &bytes[..bytes.len() * 3 / 4]).unwrap();
    let site = LogSite::new(vec![named(&cut)]);
    let log = &json_of(&site, "/info", "")["logs"][0];
    let notes = log["notes"][0].as_str().unwrap();
    assert!(notes.contains("before its end is shown"), "{notes}");
    assert_eq!(site.answer("/frame", "t=0").unwrap().status, 200);
}

/// A log of another program: JSON that is read, and CBOR that is not.
fn foreign(path: &Path) {
    let mut log = mcap::Writer::new(std::fs::File::create(path).unwrap()).unwrap();
    let none = BTreeMap::new();
    let depth = log.add_channel(0, "/depth", "json", &none).unwrap();
    let other = log.add_channel(0, "/other", "cbor", &none).unwrap();
    for k in 0..10u64 {
        let header = |channel_id| mcap::records::MessageHeader {
            channel_id,
            sequence: k as u32,
            log_time: 5_000_000_000 + 100_000_000 * k,
            publish_time: 0,
        };
        let text = format!("{{\"depth_m\": {}, \"valid\": true}}", 0.5 * k as f64);
        log.write_to_known_channel(&header(depth), text.as_bytes())
            .unwrap();
        log.write_to_known_channel(&header(other), b"\xa1").unwrap();
    }
    log.finish().unwrap();
}

#[test]
fn a_log_of_another_program_shows_what_is_read_and_says_what_is_not() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("foreign.mcap");
    foreign(&path);
    let site = LogSite::new(vec![named(&path)]);
    let log = &json_of(&site, "/info", "")["logs"][0];
    assert_eq!(log["zero"], "first sample");
    assert_eq!(log["undecoded"][0]["topic"], "/other");
    assert!(
        log["undecoded"][0]["why"]
            .as_str()
            .unwrap()
            .contains("cbor")
    );
    let depth = number(&site, "/depth", "", "depth_m");
    let series = json_of(
        &site,
        "/series",
        &format!("of={depth}&from=0&to=1&pixels=100"),
    );
    let shown = column(&series, 0);
    assert_eq!((shown.len(), shown[3]), (10, (0.3, 1.5)));
    assert_eq!(site.answer("/frame", "t=0").unwrap().status, 404);
}

/// The page asks nobody but us, and nothing is put into it as markup.
#[test]
fn nothing_is_fetched_from_anywhere() {
    let ours = [BODY, STYLE, SCRIPT].concat();
    no_fetch::assert_none(&ours);
    assert!(!ours.contains("style="), "style=");
    let guard = Guard::new(None, hydroline_live::Token::random().unwrap(), "");
    let page = page::another(&guard, TITLE, BODY, STYLE, SCRIPT).unwrap();
    assert!(!page.html.contains("{{"), "a place was not filled");
    assert!(page.html.len() <= 300_000, "{} bytes", page.html.len());
}
