"""Builds a wheel and an editable one by the backend alone, in the build folder that is there, and imports both.

    python3 wheel.py <repository> <build folder> <empty folder>
"""

import base64
import csv
import hashlib
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

repository, build, folder = (Path(argument).resolve() for argument in sys.argv[1:])
sys.path.insert(0, str(repository / "src" / "python"))
import build_backend  # noqa: E402

IMPORT = "import sys, kdl_calibration as kc; print(kc.__version__, kc.__file__); assert kc.__file__.startswith(sys.argv[1])"


def imported(site, place):
    """The package that a folder of site-packages gives: its version, from files below `place`."""
    code = f"import site; site.addsitedir({str(site)!r}); {IMPORT}"
    return subprocess.run([sys.executable, "-B", "-c", code, place], check=True, capture_output=True, text=True).stdout


def unpacked(name):
    """The wheel's files; its RECORD states the hash of each."""
    site = folder / name.split("-")[0] / str(len(list(folder.iterdir())))
    with zipfile.ZipFile(folder / name) as wheel:
        wheel.extractall(site)
    (record,) = site.glob("*.dist-info/RECORD")
    rows = {row[0]: row[1] for row in csv.reader(record.read_text().splitlines())}
    files = {str(file.relative_to(site)): file for file in site.rglob("*") if file.is_file()}
    assert rows.keys() == files.keys()
    for file, stated in rows.items():
        if stated:
            digest = base64.urlsafe_b64encode(hashlib.sha256(files[file].read_bytes()).digest())
            assert stated == "sha256=" + digest.rstrip(b"=").decode(), file
    return site


shutil.rmtree(folder, ignore_errors=True)
folder.mkdir(parents=True)
settings = {"build-dir": str(build)}
assert build_backend.get_requires_for_build_wheel(settings) == []
wheel = build_backend.build_wheel(folder, settings)
first = (folder / wheel).read_bytes()
site = unpacked(wheel)
assert {"__init__.py", "__init__.pyi", "py.typed", "plots.py"} <= {file.name for file in site.rglob("*")}
version = imported(site, str(site)).split()[0]
assert f"-{version}-" in wheel
assert (folder / build_backend.build_wheel(folder, settings)).read_bytes() == first, "two builds give two wheels"
(folder / wheel).unlink()
site = unpacked(build_backend.build_editable(folder, settings))
assert imported(site, str(build)).split()[0] == version
