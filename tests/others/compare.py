#!/usr/bin/env python3
"""Other methods on the sealed cases: what they name beside what `hydroline prove` names.

    hydroline prove --cases 23 --seed 60611 --export CASES     # runs and what each candidate law does along them
    hydroline prove --cases 23 --seed 60611 --keep SHEETS      # the same cases, diagnosed
    pip install pysindy pyoperon numpy                         # into an environment of its own
    tests/others/compare.py CASES SHEETS [--minutes 1]

Each method gets the same candidate laws (columns of `laws-K.csv`: the acceleration that a law adds along the measured motion,
at typical numbers), the vehicle's own terms (load, u, u |u|) and at most `--minutes` a case:

- bic           forward and backward selection by the Bayesian information criterion (Schwarz 1978) on the smoothed
                acceleration at 5 Hz
- sindy         pysindy: sequentially thresholded least squares, 20 bags of samples, median (Fasel et al. 2022)
- sindy-weak    the same on integrals against bumps of 1.6 s (Messenger and Bortz 2021): no derivative of the measured position
- operon        pyoperon: symbolic regression of the acceleration by x, u, t and load, minimum description length; it names no
                law, only its prediction is judged

Judged for all alike: a law's weight is the rms that it adds to the position, what the vehicle's own terms can do taken out. A
case is right where every main law of at least the tolerance is named, and no other law is that weighs more than the tolerance
and a tenth of the heaviest that is there. Prediction: the last run held out, acceleration foretold along the measured motion,
what the foretold rate differs by fed back through its slope, integrated, two numbers of the start fitted. That is kinder than
hydroline's figure, which simulates from the command alone.
"""

import argparse
import csv
import json
import pathlib
import sys
import time
import warnings

import numpy as np

TOLERANCE_M = 0.5e-3
# Half width of a bump and its stride [s]: the vehicle's time constant is some seconds.
BUMP_S, STRIDE_S = 0.8, 0.2
# Rate at which the smoothed acceleration is sampled for BIC: neighbours at 25 Hz are one number.
BIC_HZ = 5.0
# Coefficients of a law in typical sizes below which it is cut: the one with the least information criterion is taken.
THRESHOLDS = (0.03, 0.1, 0.3, 1.0, 3.0)
BASE = ("load", "u", "u|u|")


def table(path):
    with open(path, newline="") as file:
        rows = list(csv.reader(file))
    return rows[0], np.array([[float(v) for v in row] for row in rows[1:]])


class Run:
    """One run: what was measured, the vehicle's own terms and the candidate laws along it."""

    def __init__(self, run, laws, names):
        head, data = table(run)
        column = {name: data[:, k] for k, name in enumerate(head)}
        self.t = column["t_s"]
        self.x, self.raw = column["smooth_x_m"], column["x_m"]
        self.u, self.a = column["smooth_u_mps"], column["smooth_d_u_mps2"]
        self.load = column["load_surge_n"]
        far = np.abs(self.raw - self.x) > 5 * 1.4826 * np.median(np.abs(self.raw - self.x))
        self.raw = np.where(far, self.x, self.raw)
        head, data = table(laws)
        law = {name: data[:, k] for k, name in enumerate(head)}
        none = np.zeros_like(self.t)
        self.base = np.stack([self.load / 250, self.u, self.u * np.abs(self.u)], axis=1)
        self.laws = np.stack([law.get(name, none) for name in names], axis=1)

    def features(self):
        return np.hstack([self.base, self.laws])


class Case:
    def __init__(self, folder):
        self.id = folder.name
        self.names = list(json.loads((folder / "laws.json").read_text()))
        self.runs = self.read(folder, "run", "laws")
        self.held = self.read(folder, "held", "held-laws")
        self.key = json.loads((folder.parent / "keys" / f"{folder.name}.json").read_text())

    def read(self, folder, run, laws):
        each = sorted(folder.glob(f"{run}-[0-9]*.csv"))
        return [Run(p, folder / f"{laws}-{p.stem.split('-')[-1]}.csv", self.names) for p in each]

    def truth(self):
        all_ = {t["effect"]: t["weight_m"] for t in self.key["truth"]}
        main = {t["effect"]: t["weight_m"] for t in self.key["truth"] if t["main"]}
        return all_, main


def weak(run):
    """Integrals against bumps: (of the acceleration by the raw position, of the features)."""
    left, right = [], []
    features = run.features()
    step = np.gradient(run.t)
    for centre in np.arange(run.t[0] + BUMP_S, run.t[-1] - BUMP_S, STRIDE_S):
        s = (run.t - centre) / BUMP_S
        inside = np.abs(s) < 1
        s, w = s[inside], step[inside]
        bump = (1 - s**2) ** 4
        curvature = (-8 * (1 - s**2) ** 3 + 48 * s**2 * (1 - s**2) ** 2) / BUMP_S**2
        # Of a bump on samples the curvature has a mean of its own; a place at rest has no acceleration.
        curvature = curvature - bump * (curvature @ w) / (bump @ w)
        left.append((curvature * w) @ run.raw[inside])
        right.append((bump * w) @ features[inside])
    return np.array(left), np.array(right)


