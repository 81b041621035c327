"""Damaged JPEGs: an image that is cut, has a hole, zeros or flipped bits gives no stripe points without it being said.

Originals of every kind that cameras and phones write, and those of the reader's own tests. A damaged image is refused as
damaged, or gives the points of the sound one; a sound one that is called damaged is a false alarm.
"""
from __future__ import annotations

import collections
import csv
import io
import json
import random
import struct
from dataclasses import dataclass
from pathlib import Path

from . import jpeg
from .common import Bench, Ran

try:
    import cv2
    import numpy as np
except ModuleNotFoundError as missing:
    raise SystemExit(f"{missing.name} is missing: run `tests/setup --tests`, then this with HYDROLINE_PYTHON=target/python/bin/python") from None

# With and without whole blocks and groups of blocks at the border.
SIZES = [(320, 160), (640, 360), (333, 201)]
# Smaller: it is encoded in Python.
OWN_SIZE = (176, 120)
FIXTURES = Path(__file__).resolve().parents[3] / "src/core/frame/jpeg/tests"
# Standard deviations, the smaller of the two that are stated, by which a point may differ from the sound image's.
DIFFERS_SDS = 2.3
# Points that only one of the two has.
DIFFERS_POINTS = 3
# Of a sound image: median distance of its points from what was drawn [px], and share of the columns that have one.
DRAWN_PX, DRAWN_SHARE = 0.25, 0.9
DAMAGE = ["cut", "cut, end marker kept", "hole", "zeroed", "one bit", "some bits", "a byte"]
# Frames that `replay` names.
NAMED = 20
SEGMENTS = {0xC0: "SOF", 0xC2: "SOF", 0xC4: "DHT", 0xDA: "SOS", 0xDB: "DQT", 0xDD: "DRI", 0xE1: "EXIF"}

Points = dict[str, tuple[float, float]]


@dataclass
class Original:
    kind: str
    data: bytes
    # As it is shown, width and height [px].
    size: tuple[int, int]
    # Row at column 0 and slope of the stripe that was drawn; of a fixture nobody says.
    drawn: tuple[float, float] | None = None


def stripe(rng: random.Random, size: tuple[int, int]) -> tuple[np.ndarray, tuple[float, float]]:
    """Grey levels of a tilted stripe as a camera sees it, and its row at column 0 and slope."""
    width, height = size
    slope = rng.uniform(-0.05, 0.05)
    row = rng.uniform(0.35, 0.65) * height - 0.5 * slope * width
    peak, sigma, noise = rng.uniform(60, 230), rng.uniform(1.2, 3.0), rng.uniform(0.3, 2.0)
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    level = 12 + peak * np.exp(-0.5 * ((y - row - slope * x) / sigma) ** 2)
    level += np.random.default_rng(rng.getrandbits(32)).normal(0, noise, level.shape)
    return np.clip(np.rint(level), 0, 255).astype(np.uint8), (row, slope)


def coloured(grey: np.ndarray) -> np.ndarray:
    """The stripe of a green laser; blue, green, red."""
    return np.stack([grey // 2, grey, grey // 3], axis=-1)


def encoded(pixels: np.ndarray, rng: random.Random, *more: int) -> bytes:
    quality = rng.choice([80, 90, 95, 98])
    return cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, quality, *more])[1].tobytes()


def segments(data: bytes) -> list[tuple[int, int, int]]:
    """Marker, offset and whole length of the segments up to the first scan's head."""
    found, at = [], 2
    while not found or found[-1][0] != 0xDA:
        length = 2 + struct.unpack_from(">H", data, at + 2)[0]
        found.append((data[at + 1], at, length))
        at += length
    return found


def without_tables(data: bytes) -> bytes:
    """As MJPEG leaves out the standard tables."""
    left_out = [(at, at + length) for marker, at, length in segments(data) if marker == 0xC4]
    return b"".join(data[a:b] for a, b in zip([0, *(end for _, end in left_out)], [*(at for at, _ in left_out), len(data)]))


def held(upright: np.ndarray, orientation: int) -> np.ndarray:
    """Pixels as a camera stores them that was held so (EXIF, tag 0x0112)."""
    turned = {2: np.fliplr, 3: lambda a: np.rot90(a, 2), 4: np.flipud, 5: lambda a: np.swapaxes(a, 0, 1),
              6: np.rot90, 7: lambda a: np.swapaxes(np.rot90(a, 2), 0, 1), 8: lambda a: np.rot90(a, -1)}
    return np.ascontiguousarray(turned[orientation](upright))


def with_exif(data: bytes, orientation: int) -> bytes:
    tiff = b"II*\0" + struct.pack("<IHHHIHHI", 8, 1, 0x0112, 3, 1, orientation, 0, 0)
    body = b"Exif\0\0" + tiff
    return data[:2] + struct.pack(">HH", 0xFFE1, len(body) + 2) + body + data[2:]


