"""The result: its parts agree with each other and with independent formulas."""

import pickle
import re

import numpy as np
import pytest

import kdl_calibration as kc
from conftest import rows_of

PLAIN = {"priors": {"automatic": False}, "effects": {"automatic": False}}


def test_version_is_that_of_the_program(found):
    assert kc.__version__ == found.result["software"]["version"]


def test_residuals_are_measured_minus_predicted(found, measurements):
    rows, q = found.residuals, dict(zip(measurements.configurations, measurements.joint_values))
    for row, point in zip(rows, measurements.points):
        predicted = found.predict(q[row["configuration"]], row["target"], frame="measuring").position
        np.testing.assert_allclose(row["position"], point - predicted, atol=1e-12)


def without_sigma(m):
    return kc.Measurements.from_arrays(**rows_of(m))


def test_whitened_residuals(robot):
    """With stated noise alone they are the residuals over its sigma along each axis."""
    m = without_sigma(kc.simulate(robot, configurations=40, noise=3e-5, seed=2)[0])
    sigma = np.array([1e-5, 2e-5, 4e-5])
    found = kc.calibrate(robot, m, **PLAIN, noise={"stated": {"independent": sigma}, "weights": "equal"})
    rows = found.residuals
    factor = found.result["noise"]["variance_factor"]
    np.testing.assert_allclose(rows["whitened"], rows["position"] / sigma / np.sqrt(factor), rtol=1e-9)


def test_jacobian_and_covariance_agree(robot):
    """Without priors and with equal noise the covariance is sigma^2 (J^T J)^-1."""
    m = without_sigma(kc.simulate(robot, configurations=40, noise=3e-5, seed=2)[0])
    sigma = 1e-3  # so large that the residuals do not exceed it
    stated = {"stated": {"independent": sigma}, "weights": "equal", "scale_sigma": 0.0, "length_sigma": 0.0}
    found = kc.calibrate(robot, m, **PLAIN, noise=stated)
    assert found.jacobian.shape == (len(m), 3, len(found.estimated))
    J = found.jacobian.reshape(-1, len(found.estimated))
    expected = sigma**2 * np.linalg.inv(J.T @ J)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(found.covariance / scale, expected / scale, atol=1e-6)


def test_truth_of_a_simulation(robot, random):
    """Predictions in the measuring frame are as good as their radii: 95 % of the truth and noise lie within."""
    m, truth = kc.simulate(robot, configurations=40, noise=3e-5, length_error=1e-3, angle_error=1e-3, seed=5)
    found = kc.calibrate(robot, m)
    low, high = found.arm.measured_ranges.T
    q = random.uniform(low, high, (500, 6))
    own = found.predict(q, "A", frame="measuring")
    miss = own.position - truth_points(truth, q, m) + random.normal(0.0, 3e-5, (500, 3))
    inside = np.linalg.norm(miss, axis=1) <= own.radius_95
    assert inside[~own.outside].mean() > 0.9


def truth_points(truth, q, measurements):
    """Target A in the measuring frame by the truth's poses: its place on the flange from the first measured point."""
    base = truth.base()
    first = base @ truth.flange_poses(measurements.joint_values[0])
    rows = measurements.observations
    noisy = rows["position"][rows["target"] == "A"]
    poses = base @ truth.flange_poses(measurements.joint_values)
    on_flange = np.einsum("nji,nj->ni", poses[:, :3, :3], noisy - poses[:, :3, 3]).mean(axis=0)
    assert first.shape == (4, 4)
    there = base @ truth.flange_poses(q)
    return there[:, :3, :3] @ on_flange + there[:, :3, 3]


def test_doubts_are_objects(robot, measurements):
    rows = rows_of(measurements)
    rows["joints"] = rows["joints"] * [1.0, 1.0, 1.0, 1.0, -1.0, 1.0]
    found = kc.calibrate(robot, kc.Measurements.from_arrays(**rows))
    assert found.verdict == "not_trusted" and not found.trusted
    (doubt,) = [doubt for doubt in found.doubts if doubt.cause == "joint_sign"]
    assert doubt.subjects == [("joint", "joint_5")]
    assert doubt.message == str(doubt) and "joint_5" in doubt.message
    assert all(isinstance(value, float) for value in doubt.figures.values())
    assert found.warnings == [remark.message for remark in found.remarks]


