"""Docstrings, types and the generated file."""

from __future__ import annotations

import doctest
import os
import subprocess
import sys
from pathlib import Path
from typing import Dict, List

import hydroline
import hydroline._commands
import hydroline._extract
import pytest

HERE = Path(__file__).parent


@pytest.mark.parametrize("module", [hydroline, hydroline._commands, hydroline._extract])
def test_what_docstrings_show_is_so(module: object, names: Dict[str, object]) -> None:
    options = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
    found = doctest.testmod(module, extraglobs=names, optionflags=options)  # type: ignore[arg-type]
    assert found.failed == 0 and found.attempted > 0


def test_the_commands_are_as_the_command_line_defines_them() -> None:
    done = subprocess.run([sys.executable, str(HERE.parent / "generate"), "--check"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


EXAMPLES = str(HERE.parent / "examples")
MYPY = ["mypy", "--strict", f"--cache-dir={os.devnull}"]
CHECKS = [[*MYPY, EXAMPLES], [*MYPY, "-p", "hydroline"], ["pyright", EXAMPLES]]


@pytest.mark.parametrize("check", CHECKS, ids=["mypy-examples", "mypy-package", "pyright-examples"])
def test_type_checkers_accept_package_and_examples(check: List[str], tmp_path: Path) -> None:
    pytest.importorskip(check[0])
    # From a folder that holds no sources: what is checked is what is installed.
    done = subprocess.run([sys.executable, "-m", *check], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
