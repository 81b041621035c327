"""The commands as functions. Written by src/python/generate from the command line's definition: do not edit."""

# fmt: off
from __future__ import annotations

import datetime
from typing import Literal, Optional, Sequence, Union

from ._call import PathLike, Paths, PlanLike, Progress, RigLike, call
from ._results import BoardCalibration, Diagnosis, Health, Identification, Import, Prediction, Simulation

#: A length of time or a time, as the command line writes it ("30s", "2026-05-04T09:30:00Z"), in seconds, or an object.
Time = Union[str, float, datetime.timedelta, datetime.datetime]

__all__ = ["simulate", "predict", "identify", "diagnose", "doctor", "import_table", "calibrate"]


def simulate(
    *,
    rig: RigLike,
    plan: PlanLike,
    out: PathLike,
    seed: Optional[int] = None,
    motion_only: bool = False,
    position_noise_m: float = 0.00015,
    attitude_noise_rad: float = 0.000175,
    tail: Time = "0s",
    show_board: Optional[str] = None,
    board_offset_m: float = 0.0,
    note: Optional[str] = None,
    tank: Optional[RigLike] = None,
    draw: Optional[int] = None,
    draw_from: Optional[PathLike] = None,
    draw_seed: int = 1,
    start: Optional[int] = None,
    progress: Progress = None,
) -> Simulation:
    """A plan rendered without hardware: same seed, same bytes.

    The arguments are those of ``hydroline simulate``, and so is the result: ``to_dict()`` is what it prints with
    ``--json``. The GIL is released; Ctrl-C ends it within a second.

    rig: Rig file or built-in name
    plan: Plan file or built-in name
    out: Log to write
    seed: Seed of all noise; without it the rig's
    motion_only: Measured motion with white noise instead of images
    position_noise_m: With --motion-only: noise of the position, standard deviation [m]
    attitude_noise_rad: With --motion-only: noise of the attitude, standard deviation [rad]
    tail: Goes on after the plan's last step (coasting)
    show_board: Calibration board standing in the sheet instead of the tank, file or built-in name
    board_offset_m: With --show-board: its face stands so far behind the sheet [m]; negative = in front
    note: Free text for the log
    tank: Simulates the vehicle of this rig, with its thrusters' curves and [[physics]]; the log names --rig only
    draw: Simulates draw N of the rig's uncertainty (1 is the first row of `model --draws`); the log names --rig
        only
    draw_from: With --draw: what identify --json or diagnose --json printed, in place of the rig's [identified]
    draw_seed: With --draw: seed of the draws, as that of `model --draws`
    start: The log's first second, e.g. 2026-05-04T09:30:00Z; default: 2020-09-13T12:26:40Z
    progress: a function of (stage, done, of), a tqdm bar or its class

    Raises ArgumentError, InputError (what was given) or RunError (the work).

    >>> run = simulate(rig="lshpi", plan="surge-4n", motion_only=True, out=folder / "simulated.mcap")
    >>> run
    <hydroline.Simulation: ...simulated.mcap, 15.42 s>
    >>> read(run.log).motion["x_m"].shape
    (...,)
    """
    return Simulation(call("simulate", "simulate", {"rig": rig, "plan": plan, "out": out, "seed": seed, "motion_only": motion_only, "position_noise_m": position_noise_m, "attitude_noise_rad": attitude_noise_rad, "tail": tail, "show_board": show_board, "board_offset_m": board_offset_m, "note": note, "tank": tank, "draw": draw, "draw_from": draw_from, "draw_seed": draw_seed, "start": start}, progress))


