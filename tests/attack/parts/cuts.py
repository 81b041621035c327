"""Logs cut anywhere: what is recovered is a beginning of what was there, and holds every chunk that was whole."""
from __future__ import annotations

import collections

from .common import CHUNK, MAGIC, Bench, content, records


def run(bench: Bench) -> None:
    rng = bench.rng("cuts")
    whole = bench.recorded()
    data = whole.read_bytes()
    messages = content(whole).messages
    if bench.run("doctor", whole).code != 0:
        raise SystemExit("the doctor finds fault with the log as it was recorded: nothing can be told by it")
    chunks = [(at, size) for op, at, size in records(data) if op == CHUNK]
    # Messages in the first n chunks: read from a file of just these.
    least = {0: 0}
    probe = bench.folder / "chunks.mcap"
    for n, (at, size) in enumerate(chunks, 1):
        probe.write_bytes(data[: at + size] + bytes([0x0F]) + (4).to_bytes(8, "little") + bytes(4)
                          + bytes([0x02]) + (20).to_bytes(8, "little") + bytes(20) + MAGIC)
        least[n] = len(content(probe).messages)
    log, mended = bench.folder / "cut.mcap", bench.folder / "mended.mcap"
    said: collections.Counter[str] = collections.Counter()
    silent = []
    for _ in range(bench.times(200)):
        cut = rng.randrange(len(data))
        log.write_bytes(data[:cut])
        mended.unlink(missing_ok=True)
        doctor, recover = bench.run("doctor", log), bench.run("recover", log, "--out", mended)
        kept = least[sum(1 for at, size in chunks if at + size <= cut)]
        torn = any(at < cut < at + size for at, size in chunks)
        if doctor.code == 0 or doctor.code < 0 or recover.code < 0:
            silent.append(f"cut at {cut}: doctor {doctor.code}, recover {recover.code}")
        elif not mended.exists():
            if kept or recover.code not in (1, 2):
                silent.append(f"cut at {cut}: nothing recovered of {kept} messages, exit code {recover.code}")
            else:
                said["refused: nothing whole in it"] += 1
        else:
            got = content(mended).messages
            if recover.code not in (0, 3) or (torn and recover.code != 3):
                silent.append(f"cut at {cut}, inside a chunk: recover says {recover.code}")
            elif got[: len(messages)] != messages[: len(got)] or len(got) < kept:
                silent.append(f"cut at {cut}: {len(got)} messages recovered, at least {kept} were whole")
            else:
                said["by doctor; all whole chunks recovered"] += 1
    bench.row("cuts", said, silent)
