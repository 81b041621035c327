//! The probe against devices that behave, and against those that do not.

use super::*;
use crate::controller::{ControllerConfig, Faults};
use crate::loopback::Loopback;
use crate::transport::Sent;
use hydroline_core::clock::{Clock, ManualClock};
use hydroline_rigs::Rig;
use std::sync::Arc;

/// Answers each write by a function of all bytes since the power-up.
struct Device<F> {
    now_ns: u64,
    answer: F,
    waiting: Vec<u8>,
    /// Everything it was sent.
    heard: Vec<u8>,
}

impl<F: FnMut(&[u8]) -> Vec<u8> + Send> Transport for Device<F> {
    fn now_ns(&self) -> u64 {
        self.now_ns
    }
    fn write(&mut self, bytes: &[u8], _: Duration) -> io::Result<Sent> {
        self.heard.extend_from_slice(bytes);
        let answer = (self.answer)(bytes);
        self.waiting.extend(answer);
        Ok(Sent {
            last_byte_out_ns: self.now_ns,
            bytes: bytes.len(),
        })
    }
    fn read(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        let n = self.waiting.len().min(buffer.len());
        buffer[..n].copy_from_slice(&self.waiting[..n]);
        self.waiting.drain(..n);
        self.now_ns += if n == 0 {
            timeout.as_nanos() as u64
        } else {
            1000
        };
        Ok(n)
    }
    fn unsent_bytes(&mut self) -> Option<usize> {
        Some(0)
    }
}

fn device<F: FnMut(&[u8]) -> Vec<u8> + Send>(answer: F) -> Device<F> {
    Device {
        now_ns: 1,
        answer,
        waiting: Vec::new(),
        heard: Vec::new(),
    }
}

fn set(kind: LinkKind) -> ThrusterSet {
    let mut set = Rig::builtin("lshpi").unwrap().thrusters;
    set.link.kind = kind;
    set
}

/// Answers of a Maestro to one write in compact protocol: no errors, 1500 us everywhere.
fn plain_maestro(bytes: &[u8]) -> Vec<u8> {
    match bytes {
        [GET_ERRORS] => vec![0, 0],
        [maestro::GET_POSITION, _] => 6000u16.to_le_bytes().to_vec(),
        _ => Vec::new(),
    }
}

#[test]
fn a_healthy_controller_says_what_it_puts_out_and_nothing_moves() {
    for kind in [LinkKind::Stamped, LinkKind::Maestro] {
        let set = set(kind);
        let clock = Arc::new(ManualClock::new(1_760_000_000_000_000_000, 1_000_000));
        let cable = Loopback::new(
            ControllerConfig::for_rig(&set),
            clock.clone() as Arc<dyn Clock>,
        );
        let mut line = cable.open().unwrap();
        let answered = probe(&set, &mut line).unwrap();
        assert_eq!(answered.pulses.len(), set.thrusters.len(), "{kind:?}");
        assert!(answered.errors.is_empty(), "{kind:?}: {answered:?}");
        assert!(
            cable.take_events().is_empty(),
            "{kind:?}: an output changed"
        );
        cable.with(|c| {
            c.set_faults(Faults {
                mute: true,
                ..Faults::default()
            });
        });
        let silent = probe(&set, &mut line);
        assert!(matches!(silent, Err(ProbeError::Silent)), "{kind:?}");
    }
}

#[test]
fn a_line_that_echoes_our_own_bytes_is_named() {
    for kind in [LinkKind::Stamped, LinkKind::Maestro] {
        let mut line = device(<[u8]>::to_vec);
        let found = probe(&set(kind), &mut line);
        assert!(
            matches!(found, Err(ProbeError::Echoes)),
            "{kind:?}: {found:?}"
        );
    }
    // A half-duplex adapter: the echo, then the controller's answer.
    let mut line = device(|bytes| [bytes, &plain_maestro(bytes)].concat());
    let found = probe(&set(LinkKind::Maestro), &mut line);
    assert!(matches!(found, Err(ProbeError::Echoes)), "{found:?}");
}

#[test]
fn a_maestro_in_factory_mode_and_one_in_crc_mode_are_distinguished_from_a_healthy_one() {
    let healthy = probe(&set(LinkKind::Maestro), &mut device(plain_maestro)).unwrap();
    assert!(healthy.pulses.iter().all(|p| p.pulse_us() == 1500.0));

    let mut known = false;
    let mut factory = device(move |bytes| match bytes {
        [DETECT_BAUD, rest @ ..] => {
            known = true;
            plain_maestro(rest)
        }
        _ if known => plain_maestro(bytes),
        _ => Vec::new(),
    });
    let found = probe(&set(LinkKind::Maestro), &mut factory);
    assert!(matches!(found, Err(ProbeError::DetectsBaud)), "{found:?}");

    let mut crc = device(|bytes| match bytes {
        [command @ .., sum] if !command.is_empty() && crc7(command) == *sum => {
            plain_maestro(command)
        }
        _ => Vec::new(),
    });
    let found = probe(&set(LinkKind::Maestro), &mut crc);
    assert!(matches!(found, Err(ProbeError::Crc)), "{found:?}");
    for line in [factory.heard, crc.heard] {
        assert!(
            !line.contains(&maestro::SET_TARGET) && !line.contains(&maestro::GO_HOME),
            "{line:02x?}"
        );
    }
}

#[test]
fn the_check_sum_is_the_guides() {
    // User's Guide 5.d: the command 0x83, 0x01 has the check sum 0x17.
    assert_eq!(crc7(&[0x83, 0x01]), 0x17);
}

#[test]
fn something_else_at_the_line_is_said_with_what_it_sends() {
    for kind in [LinkKind::Stamped, LinkKind::Maestro] {
        let mut gps = device(|_| b"$GPGGA,123519,4807.038,N*47\r\n".to_vec());
        let Err(ProbeError::Nonsense { first, .. }) = probe(&set(kind), &mut gps) else {
            panic!("{kind:?}");
        };
        assert!(first.starts_with(b"$G"), "{first:?}");
    }
}
