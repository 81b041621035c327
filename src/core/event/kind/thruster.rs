//! Events between the daemon and the thruster controller.

use super::{EventKind, EventValue, Severity, kinds};

kinds! {
    SERIAL_OPEN "serial.open" [Info, Warning]
        "The serial line is open. As a warning: it cannot be opened, or takes no bytes, and is tried again." {
        "count" [""] "times that it opened but took no bytes, since it was last said",
        "attempts" [""] "attempts to open it that failed, since it was last said",
    };
    SERIAL_LOW_LATENCY "serial.low_latency" [Info, Warning]
        "How soon the line's driver hands over what it has received. A warning where it waits." {};
    SERIAL_LOST "serial.lost" [Error]
        "The link to the thruster controller is lost. Neutral is the first thing it is sent when it is back." {};
    SERIAL_BACK "serial.back" [Info]
        "The link is there again; neutral was sent first." {
        "away_s" ["s"] "time for which it was lost",
    };
    THRUSTER_NEUTRAL "thruster.neutral" [Info, Warning, Error]
        "All thrusters go to neutral; the message says why. An error where that cut a running plan short or is not confirmed by the controller; for information where somebody asked for it." {};
    THRUSTER_REFUSED "thruster.refused" [Warning, Error]
        "A plan was not started or a set-point not taken: no link, thrusters stopped, or a pulse out of range." {
        "count" [""] "set-points not taken, since it was last said",
    };
    THRUSTER_DEADLINE "thruster.deadline" [Error]
        "A set-point came too late; the thrusters go to neutral." {
        "late_s" ["s"] "how late it was",
        "allowed_s" ["s"] "`thrusters.link.deadline_s`",
    };
    THRUSTER_SLEW_LIMITED "thruster.slew_limited" [Warning]
        "A pulse would change faster than `thrusters.max_slew_us_per_s`; it goes there in a ramp. Said at the ramp's begin." {
        "wanted_us" ["us"] "pulse width wanted",
        "sent_us" ["us"] "pulse width sent",
        "limit_us_per_s" ["us/s"] "largest rate of change",
    };
    THRUSTER_NO_ECHO "thruster.no_echo" [Error]
        "The controller answers, but does not echo commands; the thrusters go to neutral." {
        "unechoed_s" ["s"] "age of the oldest command without an echo",
        "allowed_s" ["s"] "`thrusters.link.timeout_s`",
    };
    THRUSTER_ECHO_MISMATCH "thruster.echo_mismatch" [Warning]
        "The controller's echo has another pulse width than was sent, or other channels. At most once a second." {
        "sent_us" ["us"] "pulse width sent",
        "echo_us" ["us"] "pulse width that the controller puts out, where it says one",
        "count" [""] "sets like this, since it was last said",
    };
    THRUSTER_CONTRADICTED "thruster.contradicted" [Error]
        "The controller goes on putting out other pulses than it was sent, or does not say what it puts out; the thrusters go to neutral." {
        "sent_us" ["us"] "pulse width sent",
        "echo_us" ["us"] "pulse width that the controller puts out, where it says one",
        "for_s" ["s"] "for how long it has done so",
        "allowed_s" ["s"] "`thrusters.link.timeout_s`",
    };
    THRUSTER_FAULT "thruster.fault" [Error]
        "Every answer of the controller reports errors; the thrusters go to neutral." {
        "bits" [""] "the controller's error bits, of the last report",
        "for_s" ["s"] "for how long it has done so",
        "allowed_s" ["s"] "`thrusters.link.timeout_s`",
    };
    AUTOPILOT_MISSED "autopilot.missed" [Warning]
        "Messages of the autopilot did not arrive, by its counter; at most once a second." {
        "messages" [""] "messages missed since the start",
    };
    AUTOPILOT_RECORDING "autopilot.recording" [Info]
        "The autopilot's side began or ended the recording: arming, a MAVLink command or a mission item." {};
    THRUSTER_CLOCK_RATE "thruster.clock_rate" [Warning]
        "The controller's clock runs at another rate than any sound one: its pulses are off by as much. Said once after each of its starts." {
        "drift_ppm" ["ppm"] "rate against this computer's clock, positive = fast",
        "drift_sd_ppm" ["ppm"] "its standard deviation",
        "allowed_ppm" ["ppm"] "what is taken for usual",
    };
    THRUSTER_UNANSWERED "thruster.unanswered" [Warning]
        "Commands were not answered by the controller. At most once a second." {
        "sequence" [""] "sequence number of the oldest",
        "sets" [""] "sets of commands without an answer",
        "count" [""] "times that it was seen, since it was last said",
    };
    THRUSTER_UNSENT "thruster.unsent" [Warning]
        "Commands were cut off on their way out when the link was lost: their numbers are missing in the log." {
        "sequence" [""] "sequence number of the first",
        "sets" [""] "sets of commands cut off",
    };
    THRUSTER_ERROR_BITS "thruster.error_bits" [Warning]
        "The controller reports errors. At most once a second." {
        "bits" [""] "the controller's error bits",
        "count" [""] "reports, since it was last said",
    };
    THRUSTER_GARBAGE "thruster.garbage" [Warning]
        "Bytes from the controller made no sense and were dropped. At most once a second." {
        "count" [""] "times that it was seen, since it was last said",
    };
    THRUSTER_RESET "thruster.reset" [Error]
        "The controller was reset; a running plan ends in neutral." {};
    THRUSTER_MAESTRO_TIMEOUT "thruster.maestro_timeout" [Warning]
        "A reminder: a Maestro goes to neutral on a dead link only if its own serial timeout is set, which cannot be read back." {};
}
