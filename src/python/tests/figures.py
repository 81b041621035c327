"""Figures of the book's Validation, with the wheel of `tests/python wheel` installed:

    python src/python/tests/figures.py read LOG ...    motion and commands, beside the pure-Python `mcap` reader
    python src/python/tests/figures.py extract PROGRAM beside the Rust side (`cargo build --example time_extract`)
    python src/python/tests/figures.py memory [COUNT] [FUNCTION ...]    resident memory over so many calls of each

Both sides of a comparison are measured in one run, taking turns; the least of several rounds counts.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Dict, List, Tuple

import numpy
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

import hydroline
import memory

TOPICS = ["/vehicle/motion", "/thruster/command"]


def ours(path: str) -> Tuple[float, List[int]]:
    """Seconds and rows."""
    began = time.perf_counter()
    log = hydroline.read(path)
    rows = [len(log.motion), len(log.commands)]
    return time.perf_counter() - began, rows


def theirs(path: str) -> Tuple[float, List[int]]:
    """The same with the `mcap` package, which finds chunks by the index too, and decodes the same two kinds."""
    began = time.perf_counter()
    rows: Dict[str, List[object]] = {topic: [] for topic in TOPICS}
    with open(path, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, channel, _, m in reader.iter_decoded_messages(topics=TOPICS, log_time_order=False):
            stamp_ns = m.timestamp.ToNanoseconds()
            if channel.topic == TOPICS[0]:
                rows[channel.topic].append((stamp_ns, m.x_m, m.y_m, m.z_m, m.phi_rad, m.theta_rad, m.psi_rad))
            else:
                rows[channel.topic].append((stamp_ns, m.thruster, m.thrust_n, m.pulse_us))
    return time.perf_counter() - began, [len(rows[topic]) for topic in TOPICS]


def reading(path: str, rounds: int = 3) -> float:
    """How many times as fast ours is."""
    taken: List[Tuple[float, float]] = []
    for _ in range(rounds):
        (ours_s, found), (theirs_s, expected) = ours(path), theirs(path)
        assert found == expected
        taken.append((ours_s, theirs_s))
    ours_s, theirs_s = (min(t[k] for t in taken) for k in range(2))
    size_mb = Path(path).stat().st_size / 1e6
    print(f"{size_mb:.0f} MB, {found} rows: {ours_s:.3f} s, mcap {theirs_s:.3f} s, {theirs_s / ours_s:.1f} x", flush=True)
    return theirs_s / ours_s


def frame() -> "numpy.ndarray[Tuple[int, int], numpy.dtype[numpy.uint8]]":
    """A line across 720 x 576 pixels, with noise."""
    image = numpy.random.default_rng(1).normal(10.0, 2.0, (576, 720))
    image[286:291] += numpy.array([60, 150, 200, 150, 60])[:, None]
    return image.clip(0, 255).astype(numpy.uint8)


def extracting(program: str, count: int = 100, rounds: int = 20) -> float:
    """Cost of `extract` over that of the same work in Rust."""
    image, times = frame(), []
    words = [program, *map(str, (image.shape[1], image.shape[0], count))]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as rust:
        assert rust.stdin and rust.stdout
        rust.stdin.write(image.tobytes())
        for _ in range(rounds):
            rust.stdin.write(b"\n")
            rust.stdin.flush()
            rust_s = float(rust.stdout.readline())
            began = time.perf_counter()
            for _ in range(count):
                hydroline.extract(image)
            times.append(((time.perf_counter() - began) / count, rust_s))
        rust.stdin.close()
    python_s, rust_s = (min(t[k] for t in times) for k in range(2))
    print(f"extract, 720 x 576: {1e6 * python_s:.1f} us, Rust {1e6 * rust_s:.1f} us, {python_s / rust_s:.3f} x", flush=True)
    return python_s / rust_s


def remembering(count: int, names: List[str]) -> None:
    """Resident memory over calls of each function."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        log = hydroline.simulate(rig="lshpi", plan="surge-4n", motion_only=True, out=folder / "a.mcap").log
        for function, call in memory.calls(folder, log).items():
            if names and function not in names:
                continue
            began = time.perf_counter()
            sizes = memory.growth_kb(call, count)
            each_s = (time.perf_counter() - began) / (1.2 * count)
            slope = memory.slope_kb(sizes, count)
            print(f"{function}: {slope:+.3f} kB a call; kB after each tenth of {count}: {sizes}; {each_s:.4f} s each", flush=True)


if __name__ == "__main__":
    what, *words = sys.argv[1:]
    if what == "read":
        for path in words:
            reading(path)
    elif what == "extract":
        extracting(words[0])
    else:
        remembering(int(words[0]) if words else 1000, words[1:])
