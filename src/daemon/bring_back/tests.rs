use super::*;
use std::f64::consts::{FRAC_PI_2, PI};

const START: [f64; 6] = [-0.2, 0.0, 0.5, 0.0, 0.0, 0.0];
const S: u64 = 1_000_000_000;

fn seen(x_m: f64, y_m: f64, psi_rad: f64) -> Seen {
    Seen {
        x_m: Some(x_m),
        y_m: Some(y_m),
        psi_rad: Some(psi_rad),
    }
}

fn words(start: &[f64; 6], seen: &Seen) -> String {
    Left::of(start, seen).to_string()
}

#[test]
fn directions_are_the_vehicles_own() {
    let at = seen(-0.32, 0.03, 4f64.to_radians());
    // Nearly along the tank: what is ahead in the tank is ahead of the vehicle.
    assert_eq!(
        words(&START, &at),
        "0.12 m forward, 0.04 m left, turn 4\u{b0} left"
    );
    // Rotated by half a turn, forward is back; across the tank, along it is to the side.
    let about = words(&START, &seen(-0.3, 0.0, PI));
    assert!(about.starts_with("0.10 m back"), "{about}");
    let across = words(&START, &seen(-0.3, 0.0, FRAC_PI_2));
    assert!(
        across.contains("0.10 m left") && across.contains("turn 90\u{b0} left"),
        "{across}"
    );
    // Over the seam of the angle the short way round.
    let seam = Left::of(
        &[0.0, 0.0, 0.0, 0.0, 0.0, 179f64.to_radians()],
        &seen(0.0, 0.0, -179f64.to_radians()),
    );
    assert!((seam.turn_rad.unwrap().to_degrees() + 2.0).abs() < 1e-9);
}

#[test]
fn what_is_not_seen_is_not_said() {
    let no_sway = Seen {
        y_m: None,
        ..seen(-0.3, 0.0, 0.0)
    };
    assert_eq!(
        words(&START, &no_sway),
        "0.10 m forward, turn 0\u{b0} right"
    );
    let heading_alone = Seen {
        psi_rad: Some(0.0),
        ..Seen::default()
    };
    // A heading alone is no place.
    assert!(!Left::of(&START, &heading_alone).within(&StartTolerance::default()));
    let mut guide = Guide::new(START, StartTolerance::default());
    guide.look(S, Seen::default());
    assert_eq!(guide.stage(S), Stage::Unseen);
}

#[test]
fn crossing_the_tolerance_is_not_being_there() {
    let mut guide = Guide::new(START, StartTolerance::default());
    let (there, past) = (seen(-0.19, 0.01, 0.02), seen(-0.1, 0.0, 0.0));
    guide.look(0, past);
    assert!(matches!(guide.stage(0), Stage::Away(_)));
    guide.look(S / 2, there);
    assert!(matches!(guide.stage(S / 2), Stage::Arriving(_)));
    guide.look(S, past);
    assert!(matches!(guide.stage(S), Stage::Away(_)));
    // Held for a second: there; not by time alone, poses must have said so.
    guide.look(2 * S, there);
    assert!(matches!(guide.stage(3 * S + 1), Stage::Arriving(_)));
    guide.look(3 * S, there);
    assert!(matches!(guide.stage(3 * S), Stage::Back(_)));
    // Rotated too far, or not seen any more: not there.
    guide.look(3 * S + 1, seen(-0.2, 0.0, 0.1));
    assert!(matches!(guide.stage(3 * S + 1), Stage::Away(_)));
    guide.look(4 * S, there);
    guide.look(5 * S, there);
    assert!(matches!(guide.stage(5 * S), Stage::Back(_)));
    assert_eq!(guide.stage(8 * S), Stage::Unseen);
    guide.look(9 * S, there);
    assert!(matches!(guide.stage(9 * S), Stage::Arriving(_)));
}

#[test]
fn the_line_fits_a_terminal_of_80_columns() {
    let far = seen(-19.87, -12.34, -2.9);
    for tolerance in [0.01, 100.0] {
        let mut guide = Guide::new(
            START,
            StartTolerance {
                position_m: tolerance,
                heading_rad: 4.0,
            },
        );
        assert!(guide.line(0).chars().count() <= 80);
        guide.look(0, seen(-0.201, -0.001, -0.001));
        assert!(guide.line(0).starts_with("x -0.20 y 0.00 m, 0\u{b0}"));
        for k in 0..3 {
            guide.look(k * S, far);
            let line = guide.line(k * S);
            assert!(
                line.chars().count() <= 80,
                "{}: {line}",
                line.chars().count()
            );
        }
    }
}
