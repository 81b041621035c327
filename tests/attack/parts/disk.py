"""Disks that fill up, fail, stall, or lose the file under its name."""
from __future__ import annotations

import collections
import os
import subprocess
import time
from pathlib import Path
from typing import Callable

from .common import NEVER, Bench, account

RECORD = ["record", "--rig", "lshpi", "--for", "3s", "--no-thrusters", "--out"]
PRELOADED = {
    "a write that fails (EIO)": "eio",
    "a disk that is full (ENOSPC)": "enospc",
    "a quota that is used up (EDQUOT)": "edquot",
    "remounted read-only (EROFS)": "erofs",
    "one write fails, the next does not": "eio-once",
    "full once, then room again": "enospc-once",
    "a write that takes nothing": "zero",
    "writes of half": "half",
    "writes of a few bytes": "one",
    "interrupted writes": "eintr",
    "a stall of 2 s": "stall",
    "a sync that fails": "sync-eio",
    "syncs of 1 s": "sync-stall",
}


def deleted(folder: Path, log: Path) -> None:
    log.unlink()


def renamed(folder: Path, log: Path) -> None:
    log.rename(folder / "elsewhere.mcap")


def replaced(folder: Path, log: Path) -> None:
    other = folder / "other"
    other.write_text("another file")
    other.rename(log)


def moved(folder: Path, log: Path) -> None:
    folder.rename(folder.with_name(folder.name + "-moved"))


def hidden(folder: Path, log: Path) -> None:
    subprocess.run(["mount", "-t", "tmpfs", "none", str(folder)], check=True)


def filled(folder: Path, log: Path) -> None:
    with (folder / "filler").open("wb") as stream:
        try:
            while True:
                stream.write(bytes(1 << 16))
                stream.flush()
        except OSError:
            pass


# Under which another name holds the recording, and which are refused before it begins.
SAVED = {"deleted", "renamed", "replaced"}
REFUSED = {"/dev/full", "a disk of 2 MB", "a limit of 60 kB on a file"}


def whole(log: Path) -> bool:
    try:
        told, there = account(log)
    except Exception:
        return False
    return told == there and told > 0


def judged(log: Path, code: int, text: str) -> str | None:
    """None for silence; else what said it."""
    if code < 0 or code > 3:
        return None
    if code != 0:
        return f"exit code {code}" if text.strip() else None
    # Done, by its own word: then it is there, whole, with every frame that it says.
    return "whole all the same" if whole(log) else None


def run(bench: Bench) -> None:
    said: collections.Counter[str] = collections.Counter()
    silent: list[str] = []

    def case(name: str, one: Callable[[Path, Path], tuple[int, str]]) -> None:
        folder = bench.folder / f"disk{sum(said.values()) + len(silent)}"
        folder.mkdir()
        log = folder / "run.mcap"
        code, text = one(folder, log)
        how = judged(log, code, text)
        # Refused from the start: only what cannot be recorded to at all.
        if code == 2 and name not in REFUSED or name == "nothing wrong" and code != 0:
            how = None
        # What was saved under another name is whole.
        elsewhere = list(folder.glob("*.mcap")) if name in SAVED else []
        if name in SAVED and not any(whole(other) for other in elsewhere):
            how = None
        if how is None:
            silent.append(f"{name}: exit code {code}: {text.strip()[-200:]}")
        else:
            said[how] += 1

    def shimmed(kind: str) -> Callable[[Path, Path], tuple[int, str]]:
        def one(folder: Path, log: Path) -> tuple[int, str]:
            mark = folder / "came"
            env = {"LD_PRELOAD": str(bench.built("disk.c")), "DISK_FAULT": kind, "DISK_AFTER": "400000", "DISK_MARK": str(mark)}
            done = bench.run(*RECORD, log, env=env)
            if bool(kind) != mark.exists():
                return NEVER, "the fault did not come"
            return done.code, done.text

        return one

    def limited(blocks: int) -> Callable[[Path, Path], tuple[int, str]]:
        def one(folder: Path, log: Path) -> tuple[int, str]:
            done = bench.run(*RECORD, log, shell=f"ulimit -f {blocks}")
            return done.code, done.text

        return one

    def meanwhile(act: Callable[[Path, Path], None], small: bool = False) -> Callable[[Path, Path], tuple[int, str]]:
        def one(folder: Path, log: Path) -> tuple[int, str]:
            if small:
                subprocess.run(["mount", "-t", "tmpfs", "-o", "size=700m", "none", str(folder)], check=True)
            child = bench.start(*RECORD, log)
            time.sleep(1.5)
            act(folder, log)
            text = child.communicate(timeout=60)[0].decode(errors="replace")
            return child.returncode, text

        return one

    def tiny(folder: Path, log: Path) -> tuple[int, str]:
        subprocess.run(["mount", "-t", "tmpfs", "-o", "size=2m", "none", str(folder)], check=True)
        done = bench.run(*RECORD, log)
        return done.code, done.text

    def device(folder: Path, log: Path) -> tuple[int, str]:
        done = bench.run(*RECORD, "/dev/full")
        return done.code, done.text

    case("nothing wrong", shimmed(""))
    for name, kind in PRELOADED.items():
        case(name, shimmed(kind))
    for blocks in (60, 400, 3000):
        case(f"a limit of {blocks} kB on a file", limited(blocks))
    case("/dev/full", device)
    for name, act in {"deleted": deleted, "renamed": renamed, "replaced": replaced, "its folder moved": moved}.items():
        case(name, meanwhile(act))
    if os.geteuid() == 0:
        try:
            case("mounted over", meanwhile(hidden))
            case("a disk of 2 MB", tiny)
            case("filled by another program", meanwhile(filled, small=True))
        finally:
            for mount in Path("/proc/mounts").read_text().splitlines():
                where = mount.split(" ")[1]
                if where.startswith(str(bench.folder)):
                    subprocess.run(["umount", "-l", where], check=False)
    bench.row("faults of the disk", said, silent)
