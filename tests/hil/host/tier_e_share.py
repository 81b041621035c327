"""vivid's webcam in one pixel format of each kind: a share of tier e, for every run of the tests."""
from __future__ import annotations

import tier_e
from report import Report


def run(bench, report: Report) -> None:
    tier_e.run(bench, report, tier_e.SHARE, tier_e.MULTIPLANAR_SHARE)
