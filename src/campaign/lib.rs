//! Many logs: what a folder of recordings shows, run by run, day by day, vehicle by vehicle.
//!
//! ```text
//! survey   a folder -> logs: content hash, rig, calibration, water, time; or why a file is none
//! group    logs of one vehicle, calibration and water, and their days
//! unit     units of work and their keys: what each depends on
//! work     one unit done: doctor, replay, identify, diagnose; a day; a vehicle; what changed between its days
//! change   which single change of the rig explains a day after the days before it
//! store    sheets on disk, one per unit, named by a hash of all that it depends on
//! table    one row per run, day and vehicle: CSV and JSON lines
//! page     the same to look at
//! overlay  runs of one plan drawn over each other
//! publish  runs as a data set for another group: card, list of runs, tables in SI
//! ```
//!
//! A sheet depends on the content of its logs, the rig in them, the build, and nothing else: it is never out of date,
//! only no longer asked for. So a campaign goes on after a kill, does again only what a new log touches, and can be done by
//! several machines whose stores are put together in any order.

// Tests may unwrap; the crate itself must not.
#![cfg_attr(test, allow(clippy::unwrap_used))]

pub mod change;
pub mod group;
pub mod kind;
pub mod overlay;
pub mod page;
pub mod publish;
pub mod sheet;
pub mod store;
pub mod survey;
pub mod table;
pub mod unit;
pub mod work;

/// At most so many, evenly over their order.
fn evenly<T: Clone>(all: Vec<T>, most: usize) -> Vec<T> {
    let n = all.len();
    match n > most {
        true => (0..most).map(|k| all[k * n / most].clone()).collect(),
        false => all,
    }
}
