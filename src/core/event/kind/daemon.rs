//! Events of the run as a whole: the daemon's parts, its log, its clocks, limits and calibration.

use super::{EventKind, EventValue, Severity, kinds};

kinds! {
    DAEMON_READY "daemon.ready" [Info]
        "The first good frame is here, and the controller where one is needed: the run begins." {};
    DAEMON_STOP "daemon.stop" [Info]
        "The run ends; the message says why." {};
    DAEMON_STANDING "daemon.standing" [Warning]
        "Capture, log writer or thruster service has shown no sign of life for a second. The service manager's watchdog is not fed meanwhile." {};
    DAEMON_PANIC "daemon.panic" [Error]
        "A thread of the daemon panicked, which is a bug of hydroline; the run ends." {};
    PLAN_PLACE "plan.place" [Info, Warning, Error]
        "Where the vehicle is measured before a plan begins, and what the plan does from there. As a warning: the target is lost from there, or the place is not measured. As an error: the plan does not begin, since the vehicle would leave the tank or `[limits]`, or since a service does not measure its place." {};
    PLAN_START "plan.start" [Info]
        "The plan starts." {};
    LIMIT_PASSED "limit.passed" [Error]
        "The vehicle has passed a limit of `[limits]`; the thrusters go to neutral and the run ends." {};
    LIMIT_BLIND "limit.blind" [Error]
        "No good frame for some seconds, so nobody watches the vehicle; the thrusters go to neutral, the recording goes on." {};
    LIMIT_UNWATCHED "limit.unwatched" [Warning]
        "The rig's model cannot be simulated: x, y and pitch are watched only where the target is measured." {};
    CALIBRATION_NONE "calibration.none" [Info, Warning]
        "There is no calibration: plane coordinates come from the rig's ideal camera, or there are none." {};
    CALIBRATION_NO_BOARD "calibration.no_board" [Warning]
        "The calibration board was not found in a frame; the message says why." {};
    CALIBRATION_PROGRESS "calibration.progress" [Info]
        "What is still missing for a calibration has changed." {
        "frames" ["frames"] "frames with the board that are used",
        "nodes" [""] "nodes of the board seen",
        "coverage" ["share"] "share of the board that is covered, 0..1",
        "worst_sd_m" ["m"] "standard deviation of a plane coordinate where it is largest",
    };
    CALIBRATION_ACCEPTED "calibration.accepted" [Info]
        "The calibration is accepted, and written to a file and to the log." {
        "frames" ["frames"] "frames with the board that are used",
        "nodes" [""] "nodes of the board seen",
        "coverage" ["share"] "share of the board that is covered, 0..1",
        "worst_sd_m" ["m"] "standard deviation of a plane coordinate where it is largest",
    };
    CLOCK_STEP "clock.step" [Warning]
        "The realtime clock was set: stamps before and after do not compare." {
        "step_s" ["s"] "by how much, positive forward",
    };
    LOG_ROTATED "log.rotated" [Info]
        "The log goes on in its next part (`log.rotate_bytes`)." {
        "part" [""] "number of the part",
    };
    LOG_ROTATION_FAILED "log.rotation_failed" [Warning]
        "The next part cannot be opened; the log goes on in the part that it has." {};
    LOG_FRAMES_DROPPED "log.frames_dropped" [Error]
        "The disk is too slow: the queue is full and frames are not written. Said when it begins and when it ends." {
        "queue_mb" ["MB"] "when it begins: size of what waits in the queue",
        "dropped" ["frames"] "when it ends: frames that were not written",
    };
    LOG_NAME_LOST "log.name_lost" [Error]
        "The log's file is no longer found under its name. Data go on into it, and it is saved at its end." {};
    DISK_LOW "disk.low" [Error]
        "The disk has less room than `log.min_free_bytes`; the log is closed while it can be, and the run ends." {};
}
