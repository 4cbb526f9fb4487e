"""Every member of the results against the JSON of kdlcal, every word and option by what it does."""

import gc
import json
import subprocess
from types import SimpleNamespace

import numpy as np
import pytest

import kdl_calibration as kc
from conftest import KDLCAL, URDF_DIR, rows_of
from test_programs import CONTROLLER, fanuc

URDF = URDF_DIR / "fanuc_r2000ic_165f.urdf"
PLAIN = {"priors": {"automatic": False}, "effects": {"automatic": False}, "diagnosis": {"try_readings": False}}


def printed(*arguments):
    """The JSON that kdlcal prints, whatever its verdict."""
    done = subprocess.run([KDLCAL, *map(str, arguments), "--json"], capture_output=True, text=True)
    assert done.returncode in (0, 1), done.stderr
    return json.loads(done.stdout)


def expect_same(own, stated, where):
    """Each number of the JSON is that of the member of this name."""
    if isinstance(stated, dict):
        assert any(hasattr(own, key) for key in stated), where
        for key, value in stated.items():
            if hasattr(own, key):
                expect_same(getattr(own, key), value, f"{where}.{key}")
    else:
        assert own == stated, where


@pytest.fixture(scope="module")
def rich(robot, tmp_path_factory):
    """Repeats, and test rows at fitted and at new configurations, each kind with noise of its own."""
    m, _ = kc.simulate(robot, configurations=26, test_configurations=6, repeats=2, noise=3e-5, length_error=5e-4,
                       angle_error=5e-4, seed=8)  # fmt: skip
    rows = m.observations
    joints = rows_of(m)["joints"]
    again = (rows["repeat"] == 1) & ~rows["test"] & np.isin(rows["configuration"], m.configurations[:5])
    random = np.random.default_rng(2)
    points = np.vstack([rows["position"], rows["position"][again] + random.normal(0.0, 1e-4, (again.sum(), 3))])
    names = [*rows["configuration"], *(f"again {name}" for name in rows["configuration"][again])]
    split = np.where([*rows["test"], *np.ones(again.sum(), bool)], "test", "train")
    rich = kc.Measurements.from_arrays(np.vstack([joints, joints[again]]), points, configurations=names, split=split,
                                       targets=[*rows["target"], *rows["target"][again]], joint_names=robot.joints)  # fmt: skip
    folder = tmp_path_factory.mktemp("rich")
    (folder / "m.csv").write_text(rich.csv())
    return SimpleNamespace(measurements=kc.read_measurements(robot, folder / "m.csv"), csv=folder / "m.csv")


@pytest.mark.parametrize("validation", [{"nested": True, "leave_one_out": True, "k_fold": 5}, {}, {"held_out": False}])
def test_accuracy(robot, rich, validation):
    found = kc.calibrate(robot, rich.measurements, validation=validation, **PLAIN)
    own, stated = found.accuracy, found.result
    errors = stated["position_error"]
    for name in ("train", "test", "test_at_fitted_poses", "test_at_new_poses", "leave_one_out", "nested_leave_one_out",
                 "k_fold"):  # fmt: skip
        assert (getattr(own, name) is None) == (name not in errors), name
        if name in errors:
            expect_same(getattr(own, name), errors[name], name)
    expect_same(own.train_means, errors["train"]["means"], "train_means")
    assert (own.test_means is None) == ("means" not in errors["test"])
    assert own.folds == errors.get("k_fold", {}).get("folds", 0)
    iso = stated["iso_9283"]
    for name, of_json in [("iso_before", iso["before"]), ("iso_after", iso["after"]),
                          ("iso_test_before", iso["test"]["before"]), ("iso_test_after", iso["test"]["after"])]:  # fmt: skip
        expect_same(getattr(own, name), of_json, name)
    assert own.iso_test_after.accuracy.rms != own.iso_after.accuracy.rms
    if validation == {"held_out": False}:
        assert own.held_out is None
    else:
        expect_same(own.held_out, errors["leave_one_out"], "held_out")