def strong(run, hz=None):
    a, features = run.a, run.features()
    if hz is None:
        return a, features
    stamps = np.arange(run.t[0], run.t[-1], 1 / hz)
    columns = [np.interp(stamps, run.t, c) for c in features.T]
    return np.interp(stamps, run.t, a), np.stack(columns, axis=1)


def joined(parts):
    left, right = zip(*parts)
    return np.concatenate(left), np.vstack(right)


def solved(y, f, chosen):
    c = np.zeros(f.shape[1])
    if chosen:
        c[chosen] = np.linalg.lstsq(f[:, chosen], y, rcond=None)[0]
    return c


def bic(case):
    y, f = joined([strong(r, BIC_HZ) for r in case.runs])
    n = len(y)

    def score(chosen):
        left = y - f @ solved(y, f, chosen)
        return n * np.log(left @ left / n) + len(chosen) * np.log(n)

    acting = [k for k in range(f.shape[1]) if np.any(f[:, k])]
    chosen = list(range(len(BASE)))
    best = score(chosen)
    while True:
        moves = [chosen + [k] for k in acting if k not in chosen]
        moves += [[c for c in chosen if c != k] for k in chosen if k >= len(BASE)]
        made = min(((score(m), m) for m in moves), default=(np.inf, None))
        if made[0] >= best - 1e-9:
            return solved(y, f, chosen)
        best, chosen = made


def sindy(case, parts):
    import pysindy

    y, f = joined(parts)
    acting = np.flatnonzero(np.any(f != 0, axis=0))
    # A threshold counts in typical sizes of laws; the vehicle's own terms stay.
    unit = np.where(acting < len(BASE), 1e-6, 1.0)
    best = (np.inf, np.zeros(f.shape[1]))
    # Samples that say something of their own: a tenth of a bump or of the smoothing.
    n = max(len(y) / 10, len(acting) + 1)
    for threshold in THRESHOLDS:
        optimizer = pysindy.EnsembleOptimizer(
            pysindy.STLSQ(threshold=threshold, alpha=1e-9), bagging=True, n_models=20,
            ensemble_aggregator=lambda all_: np.median(all_, axis=0),
        )
        optimizer.fit(f[:, acting] * unit, y.reshape(-1, 1))
        found = np.array(optimizer.coef_).reshape(-1)
        chosen = sorted({*range(len(BASE)), *acting[found != 0]})
        c = solved(y, f, chosen)
        left = y - f @ c
        best = min(best, (n * np.log(left @ left / len(y)) + len(chosen) * np.log(n), c), key=lambda m: m[0])
    return best[1]


def operon(case, seconds):
    from pyoperon.sklearn import SymbolicRegressor

    def inputs(run):
        return np.stack([run.x, run.u, run.t - run.t[0], run.load], axis=1)

    y = np.concatenate([r.a[::5] for r in case.runs])
    f = np.vstack([inputs(r)[::5] for r in case.runs])
    made = SymbolicRegressor(
        allowed_symbols="add,sub,mul,div,constant,variable,sin,exp,tanh,abs", max_length=40, optimizer_iterations=5,
        max_time=int(seconds), random_state=1, generations=10**6, max_evaluations=10**9,
    )
    made.fit(f, y)

    def slope(run):
        step = 1e-4
        up = inputs(run)
        up[:, 1] += step
        return (made.predict(up) - made.predict(inputs(run))) / step

    return lambda run: made.predict(inputs(run)), slope


def response(run, a, drag):
    """Position that an acceleration adds to a hull with linear drag [1/s], from rest."""
    x = np.zeros_like(run.t)
    rate = 0.0
    for k in range(1, len(run.t)):
        step = run.t[k] - run.t[k - 1]
        rate += step * (0.5 * (a[k] + a[k - 1]) - drag * rate)
        x[k] = x[k - 1] + step * rate
    return x


def weights(case, c):
    """Weight of every law that is named [m]."""
    drag = max(-c[1], 0.02)
    made = {}
    own = np.vstack([
        np.stack([response(r, col, drag) for col in r.base.T] + [np.ones_like(r.t), r.t - r.t[0]], axis=1) for r in case.runs
    ])
    root = np.linalg.qr(own)[0]
    for k, name in enumerate(case.names):
        if c[len(BASE) + k] == 0:
            continue
        does = np.concatenate([response(r, c[len(BASE) + k] * r.laws[:, k], drag) for r in case.runs])
        left = does - root @ (root.T @ does)
        made[name.split(" ")[0]] = max(made.get(name.split(" ")[0], 0.0), float(np.sqrt(np.mean(left**2))))
    return made


