"""Bits flipped in the maps of a log whose end is missing: rig, calibration, session stand outside of chunks."""
from __future__ import annotations

import collections
import re
from pathlib import Path

from .common import METADATA, Bench, records


def told(code: int, text: str, usual: str) -> bool:
    """Whether something new is said of metadata or of a damaged record, by an exit code that is not 0."""
    new = set(text.splitlines()) - set(usual.splitlines())
    return code in (1, 2, 3) and any(re.search(r"metadata `|record|opcode|checksum|MCAP", line) for line in new)


def run(bench: Bench) -> None:
    rng = bench.rng("metadata")
    data = bench.recorded().read_bytes()
    # Killed: no summary, no end.
    tail = max(at for op, at, _ in records(data) if op == 0x06)
    killed = data[:tail]
    maps = [(at, size) for op, at, size in records(killed) if op == METADATA]
    places = [n for at, size in maps for n in range(at, at + size)]
    log, mended, out = (bench.folder / n for n in ("killed.mcap", "mended.mcap", "replayed.mcap"))

    def answers() -> dict[str, tuple[int, str]]:
        said = {}
        for name, words in {
            "doctor": ["doctor", log],
            "recover": ["recover", log, "--out", mended],
            "replay": ["replay", log, "--out", out],
        }.items():
            for left in (mended, out):
                Path(left).unlink(missing_ok=True)
            done = bench.run(*words)
            said[name] = (done.code, done.text)
        return said

    log.write_bytes(killed)
    usual = answers()
    if answers() != usual:
        raise SystemExit("the answers to one and the same log differ: nothing can be told by them")
    said: collections.Counter[str] = collections.Counter()
    silent = []
    for _ in range(bench.times(300)):
        at, bit = rng.choice(places), rng.randrange(8)
        changed = bytearray(killed)
        changed[at] ^= 1 << bit
        log.write_bytes(changed)
        now = answers()
        quiet = [name for name, (code, text) in now.items() if not told(code, text, usual[name][1])]
        if quiet:
            silent.append(f"byte {at} bit {bit}: {', '.join(quiet)}")
        else:
            said["by doctor, recover and replay"] += 1
    bench.row("bits of metadata of a killed log", said, silent)
