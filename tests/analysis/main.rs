//! From frames and logs to stripes, poses, coefficients and verdicts.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

mod diagnose_body;
mod diagnose_closed;
mod diagnose_given;
mod diagnose_images;
mod diagnose_motion;
mod diagnose_real;
mod identify_command;
mod identify_noise;
mod identify_runs;
mod light_chains;
mod pose_cases;
mod pose_light;
mod prove_small;
mod replay_refine;
mod reproduce_tables;
mod sample;
mod stripe_cases;

#[path = "../support/inputs.rs"]
mod inputs;

#[path = "../support/mod.rs"]
mod support;

#[path = "../support/experiment.rs"]
mod experiment;
