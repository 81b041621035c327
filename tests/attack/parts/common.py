"""What all attacks share: runs of the binary, logs read by other software, the table."""
from __future__ import annotations

import collections
import itertools
import os
import random
import struct
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "support"))
import mcap_package  # noqa: E402, F401
from mcap.reader import NonSeekingReader  # noqa: E402

MAGIC = b"\x89MCAP0\r\n"
METADATA, CHUNK = 0x0C, 0x06
# Exit code of what did not end.
NEVER = -1000
# Most memory and time of any command. A recording that is started and left to itself lasts as long as it is told to.
MEMORY_MAX_MB, TIME_MAX_S = 500.0, 20.0
# Then a command is ended.
PATIENCE_S = 60


@dataclass
class Ran:
    code: int
    # All that it wrote; of that, standard output.
    text: str
    out: str = ""


@dataclass
class Bench:
    binary: Path
    folder: Path
    seed: int
    scale: float
    silences: list[str] = field(default_factory=list)
    # Sound inputs that were refused or called damaged.
    alarms: list[str] = field(default_factory=list)
    # Commands beyond MEMORY_MAX_MB or TIME_MAX_S.
    excesses: list[str] = field(default_factory=list)
    # Most memory [MB] and longest command [s] since the last row of the table.
    most_mb: float = 0.0
    longest_s: float = 0.0
    # What was started and its measured memory: words, file.
    started: list[tuple[str, Path]] = field(default_factory=list)
    numbers: itertools.count[int] = field(default_factory=itertools.count)

    def rng(self, part: str) -> random.Random:
        return random.Random(f"{self.seed} {part}")

    def times(self, n: int) -> int:
        return max(1, round(n * self.scale))

    def measured(self, line: list[str]) -> tuple[list[str], Path]:
        """The command line that measures its memory into a file."""
        cost = self.folder / f"cost{next(self.numbers)}"
        return [str(self.built("measured.c", shared=False)), str(cost), *line], cost

    def charge(self, words: str, cost: Path, took_s: float) -> None:
        """Holds the price of a command that has ended against the bounds."""
        # Without a file it was killed for its time.
        memory_mb = int(cost.read_text()) * 1024e-6 if cost.exists() else 0.0
        cost.unlink(missing_ok=True)
        self.most_mb, self.longest_s = max(self.most_mb, memory_mb), max(self.longest_s, took_s)
        if memory_mb > MEMORY_MAX_MB or took_s > TIME_MAX_S:
            self.excesses.append(f"{words}: {memory_mb:.0f} MB, {took_s:.1f} s")

    def run(self, *words: object, env: dict[str, str] | None = None, shell: str = "", patience_s: float = PATIENCE_S) -> Ran:
        """To the end; `shell` runs before it in the same process (ulimit). A crash is a negative code."""
        line = [str(self.binary), *map(str, words)]
        if shell:
            line = ["bash", "-c", f'{shell}; exec "$@"', "bash", *line]
        line, cost = self.measured(line)
        began_s = time.monotonic()
        try:
            done = subprocess.run(line, stdin=subprocess.DEVNULL, capture_output=True, env=self.env(env), timeout=patience_s)
            out, said = (part.decode(errors="replace") for part in (done.stdout, done.stderr))
            ran = Ran(done.returncode, out + said, out)
        except subprocess.TimeoutExpired:
            ran = Ran(NEVER, f"not ended after {patience_s:g} s")
        self.charge(self.named(words), cost, time.monotonic() - began_s)
        return ran

    def start(self, *words: object, env: dict[str, str] | None = None) -> subprocess.Popen[bytes]:
        line, cost = self.measured([str(self.binary), *map(str, words)])
        self.started.append((self.named(words), cost))
        return subprocess.Popen(line, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, env=self.env(env))

    @staticmethod
    def named(words: tuple[object, ...]) -> str:
        return " ".join(word.name if isinstance(word, Path) else str(word) for word in words)

    @staticmethod
    def env(more: dict[str, str] | None) -> dict[str, str]:
        return {k: v for k, v in os.environ.items() if k != "RUST_LOG"} | (more or {})

    def built(self, source: str, *, shared: bool = True) -> Path:
        """A shared library to preload, or a program."""
        made = self.folder / f"{source}{'.so' if shared else '.run'}"
        if not made.exists():
            here = Path(__file__).resolve().parent
            how = ["-shared", "-fPIC"] if shared else []
            subprocess.run(["cc", *how, "-O1", "-o", str(made), str(here / source), *(["-ldl"] if shared else [])], check=True)
        return made

    def row(self, name: str, said: collections.Counter[str], silent: list[str], alarms: list[str] | None = None) -> None:
        """A row of the table; `alarms` = sound inputs of these cases that were called damaged or wrong, where there are any."""
        for words, cost in self.started:
            self.charge(words, cost, 0.0)
        self.started.clear()
        cases = sum(said.values()) + len(silent) + len(alarms or [])
        words = ", ".join(f"{n} {how}" for how, n in said.most_common())
        false = "-" if alarms is None else len(alarms)
        price = f"{self.most_mb:.0f} MB" + (f", {self.longest_s:.1f} s" if self.longest_s else "")
        print(f"| {name} | {cases} | {words or '-'} | {len(silent)} | {false} | {price} |", flush=True)
        self.most_mb = self.longest_s = 0.0
        self.silences += [f"{name}: {what}" for what in silent]
        self.alarms += [f"{name}: {what}" for what in alarms or []]

    def recorded(self) -> Path:
        """A log with images, commands and events, of the simulated rig in real time."""
        log = self.folder / "sound.mcap"
        if not log.exists():
            plan = self.folder / "short.toml"
            plan.write_text('name = "short"\n[[step]]\nfor_s = 1.0\nwrench = { surge_n = 4.0 }\n')
            done = self.run("record", "--rig", "lshpi", "--plan", plan, "--out", log)
            if done.code != 0:
                raise SystemExit(f"a recording to attack: exit code {done.code}\n{done.text}")
        return log


