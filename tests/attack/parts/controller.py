"""A Maestro on a pseudoterminal that lies, falls silent, or is unplugged; and the lines that `check` has to tell apart.

Written from the Maestro User's Guide, section 5.e, without looking at hydroline's own simulated controller.
"""
from __future__ import annotations

import collections
import os
import pty
import re
import select
import termios
import threading
import time
import tty
from dataclasses import dataclass, field

from .common import Bench, Ran

NEUTRAL = 6000  # quarter us
# Fault -> whether the output really went astray, so that exit code 0 would be a lie.
FAULTS = {
    "silent from the start": True,
    "silent after 2 s": True,
    "stuck at what it had": True,
    "puts out 1900 us, whatever it is asked": True,
    "puts out 40 us more than asked": True,
    "one channel dead": True,
    "channels crossed": True,
    "echoes our bytes": True,
    "random bytes": True,
    "half of each answer": True,
    "answers 1 s late": True,
    "error bits in every answer": True,
    "resets every second": True,
    "takes no bytes": True,
    "unplugged after 2 s": True,
    "a wrong answer once": False,
}


def crc7(data: bytes) -> int:
    """Polynomial 0x91, least significant bit first (User's Guide 5.d)."""
    crc = 0
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc ^ 0x91) >> 1 if crc & 1 else crc >> 1
    return crc


@dataclass
class Maestro:
    """Serves one pseudoterminal until stopped."""

    fault: str = ""
    asked: dict[int, int] = field(default_factory=dict)
    began_s: float = 0.0
    stop: bool = False
    baud_known: bool = False

    def __post_init__(self) -> None:
        self.host, self.line = pty.openpty()
        tty.setraw(self.line, termios.TCSANOW)
        self.port = os.ttyname(self.line)
        self.thread = threading.Thread(target=self.serve, daemon=True)
        self.thread.start()

    def end(self) -> None:
        self.stop = True
        self.thread.join()
        for descriptor in (self.host, self.line):
            try:
                os.close(descriptor)
            except OSError:
                pass

    def age_s(self) -> float:
        """Since the first command that was not neutral."""
        return time.monotonic() - self.began_s if self.began_s else 0.0

    def put_out(self, channel: int) -> int:
        value = self.asked.get(channel, NEUTRAL)
        match self.fault:
            case "stuck at what it had":
                return NEUTRAL
            case "puts out 1900 us, whatever it is asked":
                return 7600
            case "puts out 40 us more than asked":
                return value + 160
            case "one channel dead":
                return 0 if channel == 1 else value
            case "channels crossed":
                return self.asked.get(channel ^ 4, NEUTRAL)  # surge asks the same of 0 and 1
        return value

    def say(self, data: bytes) -> None:
        match self.fault:
            case "half of each answer":
                data = data[:1]
            case "answers 1 s late":
                threading.Timer(1.0, lambda: self.stop or os.write(self.host, data)).start()
                return
            case "random bytes":
                data = os.urandom(2)
            case "a wrong answer once" if self.age_s() > 1.0 and len(data) == 2:
                self.fault = ""
                data = (7000).to_bytes(2, "little")
        os.write(self.host, data)

    def take(self, command: bytes) -> None:
        kind, channel = command[0], command[1] if len(command) > 1 else 0
        if kind == 0x84:
            self.asked[channel] = command[2] | command[3] << 7
            if self.asked[channel] != NEUTRAL and not self.began_s:
                self.began_s = time.monotonic()
        elif kind == 0x90:
            self.say(self.put_out(channel).to_bytes(2, "little"))
        elif kind == 0xA1:
            self.say((0x0010 if self.fault == "error bits in every answer" else 0).to_bytes(2, "little"))
        elif kind == 0x93:
            self.say(b"\0")
        elif kind == 0xA2:
            self.asked = dict.fromkeys(self.asked, NEUTRAL)

    def serve(self) -> None:
        length = {0x84: 4, 0x87: 4, 0x89: 4, 0x90: 2, 0x93: 1, 0xA1: 1, 0xA2: 1}
        command = bytearray()
        reset_s = time.monotonic()
        while not self.stop:
            if self.fault == "takes no bytes":
                time.sleep(0.05)
                continue
            if self.fault == "unplugged after 2 s" and self.age_s() > 2.0:
                os.close(self.host)
                os.close(self.line)
                return
            if self.fault == "resets every second" and time.monotonic() - reset_s > 1.0:
                # Supply gone for a moment: deaf, and at its start-up position again.
                time.sleep(0.3)
                termios.tcflush(self.host, termios.TCIOFLUSH)
                self.asked, reset_s = {}, time.monotonic()
            if not select.select([self.host], [], [], 0.02)[0]:
                continue
            try:
                data = os.read(self.host, 4096)
            except OSError:
                return
            if self.fault == "silent from the start" or self.fault == "silent after 2 s" and self.age_s() > 2.0:
                continue
            if self.fault in ("echoes our bytes", "a line that echoes"):
                os.write(self.host, data)
                continue
            if self.fault == "in factory mode" and not self.baud_known:
                # User's Guide 5.a: nothing counts until 0xAA has told the baud rate.
                self.baud_known = 0xAA in data
                data = data.partition(b"\xaa")[2]
            if self.fault == "noise":
                os.write(self.host, os.urandom(24))
                continue
            if self.fault == "in CRC mode":
                # User's Guide 5.d: a command counts only with its CRC-7 behind it.
                if len(data) > 1 and data[-1] == crc7(data[:-1]) and data[0] == 0xA1:
                    os.write(self.host, bytes(2))
                continue
            for byte in data:
                if byte & 0x80:
                    command = bytearray([byte])
                elif command:
                    command.append(byte)
                if command and len(command) == length.get(command[0], 1):
                    self.take(bytes(command))
                    command.clear()


