"""Effects that are functions of the caller's own."""

import pickle

import numpy as np
import pytest

import kdl_calibration as kc

PLAIN = {"priors": {"automatic": False}, "diagnosis": {"try_readings": False}}


def bend(q):
    """(N, 2) for joint values (N, 6)."""
    return np.column_stack([np.sin(2.0 * q[:, 1]), q[:, 1] * q[:, 2]])


def wave(q):
    return np.sin(3.0 * q[:, 1])


def with_own(automatic=False, **functions):
    own = {name: {"joint": "joint_2", "function": function} for name, function in functions.items()}
    return {"effects": {"own": own, "automatic": automatic}, **PLAIN}


@pytest.fixture(scope="module")
def yielding(robot):
    """Measurements of a robot whose joint 2 moves by 0.2 mrad of `wave`."""
    m, _ = kc.simulate(robot, configurations=60, noise=3e-5, length_error=1e-3, angle_error=1e-3, seed=4)
    commanded = m.joint_values.copy()
    for _ in range(20):
        commanded[:, 1] = m.joint_values[:, 1] - 2e-4 * wave(commanded)
    place = {name: i for i, name in enumerate(m.configurations)}
    rows = m.observations
    return kc.Measurements.from_arrays(commanded[[place[name] for name in rows["configuration"]]], rows["position"],
                                       targets=rows["target"], configurations=rows["configuration"])


def size_of(found, name):
    (term,) = [term for term in found.result["effects"]["terms"] if term["name"] == name]
    return term["coefficient"] / term["scale"], term["std"] / term["scale"]


def test_the_one_that_is_there_is_chosen(robot, yielding):
    found = kc.calibrate(robot, yielding, **with_own(automatic=True, wave=wave, bend=bend))
    assert found.result["effects"]["terms"][0]["name"] == "own.wave.2"
    value, sigma = size_of(found, "own.wave.2")
    assert abs(value - 2e-4) < 4.0 * sigma < 0.1 * 2e-4
    rigid = kc.calibrate(robot, yielding, effects={"automatic": False}, **PLAIN)
    assert found.accuracy.held_out.after.rms < 0.7 * rigid.accuracy.held_out.after.rms
    assert "joint_2 moves by up to" in found.result["effects"]["findings"][0]


def test_any_number_of_threads_gives_the_same(robot, yielding, random):
    alone = kc.calibrate(robot, yielding, threads=1, **with_own(bend=bend))
    several = kc.calibrate(robot, yielding, threads=3, **with_own(bend=bend))
    q = random.uniform(-1.0, 1.0, (500, 6))
    np.testing.assert_array_equal(alone.predict(q, "A", threads=1).position, several.predict(q, "A", threads=4).position)
    assert (alone.residuals["position"] == several.residuals["position"]).all()
    kc.Compensator(several).solve(q[:20])


def test_files_and_copies_need_the_function(robot, yielding, random, tmp_path):
    found = kc.calibrate(robot, yielding, **with_own(bend=bend))
    found.save(tmp_path / "result.json")
    found.report(tmp_path / "report.html")
    q = random.uniform(-1.0, 1.0, (50, 6))
    with pytest.raises(kc.InputError, match="'bend' is a function of the program"):
        kc.load(tmp_path / "result.json", robot)
    with pytest.raises(kc.InputError, match="the given function 'bend' is .* there, expected .* as when it was fitted"):
        kc.load(tmp_path / "result.json", robot, own={"bend": {"joint": "joint_2", "function": lambda q: 1.1 * bend(q)}})
    loaded = kc.load(tmp_path / "result.json", robot, own=found.own)
    for other in (loaded, pickle.loads(pickle.dumps(found)), pickle.loads(pickle.dumps(loaded))):
        np.testing.assert_allclose(other.predict(q, "A").position, found.predict(q, "A").position, rtol=0, atol=1e-12)


def test_a_function_that_changes_after_the_fit(robot, yielding, tmp_path):
    """The file has the values of the fit."""
    times = 3.0

    def changing(q):
        return np.sin(times * q[:, 1])

    found = kc.calibrate(robot, yielding, **with_own(wave=changing))
    times = 2.0
    found.save(tmp_path / "r.json")
    with pytest.raises(kc.InputError, match="as when it was fitted"):
        kc.load(tmp_path / "r.json", robot, found.own)
    times = 3.0
    kc.load(tmp_path / "r.json", robot, found.own)


def test_a_function_that_loses_a_column(robot, yielding):
    width = 2

    def columns(q):
        return np.column_stack([np.sin(3.0 * q[:, 1]), np.cos(3.0 * q[:, 1])])[:, :width]

    found = kc.calibrate(robot, yielding, **with_own(wave=columns))
    assert {term["function"]["column"] for term in found.result["effects"]["terms"]} == {0, 1}
    width = 1
    with pytest.raises(kc.InputError, match="wave gives 1 columns, expected as many as when it was fitted"):
        found.predict(yielding.joint_values[:5], "A")


