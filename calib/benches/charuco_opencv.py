"""OpenCV's CharucoDetector beside ours on difficult pictures.

`CHARUCO=N CHARUCO_OUT=DIR cargo test -p hydroline-calib --release --test charuco -- --ignored` writes NNNN.pgm, NNNN.txt (board;
ids and places of its corners, seen or not) and NNNN.ours (ours); then `python charuco_opencv.py DIR`: corners found by both,
whether both gave them the same id, errors of both against the truth, and ours against OpenCV's.
"""
import sys
from collections import defaultdict
from pathlib import Path

import cv2
import numpy as np


def rms(values):
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else float("nan")


print("OpenCV", cv2.__version__)
aruco = cv2.aruco
rows = defaultdict(lambda: [0, 0, 0, 0, 0, [], [], [], []])
wrong = [0, 0]
other_ids = 0
for path in sorted(Path(sys.argv[1]).glob("*.pgm")):
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    head, *lines = path.with_suffix(".txt").read_text().splitlines()
    _, columns, board_rows, dictionary, share, difficulty = head.split(maxsplit=5)
    truth = {int(k): tuple(map(float, v)) for k, *v in (line.split() for line in lines)}
    seen = sum(t[2] > 0 for t in truth.values())
    if seen < 12 or 3 * seen < len(truth):
        continue
    ours = {int(k): (float(x), float(y)) for k, x, y in map(str.split, path.with_suffix(".ours").read_text().splitlines())}
    names = aruco.getPredefinedDictionary(getattr(aruco, dictionary))
    board = aruco.CharucoBoard((int(columns) + 1, int(board_rows) + 1), 1.0, float(share), names)
    # As its own calibration tutorial asks for: the markers' corners refined to a fraction of a pixel.
    parameters = aruco.DetectorParameters()
    parameters.cornerRefinementMethod = aruco.CORNER_REFINE_SUBPIX
    detector = aruco.CharucoDetector(board, aruco.CharucoParameters(), parameters)
    corners, ids, _, _ = detector.detectBoard(image)
    theirs = {} if ids is None else {int(k): tuple(p) for k, p in zip(np.ravel(ids), np.reshape(corners, (-1, 2)))}
    row = rows[difficulty]
    row[0] += 1
    row[1] += 2 * len(ours) >= seen
    row[2] += 2 * len(theirs) >= seen
    row[3] += len(ours)
    row[4] += len(theirs)
    far = lambda k, p: float(np.hypot(p[0] - truth[k][0], p[1] - truth[k][1]))
    for k, found in enumerate((ours, theirs)):
        off = [far(i, p) for i, p in found.items()]
        wrong[k] += sum(o > 0.5 for o in off)
        row[5 + k].extend(off)
    for i, p in ours.items():
        if i in theirs:
            row[7].append(float(np.hypot(p[0] - theirs[i][0], p[1] - theirs[i][1])))
    # A corner of theirs within two pixels of one of ours has the same id.
    for i, p in theirs.items():
        near = [k for k, q in ours.items() if np.hypot(p[0] - q[0], p[1] - q[1]) < 2]
        other_ids += bool(near and near != [i])
total = [0, 0, 0, 0, 0, [], [], [], []]
print("difficulty       boards  ours OpenCV  corners of ours, OpenCV's  rms ours  rms OpenCV  between them median, 95 %, px")
for name, row in sorted(rows.items()) + [("all", total)]:
    if name != "all":
        total = [a + b for a, b in zip(total, row)]
    else:
        row = total
    middle, high = (np.percentile(row[7], q) if row[7] else float("nan") for q in (50, 95))
    print(f"{name:16} {row[0]:6} {row[1]:5} {row[2]:6} {row[3]:16} {row[4]:10} {rms(row[5]):9.3f} {rms(row[6]):11.3f} {middle:9.3f} {high:7.3f}")
print("corners more than 0.5 px off: ours", wrong[0], "OpenCV", wrong[1])
print("corners under another id than ours:", other_ids)