def test_options(robot, measurements):
    found = kc.calibrate(robot, measurements, **PLAIN, parameters={"fix": ["Tx*"]}, validation={"k_fold": 4}, threads=1)
    assert not [name for name in found.estimated if name.startswith("Tx")]
    assert found.accuracy.folds == 4 and found.accuracy.leave_one_out is None
    base = found.arm.base()
    known = {"bases": {"W": base}, "targets": {"A": [0.1, 0.2, 0.3]}}
    held = kc.calibrate(robot, measurements, **PLAIN, parameters={"known": known})
    np.testing.assert_array_equal(held.arm.base(), base)
    assert not [name for name in held.estimated if name.startswith(("base", "A."))]


@pytest.mark.parametrize(
    ("options", "kind", "message"),
    [
        ({"fix": ["Tx*"]}, TypeError, "unknown option fix, expected one of estimator, parameters"),
        ({"parameters": {"fixed": []}}, TypeError, "unknown option parameters.fixed, expected one of parameters.model"),
        ({"parameters": ["Tx1"]}, TypeError, "parameters: .*expected a dict"),
        ({"validation": {"k_fold": "ten"}}, TypeError, "validation.k_fold: 'ten', expected an integer"),
        ({"parameters": {"fix": 3}}, TypeError, "parameters.fix: 3, expected a list of texts"),
        ({"estimator": {"loss": "cauchy"}}, ValueError, "estimator.loss: 'cauchy', expected one of 'none', 'huber'"),
        ({"noise": {"stated": {"independent": [1.0, 2.0]}}}, kc.InputError, "independent: an array of shape"),
        ({"parameters": {"fix": ["Q*"]}}, kc.InputError, "Q"),
        ({"parameters": {"known": {"bases": {"W": 2.0 * np.eye(4)}}}}, kc.InputError, "no rotation and translation"),
    ],
)
def test_bad_options(robot, measurements, options, kind, message):
    with pytest.raises(kind, match=message):
        kc.calibrate(robot, measurements, **options)


def test_an_earlier_result_is_a_prior(robot, measurements):
    earlier = kc.calibrate(robot, measurements)
    again = kc.calibrate(robot, measurements, priors={"earlier": earlier})
    assert again.std("Tx1") < earlier.std("Tx1")


def test_saved_and_pickled(found, robot, tmp_path, measurements):
    q = measurements.joint_values
    found.save(tmp_path / "result.json")
    loaded = kc.load(tmp_path / "result.json", robot)
    copies = [loaded, pickle.loads(pickle.dumps(found)), pickle.loads(pickle.dumps(loaded))]
    for copy in copies:
        np.testing.assert_array_equal(copy.covariance, found.covariance)
        for own, other in zip(copy.predict(q, "C"), found.predict(q, "C")):
            np.testing.assert_allclose(own, other, rtol=1e-12)  # the file states rotations as quaternions
        assert copy.measurements is None
        with pytest.raises(kc.InputError, match="read from a file"):
            copy.residuals
    loaded.save(tmp_path / "again.json")
    assert (tmp_path / "again.json").read_bytes() == (tmp_path / "result.json").read_bytes()
    other = pickle.loads(pickle.dumps(measurements))
    assert other.csv() == measurements.csv() and other.joints == measurements.joints
    assert pickle.loads(pickle.dumps(robot)).urdf == robot.urdf


def test_a_result_of_another_robot(found, tmp_path):
    found.save(tmp_path / "result.json")
    other = kc.parse_robot(found.robot.urdf, tip="link_5")
    with pytest.raises(kc.InputError):
        kc.load(tmp_path / "result.json", other)


