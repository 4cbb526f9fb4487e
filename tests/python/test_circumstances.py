"""Temperature and payload of the configurations."""

import pickle
import subprocess

import numpy as np
import pytest

import kdl_calibration as kc
from conftest import KDLCAL

PLAIN = {"priors": {"automatic": False}, "diagnosis": {"try_readings": False}}
GROWTH = 2e-5  # [1/K] of the whole arm and tool, so that every point moves away from the base by its share


@pytest.fixture(scope="module")
def warm(robot):
    """Measurements of an arm that warms up by 15 K, and all of it grows."""
    m, truth = kc.simulate(robot, configurations=60, noise=2e-5, length_error=1e-3, angle_error=1e-3, seed=5)
    place = {name: i for i, name in enumerate(m.configurations)}
    rows = m.observations
    of_row = np.array([place[name] for name in rows["configuration"]])
    temperature = 20.0 + 15.0 * np.random.default_rng(1).permutation(60)[of_row] / 59.0
    base = truth.base()[:3, 3]  # origin of the base in the measuring frame
    points = base + (rows["position"] - base) * (1.0 + GROWTH * (temperature - 27.5))[:, None]
    return m.joint_values[of_row], points, rows, temperature


def measured(warm, **more):
    joints, points, rows, _ = warm
    return kc.Measurements.from_arrays(joints, points, targets=rows["target"], configurations=rows["configuration"], **more)


def test_growth_is_found_and_predicted(robot, warm):
    with_it = kc.calibrate(robot, measured(warm, temperature=warm[3]), **PLAIN)
    without = kc.calibrate(robot, measured(warm), effects={"automatic": False}, **PLAIN)
    assert with_it.accuracy.held_out.after.rms < 0.5 * without.accuracy.held_out.after.rms
    q = np.array([0.3, -0.2, 0.4, 0.0, 0.6, 0.0])
    mean = with_it.predict(q, "A")
    moved = with_it.at(temperature=35.0).predict(q, "A")
    expected = GROWTH * (35.0 - warm[3].mean()) * mean.position
    assert np.linalg.norm(moved.position - mean.position - expected) < 0.25 * np.linalg.norm(expected)
    far = with_it.at(temperature=80.0).predict(q, "A")
    assert far.outside and far.covariance.trace() > 4.0 * mean.covariance.trace()
    commands = kc.Compensator(with_it.at(temperature=35.0)).solve(q)
    reached = with_it.at(temperature=35.0).flange_poses(commands.joint_values)
    nominal = kc.Compensator(with_it).solve(q)
    assert np.linalg.norm(with_it.at(temperature=35.0).flange_poses(nominal.joint_values)[:3, 3] - reached[:3, 3]) > 1e-4


def test_a_temperature_shows_in_the_text(robot, warm):
    found = kc.calibrate(robot, measured(warm, temperature=warm[3]), effects={"groups": ["drift"]}, **PLAIN)
    assert " at 30 degC: " in repr(found.at(temperature=30.0)) and "degC" not in repr(found)
    with pytest.raises(kc.InputError, match="temperature: not finite"):
        found.at(temperature=np.inf)


def test_what_nothing_depends_on_is_refused(robot, warm):
    found = kc.calibrate(robot, measured(warm), effects={"automatic": False}, **PLAIN)
    with pytest.raises(kc.InputError, match="temperature: no effect of this calibration depends on it"):
        found.at(temperature=30.0)
    with pytest.raises(kc.InputError, match="payload: no effect of this calibration depends on it"):
        found.at(payload=30.0)
    with pytest.raises(kc.InputError, match="drift needs the column temperature"):
        kc.calibrate(robot, measured(warm), effects={"groups": ["drift"]}, **PLAIN)


def test_rows_of_a_configuration_have_their_mean(robot):
    q = np.array([[0.1] * 6, [0.1] * 6, [0.2] * 6])
    points = np.arange(9.0).reshape(3, 3)
    m = kc.from_arrays(q, points, targets=["A", "B", "A"], temperature=[20.0, 21.0, np.nan], payload=5.0,
                       joint_names=robot.joints)  # fmt: skip
    assert "temperature[degC],payload[kg]" in m.csv().splitlines()[0]
    assert m.csv().splitlines()[1].endswith(",20.5,5") and m.csv().splitlines()[3].endswith(",,5")
    with pytest.raises(kc.InputError, match=r"temperature: an array of shape \(2,\), expected \(3,\)"):
        kc.from_arrays(q, points, targets=["A", "B", "A"], temperature=[1.0, 2.0])


