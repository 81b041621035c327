"""every fault of camera and serial line: its event, an exact account, one unbroken recording."""
from __future__ import annotations

from pathlib import Path

import rigs
from common import FLAG_ERROR, sound, times
from logfile import Account, Log
from report import Report
from tier_a import unwrap_jpeg

VIVID_S, UVC_S = 24.0, 22.0
# What the project promises (capture-and-log): unplug noticed within 0.5 s, camera back within 2 s of its node,
# a lost serial line within 1 s.
NOTICED_S, RESUMED_S, SERIAL_NOTICED_S = 0.5, 2.0, 1.0
# Silence is no unplug: up to half a second until an idle link sends again (it asks for the clock at 2 Hz), the rig's timeout_s of 0.5 s from there, and
# a quarter of a second of grace.
SILENT_S = 1.25
NEUTRAL_US = 1500.0
CAMERAS = {
    "c-vivid": {**rigs.VIVID_TV, "pixel_format": "GREY", "frozen_after_s": 0.5},
    "c-uvc": {**rigs.UVC, "frozen_after_s": 0.5},
}


def run(bench, report: Report) -> None:
    guest = bench.guest(timeout_s=170)
    folder = guest.overlay / "work/rigs"
    rigs.write(bench.repository, folder, CAMERAS)
    rigs.write_plan(folder / "hil-plan-long.toml", seconds=20.0)
    report.equal("c: guest script's exit code", guest.run(Path(__file__).parent.parent / "inside/tier-c.sh"), 0)
    done = times(bench.out)
    # 1: the pulled adapter aborts the plan to neutral, and a run whose plan did not come to its end has failed;
    # the recording itself goes on to its planned length all the same.
    if log := sound(report, bench, "c-vivid", (1,)):
        vivid(report, log, done)
        serial(report, log, done, bench.out / "controller.log")
    if log := sound(report, bench, "c-uvc", (3,)):
        uvc(report, log, done, truth_of(bench.out / "uvc.txt"))


def happened(report: Report, log: Log, kind: str, injected_s: float, within_s: float, count: int | None = None) -> float | None:
    """An event of that kind soon after the injection; its time on the guest's clock."""
    at = sorted(log.event_monotonic_s(e) for e in log.events(kind))
    # times.txt has a resolution of 10 ms.
    after = [t for t in at if t >= injected_s - 0.02]
    shown = f"{after[0] - injected_s:.2f} s after" if after else f"none ({log.kinds()})"
    ok = bool(after) and after[0] - injected_s <= within_s and (count is None or len(at) == count)
    report.check(f"{log.path.stem}: {kind}", f"{shown}, {len(at)} in all", f"within {within_s:g} s" + (f", {count} in all" if count else ""), ok)
    return after[0] if after else None


def stamp_s(frame) -> float:
    return frame.driver_stamp_ns / 1e9


def resumed(report: Report, log: Log, what: str, node_s: float, within_s: float) -> None:
    """The first sound frame taken after the device was usable again."""
    after = [f.received_monotonic_ns / 1e9 for f in log.frames if f.received_monotonic_ns / 1e9 > node_s and f.fault in ("", "stale")]
    delay = after[0] - node_s if after else float("inf")
    report.check(f"{log.path.stem}: frames again after {what}", f"{delay:.2f} s", f"<= {within_s:g} s", delay <= within_s)


def flowing(report: Report, log: Log, end_s: float) -> None:
    """Recording went on to its planned end."""
    last = log.frames[-1].received_monotonic_ns / 1e9
    report.check(f"{log.path.stem}: last frame vs planned end", f"{last - end_s:+.2f} s", "within 0.5 s", abs(end_s - last) <= 0.5)


def expected_by_clock(report: Report, log: Log, rate_fps: float) -> None:
    """The account's `expected` against plain arithmetic: recording time x nominal rate."""
    a = Account(log.meta("summary"))
    first, last = log.frames[0].received_monotonic_ns, log.frames[-1].received_monotonic_ns
    nominal = (last - first) / 1e9 * rate_fps + 1
    report.check(f"{log.path.stem}: expected vs time x rate", f"{a.expected} vs {nominal:.1f}", "within 2 % or 5 frames",
                 abs(a.expected - nominal) <= max(5.0, 0.02 * nominal))