def predict(
    *,
    plan: PlanLike,
    rig: Optional[RigLike] = None,
    identified: Optional[PathLike] = None,
    rate: float = 25.0,
    tail: float = 0.0,
    measured: Optional[PathLike] = None,
    other_rig: bool = False,
    report: Optional[PathLike] = None,
    force: bool = False,
    progress: Progress = None,
) -> Prediction:
    """The motion a plan will make, with its band.

    The arguments are those of ``hydroline predict``, and so is the result: ``to_dict()`` is what it prints with
    ``--json``. The GIL is released; Ctrl-C ends it within a second.

    plan: Plan file or built-in name
    rig: Rig file or built-in name. Without it the rig that the log of --measured carries
    identified: Output of `identify --json`: its coefficients replace the rig's, its covariance makes the band (a
        rig that `identify --write-rig` wrote has both in it)
    rate: Rows per second
    tail: Goes on for this long after the plan's last step (coasting) [s]
    measured: A measured run of the plan: a log with /vehicle/motion (hydroline replay makes it from images),
        compared with the prediction: rms residual of each DOF, and its motion in the report's figures. LOG@9..34 is
        a window of one
    other_rig: Takes a log whose own rig is another vehicle (name, mass or thrusters)
    report: Writes DIR/predict.html (the report) and predict.svg (its figures)
    force: Replaces result files that are there already (logs are never replaced)
    progress: a function of (stage, done, of), a tqdm bar or its class

    Raises ArgumentError, InputError (what was given) or RunError (the work).

    >>> predict(rig="lshpi", plan="surge-4n", rate=10)
    <hydroline.Prediction: ... times from 0 to ... s, without a band>
    """
    return Prediction(call("predict", "predict", {"plan": plan, "rig": rig, "identified": identified, "rate": rate, "tail": tail, "measured": measured, "other_rig": other_rig, "report": report, "force": force}, progress))


def identify(
    logs: Paths = (),
    *,
    rig: Optional[RigLike] = None,
    model: str = "auto",
    fix: Union[str, Sequence[str]] = (),
    from_rest: bool = False,
    from_: float = 0.0,
    to: Optional[float] = None,
    flat_priors: bool = False,
    bollard: Optional[PathLike] = None,
    write_rig: Optional[PathLike] = None,
    still: Optional[PathLike] = None,
    other_rig: bool = False,
    fail_on: Union[Literal["misfit"], Sequence[Literal["misfit"]]] = (),
    report: Optional[PathLike] = None,
    force: bool = False,
    progress: Progress = None,
) -> Identification:
    """Hydrodynamic coefficients with their uncertainty.

    The arguments are those of ``hydroline identify``, and so is the result: ``to_dict()`` is what it prints with
    ``--json``. The GIL is released; Ctrl-C ends it within a second.

    logs: Logs, all of the same vehicle, folders of logs, or names with * or ? in quotes; LOG@9..34 is a window of
        one, in seconds since its first stamp
    rig: Rig file or built-in name: mass, inertia, thrusters, and the priors of the coefficients. Without it the rig
        that the logs carry, where all carry the same
    model: surge .. yaw (one DOF), coupled (the rig's model, all DOFs measured), or auto
    fix: Coefficient to keep as the rig has it, e.g. k_pp (repeatable)
    from_rest: Every run starts at rest: initial velocities are known
    from_: Only motion from this time of each log on [s]
    to: Only motion up to this time of each log [s]
    flat_priors: Maximum likelihood: priors of coefficients and starts say nothing; what the runs do not determine
        is held at the rig's value
    bollard: Readings of a bollard pull (pulse_us,thrust_n[,voltage_v]): fits the thrusters' curve, and uses it for
        the logs given, which makes the thrust scale identifiable
    write_rig: Writes the rig with what was found: coefficients that the runs determine, with their covariance
        ([identified], of the whole budget; predict makes its band of it), and the curve of a bollard pull with its
        covariance ([bollard]; later fits carry it in their budgets). What was not determined keeps the rig's value
        with its uncertainty, and is named. A new curve ends the [identified] of the old one
    still: A log of the plan `still` (>= 20 s at rest): its noise is the least that is looked for in the others.
        LOG@0..30 is a window of one
    other_rig: Takes logs whose own rig is another vehicle (name, mass or thrusters): after a change to the rig file
        that is right for these logs too
    fail_on: Ends with exit code 1 when the result holds this (several with commas), for scripts (misfit)
    report: Writes DIR/identify.html
    force: Replaces result files that are there already (logs are never replaced)
    progress: a function of (stage, done, of), a tqdm bar or its class

    Raises ArgumentError, InputError (what was given) or RunError (the work).

    >>> found = identify([reversals, coast_down], rig="lshpi")
    >>> found.model
    'surge'
    >>> found.parameters["x_udot"].unit
    'kg'
    """
    return Identification(call("identify", "identify", {"logs": logs, "rig": rig, "model": model, "fix": fix, "from_rest": from_rest, "from_": from_, "to": to, "flat_priors": flat_priors, "bollard": bollard, "write_rig": write_rig, "still": still, "other_rig": other_rig, "fail_on": fail_on, "report": report, "force": force}, progress))


