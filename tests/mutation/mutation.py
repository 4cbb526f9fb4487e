"""Breaks the library on purpose, one place at a time, and shows which of the defects the tests notice.

Defects are drawn from the sources with a seed (operators.py, drawing.py) or come from the list by hand (defects.tsv).
Each is built as a shared library, as kdlcal, or both, and tried on the suites that use the file, then on all others
(tree.py). Not counted: what does not compile and what compiles to the same object code."""

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
import threading
from math import sqrt
from pathlib import Path

sys.dont_write_bytecode = True
sys.path.insert(0, str(Path(__file__).parent))

from drawing import Defect, Drawing, judged, listed  # noqa: E402
from tree import CleanTree, Runner, Worker, baseline  # noqa: E402

COUNTED = ("caught", "survived")


def arguments():
    parser = argparse.ArgumentParser(prog="mutation.sh", description=__doc__.split("\n\n")[0])
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--list", action="store_true", help="the defects of tests/mutation/defects.tsv")
    what.add_argument("--only-survivors", metavar="LOG", type=Path, help="those that survived according to this log")
    what.add_argument("--defect", metavar="ID", nargs="+", help="these of the drawing or of --log")
    parser.add_argument("--seed", type=int, default=1, help="of the drawing [1]")
    parser.add_argument("--count", type=int, default=150, help="how many are drawn [150]")
    parser.add_argument("--first", type=int, metavar="N", help="only the first N of them, a sample of all sources")
    parser.add_argument("--only", metavar="RE", default="", help="only where file, kind or text match")
    parser.add_argument("--jobs", type=int, default=2, help="defects tried side by side [2]")
    parser.add_argument("--nice", type=int, default=10, help="priority, as of the command nice [10]")
    parser.add_argument("--least", type=float, help="percent that must be caught [90; 95 with --list]")
    parser.add_argument("--real-data", action="store_true", help="run the suites on real data too, where present")
    parser.add_argument("--log", type=Path, help="what was found, a line of JSON each [build/mutation/seed-N.jsonl]")
    parser.add_argument("--resume", action="store_true", help="take what the log has as caught or not counted from it")
    parser.add_argument("--revision", help="of git, instead of the files as they are")
    parser.add_argument("--root", type=Path, default=Path(__file__).resolve().parents[2], help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.count < 1 or given.jobs < 1 or (given.first is not None and given.first < 1):
        parser.error("--count, --first and --jobs need a number above 0")
    return given


def wilson(caught, total):
    """95 % interval of a rate."""
    if total == 0:
        return 0.0, 1.0
    z = 1.959963984540054
    rate = caught / total
    middle = (rate + z * z / (2 * total)) / (1 + z * z / total)
    half = z * sqrt(rate * (1 - rate) / total + z * z / (4 * total * total)) / (1 + z * z / total)
    return middle - half, middle + half


class Session:
    """Hands out defects to the workers in a fixed order and gathers what they find."""

    def __init__(self, known, equivalent, log):
        self._known = known
        self._equivalent = equivalent
        self._log = log
        self._lock = threading.Lock()
        self.results = []

    def finish(self, defect, verdict, detail):
        with self._lock:
            self.results.append((defect, verdict, detail))
            self._log.write(json.dumps({"verdict": verdict, "detail": detail, **defect.as_dict()}) + "\n")
            self._log.flush()
            name = verdict.upper() if verdict == "survived" else verdict
            print(f"{name:<17}{defect.id}  {defect.path}:{defect.line or ''} {defect.kind}" + (detail and f"  ({detail})"))
            if verdict != "caught" and verdict != "does not compile":
                print(defect.diff())
            sys.stdout.flush()

    def tried(self, worker, defect):
        verdict, detail = self._known.get(defect.id) or worker.try_defect(defect)
        if verdict == "survived" and defect.id in self._equivalent:
            verdict, detail = "judged equivalent", self._equivalent[defect.id]
        self.finish(defect, verdict, detail)
        return verdict


def try_shares(drawing, shares, session, workers, only):
    """One defect that counts from each share."""

    def work(worker, share):
        for _ in range(40):
            defect = drawing.draw(share)
            if defect is None:
                break
            if not re.search(only, f"{defect.path} {defect.kind} {defect.old} {defect.new}"):
                continue
            if session.tried(worker, defect) in COUNTED:
                break

    _share_out(shares, work, workers)


def try_all(defects, session, workers):
    _share_out(defects, session.tried, workers)


def _share_out(items, work, workers):
    """Calls work(worker, item) with every item, each worker taking the next one."""
    left = list(items)
    lock = threading.Lock()

    def take(worker):
        while True:
            with lock:
                if not left:
                    return
                item = left.pop(0)
            work(worker, item)

    _in_threads(take, workers)


def _in_threads(work, workers):
    failures = []

    def guarded(worker):
        try:
            work(worker)
        except BaseException as failure:  # noqa: BLE001, it is raised again below
            failures.append(failure)

    threads = [threading.Thread(target=guarded, args=(worker,)) for worker in workers]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    if failures:
        raise failures[0]


def read_log(path):
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


def from_log(entry):
    return Defect(**{key: value for key, value in entry.items() if key not in ("verdict", "detail")})


def room(path):
    """Folder and stem: src/cli/plan.cpp and src/cli/plan.hpp are cli/plan."""
    return Path(path).relative_to("src").with_suffix("").as_posix()


def summary(results):
    """Prints the rate of every room and of all; returns it in percent."""
    rooms = {}
    for defect, verdict, _ in results:
        if verdict in COUNTED:
            caught, total = rooms.get(room(defect.path), (0, 0))
            rooms[room(defect.path)] = (caught + (verdict == "caught"), total + 1)
    print()
    for name, (caught, total) in sorted(rooms.items()):
        print(f"{name:<28}{caught:4} of {total:3}")
    caught = sum(count for count, _ in rooms.values())
    total = sum(count for _, count in rooms.values())
    low, high = wilson(caught, total)
    others = {verdict for _, verdict, _ in results} - set(COUNTED)
    counts = ", ".join(f"{sum(v == other for _, v, _ in results)} {other}" for other in sorted(others))
    rate = 100.0 * caught / total if total else 0.0
    print(f"{caught} of {total} defects caught: {rate:.1f} %, 95 % interval {100 * low:.1f} to {100 * high:.1f} %"
          + (f"; not counted: {counts}" if counts else ""))  # fmt: skip
    return rate


def sources_of(given, scratch):
    if given.revision is None:
        return given.root
    archive = subprocess.run(["git", "-C", str(given.root), "archive", given.revision], check=True, capture_output=True)
    subprocess.run(["tar", "-x", "-C", scratch], check=True, input=archive.stdout)
    return Path(scratch)


def chosen(given, clean, log_path):
    """A list of defects, or None for the whole drawing."""
    if given.list:
        return [d for d in listed(clean.source, given.root / "tests/mutation/defects.tsv")
                if re.search(given.only, f"{d.path} {d.old} {d.new} {d.suites}")]  # fmt: skip
    if given.only_survivors:
        return [from_log(entry) for entry in read_log(given.only_survivors) if entry["verdict"] == "survived"]
    if given.defect:
        entries = {entry["id"]: entry for entry in read_log(log_path)}
        return [from_log(entries[name]) for name in given.defect if name in entries]
    return None


def main():
    given = arguments()
    os.nice(given.nice)
    directory = given.root / "build" / "mutation"
    directory.mkdir(parents=True, exist_ok=True)
    clean = CleanTree(directory / "clean", given.root)
    with tempfile.TemporaryDirectory() as scratch:
        try:
            clean.prepare(sources_of(given, scratch), given.jobs)
        except subprocess.CalledProcessError:
            sys.exit(f"the build without any defect fails, see {clean.directory}/build.log")
    runner = Runner(clean, [] if given.real_data else ["*OnRealData*"])
    times, failing = baseline(clean, runner, lambda line: print(line, flush=True), given.jobs)
    name = "list" if given.list else "survivors" if given.only_survivors else f"seed-{given.seed}"
    log_path = given.log or directory / f"{name}.jsonl"
    defects = chosen(given, clean, log_path)
    kept = [e for e in read_log(log_path) if e["verdict"] not in ("survived", "does not apply")] if given.resume else []
    known = {entry["id"]: (entry["verdict"], entry["detail"]) for entry in kept}
    workers = [Worker(clean, number, runner, times) for number in range(given.jobs)]
    print(f"{sum(times.values()):.0f} s of CPU for {len(times)} suites without any defect")
    with open(os.devnull if given.defect else log_path, "w") as log:
        session = Session(known, judged(given.root / "tests/mutation/equivalent.tsv"), log)
        if defects is None:
            drawing = Drawing(clean.source, given.seed, given.count)
            try_shares(drawing, drawing.order[: given.first], session, workers, given.only)
        else:
            try_all(defects, session, workers)
    rate = summary(session.results)
    for suite, tests in failing.items():
        what = "" if suite in times else ", the whole suite"
        print(f"{suite} fails without any defect ({', '.join(tests)}); that was left out{what}", file=sys.stderr)
    least = given.least if given.least is not None else 95.0 if given.list else 90.0
    misplaced = any(verdict == "does not apply" for _, verdict, _ in session.results)
    sys.exit(1 if failing or misplaced or rate < least else 0)


if __name__ == "__main__":
    main()
