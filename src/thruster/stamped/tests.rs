use super::*;
use crate::ChannelPulse;
use proptest::prelude::*;
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};

fn pulses(list: &[(u8, u16)]) -> Vec<ChannelPulse> {
    list.iter()
        .map(|(channel, quarter_us)| ChannelPulse {
            channel: *channel,
            quarter_us: *quarter_us,
        })
        .collect()
}

/// The wire bytes of a named example in the protocol document (made by hand, not by this encoder).
fn example(name: &str) -> Vec<u8> {
    let line = include_str!("../stamped.md")
        .lines()
        .find_map(|l| l.strip_prefix(name).filter(|rest| rest.starts_with("  ")))
        .unwrap_or_else(|| panic!("no example {name}"));
    line.split_whitespace()
        .map(|hex| u8::from_str_radix(hex, 16).unwrap())
        .collect()
}

fn deframe(bytes: &[u8]) -> Vec<Result<Vec<u8>, FrameError>> {
    let mut deframer = Deframer::default();
    bytes.iter().filter_map(|b| deframer.feed(*b)).collect()
}

fn bytes_of(message: &ControllerMessage) -> Vec<u8> {
    let mut out = Vec::new();
    message.encode(&mut out);
    out
}

fn sample_ack() -> ControllerMessage {
    ControllerMessage::Ack {
        sequence: 7,
        time_us: 4_294_967_200,
        errors: 0,
        pulses: pulses(&[(0, 6000), (3, 6400)]),
    }
}

#[test]
fn the_crc_is_the_named_one() {
    assert_eq!(crc16(b"123456789"), 0x29b1);
}

#[test]
fn the_documents_host_frames_are_what_is_sent_and_understood() {
    let cases = [
        (
            "SetPulses",
            HostMessage::SetPulses {
                sequence: 7,
                pulses: pulses(&[(0, 6000), (3, 6400)]),
            },
        ),
        (
            "TimeSync",
            HostMessage::TimeSync {
                host_us: 123_456_789_012,
            },
        ),
        ("Neutral", HostMessage::Neutral { sequence: 8 }),
        ("GetStatus", HostMessage::GetStatus { token: 9 }),
        (
            "Configure",
            HostMessage::Configure {
                token: 1,
                watchdog_ms: 500,
                neutral: 6000,
                min: 4400,
                max: 7600,
            },
        ),
    ];
    for (name, message) in cases {
        let mut out = Vec::new();
        message.encode(&mut out);
        assert_eq!(out, example(name), "{name}");
        let payload = deframe(&out).remove(0).unwrap();
        assert_eq!(HostMessage::parse(&payload), Ok(message), "{name}");
    }
}

#[test]
fn the_documents_controller_frames_are_what_is_sent_and_understood() {
    let cases = [
        ("Ack", sample_ack()),
        (
            "TimeSyncReply",
            ControllerMessage::TimeSyncReply {
                host_us: 123_456_789_012,
                rx_us: 1_000_000,
                tx_us: 1_002_344,
                boot_id: 0x5a01,
            },
        ),
        (
            "Status",
            ControllerMessage::Status {
                token: 9,
                time_us: 2_000_000,
                boot_id: 0x5a01,
                errors: error::WATCHDOG,
                state: OutputState::Watchdog,
                watchdog_ms: 500,
                frames_ok: 41,
                frames_bad: 1,
                pulses: pulses(&[(0, 6000)]),
            },
        ),
    ];
    for (name, message) in cases {
        let out = bytes_of(&message);
        assert_eq!(out, example(name), "{name}");
        let payload = deframe(&out).remove(0).unwrap();
        assert_eq!(ControllerMessage::parse(&payload), Ok(message), "{name}");
    }
}

#[test]
fn the_longest_frame_fits_and_one_byte_more_does_not() {
    let message = ControllerMessage::Status {
        token: 1,
        time_us: 2,
        boot_id: 3,
        errors: 4,
        state: OutputState::Start,
        watchdog_ms: 5,
        frames_ok: 6,
        frames_bad: 7,
        pulses: (0..24)
            .map(|channel| ChannelPulse {
                channel,
                quarter_us: 6000,
            })
            .collect(),
    };
    let bytes = bytes_of(&message);
    assert_eq!(bytes.len(), MAX_FRAME);
    assert!(deframe(&bytes)[0].is_ok());
    let long = vec![1u8; MAX_FRAME];
    assert_eq!(
        deframe(&long),
        [Err(FrameError::TooLong { max: MAX_FRAME })]
    );
    // And the next frame is understood.
    let mut after = vec![1u8; 5000];
    after.push(0);
    after.extend(&bytes);
    let got = deframe(&after);
    assert_eq!(got.len(), 2);
    assert!(got[1].is_ok());
}

