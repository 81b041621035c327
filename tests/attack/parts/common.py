"""What all attacks share: runs of the binary, logs read by other software, the table."""
from __future__ import annotations

import collections
import os
import random
import struct
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "support"))
import mcap_package  # noqa: E402, F401
from mcap.reader import NonSeekingReader  # noqa: E402

MAGIC = b"\x89MCAP0\r\n"
METADATA, CHUNK = 0x0C, 0x06
# Exit code of what did not end.
NEVER = -1000
# Longest that any single answer may take.
PATIENCE_S = 60


@dataclass
class Ran:
    code: int
    text: str


@dataclass
class Bench:
    binary: Path
    folder: Path
    seed: int
    scale: float
    silences: list[str] = field(default_factory=list)

    def rng(self, part: str) -> random.Random:
        return random.Random(f"{self.seed} {part}")

    def times(self, n: int) -> int:
        return max(1, round(n * self.scale))

    def run(self, *words: object, env: dict[str, str] | None = None, shell: str = "", patience_s: float = PATIENCE_S) -> Ran:
        """To the end; `shell` runs before it in the same process (ulimit). A crash is a negative code."""
        line = [str(self.binary), *map(str, words)]
        if shell:
            line = ["bash", "-c", f'{shell}; exec "$@"', "bash", *line]
        try:
            done = subprocess.run(line, stdin=subprocess.DEVNULL, capture_output=True, env=self.env(env), timeout=patience_s)
        except subprocess.TimeoutExpired:
            return Ran(NEVER, f"not ended after {patience_s:g} s")
        return Ran(done.returncode, (done.stdout + done.stderr).decode(errors="replace"))

    def start(self, *words: object, env: dict[str, str] | None = None) -> subprocess.Popen[bytes]:
        line = [str(self.binary), *map(str, words)]
        return subprocess.Popen(line, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, env=self.env(env))

    @staticmethod
    def env(more: dict[str, str] | None) -> dict[str, str]:
        return {k: v for k, v in os.environ.items() if k != "RUST_LOG"} | (more or {})

    def built(self, source: str) -> Path:
        """A shared library to preload."""
        shim = self.folder / f"{source}.so"
        if not shim.exists():
            here = Path(__file__).resolve().parent
            subprocess.run(["cc", "-shared", "-fPIC", "-O1", "-o", str(shim), str(here / source), "-ldl"], check=True)
        return shim

    def row(self, name: str, said: collections.Counter[str], silent: list[str]) -> None:
        cases = sum(said.values()) + len(silent)
        words = ", ".join(f"{n} {how}" for how, n in said.most_common())
        print(f"| {name} | {cases} | {words or '-'} | {len(silent)} |", flush=True)
        self.silences += [f"{name}: {what}" for what in silent]

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
