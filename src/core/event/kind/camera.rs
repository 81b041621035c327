//! Events of the camera and its frames.

use super::{EventKind, EventValue, Severity, kinds};

kinds! {
    CAMERA_GAP "camera.gap" [Error]
        "Frames were lost before this one: by the driver's sequence numbers, or by the time between the stamps." {
        "sequence" [""] "the driver's sequence number of the first frame after the gap",
        "lost" ["frames"] "frames lost, by both counts together",
        "sequence_gap" ["frames"] "frames missing in the driver's sequence",
        "time_gap" ["frames"] "frames that the device dropped without a sequence number, by the stamps",
        "gap_s" ["s"] "time between the frame before the gap and the one after it, by the nominal period",
    };
    CAMERA_GAP_RETRACTED "camera.gap_retracted" [Info]
        "Frames of an earlier camera.gap were not lost there: one was late, or the rate had changed. The account is corrected." {
        "sequence" [""] "the driver's sequence number of the frame before which they had been counted lost",
        "frames" ["frames"] "frames that are no longer counted as lost",
    };
    CAMERA_FROZEN "camera.frozen" [Error]
        "No frame came for `camera.frozen_after_s`; the stream is restarted." {
        "silence_s" ["s"] "time since the last frame",
        "attempt" [""] "number of this restart, from 1",
    };
    CAMERA_STREAM_ERROR "camera.stream_error" [Error]
        "A call of the driver failed while streaming; the stream is restarted after a pause." {
        "errno" [""] "error number of the call",
        "attempt" [""] "number of this restart, from 1",
        "back_off_s" ["s"] "pause before the restart",
    };
    CAMERA_VOID_BUFFERS "camera.void_buffers" [Error]
        "The driver gave buffers back without a frame in them and has given up on the stream, which is restarted." {};
    CAMERA_DRIVER_NONSENSE "camera.driver_nonsense" [Error]
        "The driver handed out a buffer that it did not have; the stream is restarted." {};
    CAMERA_BUFFER_REFUSED "camera.buffer_refused" [Warning]
        "The driver refused a buffer that was given back to it; it is tried again." {
        "errno" [""] "error number of VIDIOC_QBUF",
    };
    CAMERA_UNPLUGGED "camera.unplugged" [Error]
        "The camera's device is gone. It is looked for every 200 ms, and the recording goes on." {
        "errno" [""] "error number by which it was noticed",
    };
    CAMERA_REPLUGGED "camera.replugged" [Warning]
        "The camera is back, with the rig's format and controls." {
        "gap_s" ["s"] "time for which it was gone",
    };
    CAMERA_REOPEN_FAILED "camera.reopen_failed" [Error]
        "The camera is back, but cannot be used yet." {};
    CAMERA_RESUMED "camera.resumed" [Info]
        "Frames come again, after the camera stood still, was restarted or was unplugged." {
        "gap_s" ["s"] "time without a frame",
        "lost" ["frames"] "frame periods lost meanwhile",
    };
    CAMERA_FAILED "camera.failed" [Error]
        "The camera cannot be read any more; the recording ends." {};
    CAMERA_ERROR_FRAME "camera.error_frame" [Warning]
        "A frame is damaged: flagged by the driver, cut short, no whole JPEG, not to be read, or stale. It is kept and left out of the analysis." {
        "sequence" [""] "the driver's sequence number",
        "bytes_used" ["bytes"] "bytes that the driver filled",
    };
    CAMERA_PICTURE_BLOCKS "camera.picture_blocks" [Warning]
        "Blocks of the frames' JPEGs look like damage at the same places of frame after frame. They are taken for the picture (text over it), and the frames are used. Said once." {
        "blocks" [""] "number of these blocks so far",
    };
    CAMERA_REPEATED "camera.repeated" [Warning]
        "A sequence number came twice in one period. The second frame is kept, marked stale, and not counted." {
        "sequence" [""] "the driver's sequence number",
    };
    CAMERA_LEFTOVER "camera.leftover" [Info]
        "The first frame was left over from before the start. It is kept, but counted neither as received nor as lost." {};
    CAMERA_RENUMBERED "camera.renumbered" [Warning]
        "The driver's sequence jumped in a way that the time does not explain; losses here are counted by time." {
        "from" [""] "sequence number before the jump",
        "to" [""] "sequence number after it",
    };
    CAMERA_RATE_CHANGED "camera.rate_changed" [Warning]
        "The frame rate changed, as automatic exposure does it." {
        "from_fps" ["1/s"] "frame rate before",
        "to_fps" ["1/s"] "frame rate after",
    };
    CAMERA_COUNTS "camera.counts" [Info]
        "The account of a second: frames received and lost are those that the time expects." {
        "from_s" ["s"] "begin of the span, since the first frame",
        "span_s" ["s"] "its length",
        "received" ["frames"] "frames received in the span",
        "lost" ["frames"] "frames lost in the span",
        "expected" ["frames"] "frames expected from the stamps alone",
    };
    CAMERA_COUNT_DISAGREES "camera.count_disagrees" [Error]
        "The account of a second does not close: received + lost is not what the stamps expect." {
        "from_s" ["s"] "begin of the span, since the first frame",
        "span_s" ["s"] "its length",
        "received" ["frames"] "frames received in the span",
        "lost" ["frames"] "frames lost in the span",
        "expected" ["frames"] "frames expected from the stamps alone",
    };
    CAMERA_STAMP_CLOCK_UNKNOWN "camera.stamp_clock_unknown" [Info]
        "The driver does not say with which clock it stamps. Its stamps are near CLOCK_MONOTONIC and are taken for it. Said once." {
        "age_s" ["s"] "arrival minus stamp of the frame",
    };
    CAMERA_STAMP_IN_FUTURE "camera.stamp_in_future" [Warning]
        "The driver stamps frames later than they arrive: times of this camera are off by at least that. Said once." {
        "age_s" ["s"] "arrival minus stamp of the frame, negative",
    };
    CAMERA_STAMP_IMPLAUSIBLE "camera.stamp_implausible" [Warning]
        "The driver's stamp is not near CLOCK_MONOTONIC; the time of arrival is used instead. Said once." {
        "age_s" ["s"] "arrival minus stamp of the frame",
    };
    CAMERA_INTERLACED "camera.interlaced" [Warning]
        "The camera delivers interlaced frames: odd and even rows are half a period apart." {};
    CAMERA_CONTROL_CHANGED "camera.control_changed" [Warning]
        "A control of the camera has another value than was set." {
        "from" ["the control's"] "value before",
        "to" ["the control's"] "value now",
        "asked" ["the control's"] "value that the rig asks for",
    };
    CAMERA_SOURCE "camera.source" [Info]
        "The message describes, as JSON, the camera that came back (camera.replugged): it may have been set up otherwise." {};
    CAMERA_RESPONSE "camera.response" [Info, Warning]
        "The camera's response and the line's cross-section, as the first frames over the target show them; every pose is fitted under it. A warning where they do not show it, or contradict the rig." {
        "ln_gamma" [""] "ln γ of g = b + 255 (L/255)^γ",
        "black_levels" ["grey levels"] "b",
        "line_he3" [""] "cross-section of the line beyond a Gaussian: Hermite coefficient of order 3",
        "line_he4" [""] "the same, order 4",
        "line_he5" [""] "the same, order 5",
        "line_he6" [""] "the same, order 6",
        "line_he7" [""] "the same, order 7",
        "line_he8" [""] "the same, order 8",
        "line_he9" [""] "the same, order 9",
        "line_he10" [""] "the same, order 10",
        "*_variance" ["the quantity's, squared"] "variance of the quantity before the ending",
        "*_covariance" ["product of the two units"] "covariance of the two quantities before the ending",
        "frames" ["frames"] "frames that it was found in",
        "rig_states" [""] "1 where the rig states the camera's curve; else absent",
        "frames_ln_gamma" [""] "where the rig states the curve: ln γ as the frames alone say it",
        "frames_ln_gamma_sd" [""] "its standard deviation",
    };
    POSE_WAITING "pose.waiting" [Warning]
        "No pose for a second after there were some, and what is waited for; once until the pose is back." {
        "since_s" ["s"] "time since the last pose",
        "x_m" ["m"] "where x is carried to by vehicle and commands",
        "x_sd_m" ["m"] "standard deviation of that",
    };
}
