"""A call of every function, and what calls leave in memory: a small share in test_calls.py, a thousand of each in figures.py."""

from __future__ import annotations

import csv
import resource
from pathlib import Path
from typing import Callable, Dict, List, Sequence

import numpy

import hydroline

BOARD_PLAN = "[[step]]\nfor_s = 0.32\nwrench = { surge_n = 0.0 }\n"
MAP = '[time]\ncolumn = "timestamp_ns"\nunit = "ns"\n[motion.x_m]\ncolumn = "x_m"\nunit = "m"\n'


def table_of(log: str, path: Path, rows: int = 200) -> Path:
    """The first rows of a log's motion as a table."""
    motion = hydroline.read(log).motion
    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["timestamp_ns", "x_m"])
        writer.writerows(zip(motion["timestamp_ns"][:rows].tolist(), motion["x_m"][:rows].tolist()))
    return path


def calls(folder: Path, log: str) -> Dict[str, Callable[[], object]]:
    """A short call of every function, with a log that has motion."""
    image = numpy.zeros((576, 720), numpy.uint8)
    image[286:291] = numpy.array([60, 150, 200, 150, 60], numpy.uint8)[:, None]
    plan, mapped, table = folder / "short.toml", folder / "map.toml", table_of(log, folder / "motion.csv")
    plan.write_text(BOARD_PLAN)
    mapped.write_text(MAP)
    board = hydroline.simulate(rig="lshpi", plan=plan, show_board="dots-50", seed=1, out=folder / "a-board.mcap").log

    def anew(name: str) -> Path:
        (folder / name).unlink(missing_ok=True)
        return folder / name

    return {
        "read": lambda: hydroline.read(log).motion["x_m"],
        "frames": lambda: hydroline.read(board).frames[0].grey,
        "extract": lambda: hydroline.extract(image).row_px,
        "Rig.load": lambda: hydroline.Rig.load("lshpi"),
        "simulate": lambda: hydroline.simulate(rig="lshpi", plan="still", motion_only=True, out=anew("b.mcap")),
        "predict": lambda: hydroline.predict(rig="lshpi", plan="still", rate=1),
        "doctor": lambda: hydroline.doctor(log),
        "import_table": lambda: hydroline.import_table(table, map=mapped, out=anew("c.mcap")),
        "calibrate": lambda: hydroline.calibrate(board, board="dots-50", every=4, out=folder / "c.toml", force=True),
        "identify": lambda: hydroline.identify(log, rig="lshpi"),
        "diagnose": lambda: hydroline.diagnose(log, rig="lshpi", time_limit="none"),
    }


def resident_kb() -> int:
    """Memory of this process that is in use."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * resource.getpagesize() // 1024


def growth_kb(call: Callable[[], object], count: int, rounds: int = 10) -> List[int]:
    """Resident memory after each of so many rounds of calls, over that after a first fifth which is not counted."""
    for _ in range(max(count // 5, 10)):
        call()
    before, sizes = resident_kb(), []
    for _ in range(rounds):
        for _ in range(count // rounds):
            call()
        sizes.append(resident_kb() - before)
    return sizes


def slope_kb(sizes: Sequence[int], count: int) -> float:
    """Growth per call: of the straight line through the sizes."""
    at = numpy.linspace(count / len(sizes), count, len(sizes))
    return float(numpy.polyfit(at, sizes, 1)[0])
