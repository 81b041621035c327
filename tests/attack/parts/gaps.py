"""Gaps of a second to a century in a run's stamps: rows that are lost, a vehicle that waits, a clock that is set.

Each table is imported, and again with --accept-faults where it is refused; every command that reads the log reads it. A
clock that was set is refused with its two runs, which are imported as the refusal says and hold the rows that they should.
Beyond the vehicle's memory, and wherever it waits at rest, a gap takes nothing from what the motion says of the vehicle:
the coefficients are those of the run without it.
"""
from __future__ import annotations

import collections
import csv
import json
import math
import re
from dataclasses import dataclass
from pathlib import Path

from .common import Bench, Ran

# A clock's own step, to and from summer time: nobody waits for just that [s].
HOUR_S = 3600.0
GAPS_S = [0.1, 1.0, 5.0, 18.0, 37.0, 120.0, 1000.7, HOUR_S, 1e4 + 0.7, 1e5 + 0.7, 1e6 + 0.7, 3e7 + 0.7, 1e9 + 0.7, 3.16e9]
# Gaps of rows that are lost: of longer ones too little is left.
LOST_S = [0.1, 1.0, 5.0]
# The built-in lshpi remembers its motion for less [s].
MEMORY_S = 100.0
# A clock that is set by less shows nothing but a gap [s].
SET_S = 1.0
# No vehicle waits for so long in one recording [s]: a day.
PAUSE_MAX_S = 86_400.0
# Address space beyond which a command is ended before it takes the machine along.
LIMIT = f"ulimit -v {4 << 20}"
# Of the sound run, sd from the rig that are no chance.
TRUE_SD = 5.0
# Standard deviations of both together by which a coefficient may be another than without the gap, and times of the sound
# run's that its own may be.
SAME_SD, SAME_FACTOR = 3.0, 3.0
COEFFICIENTS = ("x_u", "x_uu")
# Reversals: seconds and surge [N].
LEGS = [(4.0, 8.0), (6.0, -8.0), (6.0, 8.0), (6.0, -8.0), (3.0, 8.0)]
# Recorded behind them, at rest but for what the vehicle drifts on, and before they come again [s].
REST_S, BEFORE_S = 20.0, 2.0
MAP = """[time]
column = "t"
unit = "s"
{window}
[motion.x_m]
column = "x"
unit = "m"
[[command]]
thruster = "surge"
column = "u"
unit = "N"
"""
WINDOWS = re.compile(r"(to_s = [\d.]+\d).*(from_s = [\d.]+\d)")

Row = tuple[float, float, float]


@dataclass
class Case:
    kind: str
    gap_s: float
    table: list[Row]
    # Row behind the gap.
    behind: int
    # Rows as they would be without it.
    whole: list[Row]

    def name(self) -> str:
        return f"{self.kind}, {self.gap_s:g} s"

    def is_pause(self) -> bool:
        """Whether time has passed, as the table says, and the vehicle's state is known all the while."""
        return self.kind == "waits at rest" and self.gap_s < PAUSE_MAX_S

    def is_step(self) -> bool:
        """Whether the clock was set, as the motion or the length of the gap shows."""
        return self.kind != "rows lost" and not self.is_pause() and self.gap_s >= SET_S


def made(bench: Bench, where: Path, name: str, table: list[Row], *more: object, window: str = "") -> tuple[Ran, Path]:
    """A table, imported: what the import says, and the log."""
    source, map_, log = (where / f"{name}.{suffix}" for suffix in ("csv", "toml", "mcap"))
    log.unlink(missing_ok=True)
    source.write_text("t,x,u\n" + "".join(f"{t:.4f},{x!r},{u!r}\n" for t, x, u in table))
    map_.write_text(MAP.format(window=window))
    return bench.run("import", source, "--map", map_, "--out", log, *more, shell=LIMIT), log


def simulated(bench: Bench, legs: list[tuple[float, float]]) -> list[Row]:
    """Time, surge and load of a run that begins at rest."""
    plan, log, table = (bench.folder / f"gaps.{suffix}" for suffix in ("toml", "mcap", "csv"))
    log.unlink(missing_ok=True)
    table.unlink(missing_ok=True)
    steps = "".join(f"[[step]]\nfor_s = {for_s}\nwrench = {{ surge_n = {surge_n} }}\n" for for_s, surge_n in legs)
    plan.write_text(f'name = "gaps"\n{steps}')
    bench.run("simulate", "--motion-only", "--rig", "lshpi", "--plan", plan, "--seed", bench.seed, "--tail", REST_S, "--out", log)
    bench.run("export", log, "--merged", "--out", table)
    with table.open() as f:
        return [(float(r["t_s"]), float(r["x_m"]), float(r["surge_n"] or 0)) for r in csv.DictReader(f)]