def own(rng: random.Random) -> Original:
    grey, drawn = stripe(rng, OWN_SIZE)
    data = jpeg.encode(grey.tolist(), rng.choice([80, 90, 95, 98]), interval=rng.choice([0, 1, 13, 40]), tables=rng.random() < 0.5)
    return Original("own encoder", data, OWN_SIZE, drawn)


def drawn(kind: str, rng: random.Random) -> Original:
    """A sound image of a kind."""
    if kind == "own encoder":
        return own(rng)
    if kind.endswith(".jpg"):
        return Original(kind, (FIXTURES / kind).read_bytes(), (96, 64))
    size = rng.choice(SIZES)
    grey, truth = stripe(rng, size)
    colour = coloured(grey)
    match kind:
        case "grey":
            data = encoded(grey, rng)
        case "colour 4:2:0":
            data = encoded(colour, rng, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_420)
        case "colour 4:2:2":
            data = encoded(colour, rng, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_422)
        case "colour 4:4:4":
            data = encoded(colour, rng, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444)
        case "progressive":
            data = encoded(rng.choice([grey, colour]), rng, cv2.IMWRITE_JPEG_PROGRESSIVE, 1)
        case "optimised tables":
            data = encoded(rng.choice([grey, colour]), rng, cv2.IMWRITE_JPEG_OPTIMIZE, 1)
        case "restart markers":
            data = encoded(rng.choice([grey, colour]), rng, cv2.IMWRITE_JPEG_RST_INTERVAL, rng.choice([1, 4, 20, 60]))
        case "without tables":
            data = without_tables(encoded(rng.choice([grey, colour]), rng))
        case _:
            orientation = rng.randrange(2, 9)
            data = with_exif(encoded(held(rng.choice([grey, colour]), orientation), rng), orientation)
    return Original(kind, data, size, truth)


ORIGINALS = ["own encoder", "grey", "colour 4:2:0", "colour 4:2:2", "colour 4:4:4", "progressive", "optimised tables", "restart markers",
             "without tables", "EXIF orientation", "optimized.jpg", "progressive.jpg", "restarts.jpg"]


def place(whole: bytes, at: int) -> str:
    """Segment of the head that holds a byte; empty = coded data."""
    for marker, start, length in segments(whole):
        if start <= at < start + length:
            return f" in {SEGMENTS.get(marker, f'segment {marker:02x}')}"
    return ""


