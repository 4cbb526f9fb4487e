# %% [markdown]
# # Does an effect of your own explain what the fit leaves?
#
# A function of the joint values stands beside the built-in effects: its size is estimated with everything else, it is
# kept where it predicts unseen configurations better, and it is part of predictions and compensation. Here a virtual
# robot has a joint 2 that yields with the sine of three times its value.

# %%
from pathlib import Path

import numpy as np

import kdl_calibration as kc

robot = kc.load_robot(Path("urdf") / "fanuc_r2000ic_165f.urdf")
measured, truth = kc.simulate(robot, configurations=60, noise=3e-5, length_error=1e-3, angle_error=1e-3, seed=4)


def wave(q):
    """Motion of joint 2 [rad] per unit of the effect, (N,) for joint values (N, n). Several columns (N, K) may be."""
    return np.sin(3.0 * q[:, 1])


def is_of_no_use(q):
    return q[:, 0] * q[:, 5]


# %% [markdown]
# The measured points of a robot that yields by 0.2 mrad: the same points, at other commanded joint values.

# %%
size = 2e-4  # [rad]
true_values = measured.joint_values
commanded = true_values.copy()
for _ in range(20):  # commanded + effect(commanded) = true
    commanded[:, 1] = true_values[:, 1] - size * wave(commanded)
place = {name: i for i, name in enumerate(measured.configurations)}
rows = measured.observations
of_row = np.array([place[name] for name in rows["configuration"]])
m = kc.Measurements.from_arrays(commanded[of_row], rows["position"], targets=rows["target"],
                                configurations=rows["configuration"])  # fmt: skip

# %% [markdown]
# Candidates beside the built-in groups. Cross-validation and evidence choose.

# %%
own = {
    "wave": {"joint": "joint_2", "function": wave},
    "twist": {"joint": "joint_4", "axis": "x", "function": is_of_no_use},
}
found = kc.calibrate(robot, m, effects={"own": own})
rigid = kc.calibrate(robot, m, effects={"automatic": False})
left, left_rigid = (1e3 * c.accuracy.held_out.after.rms for c in (found, rigid))
print(f"left out: {left_rigid:.3f} mm without effects, {left:.3f} mm with them")
for term in found.result["effects"]["terms"]:
    print(f"{term['name']}: {term['coefficient'] / term['scale'] * 1e3:.4f} mrad")

# %% [markdown]
# With the choice made, or to force it: `automatic=False` takes those that are given.

# %%
forced = kc.calibrate(robot, m, effects={"own": {"wave": own["wave"]}, "automatic": False})
(term,) = forced.result["effects"]["terms"]
estimate, sigma = term["coefficient"] / term["scale"], term["std"] / term["scale"]
print(f"effect {estimate * 1e3:.4f} +- {sigma * 1e3:.4f} mrad, true {size * 1e3:.4f}")

# %% [markdown]
# The file names the effect; whoever reads it gives the function again.

# %%
forced.save("result.json")
again = kc.load("result.json", robot, own=forced.own)
assert np.allclose(again.predict(commanded, "A").position, forced.predict(commanded, "A").position, atol=1e-12)
