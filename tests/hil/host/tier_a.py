"""vivid (GREY, YUYV) and a UVC camera (MJPG), a controller with its own clock behind ftdi_sio."""
from __future__ import annotations

import json
from pathlib import Path

import rigs
from common import controller, exit_code, rate_fps, sound, stamps
from logfile import Account, Log
from report import Report

SECONDS, PLAN_SECONDS = 7.0, 5.0
CAMERAS = {
    "a-grey": {**rigs.VIVID_TV, "pixel_format": "GREY"},
    "a-yuyv": {**rigs.VIVID_TV, "pixel_format": "YUYV"},
    "a-mjpg": rigs.UVC,
}


def run(bench, report: Report) -> None:
    guest = bench.guest(timeout_s=150)
    folder = guest.overlay / "work/rigs"
    rigs.write(bench.repository, folder, CAMERAS)
    rigs.write_plan(folder / "hil-plan.toml", seconds=PLAN_SECONDS)
    report.equal("a: guest script's exit code", guest.run(Path(__file__).parent.parent / "inside/tier-a.sh"), 0)
    devices(report, bench)
    logs = []
    for name, camera in CAMERAS.items():
        log = sound(report, bench, name, (0,))
        if log is None:
            continue
        logs.append(log)
        rate = camera["rate_fps"]
        a = Account(log.meta("summary"))
        # A period that the emulated USB camera could not send in time was lost before any driver saw it.
        late = sum(" late " in l for l in (bench.out / "uvc.txt").read_text().splitlines()) if name == "a-mjpg" else 0
        report.equal(f"{name}: frames lost (the camera itself: {late})", a.lost, late)
        report.within(f"{name}: frame rate by the driver's stamps", rate_fps(log), rate * 0.98, rate * 1.02, "fps")
        report.at_least(f"{name}: frames received", a.received, (SECONDS - 1) * rate)
        marks = sum(1 for f in log.frames[2:] if f.fault)
        report.equal(f"{name}: faulty frames beyond the first two", marks, 0)
        steps = [y.sequence - x.sequence for x, y in zip(log.frames, log.frames[1:])]
        report.equal(f"{name}: sequence steps", sorted(set(steps)), [1])
        stamps(report, log, name, camera["exposure_s"])
        pixels(report, log, name, camera, bench.cache, late)
        controller(report, log, name, SECONDS, PLAN_SECONDS * rigs.command_rate_hz(bench.repository))
        low_latency(report, log, name)
    controller_saw(report, bench, logs)


def low_latency(report: Report, log: Log, name: str) -> None:
    """ftdi_sio holds bytes back for 16 ms unless told otherwise: told, and read back, at every opening of the port."""
    said = [e.message for e in log.events("serial.low_latency")]
    good = [m for m in said if "low-latency mode set and read back" in m and "latency timer 1 ms" in m]
    report.check(f"{name}: serial low-latency mode", said, "set and read back, latency timer 1 ms, every time",
                 bool(said) and good == said)


def controller_saw(report: Report, bench, logs: list[Log]) -> None:
    """What the controller put out, by its own log, against the commands in the recordings."""
    put_out = [tuple(l.split()[1:3]) for l in (bench.out / "controller.log").read_text().splitlines() if l.endswith(" Command")]
    channel = rigs.channels(bench.repository)
    logged = [(str(channel[c.thruster]), f"{c.pulse_us:.2f}") for log in logs
              for c in sorted(log.of("/thruster/command"), key=lambda c: (c.sequence, channel[c.thruster])) if c.plan_step]
    same = sum(1 for x, y in zip(put_out, logged) if x == y)
    report.check("a: pulses the controller put out vs commands logged", f"{same} of {len(put_out)} equal, {len(logged)} logged", "all equal, in order",
                 bool(logged) and put_out == logged)


def devices(report: Report, bench) -> None:
    for what, words in {"vivid": ["vivid"], "uvc": ["HIL camera", "HIL0001"], "serial": ["ttyUSB0"]}.items():
        text = (bench.out / f"devices-{what}.json").read_text()
        try:
            json.loads(text)
        except ValueError:
            text = ""
        lacking = [w for w in words if w.replace(" ", "_") not in text.replace(" ", "_")]
        report.equal(f"a: `devices --json` lists {what}: words lacking", lacking, [])


def pixels(report: Report, log: Log, name: str, camera: dict, cache: Path, late: int) -> None:
    w, h = camera["width_px"], camera["height_px"]
    if camera["pixel_format"] == "MJPG":
        sources = [p.read_bytes() for p in sorted((cache / "jpeg").glob("*.jpg"))]
        wrong = [n for n, data in map(unwrap_jpeg, log.images) if n is None or data != sources[n % len(sources)]]
        report.equal(f"{name}: JPEGs that differ from those the camera sent", wrong[:5], [])
        numbers = [unwrap_jpeg(i)[0] for i in log.images]
        missing = set(range(numbers[0], numbers[-1] + 1)) - set(numbers)
        report.equal(f"{name}: camera's own numbers: missing, repeated", (len(missing), len(numbers) - len(set(numbers))), (late, 0))
    else:
        encoding, bytes_per_px = ("mono8", 1) if camera["pixel_format"] == "GREY" else ("yuyv", 2)
        shapes = sorted({(i.encoding, i.width, i.height, i.step, len(i.data)) for i in log.images})
        report.equal(f"{name}: image encoding, size, step, bytes", shapes, [(encoding, w, h, w * bytes_per_px, w * h * bytes_per_px)])
        # vivid writes a running counter into every picture.
        repeats = sum(1 for x, y in zip(log.images, log.images[1:]) if x.data == y.data)
        report.equal(f"{name}: pictures equal to the one before", repeats, 0)


def unwrap_jpeg(image) -> tuple[int | None, bytes]:
    """The camera's frame number and the JPEG without the comment that carries it (see inject/uvc_camera.c)."""
    d = image.data
    if d[2:6] != b"\xff\xfe\x00\x0d" or d[6:9] != b"HIL":
        return None, d
    return int(d[9:17]), d[:2] + d[17:]
