"""A crowd on the live page of a recording: idle, slow, flooding, guessing connections while STOP is pressed again and again.

A viewer who opened the page before the crowd came is answered all the while. The daemon's memory is measured as every
command's is.
"""
from __future__ import annotations

import collections
import http.client
import json
import os
import re
import resource
import selectors
import socket
import statistics
import threading
import time

from .common import Bench

CROWD = 500
PRESSES = 40
# Longest that a press may take, from the connection to the answer [s].
WITHIN_S = 0.2
# Longest that the viewer may wait for an answer: then the page itself says that what it shows is old [s].
SEEN_WITHIN_S = 2.0
TOKEN = "a-token-for-the-crowd-01"
# Of the recording; the crowd is there all the while.
SECONDS = 30
KINDS = ["idle", "slow", "flooding", "guessing", "garbage", "deaf"]


class Crowd:
    """Connections of one kind from one process; one that is closed comes again at once."""

    def __init__(self, kind: str, address: tuple[str, int], size: int) -> None:
        self.kind, self.address, self.size = kind, address, size
        self.stop = False
        self.came = 0
        self.thread = threading.Thread(target=self.serve, daemon=True)
        self.thread.start()

    def sent(self) -> bytes:
        host = f"{self.address[0]}:{self.address[1]}"
        match self.kind:
            case "slow":
                return b"G"
            case "flooding":
                return f"GET /state HTTP/1.1\r\nHost: {host}\r\n\r\n".encode() * 4
            case "guessing":
                return f"GET /?token=guess-number-{self.came:08} HTTP/1.1\r\nHost: {host}\r\n\r\n".encode()
            case "garbage":
                return os.urandom(512) + b"\r\n\r\n"
            case "deaf":
                return f"GET /?token={TOKEN} HTTP/1.1\r\nHost: {host}\r\n\r\n".encode() * 50
        return b""

    def come(self, poll: selectors.BaseSelector) -> None:
        one = socket.socket()
        one.setblocking(False)
        one.connect_ex(self.address)
        self.came += 1
        poll.register(one, selectors.EVENT_READ | selectors.EVENT_WRITE)

    @staticmethod
    def drip(poll: selectors.BaseSelector) -> None:
        """Another byte of a head that never ends."""
        for key in list(poll.get_map().values()):
            try:
                key.fileobj.send(b"x")
            except OSError:
                pass

    def serve(self) -> None:
        poll = selectors.DefaultSelector()
        for _ in range(self.size):
            self.come(poll)
        dripped_s = time.monotonic()
        while not self.stop:
            if self.kind == "slow" and time.monotonic() - dripped_s > 0.2:
                dripped_s = time.monotonic()
                self.drip(poll)
            for key, what in poll.select(0.05):
                one = key.fileobj
                try:
                    if what & selectors.EVENT_WRITE:
                        one.send(self.sent())
                        # Each says its part once.
                        poll.modify(one, selectors.EVENT_READ)
                    if what & selectors.EVENT_READ and self.kind != "deaf" and not one.recv(65536):
                        raise ConnectionResetError
                    if what & selectors.EVENT_READ and self.kind == "deaf":
                        time.sleep(0.001)
                except BlockingIOError:
                    pass
                except OSError:
                    poll.unregister(one)
                    one.close()
                    # A crowd of people, not a loop that eats the machine on which the answer is timed.
                    time.sleep(0.0005)
                    self.come(poll)
        for key in list(poll.get_map().values()):
            key.fileobj.close()


class Viewer:
    """Asks for the newest state as the page does, all on the connection on which the page was opened."""

    def __init__(self, port: int, token: str) -> None:
        self.headers = {"Authorization": f"Bearer {token}"} if token else {}
        self.connection = http.client.HTTPConnection("127.0.0.1", port, timeout=5)
        self.connection.request("GET", f"/?token={token}" if token else "/")
        page = self.connection.getresponse().read().decode()
        self.key = re.search(r'name="session" content="([0-9a-f]+)"', page)[1]
        # Its place is its own: not another one among the crowd, once that is there.
        self.connection.auto_open = 0
        self.waits_s: list[float] = []
        self.faults: list[str] = []
        self.number = 0
        self.stop = False
        self.thread = threading.Thread(target=self.look, daemon=True)
        self.thread.start()

    def look(self) -> None:
        while not self.stop and not self.faults:
            began_s = time.monotonic()
            try:
                self.connection.request("GET", f"/state?after={self.number}", headers=self.headers)
                answer = self.connection.getresponse()
                body = answer.read()
                if answer.status == 200:
                    self.number = json.loads(body)["number"]
                elif answer.status != 204:
                    self.faults.append(f"the viewer is answered with {answer.status}")
            except (OSError, http.client.HTTPException, ValueError, KeyError) as error:
                self.faults.append(f"the viewer is cut off: {error!r}")
            self.waits_s.append(time.monotonic() - began_s)
            if self.waits_s[-1] > SEEN_WITHIN_S:
                self.faults.append(f"the viewer is answered after {self.waits_s[-1]:.1f} s")

    def leave(self) -> list[str]:
        """What was wrong with its answers."""
        self.stop = True
        self.thread.join()
        self.connection.close()
        return self.faults or ([] if self.number else ["the viewer saw no state"])


