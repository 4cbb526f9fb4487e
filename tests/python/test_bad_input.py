"""Input that is refused in one line, in the words of Python, and input that only looks bad."""

import os
import pickle
import shutil

import numpy as np
import pytest

import kdl_calibration as kc
from conftest import CONVENTION, EXAMPLE, URDF_DIR, rows_of

QUICK = {"effects": {"automatic": False}, "priors": {"automatic": False}, "validation": {"held_out": False},
         "diagnosis": {"try_readings": False}}  # fmt: skip


def test_nullable_columns():
    pandas = pytest.importorskip("pandas")
    plain = pandas.DataFrame({"q": [0.0, 1.0, 1.0], "x": [1.0, 2.0, 3.0], "y": 0.0, "z": 1.0, "sigma": 1e-4,
                              "target": ["A", "A", "B"], "configuration": [7, 8, 8], "repeat": [1, 1, 2],
                              "temperature": [20.0, 21.0, 23.0]})  # fmt: skip
    nullable = plain.convert_dtypes()
    assert {str(kind) for kind in nullable.dtypes} == {"Int64", "Float64", "string"}
    assert kc.from_pandas(nullable, ["q"]).csv() == kc.from_pandas(plain, ["q"]).csv()
    assert kc.from_pandas(nullable, ["q"]).configurations == ["7", "8"]
    unknown = nullable.copy()
    unknown.loc[1, "temperature"] = pandas.NA
    known = plain.copy()
    known.loc[1, "temperature"] = np.nan
    assert kc.from_pandas(unknown, ["q"]).csv() == kc.from_pandas(known, ["q"]).csv()
    for column, message in [
        ("x", r"points\[2\]\[0\]: nan, expected a finite number"),
        ("q", r"joints\[2\]\[0\]: nan"),
        ("sigma", r"sigma\[2\]: nan"),
        ("target", r"targets\[2\]: None, expected a label"),
        ("configuration", r"configurations\[2\]: nan, expected a label"),
        ("repeat", r"repeats\[2\]: nan, expected an integer"),
    ]:
        frame = nullable.copy()
        frame.loc[2, column] = pandas.NA
        with pytest.raises(kc.InputError, match=message):
            kc.from_pandas(frame, ["q"])
    series = kc.from_arrays(nullable[["q"]].to_numpy(dtype=float), plain[["x", "y", "z"]], targets=nullable["target"],
                            configurations=nullable["configuration"], repeats=nullable["repeat"])  # fmt: skip
    assert series.targets == ["A", "B"] and series.configurations == ["7", "8"]


def test_columns_that_are_there_twice():
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame([[0.0, 1.0, 2.0, 3.0, 4.0]], columns=["q", "x", "y", "z", "x"])
    with pytest.raises(kc.InputError, match="column 'x' is there 2 times, expected it once"):
        kc.from_pandas(frame, ["q"])


def test_names_of_joints_differ():
    with pytest.raises(kc.InputError, match="joint_names: 'a' is there twice, expected names that differ"):
        kc.from_arrays(np.eye(2), np.ones((2, 3)), joint_names=["a", "a"])


def test_messages_name_keywords(robot, tmp_path):
    text = EXAMPLE.read_text()
    file = tmp_path / "m.csv"
    for content, orientation, words in [
        (text, "", "need convention"),
        ("configuration,target,joint_1,joint_2,joint_3,joint_4,joint_5,joint_6,x,y,z,qw,qx,qy,qz\n1,A,0,0,0,0,0,0,1,0,1,1,0,0,0\n",
         "fixed-xyz", "no orientation"),
    ]:  # fmt: skip
        file.write_text(content)
        with pytest.raises(kc.InputError) as raised:
            kc.read_measurements(robot, file, orientation=orientation)
        assert words in str(raised.value) and "--" not in str(raised.value)
    for name in ("my--orientation.csv", "my--orientation"):
        named = tmp_path / name
        named.write_text("configuration\n")
        with pytest.raises(kc.InputError, match=f"/{name}:"):
            kc.read_measurements(robot, named)


