"""The clean build that defects are compared with, and the workers that build and try one defect each."""

import filecmp
import fnmatch
import hashlib
import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

PARTS = ["CMakeLists.txt", "CMakePresets.json", "LICENSE", "README.md", "package.xml", "include", "src", "tests", "urdf"]
ALWAYS_LEFT_OUT = ["*LongRun*", "*Campaign*"]
# The tests run this in the place of kdlcal.
FRONT = '#!/bin/sh\nexec "${KDLCAL_UNDER_TEST:-%s}" "$@"\n'


class Unit:
    """One compilation."""

    def __init__(self, entry):
        words = shlex.split(entry["command"])
        self.directory = entry["directory"]
        self.file = entry["file"]
        self.output = words[words.index("-o") + 1]
        self.words = words
        self.target = re.search(r"CMakeFiles/([^/]+)\.dir/", self.output).group(1)
        absolute = Path(self.directory, self.output)
        depends = absolute.with_name(absolute.name + ".d")
        read = depends.read_text().replace("\\\n", " ").split()[1:] if depends.exists() else [self.file]
        self.depends = {os.path.normpath(os.path.join(self.directory, path)) for path in read}
        self.object = absolute


class Suite:
    """A file of tests, which its wing's program runs by the names of the test suites in it."""

    def __init__(self, file, program):
        self.file = file
        self.program = program  # one of its compilations


class CleanTree:
    def __init__(self, directory, root):
        self.root = root
        self.directory = directory
        self.source = directory / "source"
        self.build = directory / "build"

    def prepare(self, origin, jobs):
        """Copies what changed and builds it; raises CalledProcessError where that fails."""
        _mirror(origin, self.source)
        environment = dict(os.environ, CCACHE_BASEDIR=str(self.source), CCACHE_NOHASHDIR="1")
        if shutil.which("ccache"):
            environment["CMAKE_CXX_COMPILER_LAUNCHER"] = "ccache"
        options = [
            "-G", "Unix Makefiles", "-D", "CMAKE_BUILD_TYPE=Release", "-D", "CMAKE_CXX_FLAGS_RELEASE=-O1 -DNDEBUG",
            "-D", "BUILD_SHARED_LIBS=ON", "-D", "KDL_CALIBRATION_HIDE_INTERNALS=OFF", "-D", "KDL_CALIBRATION_BUILD_TESTS=ON",
            "-D", "KDL_CALIBRATION_PRECOMPILED_HEADERS=ON", "-D", "KDL_CALIBRATION_JOINED_TESTS=ON",
            "-D", "CMAKE_EXPORT_COMPILE_COMMANDS=ON", "-D", "CMAKE_EXE_LINKER_FLAGS=-Wl,--enable-new-dtags",
            "-D", f"KDL_CALIBRATION_SHARED_DATA_DIR={self.root.parent / 'shared' / 'data'}",
        ]  # fmt: skip
        self.directory.mkdir(parents=True, exist_ok=True)
        log = open(self.directory / "build.log", "w")

        def run(*words):
            subprocess.run(words, check=True, env=environment, stdout=log, stderr=subprocess.STDOUT)

        run("cmake", "-S", str(self.source), "-B", str(self.build), *options)
        kdlcal, real = self.build / "kdlcal", self.build / "kdlcal.real"
        if kdlcal.exists() and kdlcal.read_bytes()[:2] == b"#!":
            os.replace(real, kdlcal)  # its time stamp tells whether it must be linked again
        self._read_units()
        programs = sorted({suite.program.target for suite in self.suites.values()})
        run("cmake", "--build", str(self.build), "-j", str(jobs), "--target", "kdl_calibration", "kdlcal", *programs)
        self._read_units()
        os.replace(kdlcal, real)
        kdlcal.write_text(FRONT % real)
        kdlcal.chmod(0o755)
        self.library = max(self.build.glob("libkdl_calibration.so.*.*.*"))

    def _wing_of(self, file):
        """The wing whose program has this file of tests; nothing for other files."""
        tests = self.source / "tests"
        if not file.is_relative_to(tests) or not file.name.endswith("_test.cpp"):
            return None
        parts = file.relative_to(tests).parts
        return {1: "project", 2: parts[0]}.get(len(parts))

    def _read_units(self):
        entries = json.loads((self.build / "compile_commands.json").read_text())
        self.units = [Unit(entry) for entry in entries]
        programs = {unit.target: unit for unit in self.units}
        self.suites = {}
        for file in sorted((self.source / "tests").rglob("*_test.cpp")):
            program = programs.get(f"{self._wing_of(file)}_tests")
            if program is not None:
                # Two wings may have rooms of the same name.
                name = file.stem if file.stem not in self.suites else f"{file.parent.name}_{file.stem}"
                self.suites[name] = Suite(file, program)

    def users(self, path):
        """The compilations that read this source; those of the fuzzers and benchmarks are left alone."""
        full = str(self.source / path)
        programs = {suite.program.target for suite in self.suites.values()}
        wanted = {"kdl_calibration", "kdlcal_commands", "kdlcal", *programs}
        return [unit for unit in self.units if unit.target in wanted and full in unit.depends]

    def linked_with(self, archive):
        """The test programs that call what is in it."""
        programs = [suite.program for suite in self.suites.values()]
        return {unit.target for unit in programs if archive in map(path_of(unit), link_words(unit))}

    def filter_of(self, suite):
        text = self.suites[suite].file.read_text()
        names = sorted(set(re.findall(r"^TEST(?:_F|_P)?\((\w+),", text, re.M)))
        return ":".join(f"{name}.*:*/{name}.*" for name in names)

    def executable(self, suite):
        unit = self.suites[suite].program
        words = link_words(unit)
        return path_of(unit)(words[words.index("-o") + 1])

    def in_order(self, path, times):
        """The suites that use a source first: its own, those that include its header, those of the users of a private
        one; for cli those of the command line. Then all others, the quickest first."""
        stem = Path(path).stem
        everything = sorted(self.suites, key=lambda suite: times.get(suite, 0.0))
        if "cli" in Path(path).parts:
            near = [s for s in everything if self.suites[s].file.parent.name == "cli"]
            own = [s for s in near if s == f"{stem}_test"]
        else:
            header = self.source / "include" / "kdl_calibration" / f"{stem}.hpp"
            stems = {stem} if header.exists() else {stem} | {Path(u.file).stem for u in self.users_of_stem(path)}
            own = [s for s in everything if s == f"{stem}_test"]
            own += [s for s in everything if s in {f"{other}_test" for other in stems}]
            near = [s for s in everything if self._includes(s, stems)]
        return list(dict.fromkeys(own + near + everything))

    def users_of_stem(self, path):
        header = Path(path).with_suffix(".hpp").as_posix()
        return self.users(header) + self.users(path)

    def _includes(self, suite, stems):
        text = self.suites[suite].file.read_text()
        return any(re.search(rf'#include "[^"]*\b{stem}\.hpp"', text) for stem in stems)


