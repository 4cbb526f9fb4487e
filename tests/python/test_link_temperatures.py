"""Links with temperatures of their own. The arm is computed here, without the library."""

import pickle

import numpy as np
import pytest

import kdl_calibration as kc

QUICK = {"diagnosis": {"try_readings": False}}
JOINTS = [f"joint_{i}" for i in range(1, 7)]
ORIGINS = np.array([[0, 0, 0.67], [0, 0.312, 0], [0, 0, 1.075], [0, 1.28, 0.225], [0, 0, 0], [0, 0, 0]])
AXES = [2, 0, 0, 1, 0, 1]
SENSORS = ["base_link", "link_1", "link_2", "link_3"]  # those whose links have a length
GROWTH = np.array([12e-6, 24e-6, 17e-6, 21e-6])  # [1/K]
TOOLS = {"A": [0.2, 0.215, 0.05], "B": [-0.1, 0.3, 0.2], "C": [0.05, 0.25, -0.2]}  # in link_6 [m]
LENGTHS = np.array([4e-4, -5e-4, 6e-4, 8e-4])  # [m] errors along the links
ZEROS = np.radians([0.0, 0.03, -0.02, 0.04, 0.05, 0.0])
TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
PLACE = np.array([2.0, 1.0, 0.5])
NOISE = 2e-5


def turned(axis, angle):
    a, b = (axis + 1) % 3, (axis + 2) % 3
    R = np.eye(3)
    R[a, a] = R[b, b] = np.cos(angle)
    R[b, a], R[a, b] = np.sin(angle), -np.sin(angle)
    return R


def position(q, tool, warmth, growth=GROWTH):
    """In the measuring frame [m]; `warmth` of the links of SENSORS [degC]."""
    R, p = np.eye(3), np.zeros(3)
    for i, origin in enumerate(ORIGINS):
        length = np.linalg.norm(origin)
        if length > 0.0:
            origin = origin * (1.0 + growth[i] * (warmth[i] - 20.0)) + LENGTHS[i] * origin / length
        p = p + R @ origin
        R = R @ turned(AXES[i], q[i] + ZEROS[i])
    return PLACE + TURN @ (p + R @ np.asarray(tool))


def day(count, random):
    """(count, 4): the base is slow, motors heat the turntable, sun comes and goes on the forearm."""
    t = np.linspace(0.0, 1.0, count)
    sun = 4.0 * np.sin(9.0 * t)
    curves = [20.0 + 8.0 * t**2, 38.0 - 18.0 * np.exp(-5.0 * t), 20.0 + 9.0 * t, 24.0 + 7.0 * np.exp(-3.0 * t) + sun]
    return np.column_stack(curves) + 0.1 * random.normal(size=(count, 4))


def arrays(growth=GROWTH, count=60, seed=3):
    random = np.random.default_rng(seed)
    q = random.uniform([-2.5, -1.0, -1.5, -3.0, -1.8, -3.0], [2.5, 0.9, 1.5, 3.0, 1.8, 3.0], size=(count, 6))
    warmth = day(count, random)
    points = np.array([[position(q[c], tool, warmth[c], growth) for tool in TOOLS.values()] for c in range(count)])
    return q, points + NOISE * random.normal(size=points.shape), warmth


def by_link(warmth):
    return dict(zip(SENSORS, warmth.T))


def terms_of(found):
    return [term for term in found.result["effects"]["terms"] if term["group"] in ("expansion", "drift")]


@pytest.fixture(scope="module")
def warm():
    return arrays()


@pytest.fixture(scope="module")
def found(robot, warm):
    q, points, warmth = warm
    return kc.calibrate(robot, kc.from_arrays(q, points, link_temperatures=by_link(warmth)), **QUICK)


def test_each_link_is_found_to_grow_by_its_own_coefficient(found):
    terms = terms_of(found)
    assert [term["name"] for term in terms] == [f"expansion.{i}" for i in range(1, 5)]
    growth = np.array([term["coefficient"] / term["scale"] for term in terms])
    sigma = np.array([term["std"] / term["scale"] for term in terms])
    assert (sigma < 0.25 * GROWTH).all(), sigma / GROWTH
    assert (abs(growth - GROWTH) < 3.0 * sigma).all(), (growth - GROWTH) / sigma


def errors_at(there, q, warmth, growth=GROWTH):
    return [np.linalg.norm(there.predict(q, name, frame="measuring").position - position(q, tool, warmth, growth))
            for name, tool in TOOLS.items()]  # fmt: skip