def kinds(text: str) -> list[str]:
    """Events of the thrusters that the doctor counts, but for what is said of every Maestro."""
    return sorted(set(re.findall(r"thruster\.\w+", text)) - {"thruster.maestro_timeout"})


def run(bench: Bench) -> None:
    effective = bench.run("rig", "show", "lshpi").text
    said: collections.Counter[str] = collections.Counter()
    silent: list[str] = []
    plan = bench.folder / "drive.toml"
    plan.write_text('name = "drive"\n[[step]]\nfor_s = 5.0\nwrench = { surge_n = 4.0 }\n')

    def rig(maestro: Maestro) -> object:
        text = effective.replace('kind = "stamped"', 'kind = "maestro"').replace(
            'port = "sim"', f'port = "{maestro.port}"\nallow_unstable_node = true')
        path = bench.folder / "maestro.toml"
        path.write_text(text)
        return path

    def driven(fault: str, n: int) -> tuple[Ran, Ran, Maestro]:
        maestro = Maestro(fault)
        log = bench.folder / f"controller{n}.mcap"
        done = bench.run("record", "--rig", rig(maestro), "--plan", plan, "--out", log)
        doctor = bench.run("doctor", log) if log.exists() else done
        maestro.end()
        return done, doctor, maestro

    sound, doctor, maestro = driven("", 0)
    if sound.code or doctor.code or kinds(doctor.text) or not maestro.began_s:
        silent.append(f"a sound controller: exit code {sound.code}, doctor {doctor.code}: {sound.text.strip()[-300:]}")
    for n, (fault, astray) in enumerate(FAULTS.items(), 1):
        done, doctor, maestro = driven(fault, n)
        running = {c: t for c, t in maestro.asked.items() if t != NEUTRAL}
        deaf = fault in ("silent from the start", "silent after 2 s", "echoes our bytes", "takes no bytes", "unplugged after 2 s")
        if done.code < 0 or done.code > 3 or doctor.code < 0:
            silent.append(f"{fault}: exit code {done.code}, doctor {doctor.code}")
        elif done.code and not re.search(r"controller|thruster|link|serial", done.text):
            silent.append(f"{fault}: exit code {done.code} for another reason: {done.text.strip()[-200:]}")
        elif astray and done.code == 0 and doctor.code == 0 and not kinds(doctor.text):
            silent.append(f"{fault}: exit code 0, doctor 0: {done.text.strip()[-200:]}")
        elif running and not deaf:
            silent.append(f"{fault}: left running: {running}")
        else:
            said[f"record {done.code}, doctor {doctor.code}" + ("" if done.code or doctor.code else f" counting {' '.join(kinds(doctor.text))}")] += 1
    bench.row("faults of the controller, recording", said, silent)

    said, silent = collections.Counter(), []
    for fault, words in {
        "": "answers; ",
        "silent from the start": "nothing answers",
        "a line that echoes": "the line echoes",
        "in factory mode": "factory mode",
        "in CRC mode": "CRC mode",
        "noise": "not as a maestro",
    }.items():
        maestro = Maestro(fault)
        done = bench.run("check", "--rig", rig(maestro))
        moved = [t for t in maestro.asked.values() if t != NEUTRAL]
        maestro.end()
        line = next((x.strip() for x in done.text.splitlines() if "controller" in x.lower() or "thruster" in x.lower()), "")
        healthy = not fault
        if moved or words.lower() not in done.text.lower() or (not healthy and done.code != 1):
            silent.append(f"check, {fault or 'sound'}: exit code {done.code}, moved {moved}: {line}")
        else:
            said["named"] += 1
    bench.row("lines that `check` tells apart", said, silent)
