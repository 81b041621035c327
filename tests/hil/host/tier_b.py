"""frames rendered by `simulate`, through v4l2loopback at 25 fps: the same stripes from the guest's log as from the frames."""
from __future__ import annotations

import csv
import hashlib
import io
import shutil
import struct
import zlib
from array import array
from pathlib import Path

import rigs
from common import sound, tool
from logfile import Account, Log
from report import Report

WIDTH, HEIGHT = 720, 576
SECONDS = 6.0


def png(grey: bytes) -> bytes:
    """An 8-bit grey PNG: `extract` reads images, and a PNG keeps every pixel."""
    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    rows = b"".join(b"\0" + grey[v * WIDTH:(v + 1) * WIDTH] for v in range(HEIGHT))
    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", WIDTH, HEIGHT, 8, 0, 0, 0, 0))
            + chunk(b"IDAT", zlib.compress(rows, 1)) + chunk(b"IEND", b""))


Points = tuple[bytes, bytes]
"""Columns and rows of one frame's stripe points, as the float32 a log holds."""


def single(values) -> bytes:
    return array("f", map(float, values)).tobytes()


def extract(bench, folder: Path, frames: dict[str, bytes]) -> dict[str, Points]:
    """Column and row of every stripe point of every frame, by `hydroline extract` on PNGs of the rendered frames."""
    folder.mkdir()
    for key, data in frames.items():
        (folder / f"{key}.png").write_bytes(png(data))
    r = tool(bench.binary, "extract", *(folder / f"{key}.png" for key in frames), "--csv")
    shutil.rmtree(folder)
    if r.returncode != 0:
        raise RuntimeError(f"extract: exit {r.returncode}: {r.stderr.strip()[:300]}")
    found = {}
    for block in r.stdout.split("# ")[1:]:
        path, table = block.split("\n", 1)
        rows = list(csv.DictReader(io.StringIO(table)))
        found[Path(path.strip()).stem] = (single(x["column_px"] for x in rows), single(x["row_px"] for x in rows))
    return found


def profiles(log: Log, key_of_stamp: dict[int, str]) -> dict[str, Points]:
    out = {}
    for p, stamp in zip(log.of("/laser/profile"), log.publish_ns.get("/laser/profile", [])):
        if key := key_of_stamp.get(stamp):
            out[key] = (single(p.column_px), single(p.row_px))
    return out