def test_predictions_elsewhere_are_far_better_than_with_one_temperature(robot, warm, found):
    q, points, warmth = warm
    one = kc.calibrate(robot, kc.from_arrays(q, points, temperature=warmth.mean(axis=1)), **QUICK)
    assert found.accuracy.held_out.after.rms < 0.6 * one.accuracy.held_out.after.rms
    new_q, _, new_warmth = arrays(count=40, seed=8)
    own, single = [], []
    for at, T in zip(new_q, new_warmth):
        own += errors_at(found.at(link_temperatures=by_link(T)), at, T)
        single += errors_at(one.at(temperature=T.mean()), at, T)
    assert np.sqrt(np.mean(np.square(own))) < 0.35 * np.sqrt(np.mean(np.square(single)))
    assert np.sqrt(np.mean(np.square(own))) < 3e-5


def test_a_commanded_point_is_reached_at_the_temperatures_of_the_links(found):
    T = np.array([22.0, 33.0, 30.0, 21.0])
    q = np.array([0.4, -0.3, 0.5, 0.7, 0.9, -0.5])
    there = found.at(link_temperatures=by_link(T))
    command = kc.Compensator(there).solve(q)
    nominal = kc.Compensator(found).solve(q)
    reached = there.flange_poses(command.joint_values)[:3, 3]
    assert np.linalg.norm(there.flange_poses(nominal.joint_values)[:3, 3] - reached) > 5e-5


def test_nothing_grows_in_an_arm_that_does_not(robot):
    q, points, warmth = arrays(growth=np.zeros(4), seed=5)
    found = kc.calibrate(robot, kc.from_arrays(q, points, link_temperatures=by_link(warmth)), **QUICK)
    assert terms_of(found) == []


def test_links_without_a_sensor_have_the_temperature_of_the_arm(robot, warm):
    q, points, warmth = warm
    effects = {"groups": ["expansion"]}
    mixed = kc.from_arrays(q, points, temperature=warmth[:, 1], link_temperatures={"link_3": warmth[:, 3]})
    spelled = kc.from_arrays(q, points, link_temperatures=dict(zip(SENSORS, warmth[:, [1, 1, 1, 3]].T)))
    found, same = (kc.calibrate(robot, m, effects=effects, **QUICK) for m in (mixed, spelled))
    assert found.result["effects"]["terms"] == same.result["effects"]["terms"]
    assert len(terms_of(found)) == 4
    some = kc.from_arrays(q, points, link_temperatures={"link_3": warmth[:, 3], "link_6": warmth[:, 0]})
    terms = terms_of(kc.calibrate(robot, some, effects=effects, **QUICK))
    assert [term["name"] for term in terms] == ["expansion.4"]
    stated = found.result["effects"]["circumstances"]
    assert stated["temperature"] == pytest.approx(warmth[:, 1].mean(), abs=1e-9)
    assert stated["link_temperatures"] == pytest.approx({"link_3": warmth[:, 3].mean()}, abs=1e-9)


def test_a_joint_drifts_with_the_link_that_it_moves_from(robot):
    random = np.random.default_rng(11)
    q, _, _ = arrays(seed=11)
    T = 20.0 + 10.0 * random.uniform(size=(60, 2))
    drift = 2e-5  # [rad/K] of joint 3, with the temperature of link_2
    real = q + np.outer(T[:, 1] - 25.0, [0, 0, drift, 0, 0, 0])
    points = np.array([[position(at, tool, np.full(4, 20.0)) for tool in TOOLS.values()] for at in real])
    points += NOISE * random.normal(size=points.shape)
    m = kc.from_arrays(q, points, link_temperatures={"link_3": T[:, 0], "link_2": T[:, 1]})
    found = kc.calibrate(robot, m, effects={"groups": ["drift"]}, **QUICK)
    terms = {term["name"]: term for term in terms_of(found)}
    assert set(terms) == {"drift.3", "drift.4"}
    third = terms["drift.3"]
    assert abs(third["coefficient"] / third["scale"] - drift) < 3.0 * third["std"] / third["scale"]
    assert third["std"] / third["scale"] < 0.2 * drift


def test_columns_that_say_nothing_change_no_bit(robot, warm):
    q, points, warmth = warm
    plain = {"effects": {"groups": ["expansion"]}, **QUICK}
    one = kc.calibrate(robot, kc.from_arrays(q, points, temperature=warmth[:, 0]), **plain)
    for more in ({"link_temperatures": {}}, {"link_temperatures": {"link_2": warmth[:, 0]}}):
        same = kc.calibrate(robot, kc.from_arrays(q, points, temperature=warmth[:, 0], **more), **plain)
        assert one.covariance.tobytes() == same.covariance.tobytes()
        assert one.parameters["value"].tobytes() == same.parameters["value"].tobytes()