def test_functions_that_differ_somewhere(robot, yielding, tmp_path):
    found = kc.calibrate(robot, yielding, **with_own(wave=wave))
    found.save(tmp_path / "r.json")
    for other in (
        lambda q: np.where(q[:, 1] > np.quantile(yielding.joint_values[:, 1], 0.8), 5.0, wave(q)),
        lambda q: wave(q) * (abs(q[:, 0]) < 0.5),
        lambda q: np.column_stack([wave(q), q[:, 0]]),
    ):
        with pytest.raises(kc.InputError, match="as when it was fitted"):
            kc.load(tmp_path / "r.json", robot, {"wave": {"joint": "joint_2", "function": other}})


def test_what_a_function_does_wrong_is_told(robot, yielding):
    def broken(q):
        raise KeyError("no such table")

    for function, error, message in [
        (broken, KeyError, "no such table"),
        (lambda q: q[:3, 0], kc.InputError, "3 rows of 1 columns, expected a row for each of the 60"),
        (lambda q: np.full(len(q), np.nan), kc.InputError, "not finite at joint values"),
        (lambda q: np.ones(len(q)), kc.InputError, "the same at all configurations"),
        (lambda q: q[:, 1] - q[:, 1].mean(), kc.InputError, "other values at one configuration than among all"),
        (lambda q: np.ones((len(q), 1, 1)), ValueError, r"\(60, 1, 1\), expected \(N,\) or \(N, K\)"),
        (lambda q: "text", TypeError, "effects.own.wave.function"),
        (5, TypeError, "expected a function of joint values"),
    ]:
        with pytest.raises(error, match=message):
            kc.calibrate(robot, yielding, **with_own(wave=function))
    with pytest.raises(TypeError, match="unknown option effects.own.wave.axes"):
        kc.calibrate(robot, yielding, effects={"own": {"wave": {"axes": "own"}}})
    with pytest.raises(TypeError, match="effects.own.wave: no function"):
        kc.calibrate(robot, yielding, effects={"own": {"wave": {"joint": "joint_2"}}})
    with pytest.raises(TypeError, match="effects.own.wave: no joint"):
        kc.calibrate(robot, yielding, effects={"own": {"wave": {"function": wave}}})
    with pytest.raises(kc.InputError, match="wave moves joint_9, expected a moving joint"):
        kc.calibrate(robot, yielding, effects={"own": {"wave": {"joint": "joint_9", "function": wave}},
                                               "automatic": False}, **PLAIN)


@pytest.mark.parametrize("layout", [np.asfortranarray, lambda a: np.repeat(a, 2, axis=0)[::2], lambda a: a[::-1].copy()[::-1]])
def test_any_layout_of_columns_gives_the_same(robot, yielding, layout):
    expected, found = (kc.calibrate(robot, yielding, **with_own(bend=function)) for function in (bend, lambda q: layout(bend(q))))
    np.testing.assert_array_equal(found.parameters["error"], expected.parameters["error"])


@pytest.mark.parametrize("axis", ["own", "x", "y", "along"])
def test_axis_of_an_effect(robot, yielding, axis, tmp_path):
    own = {"wave": {"joint": "joint_2", "axis": axis, "function": wave}}
    found = kc.calibrate(robot, yielding, effects={"own": own, "automatic": False}, **PLAIN)
    (term,) = found.result["effects"]["terms"]
    assert term["about"] == axis
    found.save(tmp_path / "r.json")
    other = {"wave": {**own["wave"], "axis": "x" if axis == "y" else "y"}}
    with pytest.raises(kc.InputError, match=f"moves joint_2 about '{other['wave']['axis']}'"):
        kc.load(tmp_path / "r.json", robot, other)
    with pytest.raises(kc.InputError, match="moves joint_3"):
        kc.load(tmp_path / "r.json", robot, {"wave": {**own["wave"], "joint": "joint_3"}})


def test_another_function_of_the_same_minimum(robot, yielding, tmp_path):
    found = kc.calibrate(robot, yielding, **with_own(wave=wave))
    found.save(tmp_path / "r.json")
    for other in (lambda q: np.maximum(wave(q), 0.5 * wave(q)), lambda q: np.minimum(wave(q), 0.5 * wave(q))):
        with pytest.raises(kc.InputError, match="as when it was fitted"):
            kc.load(tmp_path / "r.json", robot, {"wave": {"joint": "joint_2", "function": other}})