def held_out(case, foretold, slope):
    """rms of the last run held out over its noise; `slope` = of the acceleration by the rate [1/s]."""
    run = case.held[-1]
    a, by_rate = foretold(run), np.clip(slope(run), -5, 0)
    if not (np.all(np.isfinite(a)) and np.all(np.isfinite(by_rate))):
        return float("inf")
    x, rate = np.zeros_like(run.t), run.u[0]
    for k in range(1, len(run.t)):
        step = run.t[k] - run.t[k - 1]
        rate += step * (a[k - 1] + by_rate[k - 1] * (rate - run.u[k - 1]))
        x[k] = x[k - 1] + step * rate
    start = np.stack([np.ones_like(run.t), run.t - run.t[0]], axis=1)
    left = run.raw - x
    left = left - start @ np.linalg.lstsq(start, left, rcond=None)[0]
    noise = np.sqrt(np.mean((run.raw - run.x) ** 2))
    return float(np.sqrt(np.mean(left**2)) / noise)


def right(case, named):
    all_, main = case.truth()
    there = all(named.get(e, 0.0) > 0 for e, w in main.items() if w > TOLERANCE_M)
    limit = max(TOLERANCE_M, 0.1 * max(main.values(), default=0.0))
    invented = [e for e, w in named.items() if e not in all_ and w > limit]
    return there, not invented


def ours(sheet):
    made = json.loads(sheet.read_text())
    made = made.get("judged", made)
    named = {f["effect"]: f["weight_m"] for f in made["found"]}
    held = made["held_out"]
    return named, held[1] / held[2] if held else float("nan"), made["word"]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", type=pathlib.Path, help="folder of `hydroline prove --export`")
    parser.add_argument("sheets", type=pathlib.Path, nargs="?", help="folder of `hydroline prove --keep`, same seed")
    parser.add_argument("--minutes", type=float, default=1.0, help="of symbolic regression per case (default 1)")
    asked = parser.parse_args()
    warnings.simplefilter("ignore")
    rows = []
    folders = sorted(p for p in asked.cases.iterdir() if (p / "laws.json").is_file())
    if not folders:
        sys.exit(f"{asked.cases}: no case here; `hydroline prove --cases 23 --seed S --export {asked.cases}` makes them")
    for folder in folders:
        # Faulty data are no question of laws; a law without a name is none of the candidates.
        if folder.name.split("-")[0] in ("fault", "unnamed"):
            continue
        case = Case(folder)
        if not case.runs or not case.held:
            continue
        ways = {
            "bic": lambda: bic(case),
            "sindy": lambda: sindy(case, [strong(r) for r in case.runs]),
            "sindy-weak": lambda: sindy(case, [weak(r) for r in case.runs]),
        }
        for way, run in ways.items():
            begin = time.time()
            c = run()
            named = weights(case, c)
            held = held_out(case, lambda r: r.features() @ c, lambda r: c[1] + 2 * c[2] * np.abs(r.u))
            rows.append((case.id, way, *right(case, named), held, time.time() - begin, sorted(named)))
        begin = time.time()
        rows.append((case.id, "operon", None, None, held_out(case, *operon(case, 60 * asked.minutes)), time.time() - begin, []))
        sheet = asked.sheets / f"{case.id}.json" if asked.sheets else None
        if sheet and sheet.is_file():
            named, held, word = ours(sheet)
            rows.append((case.id, "hydroline", *right(case, named), held, float("nan"), [word, *sorted(named)]))
        for row in rows:
            if row[0] == case.id:
                print(*row[:4], f"{row[4]:.2f} x noise, {row[5]:.0f} s", *row[6], flush=True)
    print(f"\n{'':11} {'named':>9} {'no other':>9} {'both':>9} {'held out <= 1.2 noise':>22} {'median':>7}")
    for way in ("hydroline", "bic", "sindy", "sindy-weak", "operon"):
        of = [r for r in rows if r[1] == way]
        if not of:
            continue
        share = lambda k: f"{sum(map(k, of))}/{len(of)}" if of[0][2] is not None else "-"
        held = np.array([r[4] for r in of])
        print(f"{way:11} {share(lambda r: r[2]):>9} {share(lambda r: r[3]):>9} {share(lambda r: r[2] and r[3]):>9} "
              f"{f'{int((held <= 1.2).sum())}/{len(of)}':>22} {np.nanmedian(held):7.2f}")


if __name__ == "__main__":
    main()
