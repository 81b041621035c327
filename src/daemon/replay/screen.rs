//! The live page of a replay: the run's plan and its own start, as the recording's session states them.

use super::Options;
use crate::live::unhurried::Unhurried;
use hydroline_log::MetadataMap;
use hydroline_rigs::{Plan, Rig};

/// The page, when one is shown.
pub(super) fn of(options: &Options, session: &MetadataMap) -> Option<Unhurried> {
    let (live, rig) = options.live.as_ref()?;
    let rig = rig.as_deref().map(|rig| at_start(rig, session));
    let map = options.map.clone();
    let mut screen = Unhurried::new(live, "replay", options.rule, rig.as_ref(), map);
    if let Some(name) = session.get("plan.name") {
        screen.plan(name, steps(session));
    }
    Some(screen)
}

/// The rig at the run's own start: a repeated run starts where the one before has left the vehicle.
pub fn at_start(rig: &Rig, session: &MetadataMap) -> Rig {
    let mut rig = rig.clone();
    let stated = session.get("start_pose");
    let pose: Option<[f64; 6]> = stated.and_then(|text| serde_json::from_str(text).ok());
    if let Some(pose) = pose.filter(|pose| pose.iter().all(|v| v.is_finite())) {
        rig.tank.start_pose = pose;
    }
    rig
}

/// Steps of the run's plan; 0 = not known.
fn steps(session: &MetadataMap) -> u32 {
    let plan = session
        .get("plan")
        .and_then(|text| Plan::from_toml(text, "plan").ok());
    plan.map_or(0, |plan| plan.steps.len() as u32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_starts_where_its_session_says_and_has_its_plans_steps() {
        let rig = Rig::builtin("lshpi").unwrap();
        let mut session = MetadataMap::new();
        assert_eq!(
            at_start(&rig, &session).tank.start_pose,
            rig.tank.start_pose
        );
        assert_eq!(steps(&session), 0);
        let pose = [0.25, -0.5, 0.125, 0.0, 0.0, 0.1];
        session.insert("start_pose".into(), format!("{pose:?}"));
        session.insert(
            "plan".into(),
            Plan::builtin("surge-4n").unwrap().source_toml,
        );
        assert_eq!(at_start(&rig, &session).tank.start_pose, pose);
        let expected = Plan::builtin("surge-4n").unwrap().steps.len() as u32;
        assert_eq!(steps(&session), expected);
        session.insert("start_pose".into(), "somewhere".into());
        assert_eq!(
            at_start(&rig, &session).tank.start_pose,
            rig.tank.start_pose
        );
    }
}
