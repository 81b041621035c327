use super::*;
use hydroline_rigs::Rig;
use proptest::prelude::*;
use proptest::test_runner::RngSeed;

fn example() -> Calibration {
    Calibration {
        missing: Vec::new(),
        image: None,
        date: Some("2026-11-21T10:00:00Z".to_owned()),
        board: Some("wc-lines-50".to_owned()),
        residuals: Some(Residuals {
            nodes: 121,
            rms_xi_m: 1.2e-5,
            rms_eta_m: 3.4e-5,
            max_m: 1.1e-4,
        }),
        medium: Medium::Fresh,
        ..IdealMap::of(&Rig::builtin("lshpi").unwrap()).describe()
    }
}

#[test]
fn toml_round_trip() {
    for calibration in [
        example(),
        IdealMap::of(&Rig::builtin("bench-v4l").unwrap()).describe(),
    ] {
        let text = calibration.to_toml().unwrap();
        let again = Calibration::from_toml(&text, "c.toml").unwrap();
        assert_eq!(calibration, again);
        assert_eq!(again.to_map().describe().map, calibration.map);
        assert!(text.contains("method = \"eq11-12\""));
    }
}

#[test]
fn bad_numbers_and_keys_are_named() {
    let text = example().to_toml().unwrap();
    for (from, to, word) in [
        ("zeta_c_m = -0.46", "zeta_c_m = 0.0", "map.zeta_c_m"),
        ("cx_px = 359.5", "cx_px = nan", "map.cx_px"),
        ("angle_rad = 0.69", "angle_rad = 9.69", "map.fan.angle_rad"),
        ("nodes = 121", "nodes = -1", "nodes"),
        ("medium = \"fresh\"", "medium = \"oil\"", "medium"),
        ("eq11-12", "eq99", "eq99"),
        ("cx_px = 359.5", "cx_px = 359.5\nextra = 1", "extra"),
    ] {
        assert!(text.contains(from), "{from} not in {text}");
        let error = Calibration::from_toml(&text.replace(from, to), "c.toml").unwrap_err();
        let message = error.to_string();
        assert!(
            message.contains("c.toml") && message.contains(word),
            "{message}"
        );
    }
}

proptest! {
    #![proptest_config(ProptestConfig { rng_seed: RngSeed::Fixed(1), failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn any_text_is_an_answer(text in "\\PC{0,200}") {
        let _ = Calibration::from_toml(&text, "c.toml");
    }
}