def test_position_errors(robot, rich):
    stated = printed("validate", "--urdf", URDF, "--measurements", rich.csv)
    own = kc.validate(robot, rich.measurements)
    for name in ("all", "train", "test"):
        expect_same(getattr(own, name), stated["position_error"][name], name)
        means = stated["position_error"][name].get("means")
        assert (getattr(own, name + "_means") is None) == (means is None)
        if means:
            expect_same(getattr(own, name + "_means"), means, name + "_means")
    expect_same(own.iso_9283, stated["iso_9283"], "iso_9283")
    assert own.rms_corrected == stated["rms_corrected"]
    upper = stated["position_error"]
    assert own.all.rms * own.upper_95_factor == upper["all"]["rms_upper_95"]
    assert own.train.rms * own.upper_95_factor == upper["train"]["rms_upper_95"]
    assert own.test.rms * own.upper_95_factor_of_test == upper["test"]["rms_upper_95"]
    assert own.bases[0][:3, 3].tolist() == stated["base"]["position"]
    assert {name: pose[:3, 3].tolist() for name, pose in own.targets.items()} == {
        target["name"]: target["position"] for target in stated["targets"]
    }


def test_comparison(robot, rich, tmp_path):
    m = rich.measurements
    before = kc.calibrate(robot, m, **PLAIN)
    moved, _ = kc.simulate(robot, configurations=24, noise=3e-5, length_error=5e-4, angle_error=5e-4, seed=9)
    after = kc.calibrate(robot, moved, **PLAIN)
    assert before.trusted and after.trusted
    before.save(tmp_path / "before.json")
    after.save(tmp_path / "after.json")
    stated = printed("compare", tmp_path / "before.json", tmp_path / "after.json")
    own = kc.compare(kc.load(tmp_path / "before.json", robot), kc.load(tmp_path / "after.json", robot))
    for name in ("p_value", "chi_square", "degrees_of_freedom", "unseen_zeros", "not_compared", "same_measurements"):
        assert getattr(own, name) == stated[name], name
    assert own.has_changed == stated["changed"] and own.has_changed
    expect_same(own.flange, stated["flange"], "flange")
    assert own.flange_sigma == stated["flange"]["sigma"]
    assert len(own.parameters) == len(stated["parameters"]) > 10
    for row, of_json in zip(own.parameters, stated["parameters"]):
        for name in ("name", "joint", "before", "change", "std", "explained"):
            assert row[name] == of_json[name], name
        assert of_json["unit"] in (None, row["unit"])


GROUPS = ["gravity", "transverse", "gain", "backlash", "harmonics", "ripple", "tables", "coupling", "expansion", "drift",
          "payload"]  # fmt: skip


@pytest.mark.parametrize("group", GROUPS)
def test_each_group_is_that_of_its_name(robot, group):
    m, _ = kc.simulate(robot, configurations=130, noise=3e-5, length_error=5e-4, angle_error=5e-4, seed=3)
    place = {name: i for i, name in enumerate(m.configurations)}
    of_row = np.array([place[name] for name in m.observations["configuration"]])
    random = np.random.default_rng(1)
    around = {"temperature": random.uniform(20.0, 40.0, 130)[of_row], "payload": random.uniform(0.0, 150.0, 130)[of_row]}
    rich = kc.Measurements.from_arrays(**rows_of(m), **around)
    found = kc.calibrate(robot, rich, priors={"automatic": False}, effects={"groups": [group]},
                         validation={"held_out": False}, diagnosis={"try_readings": False})  # fmt: skip
    tried = {name for model in found.result["tried"] for name in model["effects"]}
    assert tried <= {group}
    terms = {term["group"] for term in found.result["effects"]["terms"]}
    assert terms == {group} or (group == "ripple" and not terms)  # where none is found


