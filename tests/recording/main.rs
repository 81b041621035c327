//! The daemon as a whole: recordings on the simulated rig, its command line, kills, full disks, calibration while recording;
//! README and guide, whose commands run as printed.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

mod architecture;
mod attacks;
mod broken_off;
mod calibrate_chain;
mod campaign;
mod citations;
mod cli_build_info;
mod cli_errors;
mod clock_set;
mod compare;
mod damaged_images;
mod flat;
mod formats;
mod guide_reference;
mod import_logs;
mod join;
mod live_page;
mod log_guarantee;
mod many_logs;
mod measured_place;
mod merged_again;
mod notebook;
mod one_verdict;
mod plan_sizes;
mod pose_gaps;
mod readme;
mod record_clock;
mod record_command;
mod record_damaged;
mod record_disk;
mod record_kill;
mod reports;
mod response;
mod service_files;
mod simulate_light;
mod simulate_reproducible;
mod streams;
mod third_party;
mod time_limit;
mod until_decided;
mod verdict_json;
mod view;
mod words;

#[path = "../support/http.rs"]
mod http;

#[path = "../support/inputs.rs"]
mod inputs;

#[path = "../support/mod.rs"]
mod support;

#[path = "../support/slow_disk.rs"]
mod slow_disk;
