"""Everything that the package has, by its types."""

from __future__ import annotations

from typing import Dict, List, Optional

import hydroline


def show(stage: str, done: int, of: Optional[int]) -> None:
    print(stage, done, of)


def coefficients(logs: List[str], rig: hydroline.Rig) -> Dict[str, float]:
    found = hydroline.identify(logs, rig=rig, from_rest=True, progress=show)
    return {key: estimate.value for key, estimate in found.parameters.items()}


def verdict(logs: List[str]) -> str:
    try:
        found = hydroline.diagnose(logs, rig="lshpi", given=["sway"], accept_faults=True)
    except hydroline.ArgumentError as error:
        return f"{error.argument}: {error.allowed}"
    except hydroline.Error as error:
        return f"exit code {error.exit_code}"
    return found.sentence


def stripe(log: str) -> float:
    frames = hydroline.read(log).frames
    profile = hydroline.extract(frames[0].grey, orientation="horizontal")
    return float(profile.row_px.mean())
