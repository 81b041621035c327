"""What the sample consists of (cases.toml): rigs, plans, logs to make, and the commands of each stage."""
from __future__ import annotations

import re
import tomllib
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).resolve().parent.parent
# Files that are kept in the repository because an estimator made them: see [[kept]] in cases.toml.
DATA = HERE.parent / "data" / "sample"
EXPECTED = DATA / "expected.json"

# Stage by stage: its table in cases.toml, the subcommand, and what the subcommand needs besides the case's arguments.
STAGES = {
    "poses": ("pose", ["replay"], ".mcap"),
    "calibrations": ("calibration", ["calibrate"], ".toml"),
    "identifications": ("identification", ["identify"], None),
    "verdicts": ("verdict", ["diagnose"], None),
}


class SampleError(Exception):
    """What a person has to put right; printed without a traceback."""


@dataclass(frozen=True)
class Case:
    stage: str
    name: str
    args: tuple[str, ...]

    def command(self, inputs: Path, out: Path) -> list[str]:
        """The subcommand with its arguments, files in their places; `out` is the stage's folder."""
        _, words, suffix = STAGES[self.stage]
        words = [*words, *(placed(a, inputs) for a in self.args), "--json"]
        return [*words, "--out", str(out / f"{self.name}{suffix}")] if suffix else words


def placed(argument: str, inputs: Path) -> str:
    """{log:NAME}, {rig:NAME} and {kept:FILE} to paths."""
    def path(match: re.Match[str]) -> str:
        kind, name = match.groups()
        return {"log": str(inputs / f"{name}.mcap"), "rig": str(inputs / "rigs" / f"{name}.toml"), "kept": str(DATA / name)}[kind]

    return re.sub(r"\{(log|rig|kept):([^}]+)\}", path, argument)


class Cases:
    """cases.toml, read."""

    def __init__(self, path: Path = HERE / "cases.toml"):
        self.path = path
        self.table = tomllib.loads(path.read_text())
        self.base = (HERE / "rig.toml").read_text()

    def of(self, stage: str) -> list[Case]:
        key = STAGES[stage][0]
        cases = [Case(stage, c["name"], tuple(c["args"])) for c in self.table[key]]
        names = [c.name for c in cases]
        if len(set(names)) < len(names):
            raise SampleError(f"{self.path}: two [[{key}]] have one name; give each its own")
        return cases

    def rigs(self) -> dict[str, str]:
        """Every rig's text: rig.toml with some lines replaced and physics appended."""
        return {name: self.rig(name) for name in self.table["rig"]}

    def rig(self, name: str) -> str:
        entry, text = self.table["rig"][name], self.base
        for old, new in entry.get("replace", []):
            if text.count(old) != 1:
                raise SampleError(f"{self.path}: [rig.{name}] replaces {old!r}, which is {text.count(old)} times in rig.toml, not once")
            text = text.replace(old, new)
        return text + "\n" + entry.get("physics", "")

    def plans(self) -> dict[str, str]:
        return self.table["plan"]

    def simulations(self, table: str = "runs") -> list[tuple[str, str, str, int, list[str]]]:
        """(log, rig, plan, seed, further arguments): one per plan of every [[runs]], seeds counting up from its own."""
        return [
            (r["log"] if len(r["plans"]) == 1 else f"{r['log']}-{plan}", r["rig"], plan, r["seed"] + k, r.get("args", []))
            for r in self.table.get(table, [])
            for k, plan in enumerate(r["plans"])
        ]
