use super::*;
use proptest::prelude::*;

const MS: u64 = 1_000_000;
const POSITION: Request = Request::Position {
    channel: 2,
    min: 4400,
    max: 7600,
};

fn feed_all(r: &mut Responses, bytes: &[u8], at_ns: u64) -> Vec<Response> {
    bytes.iter().filter_map(|b| r.feed(*b, at_ns)).collect()
}

#[test]
fn set_target_is_the_guides_example() {
    // User's Guide 5.e: channel 2 to 1500 us = 6000 quarters = 0x84 0x02 0x70 0x2E.
    assert_eq!(set_target(2, 6000), Some([0x84, 0x02, 0x70, 0x2e]));
    assert_eq!(set_target(128, 6000), None);
    assert_eq!(set_target(2, 0x4000), None);
}

#[test]
fn answers_come_in_order() {
    let mut r = Responses::new(50 * MS, 5 * MS);
    r.expect(POSITION, 0);
    r.expect(Request::Errors, 0);
    let got = feed_all(&mut r, &[0x70, 0x17, 0x20, 0x00], MS);
    assert_eq!(
        got,
        [
            Response::Answer {
                request: POSITION,
                value: 6000
            },
            Response::Answer {
                request: Request::Errors,
                value: ERROR_SERIAL_TIMEOUT
            },
        ]
    );
    assert_eq!(
        error_names(ERROR_SERIAL_TIMEOUT | 1),
        ["serial signal error", "serial timeout"]
    );
}

#[test]
fn a_lost_byte_shifts_nothing() {
    let mut r = Responses::new(50 * MS, 5 * MS);
    r.expect(POSITION, 0);
    r.expect(POSITION, 0);
    // First byte lost: 0x17 0x70 = 28695 is not believable.
    let got = feed_all(&mut r, &[0x17, 0x70, 0x17], MS);
    assert_eq!(
        got,
        [Response::Resync {
            lost: 2,
            reason: ResyncReason::Implausible
        }]
    );
    assert!(r.resyncing(3 * MS));
    r.expect(POSITION, 10 * MS);
    let got = feed_all(&mut r, &[0x70, 0x17], 11 * MS);
    assert_eq!(
        got,
        [Response::Answer {
            request: POSITION,
            value: 6000
        }]
    );
}

#[test]
fn silence_and_surplus_resync() {
    let mut r = Responses::new(50 * MS, 5 * MS);
    r.expect(POSITION, 0);
    assert_eq!(r.tick(50 * MS), None);
    assert_eq!(
        r.tick(51 * MS),
        Some(Response::Resync {
            lost: 1,
            reason: ResyncReason::Timeout
        })
    );
    assert_eq!(r.tick(52 * MS), None);
    assert_eq!(
        r.feed(1, 60 * MS),
        Some(Response::Resync {
            lost: 0,
            reason: ResyncReason::Surplus
        })
    );
}

proptest! {
    #[test]
    fn commands_survive_their_own_encoding(channel in 0u8..128, quarter_us in 0u16..=MAX_TARGET) {
        let mut parser = CommandParser::default();
        let bytes = set_target(channel, quarter_us).unwrap();
        let got: Vec<_> = bytes.iter().filter_map(|b| parser.feed(*b)).collect();
        prop_assert_eq!(got, vec![Command::SetTarget { channel, quarter_us }]);
    }

    #[test]
    fn arbitrary_bytes_never_panic_and_a_clean_command_is_understood_after_them(
        garbage in prop::collection::vec(any::<u8>(), 0..200)
    ) {
        let mut parser = CommandParser::default();
        for b in &garbage {
            parser.feed(*b);
        }
        let bytes = set_target(3, 6000).unwrap();
        let got: Vec<_> = bytes.iter().filter_map(|b| parser.feed(*b)).collect();
        prop_assert_eq!(got.last(), Some(&Command::SetTarget { channel: 3, quarter_us: 6000 }));
    }

    #[test]
    fn arbitrary_answers_never_panic_and_quiet_ends_the_resync(
        garbage in prop::collection::vec((any::<u8>(), 0u64..20 * MS), 0..200)
    ) {
        let mut r = Responses::new(50 * MS, 5 * MS);
        let mut now = 0;
        for (byte, wait) in garbage {
            now += wait;
            r.tick(now);
            r.feed(byte, now);
            if byte & 1 == 1 {
                r.expect(POSITION, now);
            }
        }
        now += 100 * MS;
        r.tick(now);
        now += 10 * MS;
        prop_assert!(!r.resyncing(now));
        r.expect(POSITION, now);
        let got = feed_all(&mut r, &[0x70, 0x17], now);
        prop_assert_eq!(got, vec![Response::Answer { request: POSITION, value: 6000 }]);
    }
}
