"""Runs the written FMU in FMPy beside our simulation: prints the largest relative distance."""

import json
import sys

import fmpy
import numpy as np
from fmpy.fmi3 import FMU3Slave
from fmpy.validation import validate_fmu

folder = sys.argv[1]
case = json.load(open(folder + "/case.json"))
path = folder + "/model.fmu"
problems = validate_fmu(path)
assert not problems, problems
description = fmpy.read_model_description(path)
assert description.fmiVersion == "3.0", description.fmiVersion
thrusts = [v for v in description.modelVariables if v.causality == "input"]
outputs = [v for v in description.modelVariables if v.causality == "output"]
assert len(outputs) == 12

# Step by step: each thrust is set when its step begins.
unpacked = fmpy.extract(path)
slave = FMU3Slave(
    guid=description.guid,
    unzipDirectory=unpacked,
    modelIdentifier=description.coSimulation.modelIdentifier,
    instanceName="one",
)
slave.instantiate()
slave.enterInitializationMode(startTime=0.0)
slave.exitInitializationMode()
rows = []
for k, thrust in enumerate(case["thrust_n"]):
    if k % 10 == 0:
        rows.append(slave.getFloat64([v.valueReference for v in outputs]))
    slave.setFloat64([v.valueReference for v in thrusts], thrust)
    slave.doStep(currentCommunicationPoint=k * case["step_s"], communicationStepSize=case["step_s"])
slave.terminate()
slave.freeInstance()
ours, theirs = np.array(case["motion"]), np.array(rows)
assert ours.shape == theirs.shape, (ours.shape, theirs.shape)
size = np.maximum(np.abs(ours).max(axis=0), 1e-6)
print((np.abs(ours - theirs).max(axis=0) / size).max())

# As one calls it: a signal, and parameters that are set before the run.
rows = [(k * case["step_s"], *thrust) for k, thrust in enumerate(case["thrust_n"])]
signals = np.array(rows, dtype=[("time", float)] + [(v.name, float) for v in thrusts])
run = {"stop_time": rows[-1][0], "output_interval": case["step_s"], "input": signals}
plain = fmpy.simulate_fmu(path, **run)
slow = fmpy.simulate_fmu(path, start_values={"x_u": -500.0, "start_x": 1.0}, **run)
assert abs(slow["x"][0] - 1.0) < 1e-12 and np.ptp(slow["x"]) < np.ptp(plain["x"])
