"""Bits flipped anywhere in a whole log: said, or without consequence for what is read."""
from __future__ import annotations

import collections

from .common import Bench, content


def run(bench: Bench) -> None:
    rng = bench.rng("flips")
    whole = bench.recorded()
    data = whole.read_bytes()
    if bench.run("doctor", whole).code != 0:
        raise SystemExit("the doctor finds fault with the log as it was recorded: nothing can be told by it")
    before = content(whole)
    log = bench.folder / "flipped.mcap"
    said: collections.Counter[str] = collections.Counter()
    silent = []
    for _ in range(bench.times(2000)):
        at, bit = rng.randrange(len(data)), rng.randrange(8)
        changed = bytearray(data)
        changed[at] ^= 1 << bit
        log.write_bytes(changed)
        doctor = bench.run("doctor", log)
        if doctor.code in (2, 3):
            said[f"by doctor (exit code {doctor.code})"] += 1
            continue
        try:
            same = doctor.code == 0 and content(log) == before
        except Exception as error:  # the other reader's own check
            silent.append(f"byte {at} bit {bit}: doctor {doctor.code}, but {error}")
            continue
        if same:
            said["nothing read differs"] += 1
        else:
            silent.append(f"byte {at} bit {bit}: doctor {doctor.code}")
    bench.row("bits of a whole log", said, silent)