def test_an_unchanged_arm_that_is_warmer_has_not_changed(robot, warm):
    joints, points, rows, temperature = warm
    cool = temperature < np.median(temperature)
    sides = [
        kc.calibrate(
            robot,
            kc.from_arrays(joints[half], points[half], targets=rows["target"][half],
                           configurations=rows["configuration"][half], temperature=temperature[half]),
            effects={"groups": ["expansion"]}, **PLAIN,
        )
        for half in (cool, ~cool)
    ]  # fmt: skip
    change = kc.compare(*sides)
    assert not change.has_changed, change.p_value
    assert change.flange.rms < 1e-4


def test_temperatures_are_those_of_all_configurations_or_none(robot, warm):
    some = np.where(np.arange(len(warm[3])) < 30, np.nan, warm[3])
    with pytest.raises(kc.InputError, match="has no temperature, expected one in each configuration or in none"):
        kc.calibrate(robot, measured(warm, temperature=some), **PLAIN)
    found = kc.calibrate(robot, measured(warm, temperature=warm[3]), effects={"groups": ["drift"]}, **PLAIN)
    for use in (
        lambda: kc.validate(found, measured(warm)),
        lambda: kc.calibrate(robot, measured(warm), priors={"earlier": found}, diagnosis={"try_readings": False}),
    ):
        with pytest.raises(kc.InputError, match="no temperature, expected the column"):
            use()


def test_at_of_at(robot, warm):
    found = kc.calibrate(robot, measured(warm, temperature=warm[3]), effects={"groups": ["drift"]}, diagnosis={"try_readings": False})
    warmer = found.at(temperature=30.0).at(temperature=34.0)
    assert warmer._origin is found and warmer.findings == found.findings
    q = np.array([0.3, -0.2, 0.4, 0.0, 0.6, 0.0])
    copy = pickle.loads(pickle.dumps(warmer))
    assert repr(copy) == repr(warmer) and " at 34 degC: " in repr(warmer.at())
    np.testing.assert_allclose(copy.predict(q, "A").position, warmer.predict(q, "A").position, rtol=0, atol=1e-12)


def test_mean_of_the_known(robot):
    m = kc.from_arrays(np.full((3, 6), 0.1), np.arange(9.0).reshape(3, 3), targets=["A", "B", "C"],
                       temperature=[20.0, np.nan, 21.0], joint_names=robot.joints)  # fmt: skip
    assert m.csv().splitlines()[1].endswith(",20.5")


def test_why_there_are_no_residuals_at_a_temperature(robot, warm):
    found = kc.calibrate(robot, measured(warm, temperature=warm[3]), effects={"groups": ["drift"]}, diagnosis={"try_readings": False})
    with pytest.raises(kc.InputError, match="at a stated temperature or payload has no measurements"):
        found.at(temperature=30.0).residuals


def test_at_a_temperature_no_file_of_the_calibration_is_replaced(robot, warm, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "m.csv").write_text(measured(warm, temperature=warm[3], joint_names=robot.joints).csv())
    found = kc.calibrate(robot, kc.read_measurements(robot, "m.csv"), effects={"groups": ["drift"]}, **PLAIN)
    found.save("r.json")
    loaded = kc.load("r.json", robot)
    written = {name: (tmp_path / name).read_bytes() for name in ("m.csv", "r.json")}
    for own, name in ((found, "m.csv"), (loaded, "r.json")):
        for each in (own, own.at(temperature=30.0), own.at(temperature=30.0).at(temperature=34.0)):
            with pytest.raises(kc.InputError, match=f"'{name}' is the file that .* reads"):
                each.write_urdf(name)
    assert {name: (tmp_path / name).read_bytes() for name in written} == written


