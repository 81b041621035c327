"""What the functions return: typed views of the JSON that the command line prints.

``to_dict()`` is that JSON, field by field as the reference of the book lists it ("JSON"); the properties are the fields
that a notebook needs most, with units in their names (SI; motion in the tank frame with z down, rates in the body frame).
"""

from __future__ import annotations

import math
from typing import Any, Dict, List, Mapping, Optional, Tuple

from ._result import Result


class Estimate:
    """One coefficient."""

    def __init__(self, key: str, fields: Mapping[str, Any]) -> None:
        self._fields = fields
        #: Its key, such as ``x_udot``.
        self.key = key

    @property
    def value(self) -> float:
        """The value, in ``unit``."""
        return float(self._fields["value"])

    @property
    def unit(self) -> str:
        """Its unit, such as ``kg``."""
        return str(self._fields["unit"])

    @property
    def sd(self) -> Optional[float]:
        """Standard deviation; None = these runs say nothing of it."""
        sd = self._fields["sd"]
        return None if sd is None else float(sd)

    @property
    def interval(self) -> Tuple[Optional[float], Optional[float]]:
        """95 % interval; None = open."""
        return self._fields["low"], self._fields["high"]

    @property
    def rig(self) -> float:
        """What the rig says."""
        return float(self._fields["rig"])

    def __repr__(self) -> str:
        sd = "-" if self.sd is None else f"{self.sd:.3g}"
        return f"<hydroline.Estimate {self.key}: {self.value:.6g} (sd {sd}) {self.unit}>"


class Identification(Result):
    """Coefficients with their uncertainty, as ``hydroline identify`` prints them."""

    @property
    def model(self) -> str:
        """The model that was fitted: a degree of freedom, or ``coupled``."""
        return str(self._fields["model"])

    @property
    def parameters(self) -> Dict[str, Estimate]:
        """The coefficients by their keys, in the order of the fit."""
        of = self._fields["parameters"]
        order: List[str] = self._fields.get("order") or list(of)
        return {key: Estimate(key, of[key]) for key in order}

    @property
    def covariance(self) -> List[List[Optional[float]]]:
        """Covariance of the coefficients in the order of ``parameters``, shape (n, n); None = not determined."""
        return list(self._fields["covariance"])

    @property
    def variance_ratio(self) -> float:
        """Residual variance over that of the noise at rest, else over the noise found; 1 = the noise explains the residuals."""
        return float(self._fields["variance_ratio"])

    @property
    def explains(self) -> bool:
        """Whether the model explains the runs; ``sentence`` says it in words."""
        return bool(self._fields["test"]["explains"])

    @property
    def sentence(self) -> str:
        """Whether the model explains the runs, and what was never driven, in a sentence."""
        return str(self._fields["test"]["sentence"])

    @property
    def notes(self) -> List[str]:
        """Remarks of the fit, a sentence each."""
        return list(self._fields["notes"])

    @property
    def misfit(self) -> List[str]:
        """What the noise does not explain, a sentence each; empty = the model explains the runs."""
        return list(self._fields["misfit"])

    def _sentence(self) -> str:
        if "parameters" not in self._fields:
            return "the thrust curve of a bollard pull"
        parts = [f"{e.key} = {e.value:.4g} {e.unit}" for e in self.parameters.values()]
        return f"{self.model}: " + ", ".join(parts)


class Diagnosis(Result):
    """Which physics the rig leaves out, as ``hydroline diagnose`` prints it."""

    @property
    def verdict(self) -> str:
        """One of ``none``, ``named``, ``ambiguous``, ``unknown``, ``data_fault``."""
        return str(self._fields["verdict"])

    @property
    def sentence(self) -> str:
        """The verdict in words."""
        return str(self._fields["sentence"])

    @property
    def effects(self) -> List[Dict[str, Any]]:
        """What was left out together, heaviest first: ``effect``, ``dof``, ``probability``, ``weight``, ``parameters`` ..."""
        return list(self._fields["effects"])

    @property
    def equivalent(self) -> List[List[str]]:
        """Sets of effects that these data cannot distinguish, most probable first."""
        return list(self._fields["equivalent"])

    @property
    def contradicted_by(self) -> List[Dict[str, Any]]:
        """Runs held out that miss their prediction, by channel: ``log``, ``channel``, ``rms``, ``band``, ``p_value``, ``outside``."""
        return list(self._fields.get("contradicted_by", []))

    @property
    def implausible(self) -> List[Dict[str, Any]]:
        """Effects not offered for their size: ``effect``, ``dof``, ``parameter``, ``value``, ``plausible``, ``probability``."""
        return list(self._fields.get("implausible", []))

    @property
    def data_faults(self) -> List[Dict[str, Any]]:
        """Faults of the data."""
        return list(self._fields["data_faults"])

    @property
    def notes(self) -> List[str]:
        """Remarks, a sentence each."""
        return list(self._fields["notes"])

    @property
    def truncated(self) -> Optional[Dict[str, Any]]:
        """Where ``time_limit`` ended the search: ``after`` what, and what was still ``open``; None = it came to its end."""
        return self._fields.get("truncated")

    @property
    def next_plan_toml(self) -> Optional[str]:
        """The plan of the next experiment as a file's text; None = none is needed."""
        planned = self._fields["next_experiment"]
        return None if planned is None else str(planned["plan_toml"])

    def _sentence(self) -> str:
        return self.sentence


