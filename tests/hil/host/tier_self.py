"""the fault injectors themselves, seen by small readers in the guest; no daemon involved."""
from __future__ import annotations

import re
from pathlib import Path

from common import FLAG_ERROR, times
from report import Report


class Watch:
    """What v4l_watch or serial_watch printed: (time, rest of the line)."""

    def __init__(self, path: Path):
        self.lines = [(float(t), rest) for t, rest in (l.split(" ", 1) for l in path.read_text().splitlines())]
        # frame SEQUENCE FLAGS BYTES AGE [HILnnnnnnnn]
        found = [(t, re.match(r"frame (\d+) (\S+) (\d+) (-?[\d.]+) ?(\S*)", r)) for t, r in self.lines]
        self.frames = [(t, int(m[1]), int(m[2], 16), int(m[3]), float(m[4]), m[5]) for t, m in found if m]

    def first(self, pattern: str, after_s: float = 0.0) -> float | None:
        return next((t for t, r in self.lines if t >= after_s and re.search(pattern, r)), None)


def soon(report: Report, name: str, at_s: float | None, injected_s: float, within_s: float) -> None:
    shown = "never" if at_s is None else f"{at_s - injected_s:.2f} s after"
    report.check(name, shown, f"within {within_s:g} s", at_s is not None and at_s - injected_s <= within_s)


def run(bench, report: Report) -> None:
    guest = bench.guest(timeout_s=120)
    guest.controller_command = None                       # an echo
    report.equal("self: guest script's exit code", guest.run(Path(__file__).parent.parent / "inside/tier-self.sh"), 0)
    done = times(bench.out)

    v = Watch(bench.out / "vivid.txt")
    flagged = [f for f in v.frames if f[2] & FLAG_ERROR]
    report.equal("vivid: frames with the error flag", len(flagged), 1)
    soon(report, "vivid: error frame", flagged[0][0] if flagged else None, done["vivid_error"][0], 0.5)
    soon(report, "vivid: fatal error is EIO", v.first("errno DQBUF Input/output error"), done["vivid_fatal"][0], 0.5)
    soon(report, "vivid: 100 % dropped is silence", v.first("silent", done["vivid_freeze"][0]), done["vivid_freeze"][0], 1.2)
    soon(report, "vivid: unbind is ENODEV", v.first("errno DQBUF No such device"), done["vivid_unbind"][0], 0.5)
    soon(report, "vivid: frames again after bind", v.first("reopened", done["vivid_unbind"][0]), done["vivid_unbind"][0], 2.5)

    truth = [(float(t), w, int(n)) for t, w, n in (l.split() for l in (bench.out / "uvc.txt").read_text().splitlines())]
    w = Watch(bench.out / "watch.txt")
    number_of = {f[5][3:].lstrip("0"): f for f in w.frames}
    of = lambda word: [str(n) for _, x, n in truth if x == word]
    report.equal("uvc: frame with the error bit has the flag", [bool(number_of[n][2] & FLAG_ERROR) for n in of("error_bit") if n in number_of], [True])
    cut = [number_of[n] for n in of("truncated") if n in number_of]
    whole = max(f[3] for f in w.frames)
    report.check("uvc: truncated JPEG", [(f"{f[3]} bytes", hex(f[2])) for f in cut], f"about half of {whole} bytes, no flag",
                 len(cut) == 1 and cut[0][3] < 0.6 * whole and not cut[0][2] & FLAG_ERROR)
    dropped = of("dropped")
    report.equal("uvc: dropped frames that arrived", [n for n in dropped if n in number_of], [])
    before, after = number_of.get(str(int(dropped[0]) - 1)), number_of.get(str(int(dropped[-1]) + 1))
    report.check("uvc: 5 frames dropped in the device: sequence step", after[1] - before[1] if before and after else None, "= 1: the driver cannot know",
                 bool(before and after) and after[1] - before[1] == 1)
    halt = next(t for t, x, _ in truth if x == "halt")
    empty = [f for f in w.frames if halt <= f[0] <= halt + 0.5 and f[3] == 0]
    print(f"      uvc: halt gave {len(empty)} empty buffers, then silence")
    soon(report, "uvc: halt ends in silence", w.first("silent", halt), halt, 1.5)
    soon(report, "uvc: unplug is ENODEV", w.first("errno DQBUF No such device"), done["uvc_unplug"][0], 0.5)
    soon(report, "uvc: frames again after the replug", w.first("reopened", done["uvc_unplug"][0]), done["uvc_node"][0], 2.0)

    s = Watch(bench.out / "serial.txt")
    for what, word in (("adapter unplugged", "serial_unplug"), ("far end closed", "controller_kill")):
        soon(report, f"serial: {what}: lost", s.first("lost", done[word][0]), done[word][0], 1.0)
        soon(report, f"serial: {what}: open again", s.first("open", done[word][0] + 0.3), done[word][0], 3.0)
    total = re.search(r"total sent (\d+) back (\d+)", s.lines[-1][1])
    report.check("serial: lines echoed", f"{total[2]} of {total[1]}" if total else "none", "all but at most 4",
                 bool(total) and int(total[1]) > 40 and int(total[1]) - int(total[2]) <= 4)

    b = Watch(bench.out / "loopback.txt")
    fed = (bench.out / "feed.txt").read_text()
    report.check("loopback: 50 frames fed", "fed 50" in fed, "yes", "fed 50" in fed)
    span = b.frames[-1][0] - b.frames[1][0]
    report.within("loopback: rate", (len(b.frames) - 2) / span, 24.0, 26.0, "fps")
