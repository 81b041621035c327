"""Type checkers accept package and examples. `tests/python types` runs these; `tests/python` leaves them out."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import List

import pytest

HERE = Path(__file__).parent

EXAMPLES = str(HERE.parent / "examples")
MYPY = ["mypy", "--strict", f"--cache-dir={os.devnull}"]
CHECKS = [[*MYPY, EXAMPLES], [*MYPY, "-p", "hydroline"], ["pyright", EXAMPLES]]


@pytest.mark.parametrize("check", CHECKS, ids=["mypy-examples", "mypy-package", "pyright-examples"])
def test_type_checkers_accept_package_and_examples(check: List[str], tmp_path: Path) -> None:
    pytest.importorskip(check[0])
    # From a folder that holds no sources: what is checked is what is installed.
    done = subprocess.run([sys.executable, "-m", *check], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