def test_files_columns_and_copies_say_the_same(robot, warm, tmp_path):
    q, points, warmth = warm
    m = kc.from_arrays(q, points, link_temperatures=by_link(warmth), temperature=25.0, joint_names=JOINTS)
    head = m.csv().splitlines()[0]
    assert head.endswith(",temperature[degC]," + ",".join(f"temperature_{link}[degC]" for link in SENSORS))
    assert pickle.loads(pickle.dumps(m)).csv() == m.csv()
    (tmp_path / "m.csv").write_text(m.csv())
    assert kc.read_measurements(robot, tmp_path / "m.csv").csv() == m.csv()
    structured = np.zeros(len(q), dtype=[(link, float) for link in SENSORS])
    for link, values in by_link(warmth).items():
        structured[link] = values
    assert kc.from_arrays(q, points, link_temperatures=structured, temperature=25.0, joint_names=JOINTS).csv() == m.csv()
    rows = np.repeat(np.arange(len(q)), 3)
    of_targets = {link: np.repeat(values[:, None], 3, axis=1) for link, values in by_link(warmth).items()}
    assert kc.from_arrays(q, points, link_temperatures=of_targets, temperature=25.0, joint_names=JOINTS).csv() == m.csv()

    class Frame(dict):  # as far as from_pandas uses one
        @property
        def columns(self):
            return list(self)

        def __getitem__(self, names):
            if isinstance(names, list):
                return Column(np.column_stack([dict.__getitem__(self, name) for name in names]))
            return Column(dict.__getitem__(self, names))

    class Column:
        def __init__(self, values):
            self.values = values

        def to_numpy(self):
            return self.values

    columns = {name: q[rows, i] for i, name in enumerate(JOINTS)}
    columns.update(zip("xyz", points.reshape(-1, 3).T))
    columns.update({"target": np.tile(list(TOOLS), len(q)), "temperature": np.full(len(rows), 25.0)})
    own = {f"temperature_{link}": values[rows] for link, values in by_link(warmth).items()}
    assert kc.from_pandas(Frame({**columns, **own}), JOINTS).csv() == m.csv()
    renamed = {f"T{i}": values for i, values in enumerate(own.values())}
    names = {link: f"T{i}" for i, link in enumerate(SENSORS)}
    assert kc.from_pandas(Frame({**columns, **renamed}), JOINTS, link_temperatures=names).csv() == m.csv()


def test_a_saved_result_predicts_at_the_same_temperatures(robot, warm, found, tmp_path):
    q = np.array([0.3, -0.2, 0.4, 0.3, 0.6, 0.2])
    found.save(tmp_path / "r.json")
    loaded = kc.load(tmp_path / "r.json", robot)
    for use in (lambda f: f, lambda f: f.at(temperature=29.0), lambda f: f.at(27.0, link_temperatures={"link_2": 35.0})):
        np.testing.assert_allclose(use(loaded).predict(q, "A").position, use(found).predict(q, "A").position, rtol=0, atol=1e-12)
    all_warm = {link: 29.0 for link in SENSORS}
    np.testing.assert_array_equal(found.at(link_temperatures=all_warm).predict(q, "A").position,
                                  found.at(temperature=29.0).predict(q, "A").position)  # fmt: skip
    one = found.at(link_temperatures={"link_2": 35.0})
    assert " with link_2 at 35 degC: " in repr(one)
    again = one.at(link_temperatures={"link_3": 30.0})
    both = found.at(link_temperatures={"link_2": 35.0, "link_3": 30.0})
    np.testing.assert_array_equal(again.predict(q, "A").position, both.predict(q, "A").position)
    copied = pickle.loads(pickle.dumps(again))
    assert repr(copied) == repr(again) == repr(both)
    np.testing.assert_allclose(copied.predict(q, "A").position, both.predict(q, "A").position, rtol=0, atol=1e-12)
    cooler = one.at(link_temperatures={"link_2": 22.0})
    assert " with link_2 at 22 degC: " in repr(cooler) == repr(pickle.loads(pickle.dumps(cooler)))
    for same in (found.at(link_temperatures={"link_2": 22.0}), pickle.loads(pickle.dumps(cooler))):
        np.testing.assert_allclose(same.predict(q, "A").position, cooler.predict(q, "A").position, rtol=0, atol=1e-12)
    warmer = one.at(temperature=30.0)
    assert "link_2" not in repr(warmer)
    np.testing.assert_array_equal(warmer.predict(q, "A").position, found.at(30.0).predict(q, "A").position)


def test_far_from_what_a_link_had_it_is_said(found):
    q = np.array([0.3, -0.2, 0.4, 0.0, 0.6, 0.0])
    mean = found.predict(q, "A")
    near = found.at(link_temperatures={"link_2": 26.0}).predict(q, "A")
    far = found.at(link_temperatures={"link_2": 150.0}).predict(q, "A")
    assert not mean.outside and not near.outside and far.outside


