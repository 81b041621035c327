"""The files that the sample is computed from: made once, by one binary, and read by every binary that is compared."""
from __future__ import annotations

import csv
import json
import shutil
import tempfile
from pathlib import Path

from . import logs
from .cases import Cases, SampleError, placed
from .process import done, version

# What a log's motion is, without pictures and stripes.
MOTION = {"/vehicle/motion"}
COMMANDS = {"/thruster/command"}


def ready(binary: Path, folder: Path, cases: Cases) -> dict:
    """The account of the inputs in `folder`, which are made where there are none."""
    account = folder / "inputs.json"
    if account.exists():
        return json.loads(account.read_text())
    if folder.exists() and any(folder.iterdir()):
        raise SampleError(f"{folder} holds something else: name another folder for the inputs, or remove it")
    folder.parent.mkdir(parents=True, exist_ok=True)
    # Whole or not at all: inputs that were broken off are begun anew.
    with tempfile.TemporaryDirectory(dir=folder.parent, prefix=f"{folder.name}-unfinished-") as scratch:
        whole = Path(scratch) / "inputs"
        whole.mkdir()
        found = {"made_by": version(binary), "digests": make(binary, whole, cases)}
        (whole / account.name).write_text(json.dumps(found, indent=1) + "\n")
        whole.replace(folder)
    return found


def make(binary: Path, folder: Path, cases: Cases) -> dict[str, dict[str, str]]:
    """Rigs, plans and logs; returns each log's digest."""
    for kind, texts in (("rigs", cases.rigs()), ("plans", cases.plans())):
        (folder / kind).mkdir()
        for name, text in texts.items():
            (folder / kind / f"{name}.toml").write_text(text)
    for log, rig, plan, seed, args in cases.simulations():
        simulate(binary, folder, log, rig, plan, seed, args)
    for entry in cases.table.get("joined", []):
        parts = [(folder / f"{entry['motion']}.mcap", MOTION), (folder / f"{entry['commands']}.mcap", COMMANDS)]
        logs.joined(folder / f"{entry['log']}.mcap", parts)
    for entry in cases.table.get("table", []):
        table(binary, folder, entry["log"], entry["of"], entry["map"])
    return {log.stem: logs.digest(log) for log in sorted(folder.glob("*.mcap"))}


def simulate(binary: Path, folder: Path, log: str, rig: str, plan: str, seed: int, args: list[str]) -> None:
    words = ["simulate", "--rig", str(folder / "rigs" / f"{rig}.toml"), "--plan", str(folder / "plans" / f"{plan}.toml")]
    done(binary, [*words, "--seed", str(seed), *args, "--out", str(folder / f"{log}.mcap")])


def table(binary: Path, folder: Path, log: str, of: str, map_text: str) -> None:
    """Another log's motion and commands through a table and `import`, under a map that may be wrong: that is what it is for."""
    work = folder / f"{log}-table"
    done(binary, ["export", str(folder / f"{of}.mcap"), "--tables-only", "--out", str(work)])
    commands = sorted(csv.DictReader((work / "commands.csv").open()), key=lambda row: int(row["timestamp_ns"]))
    thrusters = sorted({row["thruster"] for row in commands})
    channels = ["x_m", "y_m", "z_m", "phi_rad", "theta_rad", "psi_rad"]
    told = dict.fromkeys(thrusters, "0")
    nth = 0
    start_ns = None
    with (work / "run.csv").open("w", newline="") as out:
        rows = csv.writer(out, lineterminator="\n")
        rows.writerow(["t_s", *channels, *thrusters])
        for row in csv.DictReader((work / "motion.csv").open()):
            now_ns = int(row["timestamp_ns"])
            start_ns = now_ns if start_ns is None else start_ns
            while nth < len(commands) and int(commands[nth]["timestamp_ns"]) <= now_ns:
                told[commands[nth]["thruster"]] = commands[nth]["thrust_n"]
                nth += 1
            rows.writerow([(now_ns - start_ns) / 1e9, *(row[c] for c in channels), *told.values()])
    (work / "map.toml").write_text(map_text)
    # 3: the faults that it finds; the diagnosis is to find them again.
    words = ["import", str(work / "run.csv"), "--map", str(work / "map.toml"), "--accept-faults"]
    done(binary, [*words, "--out", str(folder / f"{log}.mcap")], allowed=(0, 3))
    shutil.rmtree(work)


def kept(binary: Path, folder: Path, cases: Cases) -> list[Path]:
    """Makes anew, in `folder`, the files of tests/data/sample that an estimator made: for the day that they are to be renewed."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in cases.plans().items():
        (folder / "plans").mkdir(exist_ok=True)
        (folder / "plans" / f"{name}.toml").write_text(text)
    for name, text in cases.rigs().items():
        (folder / "rigs").mkdir(exist_ok=True)
        (folder / "rigs" / f"{name}.toml").write_text(text)
    for log, rig, plan, seed, args in cases.simulations("kept_runs"):
        simulate(binary, folder, log, rig, plan, seed, args)
    made = []
    for entry in cases.table["kept"]:
        out = folder / "kept" / entry["file"]
        out.parent.mkdir(exist_ok=True)
        words = [placed(a, folder) for a in entry["args"]]
        if out.suffix == ".mcap":
            whole = folder / f"{out.stem}-whole.mcap"
            done(binary, [*words, "--out", str(whole)])
            logs.joined(out, [(whole, MOTION | COMMANDS)])
        else:
            done(binary, [*words, "--out", str(out)])
        made.append(out)
    return made

