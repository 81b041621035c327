"""Long calls: signals, threads, progress, memory."""

from __future__ import annotations

import os
import signal
import threading
import time
import warnings
from pathlib import Path
from typing import Callable, List, Optional, Tuple

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


def _interrupted_s(call: Callable[[], object], after_s: float) -> float:
    """What a call still computes after Ctrl-C, by one core: on a busy machine the clock on the wall says more."""
    pressed_s: List[float] = []

    def press() -> None:
        pressed_s.append(time.process_time())
        os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        threading.Timer(after_s, press).start()
        call()
    return (time.process_time() - pressed_s[0]) / (os.cpu_count() or 1)


@pytest.mark.parametrize("after_s", [0.3, 1.0, 3.0])
def test_ctrl_c_ends_a_diagnosis_within_a_second(long_logs: List[str], after_s: float) -> None:
    signal.signal(signal.SIGINT, signal.default_int_handler)
    assert _interrupted_s(lambda: hydroline.diagnose(long_logs, rig="lshpi", time_limit="none"), after_s) < 1.0


@pytest.fixture(scope="module")
def image_log(folder: Path) -> str:
    """A run that is images alone: what they show comes first, for minutes."""
    out = folder / "images.mcap"
    return hydroline.simulate(rig="lshpi", plan="surge-4n", seed=3, out=out).log


@pytest.mark.parametrize("after_s", [0.2, 1.5, 4.0])
def test_ctrl_c_ends_a_diagnosis_of_images_within_a_second(image_log: str, after_s: float) -> None:
    signal.signal(signal.SIGINT, signal.default_int_handler)
    assert _interrupted_s(lambda: hydroline.diagnose(image_log, rig="lshpi", time_limit="none"), after_s) < 1.0


@pytest.mark.parametrize("name", ["doctor", "read", "calibrate"])
def test_ctrl_c_ends_reading_within_a_second(image_log: str, folder: Path, name: str) -> None:
    signal.signal(signal.SIGINT, signal.default_int_handler)
    # Without its end a log is read from start to end to be opened.
    cut = folder / f"cut-for-{name}.mcap"
    cut.write_bytes(Path(image_log).read_bytes()[:-2000])

    def again() -> None:
        while True:
            if name == "doctor":
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")
                    hydroline.doctor(cut)
            elif name == "read":
                len(hydroline.read(cut).truth)
            else:
                with pytest.raises(hydroline.Error):
                    hydroline.calibrate(image_log, board="dots-50", out=folder / "none.toml")

    assert _interrupted_s(again, 0.15) < 1.0


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
        hydroline.diagnose(logs[0], rig="lshpi", progress=stop, time_limit="none")


def test_progress_by_a_function_and_by_a_bar(folder: Path, logs: List[str]) -> None:
    seen: List[Tuple[str, int, Optional[int]]] = []
    out = folder / "watched.mcap"
    hydroline.simulate(
        rig="lshpi", plan="surge-4n", out=out, progress=lambda stage, done, of: seen.append((stage, done, of))
    )
    assert seen and seen[-1][0] == "frames" and seen[-1][1] == seen[-1][2]
    tqdm = pytest.importorskip("tqdm")
    with tqdm.tqdm(disable=True) as bar:
        hydroline.diagnose(logs[0], rig="lshpi", progress=bar, time_limit="none")


def test_two_threads_diagnose_at_once_and_know_nothing_of_each_other(logs: List[str]) -> None:
    alone = [hydroline.diagnose(log, rig="lshpi", time_limit="none").json for log in logs[5:7]]
    found: List[str] = ["", ""]

    def work(k: int) -> None:
        found[k] = hydroline.diagnose(logs[5 + k], rig="lshpi", time_limit="none").json

    threads = [threading.Thread(target=work, args=(k,)) for k in range(2)]
    for thread in threads:
        thread.start()
    counted = 0
    while any(t.is_alive() for t in threads):
        # The interpreter goes on meanwhile.
        counted += 1
        time.sleep(0.001)
    assert found == alone and counted > 10


@pytest.mark.parametrize("name", ["frames", "extract", "Rig.load", "simulate", "predict", "doctor", "import_table", "calibrate",
                                  "identify", "diagnose", "read"])  # fmt: skip
def test_many_calls_leave_memory_as_it_is(name: str, folder: Path, logs: List[str]) -> None:
    pytest.importorskip("numpy")
    import memory

    own = folder / f"calls-{name}"
    own.mkdir()
    call = memory.calls(own, logs[3])[name]
    count = int(os.environ.get("HYDROLINE_CALLS", "2" if name in ("calibrate", "diagnose") else "30"))
    grown_kb = memory.growth_kb(call, count, rounds=2)[-1]
    # What the allocators keep is a few megabytes once, not some kilobytes a call.
    assert grown_kb < 4096 + count, f"{grown_kb} kB in {count} calls"


def test_refused_calls_leave_memory_as_it_is() -> None:
    import memory

    def refused() -> None:
        with pytest.raises(hydroline.InputError):
            hydroline.Rig.load("nobody")

    assert memory.growth_kb(refused, 200, rounds=2)[-1] < 4096


@pytest.mark.skipif("HYDROLINE_TIME_EXTRACT" not in os.environ, reason="with the wheel only (tests/python wheel)")
def test_extract_costs_what_it_does_in_rust() -> None:
    pytest.importorskip("mcap_protobuf")
    import figures

    # Both in turn, the least of several rounds: other work on the machine hits both.
    assert figures.extracting(os.environ["HYDROLINE_TIME_EXTRACT"]) <= 1.1
