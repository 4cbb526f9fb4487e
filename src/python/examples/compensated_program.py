# %% [markdown]
# # From a file of measurements to a compensated program
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
# A program of the controller, as offline programming writes it: a seam of 250 mm.

# %%
point = """P[{number}]{{
   GP1:
\tUF : 0, UT : 0,\t\tCONFIG : 'N U T, 0, 0, 0',
\tX =  1850.000  mm,\tY =  {y:8.3f}  mm,\tZ =   900.000  mm,
\tW =   180.000 deg,\tP =   -60.000 deg,\tR =    10.000 deg
}};
"""
seam = [(number, 50.0 * number) for number in range(1, 7)]
motions = "".join(f"   {number}:{'J' if number == 1 else 'L'} P[{number}] 100{'%' if number == 1 else 'mm/sec'} FINE ;\n"
                  for number, _ in seam)
points = "".join(point.format(number=number, y=y) for number, y in seam)
Path("seam.ls").write_text(f"/PROG  SEAM\n/MN\n{motions}/POS\n{points}/END\n")

# %% [markdown]
# The same program with other numbers: the real robot is at its points where the nominal one would be.

# %%
program = kc.compensate_program(found, "seam.ls", controller=urdf / "fanuc_r2000ic_165f_controller.json")
at = program.positions
print(f"the points move by up to {at['displacement'].max() * 1e3:.2f} mm, rounding by {program.rounding * 1e3:.4f} mm")
for line in [*program.warnings, *program.paths]:
    print(line)
program.save("SEAM_C.LS", overwrite=True)
program

# %% [markdown]
# Where the robot goes with the new program, seen by the calibration, and how well that is known.

# %%
nominal = kc.Compensator(found).nominal_poses(at["asked"])[:, :3, 3]
before = np.linalg.norm(found.flange_poses(at["asked"])[:, :3, 3] - nominal, axis=1)
after = np.linalg.norm(found.flange_poses(at["joint_values"])[:, :3, 3] - nominal, axis=1)
print(f"off by up to {before.max() * 1e3:.2f} mm before, {after.max() * 1e3:.4f} mm after")
known = found.predict(at["joint_values"], "A")
print(f"a new measurement of A lies within {known.radius_95.max() * 1e3:.3f} mm with 95 %")
print(f"{known.outside.sum()} of {len(at)} points are outside the measured region")
found.save("result.json")
