"""Alternatives of the diagnosis that are functions of the caller's own."""

import json

import numpy as np
import pytest

import kdl_calibration as kc
from conftest import rows_of

PLAIN = {"priors": {"automatic": False}, "effects": {"automatic": False}, "validation": {"held_out": False}}
TILT = 1e-3  # [rad]
HEIGHT = 0.67  # [m] of joint 1 in the URDF
ON_ITS_SIDE = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # a measuring device


def twice(q):
    return np.sin(2.0 * q[:, 0])


def astray(q):
    """(N, 2, 3)"""
    columns = np.zeros((len(q), 2, 3))
    columns[:, 0, 2] = np.cos(3.0 * q[:, 1])
    columns[:, 1, 0] = np.sin(2.0 * q[:, 2])
    return columns


TILTING = {"function": twice, "joint": "joint_1", "axis": "x"}


@pytest.fixture(scope="module")
def tilting(robot):
    """Measurements of a robot whose base tilts about its x axis, at the height of joint 1, with the angle of joint 1."""
    m, truth = kc.simulate(robot, configurations=40, noise=3e-5, length_error=5e-4, angle_error=5e-4, seed=4)
    rows = m.observations
    place = {name: i for i, name in enumerate(m.configurations)}
    joints = m.joint_values[[place[name] for name in rows["configuration"]]]
    X_WB = truth.base()
    pivot = np.array([0.0, 0.0, HEIGHT])
    lever = (rows["position"] - X_WB[:3, 3]) @ X_WB[:3, :3] - pivot
    angle = TILT * twice(joints)
    c, s = np.cos(angle), np.sin(angle)
    turned = np.column_stack([lever[:, 0], c * lever[:, 1] - s * lever[:, 2], s * lever[:, 1] + c * lever[:, 2]])
    return kc.Measurements.from_arrays(joints, (turned + pivot) @ X_WB[:3, :3].T + X_WB[:3, 3], targets=rows["target"],
                                       configurations=rows["configuration"])  # fmt: skip


@pytest.fixture(scope="module")
def moved(robot, tilting):
    """The tilt as displacements in the base frame."""
    nominal = kc.calibrate(robot, tilting, diagnosis={"try_readings": False}, **PLAIN)

    def displacements(q):
        lever = nominal.flange_poses(q)[:, :3, 3]
        return twice(q)[:, None] * np.column_stack([0.0 * lever[:, 0], HEIGHT - lever[:, 2], lever[:, 1]])

    return displacements


def with_alternatives(robot, m, **alternatives):
    return kc.calibrate(robot, m, diagnosis={"alternatives": alternatives}, **PLAIN)


def about(doubts, name):
    return [doubt for doubt in doubts if ("alternative", name) in doubt.subjects]


def test_the_one_that_is_there_is_doubted(robot, tilting, tmp_path):
    found = with_alternatives(robot, tilting, tilt=TILTING, stray={"function": astray})
    (doubt,) = about(found.doubts, "tilt")
    assert doubt.cause == "own_alternative"
    figures = doubt.figures
    assert abs(figures["estimate"] - TILT) < 3.0 * figures["estimate_sigma"] < 0.1 * TILT
    assert figures["p_value"] < 1e-5 and figures["columns"] == 1
    assert figures["moves"] > figures["radius"] > 0.0
    (remark,) = about(found.remarks, "stray")
    assert remark.figures["columns"] == 2
    assert {"estimate_1", "estimate_1_sigma", "estimate_2", "estimate_2_sigma", "p_value", "moves"} <= set(remark.figures)
    assert not found.trusted
    found.save(tmp_path / "r.json")
    saved = json.loads((tmp_path / "r.json").read_text())
    assert [d["cause"] for d in saved["doubts"]].count("own_alternative") == 1
    assert {"kind": "alternative", "name": "tilt"} in [s for d in saved["doubts"] for s in d["subjects"]]
    found.report(tmp_path / "r.html")
    assert "alternative tilt, 0.00" in (tmp_path / "r.html").read_text()
    loaded = kc.load(tmp_path / "r.json", robot)  # which needs no function
    assert [str(d) for d in loaded.doubts] == [str(d) for d in found.doubts]
    assert "own_alternative" in {mistake["cause"] for mistake in saved["detectable"]}


def test_two_stations(robot, tilting):
    """The second one is turned and moved, so that displacements in the measuring frame would be others there."""
    rows = rows_of(tilting)
    is_second = np.isin(rows["configurations"], tilting.configurations[::2])
    turned = rows["points"] @ ON_ITS_SIDE + [0.3, -2.0, 1.0]
    rows["points"] = np.where(is_second[:, None], turned, rows["points"])
    m = kc.Measurements.from_arrays(**rows, stations=np.where(is_second, "V", "W"))
    found = with_alternatives(robot, m, tilt=TILTING)
    (doubt,) = about(found.doubts, "tilt")
    assert abs(doubt.figures["estimate"] - TILT) < 3.5 * doubt.figures["estimate_sigma"] < 0.1 * TILT


