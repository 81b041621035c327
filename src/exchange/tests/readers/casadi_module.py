"""Integrates the written CasADi function beside our simulation: prints the largest relative distance."""

import importlib.util
import json
import sys

import casadi as ca
import numpy as np

folder = sys.argv[1]
case = json.load(open(folder + "/case.json"))
spec = importlib.util.spec_from_file_location("model", folder + "/casadi_model.py")
model = importlib.util.module_from_spec(spec)
spec.loader.exec_module(model)

step = model.step(case["step_s"])
parameters = ca.DM(list(model.PARAMETERS.values()))
state, rows = ca.DM(list(model.START)), []
for k, thrust in enumerate(case["thrust_n"]):
    if k % 10 == 0:
        rows.append(np.array(state).ravel()[:12])
    state = step(k * case["step_s"], state, ca.DM(thrust), parameters)
ours, theirs = np.array(case["motion"]), np.array(rows)
size = np.maximum(np.abs(ours).max(axis=0), 1e-6)
print((np.abs(ours - theirs).max(axis=0) / size).max())
# What it is for: a sensitivity.
x, u, p = ca.SX.sym("x", len(model.STATES)), ca.SX.sym("u", len(model.THRUSTERS)), ca.SX.sym("p", len(model.PARAMETERS))
jacobian = ca.Function("j", [x, u, p], [ca.jacobian(model.f()(0.0, x, u, p), p)])
value = np.array(jacobian(ca.DM(rows[20].tolist() + [0.0] * (len(model.STATES) - 12)), ca.DM(case["thrust_n"][200]), parameters))
assert np.isfinite(value).all() and np.abs(value).max() > 0.0
