"""Arrays in: shapes, types, layouts; what is refused."""

import pickle
import subprocess
import sys

import numpy as np
import pytest

import kdl_calibration as kc
from conftest import rows_of


def test_one_row_is_a_row_of_many(found, measurements):
    q = measurements.joint_values
    many = found.predict(q, "A")
    assert [a.shape for a in many] == [(28, 3), (28, 3, 3), (28,), (28,), (28,)]
    for one, all_of_them in zip(found.predict(q[4], "A"), many):
        np.testing.assert_array_equal(one, all_of_them[4])
    assert found.flange_poses(q).shape == (28, 4, 4)
    np.testing.assert_array_equal(found.flange_poses(q[4]), found.flange_poses(q)[4])
    assert found.predict(np.empty((0, 6)), "A").position.shape == (0, 3)


def test_prediction_is_the_target_on_the_flange(found, measurements):
    """Position from the pose: the target in the flange frame as the result file states it."""
    target = next(t for t in found.result["targets"] if t["name"] == "B")["position"]
    poses = found.flange_poses(measurements.joint_values)
    np.testing.assert_allclose(
        found.predict(measurements.joint_values, "B").position, poses[:, :3, :3] @ target + poses[:, :3, 3], atol=1e-12
    )


def test_flange_jacobian_agrees_with_differences(found, measurements):
    q, step = measurements.joint_values[2], 1e-6
    _, jacobian = found.arm.flange_jacobians(q)
    for i in range(6):
        there = np.zeros(6)
        there[i] = step
        difference = (found.flange_poses(q + there) - found.flange_poses(q - there)) / (2.0 * step)
        np.testing.assert_allclose(jacobian[:3, i], difference[:3, 3], atol=1e-7)
        turn = difference[:3, :3] @ found.flange_poses(q)[:3, :3].T
        np.testing.assert_allclose(jacobian[3:, i], [turn[2, 1], turn[0, 2], turn[1, 0]], atol=1e-7)


@pytest.mark.parametrize(
    "layout",
    [np.asfortranarray, lambda q: np.repeat(q, 2, axis=0)[::2], lambda q: q[::-1][::-1], lambda q: q.tolist()],
)
def test_any_layout_gives_the_same(found, measurements, layout):
    q = measurements.joint_values
    np.testing.assert_array_equal(found.predict(layout(q), "A").position, found.predict(q, "A").position)


def test_read_only_and_other_numbers(found, measurements):
    q = measurements.joint_values.copy()
    q.flags.writeable = False
    before = q.copy()
    found.predict(q, "A")
    np.testing.assert_array_equal(q, before)
    single = q.astype(np.float32)
    np.testing.assert_array_equal(found.flange_poses(single), found.flange_poses(single.astype(float)))
    np.testing.assert_array_equal(found.flange_poses([0, 0, 0, 0, 0, 0]), found.flange_poses(np.zeros(6)))


@pytest.mark.parametrize("shape", [(5,), (7,), (3, 5), (2, 3, 6), ()])
def test_wrong_shapes(found, shape):
    with pytest.raises(kc.InputError, match=r"q: an array of shape .*expected \(N, 6\) or \(6,\)"):
        found.predict(np.zeros(shape), "A")


@pytest.mark.parametrize("q", [["0"] * 6, [0j] * 6, [None] * 6, [True] * 6, "joints"])
def test_wrong_types(found, q):
    with pytest.raises(TypeError, match="^q: "):
        found.predict(q, "A")


def test_values_that_are_not_finite_name_their_row(found):
    q = np.zeros((1000, 6))
    q[700, 3] = np.nan
    q[800, 3] = np.inf
    with pytest.raises(ValueError, match="^row 700: .*finite"):
        found.predict(q, "A")


def test_unknown_target_and_frame(found):
    with pytest.raises(kc.InputError, match="target 'D'|target \"D\""):
        found.predict(np.zeros(6), "D")
    with pytest.raises(kc.InputError, match="frame: 'world', expected"):
        found.predict(np.zeros(6), "A", frame="world")


def test_views_cannot_be_written(found, measurements):
    for view in (measurements.joint_values, found.covariance):
        with pytest.raises(ValueError):
            view[0] = 0.0


