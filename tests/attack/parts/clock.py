"""The wall clock set while recording: the plan goes on by the other clock, and the log says that it was set."""
from __future__ import annotations

import collections

from .common import Bench, account, content

HOUR = 3600
STEPS_S = [(3 * HOUR, 0), (-3 * HOUR, 0), (1, 0), (-1, 0), (0.2, 0), (-0.2, 0), (30 * 24 * HOUR, 0),
           (-400 * 24 * HOUR, 0), (HOUR, -HOUR), (-HOUR, HOUR)]
PLAN_S = 4.0


def sets(messages: list[tuple[str, int, int, bytes]]) -> int:
    """Set-points of the thrusters in a log."""
    return sum(1 for m in messages if m[0] == "/thruster/command")


def run(bench: Bench) -> None:
    plan = bench.folder / "ahead.toml"
    plan.write_text(f'name = "ahead"\n[[step]]\nfor_s = {PLAN_S}\nwrench = {{ surge_n = 4.0 }}\n')
    said: collections.Counter[str] = collections.Counter()
    silent = []
    drive = bench.folder / "clock.mcap"
    bench.run("record", "--rig", "lshpi", "--plan", plan, "--out", drive)
    usual = sets(content(drive).messages)
    if usual < 20 * PLAN_S:
        raise SystemExit(f"only {usual} set-points with the clock left alone")
    for n, (step_s, back_s) in enumerate(STEPS_S):
        log = bench.folder / f"clock{n}.mcap"
        env = {"LD_PRELOAD": str(bench.built("clock.c")), "AFTER_S": "2", "STEP_S": str(step_s), "STEP2_S": str(back_s)}
        done = bench.run("record", "--rig", "lshpi", "--plan", plan, "--out", log, env=env)
        name = f"{step_s:+} s" + (f", then {back_s:+} s" if back_s else "")
        if done.code not in (0, 3):
            silent.append(f"{name}: exit code {done.code}: {done.text.strip()[-300:]}")
            continue
        told, there = account(log)
        read = content(log).messages
        events = [m[3] for m in read if m[0].endswith("/event") or m[0].endswith("/events")]
        stepped = sum(1 for data in events if b"clock.step" in data)
        # The whole plan was driven.
        if told != there or stepped < (2 if back_s else 1) or sets(read) < 0.95 * usual:
            silent.append(f"{name}: {told} frames told, {there} there, {stepped} steps said, {sets(read)} of {usual} set-points")
        else:
            said["clock.step in the log, plan driven to its end"] += 1
    bench.row("steps of the wall clock", said, silent)
