"""The stages, and what is read from their results: a tree of words and numbers, a number with its `sd` beside it where it has one."""
from __future__ import annotations

import csv
import json
import shutil
import tomllib
import zlib
from pathlib import Path

from .cases import STAGES, Case, Cases, SampleError
from .process import Ran, done, knows, ran

CHANNELS = ("x_m", "y_m", "z_m", "phi_rad", "theta_rad", "psi_rad")
# Columns of the probe's stripe at which a calibration is asked where on the sheet it puts them [px].
PROBE_EVERY_PX, PROBE_FIRST_PX = 80, 40
# A parameter of a map with an sd below this is idle: of the models that the fit averages, those that have it weigh nothing. It
# moves no node by a millionth of a pixel, and its sd is the weight and no doubt.
IDLE_SD = 1e-9


def execute(binary: Path, case: Case, inputs: Path, out: Path, threads: int | None = None) -> Ran:
    """The case's command, which is what is timed. 3 = done, with something to say of the data."""
    words = case.command(inputs, out)
    # A search that a clock ends is no result to compare. Older builds have no limit.
    if knows(binary, words[0], "--time-limit"):
        words += ["--time-limit", "none"]
    result = ran(binary, words, threads)
    if result.code not in (0, 3):
        said = result.stderr.strip()[-2000:]
        raise SampleError(f"{case.stage} {case.name}: exit code {result.code} of: {binary} {' '.join(words)}\n{said}")
    return result


def run(binary: Path, stage: str, cases: Cases, inputs: Path, out: Path, tell) -> tuple[dict, dict]:
    """(results, times) of a stage by case."""
    folder = out / stage
    folder.mkdir(parents=True)
    results, times = {}, {}
    for case in cases.of(stage):
        took = execute(binary, case, inputs, folder)
        results[case.name] = READ[stage](binary, case, took, inputs, folder)
        times[case.name] = {"wall_s": round(took.wall_s, 4), "cpu_s": round(took.cpu_s, 4)}
        tell(f"{stage} {case.name}: {took.cpu_s:.2f} s")
    return results, times


def parsed(took: Ran, *folders: Path) -> dict:
    """The JSON that a command prints, without the folders that its files happen to lie in."""
    text = took.stdout
    for folder in folders:
        text = text.replace(json.dumps(str(folder))[1:-1] + "/", "")
    return json.loads(text)


def tables(binary: Path, log: Path) -> Path:
    """The log's tables in a folder beside it."""
    folder = log.with_suffix(".tables")
    done(binary, ["export", str(log), "--tables-only", "--out", str(folder)])
    return folder


def exact(text: str) -> float:
    """A cell; an empty one and NaN are `None`, which JSON can say."""
    value = float(text) if text else float("nan")
    return value if value == value else None


def with_sd(names, values: list[float], covariance: list[list[float]]) -> dict:
    """Estimates by name, each with its sd from the covariance."""
    return {str(name): {"value": values[i], "sd": covariance[i][i] ** 0.5} for i, name in enumerate(names)}


def correlations(covariance: list[float]) -> list[float]:
    """Below the diagonal of a 6 x 6 covariance given row by row; 0 where something was not measured."""
    def one(i: int, k: int) -> float:
        size = (covariance[7 * i] * covariance[7 * k]) ** 0.5
        return covariance[6 * i + k] / size if size > 0 else 0.0

    return [one(i, k) for i in range(6) for k in range(i)]


def poses(binary: Path, case: Case, took: Ran, inputs: Path, folder: Path) -> dict:
    """Every pose with its sd and correlations, by stamp; what the replay says; the stripes' digest."""
    report = parsed(took, folder, inputs)["replays"][0]["report"]
    exported = tables(binary, folder / f"{case.name}.mcap")
    found = {}
    for row in csv.DictReader((exported / "motion.csv").open()):
        covariance = [float(v) for v in row["covariance"].split()]
        sd = [covariance[7 * i] ** 0.5 for i in range(6)]
        pose: dict = {name: {"value": exact(row[name]), "sd": sd[i]} for i, name in enumerate(CHANNELS)}
        pose["correlation"] = correlations(covariance)
        found[row["timestamp_ns"]] = pose
    stripes = f"{zlib.crc32((exported / 'profiles.csv').read_bytes()):08x}"
    shutil.rmtree(exported)
    return {"report": report, "poses": found, "stripes_crc32": stripes}


def parameters(file: Path) -> dict:
    """A fitted map's parameters with their sd, and the idle ones. A grid's are its nodes: the points say what becomes of them."""
    fitted = tomllib.loads(file.read_text())["map"]
    found = with_sd(range(len(fitted["parameters"])), fitted["parameters"], fitted["covariance"]) if "parameters" in fitted else {}
    return {
        "parameters": {name: p for name, p in found.items() if p["sd"] >= IDLE_SD},
        "idle": {name: p["value"] for name, p in found.items() if p["sd"] < IDLE_SD},
    }


def calibrations(binary: Path, case: Case, took: Ran, inputs: Path, folder: Path) -> dict:
    """What the command says, the map's parameters, and where on the sheet it puts the probe's stripe, all with the sd stated."""
    file = folder / f"{case.name}.toml"
    report = parsed(took, folder, inputs)
    probe = folder / f"{case.name}-probe.mcap"
    # A calibration of water is asked about frames in air: its answer is wanted, not its sense.
    words = ["replay", str(inputs / "probe.mcap"), "--calibration", str(file), "--force-calibration", "--out", str(probe)]
    done(binary, words, allowed=(0, 3))
    exported = tables(binary, probe)
    points: dict[str, dict] = {}
    for row in csv.DictReader((exported / "profiles.csv").open()):
        column = float(row["column_px"])
        # Outside of the board the map says nothing.
        if column % PROBE_EVERY_PX != PROBE_FIRST_PX or exact(row["xi_m"]) is None:
            continue
        place = f"frame {row['sequence']} column {column:.0f}"
        points[place] = {axis: {"value": exact(row[f"{axis}_m"]), "sd": exact(row[f"{axis}_sd_m"])} for axis in ("xi", "eta")}
    shutil.rmtree(exported)
    probe.unlink()
    return {"report": report, **parameters(file), "points": points, "file_crc32": f"{zlib.crc32(file.read_bytes()):08x}"}


def identifications(_binary: Path, _case: Case, took: Ran, inputs: Path, folder: Path) -> dict:
    """What the command prints; a bollard pull's numbers, which have their sds elsewhere, with them beside."""
    found = parsed(took, folder, inputs)
    if "curve" in found:
        found["parameters"] = with_sd(found["order"], found.pop("values"), found["covariance"])
        found["curve"] = {f"{pulse_us:.1f} us": {"value": thrust_n, "sd": sd_n} for pulse_us, thrust_n, sd_n in found["curve"]}
        del found["curve_covariance_n2"]
    return found


def verdicts(_binary: Path, _case: Case, took: Ran, inputs: Path, folder: Path) -> dict:
    """What the command prints is the result."""
    return parsed(took, folder, inputs)


READ = {"poses": poses, "calibrations": calibrations, "identifications": identifications, "verdicts": verdicts}
assert READ.keys() == STAGES.keys()
