"""What the tests of the Python package share. CTest states the program kdlcal and the folder of the URDFs."""

import os
from pathlib import Path

import numpy as np
import pytest

import kdl_calibration as kc

URDF_DIR = Path(os.environ["URDF_DIR"])
KDLCAL = os.environ["KDLCAL"]
EXAMPLE = URDF_DIR / "examples" / "measurements.csv"
CONVENTION = URDF_DIR / "fanuc_r2000ic_165f_pendant.json"


@pytest.fixture(scope="session")
def robot():
    return kc.load_robot(URDF_DIR / "fanuc_r2000ic_165f.urdf")


@pytest.fixture(scope="session")
def measurements(robot):
    return kc.read_measurements(robot, EXAMPLE, kc.read_joint_convention(CONVENTION))


@pytest.fixture(scope="session")
def found(robot, measurements):
    return kc.calibrate(robot, measurements)


@pytest.fixture
def random():
    return np.random.default_rng(7)


def rows_of(m):
    """The arrays from which the measurements could have come."""
    place = {name: i for i, name in enumerate(m.configurations)}
    rows = m.observations
    return {
        "joints": m.joint_values[[place[name] for name in rows["configuration"]]],
        "points": rows["position"],
        "targets": rows["target"],
        "configurations": rows["configuration"],
        "split": np.where(rows["test"], "test", "train"),
    }
