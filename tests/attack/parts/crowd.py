"""A crowd on the live page of a recording: idle, slow, flooding, guessing connections while STOP is pressed again and again."""
from __future__ import annotations

import collections
import http.client
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


def pressed(bench: Bench, token: str, kinds: list[str]) -> tuple[list[tuple[int, float]], str, int]:
    log = bench.folder / f"crowd-{'-'.join(kinds)}-{bool(token)}.mcap"
    words = ["record", "--rig", "lshpi", "--for", f"{SECONDS}s", "--live", "127.0.0.1:0", "--out", log]
    process = bench.start(*words, env={"HYDROLINE_LIVE_TOKEN": token} if token else None)
    said = []
    try:
        port = 0
        while not port:
            line = process.stdout.readline().decode()
            if not line:
                return [], "".join(said), process.wait()
            said.append(line)
            if found := re.search(r"live page: http://127\.0\.0\.1:(\d+)/", line):
                port = int(found[1])
        threading.Thread(target=lambda: said.extend(l.decode(errors="replace") for l in process.stdout), daemon=True).start()
        page = http.client.HTTPConnection("127.0.0.1", port, timeout=20)
        page.request("GET", f"/?token={token}" if token else "/")
        key = re.search(r'name="session" content="([0-9a-f]+)"', page.getresponse().read().decode())[1]
        page.close()
        crowds = [Crowd(kind, ("127.0.0.1", port), CROWD // len(kinds)) for kind in kinds]
        time.sleep(1.0)
        presses = []
        for _ in range(bench.times(PRESSES)):
            presses.append(press(port, key, token))
            time.sleep(0.1)
        for crowd in crowds:
            crowd.stop = True
        for crowd in crowds:
            crowd.thread.join()
    finally:
        process.terminate()
        code = process.wait()
    return presses, "".join(said), code


def run(bench: Bench) -> None:
    hard = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(hard, 4096), hard))
    for token in ("", TOKEN):
        said: collections.Counter[str] = collections.Counter()
        silent = []
        took = []
        for kinds in [["idle"], ["slow"], ["flooding"], ["guessing"], KINDS]:
            presses, text, code = pressed(bench, token, kinds)
            name = f"{' '.join(kinds)}{' with a token' if token else ''}"
            if not presses:
                silent.append(f"{name}: no live page, exit code {code}: {text.strip()[-200:]}")
            for status, wait_s in presses:
                took += [wait_s] if status == 200 else []
                if status != 200:
                    silent.append(f"{name}: STOP answered with {status or 'nothing'} after {wait_s:.3f} s")
                elif wait_s > WITHIN_S:
                    silent.append(f"{name}: STOP answered after {wait_s:.3f} s")
                else:
                    said["answered in time"] += 1
            if code not in (0, 3):
                silent.append(f"{name}: exit code {code}: {text.strip()[-200:]}")
        longest = f"answered in {1e3 * statistics.median(took):.0f} ms, {1e3 * max(took):.0f} ms at most" if took else "-"
        bench.row(f"STOP among {CROWD} others{', with a token' if token else ''} ({longest})", said, silent)