def run(bench, report: Report) -> None:
    guest = bench.guest(timeout_s=120)
    folder = guest.overlay / "work/rigs"
    rigs.write(bench.repository, folder, {"b-loopback": rigs.LOOPBACK}, with_target=True)
    plan = bench.out / "plan.toml"
    rigs.write_plan(plan, seconds=SECONDS)
    simulated = bench.out / "simulated.mcap"
    r = tool(bench.binary, "simulate", "--rig", "lshpi", "--plan", plan, "--out", simulated)
    if not report.check("b: `simulate` renders the frames", f"exit {r.returncode} {r.stderr.strip()[:300]}", "exit 0", r.returncode == 0):
        return
    rendered = Log(simulated)
    source = [bytes(i.data) for i in rendered.images]
    report.at_least("b: frames rendered", len(source), SECONDS * 25 - 2)
    report.equal("b: bytes per frame", sorted({len(d) for d in source}), [WIDTH * HEIGHT])
    by_hash = {hashlib.sha256(d).hexdigest()[:16]: d for d in source}
    report.equal("b: frames that look like another one", len(source) - len(by_hash), 0)
    (guest.overlay / "work/frames.raw").write_bytes(b"".join(source))
    (guest.overlay / "work/seconds").write_text(f"{SECONDS + 4:.0f}\n")

    report.equal("b: guest script's exit code", guest.run(Path(__file__).parent.parent / "inside/tier-b.sh"), 0)
    # v4l2loopback hands a first buffer that may be stale, and the sequence jumps after it: the daemon may call that a loss.
    log = sound(report, bench, "b", (0, 3))
    if log is None:
        return
    keys = [hashlib.sha256(i.data).hexdigest()[:16] for i in log.images]
    there = [k for k in keys if k in by_hash]
    order = [k for k in by_hash if k in set(there)]
    report.equal("b: rendered frames found in the guest's log, byte for byte", len(set(there)), len(by_hash))
    report.check("b: each once and in order", f"{len(there)} of {len(order)}", "each once, in order", there == order)
    fed = [(f, i) for f, i, k in zip(log.frames, log.images, keys) if k in by_hash]
    if not fed:
        return
    # Else the feeder began before the recording, and what is missing below is no loss of the daemon's.
    report.at_least("b: idle frames recorded before the first fed one", next(n for n, k in enumerate(keys) if k in by_hash), 5)
    span_s = (fed[-1][0].driver_stamp_ns - fed[0][0].driver_stamp_ns) / 1e9
    report.within("b: rate of the fed frames by the stamps", (len(fed) - 1) / span_s, 24.5, 25.5, "fps")
    report.equal("b: fed frames marked faulty", sum(1 for f, _ in fed if f.fault), 0)
    report.equal("b: losses marked within the fed frames", sum(f.sequence_gap_before + f.time_gap_before for f, _ in fed[1:]), 0)
    report.equal("b: stamp's clock in words", sorted({f.driver_clock for f, _ in fed}), ["unknown"])

    # The frames themselves, twice: as images (rows in the CSV are rounded to 1e-4 px), and to the last bit from the log
    # that `simulate` wrote.
    first = bench.out / "simulated-replayed.mcap"
    r = tool(bench.binary, "replay", simulated, "--out", first)
    if not report.check("b: `replay` of the simulated log", f"exit {r.returncode} {r.stderr.strip()[:300]}", "exit 0", r.returncode == 0):
        return
    truth = profiles(Log(first), {t: hashlib.sha256(i.data).hexdigest()[:16] for t, i in zip(rendered.publish_ns["/camera/image"], rendered.images)})
    report.equal("b: frames with a profile of their own", len(truth), len(by_hash))
    report.at_least("b: stripe points in the frames themselves", sum(len(c) // 4 for c, _ in truth.values()) / max(1, len(truth)), 300, "per frame")
    compare(report, "b: `extract` on images of the frames vs their profiles", extract(bench, bench.out / "png", by_hash), truth, within_px=1e-4)
    stamp_key = {s: k for s, k in zip(log.publish_ns["/camera/image"], keys) if k in by_hash}
    live = profiles(log, stamp_key)
    report.at_least("b: frames extracted live in the guest", len(live), 0.5 * len(by_hash))
    compare(report, "b: live stripes in the guest vs from the frames", live, truth)
    replayed = bench.out / "replayed.mcap"
    r = tool(bench.binary, "replay", bench.out / "b.mcap", "--out", replayed)
    # The frames come round and round: a vehicle that jumps has no pose where nobody knows which hexagon it is over, which is 3.
    done = r.returncode == 0 or (r.returncode == 3 and "frames have a pose" in r.stderr)
    if not report.check("b: `replay` of the guest's log", f"exit {r.returncode} {r.stderr.strip()[:300]}", "exit 0, or 3 for want of poses", done):
        return
    again = profiles(Log(replayed), stamp_key)
    report.equal("b: frames replay extracted", len(again), len(by_hash))
    compare(report, "b: replayed stripes vs from the frames", again, truth)


def compare(report: Report, name: str, got: dict[str, Points], truth: dict[str, Points], within_px: float = 0.0) -> None:
    worst, differing = 0.0, 0
    for k in got:
        (columns, rows), (true_columns, true_rows) = got[k], truth.get(k, (b"", b""))
        if columns != true_columns:
            differing += 1
            worst = float("inf")
        elif rows != true_rows:
            off = max(abs(x - y) for x, y in zip(array("f", rows), array("f", true_rows)))
            worst = max(worst, off)
            differing += off > within_px
    asked = "all bit-equal" if within_px == 0 else f"same columns, rows within {within_px:g} px"
    report.check(name, f"{len(got) - differing} of {len(got)} frames, worst row difference {worst:.3g} px", asked, bool(got) and differing == 0)