def diagnose(
    logs: Paths,
    *,
    rig: Optional[RigLike] = None,
    hold_out: Paths = (),
    other_rig: bool = False,
    accept_faults: bool = False,
    given: Union[str, Sequence[str]] = (),
    fail_on: Union[Literal["misfit"], Sequence[Literal["misfit"]]] = (),
    time_limit: Time = "120s",
    report: Optional[PathLike] = None,
    write_rig: Optional[PathLike] = None,
    force: bool = False,
    progress: Progress = None,
) -> Diagnosis:
    """Physics that the model left out, and proof.

    The arguments are those of ``hydroline diagnose``, and so is the result: ``to_dict()`` is what it prints with
    ``--json``. The GIL is released; Ctrl-C ends it within a second.

    logs: Logs to explain, all of the same vehicle, folders of logs, or names with * or ? in quotes; LOG@9..34 is a
        window of one, in seconds since its first stamp
    rig: Rig file or built-in name: the model that is asked what it left out. Without it the rig that the logs
        carry, where all carry the same
    hold_out: Log that is predicted and never fitted (repeatable): an effect that predicts it worse is in no model;
        without any, each run is predicted by the others. LOG@34..64 is a window of one
    other_rig: Takes logs whose own rig is another vehicle (name, mass or thrusters): after a change to the rig file
        that is right for these logs too
    accept_faults: Goes on although the data are at fault: what stands in the verdict then may be the fault's doing
    given: Degree of freedom whose measured motion is an input and not to be explained (surge, sway, heave, roll,
        pitch, yaw; repeatable, or with commas): a towed or steered hull, a carriage
    fail_on: Ends with exit code 1 when the result holds this (several with commas), for scripts (misfit)
    time_limit: Time after which a diagnosis ends with the verdict so far, marked so and with what was still open;
        none = it goes on to its end
    report: Writes DIR/diagnose.html (the report), before-after.svg (its figure), diagnose.json, and next.toml: the
        plan of the next experiment
    write_rig: Writes the rig with refitted coefficients and the [[physics]] that were left out
    force: Replaces result files that are there already (logs are never replaced)
    progress: a function of (stage, done, of), a tqdm bar or its class

    Raises ArgumentError, InputError (what was given) or RunError (the work).

    >>> found = diagnose([reversals, coast_down], rig="lshpi", given="sway", time_limit="none")
    >>> found.verdict in ("none", "named", "ambiguous", "unknown", "data_fault")
    True
    """
    return Diagnosis(call("diagnose", "diagnose", {"logs": logs, "rig": rig, "hold_out": hold_out, "other_rig": other_rig, "accept_faults": accept_faults, "given": given, "fail_on": fail_on, "time_limit": time_limit, "report": report, "write_rig": write_rig, "force": force}, progress))


def doctor(
    log: PathLike,
    *,
    progress: Progress = None,
) -> Health:
    """Is a log sound? Every finding with its next step.

    The arguments are those of ``hydroline doctor``, and so is the result: ``to_dict()`` is what it prints with
    ``--json``. The GIL is released; Ctrl-C ends it within a second.

    log: Log to look at
    progress: a function of (stage, done, of), a tqdm bar or its class

    Raises ArgumentError, InputError (what was given) or RunError (the work).

    >>> doctor(reversals)
    <hydroline.Health: sound, ... findings>
    """
    return Health(call("doctor", "doctor", {"logs": log}, progress))


