"""Logs as other software reads and writes them (the `mcap` package): digests by topic, and logs put together from two."""
from __future__ import annotations

import sys
import zlib
from pathlib import Path

from .cases import SampleError

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "support"))
import mcap_package  # noqa: E402, F401
from mcap.reader import make_reader  # noqa: E402
from mcap.writer import CompressionType, Writer  # noqa: E402


def digest(log: Path) -> dict[str, str]:
    """By topic: number of messages, and the CRC-32 over their log times and bytes.

    The session, which states version and commit, is no message: two builds may differ there.
    """
    sums: dict[str, int] = {}
    counts: dict[str, int] = {}
    with log.open("rb") as stream:
        for _, channel, message in make_reader(stream).iter_messages(log_time_order=False):
            crc = zlib.crc32(message.log_time.to_bytes(8, "little"), sums.get(channel.topic, 0))
            sums[channel.topic] = zlib.crc32(message.data, crc)
            counts[channel.topic] = counts.get(channel.topic, 0) + 1
    return {topic: f"{counts[topic]} {sums[topic]:08x}" for topic in sorted(sums)}


def joined(out: Path, parts: list[tuple[Path, set[str]]]) -> None:
    """A log of the topics named of each part, in the order of their times; metadata are the first one's."""
    found = []
    for log, topics in parts:
        with log.open("rb") as stream:
            found += [(m.log_time, c.topic, s, c, m) for s, c, m in make_reader(stream).iter_messages(log_time_order=False) if c.topic in topics]
        lacking = topics - {f[1] for f in found}
        if lacking:
            raise SampleError(f"{log} has no message of {', '.join(sorted(lacking))}")
    found.sort(key=lambda f: f[0])
    with out.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.ZSTD)
        writer.start(profile="", library="hydroline tests/sample")
        with parts[0][0].open("rb") as first:
            for metadata in make_reader(first).iter_metadata():
                writer.add_metadata(metadata.name, metadata.metadata)
        channels: dict[str, int] = {}
        for log_time, topic, schema, channel, message in found:
            if topic not in channels:
                schema_id = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[topic] = writer.register_channel(topic, channel.message_encoding, schema_id, channel.metadata)
            writer.add_message(channels[topic], log_time, message.data, message.publish_time, message.sequence)
        writer.finish()
