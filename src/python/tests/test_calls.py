"""Long calls: signals, threads, progress, memory."""

from __future__ import annotations

import os
import resource
import signal
import threading
import time
from pathlib import Path
from typing import List, Optional, Tuple

import hydroline
import pytest


@pytest.fixture(scope="module")
def long_logs(folder: Path) -> List[str]:
    """Two runs in six degrees of freedom: minutes to diagnose."""
    logs = []
    for seed in (1, 2):
        out = folder / f"six-{seed}.mcap"
        run = hydroline.simulate(rig="lshpi", plan="mixed-6dof", seed=seed, motion_only=True, out=out)
        logs.append(run.log)
    return logs


@pytest.mark.parametrize("after_s", [0.3, 1.0, 3.0])
def test_ctrl_c_ends_a_diagnosis_within_a_second(long_logs: List[str], after_s: float) -> None:
    signal.signal(signal.SIGINT, signal.default_int_handler)
    timer = threading.Timer(after_s, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    began = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        hydroline.diagnose(long_logs, rig="lshpi")
    assert time.monotonic() - began - after_s < 1.0


def test_ctrl_c_leaves_no_half_log(folder: Path) -> None:
    signal.signal(signal.SIGINT, signal.default_int_handler)
    out = folder / "interrupted" / "run.mcap"
    out.parent.mkdir()
    threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGINT)).start()
    with pytest.raises(KeyboardInterrupt):
        hydroline.simulate(rig="lshpi", plan="reversals", tail=600, out=out)
    assert list(out.parent.iterdir()) == []


def test_what_progress_raises_ends_the_call(logs: List[str]) -> None:
    def stop(stage: str, done: int, of: Optional[int]) -> None:
        raise LookupError(stage)

    with pytest.raises(LookupError):
        hydroline.diagnose(logs[0], rig="lshpi", progress=stop)


def test_progress_by_a_function_and_by_a_bar(folder: Path, logs: List[str]) -> None:
    seen: List[Tuple[str, int, Optional[int]]] = []
    out = folder / "watched.mcap"
    hydroline.simulate(
        rig="lshpi", plan="surge-4n", out=out, progress=lambda stage, done, of: seen.append((stage, done, of))
    )
    assert seen and seen[-1][0] == "frames" and seen[-1][1] == seen[-1][2]
    tqdm = pytest.importorskip("tqdm")
    with tqdm.tqdm(disable=True) as bar:
        hydroline.diagnose(logs[0], rig="lshpi", progress=bar)


def test_two_threads_diagnose_at_once_and_know_nothing_of_each_other(logs: List[str]) -> None:
    alone = [hydroline.diagnose(log, rig="lshpi").json for log in logs[5:7]]
    found: List[str] = ["", ""]

    def work(k: int) -> None:
        found[k] = hydroline.diagnose(logs[5 + k], rig="lshpi").json

    threads = [threading.Thread(target=work, args=(k,)) for k in range(2)]
    for thread in threads:
        thread.start()
    counted = 0
    while any(t.is_alive() for t in threads):
        # The interpreter goes on meanwhile.
        counted += 1
        time.sleep(0.001)
    assert found == alone and counted > 10


def _resident_kb() -> int:
    with open("/proc/self/statm", encoding="ascii") as file:
        return int(file.read().split()[1]) * resource.getpagesize() // 1024


def test_many_calls_leave_memory_as_it_is(folder: Path, logs: List[str]) -> None:
    numpy = pytest.importorskip("numpy")
    image = hydroline.read(logs[4]).frames[0].grey
    calls = {
        "read": lambda: hydroline.read(logs[0]).motion["x_m"],
        "extract": lambda: hydroline.extract(image).row_px,
        "predict": lambda: hydroline.predict(rig="lshpi", plan="still", rate=1),
        "doctor": lambda: hydroline.doctor(logs[9]),
        "refused": lambda: pytest.raises(hydroline.InputError, hydroline.Rig.load, "nobody"),
        "identify": lambda: hydroline.identify(logs[3], rig="lshpi"),
    }
    count = int(os.environ.get("HYDROLINE_CALLS", "30"))
    for name, call in calls.items():
        for _ in range(max(count // 5, 10)):
            call()
        before = _resident_kb()
        for _ in range(count):
            call()
        grown_kb = _resident_kb() - before
        # What the allocators keep is a few megabytes once, not some kilobytes a call.
        assert grown_kb < 4096 + count, f"{name}: {grown_kb} kB in {count} calls"
    assert numpy.isfinite(image).all()
