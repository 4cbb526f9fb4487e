"""Plots of a calibration. They need matplotlib and return its axes, to be changed or saved."""

import numpy as np


def _axes(axes, **options):
    if axes is not None:
        return axes
    import matplotlib.pyplot as pyplot  # optional

    return pyplot.subplots(**options)[1]


def plot_residuals(found, axes=None):
    """Length of each position residual [mm] by row; test rows are hollow."""
    rows = found.residuals
    axes = _axes(axes)
    length = np.linalg.norm(rows["position"], axis=1) * 1e3
    index = np.arange(len(rows))
    for target in dict.fromkeys(rows["target"]):
        chosen = (rows["target"] == target) & ~rows["test"]
        (points,) = axes.plot(index[chosen], length[chosen], "o", markersize=4, label=target)
        chosen = (rows["target"] == target) & rows["test"]
        axes.plot(index[chosen], length[chosen], "o", markersize=4, fillstyle="none", color=points.get_color())
    axes.set_xlabel("row")
    axes.set_ylabel("residual [mm]")
    axes.set_ylim(bottom=0.0)
    axes.legend(title="target")
    return axes


def plot_workspace(found, axes=None):
    """Measured places of the flange in the base frame [m]: height over radius, by the largest residual [mm] there."""
    rows = found.residuals
    measurements = found.measurements
    axes = _axes(axes)
    flange = found.flange_poses(measurements.joint_values)[:, :3, 3]
    length = np.linalg.norm(rows["position"], axis=1) * 1e3
    place = {name: i for i, name in enumerate(measurements.configurations)}
    largest = np.zeros(len(flange))
    np.maximum.at(largest, [place[name] for name in rows["configuration"]], length)
    radius = np.hypot(flange[:, 0], flange[:, 1])
    points = axes.scatter(radius, flange[:, 2], c=largest, cmap="viridis")
    axes.figure.colorbar(points, ax=axes, label="largest residual [mm]")
    axes.set_xlabel("radius of the flange [m]")
    axes.set_ylabel("height of the flange [m]")
    axes.set_aspect("equal", adjustable="datalim")
    return axes


def plot_convergence(found, axes=None):
    """RMS residual [mm] before each iteration of the fit."""
    history = np.array(found.result["history"])
    axes = _axes(axes)
    axes.semilogy(np.arange(len(history)), history * 1e3, "o-")
    axes.set_xlabel("iteration")
    axes.set_ylabel("rms residual [mm]")
    return axes
