"""Files of other programs, cut, flipped, renamed, wrapped: read as they are, or named; never printed."""
from __future__ import annotations

import collections
import gzip
import io
import math
import random
import struct
import tarfile
import zipfile
from dataclasses import dataclass
from pathlib import Path

from .common import Bench, Ran, content

ROWS = 300
# A refusal is read by a person.
WORDS_MAX = 6000
MAP = '[time]\ncolumn = "{time}"\nunit = "{unit}"\n[motion.x_m]\ncolumn = "{column}"\nunit = "m"\n'


@dataclass
class Kind:
    """A format: a sound file, where its records begin (what a flip there breaks shows), and the map if it is read."""

    name: str
    suffix: str
    data: bytes
    # A word of what names it.
    word: str
    records: list[int]
    map: str = ""


def x_of(k: int) -> float:
    return 0.3 * math.sin(0.05 * k)


def joined(parts: list[bytes]) -> tuple[bytes, list[int]]:
    starts, at = [], 0
    for part in parts:
        starts.append(at)
        at += len(part)
    return b"".join(parts), starts


def dataflash() -> Kind:
    def form(kind: int, size: int, name: str, letters: str, labels: str) -> bytes:
        return b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", kind, size, name.encode(), letters.encode(), labels.encode())

    parts = [form(128, 89, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns"), form(20, 15, "POS", "Qf", "TimeUS,X")]
    parts += [b"\xa3\x95\x14" + struct.pack("<Qf", 61_000_000 + 40_000 * k, x_of(k)) for k in range(ROWS)]
    return Kind("DataFlash", ".bin", *one(parts, "DataFlash"), MAP.format(time="stamp", unit="ns", column="POS.X"))


def one(parts: list[bytes], word: str) -> tuple[bytes, str, list[int]]:
    data, starts = joined(parts)
    return data, word, starts


def crc(data: bytes) -> int:
    value = 0xFFFF
    for b in data:
        t = b ^ (value & 0xFF)
        t = (t ^ (t << 4)) & 0xFF
        value = ((value >> 8) ^ (t << 8) ^ (t << 3) ^ (t >> 4)) & 0xFFFF
    return value


def telemetry() -> Kind:
    parts = []
    for k in range(ROWS):
        ms = 30_000 + 40 * k
        payload = struct.pack("<Iffffff", ms, x_of(k), 0, 0, 0, 0, 0).rstrip(b"\0")
        head = bytes([len(payload), 0, 0, k & 255, 1, 1]) + struct.pack("<I", 32)[:3]
        packet = b"\xfd" + head + payload + struct.pack("<H", crc(head + payload + bytes([185])))
        # Of a computer without a clock.
        parts.append(struct.pack(">Q", 45_000_000 + 40_000 * k) + packet)
    return Kind("telemetry", ".tlog", *one(parts, "MAVLink"), MAP.format(time="stamp", unit="ns", column="LOCAL_POSITION_NED.x"))


def ulog() -> Kind:
    def record(kind: str, body: bytes) -> bytes:
        return struct.pack("<HB", len(body), ord(kind)) + body

    parts = [b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 1000), record("B", bytes(40))]
    parts += [record("F", b"vehicle_local_position:uint64_t timestamp;float x;"), record("A", struct.pack("<BH", 0, 0) + b"vehicle_local_position")]
    parts += [record("D", struct.pack("<HQf", 0, 61_000_000 + 40_000 * k, x_of(k))) for k in range(ROWS)]
    return Kind("ULog", ".ulg", *one(parts, "ULog"), MAP.format(time="stamp", unit="ns", column="vehicle_local_position.x"))


def table() -> Kind:
    lines = ["t,x\n"] + [f"{0.04 * k:.3f},{x_of(k):.6f}\n" for k in range(ROWS)]
    return Kind("table", ".csv", *one([line.encode() for line in lines], ""), MAP.format(time="t", unit="s", column="x"))


def zipped(names: list[str], rng: random.Random) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in names:
            archive.writestr(name, rng.randbytes(3000))
    return out.getvalue()


def others(rng: random.Random) -> list[Kind]:
    noise = rng.randbytes
    c3d = bytearray(1024)
    c3d[0:2], c3d[515] = b"\x02\x50", 84
    lines = "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\n" + "".join(f"ATT, {k}, 0.1, 0.2\n" for k in range(200))
    rows = ",\n".join(f'{{"t": {0.04 * k:.3f}, "x": {x_of(k):.6f}}}' for k in range(ROWS))
    named = [
        ("text", ".log", lines.encode(), "DataFlash log as text"),
        ("encrypted", ".ulge", b"ULogEnc\x01" + noise(4000), "encrypted"),
        ("MATLAB", ".mat", b"MATLAB 5.0 MAT-file, Platform: GLNXA64".ljust(124) + b"\0\1IM" + noise(4000), "MATLAB"),
        ("MATLAB 7.3", ".mat", b"MATLAB 7.3 MAT-file".ljust(512, b"\0") + b"\x89HDF\r\n\x1a\n" + noise(4000), "MATLAB"),
        ("HDF5", ".h5", b"\x89HDF\r\n\x1a\n" + noise(4000), "HDF5"),
        ("spreadsheet", ".xlsx", zipped(["[Content_Types].xml", "xl/workbook.xml"], rng), "spreadsheet"),
        ("archive", ".zip", zipped(["run.bin"], rng), ".zip"),
        ("arrays", ".npz", zipped(["t.npy", "x.npy"], rng), "NumPy"),
        ("Parquet", ".parquet", b"PAR1" + noise(4000) + b"PAR1", "Parquet"),
        ("TDMS", ".tdms", b"TDSm" + noise(4000), "TDMS"),
        ("MDF", ".mf4", b"MDF     4.10    " + noise(4000), "MDF"),
        ("C3D", ".c3d", bytes(c3d) + noise(4000), ".c3d"),
        ("JSON", ".json", f"[{rows}]".encode(), "JSON"),
        ("HTML", ".html", b"<!DOCTYPE html><html><body><p>404 not found</p></body></html>\n" * 40, "HTML"),
        ("pointer", ".ulg", b"version https://git-lfs.github.com/spec/v1\noid sha256:" + b"4d" * 32 + b"\nsize 12345\n", "Git LFS"),
        ("ROS 1", ".bag", b"#ROSBAG V2.0\n" + noise(4000), "ROS 1"),
    ]
    return [Kind(name, suffix, data, word, list(range(min(len(data), 8)))) for name, suffix, data, word in named]


def tar_of(name: str, data: bytes) -> bytes:
    out = io.BytesIO()
    with tarfile.open(fileobj=out, mode="w") as archive:
        info = tarfile.TarInfo(name)
        info.size = len(data)
        archive.addfile(info, io.BytesIO(data))
    return out.getvalue()


@dataclass
class Attacked:
    what: str
    name: str
    data: bytes
    # Whether it must come out as the sound one does, or, of what is not read, by its word.
    same: bool
    word: str
    # Whether nothing in the file shows that something is missing.
    hidden: bool = False


def attacked(kind: Kind, kinds: list[Kind], how: str, rng: random.Random) -> Attacked:
    data, name = kind.data, "file" + kind.suffix
    if how == "cut":
        at = rng.randrange(1, len(data))
        # A table may end in any row, a cell that is cut may be one.
        hidden = at in kind.records or kind.name == "table"
        return Attacked(f"{kind.name} cut at {at}", name, data[:at], False, "", hidden)
    if how == "flipped":
        at, bit = rng.choice(kind.records), rng.randrange(8)
        flipped = bytearray(data)
        flipped[at] ^= 1 << bit
        # A cell that is another number is a table too; an old format's first byte may be one that nothing depends on.
        return Attacked(f"{kind.name} byte {at} bit {bit}", name, bytes(flipped), False, "", kind.name == "table")
    if how == "renamed":
        suffix = rng.choice(kinds).suffix
        return Attacked(f"{kind.name} named {suffix}", "file" + suffix, data, True, kind.word)
    wrap = rng.choice(["gzip", "gzip cut", "zip", "tar", "behind"])
    if wrap == "gzip":
        return Attacked(f"{kind.name} in gzip", name + ".gz", gzip.compress(data), True, kind.word)
    if wrap == "gzip cut":
        packed = gzip.compress(data)
        return Attacked(f"{kind.name} in gzip, cut", name + ".gz", packed[: rng.randrange(20, len(packed) - 8)], False, "unpack")
    if wrap == "zip":
        out = io.BytesIO()
        with zipfile.ZipFile(out, "w") as archive:
            archive.writestr("inner", data)
        return Attacked(f"{kind.name} in zip", name, out.getvalue(), False, "")
    if wrap == "tar":
        return Attacked(f"{kind.name} in tar", name, tar_of(name, data), False, ".tar")
    return Attacked(f"{kind.name} behind noise", name, rng.randbytes(rng.randrange(1, 3000)) + data, False, "")


def words_wrong(ran: Ran) -> list[str]:
    """What is wrong with how a command ended and with its words."""
    faults = []
    if ran.code not in (0, 1, 2, 3):
        faults.append(f"exit code {ran.code}")
    if any(c == "\ufffd" or (ord(c) < 32 and c not in "\n\t") for c in ran.text):
        faults.append("bytes printed")
    if ran.code != 0 and len(ran.text) > WORDS_MAX:
        faults.append(f"{len(ran.text)} letters of words")
    return faults


def motion(log: Path) -> list[tuple[int, bytes]]:
    return [(time_ns, data) for topic, time_ns, _, data in content(log).messages if topic == "/vehicle/motion"]


def run_one(bench: Bench, kind: Kind, own: Attacked, sound: list[tuple[int, bytes]]) -> tuple[str, str]:
    """How it was said, and what was wrong; one of them is empty."""
    path, out, map_ = bench.folder / own.name, bench.folder / "out.mcap", bench.folder / "map.toml"
    path.write_bytes(own.data)
    out.unlink(missing_ok=True)
    map_.write_text(kind.map or MAP.format(time="t", unit="s", column="x"))
    try:
        ran = {
            "info": bench.run("info", path),
            "guess": bench.run("import", "--guess", path),
            "import": bench.run("import", path, "--map", map_, "--out", out),
            "identify": bench.run("identify", path, "--rig", "lshpi"),
            "doctor": bench.run("doctor", path),
        }
        wrong = [f"{name}: {', '.join(faults)}" for name, r in ran.items() if (faults := words_wrong(r))]
        wrong += [f"{name}: exit code 0" for name in ("identify", "doctor") if ran[name].code == 0]
        done = ran["import"].code == 0
        if done and not kind.map:
            wrong.append("imported")
        same = done and bool(kind.map) and motion(out) == sound
        if own.same and kind.map and not same:
            wrong.append(f"import: exit code {ran['import'].code}, not as the sound file: {ran['import'].text[:300]}")
        if done and kind.map and not same and not own.hidden:
            wrong.append("import: other numbers, exit code 0")
        expected = own.word if not kind.map or not own.same else ""
        if expected and not all(expected in ran[c].text for c in ("info", "import", "guess")):
            wrong.append(f"'{expected}' not named: {ran['info'].text[:200]} | {ran['import'].text[:200]}")
        how = "read as the sound one" if same else f"said (exit code {ran['import'].code})"
        if done and not same:
            how = "nothing shows it"
        return how, "; ".join(wrong)
    finally:
        path.unlink()


def run(bench: Bench) -> None:
    rng = bench.rng("foreign")
    kinds = [dataflash(), telemetry(), ulog(), table(), *others(rng)]
    sound: dict[str, list[tuple[int, bytes]]] = {}
    said: collections.Counter[str] = collections.Counter()
    silent = []
    for kind in kinds:
        if kind.map:
            path, out, map_ = bench.folder / ("sound" + kind.suffix), bench.folder / "sound-out.mcap", bench.folder / "map.toml"
            path.write_bytes(kind.data)
            map_.write_text(kind.map)
            out.unlink(missing_ok=True)
            done = bench.run("import", path, "--map", map_, "--out", out)
            if done.code == 0:
                sound[kind.name] = motion(out)
            else:
                silent.append(f"a sound {kind.name} is not imported: {done.text[:300]}")
    # Twenty formats, five ways and more: twice each at full scale.
    ways = ["cut", "flipped", "renamed", "wrapped", "wrapped"]
    for k in range(bench.times(200)):
        kind, how = kinds[k % len(kinds)], ways[k // len(kinds) % len(ways)]
        own = attacked(kind, kinds, how, rng)
        words, wrong = run_one(bench, kind, own, sound.get(kind.name, []))
        if wrong:
            silent.append(f"{own.what}: {wrong}")
        else:
            said[words] += 1
    bench.row("files of other programs", said, silent)
