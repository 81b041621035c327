"""The notebooks of the book run, from the first cell to the last."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

FOLDER = Path(os.environ.get("HYDROLINE_NOTEBOOKS", Path(__file__).parents[2] / "guide" / "notebooks"))
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.stem)
def test_a_notebook_runs(path: Path) -> None:
    nbformat = pytest.importorskip("nbformat")
    nbclient = pytest.importorskip("nbclient")
    for needed in ("ipykernel", "pandas", "pyarrow", "matplotlib", "scipy"):
        pytest.importorskip(needed)
    notebook = nbformat.read(path, as_version=4)
    assert all(not cell.get("outputs") for cell in notebook.cells), "kept without outputs"
    nbclient.NotebookClient(notebook, timeout=120, kernel_name="python3").execute()


def test_there_are_notebooks() -> None:
    assert len(NOTEBOOKS) >= 5
