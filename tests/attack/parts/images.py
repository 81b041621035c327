"""Damaged JPEGs: an image that is cut, has a hole, zeros or flipped bits gives no stripe points without it being said."""
from __future__ import annotations

import collections
import csv
import io
import json
import math
import random
import resource

from . import jpeg
from .common import Bench

WIDTH, HEIGHT = 320, 160
# Longest for one image, and most memory of any run.
IMAGE_PATIENCE_S, MEMORY_MAX_KB = 20, 500_000
# Standard deviations, as stated with a point, by which it may differ from the sound image's.
DIFFERS_SDS = 3.0
KINDS = ["cut", "cut, end marker kept", "hole", "zeroed", "one bit", "some bits", "a byte"]


def sound(rng: random.Random) -> bytes:
    """A tilted stripe as a camera sees it, of any quality, with and without restart markers and tables."""
    row, slope, peak = rng.uniform(50, 110), rng.uniform(-0.05, 0.05), rng.uniform(60, 230)
    sigma, noise = rng.uniform(1.2, 3.0), rng.uniform(0.3, 2.0)

    def level(x: int, y: int) -> int:
        z = (y - row - slope * x) / sigma
        return min(max(round(12 + peak * math.exp(-0.5 * z * z) + rng.gauss(0, noise)), 0), 255)

    pixels = [[level(x, y) for x in range(WIDTH)] for y in range(HEIGHT)]
    return jpeg.encode(pixels, rng.choice([80, 90, 95, 98]), interval=rng.choice([0, 0, 1, 13, 40]), tables=rng.random() < 0.7)


def damaged(whole: bytes, kind: str, rng: random.Random) -> bytes:
    """Damage of a kind anywhere behind the first segments' lengths; never the same bytes."""
    n = len(whole)
    size = min(rng.choice([16, 64, 188, 512, 1024]), n // 2)
    at = rng.randrange(20, n - size - 2)
    changed = bytearray(whole)
    if kind == "cut":
        return whole[: rng.randrange(20, n - 1)]
    if kind == "cut, end marker kept":
        return whole[:at] + whole[-2:]
    if kind == "hole":
        return whole[:at] + whole[at + size :]
    if kind == "zeroed":
        changed[at : at + size] = bytes(size)
    elif kind == "a byte":
        changed[at] ^= rng.randrange(1, 256)
    else:
        for _ in range(1 if kind == "one bit" else rng.randrange(2, 9)):
            changed[rng.randrange(20, n - 2)] ^= 1 << rng.randrange(8)
    return bytes(changed)


def points(text: str) -> dict[str, tuple[float, float]]:
    """Row and its standard deviation by column."""
    rows = csv.DictReader(io.StringIO(text[text.index("column_px") :]) if "column_px" in text else io.StringIO())
    return {row["column_px"]: (float(row["row_px"]), float(row["sd_px"])) for row in rows if row["sd_px"]}


def run(bench: Bench) -> None:
    rng = bench.rng("images")
    folder = bench.folder / "images"
    folder.mkdir()
    said: collections.Counter[str] = collections.Counter()
    silent: list[str] = []
    names, cases = [], bench.times(200)
    originals = [sound(rng) for _ in range(max(2, cases // 10))]
    before = []
    for k, whole in enumerate(originals):
        path = folder / f"sound{1000 + k}.jpg"
        path.write_bytes(whole)
        found = bench.run("extract", path, "--csv", patience_s=IMAGE_PATIENCE_S)
        if found.code != 0:
            raise SystemExit(f"a sound image to damage: exit code {found.code}\n{found.text}")
        before.append(points(found.text))
    for k in range(cases):
        which, kind = k % len(originals), KINDS[k % len(KINDS)]
        path = folder / f"damaged{2000 + k}.jpg"
        path.write_bytes(damaged(originals[which], kind, rng))
        found = bench.run("extract", path, "--csv", patience_s=IMAGE_PATIENCE_S)
        after = points(found.text)
        if found.code == 2 and not after:
            said["by extract, no points" if "damaged" in found.text else "no image any more"] += 1
            names.append(path.name)
        elif found.code != 0:
            silent.append(f"{path.name}, {kind}: exit code {found.code}, {len(after)} points")
        elif same(before[which], after):
            said["not seen, every point as of the sound image within 3 of its sds"] += 1
        else:
            silent.append(f"{path.name}, {kind}: {len(after)} points, not those of the sound image, exit code 0")
    bench.row("damaged JPEGs", said, silent)
    bench.row("the same as a folder", *replayed(bench, folder, set(names)))


def same(before: dict[str, tuple[float, float]], after: dict[str, tuple[float, float]]) -> bool:
    """Whether the points are those of the sound image, within the standard deviations that are stated with them."""
    return before.keys() == after.keys() and all(
        abs(row - before[column][0]) <= DIFFERS_SDS * sd for column, (row, sd) in after.items()
    )


def replayed(bench: Bench, folder, damaged_names: set[str]) -> tuple[collections.Counter[str], list[str]]:
    """All of them at once: as many are lost as were damaged one by one, and the first are named."""
    said: collections.Counter[str] = collections.Counter()
    out = bench.folder / "images.mcap"
    done = bench.run("replay", folder, "--rate-hz", "10", "--out", out, "--json")
    text = done.text[done.text.find("{") : done.text.rfind("}") + 1]
    report = json.loads(text)["replays"][0]["report"] if text else {}
    lost, named = report.get("undecodable"), [n for n in damaged_names if n in done.text]
    memory_kb = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    silent = []
    if done.code != 3 or lost != len(damaged_names) or not named:
        silent.append(f"replay: exit code {done.code}, {lost} lost of {len(damaged_names)} damaged, {len(named)} named")
    if memory_kb > MEMORY_MAX_KB:
        silent.append(f"{memory_kb} kB of memory")
    if not silent:
        said["counted and named by replay"] = len(damaged_names)
    return said, silent
