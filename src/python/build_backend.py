"""Builds wheels by CMake (PEP 517, and PEP 660 for `pip install --editable`) with the standard library alone.

The library is built in build/python-<tag> of the repository and kept there, so that the next build is short.
`pip install --config-settings build-dir=build/release ./src/python` takes another folder of CMake instead.
"""

import base64
import hashlib
import os
import re
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path

_HERE = Path(__file__).resolve().parent
_ROOT = _HERE.parents[1]
_NAME = "kdl_calibration"
_TAG = f"cp{sys.version_info[0]}{sys.version_info[1]}"
_PLATFORM = re.sub(r"[-.]", "_", sysconfig.get_platform())


def _version():
    return re.search(r"project\(kdl_calibration VERSION (\S+)", (_ROOT / "CMakeLists.txt").read_text())[1]


def _metadata():
    guide = (_HERE / "README.md").read_text(encoding="utf-8")
    return (
        f"Metadata-Version: 2.1\nName: kdl-calibration\nVersion: {_version()}\n"
        "Summary: Kinematic calibration of robot arms\nLicense: Apache-2.0\nRequires-Python: >=3.9\n"
        "Requires-Dist: numpy\nProvides-Extra: plots\nRequires-Dist: matplotlib; extra == 'plots'\n"
        f"Description-Content-Type: text/markdown\n\n{guide}"
    )


def _built(config_settings):
    """Configures and builds; returns the folder with the complete package."""
    chosen = (config_settings or {}).get("build-dir")
    folder = _ROOT / chosen if chosen else _ROOT / "build" / f"python-{_TAG}"
    options = [f"-DPython3_EXECUTABLE={sys.executable}", "-DKDL_CALIBRATION_PYTHON=ON"]
    if not chosen:
        options += ["-DKDL_CALIBRATION_BUILD_TESTS=OFF", "-DKDL_CALIBRATION_BUILD_EXECUTABLE=OFF",
                    "-DCMAKE_UNITY_BUILD=ON", "-DKDL_CALIBRATION_PRECOMPILED_HEADERS=ON"]  # fmt: skip
    subprocess.run(["cmake", "-S", _ROOT, "-B", folder, *options], check=True)
    build = ["cmake", "--build", folder, "--target", "kdl_calibration_python", "-j", str(os.cpu_count())]
    subprocess.run(build, check=True)
    return folder / "src" / "python"


class _Wheel:
    """A wheel that is written file by file."""

    def __init__(self, directory):
        self.name = f"{_NAME}-{_version()}-{_TAG}-{_TAG}-{_PLATFORM}.whl"
        self._info = f"{_NAME}-{_version()}.dist-info"
        self._zip = zipfile.ZipFile(Path(directory) / self.name, "w", zipfile.ZIP_DEFLATED)
        self._record = []

    def add(self, name, content):
        digest = base64.urlsafe_b64encode(hashlib.sha256(content).digest()).rstrip(b"=").decode()
        self._record.append(f"{name},sha256={digest},{len(content)}")
        self._write(name, content)

    def _write(self, name, content):
        entry = zipfile.ZipInfo(name)  # without a time of its own: equal builds give equal wheels
        entry.compress_type = zipfile.ZIP_DEFLATED
        entry.external_attr = (0o755 if name.endswith(".so") else 0o644) << 16
        self._zip.writestr(entry, content)

    def finish(self):
        tag = f"Wheel-Version: 1.0\nGenerator: kdl_calibration\nRoot-Is-Purelib: false\nTag: {_TAG}-{_TAG}-{_PLATFORM}\n"
        self.add(f"{self._info}/METADATA", _metadata().encode())
        self.add(f"{self._info}/WHEEL", tag.encode())
        self.add(f"{self._info}/licenses/LICENSE", (_ROOT / "LICENSE").read_bytes())
        self._write(f"{self._info}/RECORD", "\n".join([*self._record, f"{self._info}/RECORD,,", ""]).encode())
        self._zip.close()
        return self.name


def get_requires_for_build_wheel(config_settings=None):
    return []


def get_requires_for_build_editable(config_settings=None):
    return []


def build_wheel(wheel_directory, config_settings=None, metadata_directory=None):
    package = _built(config_settings) / _NAME
    suffix = sysconfig.get_config_var("EXT_SUFFIX")
    wheel = _Wheel(wheel_directory)
    for file in sorted(package.iterdir()):
        if file.suffix in (".py", ".pyi", ".typed") or file.name in ("py.typed", f"_native{suffix}"):
            wheel.add(f"{_NAME}/{file.name}", file.read_bytes())
    return wheel.finish()


def build_editable(wheel_directory, config_settings=None, metadata_directory=None):
    """The package stays in the build folder, where its Python files are links to these."""
    wheel = _Wheel(wheel_directory)
    wheel.add(f"__editable__.{_NAME}.pth", f"{_built(config_settings)}\n".encode())
    return wheel.finish()


def build_sdist(sdist_directory, config_settings=None):
    raise NotImplementedError("the package is built from the whole repository, there is no source archive of it alone")
