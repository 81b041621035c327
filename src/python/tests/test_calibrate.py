"""A board that is seen well: the map, its fields, and the command line's words of it."""

from __future__ import annotations

from pathlib import Path
from typing import List

import hydroline
import memory
import pytest
from conftest import command


@pytest.fixture(scope="module")
def boards(folder: Path) -> List[str]:
    """The same board seen twice."""
    plan = folder / "board.toml"
    plan.write_text(memory.BOARD_PLAN)
    made = []
    for seed in (1, 2):
        out = folder / f"board-{seed}.mcap"
        made.append(hydroline.simulate(rig="lshpi", plan=plan, show_board="dots-50", seed=seed, out=out).log)
    return made


def test_a_good_board_is_accepted(folder: Path, boards: List[str]) -> None:
    out = folder / "board-1.toml"
    found = hydroline.calibrate(boards[0], board="dots-50", out=out)
    assert found.accepted and found.missing == [] and found.file == str(out)
    assert found.nodes > 50 and 0.0 < max(found.rms_m) < found.tolerance_m
    assert found.worst_sd_m is not None and found.worst_sd_m <= found.tolerance_m
    assert "withdrawn" not in found.claim and found.against == []
    calibration = hydroline.Calibration.load(out)
    assert (calibration.method, calibration.board, calibration.medium) == ("homography", "dots-50", "air")
    words = ["calibrate", boards[0], "--board", "dots-50", "--out", out, "--force", "--json"]
    assert found.json == command(*words)


def test_the_same_board_a_week_later(folder: Path, boards: List[str]) -> None:
    old = folder / "old.toml"
    hydroline.calibrate(boards[0], board="dots-50", out=old)
    again = hydroline.calibrate(boards[1], board="dots-50", out=folder / "new.toml", against=old)
    (compared,) = again.against
    assert compared["with"] == str(old) and not compared["as_is"]["drifted"]


def test_images_without_a_board_are_refused(folder: Path, logs: List[str]) -> None:
    with pytest.raises(hydroline.RunError, match="board"):
        hydroline.calibrate(logs[4], board="dots-50", every=5, out=folder / "no.toml")
    assert not (folder / "no.toml").exists()
