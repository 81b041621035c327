"""Writes calib/src/charuco/dictionaries.txt: the bits of OpenCV's predefined dictionaries.

`pip install opencv-python numpy; python calib/benches/dictionaries.py > calib/src/charuco/dictionaries.txt`
"""
import textwrap

import cv2
import numpy as np

aruco = cv2.aruco
print(f"# Markers of OpenCV {cv2.__version__}, opencv/modules/objdetect/src/aruco/predefined_dictionaries.hpp, by its Python package.")
print("# Copyright of the OpenCV team and contributors, Apache License 2.0 (https://opencv.org/license).")
print("# Written by calib/benches/dictionaries.py. One number a marker, in order of the ids: its bits as printed, row by row from the")
print("# upper left, highest first, 1 = light.")
for side in (4, 5, 6, 7):
    codes = []
    most = aruco.getPredefinedDictionary(getattr(aruco, f"DICT_{side}X{side}_1000"))
    for k in range(1000):
        image = most.generateImageMarker(k, side + 2, borderBits=1)
        assert (image[[0, -1]] == 0).all() and (image[:, [0, -1]] == 0).all()
        bits = (image[1:-1, 1:-1] > 127).astype(int).ravel()
        codes.append(int("".join(map(str, bits)), 2))
    for fewer in (50, 100, 250):
        other = aruco.getPredefinedDictionary(getattr(aruco, f"DICT_{side}X{side}_{fewer}"))
        assert np.array_equal(other.bytesList, most.bytesList[:fewer]), (side, fewer)
    digits = -(-side * side // 4)
    print(f"side {side}")
    print("\n".join(textwrap.wrap(" ".join(f"{c:0{digits}x}" for c in codes), 130)))