def test_messages_name_the_structure_of_an_option(robot, measurements, found):
    for options, message in [
        ({"estimator": {"iterations": -1}}, "^estimator.iterations: from 0 to"),
        ({"noise": {"weights": "repeats"}}, "^noise.weights: noise by repeats needs"),
        ({"estimator": {"method": "two_step"}, "priors": {"stated": {"length": 1e-3}}}, "^estimator.method: the published"),
        ({"validation": {"k_fold": 1}}, "^validation.k_fold: cannot be 1, expected at least 2"),
        ({"validation": {"k_fold": 21}}, "^validation.k_fold: 21 folds of 20 fitted configurations, expected at most as many"),
        ({"validation": {"k_fold": 5, "held_out": False}}, "^validation.held_out: False beside"),
        ({"validation": {"leave_one_out": True, "held_out": False}}, "^validation.held_out: False beside"),
        ({"validation": {"nested": True, "held_out": False}}, "^validation.held_out: False beside leave_one_out, nested or k_fold"),
        ({"parameters": {"fix": ["*"]}}, "^parameters.fix: "),
        ({"parameters": {"fix": ["Tx1"], "free": ["Tx1"]}}, "^parameters.free: "),
        ({"parameters": {"keep_axes": "angles"}, "priors": {"earlier": found}}, "^parameters.keep_axes: "),
        ({"effects": {"groups": ["gain", "gravity", "gain"]}}, "^effects: gain is named twice, expected each group once"),
    ]:
        with pytest.raises(kc.InputError, match=message):
            kc.calibrate(robot, measurements, **options)


def test_messages_of_doubts_name_keywords(robot):
    m, _ = kc.simulate(robot, configurations=30, noise=3e-5, seed=3)
    rows = rows_of(m)
    turned = kc.calibrate(robot, m, **QUICK).flange_poses(rows["joints"])[:, :3, :3]
    w = np.sqrt(np.maximum(1.0 + np.trace(turned, axis1=1, axis2=2), 1e-9)) / 2.0
    axis = np.column_stack([turned[:, 2, 1] - turned[:, 1, 2], turned[:, 0, 2] - turned[:, 2, 0],
                            turned[:, 1, 0] - turned[:, 0, 1]]) / (4.0 * w[:, None])  # fmt: skip
    wrong = np.column_stack([w, axis[:, ::-1]])
    found = kc.calibrate(robot, kc.from_arrays(orientations=wrong / np.linalg.norm(wrong, axis=1)[:, None], **rows),
                         effects={"automatic": False}, priors={"automatic": False})  # fmt: skip
    for doubt in [*found.doubts, *found.remarks]:
        assert "--" not in str(doubt) and str(doubt) == doubt.message
        assert repr(doubt) == f"<Doubt {doubt.cause}: {doubt.message}>"
    assert "orientation fixed-xyz" in " ".join(map(repr, found.doubts))


@pytest.mark.parametrize("form", [os.fsencode, os.fsdecode])
def test_file_names_that_are_not_utf8(robot, measurements, tmp_path, form):
    folder = os.fsencode(tmp_path) + b"/\xff\xfe"
    os.mkdir(folder)
    urdf, points = folder + b"/r.urdf", folder + b"/m.csv"
    shutil.copy(URDF_DIR / "fanuc_r2000ic_165f.urdf", urdf)
    shutil.copy(EXAMPLE, points)
    strange = kc.load_robot(form(urdf))
    assert strange.source.endswith(r"\xff\xfe/r.urdf")
    m = kc.read_measurements(strange, form(points), kc.read_joint_convention(CONVENTION))
    assert os.fsencode(m.source) == points
    for each in (strange, m):
        assert pickle.loads(pickle.dumps(each)).source == each.source
    found = kc.calibrate(strange, m, **QUICK)
    result = form(folder + b"/result.json")
    found.save(result)
    loaded = kc.load(result, strange)
    np.testing.assert_array_equal(loaded.predict(np.zeros((1, 6)), "A").position, found.predict(np.zeros((1, 6)), "A").position)
    found.write_urdf(form(folder + b"/c.urdf"))
    found.report(form(folder + b"/page.html"))
    assert sorted(os.listdir(folder)) == [b"c.urdf", b"m.csv", b"page.html", b"r.urdf", b"result.json"]
    with pytest.raises(kc.InputError, match=r"\\xff\\xfe/none.csv"):
        kc.read_measurements(strange, form(folder + b"/none.csv"))


