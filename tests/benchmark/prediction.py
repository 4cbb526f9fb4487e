"""Prints the time of 40,000 predictions on one thread as Google Benchmark prints it: of prediction.cpp from Python."""

import sys
import time

import numpy as np

import kdl_calibration as kc

robot = kc.load_robot(sys.argv[1])
measurements, _ = kc.simulate(robot)
found = kc.calibrate(robot, measurements)
q = np.random.default_rng(2).uniform(*robot.limits.T, (40_000, len(robot.joints)))
for _ in range(10):
    begin = time.perf_counter()
    found.predict(q, "A", threads=1)
    milliseconds = (time.perf_counter() - begin) * 1e3
    print(f"prediction_python {milliseconds:.3f} ms {milliseconds:.3f} ms 1")