def test_the_direction_of_approach_needs_no_names(robot):
    """Backlash by the order of driving, with and without the names of joints."""
    m, _ = kc.simulate(robot, configurations=60, noise=3e-5, length_error=5e-4, angle_error=5e-4, seed=3)
    place = {name: i for i, name in enumerate(m.configurations)}
    of_row = np.array([place[name] for name in m.observations["configuration"]])
    sums = []
    for names in (None, robot.joints):
        driven = kc.Measurements.from_arrays(**rows_of(m), order=of_row, joint_names=names)
        found = kc.calibrate(robot, driven, priors={"automatic": False}, effects={"groups": ["backlash"]},
                             validation={"held_out": False}, diagnosis={"try_readings": False})  # fmt: skip
        functions = [term["function"] for term in found.result["effects"]["terms"]]
        assert any(function.get("of") == "approach" for function in functions)
        sums.append(found.parameters["error"].tolist())
    assert sums[0] == sums[1]


class Enough(BaseException):
    """No Exception, as KeyboardInterrupt."""


@pytest.mark.parametrize("kind", ["effect", "alternative"])
@pytest.mark.parametrize("raised", [KeyboardInterrupt, Enough])
def test_what_is_no_exception_passes_through_an_own_function(robot, measurements, kind, raised):
    def stop(q):
        raise raised("enough")

    own = {"w": {"joint": "joint_2", "function": stop}}
    options = {"effects": {"own": own}} if kind == "effect" else {"diagnosis": {"alternatives": own}}
    with pytest.raises(raised, match="enough"):
        kc.calibrate(robot, measurements, **options)


def test_a_validation_of_a_calibration_takes_its_options(robot, rich):
    found = kc.calibrate(robot, rich.measurements, **PLAIN)
    own = {"w": {"joint": "joint_2", "function": lambda q: np.sin(3.0 * q[:, 1])}}
    errors = kc.validate(found, rich.measurements, diagnosis={"alternatives": own})
    assert any("alternative w" in text for text in [*errors.warnings, *map(str, errors.doubts)])
    base = np.eye(4)
    base[:3, 3] = found.result["base"]["position"]
    known = kc.validate(found, rich.measurements, known={"bases": {"W": base}})
    assert known.registered == "targets" and (known.bases[0] == base).all()


def test_each_column_has_its_own_sigma(robot, measurements):
    def columns(q):
        return np.column_stack([np.sin(3.0 * q[:, 1]), 5.0 * np.sin(3.0 * q[:, 2])])

    figures = []
    for order in ([0, 1], [1, 0]):
        own = {"w": {"joint": "joint_2", "function": lambda q, order=order: columns(q)[:, order]}}
        found = kc.calibrate(robot, measurements, diagnosis={"alternatives": own}, priors={"automatic": False},
                             effects={"automatic": False}, validation={"held_out": False})  # fmt: skip
        (said,) = [r for r in [*found.remarks, *found.doubts] if ("alternative", "w") in r.subjects]
        figures.append([said.figures[f"estimate_{i}{end}"] for i in (1, 2) for end in ("", "_sigma")])
    assert figures[0] == pytest.approx([*figures[1][2:], *figures[1][:2]], rel=1e-6)
    assert figures[0][1] > 1.5 * figures[0][3]


def views_of(thing):
    """Its members that are arrays which share memory with it."""
    for name in dir(type(thing)):
        if not name.startswith("_") and isinstance(getattr(type(thing), name), property):
            value = getattr(thing, name)
            if isinstance(value, np.ndarray) and not value.flags.owndata:
                yield name, value


def test_views_keep_their_owners(robot, rich):
    found = kc.calibrate(robot, rich.measurements, **PLAIN)
    owners = {"plan": kc.plan(robot, count=20), "measurements": rich.measurements, "robot": robot, "found": found,
              "arm": found.arm}  # fmt: skip
    seen = 0
    for owner, thing in owners.items():
        for name, view in views_of(thing):
            seen += 1
            assert view.base is not None, f"{owner}.{name}"
    assert seen >= 2
    view = kc.plan(robot, count=20, seed=3).joint_values
    kept = view.copy()
    gc.collect()
    filling = [np.full(view.size, i, dtype=float) for i in range(200)]
    assert len(filling) == 200 and (view == kept).all()


