"""Programs of controllers: what kdlcal writes, to the last byte."""

import json
import subprocess
from hashlib import sha256

import numpy as np
import pytest

import kdl_calibration as kc
from conftest import KDLCAL, URDF_DIR

CONTROLLER = URDF_DIR / "fanuc_r2000ic_165f_controller.json"
FRAMES = {"user_frames": {"2": {"position": [0.1, 0.0, 0.0], "quaternion_wxyz": [1, 0, 0, 0]}}}


def fanuc(frame=0, joints=(0.0, -10.0, -20.0, 5.0, -60.0, 7.0)):
    """A pose, joint values and a pose that no arm reaches."""
    values = ",".join(f"\tJ{i + 1}= {value:9.3f} deg" for i, value in enumerate(joints))
    pose = (
        "P[{0}]{{\n   GP1:\n\tUF : {1}, UT : 0,\t\tCONFIG : 'N U T, 0, 0, 0',\n\tX = {2:9.3f}  mm,\tY =   200.000  mm,"
        "\tZ =   900.000  mm,\n\tW =   180.000 deg,\tP =   -60.000 deg,\tR =    10.000 deg\n}};\n"
    )
    return (
        "/PROG  T\n/MN\n   1:J P[1] 50% FINE ;\n   2:L P[2] 9mm/sec FINE ;\n   3:J P[3] 50% FINE ;\n/POS\n"
        + pose.format(1, frame, 1850.0)
        + pose.format(2, frame, 1700.0)
        + f"P[3]{{\n   GP1:\n\tUF : 0, UT : 0,\n{values}\n}};\n/END\n"
    )


KRL = {
    "k.src": "DEF k()\nBAS(#INITMOV,0)\nPTP XP1\nEND\n",
    "k.dat": "DEFDAT k\nDECL E6AXIS XP1={A1 10.0,A2 -10.0,A3 15.0,A4 5.0,A5 30.0,A6 2.0}\nENDDAT\n",
}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "in.ls").write_text(fanuc())
    (tmp_path / "framed.ls").write_text(fanuc(frame=2))
    (tmp_path / "frames.json").write_text(json.dumps(FRAMES))
    for name, text in KRL.items():
        (tmp_path / name).write_text(text)
    convention = json.loads((URDF_DIR / "kuka.json").read_text().replace("joint_a", "joint_"))
    convention["matrix"][0][0], convention["matrix"][2][1], convention["offset"][1] = -1, 1, 0.05
    (tmp_path / "kuka.json").write_text(json.dumps(convention))
    other = json.loads((URDF_DIR / "fanuc_r2000ic_165f_pendant.json").read_text())
    other["offset"][1] += 0.1
    (tmp_path / "other.json").write_text(json.dumps(other))
    return tmp_path


