"""The same numbers as the program in C++, to the last bit."""

import json
import subprocess

import numpy as np
import pytest

import kdl_calibration as kc
from conftest import CONVENTION, EXAMPLE, KDLCAL, rows_of


@pytest.fixture(scope="module")
def of_program(tmp_path_factory):
    folder = tmp_path_factory.mktemp("program")
    command = [KDLCAL, "calibrate", "--measurements", EXAMPLE, "--joint-convention", CONVENTION, "--result",
               folder / "result.json", "--predict-at", EXAMPLE]  # fmt: skip
    subprocess.run(command, check=True, capture_output=True)
    return json.loads((folder / "result.json").read_text()), folder / "result.json"


def test_result(found, of_program):
    own = found.result
    for key in ("parameters", "targets", "base", "covariance", "position_error", "noise", "residuals", "effects",
                "history", "iso_9283"):  # fmt: skip
        assert own[key] == of_program[0][key], key


def test_members(found, of_program):
    result = of_program[0]
    shown = {p["name"]: p for p in result["parameters"]}
    for row in found.parameters:
        if row["name"] in shown:
            assert row["error"] == shown[row["name"]]["error"]
            std = shown[row["name"]]["std"]
            assert row["std"] == (np.inf if std is None else std)
    assert found.estimated == result["covariance"]["names"]
    assert found.accuracy.train.after.rms == result["position_error"]["train"]["after"]["rms"]
    assert found.accuracy.held_out.after.count == result["position_error"]["leave_one_out"]["after"]["count"]


def test_predictions(robot, measurements, found, of_program):
    loaded = kc.load(of_program[1], robot)
    place = {name: i for i, name in enumerate(measurements.configurations)}
    points = of_program[0]["predicted_accuracy"]["asked"]
    assert len(points) == len(measurements.configurations) * 3
    for point in points:
        q = measurements.joint_values[place[point["configuration"]]]
        own = found.predict(q, point["target"])
        assert own.position.tolist() == point["position"]
        assert own.radius_95 == point["radius_95"]
        assert own.outside == point["outside"]
        np.testing.assert_allclose(loaded.predict(q, point["target"]).position, point["position"], rtol=1e-13)


def test_measurements_from_arrays_give_the_same_result(robot, measurements, found):
    m = kc.Measurements.from_arrays(**rows_of(measurements))
    assert m.joints == []
    again = kc.calibrate(robot, m)
    np.testing.assert_array_equal(again.parameters["error"], found.parameters["error"])
    np.testing.assert_array_equal(again.covariance, found.covariance)
    np.testing.assert_array_equal(again.residuals["position"], found.residuals["position"])
