"""A recording, read by Python's `mcap` (not by the daemon's own reader), messages decoded with the schemas in the file."""
from __future__ import annotations

import bisect
from pathlib import Path
from typing import Any

from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory


def nanoseconds(t: Any) -> int:
    """A google.protobuf.Timestamp as UNIX ns."""
    return t.seconds * 1_000_000_000 + t.nanos


class Log:
    """All messages by topic, in file order; metadata records in file order."""

    def __init__(self, path: Path):
        self.path = path
        self.topics: dict[str, list[Any]] = {}
        self.schema_of: dict[str, str] = {}
        self.publish_ns: dict[str, list[int]] = {}
        self.log_time_steps_back = 0
        last = 0
        with open(path, "rb") as f:
            reader = make_reader(f, validate_crcs=True, decoder_factories=[DecoderFactory()])
            # File order: the order in which the daemon wrote, which is what must not go back in time.
            for schema, channel, message, decoded in reader.iter_decoded_messages(log_time_order=False):
                self.topics.setdefault(channel.topic, []).append(decoded)
                self.publish_ns.setdefault(channel.topic, []).append(message.publish_time)
                self.schema_of[channel.topic] = schema.name
                if message.log_time < last:
                    self.log_time_steps_back += 1
                last = message.log_time
            self.metadata = [(m.name, dict(m.metadata)) for m in reader.iter_metadata()]
        pairs = self.of("/clock")
        self._monotonic = [c.monotonic_ns for c in pairs]
        self._offset = [c.realtime_ns - c.monotonic_ns for c in pairs]

    def of(self, topic: str) -> list[Any]:
        return self.topics.get(topic, [])

    @property
    def frames(self) -> list[Any]:
        return self.of("/camera/frame")

    @property
    def images(self) -> list[Any]:
        return self.of("/camera/image")

    def events(self, kind: str) -> list[Any]:
        return [e for e in self.of("/daemon/event") if e.kind == kind]

    def kinds(self) -> dict[str, int]:
        out: dict[str, int] = {}
        for e in self.of("/daemon/event"):
            out[e.kind] = out.get(e.kind, 0) + 1
        return out

    def meta(self, name: str) -> dict[str, str]:
        """The last metadata record of that name; empty when there is none."""
        found = [m for n, m in self.metadata if n == name]
        return found[-1] if found else {}

    def realtime_minus_monotonic_ns(self, monotonic_ns: int) -> int:
        """From the nearest ClockPair."""
        i = bisect.bisect(self._monotonic, monotonic_ns)
        nearest = min((j for j in (i - 1, i) if 0 <= j < len(self._monotonic)), key=lambda j: abs(self._monotonic[j] - monotonic_ns))
        return self._offset[nearest]

    def event_monotonic_s(self, event: Any) -> float:
        """When an event was true, on the guest's CLOCK_MONOTONIC [s]."""
        t = nanoseconds(event.timestamp)
        nearest = min(range(len(self._monotonic)), key=lambda j: abs(self._monotonic[j] + self._offset[j] - t))
        return (t - self._offset[nearest]) / 1e9


class Account:
    """The summary's bookkeeping: received + lost = expected, per cause."""

    def __init__(self, summary: dict[str, str]):
        number = {k: int(v) for k, v in summary.items() if v.isdigit()}
        self.summary = summary
        self.received = number.get("frames.received", -1)
        self.expected = number.get("frames.expected", -1)
        self.lost_by_cause = {k.removeprefix("frames.lost."): v for k, v in number.items() if k.startswith("frames.lost.") and v}
        self.lost = sum(self.lost_by_cause.values())
        # What fell due after the last frame: no frame can be marked with it.
        self.lost_at_end = number.get("frames.lost_at_end", -1)
        # Kept and marked, but with no place in time: neither received nor lost. (Void buffers hold nothing to keep.)
        self.outside_time = sum(number.get(f"frames.{k}", 0) for k in ("leftover", "repeated"))
        self.dropped = sum(v for k, v in number.items() if k.startswith("frames.dropped."))
