//! Notifications to a service manager (systemd, sd_notify(3)): ready, alive, stopping. Nothing where there is none.

use sd_notify::NotifyState;

/// Camera and, with a plan, controller are there: the recording has begun.
pub(super) fn ready() {
    tell(&[NotifyState::Ready, NotifyState::Status("recording")]);
}

/// Capture, log writer and thruster service all went on: within every `WatchdogSec` of the unit, or systemd ends the process, and with its commands
/// the controller's own watchdog goes to neutral.
pub(super) fn alive() {
    tell(&[NotifyState::Watchdog]);
}

/// Neutral has been asked for, the log is being closed.
pub(super) fn stopping(why: &str) {
    tell(&[NotifyState::Stopping, NotifyState::Status(why)]);
}

fn tell(state: &[NotifyState<'_>]) {
    if let Err(error) = sd_notify::notify(state) {
        tracing::debug!("the service manager was not notified: {error}");
    }
}
