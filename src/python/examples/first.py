"""Simulate two runs, look at one, ask for the coefficients and for what was left out."""

from pathlib import Path
from tempfile import TemporaryDirectory

import hydroline

with TemporaryDirectory() as folder:
    runs = [
        hydroline.simulate(rig="lshpi", plan=plan, seed=seed, motion_only=True, out=Path(folder) / f"{plan}.mcap").log
        for seed, plan in enumerate(["reversals", "coast-down"])
    ]
    motion = hydroline.read(runs[0]).motion
    print(motion, "furthest:", motion["x_m"].max(), "m")
    found = hydroline.identify(runs, rig="lshpi")
    print(found.parameters["x_udot"], hydroline.diagnose(runs, rig="lshpi").sentence)
