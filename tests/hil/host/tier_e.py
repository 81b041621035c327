"""vivid's webcam in every pixel format, single- and multi-planar: bytes, exact account, and the test pattern's colours."""
from __future__ import annotations

import json
import struct
import tempfile
import zlib
from pathlib import Path

import rigs
from common import sound, tool
from report import Report

W, H, RATE, SECONDS = 320, 180, 25.0, 2.0
WEBCAM = {**rigs.VIVID_TV, "width_px": W, "height_px": H, "rate_fps": RATE}
# Format: encoding in the log, bytes of a row and of an image.
MONO = {"GREY": ("mono8", W, W * H), "Y10": ("mono10", 2 * W, 2 * W * H), "Y12": ("mono12", 2 * W, 2 * W * H),
        "Y16": ("mono16", 2 * W, 2 * W * H)}
COLOUR = {"YUYV": ("yuyv", 2 * W, 2 * W * H), "UYVY": ("uyvy", 2 * W, 2 * W * H), "NV12": ("nv12", W, W * H * 3 // 2),
          "RGB24": ("rgb8", 3 * W, 3 * W * H), "BGR24": ("bgr8", 3 * W, 3 * W * H),
          "RGBA32": ("rgba8", 4 * W, 4 * W * H), "BGRA32": ("bgra8", 4 * W, 4 * W * H),
          "RGGB8": ("bayer_rggb8", W, W * H), "GRBG10": ("bayer_grbg10", 2 * W, 2 * W * H),
          "GBRG12": ("bayer_gbrg12", 2 * W, 2 * W * H), "BGGR16": ("bayer_bggr16", 2 * W, 2 * W * H)}
FORMATS = {**MONO, **COLOUR}
MULTIPLANAR = ["GREY", "UYVY", "NV12", "RGGB8"]
# The bars of vivid's pattern, from the left: white, yellow, cyan, green, magenta, red, blue, black.
BARS = {"red": [255, 255, 0, 0, 255, 255, 0, 0], "green": [255, 255, 255, 255, 0, 0, 0, 0], "blue": [255, 0, 255, 0, 255, 0, 255, 0]}
CHANNELS = list(BARS)
# 8-bit luma and chroma are rounded, and tell a colour to 3 levels.
WITHIN = 4


def run(bench, report: Report) -> None:
    guest = bench.guest(timeout_s=240)
    folder = guest.overlay / "work/rigs"
    names: dict[str, tuple[str, str | None]] = {}
    for planes, formats in ((1, list(FORMATS)), (2, MULTIPLANAR)):
        for k, fmt in enumerate(formats):
            # Each colour format shows another channel.
            names[f"e{planes}-{fmt.lower()}"] = (fmt, CHANNELS[k % 3] if fmt in COLOUR else None)
        listed = [n for n in names if n.startswith(f"e{planes}-")]
        (guest.overlay / f"work/formats-{planes}").write_text("\n".join(listed) + "\n")
    rigs.write(bench.repository, folder, {n: {**WEBCAM, "pixel_format": fmt} for n, (fmt, _) in names.items()},
               lasers={n: {"channel": c} for n, (_, c) in names.items() if c})
    report.equal("e: guest script's exit code", guest.run(Path(__file__).parent.parent / "inside/tier-e.sh"), 0)
    devices(report, bench)
    for name, (fmt, channel) in names.items():
        # What is judged is the account, not the guest's speed: a frame that vivid itself loses has to be counted (3).
        log = sound(report, bench, name, (0, 3))
        if log is None:
            continue
        shapes = sorted({(i.encoding, i.width, i.height, i.step, len(i.data)) for i in log.images})
        encoding, step, size = FORMATS[fmt]
        report.equal(f"{name}: image encoding, size, step, bytes", shapes, [(encoding, W, H, step, size)])
        bars(report, bench, name, channel)


def bars(report: Report, bench, name: str, channel: str | None) -> None:
    """Mean grey levels of the last frame's bars, as the daemon reads them."""
    with tempfile.TemporaryDirectory(dir=bench.out) as folder:
        made = Path(folder) / "frames"
        done = tool(bench.binary, "export", bench.out / f"{name}.mcap", "--frames-only", "--out", made)
        frames = sorted(made.glob("*.png"))
        if not report.check(f"{name}: frames exported", len(frames), "some, exit code 0", done.returncode == 0 and bool(frames)):
            return
        rows = png_rows(frames[-1].read_bytes())[H // 2: H - 10]
    bar = W // 8
    means = [round(sum(sum(r[k * bar + 8:(k + 1) * bar - 8]) for r in rows) / (len(rows) * (bar - 16))) for k in range(8)]
    if channel is None:
        report.check(f"{name}: luma of the eight bars", means, "falling", all(a > b for a, b in zip(means, means[1:])))
    else:
        worst = max(abs(a - b) for a, b in zip(means, BARS[channel]))
        report.check(f"{name}: {channel} of the eight bars", means, f"{BARS[channel]} within {WITHIN}", worst <= WITHIN)


def devices(report: Report, bench) -> None:
    for planes in (1, 2):
        try:
            cameras = json.loads((bench.out / f"devices-e{planes}.json").read_text())["cameras"]
        except (ValueError, OSError, KeyError) as e:
            cameras = [{"no_camera": repr(e)}]
        usable = [c for c in cameras if not c["no_camera"] and not c["problem"]]
        report.equal(f"e: cameras that `devices` can use, multiplanar={planes}", len(usable), 1)


def png_rows(data: bytes) -> list[bytes]:
    """Rows of an 8-bit grey PNG (the venv has no imaging package)."""
    at, packed, width = 8, b"", 0
    while at < len(data):
        length, kind = struct.unpack(">I4s", data[at:at + 8])
        body = data[at + 8:at + 8 + length]
        if kind == b"IHDR":
            width, _, depth, colour = struct.unpack(">IIBB", body[:10])
            assert (depth, colour) == (8, 0), "not 8-bit grey"
        if kind == b"IDAT":
            packed += body
        at += 12 + length
    raw = zlib.decompress(packed)
    rows, above = [], bytes(width)
    for start in range(0, len(raw), width + 1):
        method, row = raw[start], bytearray(raw[start + 1:start + 1 + width])
        for i in range(width):
            a, b, c = (row[i - 1] if i else 0), above[i], (above[i - 1] if i else 0)
            p = a + b - c
            nearest = min((abs(p - a), 0, a), (abs(p - b), 1, b), (abs(p - c), 2, c))[2]
            row[i] = (row[i] + (0, a, b, (a + b) // 2, nearest)[method]) & 255
        rows.append(bytes(row))
        above = rows[-1]
    return rows