def damaged(whole: bytes, kind: str, rng: random.Random) -> tuple[bytes, str]:
    """Damage of a kind anywhere behind the first bytes, and its words; never the same bytes."""
    n = len(whole)
    size = min(rng.choice([16, 64, 188, 512, 1024]), n // 2)
    at = rng.randrange(20, n - size - 2)
    changed = bytearray(whole)
    if kind == "cut":
        at = rng.randrange(20, n - 1)
        return whole[:at], f"cut at {at} of {n}"
    if kind == "cut, end marker kept":
        return whole[:at] + whole[-2:], f"cut at {at} of {n}, end marker kept"
    if kind == "hole":
        return whole[:at] + whole[at + size :], f"hole of {size} at {at} of {n}{place(whole, at)}"
    if kind == "zeroed":
        while not any(whole[at : at + size]):
            at = rng.randrange(20, n - size - 2)
        changed[at : at + size] = bytes(size)
        return bytes(changed), f"{size} zeros at {at} of {n}{place(whole, at)}"
    if kind == "a byte":
        changed[at] ^= rng.randrange(1, 256)
        return bytes(changed), f"byte {at} of {n}{place(whole, at)}"
    places = rng.sample(range(20, n - 2), 1 if kind == "one bit" else rng.randrange(2, 9))
    for at in places:
        changed[at] ^= 1 << rng.randrange(8)
    return bytes(changed), f"a bit each at {', '.join(f'{at}{place(whole, at)}' for at in places)} of {n}"


def points(out: str) -> Points:
    """Row and its standard deviation by column."""
    rows = csv.DictReader(io.StringIO(out))
    return {row["column_px"]: (float(row["row_px"]), float(row["sd_px"])) for row in rows}


def not_as_drawn(original: Original, found: Points) -> str:
    """What is wrong with the points of a sound image; empty = nothing."""
    if len(found) < DRAWN_SHARE * original.size[0]:
        return f"{len(found)} points in {original.size[0]} columns"
    if original.drawn is None:
        return ""
    row, slope = original.drawn
    off = sorted(abs(at - row - slope * float(column)) for column, (at, _) in found.items())
    return f"points off by {off[len(off) // 2]:.2f} px" if off[len(off) // 2] > DRAWN_PX else ""


def same(sound: Points, found: Points) -> bool:
    """Whether the points are those of the sound image, as far as either states that it knows them."""
    return len(sound.keys() ^ found.keys()) <= DIFFERS_POINTS and all(
        abs(row - sound[column][0]) <= DIFFERS_SDS * min(sd, sound[column][1])
        for column, (row, sd) in found.items() if column in sound
    )


def worst(sound: Points, found: Points) -> str:
    """How far the points are from the sound image's, in words."""
    off = [(abs(row - sound[c][0]), sd) for c, (row, sd) in found.items() if c in sound]
    far, sd = max(off, default=(0.0, 0.0))
    apart = sum(abs(row - sound[c][0]) > DIFFERS_SDS * min(sd, sound[c][1]) for c, (row, sd) in found.items() if c in sound)
    return f"{len(found)} points for {len(sound)}, {apart} of them elsewhere, by up to {far:.2f} px at a stated sd of {sd:.3f}"


def refused_as_damaged(ran: Ran) -> bool:
    return ran.code == 2 and not points(ran.out) and "damaged" in ran.text


def run(bench: Bench) -> None:
    rng = bench.rng("images")
    folder = bench.folder / "images"
    # Lost ones of each folder: one folder per size, as the frames of one camera.
    lost: dict[Path, list[str]] = {}
    counts: collections.Counter[Path] = collections.Counter()
    fine: collections.Counter[str] = collections.Counter()
    said: collections.Counter[str] = collections.Counter()
    untrue, silent, alarms = [], [], []

    def extracted(size: tuple[int, int], data: bytes) -> tuple[Ran, str]:
        """What `extract` finds in an image, and its file's name in the folder of its size."""
        here = folder / f"{size[0]}x{size[1]}"
        here.mkdir(parents=True, exist_ok=True)
        counts[here] += 1
        path = here / f"{counts[here]:04}.jpg"
        path.write_bytes(data)
        ran = bench.run("extract", path, "--csv")
        if ran.code == 2:
            lost.setdefault(here, []).append(path.name)
        return ran, f"{here.name}/{path.name}"

    cases = bench.times(200)
    whole: list[tuple[Original, Points]] = []
    for k in range(cases):
        original = drawn(ORIGINALS[k % len(ORIGINALS)], rng)
        ran, name = extracted(original.size, original.data)
        found = points(ran.out)
        name = f"{name}, {original.kind}"
        if ran.code == 2:
            alarms.append(f"{name}: {ran.text.strip()[-200:]}")
        elif ran.code != 0:
            untrue.append(f"{name}: exit code {ran.code}: {ran.text.strip()[-200:]}")
        elif wrong := not_as_drawn(original, found):
            untrue.append(f"{name}: {wrong}")
        else:
            fine["read as drawn"] += 1
            whole.append((original, found))
    bench.row("sound JPEGs", fine, untrue, alarms)
    for k, (original, sound) in enumerate(whole):
        # Each kind of original with each kind of damage.
        data, what = damaged(original.data, DAMAGE[k // len(ORIGINALS) % len(DAMAGE)], rng)
        ran, name = extracted(original.size, data)
        found = points(ran.out)
        name = f"{name}, {original.kind}, {what}"
        if refused_as_damaged(ran):
            said["refused as damaged"] += 1
        elif ran.code == 2 and not found:
            said["refused as no image that is read"] += 1
        elif ran.code != 0:
            silent.append(f"{name}: exit code {ran.code}, {len(found)} points: {ran.text.strip()[-200:]}")
        elif same(sound, found):
            said[f"the sound image's points within {DIFFERS_SDS} of the smaller sd"] += 1
        else:
            silent.append(f"{name}: {worst(sound, found)}, exit code 0")
    bench.row("damaged JPEGs", said, silent)
    replays: collections.Counter[str] = collections.Counter()
    wrong = []
    for here in sorted(counts):
        if fault := replayed(bench, here, counts[here], lost.get(here, [])):
            wrong.append(f"{here.name}: {fault}")
        else:
            replays["as many lost as one by one, and named"] += 1
    bench.row("the same as folders", replays, wrong)


def replayed(bench: Bench, folder: Path, count: int, lost: list[str]) -> str:
    """All of a folder at once: what is wrong; empty = as many are lost as were refused one by one, and the first are named."""
    done = bench.run("replay", folder, "--rate-hz", "10", "--out", bench.folder / f"{folder.name}.mcap", "--json")
    if done.code not in (0, 3) or not done.out.strip():
        return f"exit code {done.code}: {done.text.strip()[-300:]}"
    report = json.loads(done.out)["replays"][0]["report"]
    named = [name for name in lost[:NAMED] if name in done.text]
    if (done.code == 3) != bool(lost) or report["frames"] != count or report["undecodable"] != len(lost) or named != lost[:NAMED]:
        return f"exit code {done.code}, {report['undecodable']} lost of {len(lost)}, {len(named)} of the first {NAMED} named"
    return ""
