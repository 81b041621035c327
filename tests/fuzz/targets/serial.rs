//! Bytes from the serial line: framed and bare messages, the simulated controller, and the host's
//! side of the Maestro protocol. What parses is what encodes to the same bytes.
#![no_main]

use hydroline::thruster::maestro::{CommandParser, Request, Responses};
use hydroline::thruster::stamped::{ControllerMessage, Deframer, HostMessage};
use libfuzzer_sys::fuzz_target;

#[path = "support/memory.rs"]
mod memory;
use memory::bounded;

fuzz_target!(|bytes: &[u8]| bounded(bytes.len(), 1 << 16, 64, || serial(bytes)));

fn serial(bytes: &[u8]) {
    let mut deframer = Deframer::default();
    for &byte in bytes {
        if let Some(Ok(payload)) = deframer.feed(byte) {
            let _ = HostMessage::parse(&payload);
            let _ = ControllerMessage::parse(&payload);
        }
    }
    if let Ok(message) = HostMessage::parse(bytes) {
        let mut framed = Vec::new();
        message.encode(&mut framed);
        assert_eq!(back(&framed), bytes, "{message:?}");
    }
    if let Ok(message) = ControllerMessage::parse(bytes) {
        let mut framed = Vec::new();
        message.encode(&mut framed);
        assert_eq!(back(&framed), bytes, "{message:?}");
    }
    let mut commands = CommandParser::default();
    let mut responses = Responses::new(50_000_000, 5_000_000);
    for (n, &byte) in bytes.iter().enumerate() {
        let _ = commands.feed(byte);
        let now_ns = n as u64 * 3_000_000;
        if byte & 3 == 0 {
            responses.expect(Request::Errors, now_ns);
        }
        let _ = responses.feed(byte, now_ns);
        let _ = responses.tick(now_ns + u64::from(byte) * 1_000_000);
    }
}

/// The payload in one frame.
fn back(framed: &[u8]) -> Vec<u8> {
    let mut deframer = Deframer::default();
    framed
        .iter()
        .find_map(|&byte| deframer.feed(byte))
        .expect("a frame ends")
        .expect("our own frame is sound")
}