def test_compensation(found, measurements):
    """The calibrated arm at the compensated values is where the nominal one should be."""
    q = measurements.joint_values
    compensator = kc.Compensator(found)
    many = compensator.solve(q)
    exact = many.status == "exact"
    assert exact.sum() > 25 and set(many.status) <= {"exact", "position_only"}
    asked, reached = compensator.nominal_poses(q), found.flange_poses(many.joint_values)
    np.testing.assert_allclose(reached[exact], asked[exact], atol=1e-9)
    np.testing.assert_allclose(reached[:, :3, 3], asked[:, :3, 3], atol=1e-9)
    one = compensator.solve(q[5])
    assert one.status == "exact"
    np.testing.assert_array_equal(one.joint_values, many.joint_values[5])
    of_poses = compensator.solve_poses(asked, q)
    np.testing.assert_allclose(of_poses.joint_values[exact], many.joint_values[exact], atol=1e-9)
    with pytest.raises(TypeError, match="unknown option most, expected one of most_change"):
        kc.Compensator(found, most=1.0)


def test_compensation_of_bad_poses(found):
    compensator = kc.Compensator(found)
    with pytest.raises(kc.InputError, match=r"X_BF\[1\]: a matrix that is no rotation"):
        compensator.solve_poses([np.eye(4), np.ones((4, 4))], np.zeros((2, 6)))
    with pytest.raises(kc.InputError, match="a pose for each row of seed"):
        compensator.solve_poses(np.eye(4), np.zeros((2, 6)))


def test_validation_and_comparison(found, robot, measurements):
    nominal = kc.validate(robot, measurements, diagnosis={"try_readings": False})
    calibrated = kc.validate(found, measurements)
    assert calibrated.all.rms < 0.1 * nominal.all.rms
    assert nominal.all.count == 84 and nominal.registered == "base and targets"
    comparison = kc.compare(found, found)
    assert not comparison.has_changed and comparison.same_measurements
    assert (comparison.parameters["change"] == 0.0).all()


def test_plan(robot):
    shares = []
    plan = kc.plan(robot, count=20, least_height=0.2, progress=shares.append)
    assert plan.joint_values.shape == (20, 6) and len(plan.configurations) == 20
    low, high = robot.limits.T
    assert ((plan.joint_values >= low) & (plan.joint_values <= high)).all()
    assert shares == sorted(shares) and 0.0 < shares[-1] <= 1.0
    assert plan.csv().count("\n") > 60
    with pytest.raises(kc.InputError, match="configurations"):
        kc.plan(robot, count=2)


def test_report_and_exports(found, tmp_path):
    kc.report(found, tmp_path / "report.html")
    assert "</html>" in (tmp_path / "report.html").read_text()
    found.write_urdf(tmp_path / "calibrated.urdf")
    assert (tmp_path / "calibrated.urdf").read_text() == found.export("urdf")
    with pytest.raises(kc.InputError, match="format: 'docx'"):
        found.export("docx")


def test_notebook_shows_verdict_number_and_table(found):
    page = found._repr_html_()
    assert "<b>Trusted.</b>" in page
    assert f"{found.accuracy.held_out.after.rms * 1e3:.3f} mm" in page
    assert page.count("<table>") == page.count("</table>") == 2
    row = found.parameters[found.parameters["name"] == "Tx1"][0]
    shown = f"<td>Tx1</td><td>{row['joint']}</td><td>{row['error'] * 1e3:.4f}</td><td>{row['std'] * 1e3:.4f}</td><td>mm</td>"
    assert shown in page


def test_units_of_a_sliding_joint(robot):
    slide = kc.parse_robot(robot.urdf.replace('name="joint_3" type="revolute"', 'name="joint_3" type="prismatic"'))
    assert slide.joint_types == ["revolute"] * 2 + ["prismatic"] + ["revolute"] * 3
    m, _ = kc.simulate(slide, configurations=60, noise=3e-5, length_error=1e-3, angle_error=1e-3)
    page = kc.calibrate(slide, m, **PLAIN, diagnosis={"try_readings": False})._repr_html_()
    units = dict(re.findall(r"<tr><td>(dq\d)</td>.*?<td>(m\w+)</td></tr>", page))
    assert units["dq2"] == "mrad" and units["dq3"] == "mm"


