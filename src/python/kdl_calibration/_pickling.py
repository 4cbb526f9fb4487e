"""The result file of a calibration in memory, and pickling through it."""

import functools
import json
import os
import tempfile
from typing import NamedTuple, Optional

from . import _native


def result_text(found):
    """The bytes that save writes."""
    with tempfile.TemporaryDirectory() as folder:
        file = os.path.join(folder, "result.json")
        found.save(file)
        with open(file, "rb") as stream:
            return stream.read()


def result(found):
    """The content of the result file, as `json` reads it; src/cli/README.md explains it."""
    return json.loads(result_text(found))


class Finding(NamedTuple):
    """Something wrong with rows of the measurements."""

    kind: str  # slipped_target, swapped_targets, mistaken_target, mistyped_coordinate, displaced_point, …
    configuration: str  # of a slip the last one before it
    repeat: int  # 0: all of the configuration
    targets: list  # of names; one of several is wrong
    axis: Optional[str]  # of a mistyped coordinate: "x", "y" or "z"
    amount: float  # [m]
    message: str  # for people

    def __str__(self):
        return self.message


def findings(found):
    """Rows of the measurements that look wrong: a list of Finding."""
    return [Finding(**each) for each in result(found._origin)["findings"]]


def restore(text, robot, own):
    with tempfile.TemporaryDirectory() as folder:
        file = os.path.join(folder, "result.json")
        with open(file, "wb") as stream:
            stream.write(text)
        return _native.load(file, robot, own)


def restore_at(origin, temperature, payload, link_temperatures):
    return origin.at(temperature, payload, link_temperatures)


def reduce(found):
    """The copy is as if it were loaded: it predicts, but knows no measurements. Effects of the caller's own are pickled
    as functions are, by their names."""
    if found._origin is not found:
        return restore_at, (found._origin, *found._circumstances)
    return restore, (result_text(found), found.robot, found.own)


def reduce_compensator(compensator):
    return functools.partial(_native.Compensator, **compensator._options), (compensator.calibration,)