@dataclass
class Content:
    """What a reader that checks every checksum takes from a log."""

    messages: list[tuple[str, int, int, bytes]]
    metadata: dict[str, dict[str, str]]


def content(log: Path) -> Content:
    """Every message and every map, in the order of the file. Any error of the reader's goes through."""
    with log.open("rb") as stream:
        reader = NonSeekingReader(stream, validate_crcs=True)
        messages = [(c.topic, m.log_time, m.sequence, m.data) for _, c, m in reader.iter_messages(log_time_order=False)]
    with log.open("rb") as stream:
        metadata = {m.name: dict(m.metadata) for m in NonSeekingReader(stream).iter_metadata()}
    return Content(messages, metadata)


def records(data: bytes) -> list[tuple[int, int, int]]:
    """Opcode, offset and whole length of the top-level records."""
    found, at = [], len(MAGIC)
    while at + 9 <= len(data) and data[at : at + len(MAGIC)] != MAGIC:
        length = struct.unpack_from("<Q", data, at + 1)[0]
        found.append((data[at], at, 9 + length))
        at += 9 + length
    return found


def account(log: Path) -> tuple[int, int]:
    """Frames that are in the file by its own summary, and by count."""
    frames, summary = 0, {}
    with log.open("rb") as stream:
        for _, channel, _ in NonSeekingReader(stream, validate_crcs=True).iter_messages(topics=["/camera/image"], log_time_order=False):
            frames += 1
    with log.open("rb") as stream:
        for m in NonSeekingReader(stream).iter_metadata():
            if m.name == "summary":
                summary = dict(m.metadata)
    lost = int(summary["frames.dropped.queue"]) + int(summary["frames.dropped.disk"])
    return int(summary["frames.received"]) - lost, frames
