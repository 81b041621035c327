"""Rig files for the guest: the repository's bench rig with another camera or port put in."""
from __future__ import annotations

import shutil
import tomllib
from pathlib import Path

from vm import ADAPTER_SERIAL


def _value(v: object) -> str:
    if isinstance(v, bool):
        return "true" if v else "false"
    if isinstance(v, str):
        return '"' + v.replace("\\", "\\\\").replace('"', '\\"') + '"'
    if isinstance(v, list):
        return "[" + ", ".join(_value(x) for x in v) + "]"
    if isinstance(v, dict):
        return "{ " + ", ".join(f"{k} = {_value(x)}" for k, x in v.items()) + " }"
    return repr(v)


def dumps(table: dict, path: str = "") -> str:
    """TOML of a parsed document: plain keys first, then tables, then arrays of tables."""
    is_tables = lambda v: isinstance(v, list) and v != [] and all(isinstance(x, dict) for x in v)
    out = "".join(f"{k} = {_value(v)}\n" for k, v in table.items() if not isinstance(v, dict) and not is_tables(v))
    for k, v in table.items():
        if isinstance(v, dict):
            out += f"\n[{path}{k}]\n" + dumps(v, f"{path}{k}.")
        elif is_tables(v):
            for x in v:
                out += f"\n[[{path}{k}]]\n" + dumps(x, f"{path}{k}.")
    return out


VIVID_TV = {"device": "/dev/v4l/by-path/platform-vivid.0-video-index0", "width_px": 720, "height_px": 576, "rate_fps": 25.0,
            "exposure_s": 0.008, "control": [{"name": "timestamp_source", "value": 1}]}
UVC = {"device": "/dev/v4l/by-id/usb-Hydroline_HIL_camera_HIL0001-video-index0", "pixel_format": "MJPG",
       "width_px": 640, "height_px": 480, "rate_fps": 30.0, "exposure_s": 0.008, "control": []}
LOOPBACK = {"device": "/dev/video10", "allow_unstable_node": True, "pixel_format": "GREY",
            "width_px": 720, "height_px": 576, "rate_fps": 25.0, "exposure_s": 0.008, "control": []}
SERIAL = f"/dev/serial/by-id/usb-QEMU_QEMU_USB_SERIAL_{ADAPTER_SERIAL}-if00-port0"
# The guest's tmpfs holds a few hundred MB, and its emulated processor compresses ten times slower than a real one.
LOG = {"min_free_bytes": 16 << 20, "zstd_level": 0}


def write(repository: Path, folder: Path, cameras: dict[str, dict], lasers: dict[str, dict] | None = None, with_target: bool = False) -> None:
    """Copies rigs/ (the data, not the code) into `folder` and adds one NAME.toml per camera, from bench-v4l.toml,
    with the keys of `lasers` put into its [laser]. Without a target over a bare floor: none lies before the guest's cameras,
    and a plan would wait for a pose over it."""
    for p in (repository / "rigs").rglob("*.toml"):
        if p.name != "Cargo.toml":
            target = folder / p.relative_to(repository / "rigs")
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(p, target)
    bench = tomllib.loads((repository / "rigs/bench-v4l.toml").read_text())
    for name, camera in cameras.items():
        rig = {**bench, "camera": {**bench["camera"], **camera}}
        rig["thrusters"] = {**bench["thrusters"], "link": {**bench["thrusters"]["link"], "kind": "stamped", "port": SERIAL}}
        rig["laser"] = {**bench["laser"], **(lasers or {}).get(name, {})}
        rig["log"] = {**bench.get("log", {}), **LOG}
        if not with_target:
            del rig["target"]
        if "fx_px" in rig["camera"]:
            # Another image size than the bench camera's: keep the principal point in the middle.
            rig["camera"]["cx_px"] = (camera["width_px"] - 1) / 2
            rig["camera"]["cy_px"] = (camera["height_px"] - 1) / 2
        (folder / f"{name}.toml").write_text(dumps(rig))


def command_rate_hz(repository: Path) -> float:
    """How often the bench rig sends a command."""
    bench = tomllib.loads((repository / "rigs/bench-v4l.toml").read_text())
    return float(bench["thrusters"]["link"]["rate_hz"])


def channels(repository: Path) -> dict[str, int]:
    """Controller channel of each thruster of the bench rig."""
    return {t["name"]: t["channel"] for t in tomllib.loads((repository / "rigs/bench-v4l.toml").read_text())["thruster"]}


def write_plan(path: Path, seconds: float) -> None:
    """Small surge forces that change sign: the pulses move, the vehicle stays."""
    n = max(2, round(seconds))
    steps = "".join(f"\n[[step]]\nfor_s = {seconds / n:.3f}\nwrench = {{ surge_n = {(0.5, -0.5, 0.8, -0.8)[i % 4]} }}\n" for i in range(n))
    path.write_text('name = "hil"\n' + steps)
