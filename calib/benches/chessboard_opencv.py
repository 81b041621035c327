"""OpenCV's findChessboardCornersSB on the images a bench wrote: one thread, CPU time.

Called by benches/detect_vs_opencv.rs with a folder that holds NAME.pgm and NAME.txt (true
corners, one "column row" per line); prints one line per image: name, found (0 or 1), mean
and least CPU ms, rms error per coordinate in px (nan where nothing was found).
"""
import sys
import time
from pathlib import Path

import cv2
import numpy as np

REPEATS = 20

cv2.setNumThreads(1)
print("version", cv2.__version__)
for path in sorted(Path(sys.argv[1]).glob("chessboard*.pgm")):
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    truth = np.loadtxt(path.with_suffix(".txt"))
    times = []
    for _ in range(REPEATS):
        start = time.process_time()
        found, corners = cv2.findChessboardCornersSB(image, (14, 10))
        times.append(1e3 * (time.process_time() - start))
    rms = float("nan")
    if found:
        # Each corner against the nearest true one: the order of the corners is free.
        off = corners.reshape(-1, 1, 2) - truth[None]
        nearest = off[np.arange(len(off)), (off**2).sum(axis=2).argmin(axis=1)]
        rms = float(np.sqrt((nearest**2).mean()))
    print(path.stem, int(bool(found)), sum(times) / REPEATS, min(times), rms)