def test_points_of_all_targets(measurements):
    """(N, T, 3) means the same as a row for each."""
    flat = rows_of(measurements)
    joints = measurements.joint_values
    points = flat["points"].reshape(28, 3, 3).copy()
    points[3, 1] = np.nan
    m = kc.Measurements.from_arrays(joints, points, targets=["A", "B", "C"], configurations=np.arange(28), sigma=1e-5)
    kept = np.delete(np.arange(84), 3 * 3 + 1)
    np.testing.assert_array_equal(m.points, flat["points"][kept])
    np.testing.assert_array_equal(m.observations["target"], flat["targets"][kept])
    np.testing.assert_array_equal(m.joint_values, joints)
    assert (m.observations["sigma"] == 1e-5).all()
    assert m.configurations[:3] == ["0", "1", "2"]


def test_equal_joint_values_are_one_configuration():
    joints = np.array([[3.0, 1.0], [2.0, 2.0], [3.0, 1.0], [3.0, 1.0]])
    m = kc.Measurements.from_arrays(joints, np.zeros((4, 3)), targets=["b", "b", "a", "b"])
    rows = m.observations
    assert m.targets == ["b", "a"]
    assert rows["configuration"].tolist() == ["1", "2", "1", "1"]
    assert rows["repeat"].tolist() == [1, 1, 1, 2]
    np.testing.assert_array_equal(m.joint_values, [[3.0, 1.0], [2.0, 2.0]])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"points": np.zeros((4, 2))}, "points: an array of shape"),
        ({"points": np.zeros((0, 3))}, "at least a row"),
        ({"joints": np.zeros((3, 6))}, "joints: an array of shape"),
        ({"joints": [[0.0, np.nan]] * 4}, r"joints\[0\]\[1\]: nan"),
        ({"points": [[0.0, 0.0, np.inf]] * 4}, r"points\[0\]\[2\]: inf"),
        ({"targets": ["A", "B"]}, "targets: an array of shape"),
        ({"configurations": ["1", "2", "1", "2"]}, r"joints\[2\]: other joint values than in joints\[0\]"),
        ({"sigma": -1.0}, r"sigma\[0\]: -1.0, expected a standard deviation"),
        ({"sigma": [1e-5] * 3}, "sigma: an array of shape"),
        ({"orientations": np.ones((4, 4))}, "its norm is not 1"),
        ({"split": "validate"}, "expected 'train' or 'test'"),
        ({"joint_names": ["a"]}, "joint_names: 1 names, expected 2"),
    ],
)
def test_bad_measurements(change, message):
    given = {"joints": np.arange(8.0).reshape(4, 2), "points": np.ones((4, 3))}
    with pytest.raises(kc.InputError, match=message):
        kc.Measurements.from_arrays(**{**given, **change})


def test_measurements_of_wrong_types():
    with pytest.raises(TypeError, match="points: an array of"):
        kc.Measurements.from_arrays(np.zeros((1, 6)), [["1", "2", "3"]])
    with pytest.raises(TypeError, match="repeats: an array of float64"):
        kc.Measurements.from_arrays(np.zeros((1, 6)), np.zeros((1, 3)), repeats=[1.0])


def test_measurements_of_another_robot(robot):
    with pytest.raises(kc.InputError, match="measurements of 2 joints, expected 6"):
        kc.calibrate(robot, kc.Measurements.from_arrays(np.zeros((4, 2)), np.zeros((4, 3))))


def test_poses(robot, found, measurements):
    """Orientations come back: poses of the calibrated arm itself leave nothing."""
    q = measurements.joint_values
    poses = found.flange_poses(q)
    x = np.empty((len(q), 4))
    for i, R in enumerate(poses[:, :3, :3]):
        values, vectors = np.linalg.eigh(
            np.array(
                [
                    [R[0, 0] - R[1, 1] - R[2, 2], 0, 0, 0],
                    [R[0, 1] + R[1, 0], R[1, 1] - R[0, 0] - R[2, 2], 0, 0],
                    [R[0, 2] + R[2, 0], R[1, 2] + R[2, 1], R[2, 2] - R[0, 0] - R[1, 1], 0],
                    [R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], R.trace()],
                ]
            )
        )
        x[i] = np.roll(vectors[:, np.argmax(values)], 1)  # Bar-Itzhack 2000: w, x, y, z
    m = kc.Measurements.from_arrays(q, poses[:, :3, 3], orientations=x)
    again = kc.calibrate(robot, m, effects={"automatic": False}, priors={"automatic": False})
    rest = again.residuals
    assert np.abs(rest["position"]).max() < 1e-9
    assert np.abs(rest["rotation"]).max() < 1e-9


