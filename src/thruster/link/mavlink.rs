//! An autopilot behind [`Protocol`]: nothing is commanded, everything is heard.

use super::{LinkEvent, Protocol};
use crate::ChannelPulse;
use crate::clocksync::Estimate;
use crate::mavlink::follow::Follower;

impl Protocol for Follower {
    fn bytes_per_set(&self, _: usize) -> (usize, usize) {
        (0, 0)
    }

    fn opened(&mut self, now_ns: u64, out: &mut Vec<u8>) {
        Follower::opened(self, now_ns);
        self.housekeeping(now_ns, out);
    }

    /// The service sends none to an autopilot that drives.
    fn set_pulses(&mut self, _: u32, _: &[ChannelPulse], _: bool, _: &mut Vec<u8>) {}

    fn housekeeping(&mut self, now_ns: u64, out: &mut Vec<u8>) {
        Follower::housekeeping(self, now_ns, out);
    }

    fn sent(&mut self, last_byte_out_ns: u64) {
        Follower::sent(self, last_byte_out_ns);
    }

    fn receive(&mut self, bytes: &[u8], at_ns: u64, events: &mut Vec<LinkEvent>) {
        Follower::receive(self, bytes, at_ns, events);
    }

    fn tick(&mut self, _: u64, _: &mut Vec<LinkEvent>) {}

    fn clock(&self) -> Option<Estimate> {
        Follower::clock(self)
    }

    fn tell(&mut self, words: &str) {
        Follower::tell(self, words);
    }
}
