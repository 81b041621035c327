"""the unit that ships, under systemd: a recording by its own user, in its sandbox, with real-time priority."""
from __future__ import annotations

import re
import subprocess
from pathlib import Path

import rigs
from common import sound
from report import Report

SECONDS, PLAN_SECONDS = 6.0, 4.0
PROGRAMS = ["/lib/systemd/systemd"]
PASSWD = "root:x:0:0:root:/root:/bin/sh\nhydroline:x:990:990::/var/lib/hydroline:/bin/sh\nnobody:x:65534:65534::/:/bin/sh\n"
GROUP = "root:x:0:\ndialout:x:20:\nvideo:x:44:\ntty:x:5:\nhydroline:x:990:\nnogroup:x:65534:\n"
# The end is told by systemd itself, outside of the sandbox; 10 s of watchdog are for an emulated processor.
HIL = """[Service]
ExecStopPost=+/bin/sh -c 'echo $SERVICE_RESULT $EXIT_CODE $EXIT_STATUS > /out/service.new; /bin/busybox mv /out/service.new /out/service.result'
WatchdogSec=10
Restart=no
StandardOutput=append:/out/d.stdout
StandardError=append:/out/d.stderr
"""


def systemd_tar(target: Path) -> None:
    """systemd and the libraries it needs, from this machine."""
    files = set(PROGRAMS)
    for program in PROGRAMS:
        listing = subprocess.run(["ldd", program], capture_output=True, text=True, check=True).stdout
        files.update(re.findall(r"=> (/\S+)", listing))
    # Links as what they lead to, under the names they are asked by; /lib as one folder.
    subprocess.run(["tar", "--dereference", "--transform", "s,^usr/lib,lib,", "-C", "/", "-cf", target, *sorted(f.lstrip("/") for f in files),
                    "lib64/ld-linux-x86-64.so.2"], check=True)


def run(bench, report: Report) -> None:
    guest = bench.guest(timeout_s=240)
    work = guest.overlay / "work"
    folder = work / "rigs"
    rigs.write(bench.repository, folder, {"d": {**rigs.VIVID_TV, "pixel_format": "GREY"}})
    rigs.write_plan(folder / "hil-plan.toml", seconds=PLAN_SECONDS)
    guest.add(bench.repository / "src/daemon/service/hydroline.service")
    for name, text in {
        "passwd": PASSWD, "group": GROUP, "hil.conf": HIL,
        "environment": f'HYDROLINE_OPTIONS="--plan /etc/hydroline/hil-plan.toml --for {SECONDS:g}s"\n',
    }.items():
        (work / name).write_text(text)
    systemd_tar(work / "systemd.tar")
    report.equal("d: guest script's exit code", guest.run(Path(__file__).parent.parent / "inside/tier-d.sh"), 0)
    result = (bench.out / "service.result").read_text().split()
    # 3, which the unit counts as success too: no target lies before this camera, and a frame may be late (`sound` says which).
    report.check("d: systemd's result of the service", result, "success exited 0 or 3", result in (["success", "exited", "0"], ["success", "exited", "3"]))
    status = dict(l.split(":", 1) for l in (bench.out / "status.txt").read_text().splitlines() if ":" in l)
    of = lambda key: status.get(key, "").split()
    report.equal("d: user", of("Uid")[:1], ["990"])
    report.equal("d: groups", sorted(of("Groups")), ["20", "44", "990"])
    report.equal("d: capabilities it could ever have", of("CapBnd"), ["0000000000000000"])
    report.equal("d: no new privileges, system calls filtered", (of("NoNewPrivs"), of("Seccomp")), (["1"], ["2"]))
    real_time = [l for l in (bench.out / "threads.txt").read_text().splitlines() if l.split()[-1] in ("1", "2")]
    report.check("d: threads with real-time priority", real_time, "the thruster's among them", any("thruster" in l for l in real_time))
    log = sound(report, bench, "d", (0,))
    if log is not None:
        report.at_least("d: frames in the file", len(log.frames), (SECONDS - 1) * 25)
        report.check("d: commands and echoes", (len(log.topics.get("/thruster/command", [])), len(log.topics.get("/thruster/echo", []))), "both",
                     all(log.topics.get(f"/thruster/{t}") for t in ("command", "echo")))
