//! `[camera.response]`: what a rig states of its camera.

use super::{changed, tells};
use crate::Rig;

const WHOLE: &str = "[camera.response]\ngamma = 0.45\ngamma_sd = 0.003\nblack_levels = 16\nblack_levels_sd = 0.5\n\
                     gamma_black_correlation = -0.8\nceiling_levels = 235\nsource = \"hydroline flat\"\n";

fn rig(table: &str) -> Rig {
    let text = include_str!("../../../lshpi.toml");
    Rig::from_toml(&format!("{text}\n{table}"), "my.toml", None).unwrap()
}

#[test]
fn a_stated_response_reads_back_bit_for_bit_and_says_itself_alone() {
    let stated = rig(WHOLE);
    let response = stated.camera.response.as_ref().unwrap();
    assert_eq!(response.black_levels, Some([16.0, 0.5]));
    assert_eq!(response.ceiling_levels, Some(235));
    let again = Rig::from_toml(&stated.effective_toml, "again.toml", None).unwrap();
    assert_eq!(again, stated);
    assert_eq!(rig(&response.to_toml()).camera, stated.camera);
}

#[test]
fn a_camera_that_leaves_light_as_it_is_is_said_in_three_lines() {
    let straight = rig("[camera.response]\ngamma = 1\ngamma_sd = 0\nsource = \"data sheet\"\n");
    let response = straight.camera.response.unwrap();
    assert_eq!((response.gamma, response.gamma_sd), (1.0, 0.0));
    assert_eq!(response.black_levels, None);
    // Rigs without the table are the same text as before there was one.
    let without = Rig::builtin("lshpi").unwrap();
    assert_eq!(without.camera.response, None);
    assert!(!without.effective_toml.contains("response"));
}

#[test]
fn what_is_wrong_in_it_is_said_with_its_key() {
    for (from, to, words) in [
        (
            "gamma = 0.45",
            "gamma = 0.05",
            &["camera.response.gamma", "0.2 to 5"][..],
        ),
        ("gamma = 0.45\n", "", &["camera.response.gamma", "missing"]),
        (
            "gamma_sd = 0.003\n",
            "",
            &["camera.response.gamma_sd", "missing"],
        ),
        (
            "gamma_sd = 0.003",
            "gamma_sd = -1",
            &["camera.response.gamma_sd", "0 to 1"],
        ),
        (
            "black_levels_sd = 0.5\n",
            "",
            &["camera.response.black_levels_sd", "goes with black_levels"],
        ),
        (
            "black_levels = 16\n",
            "",
            &["camera.response.black_levels", "goes with black_levels_sd"],
        ),
        (
            "black_levels = 16",
            "black_levels = 160",
            &["camera.response.black_levels", "-64 to 64"],
        ),
        (
            "gamma_sd = 0.003",
            "gamma_sd = 0",
            &["gamma_black_correlation", "both above 0"],
        ),
        (
            "ceiling_levels = 235",
            "ceiling_levels = 23.5",
            &["camera.response.ceiling_levels", "64 to 255"],
        ),
        (
            "source = \"hydroline flat\"",
            "source = \" \"",
            &["camera.response.source", "data sheet"],
        ),
        (
            "source = \"hydroline flat\"",
            "sourc = \"x\"",
            &["camera.response.sourc", "did you mean `source`"],
        ),
    ] {
        assert!(WHOLE.contains(from), "{from}");
        let table = WHOLE.replacen(from, to, 1);
        let error = changed("[camera.noise]", &format!("{table}\n[camera.noise]"));
        tells(&error, words);
    }
}
