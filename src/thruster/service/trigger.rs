//! Waiting for the autopilot's side to begin a recording, before anything else is opened.

use super::Opener;
use crate::link::{LinkEvent, ThrusterLink, protocol_for};
use hydroline_rigs::ThrusterSet;
use std::time::Duration;

/// Longest wait before `stopped` is asked again, and between two attempts to open the line.
const LOOK: Duration = Duration::from_millis(100);
/// Longest wait for a line that takes no bytes.
const WRITE: Duration = Duration::from_millis(100);

/// Listens on the line until a recording is to begin (true) or `stopped` says so (false). A line that is not there, or goes, is
/// opened again and again; `say` hears of each new reason.
pub fn wait_for_recording(
    set: &ThrusterSet,
    opener: &mut Opener,
    stopped: &dyn Fn() -> bool,
    say: &mut dyn FnMut(&str),
) -> bool {
    let mut last = String::new();
    while !stopped() {
        let why = match opener() {
            Err(error) => error.to_string(),
            Ok(opened) => {
                let mut link = ThrusterLink::new(protocol_for(set), opened.transport, WRITE);
                match listen(&mut link, stopped) {
                    Ok(begins) => return begins,
                    Err(error) => format!("{}: {error}", opened.name),
                }
            }
        };
        if why != last {
            say(&why);
            last = why;
        }
        std::thread::sleep(LOOK);
    }
    false
}

fn listen(link: &mut ThrusterLink, stopped: &dyn Fn() -> bool) -> std::io::Result<bool> {
    link.open()?;
    while !stopped() {
        let events = link.poll(LOOK / 5)?;
        let begins = |e: &LinkEvent| matches!(e, LinkEvent::Recording { on: true });
        if events.iter().any(begins) {
            return Ok(true);
        }
    }
    Ok(false)
}
