"""Checks that every recording has to pass, and the daemon's own tools on the host."""
from __future__ import annotations

import json
import statistics
import subprocess
from pathlib import Path

from logfile import Account, Log, nanoseconds
from report import Report

# include/uapi/linux/videodev2.h
FLAG_ERROR = 0x40
FLAG_STAMP_MASK, FLAG_STAMP_MONOTONIC = 0xE000, 0x2000
FLAG_SOURCE_MASK, FLAG_SOURCE_SOE = 0x70000, 0x10000


def tool(binary: Path, *words: str | Path, timeout_s: float = 120) -> subprocess.CompletedProcess:
    return subprocess.run([binary, *map(str, words)], capture_output=True, text=True, timeout=timeout_s, stdin=subprocess.DEVNULL)


def exit_code(out: Path, name: str) -> int | str:
    p = out / f"{name}.rc"
    if not p.exists():
        return "none (the recording never started)"
    code = int(p.read_text())
    # No target lies before the guest's cameras. That few of its frames have a pose is said with 3, where nothing was lost.
    if code == 3 and poses_alone_are_missing(out / f"{name}.mcap"):
        return 0
    return code


def poses_alone_are_missing(path: Path) -> bool:
    """Whether a recording lost nothing, and fewer than half of the frames looked at have a pose."""
    summary = Log(path).meta("summary")
    account = Account(summary)
    posed, none = (sum(int(summary.get(f"poses.{k}", 0)) for k in keys) for keys in (("fitted", "opening"), ("doubtful", "none")))
    return account.lost == 0 and account.dropped == 0 and posed < none


def times(out: Path) -> dict[str, list[float]]:
    """times.txt: what was done to the daemon and when, on the guest's CLOCK_MONOTONIC [s]."""
    found: dict[str, list[float]] = {}
    for line in (out / "times.txt").read_text().splitlines():
        t, word = line.split(maxsplit=1)
        found.setdefault(word, []).append(float(t))
    return found


def sound(report: Report, bench, name: str, allowed_codes: tuple[int, ...]) -> Log | None:
    """One unbroken recording: exit code, one file, one session, an exact account, both readers agree."""
    code = exit_code(bench.out, name)
    if code == 3 and code not in allowed_codes:
        # A refused recording is judged no further: what was lost, and where, has to be said here.
        lost = Log(bench.out / f"{name}.mcap")
        gaps = [(f.sequence, f.sequence_gap_before, f.time_gap_before, f.fault) for f in lost.frames if f.sequence_gap_before or f.time_gap_before]
        code = f"3: lost {Account(lost.meta('summary')).lost_by_cause}, gaps (sequence, by sequence, by time, fault) {gaps}"
        return report.check(f"{name}: exit code", code, " or ".join(map(str, allowed_codes)), False) or None
    if not report.check(f"{name}: exit code", code, " or ".join(map(str, allowed_codes)), code in allowed_codes):
        return None
    files = sorted(p.name for p in bench.out.glob(f"{name}*.mcap"))
    report.equal(f"{name}: one file", files, [f"{name}.mcap"])
    log = Log(bench.out / f"{name}.mcap")
    report.equal(f"{name}: sessions in it", [n for n, _ in log.metadata].count("session"), 1)
    report.equal(f"{name}: log_time steps back", log.log_time_steps_back, 0)
    a = Account(log.meta("summary"))
    report.check(f"{name}: received + lost = expected", f"{a.received} + {a.lost} = {a.expected} {a.lost_by_cause}", "exact",
                 a.received > 0 and a.received + a.lost == a.expected)
    held = a.received + a.outside_time - a.dropped
    report.equal(f"{name}: frames and images in the file", (len(log.frames), len(log.images)), (held, held))
    # A frame that comes late is marked with a gap at once; when those behind it show that nothing was lost there, an
    # event names the frame and takes the mark back.
    marked = sum(f.sequence_gap_before + f.time_gap_before for f in log.frames)
    back = round(sum(e.values["frames"] for e in log.events("camera.gap_retracted")))
    report.check(f"{name}: gaps marked on frames - taken back + at the end vs lost", f"{marked} - {back} + {a.lost_at_end} vs {a.lost}", "equal",
                 a.dropped == 0 and marked - back + a.lost_at_end == a.lost)
    info = tool(bench.binary, "info", bench.out / f"{name}.mcap", "--json")
    try:
        agree = info.returncode == 0 and topic_counts(json.loads(info.stdout)) == {t: len(m) for t, m in log.topics.items()}
    except ValueError:
        agree = False
    report.check(f"{name}: `info` counts what Python's mcap counts", f"exit {info.returncode}, {'equal' if agree else info.stdout[:300]}", "equal", agree)
    # The doctor calls a recording that lost something unsound as well, with the same exit code; it must find no damage.
    doctor = tool(bench.binary, "doctor", bench.out / f"{name}.mcap")
    damage = [l.strip() for l in doctor.stdout.splitlines() if l.strip().startswith("ERROR")]
    asked = 3 if a.lost else 0
    report.check(f"{name}: `doctor`", f"exit {doctor.returncode} {doctor.stderr.strip()[:200]}, damage {damage}", f"exit {asked}, no damage",
                 doctor.returncode == asked and not damage)
    return log


def topic_counts(info: dict) -> dict[str, int]:
    topics = info.get("topics", {})
    if isinstance(topics, list):
        return {t.get("topic", t.get("name")): t.get("messages", t.get("count")) for t in topics}
    return {k: v if isinstance(v, int) else v.get("messages", v.get("count")) for k, v in topics.items()}


