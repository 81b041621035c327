"""tiers.py [a|b|c|d|e|all|self]...: boots each tier's guest and judges what it brought back."""
from __future__ import annotations

import os
import shutil
import sys
import tempfile
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))
import tier_a  # noqa: E402
import tier_b  # noqa: E402
import tier_c  # noqa: E402
import tier_d  # noqa: E402
import tier_e  # noqa: E402
import tier_self  # noqa: E402
import vm  # noqa: E402
from report import Report  # noqa: E402

TIERS = {"a": tier_a, "b": tier_b, "c": tier_c, "d": tier_d, "e": tier_e, "self": tier_self}
# A tier that failed while other work held up the guest is run again: the verdict is about the daemon, and a guest without
# processor time loses frames before any driver sees them. One stall of a frame's length is enough for that, and far too
# short to show in the share of a whole tier. On a machine of its own the first attempt counts.
# On two busy processors one attempt in three loses a frame inside vivid (stalls of 30 ms): five are enough.
ATTEMPTS, BUSY_SHARE, STALL_MS = int(os.environ.get("HYDROLINE_HIL_ATTEMPTS", "5")), 0.02, 40.0
ALL = ["a", "b", "c", "d", "e"]         # self judges the injectors, not the daemon


class Bench:
    """What a tier works with."""

    def __init__(self, name: str):
        self.repository = HERE.parent.parent.parent
        self.cache = Path(os.environ["HYDROLINE_HIL_CACHE"]).resolve()
        self.binary = Path(os.environ["HYDROLINE_BIN"]).resolve()
        (self.cache / "runs").mkdir(exist_ok=True)
        for old in (self.cache / "runs").glob(f"{name}.*"):       # a failed run keeps its recordings until the next
            shutil.rmtree(old, ignore_errors=True)
        self.out = Path(tempfile.mkdtemp(prefix=f"{name}.", dir=self.cache / "runs"))
        self.guests: list[vm.Guest] = []

    def guest(self, timeout_s: float) -> vm.Guest:
        g = vm.Guest(self.cache, self.out, timeout_s)
        self.guests.append(g)
        g.add_program(self.binary)
        g.controller_command = [str(self.binary), "sim-controller", "--socket", "{socket}", "--kind", "stamped"]
        return g


def evidence(bench: Bench) -> None:
    console = bench.out / "console.txt"
    if console.exists():
        print(f"--- last lines of {console}")
        print("\n".join(console.read_text(errors="replace").splitlines()[-30:]))
    for said in sorted([*bench.out.glob("*.stdout"), *bench.out.glob("*.stderr")]):
        print(f"--- last lines of {said}")
        print("\n".join(said.read_text(errors="replace").splitlines()[-12:]))
    print(f"--- everything is kept in {bench.out}", flush=True)


def main(words: list[str]) -> int:
    names = ALL if not words or "all" in words else words
    unknown = [n for n in names if n not in TIERS]
    if unknown:
        print(f"run: no tier {unknown}; there are a, b, c, d, e, all and self", file=sys.stderr)
        return 2
    report = Report()
    for name in names:
        print(f"tier {name}: {TIERS[name].__doc__.strip().splitlines()[0]}", flush=True)
        for attempt in range(1, ATTEMPTS + 1):
            bench, tier = Bench(name), Report()
            started = time.monotonic()
            try:
                TIERS[name].run(bench, tier)
            except Exception as e:  # a broken recording must end as a failed check with its evidence, not as a traceback
                tier.check(f"{name}: tier runs to its end", f"{type(e).__name__}: {e}", "no error", False)
            waited = max((g.waited_share for g in bench.guests), default=0.0)
            stalls = sorted((s for g in bench.guests for s in g.stalls), key=lambda s: -s[1])
            print(f"tier {name}: {time.monotonic() - started:.1f} s; the guest's processors waited {100 * waited:.1f} % for the host's; "
                  f"{len(stalls)} stall(s)" + "".join(f", {ms:.0f} ms at {at:.1f} s" for at, ms in stalls[:3]), flush=True)
            held_up = waited > BUSY_SHARE or any(ms >= STALL_MS for _, ms in stalls)
            if tier.failed and held_up and attempt < ATTEMPTS:
                print(f"tier {name}: {tier.failed} failed on a machine busy with other work: the emulated cameras themselves "
                      f"come late then. Again ({attempt + 1} of {ATTEMPTS})", flush=True)
                continue
            break
        if attempt > 1:
            print(f"tier {name}: judged on attempt {attempt} of {ATTEMPTS}", flush=True)
        report.add(tier)
        if tier.failed:
            evidence(bench)
        elif not os.environ.get("HYDROLINE_HIL_KEEP"):
            shutil.rmtree(bench.out)
    return report.close()


sys.exit(main(sys.argv[1:]))
