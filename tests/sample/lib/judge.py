"""Two results of one case, number by number.

A number that has an sd beside it (`sd`, or `offset_sd_m` beside `offset_m`) is judged in units of the first result's; so are
the ends of its interval. An sd is
judged in units of itself, and so is a size that has no sd (rms, noise, effect size): 0.01 is then one per cent. Probabilities
and correlations are judged as they are. Everything else (evidences, counts, p-values, positions in a figure) is compared and
shown, and not judged: it has no sd to be measured by.
"""
from __future__ import annotations

import math
import re
from dataclasses import dataclass, field

LIMIT_SD = 0.01
# [value, sd] as a list: what `replay --refine` found, and the start values of an identification's runs.
PAIRS = {"thickness_m", "tilt_pitch_rad", "tilt_yaw_rad", "brightness"}
# Whatever stands below these is a size: its own unit.
SIZES = {"noise", "noise_rms", "weight", "rms", "rms_n", "rms_m", "max_m", "train", "held_out", "left_out", "fitted", "residuals"}
# Inside of them: what is none.
COUNTS = {"plain", "filtered", "at_rest", "outliers", "count", "lags", "nodes", "correlation_s"}
# Differences count as they are.
SHARES = {"probability", "correlation", "coverage", "coverage_parts", "sheet_share", "sheet_parts"}
# A verdict's tables that a word or an effect more or less makes longer: shown, not judged.
SHOWN = {"alternatives", "ladder", "next_experiment", "notes", "where", "test", "exponents", "unexplained", "sets_looked_at", "profile", "idle"}
# Statements: one more or one less is a change, whatever numbers their words hold.
STATED = {"misfit", "missing", "held"}
# By what the entries of a list are told apart.
NAMES = ("effect", "run", "name", "what", "slot", "fault", "channel")


@dataclass
class Worst:
    """The largest of something, and where."""
    size: float = 0.0
    where: str = ""

    def take(self, size: float, where: str) -> None:
        if size > self.size or math.isnan(size):
            self.size, self.where = (math.inf if math.isnan(size) else size), where


@dataclass
class Judged:
    """What a comparison found."""
    numbers: int = 0
    identical: int = 0
    measured: int = 0  # of the numbers, those that are judged
    judged: Worst = field(default_factory=Worst)
    shown: Worst = field(default_factory=Worst)
    # Judged things that are there in one result only, or of another kind; each fails.
    changed: list[str] = field(default_factory=list)
    # Words and lists that are others and are not judged.
    words: list[str] = field(default_factory=list)

    @property
    def passes(self) -> bool:
        return not self.changed and self.judged.size <= LIMIT_SD


def compare(stage: str, case: str, a: dict, b: dict, into: Judged) -> None:
    """Adds the comparison of a case's two results."""
    if stage == "verdicts":
        verdict(case, a, b, into)
    tree(a, b, case, None, into)


def number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def tree(a: object, b: object, where: str, scale: str | None, into: Judged) -> None:
    """`scale`: None = by the sd beside it, "size", "share" or "shown"."""
    if isinstance(a, dict) and isinstance(b, dict):
        branch(a, b, where, scale, into)
    elif isinstance(a, list) and isinstance(b, list):
        entries(a, b, where, scale, into)
    elif number(a) and number(b):
        leaf(float(a), float(b), where, scale, into)
    elif a != b:
        told = f"{where}: {short(a)}, {short(b)}"
        # A sentence holds rounded numbers, a digest all of them: what they say is judged where it stands as a number.
        plain = isinstance(a, str) and isinstance(b, str)
        (into.words if plain or scale == "shown" else into.changed).append(told)


def by_kind(found: dict) -> dict:
    """Frames are counted by a sentence, whose numbers 4042f4f left out: without them the same reason is the same key."""
    return {re.sub(r"[0-9.]+", "", key): value for key, value in found.items()}


