"""Logs of tank runs as tables, and hydroline's commands as functions.

A thin layer over the program: nothing is computed here, and what a function returns is what the command line prints
with ``--json``. Units are SI and stand in the names (``x_m``, ``thrust_n``, ``timestamp_ns``); poses are in the tank
frame with z down and the floor at 0, velocities in the body frame.

>>> import hydroline
>>> rig = hydroline.Rig.load("lshpi")
>>> run = hydroline.simulate(rig=rig, plan="surge-4n", motion_only=True, out=folder / "first.mcap")
>>> log = hydroline.read(run.log)
>>> log.motion
<hydroline.Table: ... rows, 30 columns>
"""

from __future__ import annotations

from ._call import PathLike
from ._commands import calibrate, diagnose, doctor, identify, import_table, predict, simulate
from ._errors import ArgumentError, Error, InputError, LossyWarning, RunError
from ._extract import extract
from ._hydroline import Calibration, Frame, Frames, Log, Plan, Profile, Rig, Table, __version__
from ._result import Result
from ._results import (
    BoardCalibration,
    Diagnosis,
    Estimate,
    Health,
    Identification,
    Import,
    Prediction,
    Simulation,
)

__all__ = [
    "ArgumentError",
    "BoardCalibration",
    "Calibration",
    "Diagnosis",
    "Error",
    "Estimate",
    "Frame",
    "Frames",
    "Health",
    "Identification",
    "Import",
    "InputError",
    "Log",
    "LossyWarning",
    "Plan",
    "Prediction",
    "Profile",
    "Result",
    "Rig",
    "RunError",
    "Simulation",
    "Table",
    "__version__",
    "calibrate",
    "diagnose",
    "doctor",
    "extract",
    "identify",
    "import_table",
    "predict",
    "read",
    "simulate",
]


def read(log: PathLike) -> Log:
    """Opens a log (.mcap). Tables and frames are read when they are asked for; chunks without them are skipped.

    Of the result:

    - ``motion``, ``truth``, ``commands``, ``echoes``, ``stripes``, ``events``: tables that pandas, polars and pyarrow take
      (``pyarrow.table(log.motion)``, ``polars.DataFrame(log.motion)``), without a copy. ``motion`` has the pose in the tank
      frame [m, rad], its standard deviations and its covariance (6 x 6 of x y z phi theta psi, SI), and velocities in the
      body frame [m/s, rad/s]; NULL = not measured.
    - ``frames``: a sequence; ``frames[k].grey`` is a NumPy array of uint8, shape (height, width).
    - ``rig``, ``calibration``, ``session``: what its head says.

    Raises InputError for a file that is missing or no log, RunError for one that is damaged; a log whose end is missing
    is read up to there (``end_missing``).

    >>> read(reversals).commands.column_names[:4]
    ['timestamp_ns', 'sequence', 'thruster', 'thrust_n']
    """
    return Log(log)