def test_plots(found):
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    residuals = found.plot_residuals()
    lengths = np.sort(np.concatenate([line.get_ydata() for line in residuals.lines]))
    np.testing.assert_allclose(lengths, np.sort(np.linalg.norm(found.residuals["position"], axis=1) * 1e3))
    places = found.plot_workspace().collections[0].get_offsets()
    np.testing.assert_allclose(places[:, 1], found.flange_poses(found.measurements.joint_values)[:, 2, 3])
    history = found.plot_convergence().lines[0].get_ydata()
    assert len(history) == len(found.result["history"]) and history[-1] < history[0]


def test_predictions_for_each_station(robot):
    """The second station sees the same points moved by `shift`."""
    m, _ = kc.simulate(robot, configurations=40, noise=1e-5, seed=3)
    shift = np.array([0.5, -2.0, 0.3])
    rows, place = m.observations, {name: i for i, name in enumerate(m.configurations)}
    of_row = np.array([place[name] for name in rows["configuration"]])
    second = of_row % 2 == 1
    found = kc.calibrate(
        robot,
        kc.from_arrays(m.joint_values[of_row], rows["position"] + second[:, None] * shift, targets=rows["target"],
                       stations=np.where(second, "far", "near")),
        effects={"automatic": False}, priors={"automatic": False}, diagnosis={"try_readings": False},
    )  # fmt: skip
    q = m.joint_values[:5]
    for arm in (found, found.arm):
        near, far = (arm.predict(q, "A", frame="measuring", station=name).position for name in ("near", "far"))
        np.testing.assert_allclose(far - near, np.tile(shift, (5, 1)), atol=1e-4)


def test_tracker_noise(robot, measurements):
    tracker = {"range": 1e-5, "range_per_metre": 2e-6, "transverse": 3e-5, "transverse_per_metre": 4e-6}
    found = kc.calibrate(robot, measurements, effects={"automatic": False}, noise={"stated": {"tracker": tracker}}, priors={"automatic": False})
    assert found.result["noise"]["tracker"] == list(tracker.values())


def test_simulated_targets_with_orientation(robot):
    pose = np.eye(4)
    pose[:3, 3] = 0.1, 0.0, 0.2
    for place, kind in ((pose, "pose"), (pose[:3, 3], "point")):
        m, _ = kc.simulate(robot, configurations=12, targets={"P": place})
        assert (m.observations["kind"] == kind).all()


def test_parameters_are_those_of_the_result(found):
    shown = {p["name"]: p for p in found.result["parameters"]}
    for row in found.parameters:
        if row["name"] in shown:
            number = shown[row["name"]]["degrees_of_freedom"]
            assert row["degrees_of_freedom"] == (np.inf if number is None else number)
            for key in ("joint", "kind", "axis", "nominal", "value", "identifiable", "gauge"):
                if key in shown[row["name"]]:
                    assert row[key] == (shown[row["name"]][key] or type(row[key])()), key


def test_loaded_results_share_nothing(robot, found, tmp_path):
    found.save(tmp_path / "r.json")
    kc.load(tmp_path / "r.json", robot).own["other"] = {}
    assert kc.load(tmp_path / "r.json", robot).own == {}


def test_a_loaded_result_does_not_replace_its_robot(robot, measurements, tmp_path):
    (tmp_path / "my.urdf").write_text(robot.urdf)
    mine = kc.load_robot(tmp_path / "my.urdf")
    found = kc.calibrate(mine, measurements)
    found.save(tmp_path / "r.json")
    for each in (found, kc.load(tmp_path / "r.json", mine)):
        with pytest.raises(kc.InputError, match="my.urdf"):
            each.save(tmp_path / "my.urdf")
        assert (tmp_path / "my.urdf").read_text() == robot.urdf


def test_known_of_another_type(robot, measurements):
    with pytest.raises(TypeError, match="known.bases"):
        kc.validate(robot, measurements, known={"bases": [np.eye(4)]})