def rate_fps(log: Log) -> float:
    """Frames per second by the driver's own stamps, per sequence step (so that lost frames do not count as slow)."""
    f = [x for x in log.frames if not x.fault or x.fault == "stale"]
    return (f[-1].sequence - f[0].sequence) / ((f[-1].driver_stamp_ns - f[0].driver_stamp_ns) / 1e9)


def stamps(report: Report, log: Log, name: str, exposure_s: float) -> None:
    """Clock and source flags as the driver set them; mid-exposure = stamp + half the exposure, on UNIX time."""
    wrong = [f.sequence for f in log.frames if f.v4l2_flags & FLAG_STAMP_MASK != FLAG_STAMP_MONOTONIC
             or f.v4l2_flags & FLAG_SOURCE_MASK != FLAG_SOURCE_SOE]
    report.equal(f"{name}: frames whose raw flags are not monotonic + SOE", len(wrong), 0)
    words = sorted({(f.driver_clock, f.stamp_source) for f in log.frames})
    report.equal(f"{name}: stamp's clock and source in words", words, [("monotonic", "start_of_exposure")])
    age_ms = [(f.received_monotonic_ns - f.driver_stamp_ns) / 1e6 for f in log.frames]
    report.check(f"{name}: stamp to daemon", f"{min(age_ms):.1f} / {statistics.median(age_ms):.1f} / {max(age_ms):.1f} ms (min/median/max)",
                 "min >= 0, median <= 40 ms", min(age_ms) >= 0 and statistics.median(age_ms) <= 40)
    off_ms = [abs(nanoseconds(f.timestamp) - f.driver_stamp_ns - log.realtime_minus_monotonic_ns(f.driver_stamp_ns) - exposure_s * 5e8) / 1e6
              for f in log.frames]
    report.check(f"{name}: mid-exposure vs stamp + exposure/2", f"{max(off_ms):.4f} ms at most", "<= 1 ms", max(off_ms) <= 1.0)
    mismatch = sum(1 for p, f in zip(log.publish_ns["/camera/frame"], log.frames) if p != nanoseconds(f.timestamp))
    report.equal(f"{name}: publish_time differs from mid-exposure", mismatch, 0)


# ControllerConfig::bench in src/thruster/controller.rs
CONTROLLER_DRIFT_PPM = 37.0


def controller(report: Report, log: Log, name: str, seconds: float, planned: float) -> None:
    """Commands and echoes one to one; the controller's clock seen and followed."""
    commands, echoes = log.of("/thruster/command"), log.of("/thruster/echo")
    asked = {(c.sequence, c.thruster) for c in commands}
    sequences = {c.sequence for c in commands}
    answered = {e.sequence for e in echoes}
    report.equal(f"{name}: command sets the plan asked for", len({c.sequence for c in commands if c.plan_step}), int(planned))
    report.equal(f"{name}: commands logged twice", len(commands) - len(asked), 0)
    report.check(f"{name}: command sequences without an echo", sorted(sequences - answered)[:10], "none", sequences == answered)
    pulse = {(c.sequence, c.thruster): c.pulse_us for c in commands}
    named = [e for e in echoes if e.thruster]
    worst = max((abs(e.pulse_us - pulse[e.sequence, e.thruster]) for e in named if (e.sequence, e.thruster) in pulse), default=None)
    report.check(f"{name}: echoed pulse vs commanded", f"{worst} us over {len(named)} echoes", "<= 0.5 us",
                 worst is not None and worst <= 0.5)
    moving = len({round(c.pulse_us) for c in commands})
    report.at_least(f"{name}: different pulses commanded", moving, 3)
    clock = [e.controller_time_us for e in sorted(echoes, key=lambda e: e.sequence)]
    report.check(f"{name}: controller's clock runs forward", f"{clock[:1]} to {clock[-1:]} us", "ascending, not 0",
                 bool(clock) and clock[0] > 0 and all(x <= y for x, y in zip(clock, clock[1:])))
    trips = sorted(e.round_trip_s for e in echoes)
    report.check(f"{name}: round trip", f"{trips[0] * 1e3:.2f} / {trips[len(trips) // 2] * 1e3:.2f} / {trips[-1] * 1e3:.2f} ms (min/median/max)",
                 "0 < min, median <= 20 ms", 0 < trips[0] and trips[len(trips) // 2] <= 0.020)
    pairs = log.of("/clock")
    report.at_least(f"{name}: /clock pairs", len(pairs), int(seconds) - 1)
    fits = [p.controller for p in pairs if p.HasField("controller")]
    if not report.check(f"{name}: /clock carries the controller's clock", len(fits), f">= {int(seconds) - 3}", len(fits) >= int(seconds) - 3):
        return
    last = fits[-1]
    report.check(f"{name}: controller offset", f"{last.offset_us:.0f} us, sd {last.offset_sd_us:.1f} us, {last.samples} samples", "sd <= 500 us, >= 10 samples",
                 0 < last.offset_sd_us <= 500 and last.samples >= 10)
    report.check(f"{name}: controller drift", f"{last.drift_ppm:.1f} ppm, sd {last.drift_sd_ppm:.1f}",
                 f"{CONTROLLER_DRIFT_PPM:g} ppm within 4 sd, sd <= 50", 0 < last.drift_sd_ppm <= 50
                 and abs(last.drift_ppm - CONTROLLER_DRIFT_PPM) <= 4 * last.drift_sd_ppm)
    report.check(f"{name}: clock's round trip and spread", f"{last.round_trip_us:.0f} us, {last.round_trip_spread_us:.0f} us", "0 < trip <= 20 ms, spread > 0",
                 0 < last.round_trip_us <= 20000 and last.round_trip_spread_us > 0)
