"""The committed results: a case a line, so that a change shows which case it is."""
from __future__ import annotations

import json
from pathlib import Path

from .cases import STAGES

# Of the checkout: what is committed names its files from here.
ROOT = Path(__file__).resolve().parents[3]
# A file of the repository is to stay small [bytes].
LARGEST = 1_000_000


def write(result: dict, commit: str, path: Path) -> int:
    """Writes what is compared (not the times) and returns its size [bytes]. Numbers keep every digit."""
    def lines(table: dict) -> str:
        return ",\n".join(f"{json.dumps(name)}: {json.dumps(value, separators=(',', ':'))}" for name, value in table.items())

    binary = {"version": f"{result['binary']['version']}, {commit}", "sha256": result["binary"]["sha256"]}
    parts = [f'"binary": {json.dumps(binary)}']
    parts += [f'"{key}": {{\n{lines(result[key])}\n}}' for key in ("inputs", *STAGES)]
    text = ("{\n" + ",\n".join(parts) + "\n}\n").replace(f"{ROOT}/", "")
    path.write_text(text)
    return len(text)
