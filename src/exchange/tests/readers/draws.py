"""Reads the written draws with NumPy: prints names, shape and the first row."""

import sys

import numpy as np

draws = np.load(sys.argv[1] + "/draws.npz")
print(",".join(draws["names"]), draws["values"].shape, draws["models"].tolist(), draws["values"][0].tolist())
