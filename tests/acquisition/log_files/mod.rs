//! The log on real files: crashes, cuts, bit flips, other people's files, slow disks.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

mod crash;
mod damage;
mod real;
mod replayed;
mod stall;
mod support;