def branch(a: dict, b: dict, where: str, scale: str | None, into: Judged) -> None:
    if where.endswith((" without_pose", " without_stripe")):
        a, b = by_kind(a), by_kind(b)
    sd = a.get("sd") if number(a.get("value")) else None
    for key in sorted(a.keys() | b.keys()):
        here = f"{where} {key}"
        if key not in a or key not in b:
            lacking = f"{here}: only in the {'second' if key not in a else 'first'}"
            # A later build may say more; what it no longer says is a change.
            said = scale == "shown" or key.startswith("~") or key not in a
            (into.words if said else into.changed).append(lacking)
            continue
        own = sd if key in ("value", "low", "high") else a.get(sd_name(key))
        if scale != "shown" and number(own) and own > 0 and number(a[key]) and number(b[key]):
            count(float(a[key]), float(b[key]), abs(b[key] - a[key]) / own, here, into)
            continue
        below = scale
        if scale != "shown":
            if key in SHOWN or key in COUNTS:
                below = "shown"
            elif key in SIZES or "sd" in key.split("_"):
                below = "size"
            elif key in SHARES:
                below = "share"
        if scale != "shown" and (key in PAIRS or where.endswith(" start")) and pair(a[key]) and pair(b[key]):
            branch(dict(zip(("value", "sd"), a[key])), dict(zip(("value", "sd"), b[key])), here, None, into)
            continue
        tree(a[key], b[key], here, below, into)


def sd_name(key: str) -> str:
    """offset_m -> offset_sd_m, whose unit stands last too."""
    name, _, unit = key.rpartition("_")
    return f"{name}_sd_{unit}"


def pair(value: object) -> bool:
    return isinstance(value, list) and len(value) == 2


def entries(a: list, b: list, where: str, scale: str | None, into: Judged) -> None:
    named = all(isinstance(e, dict) and any(k in e for k in NAMES) for e in a + b)
    if named:
        tree(by_name(a), by_name(b), where, scale, into)
    elif len(a) != len(b):
        words = all(isinstance(e, str) for e in a + b) and where.rsplit(" ", 1)[-1] not in STATED
        (into.words if words or scale == "shown" else into.changed).append(f"{where}: {len(a)} entries, {len(b)}")
    else:
        for k, (x, y) in enumerate(zip(a, b)):
            tree(x, y, f"{where} {k}", scale, into)


def by_name(entries: list[dict]) -> dict:
    """A list as a dictionary. An effect that is not practically significant may be listed or not ("~")."""
    found: dict[str, dict] = {}
    for entry in entries:
        name = " ".join(str(entry[k]) for k in NAMES if isinstance(entry.get(k), str))
        name = f"~{name}" if entry.get("matters") is False else name
        while name in found:
            name += "'"
        found[name] = entry
    return found


def leaf(a: float, b: float, where: str, scale: str | None, into: Judged) -> None:
    off = abs(b - a)
    size = max(abs(a), abs(b))
    if scale == "share":
        count(a, b, off, where, into)
    elif scale == "size":
        count(a, b, off / size if size > 0 else 0.0, where, into)
    else:
        into.numbers += 1
        into.identical += a == b
        into.shown.take(off / size if size > 0 else 0.0, where)


def count(a: float, b: float, units: float, where: str, into: Judged) -> None:
    into.numbers += 1
    into.measured += 1
    into.identical += a == b
    into.judged.take(units, where)


def verdict(case: str, a: dict, b: dict, into: Judged) -> None:
    """The word, what matters, what cannot be told apart, and what is wrong with the data: none may change."""
    def of(v: dict) -> dict[str, object]:
        return {
            "verdict": v["verdict"],
            "effects that matter": sorted(e["effect"] for e in v["effects"] if e["matters"]),
            "equivalent models": sorted(sorted(s) for s in v["equivalent"]),
            "data faults": sorted([f["fault"], f["channel"], f["run"], f["fatal"]] for f in v["data_faults"]),
        }

    for name, was in of(a).items():
        now = of(b)[name]
        if was != now:
            into.changed.append(f"{case} {name}: {was}, {now}")
    for name in ("effects", "blind_spots"):
        was, now = ({e["effect"] if isinstance(e, dict) else e for e in v[name]} for v in (a, b))
        if was != now:
            into.words.append(f"{case} {name}: not in the second {sorted(was - now)}, only there {sorted(now - was)}")


def short(value: object) -> str:
    text = str(value)
    return text if len(text) <= 60 else text[:57] + "..."


def inputs_differ(a: dict[str, dict[str, str]], b: dict[str, dict[str, str]]) -> list[str]:
    """Where two sets of inputs do not hold the same messages: `log topic: this, that`."""
    found = []
    for log in sorted(a.keys() | b.keys()):
        old, new = a.get(log, {}), b.get(log, {})
        topics = sorted(t for t in old.keys() | new.keys() if old.get(t) != new.get(t))
        found += [f"{log} {t}: {old.get(t, 'none')}, {new.get(t, 'none')}" for t in topics]
    return found