def link_words(unit):
    directory = Path(unit.directory, unit.output.split("CMakeFiles/")[0])
    text = (directory / "CMakeFiles" / f"{unit.target}.dir" / "link.txt").read_text()
    return shlex.split(text.splitlines()[-1] if " qc " not in text else text.splitlines()[0])


def path_of(unit):
    """Where a word of the link command leads, if it is a path."""
    directory = Path(unit.directory, unit.output.split("CMakeFiles/")[0])
    return lambda word: Path(os.path.normpath(directory / word))


def _mirror(origin, copy):
    wanted = set()
    for part in PARTS:
        for path in [origin / part] if (origin / part).is_file() else sorted((origin / part).rglob("*")):
            if not path.is_file() or "__pycache__" in path.parts:
                continue
            target = copy / path.relative_to(origin)
            wanted.add(target)
            if not target.exists() or not filecmp.cmp(path, target, shallow=False):
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(path, target)
                shutil.copymode(path, target)
    for path in sorted(copy.rglob("*")):
        if path.is_file() and path not in wanted:
            path.unlink()


class Outcome:
    def __init__(self, passed, test="", seconds=0.0):
        self.passed = passed
        self.test = test  # the first that failed, or what ended the suite
        self.seconds = seconds  # CPU


class Runner:
    """Runs suites within limits. `environment` says which library and which kdlcal."""

    def __init__(self, clean, left_out, memory_mb=6000):
        self.clean = clean
        self.left_out = left_out
        self.left_out_of = {}  # by suite, what fails without any defect
        self.memory_mb = memory_mb

    def run(self, suite, executable, environment, scratch, cpu_limit):
        shutil.rmtree(scratch, ignore_errors=True)
        scratch.mkdir(parents=True)
        limits = f"ulimit -v {self.memory_mb * 1024}; ulimit -t {int(cpu_limit)}; ulimit -f 67108864; ulimit -c 0"
        words = [  # what runs in the background ignores signals, which the tests send
            "env", "--default-signal=HUP,INT,QUIT", "sh", "-c", limits + '; exec "$@"', "-", str(executable), "--gtest_fail_fast", "--gtest_brief=1",
            "--gtest_filter=" + self.clean.filter_of(suite) + "-" + ":".join(ALWAYS_LEFT_OUT + self.left_out + self.left_out_of.get(suite, [])),
        ]  # fmt: skip
        process = subprocess.Popen(
            words, cwd=self.clean.executable(suite).parent, env=dict(environment, TMPDIR=str(scratch)),
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, start_new_session=True,
        )  # fmt: skip
        # Time on a busy machine is not CPU time; this limit is for what waits.
        timer = threading.Timer(6.0 * cpu_limit, _end_session, [process.pid])
        timer.start()
        head, tail = b"", b""
        for block in iter(lambda: process.stdout.read1(65536), b""):
            head = (head + block)[:200000]
            tail = (tail + block)[-200000:]
        _, status, usage = os.wait4(process.pid, 0)
        status = process.returncode = os.waitstatus_to_exitcode(status)
        timer.cancel()
        _end_session(process.pid)
        shutil.rmtree(scratch, ignore_errors=True)
        if status == 0:
            return Outcome(True, seconds=usage.ru_utime + usage.ru_stime)
        names = re.findall(rb"\[  FAILED  \] (\S+?)[ ,\n]", head + tail)
        if status < 0 or status >= 128:
            number = -status if status < 0 else status - 128
            return Outcome(False, names[0].decode() if names else f"ended by signal {number}")
        return Outcome(False, names[0].decode() if names else f"exit status {status}")


