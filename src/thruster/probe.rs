//! Who is at the other end of the line? Asked without moving anything: no command of [`probe`] changes an output.
//!
//! A `stamped` controller is asked for its status, a Maestro for its error register and the positions of the rig's
//! channels. What does not answer as it should is distinguished by what it does answer to:
//!
//! | seen | it is |
//! |---|---|
//! | our own bytes | a line that echoes: loopback plug, or a half-duplex adapter |
//! | a Maestro answers only after 0xAA | factory mode "UART, detect baud rate": after each power-up it waits for that byte |
//! | a Maestro answers only with a CRC byte | CRC mode: it ignores every command without one |
//! | nothing | no power, another baud rate, another protocol, RX and TX the wrong way round |
//!
//! Source: Pololu Maestro Servo Controller User's Guide, sections 5.a (serial modes), 5.d (CRC), 5.e (commands).

use super::ChannelPulse;
use super::link::LinkEvent;
use super::maestro::{self, GET_ERRORS};
use super::mavlink::follow::Follower;
use super::mavlink::{Content, Heard};
use super::stamped::{ControllerMessage, Deframer, HostMessage, OutputState};
use super::transport::Transport;
use hydroline_rigs::{LinkKind, ThrusterSet};
use std::io;
use std::time::Duration;

/// Longest wait for an answer: a hundred byte times at 9600 baud, and a USB adapter's latency timer (16 ms) with it.
const ANSWER_WITHIN: Duration = Duration::from_millis(200);
/// The byte by which a Maestro in its factory mode learns the baud rate (User's Guide 5.a).
const DETECT_BAUD: u8 = 0xAA;

/// A controller that answered.
#[derive(Debug, Clone, PartialEq)]
pub struct Answered {
    /// Pulses that it puts out on the rig's channels; 0 us = none. Channels it does not have are missing.
    pub pulses: Vec<ChannelPulse>,
    /// Names of error bits that it reports now.
    pub errors: Vec<&'static str>,
    /// Its own watchdog \[ms\], where it reports it.
    pub watchdog_ms: Option<u16>,
}

/// Reason why a controller cannot be used as it is.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum ProbeError {
    #[error(
        "opened, but nothing answers: check power, TX/RX wiring, the baud rate of rig and controller, and thrusters.link.kind"
    )]
    Silent,
    #[error(
        "the line echoes what is sent to it: take out the loopback plug, or switch the adapter's echo off (half-duplex RS-485)"
    )]
    Echoes,
    #[error(
        "a Maestro in its factory mode 'UART, detect baud rate': set 'UART, fixed baud rate' (or 'USB dual port' over USB) in the Pololu Maestro Control Center, Serial Settings"
    )]
    DetectsBaud,
    #[error(
        "a Maestro in CRC mode, which ignores commands without a check sum: take the tick off 'Enable CRC' in the Pololu Maestro Control Center, Serial Settings"
    )]
    Crc,
    #[error(
        "something answers, but not as a {protocol} controller does ({bytes} bytes, first {first:02x?}): check the baud rate and thrusters.link.kind"
    )]
    Nonsense {
        protocol: &'static str,
        bytes: usize,
        first: Vec<u8>,
    },
    #[error(
        "an autopilot answers, but does not say what it puts out (SERVO_OUTPUT_RAW, ACTUATOR_OUTPUT_STATUS): raise the rate of its RC_CHANNELS stream (SRx_RC_CHAN of ArduSub), and look whether its servo outputs are assigned"
    )]
    NoOutputs,
    #[error("the line failed: {0}")]
    Io(#[from] io::Error),
}

/// Asks once; see the module.
pub fn probe(set: &ThrusterSet, line: &mut dyn Transport) -> Result<Answered, ProbeError> {
    let channels: Vec<u8> = set.thrusters.iter().map(|t| t.channel).collect();
    match set.link.kind {
        LinkKind::Stamped => stamped(&channels, line),
        LinkKind::Maestro => maestro(&channels, line),
        LinkKind::Mavlink => autopilot(set, line),
    }
}

/// Sends and listens until `enough` bytes have come or the patience is over.
fn ask(line: &mut dyn Transport, question: &[u8], enough: usize) -> io::Result<Vec<u8>> {
    let sent = line.write(question, ANSWER_WITHIN)?;
    let until_ns = sent.last_byte_out_ns + ANSWER_WITHIN.as_nanos() as u64;
    let (mut got, mut buffer) = (Vec::new(), [0u8; 256]);
    while got.len() < enough {
        let now_ns = line.now_ns();
        if now_ns >= until_ns {
            break;
        }
        let n = line.read(&mut buffer, Duration::from_nanos(until_ns - now_ns))?;
        got.extend_from_slice(&buffer[..n]);
    }
    Ok(got)
}

/// Waits until the line is quiet, and forgets what came.
fn drain(line: &mut dyn Transport) -> io::Result<()> {
    let mut buffer = [0u8; 256];
    let until_ns = line.now_ns() + ANSWER_WITHIN.as_nanos() as u64;
    while line.now_ns() < until_ns && line.read(&mut buffer, ANSWER_WITHIN / 10)? > 0 {}
    Ok(())
}

/// Longest wait for an autopilot's heartbeat (1 /s) and outputs after it.
const HEARTBEAT_WITHIN: Duration = Duration::from_secs(3);