def test_distances(robot, tilting, moved, tmp_path):
    """Of the same points from six anchors, read from a file."""
    rows = rows_of(tilting)
    anchors = np.array([[3.0, 0, 0], [0, 3.0, 0], [-3.0, 0, 1.0], [0, -3.0, 2.0], [2.0, 2.0, 3.0], [-2.0, 2.0, 0.5]])
    lines = ["configuration,target,repeat," + ",".join(f"joint_{i}[rad]" for i in range(1, 7)) + ",x[m],y[m],z[m],distance[m]"]
    for row, q, point in zip(tilting.observations, rows["joints"], rows["points"]):
        for i, anchor in enumerate(anchors):
            numbers = [*q, *anchor, np.linalg.norm(point - anchor)]
            lines.append(f"{row['configuration']},{row['target']},{i + 1}," + ",".join(f"{x:.17g}" for x in numbers))
    (tmp_path / "m.csv").write_text("\n".join(lines) + "\n")
    m = kc.read_measurements(robot, tmp_path / "m.csv")
    for tilt in (TILTING, {"function": moved, "frame": "base"}):
        found = with_alternatives(robot, m, tilt=tilt)
        (doubt,) = about(found.doubts, "tilt")
        assert abs(doubt.figures["estimate"] - TILT) < 0.1 * TILT and doubt.figures["estimate_sigma"] < 0.03 * TILT


def test_what_is_not_there_is_a_remark(robot, measurements):
    found = with_alternatives(robot, measurements, tilt=TILTING)
    (remark,) = about(found.remarks, "tilt")
    assert remark.cause == "own_alternative"
    assert str(remark) in found.warnings
    assert remark.figures["p_value"] > 1e-5
    assert not about(found.doubts, "tilt")


def test_the_frame_of_displacements(robot, tilting, moved):
    """A tilt as displacements in the base frame is the same; in the measuring frame another one."""
    in_base = with_alternatives(robot, tilting, tilt={"function": moved, "frame": "base"})
    (doubt,) = about(in_base.doubts, "tilt")
    assert abs(doubt.figures["estimate"] - TILT) < 0.1 * TILT
    elsewhere = with_alternatives(robot, tilting, tilt={"function": moved})
    (other,) = about([*elsewhere.doubts, *elsewhere.remarks], "tilt")
    assert other.figures["moves"] != doubt.figures["moves"]


def test_columns_in_the_base_frame_move_points_each_by_its_own(robot, tilting, moved):
    """A tilt in its two coordinates moves predictions as the tilt does."""
    figures = []
    for function in (moved, lambda q: moved(q)[:, None, :] * np.eye(3)[1:]):
        found = with_alternatives(robot, tilting, tilt={"function": function, "frame": "base"})
        (said,) = about([*found.doubts, *found.remarks], "tilt")
        figures.append(said.figures)
    assert figures[1]["moves"] == pytest.approx(figures[0]["moves"], rel=0.05)
    assert figures[1]["estimate_1"] == pytest.approx(TILT, rel=0.15)
    assert figures[1]["estimate_2"] == pytest.approx(TILT, rel=0.15)


def test_columns_in_the_base_frame_turn_with_the_measuring_frame(robot, tilting, moved):
    """All points seen from a device that lies on its side."""
    rows = rows_of(tilting)
    m = kc.Measurements.from_arrays(**{**rows, "points": rows["points"] @ ON_ITS_SIDE})
    found = with_alternatives(robot, m, tilt={"function": lambda q: moved(q)[:, None, :] * np.eye(3)[1:], "frame": "base"})
    (said,) = about([*found.doubts, *found.remarks], "tilt")
    assert said.figures["estimate_1"] == pytest.approx(TILT, rel=0.15)
    assert said.figures["estimate_2"] == pytest.approx(TILT, rel=0.15)


def test_constant_columns_cannot_be_seen(robot, tilting):
    found = with_alternatives(robot, tilting, still={"function": lambda q: np.ones(len(q)), "joint": "joint_2"},
                              shift={"function": lambda q: np.ones((len(q), 3))})  # fmt: skip
    for name in ("still", "shift"):
        (remark,) = about(found.remarks, name)
        assert f"alternative {name} cannot be seen" in str(remark)
        assert set(remark.figures) == {"columns"}


