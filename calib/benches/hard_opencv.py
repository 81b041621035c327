"""OpenCV's findChessboardCornersSB beside ours on difficult pictures.

`HARD=N HARD_OUT=DIR cargo test -p hydroline-calib --release --test hard -- --ignored` writes NNNN.pgm, NNNN.txt (true corners,
seen or not) and NNNN.ours (ours); then `python hard_opencv.py DIR`: boards found by both, errors of both against the truth,
and ours against OpenCV's.
"""
import sys
from collections import defaultdict
from pathlib import Path

import cv2
import numpy as np


def nearest(some, others):
    off = some[:, None] - others[None]
    far = np.hypot(off[..., 0], off[..., 1])
    return far.min(axis=1)


def rms(values):
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else float("nan")


print("OpenCV", cv2.__version__)
rows = defaultdict(lambda: [0, 0, 0, [], [], []])
wrong = [0, 0]
for path in sorted(Path(sys.argv[1]).glob("*.pgm")):
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    head, *lines = path.with_suffix(".txt").read_text().splitlines()
    _, columns, board_rows, difficulty = head.split(maxsplit=3)
    truth = np.array([[float(v) for v in line.split()] for line in lines])
    seen = truth[:, 2] > 0
    if seen.sum() < 12 or 3 * seen.sum() < len(truth):
        continue
    text = path.with_suffix(".ours").read_text().split()
    ours = np.array([float(v) for v in text]).reshape(-1, 2)
    size = (int(columns), int(board_rows))
    flags = cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_NORMALIZE_IMAGE
    found, corners = cv2.findChessboardCornersSB(image, size, flags=flags)
    row = rows[difficulty]
    row[0] += 1
    row[1] += 2 * len(ours) >= seen.sum()
    row[2] += bool(found)
    if len(ours):
        off = nearest(ours, truth[:, :2])
        wrong[0] += int((off > 0.5).sum())
        row[3].extend(off)
    if found:
        corners = corners.reshape(-1, 2)
        off = nearest(corners, truth[:, :2])
        wrong[1] += int((off > 0.5).sum())
        row[4].extend(off)
        if len(ours):
            row[5].extend(nearest(ours, corners))
total = [0, 0, 0, [], [], []]
print("difficulty       boards  ours OpenCV  rms ours  rms OpenCV  between them rms, 99 %, px")
for name, row in sorted(rows.items()) + [("all", total)]:
    if name != "all":
        total = [a + b for a, b in zip(total, row)]
    else:
        row = total
    high = np.percentile(row[5], 99) if row[5] else float("nan")
    print(f"{name:16} {row[0]:6} {row[1]:5} {row[2]:6} {rms(row[3]):9.3f} {rms(row[4]):11.3f} {rms(row[5]):9.3f} {high:7.3f}")
print("corners more than 0.5 px off: ours", wrong[0], "OpenCV", wrong[1])
