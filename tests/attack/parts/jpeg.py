"""A baseline JPEG encoder (ITU-T T.81) of grey levels, so that what is damaged is known to have been sound."""
from __future__ import annotations

import math
import struct

# T.81, tables K.1, K.3 and K.5.
QUANTIZATION = [
    16, 11, 10, 16, 24, 40, 51, 61, 12, 12, 14, 19, 26, 58, 60, 55, 14, 13, 16, 24, 40, 57, 69, 56, 14, 17, 22, 29, 51, 87, 80, 62,
    18, 22, 37, 56, 68, 109, 103, 77, 24, 35, 55, 64, 81, 104, 113, 92, 49, 64, 78, 87, 103, 121, 120, 101, 72, 92, 95, 98, 112, 100, 103, 99,
]
DC = ([0, 1, 5, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0, 0, 0], list(range(12)))
AC = ([0, 2, 1, 3, 3, 2, 4, 3, 5, 5, 4, 4, 0, 0, 1, 125], list(bytes.fromhex(
    "01020300041105122131410613516107227114328191a1082342b1c11552d1f02433627282090a161718191a25262728292a3435363738393a43444546474849"
    "4a535455565758595a636465666768696a737475767778797a838485868788898a92939495969798999aa2a3a4a5a6a7a8a9aab2b3b4b5b6b7b8b9bac2c3c4c5"
    "c6c7c8c9cad2d3d4d5d6d7d8d9dae1e2e3e4e5e6e7e8e9eaf1f2f3f4f5f6f7f8f9fa")))
ZIGZAG = sorted(range(64), key=lambda k: (k // 8 + k % 8, k // 8 if (k // 8 + k % 8) % 2 else k % 8))
COSINES = [[(math.sqrt(0.125) if u == 0 else 0.5) * math.cos((2 * x + 1) * u * math.pi / 16) for x in range(8)] for u in range(8)]


def codes(table: tuple[list[int], list[int]]) -> dict[int, tuple[int, int]]:
    """Code and length by symbol (T.81, annex C)."""
    counts, symbols = table
    made, code, place = {}, 0, 0
    for length, count in enumerate(counts, 1):
        for symbol in symbols[place : place + count]:
            made[symbol] = (code, length)
            code += 1
        place, code = place + count, code << 1
    return made


class Bits:
    def __init__(self) -> None:
        self.data, self.held, self.count = bytearray(), 0, 0

    def put(self, value: int, bits: int) -> None:
        self.held, self.count = self.held << bits | value, self.count + bits
        while self.count >= 8:
            self.count -= 8
            byte = self.held >> self.count & 0xFF
            self.data.append(byte)
            if byte == 0xFF:
                self.data.append(0)
        self.held &= (1 << self.count) - 1

    def align(self) -> None:
        if self.count:
            self.put((1 << 8 - self.count) - 1, 8 - self.count)


def segment(marker: int, body: bytes) -> bytes:
    return struct.pack(">BBH", 0xFF, marker, len(body) + 2) + body


def encode(pixels: list[list[int]], quality: int, *, interval: int = 0, tables: bool = True) -> bytes:
    """Rows of grey levels as a JPEG; `interval` = blocks between restart markers; without its tables as some cameras leave them out."""
    height, width = len(pixels), len(pixels[0])
    scale = 5000 / quality if quality < 50 else 200 - 2 * quality
    steps = [min(max(int((base * scale + 50) / 100), 1), 255) for base in QUANTIZATION]
    dc_codes, ac_codes = codes(DC), codes(AC)
    bits, last, done, restarts = Bits(), 0, 0, 0

    def value(v: int, table: dict[int, tuple[int, int]], zeros: int = 0) -> None:
        size = abs(v).bit_length()
        bits.put(*table[zeros << 4 | size])
        if size:
            bits.put(v if v > 0 else v + (1 << size) - 1, size)

    for top in range(0, height, 8):
        for left in range(0, width, 8):
            if interval and done and done % interval == 0:
                bits.align()
                bits.data += bytes([0xFF, 0xD0 + restarts % 8])
                restarts, last = restarts + 1, 0
            done += 1
            block = [[pixels[min(top + y, height - 1)][min(left + x, width - 1)] - 128 for x in range(8)] for y in range(8)]
            half = [[sum(c * p for c, p in zip(COSINES[u], row)) for u in range(8)] for row in block]
            made = [sum(COSINES[v][y] * half[y][u] for y in range(8)) for v in range(8) for u in range(8)]
            values = [round(made[k] / steps[k]) for k in ZIGZAG]
            value(values[0] - last, dc_codes)
            last, zeros = values[0], 0
            for k in range(1, 64):
                if values[k] == 0:
                    zeros += 1
                    continue
                while zeros > 15:
                    bits.put(*ac_codes[0xF0])
                    zeros -= 16
                value(values[k], ac_codes, zeros)
                zeros = 0
            if zeros:
                bits.put(*ac_codes[0])
    bits.align()
    head = b"\xff\xd8" + segment(0xDB, bytes([0]) + bytes(steps[k] for k in ZIGZAG))
    head += segment(0xC0, struct.pack(">BHHBBBB", 8, height, width, 1, 1, 0x11, 0))
    if tables:
        head += segment(0xC4, b"".join(bytes([name, *counts, *symbols]) for name, (counts, symbols) in ((0, DC), (0x10, AC))))
    if interval:
        head += segment(0xDD, struct.pack(">H", interval))
    return head + segment(0xDA, bytes([1, 1, 0, 0, 63, 0])) + bytes(bits.data) + b"\xff\xd9"