def test_data_frames(robot, measurements, found):
    pandas = pytest.importorskip("pandas")
    rows = rows_of(measurements)
    frame = pandas.DataFrame(rows["joints"], columns=robot.joints)
    frame[["x", "y", "z"]] = rows["points"]
    frame["target"], frame["configuration"], frame["split"] = rows["targets"], rows["configurations"], rows["split"]
    m = kc.Measurements.from_pandas(frame, robot.joints)
    assert m.joints == robot.joints
    assert m.csv() == kc.Measurements.from_arrays(**rows, joint_names=robot.joints).csv()
    with pytest.raises(kc.InputError, match="column 'joint_9'"):
        kc.Measurements.from_pandas(frame, ["joint_9"])
    assert len(pandas.DataFrame({name: found.parameters[name] for name in ("name", "error", "std")})) == len(
        found.parameters
    )


def test_order_gives_the_directions_of_approach(robot):
    m, _ = kc.simulate(robot, configurations=40, noise=2e-5, seed=3)
    q, rows = m.joint_values, m.observations
    commanded = q.copy()  # joint 2 stays behind by 0.5 mrad
    commanded[1:, 1] += 5e-4 * np.sign(np.diff(q[:, 1]))
    place = {name: i for i, name in enumerate(m.configurations)}
    of_row = np.array([place[name] for name in rows["configuration"]])
    stated = {"targets": rows["target"], "configurations": rows["configuration"]}
    effects = {"effects": {"groups": ["backlash"]}, "priors": {"automatic": False},
               "diagnosis": {"try_readings": False}}  # fmt: skip
    for order in (of_row, None):
        found = kc.calibrate(robot, kc.from_arrays(commanded[of_row], rows["position"], order=order, **stated), **effects)
        names = [term["name"] for term in found.result["effects"]["terms"]]
        assert ("backlash.2.approach" in names) == (order is not None)


def test_half_a_point_is_refused():
    points = np.ones((4, 2, 3))
    points[2, 1] = np.nan
    points[1, 1, 2] = np.nan
    with pytest.raises(kc.InputError, match=r"points.*nan"):
        kc.from_arrays(np.arange(8.0).reshape(4, 2), points)


def test_keywords_before_usual_columns():
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame({"q": [0.0, 1.0], "x": 0.0, "y": 0.0, "z": 1.0, "target": ["A", "B"], "mark": ["C", "D"],
                              "sigma": 1e-5, "w": 2e-5})  # fmt: skip
    m = kc.from_pandas(frame, ["q"], targets="mark", sigma="w", configurations=["k", "l"])
    assert m.targets == ["C", "D"] and (m.observations["sigma"] == 2e-5).all() and m.configurations == ["k", "l"]


def test_one_row_of_many_keeps_its_shape(found, measurements):
    q = measurements.joint_values[4:5]
    for one, single in zip(found.predict(q, "A"), found.predict(q[0], "A")):
        assert one.shape == (1, *single.shape)
        np.testing.assert_array_equal(one[0], single)
    assert found.flange_poses(q).shape == (1, 4, 4) and kc.Compensator(found).solve(q).status.shape == (1,)


@pytest.mark.parametrize("call", ["calibrate(robot, None)", "calibrate(None, m)", "validate(robot, None)",
                                  "validate(None, m)", "plan(None)", "load('r.json', None)",
                                  "compensate_program(None, 'k.src')"])
def test_none_is_refused(robot, call):
    """In a process of its own, as it may end it."""
    code = (f"import kdl_calibration as kc\nrobot = kc.load_robot({robot.source!r})\nm = kc.from_arrays([[0.0] * 6], [[0.0] * 3])\n"
            f"try:\n    kc.{call}\nexcept TypeError:\n    print('refused')\n")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout == "refused\n", done


def test_measurements_without_names_are_copied(robot, measurements):
    m = kc.from_arrays(**rows_of(measurements))
    copy = pickle.loads(pickle.dumps(m))
    assert copy.joints == []
    np.testing.assert_array_equal(copy.joint_values, m.joint_values)
    for field in m.observations.dtype.names:
        np.testing.assert_array_equal(copy.observations[field], m.observations[field])


def test_a_file_needs_the_names_of_joints(measurements):
    with pytest.raises(kc.InputError, match="0 names of joints, expected 6"):
        kc.from_arrays(**rows_of(measurements)).csv()


