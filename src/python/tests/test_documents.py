"""Docstrings and the generated file."""

from __future__ import annotations

import doctest
import subprocess
import sys
from pathlib import Path
from typing import Dict

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
