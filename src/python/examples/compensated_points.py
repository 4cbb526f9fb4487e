# %% [markdown]
# # From a file of measurements to compensated points
#
# Run it in the root of the repository: the measurements of the example are in `urdf/examples`.

# %%
from pathlib import Path

import numpy as np

import kdl_calibration as kc

urdf = Path("urdf")
robot = kc.load_robot(urdf / "fanuc_r2000ic_165f.urdf")
pendant = kc.read_joint_convention(urdf / "fanuc_r2000ic_165f_pendant.json")
measurements = kc.read_measurements(robot, urdf / "examples" / "measurements.csv", pendant)
measurements

# %% [markdown]
# The calibration says whether it may be used. The number that counts is that of configurations which were left out.

# %%
found = kc.calibrate(robot, measurements)
for doubt in found.doubts:
    print(doubt.cause, doubt.message)
print(found.verdict, f"{found.accuracy.held_out.after.rms * 1e3:.3f} mm at configurations that were left out")
found

# %% [markdown]
# The largest errors in units of their uncertainty.

# %%
geometric = found.parameters[np.char.find(found.parameters["name"], ".") < 0]
geometric = geometric[geometric["std"] > 0.0]
order = np.argsort(-abs(geometric["error"]) / geometric["std"])
for row in geometric[order][:5]:
    print(f"{row['name']:5} {row['error'] * 1e3:8.4f} +- {row['std'] * 1e3:.4f} mm or mrad")

# %% [markdown]
# A program of the nominal robot: a straight line of the flange, as joint values. The compensated values bring the real
# robot there.

# %%
start, end = measurements.joint_values[0], measurements.joint_values[0] + [0.1, 0.05, 0.05, 0.0, 0.1, 0.0]
q = np.linspace(start, end, 50)
compensator = kc.Compensator(found)
compensated = compensator.solve(q)
before = np.linalg.norm(found.flange_poses(q)[:, :3, 3] - compensator.nominal_poses(q)[:, :3, 3], axis=1)
print(f"off by up to {before.max() * 1e3:.2f} mm before, {compensated.position_error.max() * 1e3:.6f} mm after")
if not (compensated.status == "exact").all():
    print("not exact:", np.flatnonzero(compensated.status != "exact"))

# %% [markdown]
# How well the points are known there, and whether they are where the robot was measured.

# %%
known = found.predict(compensated.joint_values, "A")
print(f"A new measurement of A lies within {known.radius_95.max() * 1e3:.3f} mm with 95 %.")
print(f"{known.outside.sum()} of {len(q)} points are outside the measured region.")

# %% [markdown]
# The values as the controller counts its joints, in degrees.

# %%
commands = np.degrees(np.linalg.solve(pendant.matrix, (compensated.joint_values - pendant.offset).T).T)
np.savetxt("commands.csv", commands, delimiter=",", header=",".join(pendant.controller_joints), comments="", fmt="%.6f")
found.save("result.json")