@pytest.mark.parametrize("function", [lambda q: q[:, 1] - q[0, 1], lambda q: q[:, 1] - q[-1, 1], lambda q: np.cumsum(q[:, 1])])
def test_functions_of_other_rows(robot, yielding, function):
    with pytest.raises(kc.InputError, match="other values at one configuration than among all"):
        kc.calibrate(robot, yielding, **with_own(wave=function))


def test_one_call_for_each_evaluation_of_an_arm(robot, yielding):
    """However many columns; with its derivative for 2 n + 1 configurations at once."""
    sizes = []

    def counted(q):
        sizes.append(len(q))
        return np.column_stack([np.sin(3.0 * q[:, 1]), q[:, 2] * q[:, 1]])

    found = kc.calibrate(robot, yielding, effects={"own": {"pair": {"joint": "joint_2", "function": counted}},
                                                   "automatic": False}, **PLAIN)  # fmt: skip
    assert len(found.result["effects"]["terms"]) == 2
    q = np.full((1, 6), 0.3)
    sizes.clear()
    found.flange_poses(q)
    assert sizes == [1]
    sizes.clear()
    _, jacobian = found.arm.flange_jacobians(q)
    assert sizes == [13]
    step = 1e-5 * np.eye(6)
    difference = found.flange_poses(q + step)[:, :3, 3] - found.flange_poses(q - step)[:, :3, 3]
    np.testing.assert_allclose(jacobian[0, :3].T, difference / 2e-5, atol=1e-7)


def test_the_arm_adds_the_columns_of_a_function(robot, yielding):
    """Predictions and poses of the flange are of one arm: the target stays where it is in the flange frame."""

    def pair(q):
        return np.column_stack([np.sin(3.0 * q[:, 1]), q[:, 2] * q[:, 1]])

    found = kc.calibrate(robot, yielding, effects={"own": {"pair": {"joint": "joint_2", "function": pair}},
                                                   "automatic": False}, **PLAIN)  # fmt: skip
    q = yielding.joint_values[:5]
    X = found.flange_poses(q)
    offset = found.predict(q, "A").position - X[:, :3, 3]
    in_flange = np.einsum("nji,nj->ni", X[:, :3, :3], offset)
    np.testing.assert_allclose(in_flange, in_flange[[0] * 5], rtol=0, atol=1e-12)


def test_own_is_as_it_was_given(robot, yielding):
    given = with_own(wave=wave)
    found = kc.calibrate(robot, yielding, **given)
    given["effects"]["own"].clear()
    assert pickle.loads(pickle.dumps(found)).own.keys() == {"wave"}


def test_columns_that_are_no_array_and_values_at_one_configuration(robot, yielding):
    with pytest.raises(ValueError, match=r"effects.own.wave.function: an array of shape \(\), expected \(N,\) or \(N, K\)"):
        kc.calibrate(robot, yielding, **with_own(wave=lambda q: 1.0))
    at = yielding.joint_values[7]
    with pytest.raises(kc.InputError, match=f"not finite at joint values {at[0]!r:.8}"):
        kc.calibrate(robot, yielding, **with_own(wave=lambda q: np.where(q[:, 0] == at[0], np.nan, q[:, 1])))


def test_a_calibration_that_is_continued(robot, yielding, tmp_path):
    """It has the earlier one's effects, and so has one that continues a loaded one."""
    found = kc.calibrate(robot, yielding, **with_own(wave=wave))
    with pytest.raises(kc.InputError, match="priors.earlier: decides this already, expected no effects beside it"):
        kc.calibrate(robot, yielding, priors={"earlier": found}, effects=with_own(wave=wave)["effects"])
    found.save(tmp_path / "a.json")
    loaded = kc.load(tmp_path / "a.json", robot, own=found.own)
    for earlier in (found, loaded):
        again = kc.calibrate(robot, yielding, priors={"earlier": earlier}, diagnosis={"try_readings": False})
        assert again.own.keys() == {"wave"}
        copy = pickle.loads(pickle.dumps(again))
        q = yielding.joint_values[:5]
        np.testing.assert_allclose(copy.predict(q, "A").position, again.predict(q, "A").position, rtol=0, atol=1e-12)
        again.report(tmp_path / "again.html")
        again.save(tmp_path / "b.json")
        with pytest.raises(kc.InputError, match="as when it was fitted"):
            kc.load(tmp_path / "b.json", robot, own={"wave": {"joint": "joint_2", "function": lambda q: 1.1 * wave(q)}})


def test_what_is_changed_afterwards_changes_no_result(robot, yielding):
    given = with_own(wave=wave)
    found = kc.calibrate(robot, yielding, **given)
    given["effects"]["own"]["wave"]["axis"] = "x"
    found.own["wave"]["joint"] = "joint_5"
    pickle.loads(pickle.dumps(found))
