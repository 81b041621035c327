use super::*;
use hydroline_calib::analytic::IdealMap;
use hydroline_plan::preflight::preflight;
use hydroline_stripe::ExtractorConfig;

/// A value of a pose that is not shown is `None`.
type Shown = Option<[Option<f64>; 6]>;

fn rig() -> Rig {
    Rig::builtin("lshpi").unwrap()
}

/// The paper's surge run of 4 N, a metre ahead.
fn job(rig: &Rig, unattended: bool) -> Job {
    Job {
        rig: rig.clone(),
        plan: Some(Plan::builtin("surge-4n").unwrap()),
        length: None,
        ready_within: Duration::from_secs(10),
        extractor: ExtractorConfig::default(),
        calibrate: None,
        unattended,
    }
}

fn launcher(job: &Job) -> Launcher {
    let map: Arc<dyn PlaneMap> = Arc::new(IdealMap::of(&job.rig));
    Launcher::new(job, job.plan.as_ref().unwrap(), Some(map))
}

/// The k-th look, every 40 ms, at a new pose.
fn look(job: &Job, k: u32, shown: Shown) -> Look {
    let ready_for = Duration::from_millis(40) * k;
    let now_ns = 1_000_000_000 + ready_for.as_nanos() as u64;
    Look {
        now_ns,
        ready_for,
        is_late: ready_for > job.ready_within,
        pose: shown.map(|values| MeasuredPose {
            received_ns: now_ns,
            eta: values.map(|value| value.map(|v| (v, 0.001))),
        }),
    }
}

/// What comes of looks at these poses, and after how many simulations.
fn decided(job: &Job, shown: impl Fn(u32) -> Shown) -> (Next, u32) {
    let Launcher {
        mut launch,
        subject,
        ..
    } = launcher(job);
    let mut simulations = 0;
    for k in 0..500 {
        match launch.look(&look(job, k, shown(k))) {
            Next::Wait => {}
            Next::Simulate(start) => {
                simulations += 1;
                launch.simulated(subject.violations(start));
            }
            next => return (next, simulations),
        }
    }
    unreachable!("no decision")
}

fn whole(pose: [f64; 6]) -> Shown {
    Some(pose.map(Some))
}

fn ahead(rig: &Rig, by_m: f64) -> [f64; 6] {
    let mut pose = rig.tank.start_pose;
    pose[0] += by_m;
    pose
}

/// The rig in a tank that ends 0.2 m beyond where the plan gets to from the rig's start.
fn short_tank() -> Rig {
    let mut rig = rig();
    let plan = Plan::builtin("surge-4n").unwrap();
    let reach_m = preflight(&rig, &plan).unwrap().ranges[0].max;
    rig.tank.x_m[1] = reach_m + 0.2;
    rig.limits.x_m[1] = reach_m + 0.2;
    rig
}

#[test]
fn a_vehicle_half_a_metre_ahead_is_not_driven_out_of_the_tank() {
    let rig = short_tank();
    for unattended in [false, true] {
        let (next, simulations) = decided(&job(&rig, unattended), |_| whole(ahead(&rig, 0.5)));
        let Next::Refuse(words) = next else {
            unreachable!("{next:?}")
        };
        for part in [
            "measured at x 0.300 m",
            "x against the tank",
            "--return-to-start",
        ] {
            assert!(words.contains(part), "no '{part}' in: {words}");
        }
        assert_eq!(words.contains("systemctl stop"), unattended, "{words}");
        assert_eq!(simulations, CONFIRM);
    }
}

#[test]
fn a_vehicle_as_near_its_start_as_hands_bring_it_begins_at_once() {
    let rig = short_tank();
    let mut near = rig.tank.start_pose;
    near[1] += 0.029;
    near[5] -= 2.9f64.to_radians();
    for pose in [rig.tank.start_pose, near] {
        let (next, simulations) = decided(&job(&rig, true), |_| whole(pose));
        let severity = Severity::Info;
        assert!(
            matches!(&next, Next::Begin { pose: at, severity: s, .. } if *at == pose && *s == severity),
            "{next:?}"
        );
        assert_eq!(simulations, 0);
    }
}