def import_table(
    data: PathLike,
    *,
    map: Optional[PathLike] = None,
    out: Optional[PathLike] = None,
    topic: Union[str, Sequence[str]] = (),
    accept_faults: bool = False,
    rig: Optional[RigLike] = None,
    progress: Progress = None,
) -> Import:
    """Motion and commands recorded by something else, into a log.

    The arguments are those of ``hydroline import``, and so is the result: ``to_dict()`` is what it prints with
    ``--json``. The GIL is released; Ctrl-C ends it within a second.

    data: Table (CSV or text; - = standard input) or log of another program to import
    map: Map that says what its columns are
    out: Log to write
    topic: Of a log, only this topic (again for more): where fields without a topic are looked for, and what --guess
        looks at
    accept_faults: Imports what is sound although there are faults; what is left out is counted (exit code 3)
    rig: Rig file or built-in name: names and sizes of the commands are held against it, pulses go through its
        curves
    progress: a function of (stage, done, of), a tqdm bar or its class

    Raises ArgumentError, InputError (what was given) or RunError (the work).
    """
    return Import(call("import_table", "import", {"data": data, "map": map, "out": out, "topic": topic, "accept_faults": accept_faults, "rig": rig}, progress))


def calibrate(
    inputs: Paths,
    *,
    out: PathLike,
    board: Optional[str] = None,
    free: bool = False,
    intrinsics: Optional[PathLike] = None,
    method: str = "homography",
    rig: Optional[RigLike] = None,
    medium: Optional[str] = None,
    at: Optional[str] = None,
    port_distance_m: Optional[float] = None,
    port_glass_m: Optional[float] = None,
    accept_unknown_gap: bool = False,
    image_topic: Optional[str] = None,
    channel: Optional[str] = None,
    bits: Optional[int] = None,
    every: int = 1,
    against: Paths = (),
    annotate: Optional[PathLike] = None,
    force: bool = False,
    progress: Progress = None,
) -> BoardCalibration:
    """Images of a board become the map from image to laser plane.

    The arguments are those of ``hydroline calibrate``, and so is the result: ``to_dict()`` is what it prints with
    ``--json``. The GIL is released; Ctrl-C ends it within a second.

    inputs: Logs (.mcap), images (PNG of 8 or 16 bits, JPEG) of the board, or folders of them
    out: Calibration to write
    board: Board file or built-in name; default: the rig's [board]
    free: Boards held in the hand, the line across them: fits camera, port and laser sheet together
    intrinsics: For --free: camera that OpenCV or ROS (YAML), Kalibr or MATLAB (JSON) calibrated in air; taken as
        good to 0.3 %
    method: Map to fit
    rig: Rig file or built-in name: where the camera stands, thickness of the sheet, tolerance; default: the log's
    medium: Medium that the light went through: air, fresh or salt; default: what log or rig say
    at: Where the board's middle stood in the sheet [m], turned by [deg]; default: from the rig's mounts
    port_distance_m: For refractive and --free: entrance pupil to the port's inner face [m]; default: the rig's
        [port], else 0.03
    port_glass_m: For refractive and --free: thickness of the port [m]; default: the rig's [port], else 0.01
    accept_unknown_gap: Counts a board without gauge blocks as accepted; the claim stays withdrawn
    image_topic: Topic of the logs' images; default: /camera/image, else the only one with images (of ROS 2 or
        Foxglove)
    channel: Part of a colour image that is read: luma, or the laser's red, green or blue; default: the rig's
        laser.channel, else luma
    bits: Bits that samples of 16 really have, right-aligned (8 to 16); default: the rig's camera.bits, else 16
    every: Takes every N-th frame of a log
    against: Older calibration to compare with: drift, or another board or pose; may be repeated
    annotate: Writes the first image used with its nodes drawn in (green; red: not found)
    force: Replaces result files that are there already (logs are never replaced)
    progress: a function of (stage, done, of), a tqdm bar or its class

    Raises ArgumentError, InputError (what was given) or RunError (the work).
    """
    return BoardCalibration(call("calibrate", "calibrate", {"inputs": inputs, "out": out, "board": board, "free": free, "intrinsics": intrinsics, "method": method, "rig": rig, "medium": medium, "at": at, "port_distance_m": port_distance_m, "port_glass_m": port_glass_m, "accept_unknown_gap": accept_unknown_gap, "image_topic": image_topic, "channel": channel, "bits": bits, "every": every, "against": against, "annotate": annotate, "force": force}, progress))
