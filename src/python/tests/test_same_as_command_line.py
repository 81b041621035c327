"""The same JSON as the command line's, bit for bit."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import List

import hydroline
import pytest
from conftest import command


def test_ten_logs_one_by_one(logs: List[str]) -> None:
    assert len(logs) == 10
    for log in logs:
        assert hydroline.doctor(log).json == command("doctor", log, "--json")
    moving = [log for log in logs if "still" not in log]
    for log in moving:
        assert hydroline.identify(log, rig="lshpi").json == command("identify", log, "--rig", "lshpi", "--json")
        assert hydroline.diagnose(log, rig="lshpi", time_limit="none").json == command(
            "diagnose", log, "--rig", "lshpi", "--time-limit", "none", "--json"
        )


def test_several_logs_and_options(logs: List[str]) -> None:
    two = logs[5:7]
    found = hydroline.identify(two, rig="lshpi", from_rest=True, fix=["x_uu"], flat_priors=True, from_=1, to=20)
    words = ["identify", *two, "--rig", "lshpi", "--from-rest", "--fix", "x_uu", "--flat-priors", "--from", 1, "--to", 20]
    assert found.json == command(*words, "--json")
    found = hydroline.diagnose(two, rig=hydroline.Rig.load("lshpi"), hold_out=logs[7], time_limit="none")
    words = ["diagnose", *two, "--rig", "lshpi", "--hold-out", logs[7], "--time-limit", "none"]
    assert found.json == command(*words, "--json")
    assert found.verdict == "named" and found.effects[0]["effect"] == "thruster_lag"
    assert found.to_dict() == json.loads(found.json)
    assert "<iframe" in (found._repr_html_() or "")


def test_predict_and_simulate(folder: Path, logs: List[str]) -> None:
    plan = hydroline.Plan.load("reversals")
    assert hydroline.predict(rig="lshpi", plan=plan, rate=5).json == command(
        "predict", "--rig", "lshpi", "--plan", "reversals", "--rate", 5, "--json"
    )
    other = folder / "by-command-line.mcap"
    words = ["simulate", "--rig", "lshpi", "--plan", "reversals", "--seed", 0, "--motion-only", "--out", other]
    command(*words, "--json")
    ours, theirs = hydroline.read(logs[0]), hydroline.read(other)
    for name in ours.motion.column_names:
        assert ours.motion[name].tobytes() == theirs.motion[name].tobytes(), name


def test_import(folder: Path, logs: List[str]) -> None:
    table, plan = folder / "table.csv", folder / "map.toml"
    command("export", logs[0], "--merged", "--out", table)
    lines = table.read_text().splitlines()
    names = lines[0].split(",")
    keep = [names.index("t_s"), names.index("x_m")]
    rows = [[line.split(",")[k] for k in keep] for line in lines]
    table.write_text("\n".join(",".join(row) for row in rows))
    plan.write_text('[time]\ncolumn = "t_s"\nunit = "s"\n[motion.x_m]\ncolumn = "x_m"\nunit = "m"\n')
    found = hydroline.import_table(table, map=plan, out=folder / "imported.mcap")
    assert found.json == command("import", table, "--map", plan, "--out", folder / "again.mcap", "--json")
    assert found.samples == len(rows) - 1


def test_extract_of_an_array_is_that_of_the_file(folder: Path, logs: List[str]) -> None:
    numpy = pytest.importorskip("numpy")
    frame = hydroline.read(logs[4]).frames[0]
    command("export", logs[4], "--frames-only", "--out", folder / "frames")
    png = sorted((folder / "frames").rglob("*.png"))[0]
    by_command = json.loads(command("extract", png, "--json"))["images"][0]
    assert hydroline.extract(png).to_dict() == by_command
    of_array = hydroline.extract(frame.grey)
    assert {**of_array.to_dict(), "image": str(png)} == by_command
    # Any other memory is copied first, and gives the same.
    turned = numpy.asfortranarray(frame.grey)
    assert hydroline.extract(turned).to_dict() == of_array.to_dict()


def test_frames_are_asked_and_name_a_wrong_tone_curve(folder: Path) -> None:
    # The log of tests/recording/one_verdict.rs: a smaller camera, so that it takes seconds.
    values = {
        "width_px": "360",
        "height_px": "288",
        "rate_fps": "2.1",
        "fx_px": "443.1864293532365",
        "fy_px": "443.1864293532365",
        "cx_px": "179.5",
        "cy_px": "143.5",
        "frozen_after_s": "4.0",
        "ambient": "8.0",
    }
    text = hydroline.Rig.load("lshpi").to_toml()
    for key, value in values.items():
        text = re.sub(rf"(?m)^{key} = .*$", f"{key} = {value}", text, count=1)
    rig, tank, plan = (folder / f"curve-{name}.toml" for name in ("rig", "tank", "plan"))
    rig.write_text(text)
    tank.write_text(text + '\n[[physics]]\neffect = "tone_curve"\ngamma = 1.4\n')
    steps = [(1.0, 8.0), (1.4, -8.0)]
    plan.write_text("".join(f"[[step]]\nfor_s = {s}\nwrench = {{ surge_n = {n} }}\n" for s, n in steps))
    log = hydroline.simulate(rig=rig, tank=tank, plan=plan, out=folder / "curve.mcap").log
    found = hydroline.diagnose(log, rig=rig, time_limit="none")
    assert found.json == command("diagnose", log, "--rig", rig, "--time-limit", "none", "--json")
    assert "tone_curve" in [effect["effect"] for effect in found.effects], found.sentence