#[test]
fn every_error_has_its_own_words() {
    let frame = |raw: &[u8]| {
        let mut raw = raw.to_vec();
        let crc = crc16(&raw);
        raw.extend_from_slice(&crc.to_le_bytes());
        let mut wire = cobs::encode_vec(&raw);
        wire.push(0);
        deframe(&wire).remove(0).unwrap()
    };
    assert_eq!(
        HostMessage::parse(&frame(&[2, 3, 0, 0, 0, 0])),
        Err(FrameError::Version { got: 2 })
    );
    assert_eq!(
        HostMessage::parse(&frame(&[1, 9])),
        Err(FrameError::Type { got: 9 })
    );
    assert_eq!(
        HostMessage::parse(&frame(&[1, 3, 0, 0, 0])),
        Err(FrameError::Length { kind: 3, len: 5 })
    );
    assert_eq!(
        HostMessage::parse(&frame(&[1, 3, 0, 0, 0, 0, 0])),
        Err(FrameError::Length { kind: 3, len: 7 })
    );
    assert_eq!(
        HostMessage::parse(&frame(&[1, 1, 0, 0, 0, 0, 25])),
        Err(FrameError::Value { kind: 1, got: 25 })
    );
    assert_eq!(deframe(&[5, 1, 0]), [Err(FrameError::Cobs { len: 2 })]);
    assert_eq!(deframe(&[2, 1, 0]), [Err(FrameError::Short { len: 1 })]);
    assert_eq!(deframe(&[0, 0, 0]), []);
}

/// Flips the given bits of an Ack in a stream Ack, damaged Ack, Ack; the two sound ones must come through unless a
/// delimiter was hit, and nothing else may.
fn damaged(flips: &[(usize, u8)]) -> Vec<ControllerMessage> {
    let good = bytes_of(&sample_ack());
    let mut bad = good.clone();
    for (at, bit) in flips {
        bad[*at] ^= 1 << bit;
    }
    let stream = [good.clone(), bad, good].concat();
    deframe(&stream)
        .into_iter()
        .flatten()
        .filter_map(|p| ControllerMessage::parse(&p).ok())
        .collect()
}

#[test]
fn every_one_and_two_bit_flip_is_noticed() {
    let bits = bytes_of(&sample_ack()).len() * 8;
    let at = |bit: usize| (bit / 8, (bit % 8) as u8);
    let mut undetected = 0;
    for a in 0..bits {
        for b in a..bits {
            let flips = if a == b {
                vec![at(a)]
            } else {
                vec![at(a), at(b)]
            };
            let got = damaged(&flips);
            assert!(got.len() <= 2 || got.iter().all(|m| *m == sample_ack()));
            undetected += usize::from(got.len() > 2 || got.iter().any(|m| *m != sample_ack()));
            // The first frame is over before the damage: it always comes through.
            assert_eq!(got.first(), Some(&sample_ack()));
        }
    }
    assert_eq!(undetected, 0, "of {} damages", bits * (bits + 1) / 2);
}

#[test]
fn random_damage_is_dropped_but_for_the_share_a_16_bit_check_must_let_pass() {
    let good = bytes_of(&sample_ack());
    let mut rng = StdRng::seed_from_u64(7);
    let (mut accepted, damages) = (0, 200_000);
    for _ in 0..damages {
        let mut bad = good.clone();
        for _ in 0..rng.random_range(1..12) {
            let at = rng.random_range(0..bad.len());
            bad[at] ^= 1 << rng.random_range(0..8);
        }
        if bad == good {
            continue;
        }
        bad.push(0);
        accepted += deframe(&bad)
            .into_iter()
            .flatten()
            .filter(|p| ControllerMessage::parse(p).is_ok_and(|m| m != sample_ack()))
            .count();
    }
    println!(
        "{accepted} of {damages} damaged frames accepted; chance alone: {:.1}",
        f64::from(damages) / 65536.0
    );
    // Exactly reproducible; a check that were not a good 16-bit one would let hundreds pass.
    assert!(accepted <= 6, "{accepted}");
}

proptest! {
    #[test]
    fn arbitrary_bytes_never_panic_and_a_frame_after_them_is_understood(
        garbage in prop::collection::vec(any::<u8>(), 0..400)
    ) {
        let mut stream = garbage;
        stream.push(0);
        stream.extend(bytes_of(&sample_ack()));
        let payloads: Vec<_> = deframe(&stream).into_iter().flatten().collect();
        for payload in &payloads {
            let _ = HostMessage::parse(payload);
        }
        let last = payloads.last().map(|p| ControllerMessage::parse(p));
        prop_assert_eq!(last, Some(Ok(sample_ack())));
    }

    #[test]
    fn arbitrary_payloads_never_panic(payload in prop::collection::vec(any::<u8>(), 0..120)) {
        let mut sound = vec![VERSION];
        sound.extend(&payload);
        for bytes in [&payload, &sound] {
            let _ = HostMessage::parse(bytes);
            let _ = ControllerMessage::parse(bytes);
        }
    }

    #[test]
    fn any_set_of_pulses_survives(sequence: u32, list in prop::collection::vec((any::<u8>(), any::<u16>()), 0..=24)) {
        let message = HostMessage::SetPulses { sequence, pulses: pulses(&list) };
        let mut out = Vec::new();
        message.encode(&mut out);
        prop_assert_eq!(out.len(), 9 + 3 * list.len() + 2);
        prop_assert!(!out[..out.len() - 1].contains(&0));
        let payload = deframe(&out).remove(0).unwrap();
        prop_assert_eq!(HostMessage::parse(&payload), Ok(message));
    }
}
