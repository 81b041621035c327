//! The live page of a recording: image, stripe, pose and loads; STOP, measured at the controller; viewers that cost nothing.
//!
//! Everyday tests speak HTTP themselves and compare; figures in seconds, and a real browser, are in [`figures`].

pub(crate) mod figures;
mod run;

use crate::http::{Viewer, ask, picture, session_key};
use run::{Recording, State, finish};
use std::time::{Duration, Instant};

/// Asks for states until one will do.
fn state_when(
    viewer: &mut Viewer,
    will_do: impl Fn(&serde_json::Value) -> bool,
) -> serde_json::Value {
    let until = Instant::now() + Duration::from_secs(60);
    let mut after = 0;
    loop {
        let answer = viewer.ask(&format!("GET /state?after={after}"), "");
        if answer.status == 200 {
            let json = answer.json();
            if will_do(&json["state"]) {
                return json["state"].clone();
            }
            after = json["number"].as_u64().unwrap();
        }
        assert!(
            Instant::now() < until,
            "no such state; the last: {}",
            answer.text()
        );
    }
}

#[test]
fn image_stripe_pose_and_loads_are_on_the_page_and_stop_stops() {
    let _alone = crate::support::alone();
    // As long as a busy computer may need for a pose; ended below.
    let running = Recording::start(State::Viewed, 120.0);
    let address = running.address();
    let mut viewer = Viewer::new(address);
    let state = state_when(&mut viewer, |s| {
        s["pose"]["channels"][0]["residual"].is_f64()
            && s["thrusters"][0]["echo_n"].is_f64()
            && s["run"]["step"] == 1
    });
    let pose = &state["pose"]["channels"];
    assert_eq!(pose[2]["name"], "z_m");
    assert!(
        (pose[2]["value"].as_f64().unwrap() + 0.83).abs() < 0.02,
        "{pose}"
    );
    assert!(pose[2]["residual"].as_f64().unwrap().abs() < 0.02, "{pose}");
    let loads = state["thrusters"].as_array().unwrap();
    assert_eq!(loads.len(), 8);
    assert!(loads[0]["thrust_n"].as_f64().unwrap() > 1.0, "{state}");
    let missing = state["not_shown"].as_array().unwrap();
    assert!(
        missing.iter().any(|m| m == "yaw drag: not yet excited"),
        "{missing:?}"
    );
    let shown = viewer.ask("GET /picture", "");
    let (overlay, jpeg) = picture(&shown);
    assert_eq!(jpeg[..2], [0xff, 0xd8]);
    assert!(overlay["stripe_px"].as_array().unwrap().len() > 100);
    let metrics = ask(address, "GET /metrics", "").text();
    assert!(
        metrics.contains("hydroline_thrust_newtons{thruster=\"h_fore_stbd\"}"),
        "{metrics}"
    );

    // Somebody else's STOP does nothing, the page's own brings every output to neutral while the plan would go on.
    let refused = ask(address, "POST /stop", "Origin: http://evil.example\r\n");
    assert_eq!(refused.status, 403);
    assert!(running.neutral_since(running.now_ns()).is_none());
    let key = format!("X-Hydroline-Session: {}\r\n", session_key(address));
    let pressed_ns = running.now_ns();
    assert_eq!(ask(address, "POST /stop", &key).status, 200);
    state_when(&mut viewer, |s| {
        s["stop"]["pressed"] == true && s["thrusters"][0]["echo_n"] == 0.0
    });
    let neutral_ns = running.neutral_since(pressed_ns).unwrap();
    println!(
        "neutral at the controller {:.1} ms after STOP",
        (neutral_ns - pressed_ns) as f64 * 1e-6
    );
    state_when(&mut viewer, |s| {
        let events = s["events"].as_array().unwrap();
        let said = |e: &serde_json::Value| {
            e["message"]
                .as_str()
                .is_some_and(|m| m.starts_with("STOP on the live page"))
        };
        events.iter().any(said)
    });
    running.end();
    let ended = finish(running);
    assert!(
        ended.pushes_after(neutral_ns).is_empty(),
        "nothing moves any more"
    );
}

/// Frames, or commands, that a busy computer loses by itself.
const BY_ITSELF: u64 = 2;

/// Pairs of runs, at most. What viewers cost they cost in every pair; the load of other programs comes and goes.
const PAIRS: usize = 3;

#[test]
fn viewers_slow_and_hostile_cost_no_frame_and_no_command() {
    let _alone = crate::support::alone();
    let mut costs = Vec::new();
    for _ in 0..PAIRS {
        match cost_of_viewers() {
            None => return,
            Some(cost) => costs.push(cost),
        }
    }
    panic!("viewers cost something in each of {PAIRS} pairs of runs: {costs:#?}");
}

/// Cost of a crowd of viewers: a run with them against a run without; `None` for no cost.
fn cost_of_viewers() -> Option<String> {
    let alone = finish(Recording::start(State::Unseen, 5.0));
    let running = Recording::start(State::Viewed, 5.0);
    let crowd = run::Crowd::gather(running.address());
    let beside = finish(running);
    let seen = crowd.leave();
    let commands = |ended: &run::Ended| {
        let stats = ended.report.thrusters.unwrap();
        stats.skipped + stats.losses
    };
    let sets = |ended: &run::Ended| ended.report.thrusters.unwrap().sets as f64;
    let (with_ms, without_ms) = (beside.away_ms(0.5), alone.away_ms(0.5));
    let costs = [
        // They are served last: on a busy computer a few times each.
        (
            seen.states <= 8 || seen.pictures <= 8,
            format!("viewers are not served: {seen:?}"),
        ),
        (
            beside.lost() > alone.lost() + BY_ITSELF,
            format!(
                "{} frames lost with viewers, {} without",
                beside.lost(),
                alone.lost()
            ),
        ),
        (
            commands(&beside) > commands(&alone) + BY_ITSELF,
            format!(
                "{} commands lost with viewers, {} without",
                commands(&beside),
                commands(&alone)
            ),
        ),
        (
            (sets(&beside) / sets(&alone) - 1.0).abs() >= 0.2,
            format!(
                "{} commands with viewers, {} without",
                sets(&beside),
                sets(&alone)
            ),
        ),
        // The capture thread is kept away from its camera no longer than without them, within what two busy cores scatter.
        (
            with_ms >= 20.0 * without_ms + 1.0,
            format!("away from the camera {with_ms} ms with viewers, {without_ms} ms without"),
        ),
    ];
    costs
        .into_iter()
        .find_map(|(costly, said)| costly.then_some(said))
}
