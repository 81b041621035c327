"""A QEMU/TCG guest with real drivers: builds the overlay, boots, obeys the guest's MARK lines, brings the files back.

Standard library only. The guest asks for things on its console, one per line:

    MARK <id> {"execute": "device_del", "arguments": {"id": "ftdi0"}}   any QMP command
    MARK <id> {"adapter": "unplug"} | {"adapter": "plug"}               device_del / device_add of the USB serial adapter
    MARK <id> {"controller": "start"} | "kill" | "stop" | "cont" | "echo"   the process at the far end of the adapter
    MARK <id> {"note": "text"}                                          a time mark in marks.jsonl

and finds the answer in /out/ack.<id>. Killing the controller closes its socket, which qemu's usb-serial turns into an
unplug; "stop" (SIGSTOP) is a controller that is silent behind an adapter that stays.
"""
from __future__ import annotations

import json
import os
import re
import shutil
import signal
import socket
import subprocess
import tempfile
import threading
import time
from pathlib import Path


# Left to itself qemu makes the serial number from the USB port, and hands out another port at a replug.
ADAPTER_SERIAL = "HIL0002"


class GuestError(Exception):
    """The guest did not do what it was booted for."""


def go_first(pid: int) -> None:
    """Puts a process of its own session before the host's other work, where that is allowed.

    A guest that gets no processor time loses frames that no daemon could have kept. With the kernel's autogroups
    (sched(7)) a nice value only counts within a session; the session's own weight is a file.
    """
    try:
        os.setpriority(os.PRIO_PROCESS, pid, -20)
        Path(f"/proc/{pid}/autogroup").write_text("-20")
    except OSError:
        pass


def copy_program(binary: Path, root: Path) -> None:
    """Puts a program into the overlay, without debug sections, with the shared libraries it needs."""
    target = root / "bin" / binary.name
    target.parent.mkdir(parents=True, exist_ok=True)
    # The code stays the same; without the line tables the initrd unpacks a second faster.
    if subprocess.run(["strip", "-g", "-o", target, binary], capture_output=True).returncode != 0:
        shutil.copy(binary, target)      # a script
    target.chmod(0o755)
    listing = subprocess.run(["ldd", binary], capture_output=True, text=True).stdout
    missing = [l.strip() for l in listing.splitlines() if "not found" in l]
    if missing:
        raise GuestError(f"{binary} lacks libraries on this machine: {missing}")
    libs = root / "lib/x86_64-linux-gnu"
    libs.mkdir(parents=True, exist_ok=True)
    for path in re.findall(r"=> (/\S+)", listing):
        shutil.copy(os.path.realpath(path), libs / Path(path).name)


class Controller:
    """What sits behind the serial adapter: a process that connects to qemu's socket, or an echo."""

    def __init__(self, socket_path: str, command: list[str] | None, log: Path):
        self.socket_path, self.command, self.log = socket_path, command, log
        self.process: subprocess.Popen | None = None
        self.echo: socket.socket | None = None

    def do(self, word: str) -> str:
        if word == "start":
            if self.command is None:
                return self.do("echo")
            out = open(self.log, "ab")
            self.process = subprocess.Popen(self.command, stdin=subprocess.DEVNULL, stdout=out, stderr=out, start_new_session=True)
            go_first(self.process.pid)             # its clock is what the guest synchronises with
        elif word == "echo":
            self.echo = socket.socket(socket.AF_UNIX)
            self.echo.connect(self.socket_path)
            threading.Thread(target=self._echo, args=(self.echo,), daemon=True).start()
        elif word == "kill":
            self.close()
        elif word in ("stop", "cont") and self.process:
            self.process.send_signal(signal.SIGSTOP if word == "stop" else signal.SIGCONT)
        else:
            return f"error: cannot {word}"
        return "ok"

    @staticmethod
    def _echo(s: socket.socket) -> None:
        try:
            while data := s.recv(4096):
                s.sendall(data)
        except OSError:
            pass

    def close(self) -> None:
        if self.echo:
            try:
                self.echo.shutdown(socket.SHUT_RDWR)
            except OSError:
                pass
            self.echo.close()
            self.echo = None
        if self.process:
            self.process.send_signal(signal.SIGCONT)
            self.process.kill()
            self.process.wait()
            self.process = None