#[test]
fn one_false_pose_refuses_no_plan() {
    let rig = short_tank();
    let (next, simulations) = decided(&job(&rig, true), |k| {
        whole(match k {
            0 => ahead(&rig, 0.5),
            _ => rig.tank.start_pose,
        })
    });
    assert!(matches!(next, Next::Begin { .. }), "{next:?}");
    assert_eq!(simulations, 1);
}

#[test]
fn a_pose_that_speaks_against_the_plan_counts_where_none_follows() {
    let rig = short_tank();
    for unattended in [false, true] {
        let only = |k: u32| whole(ahead(&rig, 0.5)).filter(|_| k == 0);
        let (next, _) = decided(&job(&rig, unattended), only);
        assert!(
            matches!(&next, Next::Refuse(words) if words.contains("x against the tank")),
            "{next:?}"
        );
    }
}

#[test]
fn a_plan_that_loses_its_target_from_there_begins_with_a_warning() {
    let rig = rig();
    let (next, _) = decided(&job(&rig, true), |_| whole(ahead(&rig, 0.5)));
    let Next::Begin {
        pose,
        severity,
        words,
    } = next
    else {
        unreachable!("{next:?}")
    };
    assert_eq!((pose, severity), (ahead(&rig, 0.5), Severity::Warning));
    assert!(
        words.contains("but at ") && words.contains("target"),
        "{words}"
    );
}

#[test]
fn what_a_plan_does_from_the_rigs_start_as_well_refuses_nothing() {
    let mut rig = rig();
    rig.limits.x_m[1] = rig.tank.start_pose[0] + 0.2;
    let (next, simulations) = decided(&job(&rig, true), |_| whole(ahead(&rig, 0.1)));
    assert!(matches!(next, Next::Begin { .. }), "{next:?}");
    assert_eq!(simulations, 1);
}

#[test]
fn without_a_pose_a_service_drives_nothing_and_whoever_watches_is_warned() {
    let rig = rig();
    // Over the bare floor: height and roll, and no place.
    let floor = [None, None, Some(-0.83), Some(0.0), None, None];
    for shown in [None, Some(floor)] {
        let (next, _) = decided(&job(&rig, true), |_| shown);
        assert!(
            matches!(&next, Next::Refuse(words) if words.contains(NO_POSE) && words.contains("systemctl stop")),
            "{next:?}"
        );
        let (next, _) = decided(&job(&rig, false), |_| shown);
        assert!(
            matches!(&next, Next::Begin { pose, severity: Severity::Warning, words }
                if *pose == rig.tank.start_pose && words.contains(NO_POSE)),
            "{next:?}"
        );
    }
}

#[test]
fn where_no_pose_can_come_none_is_waited_for() {
    let mut rig = rig();
    rig.target = None;
    for unattended in [false, true] {
        let job = job(&rig, unattended);
        let next = launcher(&job).launch.look(&look(&job, 0, None));
        assert!(
            matches!(&next, Next::Begin { severity: Severity::Warning, words, .. } if words.contains(NO_TARGET)),
            "{next:?}"
        );
    }
}

#[test]
fn whoever_looks_does_not_wait_for_the_simulation() {
    let rig = short_tank();
    let job = job(&rig, false);
    let mut launcher = launcher(&job);
    let mut next = Next::Wait;
    let mut looks = 0;
    while next == Next::Wait {
        // Time stands still: what is waited for is the simulations' threads.
        let mut at = look(&job, 0, whole(ahead(&rig, 0.5)));
        if let Some(pose) = &mut at.pose {
            pose.received_ns -= looks;
        }
        looks += 1;
        assert!(looks < 100_000, "no simulation ends");
        next = launcher.look(&at);
        std::thread::sleep(Duration::from_millis(1));
    }
    assert!(matches!(next, Next::Refuse(_)), "{next:?}");
}