def waits(bench: Bench, gap_s: float) -> Case:
    """Twice the same legs with a rest between them, of which the middle is not recorded."""
    # Longer than that the vehicle only stands.
    drifts_s = min(gap_s, 1.2 * MEMORY_S)
    whole = simulated(bench, [*LEGS, (REST_S + drifts_s + BEFORE_S, 0.0), *LEGS])
    from_s = whole[0][0] + sum(for_s for for_s, _ in LEGS) + REST_S
    before = [row for row in whole if row[0] < from_s]
    after = [(t + gap_s - drifts_s, x, u) for t, x, u in whole if t >= from_s + drifts_s]
    return Case("waits at rest", gap_s, before + after, len(before), whole)


def cases(bench: Bench, run: list[Row]) -> list[Case]:
    made = []
    # Where it is fastest, so that a clock that is set shows.
    n, side = len(run), 8
    fastest = max(range(n // 3, 2 * n // 3), key=lambda k: abs(run[k + side][1] - run[k - side][1]))
    for gap_s in GAPS_S:
        stepped = [(t + (gap_s if k >= fastest else 0), x, u) for k, (t, x, u) in enumerate(run)]
        made.append(Case("clock set", gap_s, stepped, fastest, run))
        if gap_s != HOUR_S:
            made.append(waits(bench, gap_s))
        if gap_s in LOST_S:
            made.append(Case("rows lost", gap_s, [r for r in run if not 0 <= r[0] - run[fastest][0] < gap_s], fastest, run))
    return made


def ended(kind: str, found: Ran, *good: int) -> list[str]:
    """What is wrong with how a command ended."""
    if found.code not in good or "panicked" in found.text:
        return [f"{kind}: exit code {found.code}: {found.text.strip()[-200:]}"]
    return []


@dataclass
class Fitted:
    value: float
    sd: float | None
    rig: float


def identified(bench: Bench, *logs: Path) -> tuple[Ran, dict[str, Fitted]]:
    """`identify` of logs, and what it found."""
    found = bench.run("identify", *logs, "--rig", "lshpi", "--json", shell=LIMIT)
    if found.code != 0:
        return found, {}
    parameters = json.loads(found.out)["parameters"]
    return found, {key: Fitted(*(parameters[key][k] for k in ("value", "sd", "rig"))) for key in COEFFICIENTS}


@dataclass
class Expected:
    """What `identify` finds without the gap, and of the run alone."""

    whole: dict[str, Fitted]
    sound: dict[str, Fitted]


def moved(bench: Bench, expected: Expected, *logs: Path) -> list[str]:
    """What `identify` finds otherwise than without the gap."""
    found, fitted = identified(bench, *logs)
    faults = ended("identify", found, 0)
    for key, here in fitted.items():
        there, sound = expected.whole[key], expected.sound[key]
        if not here.sd:
            faults.append(f"identify: {key} without a standard deviation")
        elif not (abs(here.value - there.value) < SAME_SD * math.hypot(here.sd, there.sd) and here.sd < SAME_FACTOR * sound.sd):
            faults.append(f"identify: {key} {here.value:.3f} +- {here.sd:.3f}, not {there.value:.3f} +- {there.sd:.3f}")
    return faults


def differs(bench: Bench, log: Path, table: list[Row]) -> list[str]:
    """What a log holds otherwise than the table's rows, as `export` writes it."""
    out = log.with_name("out.csv")
    out.unlink(missing_ok=True)
    found = bench.run("export", log, "--merged", "--out", out, shell=LIMIT)
    if faults := ended("export", found, 0):
        return faults
    with out.open() as f:
        got = [(float(r["t_s"]), float(r["x_m"])) for r in csv.DictReader(f)]
    out.unlink()
    if len(got) != len(table):
        return [f"{log.name}: {len(got)} rows, not {len(table)}"]
    off_t = max(abs((t - got[0][0]) - (row[0] - table[0][0])) for (t, _), row in zip(got, table))
    off_x = max(abs(x - row[1]) for (_, x), row in zip(got, table))
    # Stamps are written to 0.1 ms.
    return [f"{log.name}: stamps off by {off_t:.4f} s, x by {off_x:.2g} m"] if off_t > 3e-4 or off_x > 1e-6 else []


def two_runs(bench: Bench, where: Path, case: Case, words: str, expected: Expected) -> list[str]:
    """What is wrong with the two runs that a refusal names, imported as it says."""
    windows = WINDOWS.search(words)
    if not windows:
        return [f"refused without the two runs: {words.strip()[-300:]}"]
    faults, logs = [], []
    for window, table in zip(windows.groups(), (case.table[: case.behind], case.table[case.behind :])):
        found, log = made(bench, where, f"{case.name()}, {window.split()[0]}", case.table, window=window)
        wrong = ended(f"import with {window}", found, 0)
        wrong += [f"import with {window}: {found.text.strip()[-300:]}"] if "FAULT" in found.text else []
        faults += wrong or differs(bench, log, table)
        logs.append(log)
    if all(log.exists() for log in logs):
        faults += moved(bench, expected, *logs)
    return faults


def readers(bench: Bench, log: Path) -> list[str]:
    """What is wrong with how the others end that read a log."""
    faults = []
    for good, words in (
        ((0, 1), ["diagnose", log, "--rig", "lshpi", "--time-limit", "none", "--accept-faults"]),
        ((0,), ["predict", "--rig", "lshpi", "--plan", "reversals", "--measured", log]),
        ((0,), ["info", log]),
        ((0, 3), ["doctor", log]),
    ):
        faults += ended(str(words[0]), bench.run(*words, shell=LIMIT), *good)
    return faults


def judged(bench: Bench, where: Path, case: Case, expected: Expected) -> tuple[str, list[str], str]:
    """How a gap was said, what is wrong, and why it is a false alarm; one of them holds."""
    imported, log = made(bench, where, case.name(), case.table)
    refused = imported.code == 2
    faults = ended("import", imported, 0, 2)
    if refused and case.is_pause():
        return "", [], f"refused: {imported.text.strip()[-200:]}"
    if case.is_step() and not refused:
        faults.append("a clock that was set is imported")
    if refused:
        faults += two_runs(bench, where, case, imported.text, expected)
        accepted, log = made(bench, where, case.name(), case.table, "--accept-faults")
        faults += ended("import --accept-faults", accepted, 0, 3)
    elif "WARNING gaps" not in imported.text:
        faults.append("a gap, no word")
    if not log.exists():
        return "", faults + ["no log"], ""
    faults += differs(bench, log, case.table)
    if case.gap_s > MEMORY_S or case.is_pause():
        faults += moved(bench, expected, log)
    else:
        # A clock that was set, accepted all the same, may cost it the coefficients, not more.
        faults += ended("identify", identified(bench, log)[0], *((0, 1) if case.kind == "clock set" else (0,)))
    faults += readers(bench, log)
    return "refused, with its two runs" if refused else "a gap, said", faults, ""


def reference(bench: Bench, where: Path, table: list[Row]) -> dict[str, Fitted]:
    """Coefficients of a run without a gap, which are the rig's; else there is nothing to hold against."""
    imported, log = made(bench, where, "reference", table)
    found, fitted = identified(bench, log)
    if imported.code != 0 or "WARNING gaps" in imported.text or "FAULT" in imported.text or not fitted:
        raise SystemExit(f"a run without a gap: {imported.text}\n{found.text}")
    for key, one in fitted.items():
        if not one.sd or abs(one.value - one.rig) > TRUE_SD * one.sd:
            raise SystemExit(f"a run without a gap: {key} {one}")
    return fitted


def run(bench: Bench) -> None:
    base = simulated(bench, LEGS)
    where = bench.folder / "gaps"
    where.mkdir()
    sound = reference(bench, where, base)
    said: collections.Counter[str] = collections.Counter()
    silent, alarms = [], []
    for case in cases(bench, base):
        expected = Expected(sound if case.whole is base else reference(bench, where, case.whole), sound)
        how, faults, alarm = judged(bench, where, case, expected)
        if faults:
            silent.append(f"{case.name()}: {'; '.join(faults)}")
        elif alarm:
            alarms.append(f"{case.name()}: {alarm}")
        else:
            said[how] += 1
    bench.row("gaps of a second to a century", said, silent, alarms)