def test_validations_try_them(robot, tilting):
    errors = kc.validate(robot, tilting, diagnosis={"alternatives": {"tilt": TILTING}})
    (doubt,) = about(errors.doubts, "tilt")
    assert abs(doubt.figures["estimate"] - TILT) < 3.0 * doubt.figures["estimate_sigma"]


@pytest.mark.parametrize("dtype", [np.float32, np.int64])
def test_other_numbers_and_layouts(robot, tilting, dtype):
    found = with_alternatives(robot, tilting, any={"function": lambda q: np.asfortranarray(1e3 * astray(q)).astype(dtype)})
    exact = with_alternatives(robot, tilting, any={"function": lambda q: (1e3 * astray(q)).astype(dtype).astype(float)})
    assert about(found.remarks, "any")[0].figures == about(exact.remarks, "any")[0].figures


def test_what_a_function_does_wrong_is_told_in_one_line(robot, tilting):
    def broken(q):
        raise KeyError("no such table")

    where = r"^diagnosis\.alternatives\.any\.function"
    for alternative, error, message in [
        ({"function": broken}, kc.InputError, where + r" raised KeyError: 'no such table'$"),
        ({"function": broken, "joint": "joint_1"}, kc.InputError, where + " raised KeyError"),
        ({"function": lambda q: q[:3, :3]}, kc.InputError, "^diagnosis.alternatives: any gives 3 rows"),
        ({"function": lambda q: q[:, :2]}, kc.InputError, where + r": an array of shape \(40, 2\), expected displacements"),
        ({"function": lambda q: q[:, :4]}, kc.InputError, where + r": an array of shape \(40, 4\), expected displacements"),
        ({"function": lambda q: astray(q)[:, :, :2]}, kc.InputError, r": an array of shape \(40, 2, 2\), expected displacements"),
        ({"function": lambda q: q[:, None, :4] * np.ones((2, 1))}, kc.InputError,
         r": an array of shape \(40, 2, 4\), expected displacements"),
        ({"function": twice}, kc.InputError, where + r": an array of shape \(40,\), expected displacements \(N, 3\)"),
        ({"function": lambda q: q[:, :3] * np.nan}, kc.InputError, "^diagnosis.alternatives: any gives a value that is not"),
        ({"function": lambda q: q[:, :3] * np.inf}, kc.InputError, "any gives a value that is not finite at joint values"),
        ({"function": astray, "joint": "joint_1"}, ValueError, where + r": an array of shape \(40, 2, 3\), expected \(N,\)"),
        ({"function": lambda q: "text"}, TypeError, where + ": an array of <U4, expected one of real numbers"),
        ({"function": lambda q: q[:, :3] - q[:, :3].mean(axis=0)}, kc.InputError, "other values at one configuration"),
        ({"function": 5}, TypeError, where + ": 5, expected a function of joint values"),
        ({"joint": "joint_1"}, TypeError, "^diagnosis.alternatives.any: no function"),
        ({"function": twice, "joint": "joint_9"}, kc.InputError, "any moves joint_9, expected a moving joint"),
        ({"function": astray, "axis": "x"}, TypeError, "any: an axis without a joint"),
        ({"function": twice, "joint": "joint_1", "frame": "base"}, TypeError, "any: a frame beside a joint"),
        ({"function": astray, "frame": "world"}, ValueError, "any.frame: 'world', expected one of 'measuring', 'base'"),
        ({"functions": astray}, TypeError, "unknown option diagnosis.alternatives.any.functions"),
    ]:
        with pytest.raises(error, match=message) as raised:
            with_alternatives(robot, tilting, any=alternative)
        assert "\n" not in str(raised.value)
    with pytest.raises(kc.InputError) as raised:
        with_alternatives(robot, tilting, any={"function": broken})
    assert isinstance(raised.value.__cause__, KeyError)
    with pytest.raises(TypeError, match="diagnosis.alternatives: .*expected a dict of names and alternatives"):
        kc.calibrate(robot, tilting, diagnosis={"alternatives": [TILTING]})
    with pytest.raises(kc.InputError, match="'a b' is not accepted as a name"):
        kc.calibrate(robot, tilting, diagnosis={"alternatives": {"a b": TILTING}})
    with pytest.raises(kc.InputError, match="diagnosis.alternatives: are other readings .* expected one of the two"):
        kc.calibrate(robot, tilting, diagnosis={"alternatives": {"tilt": TILTING}, "try_readings": False})


def test_functions_are_looked_at_before_the_fit(robot, tilting):
    stages = []
    with pytest.raises(kc.InputError):
        kc.calibrate(robot, tilting, diagnosis={"alternatives": {"any": {"function": lambda q: q[:, :3] * np.nan}}},
                     progress=lambda stage, done, of: stages.append(stage))  # fmt: skip
    assert not stages