def test_other_measurements_state_what_the_effects_depend_on(robot, warm, found):
    q, points, warmth = arrays(count=20, seed=9)
    of_links = by_link(warmth)
    well = kc.validate(found, kc.from_arrays(q, points, link_temperatures=of_links))
    badly = kc.validate(found, kc.from_arrays(q, points, temperature=warmth.mean(axis=1)))
    assert well.all.rms < 6e-5 < badly.all.rms
    del of_links["link_1"]
    for use in (
        lambda m: kc.validate(found, m),
        lambda m: kc.calibrate(robot, m, priors={"earlier": found}, **QUICK),
    ):
        with pytest.raises(kc.InputError, match="the arrays: no temperature_link_1 and no temperature, expected one of the two: "
                                                "the effect expansion.2 depends on it"):  # fmt: skip
            use(kc.from_arrays(q, points, link_temperatures=of_links))
        use(kc.from_arrays(q, points, link_temperatures=of_links, temperature=warmth[:, 1]))


def test_a_continued_calibration_keeps_the_temperatures_of_its_links(robot, warm, found):
    q, points, warmth = arrays(count=12, seed=10)
    more = kc.calibrate(robot, kc.from_arrays(q, points, link_temperatures=by_link(warmth)), priors={"earlier": found}, **QUICK)
    own = []
    new_q, _, new_warmth = arrays(count=20, seed=12)
    for at, T in zip(new_q, new_warmth):
        own += errors_at(more.at(link_temperatures=by_link(T)), at, T)
    assert np.sqrt(np.mean(np.square(own))) < 3e-5


def test_an_unchanged_arm_on_another_day_has_not_changed(robot, warm, found):
    q, points, warmth = arrays(count=60, seed=21)
    later = kc.calibrate(robot, kc.from_arrays(q, points, link_temperatures=by_link(warmth + [2.0, -3.0, 5.0, 1.0])), **QUICK)
    q, points, warmth = arrays(count=60, seed=22)
    same = kc.calibrate(robot, kc.from_arrays(q, points, link_temperatures=by_link(warmth)), **QUICK)
    assert not kc.compare(found, same).has_changed
    assert kc.compare(found, later).flange.rms > 2.0 * kc.compare(found, same).flange.rms  # its sensors are off


@pytest.mark.parametrize(
    ("given", "error", "words"),
    [
        ({"link_9": 20.0}, kc.InputError, "the arrays: temperature of 'link_9', which is no link of the chain: expected some of "
         "base_link, link_1, link_2, link_3, link_4, link_5, link_6, flange"),
        ({"link_2": [20.0, 21.0]}, kc.InputError, r"link_temperatures\['link_2'\]: an array of shape \(2,\), expected \(60,\) or "
         r"\(60, 3\)"),
        ({"link_2": 5000.0}, kc.InputError, "an impossible temperature of 'link_2', expected -273.15 to 1000"),
        ({"link_2": "warm"}, TypeError, r"link_temperatures\['link_2'\]: an array of <U4"),
        ({"link_2": None}, TypeError, r"link_temperatures\['link_2'\]: None, expected numbers"),
        ({2: 20.0}, TypeError, r"link_temperatures: \[2\], expected names of links"),
        (20.0, TypeError, "link_temperatures: float, expected a mapping of links to numbers or a structured array"),
        (np.ones(60), TypeError, "link_temperatures: ndarray, expected a mapping"),
        ({"link_2": np.ma.masked_array(np.ones(60), np.arange(60) == 3)}, kc.InputError, r"link_temperatures\['link_2'\]: masked"),
        ({"link_2": np.where(np.arange(60) == 3, np.nan, 20.0)}, kc.InputError, "the arrays: configuration '4' has no "
         "temperature_link_2, expected one in each configuration or in none"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said(robot, warm, given, error, words):
    q, points, _ = warm
    with pytest.raises(error, match=words):
        kc.calibrate(robot, kc.from_arrays(q, points, link_temperatures=given), **QUICK)


def test_temperatures_that_nothing_depends_on_are_refused(found):
    for given, words in (
        ({"link_9": 30.0}, "temperature of 'link_9': no effect of this calibration depends on it, expected that of base_link, "
         "link_1, link_2, link_3"),
        ({"link_5": 30.0}, "temperature of 'link_5': no effect"),
        ({"link_2": np.inf}, "temperature of 'link_2': not finite, expected a number"),
    ):  # fmt: skip
        with pytest.raises(kc.InputError, match=words):
            found.at(link_temperatures=given)
    with pytest.raises(TypeError):
        found.at(link_temperatures=[30.0])
