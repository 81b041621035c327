"""The same frames through OpenCV: blur + centre of gravity, and Steger. One core.

Called by benches/stripe_vs_opencv.rs with a folder that holds frames.json (name, width, height,
truth slope and row) and one raw file per frame; prints one JSON object with ms and errors.
"""
import json
import sys
import time
from pathlib import Path

import cv2
import numpy as np

REPEATS = 60


def blur_cog(image):
    """Gaussian blur of 2 px, brightest row, centre of gravity of +-6 rows above the background.

    Vectorised over columns: nothing in it loops in Python.
    """
    smooth = cv2.GaussianBlur(image, (0, 0), 2.0)
    top = smooth.argmax(axis=0)
    rows = np.clip(top[None, :] + np.arange(-6, 7)[:, None], 0, image.shape[0] - 1)
    values = np.take_along_axis(image, rows, axis=0).astype(np.float32)
    values = np.maximum(values - np.minimum(values[0], values[-1]), 0.0)
    weight = values.sum(axis=0)
    return np.where(weight > 0, (values * rows).sum(axis=0) / np.maximum(weight, 1e-6), np.nan)


def steger(image, sigma=2.0):
    """Steger 1998: Hessian ridge, sub-pixel along the normal, brightest ridge point per column."""
    smooth = cv2.GaussianBlur(image.astype(np.float32), (0, 0), sigma)
    gx = cv2.Sobel(smooth, cv2.CV_32F, 1, 0, ksize=3, scale=1 / 8)
    gy = cv2.Sobel(smooth, cv2.CV_32F, 0, 1, ksize=3, scale=1 / 8)
    gxx = cv2.Sobel(smooth, cv2.CV_32F, 2, 0, ksize=3, scale=1 / 4)
    gyy = cv2.Sobel(smooth, cv2.CV_32F, 0, 2, ksize=3, scale=1 / 4)
    gxy = cv2.Sobel(smooth, cv2.CV_32F, 1, 1, ksize=3, scale=1 / 4)
    columns = np.arange(image.shape[1])
    top = gyy.argmin(axis=0)
    pick = lambda a: a[top, columns]
    hxx, hyy, hxy, dx, dy = map(pick, (gxx, gyy, gxy, gx, gy))
    # Normal = eigenvector of the eigenvalue of larger size.
    half = 0.5 * (hxx - hyy)
    root = np.sqrt(half * half + hxy * hxy)
    value = 0.5 * (hxx + hyy) - root
    nx, ny = hxy, value - hxx
    length = np.maximum(np.hypot(nx, ny), 1e-9)
    nx, ny = nx / length, ny / length
    flat = np.abs(hxy) < 1e-6
    nx, ny = np.where(flat, 0.0, nx), np.where(flat, 1.0, ny)
    t = -(dx * nx + dy * ny) / (hxx * nx * nx + 2 * hxy * nx * ny + hyy * ny * ny)
    # From the foot point on the ridge back to this column, along the ridge.
    with np.errstate(divide="ignore", invalid="ignore"):
        row = top + t * ny + (t * nx) * (nx / ny)
    return row


def timed(function, image):
    function(image)
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        rows = function(image)
        times.append(time.perf_counter() - start)
    return rows, 1e3 * min(times), 1e3 * float(np.median(times))


def main():
    cv2.setNumThreads(1)
    folder = Path(sys.argv[1])
    out = {"opencv": cv2.__version__, "numpy": np.__version__, "results": []}
    for frame in json.loads((folder / "frames.json").read_text()):
        shape = (frame["height_px"], frame["width_px"])
        image = np.fromfile(folder / frame["file"], np.uint8).reshape(shape)
        truth = frame["row0_px"] + frame["slope"] * np.arange(shape[1])
        for method, function in (("blur + CoG", blur_cog), ("Steger", steger)):
            rows, best_ms, median_ms = timed(function, image)
            error = rows - truth
            error = error[np.isfinite(error)]
            out["results"].append({
                "frame": frame["name"], "method": method, "best_ms": best_ms, "median_ms": median_ms,
                "rms_px": float(np.sqrt(np.mean(error**2))), "bias_px": float(error.mean()),
                "columns": int(error.size),
            })
    print(json.dumps(out))


main()