DH = """convention,standard
joint,type,a[mm],alpha[deg],d[mm],theta[deg],lower[deg],upper[deg]
J1,revolute,0,90,400,0,-170,170
J2,revolute,700,0,0,90,-90,90
J3,revolute,100,90,0,0,-90,90
"""


def test_every_argument_of_the_readers(robot, tmp_path):
    for read in (kc.load_robot, lambda file, **links: kc.parse_robot(file.read_text(), **links)):
        part = read(URDF, base="link_1", tip="link_4")
        assert (part.base, part.tip) == ("link_1", "link_4") and len(part.joints) == 3
        assert read(URDF, tip="link_3").joints == robot.joints[:3]
        assert read(URDF, base="link_2").joints == robot.joints[2:]
    (tmp_path / "dh.csv").write_text(DH)
    whole = kc.load_dh_robot(tmp_path / "dh.csv")
    assert whole.joints == ["J1", "J2", "J3"]
    shorter = kc.load_dh_robot(tmp_path / "dh.csv", tip="link_2")
    assert shorter.tip == "link_2" and len(shorter.joints) < 3
    later = kc.load_dh_robot(tmp_path / "dh.csv", base="link_1")
    assert later.base == "link_1" and later.joints == ["J2", "J3"]


def test_progress_of_every_long_work(robot, rich):
    """An exception of the callable ends the work."""
    found = kc.calibrate(robot, rich.measurements, **PLAIN)
    works = {
        "calibrate": lambda progress: kc.calibrate(robot, rich.measurements, progress=progress),
        "validate": lambda progress: kc.validate(robot, rich.measurements, progress=progress),
        "plan": lambda progress: kc.plan(robot, count=20, progress=progress),
    }
    wrong = rows_of(rich.measurements)
    wrong["joints"] = wrong["joints"] + [0.0, 0.0, 5e-3, 0.0, 0.0, 0.0]
    wrong = kc.Measurements.from_arrays(**wrong)
    works["validate a calibration"] = lambda progress: kc.validate(found, wrong, progress=progress)
    for name, work in works.items():
        calls = []
        work(lambda *call: calls.append(call))
        assert calls, name
        with pytest.raises(ZeroDivisionError):
            work(lambda *call: 1 / 0)


def test_one_point_that_is_not_reached(found, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "in.ls").write_text(fanuc())
    changes = kc.compensate_program(found, "in.ls", controller=CONTROLLER).positions
    largest = np.sort(abs(changes["joint_values"] - changes["asked"]).max(axis=1))
    assert largest[-1] > largest[-2]
    limited = kc.compensate_program(found, "in.ls", controller=CONTROLLER, most_change=largest[-2:].mean())
    assert limited.positions["written"].sum() == 2
    assert limited.warnings[0] == "1 of 3 points are not reached and stay as they were"


def test_links_of_temperatures_are_those_of_the_robot(robot, found):
    q = np.random.default_rng(1).uniform(-1.0, 1.0, (20, 6))
    for names in (None, robot.joints):
        m = kc.Measurements.from_arrays(q, found.predict(q, "A").position, link_temperatures={"nolink": np.full(20, 20.0)},
                                        joint_names=names)  # fmt: skip
        for work in (lambda: kc.validate(robot, m), lambda: kc.calibrate(robot, m), lambda: kc.validate(found, m)):
            with pytest.raises(kc.InputError, match="temperature of 'nolink'"):
                work()


def test_alternatives_that_were_not_tried_say_why(robot, rich):
    wrong = rows_of(rich.measurements)
    wrong["joints"] = wrong["joints"] * [1, 1, -1, 1, 1, 1]
    wrong = kc.Measurements.from_arrays(**wrong)
    own = {"w": {"joint": "joint_2", "function": lambda q: np.sin(3.0 * q[:, 1])}}
    said = [str(r) for r in kc.calibrate(robot, wrong, diagnosis={"alternatives": own}).remarks]
    said += kc.validate(robot, wrong, diagnosis={"alternatives": own}).warnings
    assert [text for text in said if "alternative w" in text] == [
        "alternative w was not tried, as the input seems to be wrong"] * 2  # fmt: skip


