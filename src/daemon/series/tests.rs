//! A series driven event by event.

use super::*;

const RULES: Rules = Rules {
    plans: Plans::Given,
    next: 1,
    last: 3,
    usable: 0,
    settle: Duration::from_secs(120),
    return_to_start: false,
};

fn proposed(starts: Starts) -> Rules {
    Rules {
        plans: Plans::Proposed(starts),
        ..RULES
    }
}

fn made(stop: StopReason) -> Event {
    Event::Recorded(Made {
        stop,
        lost: false,
        few_poses: None,
        misplaced: false,
        not_calibrated: None,
        neutral_open: false,
    })
}

fn finished() -> Event {
    made(StopReason::Finished)
}

fn done(lossy: bool) -> Action {
    Action::End(End::Done { lossy })
}

fn record(run: u32, offer: usize) -> Action {
    Action::Record { run, offer }
}

fn propose(run: u32, left: usize) -> Action {
    Action::Propose { run, left }
}

/// Actions behind the first, of a series to which these events happen.
fn driven(rules: Rules, events: Vec<Event>) -> (Vec<Action>, Vec<String>) {
    let (mut series, first) = Series::begin(rules);
    let mut steps = vec![first];
    steps.extend(events.into_iter().map(|e| series.next(e)));
    let said = steps
        .iter()
        .filter_map(|s| Some(s.say.as_ref()?.to_string()));
    let said = said.collect();
    (steps.into_iter().map(|s| s.action).collect(), said)
}

#[test]
fn runs_of_a_given_plan_settle_in_between() {
    let pause = Action::Settle(RULES.settle);
    let ready = || Event::Ready(true);
    let events = vec![finished(), ready(), finished(), ready(), finished()];
    let (actions, said) = driven(RULES, events);
    let wanted = [
        record(1, 0),
        pause.clone(),
        record(2, 0),
        pause,
        record(3, 0),
        done(false),
    ];
    assert_eq!(actions, wanted);
    assert!(said.is_empty(), "{said:?}");
}

#[test]
fn the_vehicle_is_brought_back_before_all_runs_of_a_plan_but_the_first() {
    let rules = Rules {
        return_to_start: true,
        ..RULES
    };
    let events = vec![
        finished(),
        Event::Ready(true),
        Event::Ready(true),
        finished(),
    ];
    let (actions, _) = driven(rules, events);
    let back = Action::Return { run: 2 };
    assert_eq!(
        actions[1..4],
        [Action::Settle(RULES.settle), back, record(2, 0)]
    );
    assert_eq!(actions[4], Action::Settle(RULES.settle));
    // Broken off on the way.
    let events = vec![finished(), Event::Ready(true), Event::Ready(false)];
    let (actions, said) = driven(rules, events);
    assert_eq!(actions[3], done(false));
    assert_eq!(said, ["stopped between runs; 1 of 3 runs are recorded"]);
}

#[test]
fn a_run_that_somebody_ended_is_the_last_and_no_failure() {
    let (actions, _) = driven(RULES, vec![made(StopReason::Asked("q"))]);
    assert_eq!(actions[1], done(false));
}

#[test]
fn a_run_that_failed_is_the_last_whatever_else_is_said_of_it() {
    let failures = [
        StopReason::Failed("the camera is gone".to_owned()),
        StopReason::Limit("pitch".to_owned()),
        StopReason::PlanAborted("no echo".to_owned()),
    ];
    for rules in [RULES, proposed(Starts::Unasked)] {
        for stop in failures.clone() {
            let words = stop.to_string();
            let (mut series, _) = Series::begin(rules);
            let step = series.next(made(stop));
            assert_eq!(step.action, Action::End(End::Failed(words)));
        }
    }
}

#[test]
fn a_log_in_another_place_and_a_calibration_that_is_missing_end_the_series() {
    let with = |misplaced, not_calibrated: Option<&str>| {
        let event = Event::Recorded(Made {
            stop: StopReason::Finished,
            lost: false,
            few_poses: None,
            misplaced,
            not_calibrated: not_calibrated.map(str::to_owned),
            neutral_open: false,
        });
        driven(RULES, vec![event]).0.pop()
    };
    let failed = |words: &str| Some(Action::End(End::Failed(words.to_owned())));
    assert_eq!(with(true, Some("no board")), failed(MISPLACED));
    assert_eq!(with(false, Some("no board")), failed("no board"));
}

#[test]
fn a_full_disk_ends_a_given_series_and_not_one_that_proposes() {
    let full = || made(StopReason::LogStopped("full".to_owned()));
    assert_eq!(driven(RULES, vec![full()]).0[1], done(true));
    let (actions, _) = driven(proposed(Starts::Unasked), vec![Event::Proposed, full()]);
    assert_eq!(actions[2], Action::Examine { run: 1 });
}