def vivid(report: Report, log: Log, done: dict[str, list[float]]) -> None:
    injected = len(done["vivid_error"])
    flagged = [f for f in log.frames if f.v4l2_flags & FLAG_ERROR]
    report.check("c-vivid: ERROR frames kept, marked", f"{[f.fault for f in flagged]}", f"{injected} x driver_error",
                 [f.fault for f in flagged] == ["driver_error"] * injected)
    at_flagged = {f.driver_stamp_ns for f in flagged}
    extracted = [p for p in log.of("/laser/profile") if p.sequence in {f.sequence for f in flagged}
                 and any(f.timestamp == p.timestamp for f in flagged)]
    report.equal("c-vivid: ERROR frames extracted", len(extracted), 0 if at_flagged else -1)
    happened(report, log, "camera.error_frame", done["vivid_error"][0], NOTICED_S)
    happened(report, log, "camera.frozen", done["vivid_freeze"][0], 1.0)
    frozen_s = done["vivid_thaw"][0] - done["vivid_freeze"][0]
    frozen = Account(log.meta("summary")).lost_by_cause.get("frozen", 0)
    report.within("c-vivid: frames lost by standing still", frozen, 25 * frozen_s - 5, 25 * (frozen_s + NOTICED_S) + 5)
    happened(report, log, "camera.resumed", done["vivid_thaw"][0] - 0.1, RESUMED_S)
    failed = happened(report, log, "camera.stream_error", done["vivid_fatal"][0], NOTICED_S)
    happened(report, log, "camera.resumed", done["vivid_fatal"][0], NOTICED_S + RESUMED_S)
    resumed(report, log, "a fatal streaming error", failed or float("inf"), RESUMED_S)
    happened(report, log, "camera.unplugged", done["vivid_unbind"][0], NOTICED_S, 1)
    happened(report, log, "camera.replugged", done["vivid_node"][0] - 0.2, RESUMED_S, 1)
    resumed(report, log, "unbind and bind", done["vivid_node"][0], RESUMED_S)
    # bind puts vivid's controls back to their defaults; only a daemon that applies them again gets SOE stamps.
    sources = sorted({f.stamp_source for f in log.frames if stamp_s(f) > done["vivid_node"][0]})
    report.equal("c-vivid: controls applied again after the replug", sources, ["start_of_exposure"])
    expected_by_clock(report, log, 25.0)
    flowing(report, log, log.frames[0].received_monotonic_ns / 1e9 + VIVID_S)


def neutral(report: Report, log: Log, controller_log: Path, done: dict[str, list[float]]) -> None:
    """A lost line means neutral: by the controller's watchdog at once, by the daemon as soon as it can speak again."""
    put_out = [(int(t), float(pulse), cause) for t, _, pulse, cause in (l.split() for l in controller_log.read_text().splitlines())]
    moving = [i for i, (_, pulse, _) in enumerate(put_out) if pulse != NEUTRAL_US]
    after = put_out[moving[-1] + 1:] if moving else []
    delay_s = next(((t - put_out[moving[-1]][0]) / 1e9 for t, _, cause in after if cause == "Watchdog"), float("inf")) if moving else float("inf")
    # The bench rig's timeout_s is the controller's watchdog.
    report.check("c-vivid: controller's outputs after the last command", f"neutral {delay_s:.3f} s later, by its watchdog", "<= 0.55 s, all outputs",
                 delay_s <= 0.55 and all(pulse == NEUTRAL_US for _, pulse, _ in after))
    lost = log.event_monotonic_s(log.events("serial.lost")[0]) if log.events("serial.lost") else float("inf")
    later = [c for c in log.of("/thruster/command") if c.timestamp.seconds + c.timestamp.nanos / 1e9 - log.realtime_minus_monotonic_ns(int(lost * 1e9) if lost < 1e9 else 0) / 1e9 > lost]
    report.check("c-vivid: commands after the loss", sorted({(c.cause, c.pulse_us) for c in later}), f"some, the first for cause 'lost', all {NEUTRAL_US:g} us",
                 bool(later) and later[0].cause == "lost" and all(c.pulse_us == NEUTRAL_US for c in later))


def serial(report: Report, log: Log, done: dict[str, list[float]], controller_log: Path) -> None:
    # The host needs its time to pull the adapter: noticed is counted from when it was out.
    pulling_s = done["serial_unplugged"][0] - done["serial_unplug"][0]
    happened(report, log, "serial.lost", done["serial_unplug"][0], pulling_s + SERIAL_NOTICED_S)
    neutral(report, log, controller_log, done)
    happened(report, log, "serial.back", done["serial_node"][0] - 0.3, RESUMED_S)
    lost_again = [t for t in map(log.event_monotonic_s, log.events("serial.lost")) if t > done["controller_stop"][0]]
    report.check("c-vivid: a silent controller counts as lost", f"{[round(t - done['controller_stop'][0], 2) for t in lost_again]} s after",
                 f"one within {SILENT_S:g} s of its standing still", bool(lost_again) and lost_again[0] - done["controller_stopped"][0] <= SILENT_S)
    happened(report, log, "serial.back", done["controller_cont"][0], RESUMED_S)
    to_monotonic = lambda m: (m.timestamp.seconds * 10**9 + m.timestamp.nanos - log.realtime_minus_monotonic_ns(log.of("/clock")[-1].monotonic_ns)) / 1e9
    echoes = [to_monotonic(e) for e in log.of("/thruster/echo")]
    # From the plugging in: the guest's shell may see the node later than the daemon.
    for what, word in (("the replug", "serial_plug"), ("the silence", "controller_cont")):
        after = [t for t in echoes if done[word][0] < t < done[word][0] + RESUMED_S + 1]
        report.at_least(f"c-vivid: echoes within 3 s of {what}", len(after), 3)
    # While the adapter was out no command can have been echoed.
    out = [t for t in echoes if done["serial_unplugged"][0] + 0.2 < t < done["serial_plug"][0]]
    report.equal("c-vivid: echoes while the adapter was out", len(out), 0)
    # Every number is a command in the log, or one that an event says was cut off with the line.
    sent = {c.sequence for c in log.of("/thruster/command")}
    cut_off = {round(e.values["sequence"]) + k for e in log.events("thruster.unsent") for k in range(round(e.values["sets"]))}
    numbers = sent | cut_off
    hole = sorted(set(range(min(numbers), max(numbers) + 1)) - numbers) if numbers else None
    report.check("c-vivid: command numbers without a hole", f"{len(sent)} sent, cut off {sorted(cut_off)}, missing {hole}", "none missing, none both",
                 hole == [] and not sent & cut_off)
    report.check("c-vivid: neutral at the loss is said", [e.message[:40] for e in log.events("thruster.neutral")], "at least one for the lost link",
                 any("lost" in e.message for e in log.events("thruster.neutral")))


