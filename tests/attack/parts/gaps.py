"""Gaps of a second to a century in a run's stamps: rows that are lost, a vehicle that waits, a clock that is set.

Each table is imported (and again with --accept-faults where it is refused), and every command that reads the log reads it:
none takes more than 500 MB or 20 s, and no coefficient is far off without a word.
"""
from __future__ import annotations

import collections
import csv
import json
import os
import resource
import subprocess
import tempfile
import time
from pathlib import Path

from .common import Bench, Ran

GAPS_S = [1.0, 5.0, 18.0, 37.0, 120.0, 1000.7, 1e4 + 0.7, 1e5 + 0.7, 1e6 + 0.7, 3e7 + 0.7, 1e9 + 0.7, 3.16e9]
MEMORY_MB = 500
TIME_S = 20.0
# Address space beyond which a command is ended before it takes the machine along.
LIMIT_BYTES = 4 << 30
# sd from the truth that are no chance.
OFF_SD = 5.0
MAP = """[time]
column = "t"
unit = "s"
[motion.x_m]
column = "x"
unit = "m"
[[command]]
thruster = "surge"
column = "u"
unit = "N"
"""


def measured(bench: Bench, *words: object) -> tuple[Ran, float, float]:
    """A command to its end, its peak memory [MB] and its time [s]."""
    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_AS, (LIMIT_BYTES, LIMIT_BYTES))
    with tempfile.TemporaryFile() as out:
        line = [str(bench.binary), *map(str, words)]
        begin = time.monotonic()
        child = subprocess.Popen(line, stdin=subprocess.DEVNULL, stdout=out, stderr=out, env=bench.env(None), preexec_fn=limit)
        while True:
            pid, status, usage = os.wait4(child.pid, os.WNOHANG)
            if pid:
                child.returncode = os.waitstatus_to_exitcode(status)
                break
            if time.monotonic() - begin > 3 * TIME_S:
                child.kill()
            time.sleep(0.01)
        took_s = time.monotonic() - begin
        out.seek(0)
        return Ran(child.returncode, out.read().decode(errors="replace")), usage.ru_maxrss / 1024, took_s


def rows(bench: Bench) -> list[tuple[float, float, float]]:
    """Time, surge and load of a run under reversals that begins and ends at rest."""
    log, table = bench.folder / "gaps.mcap", bench.folder / "gaps.csv"
    bench.run("simulate", "--motion-only", "--rig", "lshpi", "--plan", "reversals", "--seed", bench.seed, "--tail", "20", "--out", log)
    bench.run("export", log, "--merged", "--out", table)
    with table.open() as f:
        return [(float(r["t_s"]), float(r["x_m"]), float(r["surge_n"] or 0)) for r in csv.DictReader(f)]


def cases(run: list[tuple[float, float, float]]) -> list[tuple[str, float, list[tuple[float, float, float]]]]:
    made = []
    middle = len(run) // 2
    for gap_s in GAPS_S:
        made.append(("clock set", gap_s, [(t + (gap_s if k >= middle else 0), x, u) for k, (t, x, u) in enumerate(run)]))
        last_t, last_x, _ = run[-1]
        waits = run + [(t + gap_s + last_t, x - run[0][1] + last_x, u) for t, x, u in run]
        made.append(("waits at rest", gap_s, waits))
        if gap_s < 10:
            made.append(("rows lost", gap_s, [r for r in run if not run[middle][0] <= r[0] < run[middle][0] + gap_s]))
    return made


def fault(kind: str, found: Ran, took: tuple[float, float]) -> str:
    """What is wrong with how a command ended; empty = nothing."""
    if found.code not in (0, 1, 2, 3) or "panicked" in found.text:
        return f"{kind}: exit code {found.code}: {found.text.strip()[-200:]}"
    if took[0] > MEMORY_MB or took[1] > TIME_S:
        return f"{kind}: {took[0]:.0f} MB, {took[1]:.1f} s"
    return ""


def run(bench: Bench) -> None:
    base = rows(bench)
    said: collections.Counter[str] = collections.Counter()
    silent = []
    where = bench.folder / "gaps"
    where.mkdir()
    (where / "m.toml").write_text(MAP)
    for n, (kind, gap_s, table) in enumerate(cases(base)):
        name = f"{kind}, {gap_s:g} s"
        source, log = where / f"{n}.csv", where / f"{n}.mcap"
        source.write_text("t,x,u\n" + "".join(f"{t:.4f},{x!r},{u!r}\n" for t, x, u in table))
        words = ["import", source, "--map", where / "m.toml", "--out", log]
        imported, *took = measured(bench, *words)
        faults = [fault("import", imported, tuple(took))]
        refused = imported.code == 2 and "from_s =" in imported.text
        if refused:
            accepted, *took = measured(bench, *words, "--accept-faults")
            faults.append(fault("import --accept-faults", accepted, tuple(took)))
        if not log.exists():
            silent.append(f"{name}: no log: {imported.text.strip()[-300:]}")
            continue
        told = "WARNING" in imported.text or "FAULT" in imported.text
        faults += readers(bench, log, where, told or refused)
        faults = [f for f in faults if f]
        if faults:
            silent.append(f"{name}: {'; '.join(faults)}")
        else:
            said["refused, with its two runs" if refused else "a gap, said"] += 1
        log.unlink()
    bench.row("gaps of a second to a century", said, silent)


def readers(bench: Bench, log: Path, where: Path, told: bool) -> list[str]:
    faults = []
    found, *took = measured(bench, "identify", log, "--rig", "lshpi", "--json")
    faults.append(fault("identify", found, tuple(took)))
    if found.code == 0:
        text = found.text[found.text.index("{"):]
        fitted = json.JSONDecoder().raw_decode(text)[0]
        for key in ("x_u", "x_uu"):
            p = fitted["parameters"][key]
            off = abs(p["value"] - p["rig"]) / p["sd"] if p["sd"] else 0
            if off > OFF_SD and not (told or fitted["misfit"]):
                faults.append(f"identify: {key} {off:.0f} sd off, no word")
    table = where / "out.csv"
    for words in (["diagnose", log, "--rig", "lshpi", "--accept-faults"], ["predict", "--rig", "lshpi", "--plan", "reversals", "--measured", log],
                  ["export", log, "--merged", "--rig", "lshpi", "--out", table], ["info", log], ["doctor", log]):
        table.unlink(missing_ok=True)
        found, *took = measured(bench, *words)
        faults.append(fault(words[0], found, tuple(took)))
    return faults
