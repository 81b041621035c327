//! States of a plan, as seen from outside.

use super::*;

fn state(b: &Bench) -> PlanState {
    b.shared.plan(|p| p.clone())
}

#[test]
fn a_plan_waits_runs_and_completes() {
    for kind in KINDS {
        let mut b = bench(kind, |_| {});
        assert_eq!(state(&b), PlanState::None);
        b.run_ms(60);
        let start_ns = b.now() + 200 * MS;
        b.orders
            .try_send(Order::Plan {
                start_ns,
                duration_s: 0.5,
                load: Box::new(constant(5.0)),
            })
            .unwrap();
        b.run_ms(100);
        assert_eq!(state(&b), PlanState::Waiting, "{kind:?}");
        b.run_ms(200);
        assert_eq!(state(&b), PlanState::Running, "{kind:?}");
        b.run_ms(1000);
        assert_eq!(state(&b), PlanState::Completed, "{kind:?}");
        // A command to be quiet afterwards does not take it back.
        NeutralHandle(b.shared.clone()).request(NeutralReason::Request);
        b.run_ms(50);
        assert_eq!(state(&b), PlanState::Completed, "{kind:?}");
    }
}

#[test]
fn a_plan_without_a_link_is_refused_in_words() {
    let mut b = bench(LinkKind::Stamped, |_| {});
    b.cable.unplug();
    b.plan(1.0, constant(5.0));
    b.run_ms(100);
    assert!(
        matches!(state(&b), PlanState::Refused(why) if why.contains("no link")),
        "{:?}",
        state(&b)
    );
}

#[test]
fn after_a_persons_stop_no_plan_and_no_set_point_moves_anything() {
    for kind in KINDS {
        let mut b = bench(kind, |_| {});
        b.run_ms(60);
        // The key is pressed in the very moment in which the plan is ordered, before the service looks.
        b.orders
            .try_send(Order::Plan {
                start_ns: b.now() + 5 * MS,
                duration_s: 1.0,
                load: Box::new(constant(5.0)),
            })
            .unwrap();
        NeutralHandle(b.shared.clone()).bar(NeutralReason::Request);
        b.run_ms(300);
        assert!(
            matches!(state(&b), PlanState::Refused(why) if why.contains("someone stopped")),
            "{kind:?} {:?}",
            state(&b)
        );
        // Nor later, nor by hand.
        b.plan(1.0, constant(5.0));
        b.orders.try_send(Order::Arm).unwrap();
        b.orders
            .try_send(Order::SetPoint(SetPoint {
                due_ns: 0,
                thrust_n: vec![5.0, 5.0],
                plan_step: 0,
            }))
            .unwrap();
        b.run_ms(1500);
        let moved = b.commands().into_iter().find(|c| c.pulse_us != 1500.0);
        assert!(moved.is_none(), "{kind:?} {moved:?}");
    }
}

#[test]
fn every_early_end_names_its_reason() {
    type End = fn(&mut Bench);
    let ends: [(End, NeutralReason); 3] = [
        (|b| b.cable.unplug(), NeutralReason::Lost),
        (
            |b| b.clock.advance(Duration::from_millis(200)),
            NeutralReason::Deadline,
        ),
        (
            |b| NeutralHandle(b.shared.clone()).request(NeutralReason::Limit),
            NeutralReason::Limit,
        ),
    ];
    for (end, reason) in ends {
        let mut b = bench(LinkKind::Stamped, |_| {});
        b.plan(60.0, constant(10.0));
        b.run_ms(500);
        assert_eq!(state(&b), PlanState::Running);
        end(&mut b);
        b.run_ms(1000);
        assert_eq!(state(&b), PlanState::Aborted(reason));
    }
    let mut b = bench(LinkKind::Stamped, |_| {});
    b.plan(1.0, constant(60.0));
    b.run_ms(200);
    assert_eq!(state(&b), PlanState::Aborted(NeutralReason::Range));
    let mut b = bench(LinkKind::Stamped, |_| {});
    b.plan(60.0, constant(10.0));
    b.run_ms(500);
    b.shared.stop.store(true, Ordering::Release);
    b.run_ms(1000);
    assert_eq!(state(&b), PlanState::Aborted(NeutralReason::Exit));
}

#[test]
fn a_resumed_plan_completes_only_if_it_is_followed_at_its_end() {
    for (back, want) in [
        (true, PlanState::Completed),
        (false, PlanState::Aborted(NeutralReason::Lost)),
    ] {
        let mut b = bench(LinkKind::Stamped, |c| c.resume_after_loss = true);
        b.plan(3.0, constant(10.0));
        b.run_ms(500);
        b.cable.unplug();
        b.run_ms(500);
        assert_eq!(state(&b), PlanState::Running);
        if back {
            b.cable.replug();
        }
        b.run_ms(3000);
        assert_eq!(state(&b), want);
    }
}

#[test]
fn a_panic_aborts_the_plan() {
    let mut b = bench(LinkKind::Stamped, |_| {});
    b.plan(60.0, |t_s| {
        assert!(t_s < 0.4, "the plan breaks");
        PlannedLoad {
            thrust_n: vec![10.0; 2],
            pulses_us: None,
            plan_step: 1,
        }
    });
    assert!(catch_unwind(AssertUnwindSafe(|| b.run_ms(1000))).is_err());
    b.core.panicked("the plan breaks");
    assert_eq!(state(&b), PlanState::Aborted(NeutralReason::Panic));
}
