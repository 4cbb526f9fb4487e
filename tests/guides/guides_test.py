"""Runs the commands of guides: every line that begins with "$ " in an indented block, in one folder for each page.

    guides_test.py <folder of kdlcal> <folder of the robots> <page>...

An HTML comment "<!-- run: ... -->" holds commands that a reader does not see, such as the preparation of files. The
lines below a command are its output: each has to occur in it, in this order. Blanks count as one, an ellipsis is any
text. Every command has to succeed.
"""

import os
import pathlib
import re
import subprocess
import sys
import tempfile
import unittest

BIN, ROBOTS, *PAGES = sys.argv[1:]
MOST_WORDS = 800


def steps(text):
    """Pairs of a command and the lines of its output. A block without "$ " is an example that is not run."""
    result = []
    for comment, block in re.findall(r"<!-- run:\n(.*?)-->|((?:^    [^\n]*\n)+)", text, re.S | re.M):
        if comment:
            result.append((comment, []))
            continue
        lines = [line[4:] for line in block.splitlines()]
        if not lines[0].startswith("$ "):
            continue
        while lines:
            line = lines.pop(0)
            if not line.startswith("$ "):
                result[-1][1].append(line)
                continue
            command = line[2:]
            while command.endswith("\\"):
                command += "\n" + lines.pop(0)
            result.append((command, []))
    return result


def pattern(line):
    words = re.split(r"(…)", line)
    return "".join(".*" if w == "…" else r"\s+".join(map(re.escape, w.split(" "))) for w in words)


class Guides(unittest.TestCase):
    def run_page(self, page):
        text = pathlib.Path(page).read_text(encoding="utf-8")
        commands = steps(text)
        self.assertTrue(any(expected for _, expected in commands), "the page shows no output of a command")
        environment = dict(os.environ, PATH=BIN + os.pathsep + os.environ["PATH"], ROBOTS=ROBOTS, LC_ALL="C.UTF-8")
        with tempfile.TemporaryDirectory() as folder:
            for command, expected in commands:
                run = subprocess.run(["bash", "-euc", command], cwd=folder, env=environment,
                                     capture_output=True, text=True, encoding="utf-8")
                output = run.stdout + run.stderr
                self.assertEqual(run.returncode, 0, f"{command}\n{output}")
                at = 0
                for line in expected:
                    found = re.search(pattern(" ".join(line.split())), re.sub(r"[ \t]+", " ", output)[at:])
                    self.assertIsNotNone(found, f"{command}\nsays no more:\n{line}\nbut\n{output}")
                    at += found.end()

    def test_pages_do_what_they_say(self):
        for page in PAGES:
            with self.subTest(page=os.path.basename(page)):
                self.run_page(page)

    def test_guides_are_short(self):
        for page in PAGES:
            if "guides" in page:
                text = pathlib.Path(page).read_text(encoding="utf-8")
                visible = re.sub(r"<!--.*?-->|^```.*?^```", "", text, flags=re.S | re.M)
                self.assertLessEqual(len(visible.split()), MOST_WORDS, page)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
