"""Imports nothing but the `mcap` package: with another interpreter than the caller's where only that one has it."""
from __future__ import annotations

import os
import sys
from pathlib import Path

try:
    import mcap.reader  # noqa: F401
except ModuleNotFoundError as missing:
    python = os.environ.get("HYDROLINE_PYTHON")
    if python and Path(python).exists() and os.path.abspath(python) != os.path.abspath(sys.executable):
        # The interpreter that tests/setup has made.
        os.execv(python, [python, *sys.argv])
    raise SystemExit(
        f"{missing.name} is missing in {sys.executable}: run `tests/setup --tests`, then start this with "
        "HYDROLINE_PYTHON=target/python/bin/python"
    ) from None