def test_places_are_those_of_the_given_arrays():
    points = np.ones((4, 2, 3))
    points[0, 1] = np.nan
    points[2, 1, 2] = np.inf
    with pytest.raises(kc.InputError, match=r"points\[2\]\[1\]\[2\]: inf"):
        kc.from_arrays(np.arange(8.0).reshape(4, 2), points)
    joints = np.arange(8.0).reshape(4, 2)
    joints[2, 0] = np.inf
    with pytest.raises(kc.InputError, match=r"joints\[2\]\[0\]: inf"):
        kc.from_arrays(joints, np.ones((4, 2, 3)))
    sigma = np.ones((4, 2))
    sigma[3, 1] = np.inf
    with pytest.raises(kc.InputError, match=r"sigma\[3\]\[1\]: inf"):
        kc.from_arrays(np.arange(8.0).reshape(4, 2), np.ones((4, 2, 3)), sigma=sigma)


def test_no_orientations_in_a_frame():
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame({"q": [0.0, 1.0], "x": 0.0, "y": 0.0, "z": 1.0})
    assert len(kc.from_pandas(frame, ["q"], orientations=None)) == 2


def test_a_label_that_is_missing():
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame({"q": [0.0, 1.0], "x": 0.0, "y": 0.0, "z": 1.0, "target": ["A", None]})
    with pytest.raises(kc.InputError, match=r"targets\[1\]: None, expected a label"):
        kc.from_pandas(frame, ["q"])


def test_a_repeat_is_given_once():
    with pytest.raises(kc.InputError, match=r"repeats\[2\]: 1, as in repeats\[0\] of this configuration and target"):
        kc.from_arrays(np.zeros((3, 2)), np.ones((3, 3)), repeats=[1, 2, 1])


def test_minus_zero_is_zero():
    q = np.zeros((2, 6))
    q[1, 0] = -0.0
    assert kc.from_arrays(q, np.ones((2, 3))).configurations == ["1"]


def test_a_number_that_is_missing_is_no_label():
    with pytest.raises(kc.InputError, match=r"targets\[1\]: nan, expected a label"):
        kc.from_arrays(np.eye(2), np.ones((2, 3)), targets=np.array([1.0, np.nan]))


def test_the_same_repeat_at_two_stations():
    m = kc.from_arrays(np.zeros((2, 2)), np.ones((2, 3)), stations=["V", "W"], repeats=[1, 1])
    assert list(m.observations["station"]) == ["V", "W"]


def quaternions_of(poses):
    w = np.sqrt(np.maximum(0.0, 1.0 + np.trace(poses[:, :3, :3], axis1=1, axis2=2))) / 2.0
    differences = [poses[:, 2, 1] - poses[:, 1, 2], poses[:, 0, 2] - poses[:, 2, 0], poses[:, 1, 0] - poses[:, 0, 1]]
    return np.column_stack([w, *(d / (4.0 * w) for d in differences)])


def test_quaternions_are_normalised(robot, found, random):
    """Within the tolerance of their norm."""
    q = random.uniform(-1.0, 1.0, (40, 6))
    poses = found.flange_poses(q)
    exact = quaternions_of(poses)
    for orientations in (exact, exact * 1.0009):
        m = kc.from_arrays(q, poses[:, :3, 3] + random.normal(0.0, 1e-4, (40, 3)), orientations=orientations)
        fit = kc.calibrate(robot, m, effects={"automatic": False}, diagnosis={"try_readings": False})
        assert abs(fit.residuals["rotation"]).max() < 1e-6


def test_orientations_of_four_targets(robot):
    """(N, 4) is a quaternion for each row of points, however many targets there are."""
    q, points = np.arange(30.0).reshape(5, 6), np.ones((5, 4, 3))
    turned = np.tile([0.6, 0.8, 0.0, 0.0], (5, 1))
    by_row = kc.from_arrays(q, points, orientations=turned, joint_names=robot.joints)
    by_target = kc.from_arrays(q, points, orientations=np.repeat(turned[:, None], 4, axis=1), joint_names=robot.joints)
    assert by_row.csv() == by_target.csv() and "0.6" in by_row.csv()


def test_masked_values_are_refused():
    points = np.ma.masked_array(np.ones((2, 3)), mask=[[False] * 3, [True] * 3])
    with pytest.raises(kc.InputError, match="points: masked values, expected NaN or no row"):
        kc.from_arrays(np.eye(2), points)
    with pytest.raises(TypeError, match=r"joint_names: \[0, 1\], expected texts"):
        kc.from_arrays(np.eye(2), np.ones((2, 3)), joint_names=range(2))