def test_columns_that_are_not_to_be_used():
    pandas = pytest.importorskip("pandas")
    usual = {"sigma": 1e-3, "split": ["train", "test"], "temperature": 20.0, "payload": 80.0, "repeat": [3, 4],
             "station": ["V", "W"], "configuration": ["a", "b"], "target": ["E", "F"]}  # fmt: skip
    frame = pandas.DataFrame({"q": [0.0, 1.0], "x": 1.0, "y": 2.0, "z": 3.0, "temperature_link_2": 25.0, **usual})
    bare = kc.from_pandas(frame[["q", "x", "y", "z"]], ["q"]).csv()
    assert kc.from_pandas(frame, ["q"]).csv() != bare
    keywords = {"sigma": "sigma", "split": "split", "temperature": "temperature", "payload": "payload", "repeats": "repeat",
                "stations": "station", "configurations": "configuration", "targets": "target"}  # fmt: skip
    for keyword, column in keywords.items():
        alone = frame[["q", "x", "y", "z", column]]
        assert kc.from_pandas(alone, ["q"]).csv() != bare, keyword
        assert kc.from_pandas(alone, ["q"], **{keyword: None}).csv() == bare, keyword
    unused = dict.fromkeys([*keywords, "link_temperatures"])
    assert kc.from_pandas(frame, ["q"], **unused).csv() == bare


def test_arrays_of_a_convention_are_copies():
    file = URDF_DIR / "fanuc_r2000ic_165f_pendant.json"
    stated = json.loads(file.read_text())
    for name in ("matrix", "offset"):
        array = getattr(kc.read_joint_convention(file), name)
        gc.collect()
        filling = [np.full(array.size, i, dtype=float) for i in range(200)]
        assert len(filling) == 200 and array.tolist() == stated[name]
        convention = kc.read_joint_convention(file)
        getattr(convention, name)[...] = 5.0
        assert getattr(convention, name).tolist() == stated[name]


@pytest.mark.parametrize("joints", [2, 7])
def test_rows_of_arms_with_other_numbers_of_joints(joints):
    links = "".join(f"<link name='l{i}'/>" for i in range(joints + 1))
    axes = ["0 0 1", "0 1 0", "1 0 0"]
    chain = "".join(
        f"<joint name='j{i}' type='revolute'><parent link='l{i}'/><child link='l{i + 1}'/><axis xyz='{axes[i % 3]}'/>"
        f"<origin xyz='0.1 {0.02 * i} 0.3'/><limit lower='-2' upper='2' effort='1' velocity='1'/></joint>"
        for i in range(joints)
    )
    _, arm = kc.simulate(kc.parse_robot(f"<robot name='r'>{links}{chain}</robot>"), configurations=20)
    q = np.random.default_rng(1).uniform(-1.5, 1.5, (5, joints))
    poses, jacobians = arm.flange_jacobians(q)
    assert jacobians.shape == (5, 6, joints) and poses.shape == (5, 4, 4)
    np.testing.assert_allclose(poses, arm.flange_poses(q), rtol=0, atol=1e-14)
    for i in range(5):
        one_pose, one_jacobian = arm.flange_jacobians(q[i])
        np.testing.assert_array_equal(poses[i], one_pose)
        np.testing.assert_array_equal(jacobians[i], one_jacobian)
        step = 1e-6
        for j in range(joints):  # central differences of positions
            there = [arm.flange_poses(q[i] + sign * step * np.eye(joints)[j])[:3, 3] for sign in (1, -1)]
            np.testing.assert_allclose(jacobians[i][:3, j], (there[0] - there[1]) / (2.0 * step), atol=1e-8)