/// Listens as a recording does; what is sent is a heartbeat and the requests for messages.
fn autopilot(set: &ThrusterSet, line: &mut dyn Transport) -> Result<Answered, ProbeError> {
    let mut follower = Follower::new(set.link.autopilot(), set.link.rate_hz);
    follower.opened(line.now_ns());
    let until_ns = line.now_ns() + HEARTBEAT_WITHIN.as_nanos() as u64;
    let (mut first, mut bytes, mut is_sound) = (Vec::new(), 0, false);
    let (mut out, mut buffer, mut events) = (Vec::new(), [0u8; 256], Vec::new());
    while line.now_ns() < until_ns {
        out.clear();
        follower.housekeeping(line.now_ns(), &mut out);
        if !out.is_empty() {
            follower.sent(line.write(&out, ANSWER_WITHIN)?.last_byte_out_ns);
        }
        let got = line.read(&mut buffer, ANSWER_WITHIN / 10)?;
        bytes += got;
        first.extend_from_slice(&buffer[..got.min(8_usize.saturating_sub(first.len()))]);
        follower.receive(&buffer[..got], line.now_ns(), &mut events);
        for event in events.drain(..) {
            is_sound |= event.is_sound();
            if let LinkEvent::Heard(Heard {
                what: Content::Outputs(pulses),
                ..
            }) = event
            {
                return Ok(Answered {
                    pulses,
                    errors: Vec::new(),
                    watchdog_ms: None,
                });
            }
        }
    }
    Err(match (is_sound, bytes) {
        (true, _) => ProbeError::NoOutputs,
        (false, 0) => ProbeError::Silent,
        (false, _) => ProbeError::Nonsense {
            protocol: "mavlink",
            bytes,
            first,
        },
    })
}

fn nonsense(protocol: &'static str, got: &[u8]) -> ProbeError {
    ProbeError::Nonsense {
        protocol,
        bytes: got.len(),
        first: got.iter().take(8).copied().collect(),
    }
}

fn stamped(channels: &[u8], line: &mut dyn Transport) -> Result<Answered, ProbeError> {
    drain(line)?;
    let token = 0x6879_6472;
    // A delimiter first: it ends whatever the last owner of the line left half sent.
    let mut question = vec![0];
    HostMessage::GetStatus { token }.encode(&mut question);
    let got = ask(line, &question, 256)?;
    if got.is_empty() {
        return Err(ProbeError::Silent);
    }
    if got.starts_with(&question) {
        return Err(ProbeError::Echoes);
    }
    let mut deframer = Deframer::default();
    for byte in &got {
        let Some(Ok(payload)) = deframer.feed(*byte) else {
            continue;
        };
        if let Ok(ControllerMessage::Status {
            token: answered,
            errors,
            watchdog_ms,
            pulses,
            state,
            ..
        }) = ControllerMessage::parse(&payload)
            && answered == token
        {
            let mut errors = super::stamped::error::names(errors);
            if state == OutputState::Watchdog {
                errors.push("its watchdog has acted");
            }
            return Ok(Answered {
                pulses: pulses
                    .into_iter()
                    .filter(|p| channels.contains(&p.channel))
                    .collect(),
                errors,
                watchdog_ms: Some(watchdog_ms),
            });
        }
    }
    Err(nonsense("stamped", &got))
}

/// CRC-7 as the Maestro has it (User's Guide 5.d: polynomial 0x91, least significant bit first).
fn crc7(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0u8, |crc, byte| {
        (0..8).fold(crc ^ byte, |crc, _| {
            if crc & 1 != 0 {
                (crc ^ 0x91) >> 1
            } else {
                crc >> 1
            }
        })
    })
}

/// The two bytes of an error register: nine bits are assigned.
fn errors_of(got: &[u8]) -> Option<u16> {
    match got {
        [low, high @ 0..=1] => Some(u16::from_le_bytes([*low, *high])),
        _ => None,
    }
}

fn maestro(channels: &[u8], line: &mut dyn Transport) -> Result<Answered, ProbeError> {
    // Two data bytes end a command that was left half sent, as the link does when it opens.
    line.write(&[0, 0], ANSWER_WITHIN)?;
    drain(line)?;
    // The first reading clears what that may have set, and whatever is older.
    let first = ask(line, &[GET_ERRORS], 2)?;
    if first.first() == Some(&GET_ERRORS) {
        return Err(ProbeError::Echoes);
    }
    if first.is_empty() {
        return Err(silent_maestro(line)?);
    }
    if errors_of(&first).is_none() {
        return Err(nonsense("maestro", &first));
    }
    let mut pulses = Vec::new();
    for channel in channels {
        let Some(question) = maestro::get_position(*channel) else {
            continue;
        };
        // A channel that this model does not have is not answered, and sets an error bit.
        if let [low, high] = ask(line, &question, 2)?[..] {
            pulses.push(ChannelPulse {
                channel: *channel,
                quarter_us: u16::from_le_bytes([low, high]),
            });
        }
    }
    let again = ask(line, &[GET_ERRORS], 2)?;
    let bits = errors_of(&again).ok_or_else(|| nonsense("maestro", &again))?;
    Ok(Answered {
        pulses,
        errors: maestro::error_names(bits),
        watchdog_ms: None,
    })
}

/// Error for a Maestro that does not answer to a plain question.
fn silent_maestro(line: &mut dyn Transport) -> io::Result<ProbeError> {
    let checked = [GET_ERRORS, crc7(&[GET_ERRORS])];
    if errors_of(&ask(line, &checked, 2)?).is_some() {
        return Ok(ProbeError::Crc);
    }
    drain(line)?;
    // Harmless where it is not waited for: 0xAA also begins the Pololu protocol, and a command byte ends it again.
    if errors_of(&ask(line, &[DETECT_BAUD, GET_ERRORS], 2)?).is_some() {
        return Ok(ProbeError::DetectsBaud);
    }
    Ok(ProbeError::Silent)
}

#[cfg(test)]
mod tests;
