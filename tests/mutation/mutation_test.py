"""What is drawn from a source, and what is not. Run by CTest."""

import math
import sys
import tempfile
import unittest
from pathlib import Path
from types import SimpleNamespace

sys.dont_write_bytecode = True
sys.path.insert(0, str(Path(__file__).parent))

from cpp_tokens import Source  # noqa: E402
from drawing import Defect, listed  # noqa: E402
from mutation import wilson  # noqa: E402
from operators import mutations  # noqa: E402
from tree import CleanTree, Outcome, baseline  # noqa: E402


def drawn(code, kind=None):
    """What the code may become."""
    source = Source(code)
    return {
        code[: m.start] + m.text + code[m.end :] for m in mutations(source) if kind is None or m.kind == kind
    }


class Operators(unittest.TestCase):
    def test_flips_signs_and_comparisons(self):
        self.assertIn("x = a - b;", drawn("x = a + b;", "sign"))
        self.assertIn("x = f(b);", drawn("x = f(-b);", "sign"))
        self.assertIn("x = a >= b;", drawn("x = a < b;", "comparison"))
        self.assertIn("x = std::max(a, b);", drawn("x = std::min(a, b);", "comparison"))

    def test_changes_constants_and_indices(self):
        self.assertLessEqual({"x = 0.0;", "x = 1.0;", "x = (2.5 * 10.0);"}, drawn("x = 2.5;", "constant"))
        self.assertEqual({"x = a[2];", "x = a[0];"}, drawn("x = a[1];", "index"))
        self.assertIn("x = R(1, 2);", drawn("x = R(0, 2);", "index"))

    def test_swaps_arguments_of_calls_but_not_parameters(self):
        self.assertEqual({"x = f(b, a);"}, drawn("x = f(a, b);", "swapped arguments"))
        self.assertEqual(set(), drawn("double f(const A& a, const B& b);", "swapped arguments"))
        self.assertEqual({"g({.a = y, .b = x});"}, drawn("g({.a = x, .b = y});", "swapped arguments"))
        self.assertIn('x = {{"a", d}, {"c", b}};', drawn('x = {{"a", b}, {"c", d}};', "swapped arguments"))

    def test_drops_statements_but_not_declarations(self):
        self.assertIn("void f() { ; }", drawn("void f() { g(1); }", "dropped statement"))
        self.assertEqual(set(), drawn("void f() { const double x = g(1); }", "dropped statement"))
        self.assertIn("void f() { if (a) { ; } }", drawn("void f() { if (a) { throw E(); } }", "dropped statement"))

    def test_drops_conditions(self):
        conditions = drawn("; if (a && b) { g(); }", "dropped condition")
        self.assertEqual({f"; if ({c}) {{ g(); }}" for c in ("true", "false", "a", "b")}, conditions)
        self.assertIn("x = false ? 1 : 2;", drawn("x = c ? 1 : 2;", "dropped condition"))

    def test_swaps_axes_and_units_and_transposes(self):
        self.assertEqual({"a = p.y();", "a = p.z();"}, drawn("a = p.x();", "swapped axis"))
        self.assertEqual({"a = b * 1.0;"}, drawn("a = b * 1e3;", "swapped unit"))
        self.assertEqual({"a = R_BF.transpose() * p;"}, drawn("a = R_BF * p;", "transposed matrix"))

    def test_ignores_options(self):
        self.assertEqual(
            {"x = std::remove_cvref_t<decltype(options)>{}.seed;"}, drawn("x = options.seed;", "ignored option")
        )
        self.assertEqual({"o;"}, drawn("o->check(positive());", "ignored option"))

    def test_leaves_comments_texts_templates_and_assertions_alone(self):
        for code in (
            "// x = a + b", "#include <a/b>", 'throw E("1 + 2");', "std::array<int, 3> a;", "static_assert(a == 1);"
        ):
            changed = drawn(code) - drawn(code, "dropped statement")
            self.assertEqual(set(), changed, code)


class Defects(unittest.TestCase):
    def test_is_found_again_where_lines_moved(self):
        defect = Defect("src/a.cpp", 2, "b;\n", "c;\n", "sign")
        self.assertEqual("x;\ny;\nz;\nc;\n", defect.applied_to("x;\ny;\nz;\nb;\n"))
        self.assertIsNone(defect.applied_to("x;\n"))

    def test_of_the_list_stand_once_in_their_sources(self):
        root = Path(__file__).parents[2]
        for defect in listed(root, root / "tests/mutation/defects.tsv"):
            file = root / defect.path
            count = file.read_text().count(defect.old) if file.exists() else 0
            self.assertEqual(1, count, f"{defect.path}: {defect.old}")
            self.assertNotEqual(defect.old, defect.new, defect.path)

    def test_interval_is_that_of_wilson(self):
        low, high = wilson(81, 263)  # Newcombe, Statistics in Medicine 17 (1998), table I
        self.assertTrue(math.isclose(low, 0.2553, abs_tol=5e-5) and math.isclose(high, 0.3662, abs_tol=5e-5), (low, high))


class Suites(unittest.TestCase):
    def test_are_those_of_the_tests_folder_alone(self):
        tree = CleanTree(Path("/made/clean"), Path("/project"))
        for file, expected in {
            "/made/clean/source/tests/base/text_test.cpp": "base",
            "/made/clean/source/tests/layers_test.cpp": "project",
            "/made/clean/source/tests/faults.cpp": None,
            "/made/clean/build/report_files.cpp": None,
        }.items():
            self.assertEqual(expected, tree._wing_of(Path(file)), file)

    def test_that_fail_without_a_defect_are_left_out_test_by_test(self):
        broken = {"a_test": ["A.One", "A.Two"], "b_test": [], "c_test": ["ended by signal 11"]}

        class Runner:
            left_out = []
            left_out_of = {}

            def run(self, suite, *_):
                left = [test for test in broken[suite] if test not in self.left_out_of.get(suite, [])]
                return Outcome(not left, *left[:1])

        with tempfile.TemporaryDirectory() as scratch:
            folder = Path(scratch)
            for name in ("kdlcal.real", *broken):
                (folder / name).write_text(name)
            clean = SimpleNamespace(
                directory=folder, build=folder, library=folder / "kdlcal.real", suites=broken,
                executable=lambda suite: folder / suite,
            )  # fmt: skip
            runner = Runner()
            times, failing = baseline(clean, runner, lambda line: None)
        self.assertEqual({"a_test", "b_test"}, set(times))
        self.assertEqual({"a_test": ["A.One", "A.Two"], "c_test": ["ended by signal 11"]}, failing)
        self.assertEqual({"a_test": ["A.One", "A.Two"]}, runner.left_out_of)


if __name__ == "__main__":
    unittest.main()
