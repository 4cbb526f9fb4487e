# %% [markdown]
# # Do the stated uncertainties hold?
#
# Virtual robots with known errors are measured with noise and calibrated. The share of truths within the stated 95 %
# is counted, with the statistics written out here.

# %%
from pathlib import Path

import numpy as np

import kdl_calibration as kc

robot = kc.load_robot(Path("urdf") / "fanuc_r2000ic_165f.urdf")
noise = 3e-5  # [m] 1 sigma of each coordinate
runs = 40
random = np.random.default_rng(1)

# %% [markdown]
# Each run draws new errors, configurations and noise. The points to predict are measured once more, with the same
# noise: they are the test rows, which the fit does not see.

# %%
ratios = []
for seed in range(runs):
    measurements, _ = kc.simulate(robot, configurations=30, test_configurations=20, noise=noise, length_error=1e-3,
                                  angle_error=1e-3, seed=seed + 1)  # fmt: skip
    found = kc.calibrate(robot, measurements, priors={"automatic": False}, effects={"automatic": False},
                         diagnosis={"try_readings": False})  # fmt: skip
    rows = found.residuals
    place = {name: i for i, name in enumerate(measurements.configurations)}
    q = measurements.joint_values[[place[name] for name in rows["configuration"]]]
    for target in measurements.targets:
        new = rows["test"] & (rows["target"] == target)
        predicted = found.predict(q[new], target)
        ratio = np.linalg.norm(rows["position"][new], axis=1) / predicted.radius_95
        ratios.append(ratio[~predicted.outside])
ratios = np.concatenate(ratios)

# %% [markdown]
# The share within the radius, with the interval that chance leaves: runs are independent of each other, the points of
# one run are not.

# %%
coverage = (ratios <= 1.0).mean()
print(f"{coverage:.1%} of {len(ratios)} new points lie within their radius, expected 95 %")

# %% [markdown]
# The whitened residuals of the fitted rows have variance 1, less the share of the fitted parameters.

# %%
fitted = rows["whitened"][~rows["test"]]
freedom = 1.0 - len(found.estimated) / fitted.size
print(f"variance of the whitened residuals {fitted.var() / freedom:.2f}, expected 1")