def test_several_payloads(robot, tmp_path):
    """As kdlcal: each mass has its centre, and a copy and the file keep them."""
    m, _ = kc.simulate(robot, configurations=40, noise=3e-5, length_error=1e-3, angle_error=1e-3, seed=3)
    rows = m.observations
    place = {name: i for i, name in enumerate(m.configurations)}
    of_row = np.array([place[name] for name in rows["configuration"]])
    load = np.array([0.0, 40.0, 100.0])[np.arange(40) % 3]
    joints = m.joint_values[of_row] + np.outer(load[of_row], [0.0, 1e-5, 0.0, 0.0, 0.0, 0.0])
    heavy = kc.from_arrays(joints, rows["position"], targets=rows["target"], configurations=rows["configuration"],
                           payload=load[of_row], joint_names=robot.joints)  # fmt: skip
    centres = {40: [0.1, 0.0, 0.2], 100.0: np.array([0.0, -0.1, 0.3])}

    def with_centres(given):
        return kc.calibrate(robot, heavy, effects={"groups": ["payload"], "payload_centres": given}, **PLAIN)

    found = with_centres(centres)
    for term in found.result["effects"]["terms"]:
        assert term["function"] == {"centres": [{"mass": 40.0, "centre": [0.1, 0.0, 0.2]},
                                                {"mass": 100.0, "centre": [0.0, -0.1, 0.3]}]}  # fmt: skip
    (tmp_path / "m.csv").write_text(heavy.csv())
    subprocess.run([KDLCAL, "calibrate", "--measurements", "m.csv", "--effects", "payload", "--prior", "none",
                    "--payload-centre", "40=0.1,0,0.2,100=0,-0.1,0.3", "--result", "r.json"],
                   cwd=tmp_path, check=True, capture_output=True)  # fmt: skip
    q = m.joint_values
    found.save(tmp_path / "saved.json")
    for copy in (pickle.loads(pickle.dumps(found)), kc.load(tmp_path / "saved.json", robot), kc.load(tmp_path / "r.json", robot)):
        for payload in (0.0, 40.0, 70.0, 100.0):
            np.testing.assert_allclose(copy.at(payload=payload).predict(q, "A").position,
                                       found.at(payload=payload).predict(q, "A").position, rtol=0, atol=1e-9)  # fmt: skip
    for given, message in (({40: [0.1, 0.0, 0.2]}, "no centre for the measured payload of 100 kg"),
                           ({-1: [0.0, 0.0, 0.0]}, "a mass of -1 kg, expected one above 0"),
                           ({40: [0.1, 0.0]}, r"payload_centres.40: .*\(3,\)"), ({40: [np.nan] * 3}, "payload_centres")):  # fmt: skip
        with pytest.raises(kc.InputError, match=message):
            with_centres(given)
    with pytest.raises(TypeError, match="payload_centres: .* expected a dict of masses and centres"):
        with_centres([0.0, 0.0, 0.1])
    with pytest.raises(kc.InputError, match="beside that of payload_centre, expected one of the two"):
        kc.calibrate(robot, heavy, effects={"groups": ["payload"], "payload_centres": centres,
                                            "payload_centre": [0.1, 0.0, 0.0]}, **PLAIN)  # fmt: skip


def test_a_copy_with_a_payload(robot):
    m, _ = kc.simulate(robot, configurations=40, noise=3e-5, length_error=1e-3, angle_error=1e-3, seed=3)
    rows = m.observations
    place = {name: i for i, name in enumerate(m.configurations)}
    of_row = np.array([place[name] for name in rows["configuration"]])
    load = np.random.default_rng(2).uniform(0.0, 100.0, 40)[of_row]
    joints = m.joint_values[of_row] + np.outer(load, [0.0, 1e-5, 0.0, 0.0, 0.0, 0.0])
    heavy = kc.from_arrays(joints, rows["position"], targets=rows["target"], configurations=rows["configuration"], payload=load)
    found = kc.calibrate(robot, heavy, effects={"groups": ["payload"]}, **PLAIN)
    at = found.at(payload=90.0)
    copy, q = pickle.loads(pickle.dumps(at)), np.zeros(6)
    assert repr(copy) == repr(at) and " with 90 kg: " in repr(copy)
    np.testing.assert_allclose(copy.predict(q, "A").position, at.predict(q, "A").position, rtol=0, atol=1e-12)
    assert abs(found.predict(q, "A").position - at.predict(q, "A").position).max() > 1e-6
