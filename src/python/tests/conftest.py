"""Logs of the tests: ten simulated runs, made once."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path
from typing import Dict, List

import pytest

import hydroline

#: The program with whose JSON results are compared.
PROGRAM = os.environ.get("HYDROLINE_PROGRAM", "hydroline")

LAGGING = '\n[[physics]]\neffect = "thruster_lag"\nlag_s = 0.25\n'


def command(*words: object) -> str:
    """stdout of the command line."""
    done = subprocess.run([PROGRAM, *map(str, words)], capture_output=True, text=True)
    assert done.returncode in (0, 3), done.stderr
    return done.stdout


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("hydroline")


@pytest.fixture(scope="session")
def logs(folder: Path) -> List[str]:
    """Ten logs: five plans, with and without a lag of the thrusters, each with its own seed; one with images."""
    lagging = folder / "lagging.toml"
    lagging.write_text(hydroline.Rig.load("lshpi").to_toml() + LAGGING)
    made: List[str] = []
    for rig in ("lshpi", lagging):
        for plan in ("reversals", "coast-down", "two-tone", "surge-4n", "still"):
            images = plan == "still" and rig == "lshpi"
            out = folder / f"{len(made)}-{plan}.mcap"
            run = hydroline.simulate(rig=rig, plan=plan, seed=len(made), motion_only=not images, out=out)
            made.append(run.log)
    return made


@pytest.fixture(scope="session")
def names(folder: Path, logs: List[str]) -> Dict[str, object]:
    """What stands in doctests."""
    return {**vars(hydroline), "folder": folder, "reversals": logs[0], "coast_down": logs[1]}
