//! What poses state to share, in the budget.

use super::QUICK;
use super::tank::{Noise, PLANS, Truth, runs};
use crate::{Options, identify};
use hydroline_identify::Identification;
use hydroline_rigs::Rig;
use rand::{SeedableRng, rngs::StdRng};

const SOURCE: &str = "calibration, which all its poses share";

/// Two runs with the same noise, each through a calibration that errs by so many sds.
fn fitted(calibrations: [(&'static str, f64); 2]) -> Identification {
    let rig = Rig::builtin("lshpi").unwrap();
    let truth = Truth {
        calibrations: calibrations.to_vec(),
        ..Truth::of(&rig)
    };
    let mut rng = StdRng::seed_from_u64(3);
    let plans = [PLANS[0], PLANS[0]];
    let options = Options {
        budget: true,
        ..QUICK
    };
    let runs = runs(&truth, &plans, Noise::White, &mut rng);
    identify(&runs, &rig, &options).unwrap()
}

fn line(of: &Identification, key: &str) -> f64 {
    let line = of.budget.iter().find(|l| l.source == SOURCE).unwrap();
    line.contributions[key]
}

#[test]
fn a_line_is_what_an_error_of_one_sd_moves() {
    let exact = fitted([("a", 0.0), ("a", 0.0)]);
    let off = [1.0, -1.0].map(|sds| fitted([("a", sds), ("a", sds)]));
    let offset = "offset that all poses of a run share";
    assert!(exact.budget.iter().all(|l| l.source != offset));
    for key in ["x_udot", "x_uu"] {
        let moved = 0.5 * (off[0].value(key).unwrap() - off[1].value(key).unwrap());
        let said = line(&exact, key);
        assert!(
            (said / moved.abs() - 1.0).abs() < 0.1,
            "{key}: {said} {moved}"
        );
    }
}

/// Errors of two calibrations are independent, that of one is not averaged.
#[test]
fn two_runs_share_what_one_calibration_errs_by_and_not_what_two_do() {
    let of = |other| fitted([("a", 0.0), (other, 0.0)]);
    let (one, two) = (of("a"), of("b"));
    for key in ["x_udot", "x_uu"] {
        let ratio = line(&two, key) / line(&one, key);
        assert!((ratio * 2f64.sqrt() - 1.0).abs() < 0.1, "{key}: {ratio}");
    }
}