def truth_of(path: Path) -> list[tuple[float, str, int]]:
    """What the UVC camera did: (time, word, number)."""
    return [(float(t), w, int(n)) for t, w, n in (line.split() for line in path.read_text().splitlines())]


def uvc(report: Report, log: Log, done: dict[str, list[float]], truth: list[tuple[float, str, int]]) -> None:
    number = {w: [n for _, x, n in truth if x == w] for w in ("error_bit", "truncated", "dropped", "late")}
    plugged = [t for t, w, _ in truth if w == "plugged"]
    first_life = [(f, i) for f, i in zip(log.frames, log.images) if stamp_s(f) < plugged[-1]]
    # A JPEG that was cut before its number carries none; its frame is judged by the account, not by number.
    by_number = {n: f for n, f in ((unwrap_jpeg(i)[0], f) for f, i in first_life) if n is not None}
    fault_of = lambda n: by_number[n].fault if n in by_number else "not in the log"
    report.equal("c-uvc: frames with the error bit", [fault_of(n) for n in number["error_bit"]], ["driver_error"])
    # The driver does not flag a JPEG that was cut: only its missing end shows it.
    report.check("c-uvc: truncated JPEG", [fault_of(n) for n in number["truncated"]], "broken_jpeg or truncated",
                 [fault_of(n) for n in number["truncated"]] in (["broken_jpeg"], ["truncated"]))
    report.equal("c-uvc: dropped inside the camera, in the log", [n for n in number["dropped"] if n in by_number], [])
    # Frames that the emulated camera could not send in time (a busy host) are lost inside it as well: whatever is missing
    # between the last frame before the drop and the first one after it has to be marked there, by time alone.
    before, after = max(n for n in by_number if n < min(number["dropped"])), min(n for n in by_number if n > max(number["dropped"]))
    frame = by_number[after]
    taken_back = round(sum(e.values["frames"] for e in log.events("camera.gap_retracted")
                           if e.values["sequence"] == frame.sequence and 0 <= log.event_monotonic_s(e) - stamp_s(frame) < 2))
    report.equal(f"c-uvc: device-side drops ({len(number['late'])} more frames late in the camera): sequence gap, time gap",
                 (frame.sequence_gap_before, frame.time_gap_before - taken_back), (0, after - before - 1))
    happened(report, log, "camera.error_frame", done["uvc_error"][0], NOTICED_S)
    happened(report, log, "camera.gap", done["uvc_dropped"][0], 1.0)
    happened(report, log, "camera.frozen", done["uvc_silent"][0], 1.0)
    resumed(report, log, "2 s of silence", done["uvc_silent"][0] + 2.0, RESUMED_S)
    halted = happened(report, log, "camera.void_buffers", done["uvc_halt"][0], NOTICED_S)
    happened(report, log, "camera.resumed", done["uvc_halt"][0], 1.0 + RESUMED_S)
    resumed(report, log, "EPIPE", halted or float("inf"), RESUMED_S)
    happened(report, log, "camera.unplugged", done["uvc_unplug"][0], NOTICED_S, 1)
    happened(report, log, "camera.replugged", done["uvc_node"][0] - 0.2, RESUMED_S, 1)
    resumed(report, log, "unplug and replug", done["uvc_node"][0], RESUMED_S)
    huge = [f.sequence for f in log.frames if f.sequence_gap_before + f.time_gap_before > 30 * UVC_S]
    report.equal("c-uvc: gaps larger than the recording (underflow)", huge, [])
    expected_by_clock(report, log, 30.0)
    flowing(report, log, log.frames[0].received_monotonic_ns / 1e9 + UVC_S)
