"""The result: its parts agree with each other and with independent formulas."""

import pickle
import re
import subprocess

import numpy as np
import pytest

import kdl_calibration as kc
from conftest import KDLCAL, URDF_DIR, rows_of

PLAIN = {"priors": {"automatic": False}, "effects": {"automatic": False}}
MOVED = np.eye(4)
MOVED[:3, 3] = 0.1, 0.0, 0.2


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


def test_as_many_folds_as_configurations_leave_each_out_once(robot, measurements):
    rows = {**rows_of(measurements), "split": None}
    m = kc.from_arrays(**rows)
    folds = kc.calibrate(robot, m, **PLAIN, validation={"k_fold": len(m.configurations)}).accuracy
    each = kc.calibrate(robot, m, **PLAIN, validation={"leave_one_out": True}).accuracy
    assert folds.folds == len(m.configurations) == 28
    for errors in ("before", "after"):
        for figure in ("count", "rms", "max"):
            by_folds, by_each = (getattr(getattr(of, errors), figure) for of in (folds.k_fold, each.leave_one_out))
            assert by_folds == pytest.approx(by_each, rel=1e-9)


@pytest.mark.parametrize(
    ("options", "kind", "message"),
    [
        ({"fix": ["Tx*"]}, TypeError, "unknown option fix, expected one of estimator, parameters"),
        ({"parameters": {"fixed": []}}, TypeError, "unknown option parameters.fixed, expected one of parameters.model"),
        ({"parameters": ["Tx1"]}, TypeError, "parameters: .*expected a dict"),
        ({"validation": {"k_fold": "ten"}}, TypeError, "validation.k_fold: 'ten', expected an integer"),
        ({"validation": {"k_fold": -3}}, kc.InputError, "validation.k_fold: cannot be -3, expected at least 2 folds"),
        ({"validation": {"k_fold": 1}}, kc.InputError, "validation.k_fold: cannot be 1"),
        ({"estimator": {"iterations": -1}}, kc.InputError, "iterations: from 0 to"),
        ({"progress": 3}, TypeError, "progress: 3, expected a function"),
        ({"validation": {"held_out": 2.0}}, TypeError, "validation.held_out: 2.0, expected True or False"),
        ({"parameters": {"fix": 3}}, TypeError, "parameters.fix: 3, expected a list of texts"),
        ({"estimator": {"loss": "cauchy"}}, ValueError, "estimator.loss: 'cauchy', expected one of 'none', 'huber'"),
        ({"noise": {"stated": {"independent": [1.0, 2.0]}}}, kc.InputError, "independent: an array of shape"),
        ({"parameters": {"fix": ["Q*"]}}, kc.InputError, "Q"),
        ({"parameters": {"known": {"bases": {"W": 2.0 * np.eye(4)}}}}, kc.InputError, "no rotation and translation"),
        ({"parameters": {"known": {"bases": {"W": MOVED.T}}}}, kc.InputError, "no rotation and translation"),
        ({"parameters": {"known": {"targets": {"A": MOVED.T}}}}, kc.InputError, "no rotation and translation"),
        ({"parameters": {"known": {"bases": {"W": np.diag([1.0, 1.0, -1.0, 1.0])}}}}, kc.InputError, "no rotation and"),
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


@pytest.mark.parametrize("ends", [{"tip": "link_5"}, {"base": "link_1"}, {"base": "link_1", "tip": "link_5"}])
def test_a_copy_of_a_robot_is_the_same_chain(robot, ends):
    chain = kc.parse_robot(robot.urdf, **ends, source="cell.urdf")
    copy = pickle.loads(pickle.dumps(chain))
    assert {end: getattr(copy, end) for end in ends} == ends
    for name in ("name", "source", "base", "tip", "joints", "joint_types"):
        assert getattr(copy, name) == getattr(chain, name)
    assert len(copy.joints) == 6 - len(ends) and repr(copy) == repr(chain)
    np.testing.assert_array_equal(copy.limits, chain.limits)


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
    with pytest.raises(kc.InputError, match=r"X_BF: an array of shape \(3, 4, 4\), expected \(2, 4, 4\)"):
        compensator.solve_poses([np.eye(4)] * 3, np.zeros((2, 6)))
    nowhere = np.eye(4)
    nowhere[0, 3] = np.nan
    with pytest.raises(kc.InputError, match="X_BF: a matrix that is no rotation and translation"):
        compensator.solve_poses(nowhere, np.zeros(6))


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


def test_plan_promises_what_kdlcal_prints(robot, tmp_path):
    plan = kc.plan(robot, count=20, noise=5e-5, seed=5)
    printed = subprocess.run(
        [KDLCAL, "plan", "--urdf", URDF_DIR / "fanuc_r2000ic_165f.urdf", "--configurations", "20", "--noise", "5e-5",
         "--seed", "5", "--output", tmp_path / "plan.csv"], check=True, capture_output=True, text=True).stdout  # fmt: skip
    header, line = (re.search(rf"^ *{words} (.*)$", printed, re.M)[1].split() for words in
                    (r"predicted 1 sigma \[mm\]", "this plan"))  # fmt: skip
    promised = dict(zip(header, map(float, line)))  # [mm]
    assert plan.predicted_mean * 1e3 == pytest.approx(promised["mean"], abs=6e-5)
    assert plan.predicted_max * 1e3 == pytest.approx(promised["max"], abs=6e-5)
    assert promised["max"] > 1.05 * promised["mean"]


def test_plan_beside_the_column(robot):
    """Every target stays away from the axis of the first joint, which is the z axis of the base."""
    _, arm = kc.simulate(robot, length_error=0.0, angle_error=0.0)
    places = {"F": np.zeros(3), "G": np.array([0.1, 0.0, 0.0]), "H": np.array([0.0, 0.1, 0.0])}
    poses = arm.flange_poses(kc.plan(robot, count=20, least_radius=1.5, targets=places).joint_values)
    radii = [np.hypot(*(poses[:, :3, :3] @ p + poses[:, :3, 3])[:, :2].T).min() for p in places.values()]
    assert min(radii) >= 1.5 - 1e-6 and poses[:, 2, 3].min() < 1.0


def test_plan_after_a_repair(robot):
    """Eight configurations find the new zero of joint 5; the truth's points are those of that joint moved."""
    m, truth = kc.simulate(robot, configurations=40, noise=2e-5, length_error=1e-3, angle_error=1e-3, seed=3)
    before = kc.calibrate(robot, m, **PLAIN)
    plan = kc.plan(robot, after=before, suspect=["joint_5"])
    assert plan.joint_values.shape == (8, 6) and plan.targets == before.arm.targets and plan.warnings == []
    moved = np.array([0.0, 0.0, 0.0, 0.0, 1.5e-3, 0.0])

    def points(q):
        at = [truth.predict(q + moved, target, frame="measuring").position for target in plan.targets]
        return np.stack(at, axis=1)

    random = np.random.default_rng(4)
    few = points(plan.joint_values) + random.normal(0.0, 2e-5, (8, 3, 3))
    again = kc.Measurements.from_arrays(plan.joint_values, few, targets=plan.targets, sigma=2e-5)
    after = kc.calibrate(robot, again, priors={"earlier": before}, diagnosis={"try_readings": False})
    q = random.uniform(*robot.limits.T, (200, 6))
    error = {
        found: np.linalg.norm(
            np.stack([found.predict(q, t, frame="measuring").position for t in plan.targets], axis=1) - points(q), axis=2
        ).mean()
        for found in (before, after)
    }
    assert error[after] < 1e-4 and error[before] > 3.0 * error[after]
    everywhere = kc.plan(robot, after=before, count=9)
    assert len(everywhere.configurations) == 9 and (everywhere.joint_values[:8] != plan.joint_values).any()
    (warning,) = kc.plan(robot, after=before, suspect=["joint_1", "joint_5"]).warnings
    assert "zero of joint_1 cannot show" in warning
    own = kc.plan(robot, after=before, targets={"ball": [0.1, 0.0, 0.2]})
    assert own.targets == ["ball"]


def test_plan_after_is_that_of_kdlcal(robot, found, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    found.save("r.json")
    plan = kc.plan(robot, after=found, suspect=["joint_3"], noise=2e-5, seed=5)
    subprocess.run(
        [KDLCAL, "plan", "--urdf", URDF_DIR / "fanuc_r2000ic_165f.urdf", "--after", "r.json", "--suspect", "joint_3",
         "--noise", "2e-5", "--seed", "5", "--output", "plan.csv"], check=True, capture_output=True)  # fmt: skip

    def rows(text):
        return [line for line in text.splitlines() if not line.startswith("#")]

    assert rows((tmp_path / "plan.csv").read_text()) == rows(plan.csv())


def test_what_a_plan_cannot_come_after(robot, found):
    other = kc.parse_robot(robot.urdf, tip="link_5")
    for use, error, message in [
        (lambda: kc.plan(other, after=found), kc.InputError, "was not made with"),
        (lambda: kc.plan(robot, after=found, suspect=["joint_9"]), kc.InputError, "no joint 'joint_9', expected some of joint_1"),
        (lambda: kc.plan(robot, targets={"A": np.eye(4), "B": np.diag([1.0, 1.0, -1.0, 1.0])}), kc.InputError,
         "targets.B: a matrix that is no rotation"),
        (lambda: kc.plan(robot, suspect=["joint_5"]), kc.InputError, "suspect: nothing is known from before"),
        (lambda: kc.plan(robot, after="r.json"), TypeError, "after: 'r.json', expected a Calibration"),
        (lambda: kc.plan(robot, after=found, suspect="joint_5"), TypeError, "suspect: 'joint_5', expected a list of texts"),
    ]:
        with pytest.raises(error, match=message):
            use()


def test_findings_are_objects(robot, measurements, tmp_path):
    rows = rows_of(measurements)
    points = rows["points"].copy()
    points[10, 1] += 0.1
    found = kc.calibrate(robot, kc.Measurements.from_arrays(**{**rows, "points": points}))
    (finding,) = found.findings
    assert finding.kind == "mistyped_coordinate" and finding.axis == "y"
    assert (finding.configuration, finding.targets) == (rows["configurations"][10], [rows["targets"][10]])
    assert abs(abs(finding.amount) - 0.1) < 1e-3 and finding.message == str(finding)
    found.save(tmp_path / "r.json")
    loaded = kc.load(tmp_path / "r.json", robot)
    assert loaded.findings == pickle.loads(pickle.dumps(found.findings)) == found.findings
    assert kc.calibrate(robot, measurements, **PLAIN).findings == []


def test_a_compensator_is_pickled(found, measurements):
    own = kc.Compensator(found, most_change=0.02, held=["joint_6"], position_first=True)
    copy = pickle.loads(pickle.dumps(own))
    assert own.calibration is found
    q = measurements.joint_values
    one, other = own.solve(q), copy.solve(q)
    assert (one.status == other.status).all() and (one.joint_values[:, 5] == q[:, 5]).all()
    np.testing.assert_allclose(one.joint_values, other.joint_values, rtol=0, atol=1e-12)
    held = ["joint_6"]
    listed = kc.Compensator(found, held=held)
    held.append("joint_5")
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(listed)).solve(q).joint_values, listed.solve(q).joint_values)
    free = pickle.loads(pickle.dumps(kc.Compensator(found))).solve(q)
    assert (free.joint_values[:, 5] != q[:, 5]).any()
    with pytest.raises(TypeError):
        kc.Compensator(None)


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


def test_options_that_are_true_for_numpy(robot, measurements):
    found = kc.calibrate(robot, measurements, **PLAIN, validation={"held_out": np.bool_(False)})
    assert found.accuracy.held_out is None


def test_statistics_outlive_their_accuracy(robot):
    left = kc.calibrate(robot, kc.simulate(robot, configurations=30, noise=3e-5, seed=1)[0], **PLAIN).accuracy.held_out
    before = left.after.rms
    other = kc.calibrate(robot, kc.simulate(robot, configurations=30, noise=3e-3, seed=1)[0], **PLAIN)
    others = [other.accuracy for _ in range(100)]
    assert len(others) == 100 and left.after.rms == before


def test_iso_figures_of_test_rows(robot):
    m, _ = kc.simulate(robot, configurations=30, test_configurations=5, repeats=5, noise=2e-5, length_error=1e-3, seed=1)
    accuracy = kc.calibrate(robot, m, **PLAIN).accuracy
    repeated = kc.validate(robot, m)
    assert (repeated.train_means.count, repeated.test_means.count, repeated.all_means.count) == (90, 15, 105)
    assert accuracy.iso_test_after.accuracy.rms < 1e-4 < accuracy.iso_test_before.accuracy.rms
    errors = kc.validate(robot, kc.simulate(robot, configurations=30, test_configurations=8, seed=1)[0])
    assert 1.0 < errors.upper_95_factor < errors.upper_95_factor_of_test


def test_a_plan_as_the_pendant_counts(robot):
    plan = kc.plan(robot, count=15)
    convention = kc.read_joint_convention(URDF_DIR / "fanuc_r2000ic_165f_pendant.json")
    last = [float(cell) for cell in plan.csv(convention).splitlines()[-1].split(",")[2:8]]
    pendant = np.linalg.solve(convention.matrix, plan.joint_values[-1] - convention.offset)
    np.testing.assert_allclose(last, np.degrees(pendant), atol=1e-8)
    assert abs(pendant - plan.joint_values[-1]).max() > 0.01


def test_nothing_that_was_read_is_replaced(robot, measurements, tmp_path, monkeypatch):
    """Also from another folder, and by a copy of the robot."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "r.urdf").write_text(robot.urdf)
    named = kc.Measurements.from_arrays(**rows_of(measurements), joint_names=robot.joints)
    (tmp_path / "m.csv").write_text(named.csv())
    own = kc.load_robot("r.urdf")
    found = kc.calibrate(own, kc.read_measurements(own, "m.csv"), **PLAIN)
    by_copy = kc.calibrate(pickle.loads(pickle.dumps(own)), measurements, **PLAIN)
    (tmp_path / "sub").mkdir()
    monkeypatch.chdir(tmp_path / "sub")
    for write in (
        lambda: found.write_urdf("../r.urdf"),
        lambda: found.save("../r.urdf"),
        lambda: found.save("../m.csv"),
        lambda: found.report("../m.csv"),
        lambda: by_copy.write_urdf("../r.urdf"),
    ):
        with pytest.raises(kc.InputError, match="is the file"):
            write()
    assert (tmp_path / "r.urdf").read_text() == robot.urdf and (tmp_path / "m.csv").read_text() == named.csv()


def test_plots_show_what_they_say(robot):
    pytest.importorskip("matplotlib")
    found = kc.calibrate(robot, kc.simulate(robot, configurations=30, noise=3e-5, seed=1)[0], **PLAIN)
    shown = found.plot_workspace().collections[0].get_array()
    lengths = 1e3 * np.linalg.norm(found.residuals["position"], axis=1)
    np.testing.assert_allclose(shown, lengths.reshape(30, 3).max(axis=1))
    assert found.plot_convergence().lines[0].get_xdata()[0] == 0


def test_test_rows_at_fitted_poses_and_at_new_ones(robot):
    m, _ = kc.simulate(robot, configurations=40, test_configurations=8, noise=3e-5, length_error=1e-3, seed=3)
    rows = rows_of(m)
    again = slice(0, 15)  # five fitted poses, measured again under other labels
    twice = kc.from_arrays(
        np.r_[rows["joints"], rows["joints"][again]], np.r_[rows["points"], rows["points"][again] + 3e-5],
        targets=np.r_[rows["targets"], rows["targets"][again]], split=np.r_[rows["split"], ["test"] * 15],
        configurations=np.r_[rows["configurations"], ["x" + name for name in rows["configurations"][again]]],
    )  # fmt: skip
    accuracy = kc.calibrate(robot, twice, **PLAIN).accuracy
    assert (accuracy.test_at_fitted_poses.count, accuracy.test_at_new_poses.count) == (15, 24)


def test_options_of_a_validation(robot, measurements):
    rows = rows_of(measurements)
    rows["joints"] = rows["joints"] * [1.0, 1.0, -1.0, 1.0, 1.0, 1.0]
    turned = kc.from_arrays(**rows)
    causes = [[doubt.cause for doubt in kc.validate(robot, turned, diagnosis={"try_readings": tried}).doubts]
              for tried in (True, False)]  # fmt: skip
    assert "joint_sign" in causes[0] and "joint_sign" not in causes[1]
