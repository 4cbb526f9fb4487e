"""The stub names what the package has, and no more."""

import ast
from pathlib import Path

import kdl_calibration as kc

STUB = ast.parse((Path(kc.__file__).parent / "__init__.pyi").read_text())


def public(names):
    return {name for name in names if not name.startswith("_")}


def names_in(body):
    names = set()
    for node in body:
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            names.add(node.name)
        elif isinstance(node, ast.AnnAssign):
            names.add(node.target.id)
        elif isinstance(node, ast.Assign):
            names.update(target.id for target in node.targets)
    return public(names)


def test_functions_and_classes():
    assert names_in(STUB.body) == public(dir(kc)) - {"plots"}


def test_members_and_their_documentation():
    for node in STUB.body:
        if isinstance(node, ast.ClassDef) and node.name not in ("InputError", "Prediction", "Compensated"):
            own = getattr(kc, node.name)
            assert names_in(node.body) == public(vars(own)), node.name
            assert own.__doc__ and own.__module__ == "kdl_calibration", node.name


def test_options_are_those_that_are_known(robot, measurements, found):
    """The TypeError of an unknown keyword lists the known ones, which are the stub's."""
    calls = {"calibrate": (robot, measurements), "plan": (robot,), "simulate": (robot,), "validate": (robot, measurements),
             "compensate_program": (found, "none.ls")}
    for node in STUB.body:
        if isinstance(node, ast.FunctionDef) and node.name in calls:
            try:
                getattr(kc, node.name)(*calls[node.name], nothing=0)
                raise AssertionError(node.name)
            except TypeError as error:
                known = str(error).split("expected one of ")[1].split(", ")
            assert known == [argument.arg for argument in node.args.kwonlyargs]
