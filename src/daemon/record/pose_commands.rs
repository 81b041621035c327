//! Commands on their way from the thruster service to the poses, which carry the vehicle's place by them.

use hydroline_core::lock::Lock;
use hydroline_thruster::CommandRecord;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex};

/// Commands that may wait for the next frame: eight thrusters at 50 Hz for 20 s, where poses are fitted some times a second.
const WAITING: usize = 8192;

/// When (UNIX, ns), thruster, thrust \[N\].
type Posted = (u64, Arc<str>, f64);

pub(super) struct PoseCommands {
    post: SyncSender<Posted>,
    inbox: Mutex<Receiver<Posted>>,
}

impl Default for PoseCommands {
    fn default() -> Self {
        let (post, inbox) = sync_channel(WAITING);
        Self {
            post,
            inbox: Mutex::new(inbox),
        }
    }
}

impl PoseCommands {
    /// Posts a command that was sent. Never waits: the thruster service calls it. Where nobody fetches (no poses are fitted) what
    /// finds no room is dropped: it carries nothing.
    pub fn post(&self, command: &CommandRecord) {
        let posted = (
            command.timestamp_ns,
            command.thruster.clone(),
            command.thrust_n,
        );
        // Dropped where there is no room.
        let _full = self.post.try_send(posted);
    }

    /// Fetches what was posted, the oldest first.
    pub fn fetched(&self) -> Vec<Posted> {
        self.inbox.held().try_iter().collect()
    }
}