class Qmp:
    """The monitor; answers come back, events are remembered."""

    def __init__(self, path: str):
        self.socket = socket.socket(socket.AF_UNIX)
        self.socket.settimeout(10)
        deadline = time.monotonic() + 10
        while True:
            try:
                self.socket.connect(path)
                break
            except OSError:
                if time.monotonic() > deadline:
                    raise GuestError(f"qemu offers no monitor at {path}") from None
                time.sleep(0.02)
        self.file = self.socket.makefile("rw")
        self.file.readline()
        self.events: list[str] = []
        self.command({"execute": "qmp_capabilities"})

    def _answer(self) -> dict:
        return json.loads(self.file.readline() or '{"error": {"desc": "monitor closed"}}')

    def command(self, c: dict) -> dict:
        self.file.write(json.dumps(c) + "\n")
        self.file.flush()
        while True:
            r = self._answer()
            if "return" in r or "error" in r:
                return r
            self.events.append(r.get("event", ""))

    def wait_event(self, name: str) -> None:
        while name not in self.events:
            self.events.append(self._answer().get("event", ""))
        self.events.remove(name)


class Guest:
    """One boot."""

    def __init__(self, cache: Path, out: Path, timeout_s: float = 120.0):
        self.cache, self.out, self.timeout_s = cache, out, timeout_s
        self.work = Path(tempfile.mkdtemp(prefix="hil-"))     # short: a UNIX socket path holds 107 bytes
        self.overlay = self.work / "overlay"
        (self.overlay / "bin").mkdir(parents=True)
        (self.overlay / "work").mkdir()
        self.out.mkdir(parents=True, exist_ok=True)
        self.console: list[str] = []
        self.marks: list[dict] = []
        self.wall_s = 0.0
        self.stalls: list[tuple[float, float]] = []     # (uptime [s], length [ms]) of each time a processor stood still
        self.waited_share = 0.0      # of the time its processors wanted to run, the share they waited for the host's
        self.echo_console = False
        self.controller_command: list[str] | None = None      # {socket} is replaced

    def add(self, path: Path, name: str | None = None) -> None:
        """A file for /work."""
        shutil.copy(path, self.overlay / "work" / (name or path.name))

    def add_program(self, path: Path) -> None:
        copy_program(path, self.overlay)

    def run(self, script: Path) -> int:
        """Boots, runs the script to its end; its exit code as the guest wrote it down."""
        shutil.copy(script, self.overlay / "test.sh")
        shutil.copy(Path(__file__).parent.parent / "inside/lib.sh", self.overlay / "lib.sh")
        for jpeg in (self.cache / "jpeg").glob("*.jpg"):
            self.add(jpeg)
        for injector in (self.cache / "bin").iterdir():
            shutil.copy(injector, self.overlay / "bin" / injector.name)
        initrd = self.work / "initrd"
        with open(initrd, "wb") as f:
            f.write((self.cache / "base.cpio.gz").read_bytes())
            f.flush()
            subprocess.run("find . | cpio -o -H newc -R 0:0 --quiet | gzip -1", shell=True, cwd=self.overlay, stdout=f, check=True)
        usb, qmp_path = str(self.work / "usb"), str(self.work / "qmp")
        version = (self.cache / "KV").read_text().strip()
        started = time.monotonic()
        qemu = subprocess.Popen(
            ["qemu-system-x86_64", "-accel", "tcg,thread=multi", "-cpu", "max", "-smp", "2", "-m", "1536",
             "-nodefaults", "-no-reboot", "-display", "none", "-serial", "stdio",
             "-kernel", str(self.cache / f"k/boot/vmlinuz-{version}"), "-initrd", str(initrd),
             "-append", "console=ttyS0 quiet panic=-1",
             "-virtfs", f"local,path={self.out},mount_tag=out9p,security_model=none",
             "-qmp", f"unix:{qmp_path},server=on,wait=off",
             "-device", "qemu-xhci,id=xhci",
             "-chardev", f"socket,id=cusb,path={usb},server=on,wait=off",
             "-device", f"usb-serial,chardev=cusb,id=ftdi0,bus=xhci.0,port=1,serial={ADAPTER_SERIAL}"],
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace", bufsize=1,
            start_new_session=True)
        go_first(qemu.pid)
        killer = threading.Timer(self.timeout_s, qemu.kill)
        killer.start()
        threading.Thread(target=self._watch_host, args=(qemu.pid,), daemon=True).start()
        command = [w.replace("{socket}", usb) for w in self.controller_command] if self.controller_command else None
        controller = Controller(usb, command, self.out / "controller.log")
        done = False
        try:
            qmp = Qmp(qmp_path)
            for line in qemu.stdout:
                line = line.rstrip()
                self.console.append(line)
                if self.echo_console:
                    print(line, flush=True)
                found = re.search(r"MARK (\S+) (\{.*\})", line)
                if found:
                    self._obey(found[1], found[2], qmp, controller, time.monotonic() - started)
                done = done or line.startswith("GUEST-DONE")
            qemu.wait()
        finally:
            killer.cancel()
            qemu.kill()
            qemu.wait()
            controller.close()
            self.wall_s = time.monotonic() - started
            (self.out / "console.txt").write_text("\n".join(self.console) + "\n")
            (self.out / "marks.jsonl").write_text("".join(json.dumps(m) + "\n" for m in self.marks))
            shutil.rmtree(self.work, ignore_errors=True)
        if not done:
            raise GuestError(f"the guest did not finish within {self.timeout_s:.0f} s (ran {self.wall_s:.1f} s)")
        self.stalls = [(float(at), float(ms)) for at, _, ms in
                       (l.split() for l in (self.out / "stalls.txt").read_text().splitlines())]
        # qemu's own exit code says nothing about the script.
        return int((self.out / "guest.rc").read_text())

    def _watch_host(self, pid: int) -> None:
        """How long qemu's threads were runnable but not run (Documentation/scheduler/sched-stats.rst)."""
        last: dict[str, tuple[int, int]] = {}
        while True:
            try:
                for task in os.listdir(f"/proc/{pid}/task"):
                    ran, waited, _ = Path(f"/proc/{pid}/task/{task}/schedstat").read_text().split()
                    last[task] = (int(ran), int(waited))
            except (OSError, ValueError):
                return
            ran, waited = sum(r for r, _ in last.values()), sum(w for _, w in last.values())
            self.waited_share = waited / max(1, ran + waited)
            time.sleep(0.5)

    def _obey(self, mark: str, text: str, qmp: Qmp, controller: Controller, at_s: float) -> None:
        try:
            c = json.loads(text)
            if "execute" in c:
                answer = json.dumps(qmp.command(c))
            elif c.get("adapter") == "unplug":
                answer = json.dumps(qmp.command({"execute": "device_del", "arguments": {"id": "ftdi0"}}))
                qmp.wait_event("DEVICE_DELETED")          # a device_add before that is refused
            elif c.get("adapter") == "plug":
                answer = json.dumps(qmp.command({"execute": "device_add", "arguments": {
                    "driver": "usb-serial", "chardev": "cusb", "id": "ftdi0", "bus": "xhci.0", "port": "1", "serial": ADAPTER_SERIAL}}))
            elif "controller" in c:
                answer = controller.do(c["controller"])
            elif "note" in c:
                answer = "ok"
            else:
                answer = f"error: unknown request {text}"
        except (OSError, ValueError, GuestError) as e:
            answer = f"error: {e}"
        self.marks.append({"host_s": round(at_s, 3), "request": text, "answer": answer})
        temporary = self.out / f".ack.{mark}"
        temporary.write_text(answer + "\n")
        temporary.rename(self.out / f"ack.{mark}")
