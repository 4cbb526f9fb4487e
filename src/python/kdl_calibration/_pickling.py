"""The result file of a calibration in memory, and pickling through it."""

import json
import os
import tempfile

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


def restore(text, robot, own):
    with tempfile.TemporaryDirectory() as folder:
        file = os.path.join(folder, "result.json")
        with open(file, "wb") as stream:
            stream.write(text)
        return _native.load(file, robot, own)


def reduce(found):
    """The copy is as if it were loaded: it predicts, but knows no measurements. Effects of the caller's own are pickled
    as functions are, by their names."""
    return restore, (result_text(found), found.robot, found.own)
