# %% [markdown]
# # Does an effect of your own explain what the fit leaves?
#
# The residuals and the Jacobian of a calibration are arrays. Columns of your own stand beside them in a linear least
# squares problem. Here a virtual robot has a joint 2 that yields with the sine of its value, which the rigid fit does
# not know.

# %%
from pathlib import Path

import numpy as np

import kdl_calibration as kc

robot = kc.load_robot(Path("urdf") / "fanuc_r2000ic_165f.urdf")
rigid = {"priors": {"automatic": False}, "effects": {"automatic": False}, "diagnosis": {"try_readings": False}}
measured, truth = kc.simulate(robot, configurations=60, noise=3e-5, length_error=1e-3, angle_error=1e-3, seed=4)


def effect(q):
    """Motion of joint 2 per unit of the effect, (N,) for joint values (N, n)."""
    return np.sin(3.0 * q[:, 1])


# %% [markdown]
# The measured points of a robot that yields by 0.2 mrad: the same points, at other commanded joint values.

# %%
size = 2e-4  # [rad]
true_values = measured.joint_values
commanded = true_values.copy()
for _ in range(20):  # commanded + effect(commanded) = true
    commanded[:, 1] = true_values[:, 1] - size * effect(commanded)
place = {name: i for i, name in enumerate(measured.configurations)}
rows = measured.observations
of_row = np.array([place[name] for name in rows["configuration"]])
found = kc.calibrate(robot, kc.Measurements.from_arrays(commanded[of_row], rows["position"], targets=rows["target"],
                                                        configurations=rows["configuration"]), **rigid)  # fmt: skip
print(f"left out {found.accuracy.held_out.after.rms * 1e3:.3f} mm, noise {np.sqrt(3.0) * 3e-5 * 1e3:.3f} mm")

# %% [markdown]
# The column: the motion of each measured point by joint 2, in the measuring frame, times the effect.

# %%
poses, jacobians = found.arm.flange_jacobians(commanded)
targets = {target["name"]: np.array(target["position"]) for target in found.result["targets"]}
lever = np.einsum("nij,nj->ni", poses[of_row, :3, :3], np.array([targets[name] for name in rows["target"]]))
twist = jacobians[of_row][:, :, 1] * effect(commanded)[of_row, None]
motion = twist[:, :3] + np.cross(twist[:, 3:], lever)
column = (motion @ found.arm.base()[:3, :3].T).reshape(-1, 1)

# %% [markdown]
# Beside the columns of the fit. The points of a configuration share its misfit, so that their errors are gathered by
# configuration ("sandwich" estimate of the covariance, Liang and Zeger 1986).

# %%
J = np.hstack([found.jacobian.reshape(len(column), -1), column])
r = found.residuals["position"].reshape(-1)
scale = np.linalg.norm(J, axis=0)
step, *_ = np.linalg.lstsq(J / scale, r, rcond=None)
rest = r - J / scale @ step
bread = np.linalg.inv((J / scale).T @ (J / scale))
scores = np.array([(J / scale)[np.repeat(of_row, 3) == c].T @ rest[np.repeat(of_row, 3) == c] for c in range(60)])
covariance = bread @ scores.T @ scores @ bread
estimate, sigma = step[-1] / scale[-1], np.sqrt(covariance[-1, -1]) / scale[-1]
rms_before, rms_after = (np.sqrt(3.0 * np.mean(v**2)) * 1e3 for v in (r, rest))
print(f"effect {estimate * 1e3:.4f} +- {sigma * 1e3:.4f} mrad, true {size * 1e3:.4f}")
print(f"rms {rms_before:.3f} mm without it, {rms_after:.3f} mm with it")
