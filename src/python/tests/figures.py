"""Figures of the book's Validation: `python src/python/tests/figures.py LOG` with the wheel of `tests/python wheel` installed.

Reading LOG's motion and commands beside the pure-Python `mcap` reader (once each, as a notebook does), the cost of a call of
`extract`, and the memory after a thousand calls of each function.
"""

from __future__ import annotations

import resource
import sys
import tempfile
import time
import timeit
from pathlib import Path
from typing import Callable, Dict, List

import numpy
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

import hydroline

TOPICS = ["/vehicle/motion", "/thruster/command"]


def reading(path: str) -> None:
    began = time.perf_counter()
    log = hydroline.read(path)
    ours = [len(log.motion), len(log.commands)]
    ours_s = time.perf_counter() - began
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
    theirs_s = time.perf_counter() - began
    assert ours == [len(rows[topic]) for topic in TOPICS]
    size_mb = Path(path).stat().st_size / 1e6
    print(f"{size_mb:.0f} MB, {ours} rows: {ours_s:.3f} s, mcap {theirs_s:.3f} s, {theirs_s / ours_s:.1f} x")


def extracting() -> None:
    none = numpy.zeros((8, 8), numpy.uint8)
    image = numpy.zeros((576, 720), numpy.uint8)
    image[286:291] = numpy.array([60, 150, 200, 150, 60], numpy.uint8)[:, None]
    for name, frame, count in (("call alone", none, 20000), ("720 x 576", image, 300)):
        each_s = min(timeit.repeat(lambda: hydroline.extract(frame), number=count, repeat=5)) / count
        print(f"extract, {name}: {1e6 * each_s:.2f} us")


def calling(folder: Path, count: int = 1000) -> None:
    log = hydroline.simulate(rig="lshpi", plan="surge-4n", motion_only=True, out=folder / "a.mcap").log
    image = numpy.zeros((576, 720), numpy.uint8)

    def simulate() -> None:
        out = folder / "b.mcap"
        out.unlink(missing_ok=True)
        hydroline.simulate(rig="lshpi", plan="still", motion_only=True, out=out)

    calls: Dict[str, Callable[[], object]] = {
        "read": lambda: hydroline.read(log).motion["x_m"],
        "extract": lambda: hydroline.extract(image).row_px,
        "Rig.load": lambda: hydroline.Rig.load("lshpi"),
        "simulate": simulate,
        "predict": lambda: hydroline.predict(rig="lshpi", plan="still", rate=5),
        "doctor": lambda: hydroline.doctor(log),
        "identify": lambda: hydroline.identify(log, rig="lshpi"),
        "diagnose": lambda: hydroline.diagnose(log, rig="lshpi"),
    }
    for name, call in calls.items():
        sizes = []
        for _ in range(3):
            for _ in range(count // 2):
                call()
            pages = int(Path("/proc/self/statm").read_text().split()[1])
            sizes.append(pages * resource.getpagesize() // 1024)
        print(f"{name}: resident {sizes} kB after {[k * (count // 2) for k in (1, 2, 3)]} calls", flush=True)


if __name__ == "__main__":
    for path in sys.argv[1:]:
        reading(path)
    extracting()
    with tempfile.TemporaryDirectory() as folder:
        calling(Path(folder))