class Prediction(Result):
    """The motion that a plan will make, as ``hydroline predict`` prints it."""

    @property
    def channels(self) -> List[str]:
        """Names of the columns of ``motion``: pose in the tank frame [m, rad], velocities in the body frame [m/s, rad/s]."""
        return list(self._fields["channels"])

    @property
    def t_s(self) -> List[float]:
        """Times since the plan's start [s], shape (n,)."""
        return list(self._fields["t_s"])

    @property
    def motion(self) -> List[List[float]]:
        """The motion, shape (n, 12): a row per time, a column per channel."""
        return list(self._fields["motion"])

    @property
    def sd(self) -> List[List[float]]:
        """Its standard deviations, shape (n, 12); empty = the coefficients carry no uncertainty."""
        return list(self._fields.get("sd", []))

    def _sentence(self) -> str:
        band = "with its band" if self.sd else "without a band"
        return f"{len(self.t_s)} times from {self.t_s[0]:g} to {self.t_s[-1]:g} s, {band}"


class Simulation(Result):
    """A simulated log, as ``hydroline simulate`` reports it."""

    @property
    def log(self) -> str:
        """The log that was written."""
        return str(self._fields["log"])

    @property
    def length_s(self) -> float:
        """Length of the run [s]."""
        return float(self._fields["length_s"])

    @property
    def messages(self) -> Dict[str, int]:
        """Messages written, by topic."""
        return dict(self._fields["messages"])

    def _sentence(self) -> str:
        return f"{self.log}, {self.length_s:g} s"


class Health(Result):
    """Whether a log is sound, as ``hydroline doctor`` prints it."""

    @property
    def sound(self) -> bool:
        """No finding is worse than a note."""
        return bool(self._fields["sound"])

    @property
    def messages(self) -> int:
        """Messages read."""
        return int(self._fields["messages"])

    @property
    def frames_lost(self) -> int:
        """Frames that were lost on the way into the log."""
        return int(self._fields["frames_lost"])

    @property
    def findings(self) -> List[Dict[str, Any]]:
        """What was found, each with its next step."""
        return list(self._fields["findings"])

    def _sentence(self) -> str:
        return "data is lost or damaged" if self.lossy else f"sound, {len(self.findings)} findings"


class Import(Result):
    """A table that became a log, as ``hydroline import`` reports it."""

    @property
    def samples(self) -> Optional[int]:
        """Motion samples written."""
        found: Optional[int] = self._fields["samples"]
        return found

    @property
    def commands(self) -> Optional[int]:
        """Commands written."""
        found: Optional[int] = self._fields["commands"]
        return found

    @property
    def findings(self) -> List[Dict[str, Any]]:
        """What was found in the table."""
        return list(self._fields["findings"])

    def _sentence(self) -> str:
        return f"{self.samples} motion samples, {self.commands} commands"


class BoardCalibration(Result):
    """A map from image to laser plane, as ``hydroline calibrate`` reports it."""

    @property
    def file(self) -> str:
        """The calibration file that was written."""
        return str(self._fields["calibration"])

    @property
    def accepted(self) -> bool:
        """Whether it meets its tolerance."""
        return bool(self._fields["accepted"])

    @property
    def nodes(self) -> int:
        """Nodes of the board that the map is made of."""
        return int(self._fields["nodes"])

    @property
    def rms_m(self) -> Tuple[float, float]:
        """Root mean square of the nodes' residuals in the laser plane [m], in xi and eta; NaN = there are none."""
        found = self._fields["residuals"]
        return (math.nan, math.nan) if found is None else (float(found["rms_xi_m"]), float(found["rms_eta_m"]))

    @property
    def worst_sd_m(self) -> Optional[float]:
        """Largest standard deviation of a plane coordinate over the board [m], the gap between board and sheet included."""
        found: Optional[float] = self._fields["worst_sd_m"]
        return found

    @property
    def tolerance_m(self) -> float:
        """Largest standard deviation that the rig allows [m]."""
        return float(self._fields["tolerance_m"])

    @property
    def claim(self) -> str:
        """What accuracy it claims, in words."""
        return str(self._fields["claim"])

    @property
    def against(self) -> List[Dict[str, Any]]:
        """Comparisons with other calibrations, and with the board's other poses."""
        return list(self._fields["against"])

    @property
    def missing(self) -> List[str]:
        """What is missing until it does, in words."""
        return list(self._fields["missing"])

    def _sentence(self) -> str:
        return f"{self.file}, " + ("accepted" if self.accepted else "; ".join(self.missing))
