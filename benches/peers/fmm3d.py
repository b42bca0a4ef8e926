"""FMM3D through fmm3dpy: finds the largest eps that keeps a tolerance, and times it.

    fmm3d.py FOLDER TOLERANCE REPEATS

FOLDER holds points.f64 (N x 3), charges.f64 and exact.f64 (the sums at every ceil(N/1000)-th point).
Prints a line for each trial: eps, relative l2 error, 0, median seconds. FMM3D makes no plan.
"""

import sys
import time
from pathlib import Path

import fmm3dpy
import numpy as np

folder, tolerance, repeats = Path(sys.argv[1]), float(sys.argv[2]), int(sys.argv[3])
charges = np.fromfile(folder / "charges.f64")
points = np.asfortranarray(np.fromfile(folder / "points.f64").reshape(-1, 3).T)
exact = np.fromfile(folder / "exact.f64")
step = -(-len(charges) // 1000)

# It sums 1/(4 pi r), and delivers up to some 1,500 times less error than it is asked for.
for exponent in range(max(1, round(-np.log10(tolerance)) - 4), 15):
    eps, times = 10.0**-exponent, []
    while True:
        start = time.perf_counter()
        sums = fmm3dpy.lfmm3d(eps=eps, sources=points, charges=charges, pg=1).pot * (4 * np.pi)
        times.append(time.perf_counter() - start)
        error = np.linalg.norm(sums[::step] - exact) / np.linalg.norm(exact)
        kept = error <= tolerance
        if not kept or len(times) >= repeats:
            break
    print(f"{eps:e},{error:e},0,{sorted(times)[len(times) // 2]}", flush=True)
    if kept:
        break