def press(port: int, key: str, token: str) -> tuple[int, float]:
    """Status of a STOP on a connection of its own, and how long it took [s]; 0 = no answer."""
    began = time.monotonic()
    headers = {"X-Hydroline-Session": key, "Content-Length": "0"}
    if token:
        headers["Authorization"] = f"Bearer {token}"
    try:
        connection = http.client.HTTPConnection("127.0.0.1", port, timeout=5)
        connection.request("POST", "/stop", headers=headers)
        status = connection.getresponse().status
        connection.close()
    except OSError:
        status = 0
    except http.client.HTTPException:
        status = 0
    return status, time.monotonic() - began


class Pressed:
    """STOP among a crowd of some kinds: its answers, and what was wrong beside them."""

    def __init__(self, bench: Bench, token: str, kinds: list[str]) -> None:
        self.presses: list[tuple[int, float]] = []
        self.faults: list[str] = []
        self.seen_s = 0.0
        log = bench.folder / f"crowd-{'-'.join(kinds)}-{bool(token)}.mcap"
        words = ["record", "--rig", "lshpi", "--for", f"{SECONDS}s", "--live", "127.0.0.1:0", "--out", log]
        process = bench.start(*words, env={"HYDROLINE_LIVE_TOKEN": token} if token else None)
        said: list[str] = []
        try:
            port = self.port(process, said)
            if port:
                # What else it says, so that the pipe never fills.
                rest = threading.Thread(target=lambda: said.extend(line.decode(errors="replace") for line in process.stdout), daemon=True)
                rest.start()
                self.among(bench, port, token, kinds)
        finally:
            process.terminate()
            code = process.wait()
        if not self.presses:
            self.faults.append("no live page")
        if self.faults or code not in (0, 3):
            self.faults.append(f"exit code {code}: {''.join(said).strip()[-200:]}")

    @staticmethod
    def port(process, said: list[str]) -> int:
        """Of the live page; 0 = there is none."""
        for line in iter(process.stdout.readline, b""):
            said.append(line.decode(errors="replace"))
            if found := re.search(r"live page: http://127\.0\.0\.1:(\d+)/", said[-1]):
                return int(found[1])
        return 0

    def among(self, bench: Bench, port: int, token: str, kinds: list[str]) -> None:
        viewer = Viewer(port, token)
        crowds = [Crowd(kind, ("127.0.0.1", port), CROWD // len(kinds)) for kind in kinds]
        time.sleep(1.0)
        for _ in range(bench.times(PRESSES)):
            self.presses.append(press(port, viewer.key, token))
            time.sleep(0.1)
        self.faults += viewer.leave()
        self.seen_s = max(viewer.waits_s, default=0.0)
        for crowd in crowds:
            crowd.stop = True
        for crowd in crowds:
            crowd.thread.join()


def run(bench: Bench) -> None:
    hard = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(hard, 4096), hard))
    for token in ("", TOKEN):
        said: collections.Counter[str] = collections.Counter()
        silent = []
        took, seen_s = [], 0.0
        for kinds in [["idle"], ["slow"], ["flooding"], ["guessing"], KINDS]:
            one = Pressed(bench, token, kinds)
            name = f"{' '.join(kinds)}{' with a token' if token else ''}"
            silent += [f"{name}: {fault}" for fault in one.faults]
            seen_s = max(seen_s, one.seen_s)
            for status, wait_s in one.presses:
                took += [wait_s] if status == 200 else []
                if status != 200:
                    silent.append(f"{name}: STOP answered with {status or 'nothing'} after {wait_s:.3f} s")
                elif wait_s > WITHIN_S:
                    silent.append(f"{name}: STOP answered after {wait_s:.3f} s")
                else:
                    said["answered in time"] += 1
        longest = f"{1e3 * statistics.median(took):.0f} ms, {1e3 * max(took):.0f} ms at most; a viewer after {seen_s:.1f} s at most" if took else "-"
        bench.row(f"STOP among {CROWD} others{', with a token' if token else ''} ({longest})", said, silent)
