"""The examples run, and find what they say."""

import os
import runpy
from pathlib import Path

import pytest

from conftest import URDF_DIR

EXAMPLES = URDF_DIR.parent / "src" / "python" / "examples"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    os.symlink(URDF_DIR, tmp_path / "urdf")
    return tmp_path


def test_compensated_program(folder):
    names = runpy.run_path(str(EXAMPLES / "compensated_program.py"))
    assert names["found"].trusted
    assert names["before"].max() > 1e-4 > 1e-5 > names["after"].max()
    assert (names["at"]["status"] == "exact").all() and len(names["at"]) == 6
    written = Path("SEAM_C.LS").read_text()
    assert written != Path("seam.ls").read_text()
    assert written.count("CONFIG") == 6 and Path("result.json").exists()


def test_coverage(folder):
    names = runpy.run_path(str(EXAMPLES / "coverage.py"))
    assert len(names["ratios"]) > 1000
    assert 0.92 < names["coverage"] < 0.98
    assert 0.8 < names["fitted"].var() / names["freedom"] < 1.2


def test_own_effect(folder):
    names = runpy.run_path(str(EXAMPLES / "own_effect.py"))
    assert abs(names["estimate"] - names["size"]) < 4.0 * names["sigma"] < 0.2 * names["size"]
    assert names["left"] < 0.07 < 0.8 * names["left_rigid"]
    assert [term["name"] for term in names["found"].result["effects"]["terms"]] == ["own.wave.2"]
