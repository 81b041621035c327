"""stripe_frames.py DIR: 640x480 colour PPMs of a green laser stripe, each with another tilt and noise."""
import math
import random
import sys

WIDTH, HEIGHT = 640, 480
SIGMA_PX, PEAK, NOISE_SD = 2.0, 170.0, 2.5


def frame(index: int) -> bytes:
    rng = random.Random(1000 + index)
    # A stripe that bends and tilts differently in every frame, so that frames cannot be mistaken for each other.
    slope, bend, middle = 0.06 * (index - 1), 18.0 + 6.0 * index, 200.0 + 35.0 * index
    row_of = [middle + slope * (u - WIDTH / 2) + bend * math.sin(u / 90.0 + index) for u in range(WIDTH)]
    noise = [int(rng.gauss(12.0, NOISE_SD)) for _ in range(8191)]        # prime length: no visible pattern
    out, k = bytearray(), 0
    for v in range(HEIGHT):
        for u in range(WIDTH):
            base = max(0, noise[k])
            k = (k + 1) % 8191
            d = v - row_of[u]
            light = PEAK * math.exp(-d * d / (2 * SIGMA_PX * SIGMA_PX)) if abs(d) < 12 else 0.0
            out += bytes((min(255, base + int(light * 0.15)), min(255, base + int(light)), min(255, base + int(light * 0.25))))
    return b"P6 %d %d 255\n" % (WIDTH, HEIGHT) + bytes(out)


for i in range(3):
    with open(f"{sys.argv[1]}/{i}.ppm", "wb") as f:
        f.write(frame(i))