def test_file_names_with_nul(robot, found):
    for call in (
        lambda name: kc.load_robot(name),
        lambda name: kc.load_dh_robot(name),
        lambda name: kc.read_joint_convention(name),
        lambda name: kc.read_measurements(robot, name),
        lambda name: kc.load(name, robot),
        lambda name: kc.compensate_program(found, name),
        lambda name: kc.compensate_program(found, "p.ls", controller=name),
        found.save,
        found.report,
        found.write_urdf,
    ):
        for name in ("a\0b", b"a\0b"):
            with pytest.raises(ValueError, match=r"^the file name b?'a\\x00b' is none, expected one without NUL$"):
                call(name)


def test_the_only_station_has_a_name(found):
    q = np.full((2, 6), 0.2)
    for frame in ("base", "measuring"):
        np.testing.assert_array_equal(found.predict(q, "A", frame=frame, station="W").position,
                                      found.predict(q, "A", frame=frame).position)  # fmt: skip
    np.testing.assert_array_equal(found.arm.base("W"), found.arm.base())
    with pytest.raises(kc.InputError, match="station 'V' was not measured, expected none"):
        found.predict(q, "A", station="V")


def test_no_rows_are_refused_like_others(found):
    nothing = np.empty((0, 6))
    assert found.predict(nothing, "A").position.shape == (0, 3)
    assert found.predict(nothing, "A", frame="measuring").covariance.shape == (0, 3, 3)
    for keywords in ({"target": "Z"}, {"target": "A", "station": "V"}, {"target": "A", "station": "V", "frame": "measuring"}):
        messages = []
        for q in (nothing, np.zeros(6)):
            with pytest.raises(kc.InputError) as raised:
                found.predict(q, **keywords)
            messages.append(str(raised.value))
        assert messages[0] == messages[1]


def test_temperatures_that_no_arm_has(robot):
    m, _ = kc.simulate(robot, configurations=40, noise=3e-5, length_error=1e-3, seed=5)
    rows = rows_of(m)
    count = len(rows["joints"])
    warm = kc.from_arrays(temperature=np.linspace(20.0, 30.0, count), payload=np.linspace(10.0, 90.0, count),
                          **rows)  # fmt: skip
    found = kc.calibrate(robot, warm, effects={"groups": ["drift", "payload"]}, priors={"automatic": False},
                         validation={"held_out": False}, diagnosis={"try_readings": False})  # fmt: skip
    for keywords, message in [
        ({"temperature": -300.0}, "temperature: -300 is impossible, expected -273.15 to 1000"),
        ({"temperature": 1001.0}, "temperature: 1001 is impossible"),
        ({"temperature": np.inf}, "temperature: not finite"),
        ({"payload": -1.0}, "payload: -1 is impossible, expected 0 to 100000"),
    ]:
        with pytest.raises(kc.InputError, match=message):
            found.at(**keywords)
    found.at(temperature=-273.15)


def test_poses_without_joint_values_near_them(found):
    compensator = kc.Compensator(found)
    with pytest.raises(TypeError, match=r"^seed: none, expected nominal joint values near the poses, \(N, 6\) or \(6,\)$"):
        compensator.solve_poses(np.eye(4))


@pytest.mark.parametrize("count, names", [(26, ["A", "Z"]), (27, ["1", "27"])])
def test_targets_without_names_are_letters_while_there_are_any(count, names):
    m = kc.from_arrays(np.eye(2), np.random.default_rng(1).normal(size=(2, count, 3)))
    assert [m.targets[0], m.targets[-1]] == names and len(m.targets) == count


def test_a_sigma_of_zero_states_none_and_quaternions_are_of_unit_length():
    m = kc.from_arrays(np.eye(2), np.ones((2, 3)), sigma=[0.0, 1e-4])
    assert m.observations["sigma"].tolist() == [0.0, 1e-4]
    with pytest.raises(kc.InputError, match=r"orientations\[1\]: its norm is not 1"):
        kc.from_arrays(np.eye(2), np.ones((2, 3)), orientations=[[1.0, 0.0, 0.0, 0.0], [1.01, 0.0, 0.0, 0.0]])
