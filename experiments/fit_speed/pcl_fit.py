"""Fits by PCL, for a Python that has its binding; prints JSON.

`/usr/bin/python3 pcl_fit.py POINTS SIGMA RADIUS REPEATS`, where POINTS is a .npy file
of (n, 3) points in meters and RADIUS the true one. It needs NumPy and the binding
alone: Debian's package python3-pcl is built for an older NumPy than this package uses.
"""

import json
import sys
import time

import numpy as np
import pcl  # pyright: ignore[reportMissingImports]

NEIGHBORS = 50
"""Points from which PCL takes a normal."""

SAMPLES = 1000


def fit(points, sigma, radius):
    """Radius of the refined cylinder of the best sample; None where there is none."""
    cloud = pcl.PointCloud()
    cloud.from_array(points)
    search = cloud.make_segmenter_normals(ksearch=NEIGHBORS)
    search.set_optimize_coefficients(True)
    search.set_model_type(pcl.SACMODEL_CYLINDER)
    search.set_method_type(pcl.SAC_RANSAC)
    search.set_normal_distance_weight(0.1)
    search.set_max_iterations(SAMPLES)
    search.set_distance_threshold(3 * sigma)
    search.set_radius_limits(0.0, 2 * radius)
    _, model = search.segment()
    # A point, the axis and the radius.
    return model[6] if len(model) == 7 else None


def main():
    """Fit once more than asked: the first call does not count."""
    path, sigma, radius, repeats = sys.argv[1:]
    points, ms, found = np.load(path).astype(np.float32), [], None
    for _ in range(int(repeats) + 1):
        start = time.perf_counter()
        found = fit(points, float(sigma), float(radius))
        ms.append(1e3 * (time.perf_counter() - start))
    print(json.dumps({"radius": found, "ms": ms[1:]}))


if __name__ == "__main__":
    main()
