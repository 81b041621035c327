"""Each bad input gives an exception that names the argument, the value and what is allowed."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any, Callable, Dict, List, Tuple

import hydroline
import pytest

Case = Tuple[str, Callable[[Dict[str, Any]], object], List[str]]

CASES: List[Case] = [
    ("no such log", lambda f: hydroline.read("/nowhere.mcap"), ["/nowhere.mcap", "name a log"]),
    ("no log", lambda f: hydroline.read(f["text"]), [".txt", "not an MCAP file", "89 4D 43"]),
    ("no such rig", lambda f: hydroline.Rig.load("nobody"), ["nobody", "lshpi"]),
    ("no such plan", lambda f: hydroline.Plan.load("nothing"), ["nothing", "surge-4n"]),
    ("no such log to identify", lambda f: hydroline.identify("/nowhere.mcap", rig="lshpi"), ["/nowhere.mcap"]),
    ("no log to identify", lambda f: hydroline.identify(rig="lshpi"), ["LOG", "required"]),
    ("what to fail on", lambda f: hydroline.identify(f["log"], rig="lshpi", fail_on="misfits"), ["fail_on", "misfits", "misfit"]),
    ("model", lambda f: hydroline.identify(f["log"], rig="lshpi", model="warp"), ["model", "warp", "surge"]),
    ("coefficient", lambda f: hydroline.identify(f["log"], rig="lshpi", fix="q_x"), ["fix", "q_x", "x_udot"]),
    ("time before the log", lambda f: hydroline.identify(f["log"], rig="lshpi", from_=-1), ["from", "-1", ">= 0"]),
    ("priors", lambda f: hydroline.identify(f["log"], rig="lshpi", flat_priors="yes"), ["flat_priors", "yes", "True or False"]),
    ("a flag that is no flag", lambda f: hydroline.identify(f["log"], rig="lshpi", from_rest=1), ["from_rest=1", "True or False"]),
    ("a log that is no path", lambda f: hydroline.identify([{}], rig="lshpi"), ["logs={}", "dict", "path"]),
    ("the same log twice", lambda f: hydroline.identify([f["log"]] * 2, rig="lshpi"), ["same recording", ".mcap"]),
    ("degree of freedom", lambda f: hydroline.diagnose(f["log"], rig="lshpi", given="up"), ["given", "up", "heave"]),
    ("held out and fitted", lambda f: hydroline.diagnose(f["log"], rig="lshpi", hold_out=f["log"]), ["hold_out ", ".mcap", "another log"]),
    ("rate 0", lambda f: hydroline.predict(rig="lshpi", plan="still", rate=0), ["rate", "0", "at most 10000"]),
    ("rate NaN", lambda f: hydroline.predict(rig="lshpi", plan="still", rate=float("nan")), ["rate", "nan", ">= 0"]),
    ("out is there", lambda f: hydroline.simulate(rig="lshpi", plan="still", motion_only=True, out=f["log"]), ["out", ".mcap", "exists"]),
    ("out in no folder", lambda f: hydroline.simulate(rig="lshpi", plan="still", motion_only=True, out="/no/where.mcap"), ["out", "/no/where.mcap"]),
    ("tail", lambda f: hydroline.simulate(rig="lshpi", plan="still", out="/tmp/x.mcap", tail="long"), ["tail", "long", "30s"]),
    ("noise below 0", lambda f: hydroline.simulate(rig="lshpi", plan="still", out="/tmp/x.mcap", position_noise_m=-1), ["position_noise_m", "-1", ">= 0"]),
    ("board", lambda f: hydroline.calibrate(f["text"], board="none", out="/tmp/x.toml"), ["none", "dots-50"]),
    ("map", lambda f: hydroline.import_table(f["text"], map="/no.toml", out="/tmp/x.mcap"), ["/no.toml"]),
    ("image of floats", lambda f: hydroline.extract(f["numpy"].zeros((9, 9))), ["image", "float64", "uint8"]),
    ("image of three dimensions", lambda f: hydroline.extract(f["numpy"].zeros((9, 9, 3), "uint8")), ["image", "(9, 9, 3)", "(height, width)"]),
    ("no image", lambda f: hydroline.extract(None), ["image", "NoneType", "path"]),
    ("no image file", lambda f: hydroline.extract(f["text"]), [".txt"]),
    ("orientation", lambda f: hydroline.extract(f["text"], orientation="up"), ["orientation", "up", "vertical"]),  # type: ignore[arg-type]
    ("progress", lambda f: hydroline.predict(rig="lshpi", plan="still", progress=3), ["progress=3", "stage, done, of"]),
]


@pytest.mark.parametrize("case", CASES, ids=[c[0] for c in CASES])
def test_a_bad_input_is_named(case: Case, folder: Path, logs: List[str]) -> None:
    numpy = pytest.importorskip("numpy")
    text = folder / "a.txt"
    text.write_text("t,x\n0,0\n")
    given = {"log": logs[0], "text": text, "numpy": numpy}
    with pytest.raises(hydroline.InputError) as caught:
        case[1](given)
    words = str(caught.value)
    for part in case[2]:
        assert part in words, words
    assert "panic" not in words and "bug" not in words
    assert "--" not in words, "a keyword, not the command line's flag"
    assert caught.value.exit_code == 2


def test_an_argument_error_carries_its_parts(logs: List[str]) -> None:
    with pytest.raises(hydroline.ArgumentError) as caught:
        hydroline.identify(logs[0], rig="lshpi", fail_on="misfits")  # type: ignore[arg-type]
    error = caught.value
    assert (error.argument, error.value, error.allowed) == ("fail_on", "misfits", ("misfit",))


def test_a_lossy_result_warns(folder: Path, logs: List[str]) -> None:
    cut = folder / "short.mcap"
    cut.write_bytes(Path(logs[0]).read_bytes()[:-2000])
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        health = hydroline.doctor(cut)
    assert health.lossy and any(issubclass(w.category, hydroline.LossyWarning) for w in seen)
