"""A command run to its end, with the time it took."""
from __future__ import annotations

import functools
import os
import subprocess
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from .cases import SampleError


@dataclass(frozen=True)
class Ran:
    stdout: str
    stderr: str
    code: int
    wall_s: float
    cpu_s: float  # user and system, of the process and its threads


def ran(binary: Path, words: list[str], threads: int | None = None) -> Ran:
    """Runs to the end; the processor's time is the kernel's own account of this child (wait4)."""
    env = {k: v for k, v in os.environ.items() if k != "RUST_LOG"}
    if threads:
        env["RAYON_NUM_THREADS"] = str(threads)
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err, tempfile.TemporaryDirectory() as data:
        # Calibrations that one run remembers are taken by no other, and none is left in the user's own folder.
        env["XDG_DATA_HOME"] = data
        begin = time.perf_counter()
        child = subprocess.Popen([str(binary), *words], stdin=subprocess.DEVNULL, stdout=out, stderr=err, env=env)
        _, status, usage = os.wait4(child.pid, 0)
        wall_s = time.perf_counter() - begin
        # Popen is told, or it would wait for a child that is gone.
        child.returncode = os.waitstatus_to_exitcode(status)
        text = []
        for stream in (out, err):
            stream.seek(0)
            text.append(stream.read().decode(errors="replace"))
    return Ran(text[0], text[1], child.returncode, wall_s, usage.ru_utime + usage.ru_stime)


def done(binary: Path, words: list[str], threads: int | None = None, allowed: tuple[int, ...] = (0,)) -> Ran:
    """As `ran`; any other exit code is an error that shows the command and what it said."""
    result = ran(binary, words, threads)
    if result.code not in allowed:
        said = result.stderr.strip()[-2000:]
        raise SampleError(f"exit code {result.code} of: {binary} {' '.join(words)}\n{said}")
    return result


@functools.cache
def knows(binary: Path, command: str, flag: str) -> bool:
    """Whether this build's command has the flag."""
    return flag in done(binary, [command, "--help"]).stdout


def version(binary: Path) -> str:
    return done(binary, ["--version"]).stdout.strip()
