#!/usr/bin/env python3
"""OpenCV's findChessboardCornersSB on the images the bench wrote, one thread, CPU time.

    HYDROLINE_DUMP=/tmp/d cargo bench -p hydroline-calib --bench detect -- detection
    python -m venv v && v/bin/pip install opencv-python-headless && v/bin/python opencv.py /tmp/d
"""
import glob, statistics, sys, time
import cv2

cv2.setNumThreads(1)
for path in sorted(glob.glob(sys.argv[1] + "/chessboard-*.pgm")):
    image = cv2.imread(path, cv2.IMREAD_GRAYSCALE)
    times = []
    for _ in range(20):
        start = time.process_time()
        found, corners = cv2.findChessboardCornersSB(image, (14, 10))
        times.append(1e3 * (time.process_time() - start))
    print(f"{path}: found {found}, median {statistics.median(times):.1f} ms, fastest {min(times):.1f} ms")
