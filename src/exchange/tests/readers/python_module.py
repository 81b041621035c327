"""Integrates the written Python module beside our simulation: prints the largest relative distance."""

import importlib.util
import json
import sys

folder = sys.argv[1]
case = json.load(open(folder + "/case.json"))
spec = importlib.util.spec_from_file_location("model", folder + "/model.py")
model = importlib.util.module_from_spec(spec)
spec.loader.exec_module(model)

state, rows = list(model.START), []
for k, thrust in enumerate(case["thrust_n"]):
    if k % 10 == 0:
        rows.append(state[:12])
    state = model.step(k * case["step_s"], state, thrust, case["step_s"])
worst = 0.0
for c in range(12):
    ours = [row[c] for row in case["motion"]]
    size = max(max(map(abs, ours)), 1e-6)
    worst = max(worst, max(abs(a - b[c]) for a, b in zip(ours, rows)) / size)
# The curve: a pulse at a point, one between, one beyond.
points = model.CURVES[0]
assert model.thrust_of_pulse(0, points[1][0]) == points[1][1]
assert abs(model.thrust_of_pulse(0, 0.5 * (points[0][0] + points[1][0])) - 0.5 * (points[0][1] + points[1][1])) < 1e-12
assert model.thrust_of_pulse(0, 1e9) == points[-1][1]
print(worst)