#[test]
fn what_was_lost_in_one_run_is_said_and_stays_with_the_series() {
    let few = Event::Recorded(Made {
        stop: StopReason::Finished,
        lost: false,
        few_poses: Some("only 2 of 90".to_owned()),
        misplaced: false,
        not_calibrated: None,
        neutral_open: false,
    });
    let rules = Rules { last: 2, ..RULES };
    let (actions, said) = driven(rules, vec![few, Event::Ready(true), finished()]);
    assert_eq!(actions[3], done(true));
    assert_eq!(said, ["only 2 of 90"]);
}

#[test]
fn no_run_follows_one_whose_neutral_is_not_confirmed() {
    let open = |stop, few_poses: Option<&str>| {
        Event::Recorded(Made {
            stop,
            lost: false,
            few_poses: few_poses.map(str::to_owned),
            misplaced: false,
            not_calibrated: None,
            neutral_open: true,
        })
    };
    let (actions, said) = driven(RULES, vec![open(StopReason::Finished, None)]);
    assert_eq!(actions[1], done(true));
    assert!(said[0].contains("not confirmed neutral"), "{said:?}");
    let events = vec![
        Event::Proposed,
        open(StopReason::Finished, Some("only 2 of 90")),
    ];
    let (actions, said) = driven(proposed(Starts::Unasked), events);
    assert_eq!(actions[2], done(true));
    assert!(said[0].contains("only 2 of 90") && said[0].contains("not confirmed"));
    // A run that failed stays failed.
    let stop = StopReason::Limit("x = 9 m".to_owned());
    let words = stop.to_string();
    let (actions, said) = driven(RULES, vec![open(stop, None)]);
    assert_eq!(actions[1], Action::End(End::Failed(words)));
    assert_eq!(said.len(), 1);
}

#[test]
fn plans_are_proposed_chosen_run_and_looked_at_until_the_verdict_stands() {
    let rules = Rules {
        return_to_start: true,
        next: 2,
        usable: 1,
        ..proposed(Starts::Asked)
    };
    let events = vec![
        Event::Proposed,
        Event::Chosen(Some(1)),
        Event::Ready(true),
        finished(),
        Event::Examined { stop: false },
        Event::Concluded,
    ];
    let (actions, said) = driven(rules, events);
    let wanted = [
        propose(2, 2),
        Action::Choose,
        Action::Return { run: 2 },
        record(2, 1),
        Action::Examine { run: 2 },
        propose(3, 1),
        done(false),
    ];
    assert_eq!(actions, wanted);
    assert_eq!(said, ["goes on from 1 run(s) of this series"]);
}

#[test]
fn unasked_a_plan_starts_by_itself_and_nobody_brings_the_vehicle_back() {
    let rules = Rules {
        return_to_start: true,
        ..proposed(Starts::Unasked)
    };
    let (actions, _) = driven(rules, vec![Event::Proposed]);
    assert_eq!(actions, [propose(1, 3), record(1, 0)]);
}

#[test]
fn a_plan_that_is_only_shown_is_not_run() {
    let (actions, _) = driven(proposed(Starts::Never), vec![Event::Proposed]);
    assert_eq!(actions[1], done(false));
}

#[test]
fn whoever_ends_a_proposing_series_hears_what_the_next_one_goes_on_from() {
    let asked = proposed(Starts::Asked);
    let (actions, said) = driven(asked, vec![Event::Proposed, Event::Chosen(None)]);
    assert_eq!(actions[2], done(false));
    let words = "ended by you; the same command goes on from 0 run(s)";
    assert_eq!(said, [words]);
    // In a run: its poses are found before the end.
    let asked_to_stop = vec![
        Event::Proposed,
        Event::Chosen(Some(0)),
        made(StopReason::Asked("q")),
        Event::Examined { stop: false },
    ];
    let (actions, said) = driven(asked, asked_to_stop);
    assert_eq!(actions[3..], [Action::Examine { run: 1 }, done(false)]);
    assert_eq!(said, ["ended by you; the same command goes on from here"]);
    // At the page, while they are found.
    let (mut series, _) = Series::begin(asked);
    let step = series.next(Event::Examined { stop: true });
    assert_eq!(step.say, Some(Line::EndedHere));
}

#[test]
fn behind_the_last_run_none_is_left() {
    let rules = Rules {
        next: 3,
        usable: 2,
        ..proposed(Starts::Unasked)
    };
    let events = vec![Event::Proposed, finished(), Event::Examined { stop: false }];
    assert_eq!(driven(rules, events).0.pop(), Some(propose(4, 0)));
}