def _end_session(leader):
    try:
        os.killpg(leader, signal.SIGKILL)
    except (ProcessLookupError, PermissionError):
        pass


def baseline(clean, runner, report, jobs=1):
    """CPU seconds of every suite without any defect, measured once for each build. What fails is returned by suite, and
    the runner leaves it out from now on; a suite that names no test that fails is left out whole."""
    cache = clean.directory / "times.json"
    known = json.loads(cache.read_text()) if cache.exists() else {}
    product = hashlib.sha1(clean.library.read_bytes() + (clean.build / "kdlcal.real").read_bytes()).hexdigest()
    keys, times, failing = {}, {}, {}
    for suite in sorted(clean.suites):
        executable = clean.executable(suite)
        key = hashlib.sha1((suite + product + str(ALWAYS_LEFT_OUT + runner.left_out)).encode() + executable.read_bytes()).hexdigest()
        if key in known:
            times[suite] = known[key]
        else:
            keys[suite] = key
    with ThreadPoolExecutor(jobs) as pool:
        for suite, (seconds, failures) in zip(keys, pool.map(lambda suite: _measured(clean, runner, suite), keys)):
            if seconds is not None:
                times[suite] = seconds
                report(f"{suite}: {seconds:.1f} s")
            for test in failures:
                report(f"{suite} fails without a defect: {test}")
                failing.setdefault(suite, []).append(test)
            if not failures:
                known[keys[suite]] = seconds
                cache.write_text(json.dumps(known))
    return times, failing


def _measured(clean, runner, suite):
    """CPU seconds, nothing where it fails and no test is to blame; and the tests that fail."""
    environment = environment_of(clean.build, clean.build / "kdlcal.real")
    failures = []
    while True:
        outcome = runner.run(suite, clean.executable(suite), environment, clean.directory / f"tmp-{suite}", 600)
        if outcome.passed:
            return outcome.seconds, failures
        failures.append(outcome.test)
        if "." not in outcome.test or failures.count(outcome.test) > 1:
            return None, failures
        runner.left_out_of.setdefault(suite, []).append(outcome.test)


def environment_of(library_dir, kdlcal):
    return dict(os.environ, LD_LIBRARY_PATH=str(library_dir), KDLCAL_UNDER_TEST=str(kdlcal))


