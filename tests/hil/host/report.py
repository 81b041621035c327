"""One line per check: name, measured, asked, PASS or FAIL."""
from __future__ import annotations


class Report:
    def __init__(self) -> None:
        self.passed = 0
        self.failed = 0

    def check(self, name: str, measured: object, asked: str, ok: bool) -> bool:
        if ok:
            self.passed += 1
        else:
            self.failed += 1
        print(f"{'PASS' if ok else 'FAIL'}  {name:<58} measured {measured}; asked {asked}", flush=True)
        return ok

    def equal(self, name: str, measured: object, asked: object) -> bool:
        return self.check(name, measured, f"= {asked}", measured == asked)

    def within(self, name: str, measured: float, low: float, high: float, unit: str = "") -> bool:
        return self.check(name, f"{measured:.4g} {unit}".strip(), f"{low:g} to {high:g} {unit}".strip(), low <= measured <= high)

    def at_least(self, name: str, measured: float, low: float, unit: str = "") -> bool:
        return self.check(name, f"{measured:.4g} {unit}".strip(), f">= {low:g} {unit}".strip(), measured >= low)

    def add(self, other: Report) -> None:
        self.passed += other.passed
        self.failed += other.failed

    def close(self) -> int:
        print(f"{self.passed} passed, {self.failed} failed", flush=True)
        return 0 if self.failed == 0 and self.passed > 0 else 1