def by_program(*arguments):
    done = subprocess.run([KDLCAL, "compensate", "--result", "r.json", *arguments], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done


@pytest.mark.parametrize(
    "name, options, arguments",
    [
        ("in.ls", {"controller": CONTROLLER}, []),
        ("in.ls", {"controller": str(CONTROLLER), "most_change": 0.2, "line_tolerance": 1e-6}, ["--linear", "0.001"]),
        ("framed.ls", {"controller": CONTROLLER, "frames": "frames.json"}, ["--frames", "frames.json"]),
        ("in.ls", {"controller": CONTROLLER, "joint_convention": "other.json"}, ["--joint-convention", "other.json"]),
        ("k.src", {}, []),
        ("k.src", {"joint_convention": "kuka.json"}, ["--joint-convention", "kuka.json"]),
    ],
)
def test_files_are_those_of_kdlcal(found, folder, name, options, arguments):
    found.save("r.json")
    program = kc.compensate_program(found, folder / name, **options)
    stem, extension = name.split(".")
    (folder / "own").mkdir()
    program.save(f"own/{stem}_c.{extension}")
    (folder / "other").mkdir()
    if "controller" in options:
        arguments = [*arguments, "--controller", str(CONTROLLER)]
    by_program("--program", name, "--output", f"other/{stem}_c.{extension}", *arguments)
    files = sorted(file.name for file in (folder / "other").iterdir())
    assert len(files) == (3 if extension == "src" else 2)
    assert files == sorted(file.name for file in (folder / "own").iterdir())
    for file in files:
        assert (folder / "own" / file).read_bytes() == (folder / "other" / file).read_bytes(), file
    for file, text in program.texts.items():
        suffix = file.rsplit(".", 1)[1]
        assert (folder / "own" / f"{stem}_c.{suffix}").read_bytes() == text


def test_frames_as_arrays(found, folder):
    frame = np.eye(4)
    frame[0, 3] = 0.1
    by_file = kc.compensate_program(found, "framed.ls", controller=CONTROLLER, frames="frames.json")
    by_array = kc.compensate_program(found, "framed.ls", controller=CONTROLLER, frames={"user_frames": {"2": frame}})
    assert by_array.texts == by_file.texts
    frame[0, 3] = 0.2
    moved = kc.compensate_program(found, "framed.ls", controller=CONTROLLER, frames={"user_frames": {"2": frame}})
    assert moved.texts != by_file.texts


def test_positions(found, folder):
    program = kc.compensate_program(found, "in.ls", controller=CONTROLLER)
    assert program.language == "FANUC LS" and program.calibration is found
    at = program.positions
    assert list(at["name"]) == ["P[1]", "P[2]", "P[3]"] and (at["status"] == "exact").all() and at["written"].all()
    lines = fanuc().splitlines()
    assert [lines[line - 1].split("[")[0] for line in at["line"]] == ["P"] * 3
    nominal = kc.Compensator(found).nominal_poses(at["asked"])
    np.testing.assert_allclose(found.flange_poses(at["joint_values"]), nominal, atol=1e-8)
    moved = kc.Compensator(found).nominal_poses(at["joint_values"])[:, :3, 3] - nominal[:, :3, 3]
    np.testing.assert_allclose(np.linalg.norm(moved, axis=1), at["displacement"], atol=1e-9)
    assert at["displacement"].min() > 1e-5 and at["position_error"].max() < 1e-9
    assert 0.0 < program.rounding < 3e-5
    assert program.straight_lines == 1
    # The pose of the first point, as the controller counts: its world is level with axis 2.
    convention = kc.read_joint_convention(URDF_DIR / "fanuc_r2000ic_165f_pendant.json")
    third = np.linalg.solve(convention.matrix, at["asked"][2] - convention.offset)
    np.testing.assert_allclose(np.degrees(third), [0.0, -10.0, -20.0, 5.0, -60.0, 7.0], atol=1e-9)


def test_the_way_next_to_given_joint_values(found, folder):
    """A URScript pose has several; no frame of the URDF moves its base or flange."""
    q = np.array([0.2, -0.1, -0.3, 0.4, 0.9, -0.5])
    pose = kc.Compensator(found).nominal_poses(q)
    axis = np.array([pose[2, 1] - pose[1, 2], pose[0, 2] - pose[2, 0], pose[1, 0] - pose[0, 1]])
    angle = np.arctan2(np.linalg.norm(axis), np.trace(pose[:3, :3]) - 1.0)
    numbers = ",".join(f"{x:.9f}" for x in [*pose[:3, 3], *(axis * angle / np.linalg.norm(axis))])
    (folder / "u.script").write_text(f"def t():\n  set_tcp(p[0,0,0,0,0,0])\n  movej(p[{numbers}])\nend\n")
    found.save("r.json")
    flipped = q + [0.0, 0.0, 0.0, -np.pi, -2.0 * q[4], np.pi]
    for near in (q + 0.02, flipped - 0.02):
        program = kc.compensate_program(found, "u.script", near=near)
        np.testing.assert_allclose(program.positions["asked"][0], near, atol=0.021)
        by_program("--program", "u.script", "--output", "c.script", "--force", "--near",
                   ",".join(repr(float(x)) for x in np.degrees(near)))  # fmt: skip
        assert (folder / "c.script").read_bytes() == program.texts["u.script"]


def test_lines_that_the_tool_leaves(found, folder):
    assert kc.compensate_program(found, "in.ls", controller=CONTROLLER, line_tolerance=1.0).paths == []
    (path,) = kc.compensate_program(found, "in.ls", controller=CONTROLLER, line_tolerance=1e-9).paths
    assert (path["line"], path["from"], path["to"]) == (4, "P[1]", "P[2]")
    assert 1e-9 < path["deviation"] < 1e-3 and 0.0 <= path["orientation_deviation"] < 1e-3
    turned = fanuc().replace("R =    10.000 deg", "R =    70.000 deg", 1)  # so that the tool turns on its way
    (folder / "turned.ls").write_text(turned)
    found.save("r.json")
    (path,) = kc.compensate_program(found, "turned.ls", controller=CONTROLLER, line_tolerance=1e-9).paths
    said = by_program("--program", "turned.ls", "--output", "c.ls", "--controller", str(CONTROLLER), "--linear", "0.001").stderr
    degrees = np.degrees(path["orientation_deviation"])
    assert f"leaves the straight line by {path['deviation'] * 1e3:.3f} mm and {degrees:.3f} deg" in said
    assert abs(degrees - np.degrees(path["deviation"])) > 2e-3


def test_points_that_cannot_be_reached_stay(found, folder):
    (folder / "far.ls").write_text(fanuc().replace("1850.000", "3850.000"))
    with pytest.raises(kc.InputError, match=r"P\[1\]"):
        kc.compensate_program(found, "far.ls", controller=CONTROLLER)
    limited = kc.compensate_program(found, "in.ls", controller=CONTROLLER, most_change=1e-9)
    assert not limited.positions["written"].any() and (limited.positions["status"] != "exact").all()
    assert limited.texts["in.ls"] == fanuc().encode()
    # What remains is what the robot does with the program as it stands.
    at = limited.positions
    np.testing.assert_array_equal(at["joint_values"], at["asked"])
    nominal = kc.Compensator(found).nominal_poses(at["asked"])
    real = found.flange_poses(at["asked"])
    np.testing.assert_allclose(at["position_error"], np.linalg.norm((real - nominal)[:, :3, 3], axis=1), rtol=1e-9)
    turned = np.swapaxes(real[:, :3, :3], 1, 2) @ nominal[:, :3, :3]
    cosine = (np.trace(turned, axis1=1, axis2=2) - 1.0) / 2.0
    np.testing.assert_allclose(at["orientation_error"], np.arccos(np.clip(cosine, -1.0, 1.0)), rtol=1e-3)
    assert at["position_error"].min() > 1e-5
    assert limited.warnings[0] == "3 of 3 points are not reached and stay as they were"
    assert "3 of them left" in repr(limited)


def test_at_a_temperature_the_record_names_the_calibration(robot, folder):
    measured, arm = kc.simulate(robot, configurations=60, noise=3e-5, length_error=1e-3, angle_error=1e-3, seed=2)
    joints = measured.joint_values
    temperature = np.linspace(20.0, 35.0, len(joints))
    points = arm.predict(joints + 1e-5 * np.outer(temperature, [0, 1, 0, 0, 0, 0]), "A").position
    m = kc.Measurements.from_arrays(joints, points, temperature=temperature, sigma=3e-5)
    found = kc.calibrate(robot, m, effects={"groups": ["drift"]}, diagnosis={"try_readings": False})
    warm = found.at(temperature=34.0)
    assert warm._origin is found and found._origin is found
    kc.compensate_program(warm, "in.ls", controller=CONTROLLER).save("out.ls")
    found.save("r.json")
    assert json.loads((folder / "out.ls.kdlcal.json").read_text())["result_sha256"] == sha256(
        (folder / "r.json").read_bytes()
    ).hexdigest()


def test_nothing_that_was_read_is_replaced(robot, measurements, folder, monkeypatch):
    """Also from another folder, under names that were relative when the files were read."""
    (folder / "my.urdf").write_text(robot.urdf)
    mine = kc.load_robot(folder / "my.urdf")
    kc.calibrate(mine, measurements).save("r.json")
    program = kc.compensate_program(kc.load("r.json", mine), "k.src", joint_convention="kuka.json")
    (folder / "elsewhere").mkdir()
    monkeypatch.chdir(folder / "elsewhere")
    before = {file: file.read_bytes() for file in folder.iterdir() if file.is_file()}
    for output in ("../k.src", folder / "k.src", "../kuka.json", "../my.urdf", "../r.json"):
        with pytest.raises(kc.InputError, match="is the file that"):
            program.save(output, overwrite=True)
    assert {file: file.read_bytes() for file in folder.iterdir() if file.is_file()} == before
    program.save("c.src")


def test_nothing_is_lost(found, folder):
    program = kc.compensate_program(found, "k.src", joint_convention=kc.read_joint_convention("kuka.json"))
    for output in ("k.src", "./k.src"):
        with pytest.raises(kc.InputError, match="k.src"):
            program.save(output, overwrite=True)
    program.save("c.src")
    with pytest.raises(kc.InputError, match="c.src.*overwrite=True"):
        program.save("c.src")
    for inputs in ("kuka.json", "c.dat"):
        with pytest.raises(kc.InputError, match=f"output: '?{inputs}"):
            kc.compensate_program(found, "k.src", joint_convention="kuka.json").save(inputs, overwrite=True)
    program.save("c.src", overwrite=True)
    with pytest.raises(kc.InputError, match="no_such_folder"):
        program.save("no_such_folder/c.src")
    for again in ("c.src", "c.dat"):
        with pytest.raises(kc.InputError, match="compensated already"):
            kc.compensate_program(found, again)
    assert {name: (folder / name).read_text() for name in KRL} == KRL


def test_wrong_arguments(found, folder):
    for options, error, message in [
        ({}, kc.InputError, "in.ls: controllers of FANUC LS count joints in another way.*expected controller"),
        ({"controller": "none.json"}, kc.InputError, "none.json"),
        ({"controller": 5}, TypeError, "PathLike"),
        ({"controller": CONTROLLER, "frames": 5}, TypeError, "frames: 5, expected a file"),
        ({"controller": CONTROLLER, "frames": {"users": {}}}, TypeError, "unknown option frames.users, expected one of"),
        ({"controller": CONTROLLER, "frames": {"user_frames": {"1": np.ones((4, 4))}}}, kc.InputError,
         r"frames.user_frames.1: a matrix that is no rotation"),
        ({"controller": CONTROLLER, "frames": {"tool_frames": [np.eye(4)]}}, TypeError, r"(?s)frames.tool_frames: \[.* a dict of names"),
        ({"controller": CONTROLLER, "joint_convention": 5}, TypeError, "joint_convention: 5, expected a JointConvention"),
        ({"controller": CONTROLLER, "frames": "in.ls.json"}, kc.InputError, "in.ls.json"),
        ({"controller": CONTROLLER, "external_axes": {"E7": "joint_1"}}, kc.InputError, "external_axes: 'E7'"),
        ({"controller": CONTROLLER, "external_axes": {"E1": "rail"}}, kc.InputError, "external_axes: .* no joint 'rail'"),
        ({"controller": CONTROLLER, "external_axes": ["E1"]}, TypeError, "external_axes"),
        ({"controller": CONTROLLER, "near": [0.0] * 5}, kc.InputError, "near"),
        ({"controller": CONTROLLER, "near": [[0.0] * 6]}, kc.InputError, r"near: an array of shape \(1, 6\), expected \(6,\)"),
        ({"controller": CONTROLLER, "near": [0.0, np.nan, 0.0, 0.0, 0.0, 0.0]}, kc.InputError, "near: .* not finite"),
        ({"controller": CONTROLLER, "line_tolerance": "x"}, TypeError, "line_tolerance"),
        ({"controller": CONTROLLER, "line_tolerance": 0.0}, kc.InputError, "line_tolerance: 0, expected"),
        ({"controller": CONTROLLER, "line_tolerance": np.nan}, kc.InputError, "line_tolerance: nan, expected"),
        ({"controller": CONTROLLER, "nothing": 0}, TypeError, "unknown option nothing"),
    ]:
        with pytest.raises(error, match=message):
            kc.compensate_program(found, "in.ls", **options)
    with pytest.raises(kc.InputError, match="framed.ls:.*2.*expected it in frames"):
        kc.compensate_program(found, "framed.ls", controller=CONTROLLER)
    (folder / "text.ls").write_text("no program")
    with pytest.raises(kc.InputError, match="text.ls"):
        kc.compensate_program(found, "text.ls")


def test_held_joints_of_a_program(found, folder):
    free, held = (kc.compensate_program(found, "in.ls", controller=CONTROLLER, held=joints, position_first=True).positions
                  for joints in ([], ["joint_1"]))  # fmt: skip
    np.testing.assert_array_equal(held["joint_values"][:, 0], held["asked"][:, 0])
    assert (free["joint_values"][:, 0] != free["asked"][:, 0]).all()


RAIL = (
    '<link name="ground"/><joint name="rail" type="prismatic"><parent link="ground"/><child link="base_link"/>'
    '<axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
)


def test_external_axes_stay(robot, tmp_path):
    on_rail = kc.parse_robot(robot.urdf.replace("</robot>", RAIL + "</robot>"), base="ground", tip="flange")
    assert on_rail.joints[0] == "rail"
    m, _ = kc.simulate(on_rail, configurations=60, noise=2e-5, length_error=5e-4, angle_error=5e-4)
    found = kc.calibrate(on_rail, m, effects={"automatic": False}, diagnosis={"try_readings": False})
    (tmp_path / "k.src").write_text(KRL["k.src"])
    (tmp_path / "k.dat").write_text(KRL["k.dat"].replace("A6 2.0}", "A6 2.0,E1 500.0}"))
    for axis, place in (("rail", 0.5), ("-rail", -0.5)):
        at = kc.compensate_program(found, tmp_path / "k.src", external_axes={"E1": axis}).positions
        assert at["asked"][0, 0] == at["joint_values"][0, 0] == place


def test_record_beside_the_other_file(found, folder):
    kc.compensate_program(found, "k.dat").save("c.dat")
    assert (folder / "c.dat.kdlcal.json").exists()
    for again in ("c.src", "c.dat"):
        with pytest.raises(kc.InputError, match="compensated already"):
            kc.compensate_program(found, again)


def test_a_convention_without_a_description(found, folder):
    convention = json.loads((folder / "kuka.json").read_text())
    values = np.radians([10.0, -10.0, 15.0, 5.0, 30.0, 2.0])
    asked = np.array(convention["matrix"]) @ values + convention["offset"]
    assert abs(asked - values).max() > 0.04
    for given in ("kuka.json", kc.read_joint_convention("kuka.json")):
        at = kc.compensate_program(found, "k.src", joint_convention=given).positions
        np.testing.assert_allclose(at["asked"][0], asked, atol=1e-12)


def test_more_points_than_are_written_at_a_time(found, folder):
    count = 32800
    pose = fanuc().split("P[2]{")[1].split("};")[0]
    points = "".join("P[{}]{{{}}};\n".format(n, pose.replace("200.000", f"{n * 0.01:.3f}")) for n in range(1, count + 1))
    moves = "".join(f"   {n}:J P[{n}] 100% FINE ;\n" for n in range(1, count + 1))
    (folder / "long.ls").write_text(f"/PROG  LONG\n/MN\n{moves}/POS\n{points}/END\n")
    program = kc.compensate_program(found, "long.ls", controller=CONTROLLER)
    program.save("c.ls")
    record = json.loads((folder / "c.ls.kdlcal.json").read_text())["positions"]
    assert [each["position"] for each in record] == list(program.positions["name"])
    assert record[-1]["position"] == f"P[{count}]"


def test_names_of_files_stay_as_they_are(found, folder):
    (folder / "weld--near.ls").write_text(fanuc(frame=7))
    with pytest.raises(kc.InputError, match="weld--near.ls:.*expected it in frames"):
        kc.compensate_program(found, "weld--near.ls", controller=CONTROLLER)