class Worker:
    def __init__(self, clean, number, runner, times):
        self.clean = clean
        self.directory = clean.directory.parent / f"worker-{number}"
        self.source = self.directory / "source"
        self.out = self.directory / "out"
        self.runner = runner
        self.times = times
        _mirror(clean.source, self.source)

    def try_defect(self, defect):
        """(verdict, detail): "caught" by a test, "survived", "does not compile", "equivalent" or "does not apply"."""
        path = self.source / defect.path
        original = (self.clean.source / defect.path).read_text() if (self.clean.source / defect.path).exists() else ""
        text = defect.applied_to(original)
        if text is None:
            return "does not apply", ""
        try:
            path.write_text(text)
            shutil.rmtree(self.out, ignore_errors=True)
            self.out.mkdir(parents=True)
            return self._built_and_tried(defect)
        finally:
            path.write_text(original)

    def _built_and_tried(self, defect):
        objects = {}
        for unit in self.clean.users(defect.path):
            target = self._compiled(unit)
            if target is None:
                return "does not compile", ""
            if target.read_bytes() != unit.object.read_bytes():
                objects[unit.object] = target
        if not objects:
            return "equivalent", "the same object code"
        changed = [unit for unit in self.clean.units if unit.object in objects]
        if not self._linked(changed, objects):
            return "does not compile", "does not link"
        return self._tried(defect)

    def _compiled(self, unit):
        target = self.out / "objects" / unit.target / (Path(unit.file).name + ".o")
        target.parent.mkdir(parents=True, exist_ok=True)
        source = str(self.clean.source)
        words = [word.replace(source + "/src", str(self.source) + "/src") for word in unit.words]
        words = [word.replace(source + "/tests", str(self.source) + "/tests") for word in words]
        words = [str(target) if word == unit.output else word for word in words]
        if shutil.which("ccache") and "ccache" not in words[0]:
            words.insert(0, "ccache")
        environment = dict(os.environ, CCACHE_BASEDIR=str(self.clean.directory.parent), CCACHE_NOHASHDIR="1")
        done = subprocess.run(
            words, cwd=unit.directory, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        return target if done.returncode == 0 else None

    def _linked(self, changed, objects):
        targets = {unit.target for unit in changed}
        by_target = {unit.target: unit for unit in self.clean.units}
        replaced = {str(old): str(new) for old, new in objects.items()}
        if "kdlcal_commands" in targets:
            archive = self.clean.build / "libkdlcal_commands.a"
            shutil.copyfile(archive, self.out / archive.name)
            members = [str(objects[unit.object]) for unit in changed if unit.target == "kdlcal_commands"]
            # The archive names its members like CMake's objects: one.cpp.o
            if subprocess.run(["ar", "r", str(self.out / archive.name), *members], stderr=subprocess.DEVNULL).returncode:
                return False
            replaced[str(archive)] = str(self.out / archive.name)
            targets |= {"kdlcal", *self.clean.linked_with(archive)}
        for target in sorted(targets - {"kdlcal_commands"}, key=lambda name: name != "kdl_calibration"):
            if not self._linked_target(by_target[target], replaced):
                return False
        return True

    def _linked_target(self, unit, replaced):
        directory = Path(unit.directory, unit.output.split("CMakeFiles/")[0])
        words = link_words(unit)
        output = words.index("-o") + 1
        result = self.out / Path(words[output]).name
        words = [replaced.get(str(path_of(unit)(word)), word) for word in words]
        words[output] = str(result)
        if unit.target == "kdl_calibration":
            soname = next(word for word in words if "-soname," in word).split("-soname,")[1]
            (self.out / soname).symlink_to(result.name)
        return subprocess.run(words, cwd=directory, stderr=subprocess.DEVNULL).returncode == 0

    def _is_named(self, suite, names):
        """A name may have wildcards and the wing in front: cli/*."""
        wing = self.clean.suites[suite].file.parent.name
        return any(fnmatch.fnmatch(suite, name) or fnmatch.fnmatch(f"{wing}/{suite}", name) for name in names)

    def _tried(self, defect):
        kdlcal = self.out / "kdlcal"
        environment = environment_of(
            self.out if any(self.out.glob("libkdl_calibration.so*")) else self.clean.build,
            kdlcal if kdlcal.exists() else self.clean.build / "kdlcal.real",
        )
        suites = [suite for suite in self.clean.in_order(defect.path, self.times) if suite in self.times]
        suites.sort(key=lambda suite: not self._is_named(suite, defect.suites))
        for suite in suites:
            own = self.out / self.clean.executable(suite).name
            executable = own if own.exists() else self.clean.executable(suite)
            limit = 5.0 * self.times[suite] + 20.0
            outcome = self.runner.run(suite, executable, environment, self.directory / "tmp", limit)
            if not outcome.passed:
                return "caught", f"{suite}: {outcome.test}"
        return "survived", ""