def test_repeats_are_counted_in_the_order_of_the_rows(robot):
    q = robot.limits.mean(axis=1)
    m = kc.from_arrays(np.array([q, q + 0.1] * 20), np.arange(120.0).reshape(40, 3))
    np.testing.assert_array_equal(m.observations["repeat"], np.arange(40) // 2 + 1)


def test_masks_and_missing_labels_of_any_array(robot):
    q, points = np.arange(24.0).reshape(4, 6), np.ones((4, 3, 3))
    for options, message in [
        ({"sigma": np.ma.masked_array(np.full((4, 3), 1e-4), mask=np.eye(4, 3, dtype=bool))}, "sigma: masked values"),
        ({"targets": np.ma.masked_array(["A", "B", "C"], mask=[True, False, False])}, "targets: masked values"),
    ]:
        with pytest.raises(kc.InputError, match=message):
            kc.from_arrays(q, points, **options)
    with pytest.raises(kc.InputError, match=r"targets\[2\]: nan, expected a label"):
        kc.from_arrays(q[:3], np.ones((3, 3)), targets=["A", "B", float("nan")])


def test_places_of_what_is_refused_beside_points_of_configurations():
    q, points = np.arange(24.0).reshape(4, 6), np.ones((4, 3, 3))
    sigma, turned, split = np.full(4, 1e-4), np.tile([1.0, 0.0, 0.0, 0.0], (4, 1)), np.full((4, 3), "train")
    sigma[2], turned[2], split[2, 1] = -1.0, 0.0, "tests"
    broken = np.tile([1.0, 0.0, 0.0, 0.0], (4, 3, 1))
    broken[2, 1, 3] = np.nan
    for options, message in [
        ({"sigma": sigma}, r"sigma\[2\]: -1.0, expected a standard deviation of at least 1e-15 m"),
        ({"sigma": 1e-300}, r"sigma\[0\]: 1e-300, expected a standard deviation"),
        ({"orientations": turned}, r"orientations\[2\]: its norm is not 1"),
        ({"split": split}, r"split\[2\]\[1\]: 'tests', expected 'train' or 'test'"),
        ({"configurations": ["a", "b", "c", "a"]}, r"joints\[3\]: other joint values than in joints\[0\]"),
        ({"sigma": [1e-5, 1e-5, np.nan, 1e-5]}, r"sigma\[2\]: nan"),
        ({"configurations": ["a", "b", None, "d"]}, r"configurations\[2\]: None, expected a label"),
        ({"stations": ["a", "b", None, "d"]}, r"stations\[2\]: None, expected a label"),
        ({"split": ["train", None, "test", "test"]}, r"split\[1\]: None, expected a label"),
        ({"orientations": broken}, r"orientations\[2\]\[1\]\[3\]: nan"),
        ({"order": np.array([0, 2**63, 1, 2], dtype=np.uint64)}, "order: 9223372036854775808, expected at most"),
        ({"repeats": [1, -1, 1, 1]}, r"repeats\[1\]: -1, expected 0 to 2147483647"),
        ({"repeats": [1, 1, 2**32 + 1, 1]}, r"repeats\[2\]: 4294967297, expected 0 to"),
    ]:
        with pytest.raises(kc.InputError, match=message):
            kc.from_arrays(q, points, **options)


def test_words_of_a_split_in_capitals():
    q, points = np.repeat(np.eye(2), 3, axis=0), np.ones((6, 3))
    m = kc.from_arrays(q, points, targets=list("ABCABC"), split=["Train"] * 3 + ["TEST"] * 3)
    np.testing.assert_array_equal(m.observations["test"], [False] * 3 + [True] * 3)


def test_a_configuration_is_of_one_split():
    split = ["train"] * 5 + ["test"]
    with pytest.raises(kc.InputError, match=r"split\[5\]: 'test', expected the same in all rows of configuration 2"):
        kc.from_arrays(np.repeat(np.eye(2), 3, axis=0), np.ones((6, 3)), targets=list("ABCABC"), split=split)


def test_points_of_a_frame_by_a_generator():
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame({"q": [0.0, 1.0], "x": 0.0, "y": 0.0, "z": 1.0})
    assert len(kc.from_pandas(frame, (name for name in "q"), points=(name for name in "xyz"))) == 2


def test_what_is_predicted_is_not_masked(found):
    with pytest.raises(kc.InputError, match="q: masked values, expected numbers"):
        found.flange_poses(np.ma.masked_array(np.zeros((1, 6)), mask=[[0, 0, 0, 0, 0, 1]]))


def test_a_copy_of_measurements_keeps_their_remark(measurements):
    assert measurements.remark and pickle.loads(pickle.dumps(measurements)).remark == measurements.remark
