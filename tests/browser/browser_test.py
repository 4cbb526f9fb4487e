"""The pages of kdlcal in a real browser: nothing is asked of the network, nothing is complained of, every section is
there, and the numbers are those of the data. Exit status 77 where there is no browser."""

import argparse
import csv
import json
import math
import pathlib
import re
import subprocess
import sys
import tempfile
import unittest

import browser

ARGUMENTS = None
SKIPPED = 77

SECTIONS = {
    "calibration": ["verdict", "provenance", "accuracy", "enter", "robot", "residuals", "parameters", "effects", "influence", "next"],
    "validation": ["verdict", "provenance", "accuracy", "robot", "residuals"],
    "comparison": ["verdict", "provenance", "parameters"],
    "compensation": ["verdict", "provenance", "corrections", "bounded"],
    "plan": ["verdict", "accuracy", "robot"],
    "monte_carlo": ["verdict", "accuracy"],
    "two_step": ["verdict", "convergence", "truth"],
}
HOSTILE = ["</script><script>document.title='no'</script>", "<img src=x onerror=\"document.title='no'\">", "a 'quote' \"",
           "\U0001F916 robot", "x" * 300, "\u05e2\u05d1\u05e8\u05d9\u05ea"]


def kdlcal(folder, *words, expected=(0,)):
    done = subprocess.run([ARGUMENTS.kdlcal, *map(str, words)], cwd=folder, capture_output=True, text=True, timeout=300)
    if done.returncode not in expected:
        raise AssertionError(f"kdlcal {' '.join(map(str, words))}: status {done.returncode}\n{done.stderr}")
    return done.stdout


def simulated(folder, name, *options):
    kdlcal(folder, "simulate", "--noise", "3e-5", "--seed", "1", "--length-sigma", "0.001", "--angle-sigma", "0.001",
           *options, "--output", name)


def urdf():
    return pathlib.Path(ARGUMENTS.urdf_dir) / "fanuc_r2000ic_165f.urdf"


def on_a_rail():
    """The FANUC on a linear axis: seven joints."""
    rail = """<link name="rail_base"/><joint name="rail" type="prismatic"><parent link="rail_base"/>
      <child link="base_link"/><origin xyz="0 0 0.1"/><axis xyz="1 0 0"/>
      <limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>"""
    return urdf().read_text().replace("</robot>", rail)


def signed(value, decimals):
    return f"{value:.{decimals}f}".replace("-", "−")


def short_number(metres):
    size = abs(metres) * 1e3
    return signed(metres * 1e3, 1 if size >= 100 else 2 if size >= 10 else 3)


class Pages(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.browser = browser.driver()
        cls.folder = tempfile.TemporaryDirectory(prefix="kdlcal_pages_")
        cls.path = pathlib.Path(cls.folder.name)
        simulated(cls.path, "demo.csv", "--configurations", "30", "--test-configurations", "20", "--joint-ranges",
                  "-90:90,-75:60,-90:90,-90:90,-120:120,-180:180")
        (cls.path / "asked.csv").write_text("configuration," + ",".join(f"joint_{j}[rad]" for j in range(1, 7)) +
                                            "\nhere,0.1,0.2,0.3,0.4,0.5,0.6\nfar,0,3,0,0,0,0\n")
        kdlcal(cls.path, "calibrate", "--measurements", "demo.csv", "--output", "demo.urdf", "--result", "demo.json",
               "--report", "demo.html", "--note", "serial=R1", "--note", "payload=120 kg", "--predict-at", "asked.csv",
               "--require", "test.rms<=0.1mm")

    @classmethod
    def tearDownClass(cls):
        browser.close(cls.browser)
        cls.folder.cleanup()

    def js(self, code, *arguments):
        return self.browser.execute_script(code, *arguments)

    def data(self):
        return json.loads(self.js("return document.getElementById('data').textContent"))

    def open(self, name, dark=False, width=1200):
        browser.set_colours(self.browser, dark)
        browser.set_size(self.browser, width, 900)
        browser.open_page(self.browser, self.path / name)

    def check_page(self, name, kind="calibration"):
        """What holds of every page. Returns its data."""
        self.open(name)
        data = self.data()
        self.assertEqual(data["kind"], kind)
        self.assertEqual(self.js("return Array.from(document.querySelectorAll('main > section'), (s) => s.id)"), SECTIONS[kind])
        self.assertEqual(self.js("return Array.from(document.querySelectorAll('main > section'), (s) => s.children.length).filter((n) => n < 2)"), [])
        self.assertNotIn("could not be drawn", self.js("return document.body.innerText"))
        for text in ["NaN", "undefined", "Infinity", "[object"]:
            self.assertNotIn(text, self.js("return document.getElementById('report').innerText"))
            self.assertNotIn(text, self.js("return Array.from(document.querySelectorAll('svg *'), (n) => Array.from(n.attributes, (a) => a.value).join(' ')).join(' ')"))
        light = browser.screenshot(self.browser)
        self.assertGreater(browser.colours(light), 20)
        if self.js("return document.getElementById('view') !== null"):
            self.check_canvas()
        self.open(name, dark=True)
        dark = browser.screenshot(self.browser)
        self.assertGreater(browser.colours(dark), 20)
        self.assertGreater(browser.brightness(light), 180)
        self.assertLess(browser.brightness(dark), 90)
        self.open(name, width=400)
        self.assertGreater(browser.colours(browser.screenshot(self.browser)), 20)
        self.assertLessEqual(self.js("return document.documentElement.scrollWidth"), 400)
        printed = browser.pdf(self.browser)
        self.assertTrue(printed.startswith(b"%PDF"))
        self.assertGreater(len(printed), 20000)
        self.assertEqual(browser.requests(self.browser), [])
        self.assertEqual(browser.complaints(self.browser), [])
        self.open(name)
        return data

    def check_canvas(self):
        different = self.js("""const c = document.getElementById('view'); const g = c.getContext('2d');
          const p = g.getImageData(0, 0, c.width, c.height).data; const found = new Set();
          for (let i = 0; i < p.length; i += 404) found.add(p[i] + ',' + p[i + 1] + ',' + p[i + 2]); return found.size;""")
        self.assertGreater(different, 5)

    def check_kinematics(self):
        """The tool in the picture stands where the result predicts it: measured minus residual."""
        largest = self.js("""let most = 0;
          for (const p of kdlcal.data.measured.points) {
            const found = kdlcal.predictedPoint(kdlcal.data.robot, kdlcal.data.measured.configurations[p.configuration], p.target);
            for (let i = 0; i < 3; ++i) most = Math.max(most, Math.abs(found[i] - (p.measured[i] - p.residual[i])));
          } return most;""")
        self.assertLess(largest, 1e-9)

    def check_statement(self, data):
        """The sentence at the top: k times the RMS of rows that were not fitted, what no row shows, and the scatter of one row."""
        result = data["result"]
        errors, stated = result["position_error"], result["new_point"]
        pair = errors.get("leave_one_out") or errors.get("k_fold") or errors.get("test") or errors["train"]
        assumed = result["predicted_accuracy"]["budget"]["of_assumptions"]
        expanded = lambda rms: stated["coverage_factor"] * math.hypot(rms, assumed, stated["of_one"])
        self.assertAlmostEqual(stated["nominal"], expanded(pair["before"]["rms"]), delta=1e-12)
        if "exported_urdf" in pair:
            self.assertAlmostEqual(stated["urdf_alone"], expanded(pair["exported_urdf"]["rms"]), delta=1e-12)
        self.assertGreaterEqual(stated["compensated"], expanded(pair["after"]["rms"]) - 1e-12)
        millimetres = lambda v: f"{v * 1e3:.{3 if v < 1e-4 else 2}f} mm"
        shown = [millimetres(v) for v in dict.fromkeys([stated["nominal"], stated["urdf_alone"], stated["compensated"]])]
        self.assertEqual(self.js("return Array.from(document.querySelectorAll('#verdict .arms .value'), (n) => n.textContent)"), shown)
        if result["trusted"]:
            sentence = self.js("return document.querySelector('#verdict .statement').textContent")
            self.assertEqual([word for word in shown if word not in sentence], [])
        self.assertLessEqual(self.js("return document.querySelectorAll('#verdict > .messages li').length"), 3)

    def rows_of(self, section):
        return self.js("return Array.from(document.querySelectorAll(arguments[0] + ' tbody tr'), (r) => Array.from(r.cells, (c) => c.textContent))",
                       "#" + section)

    def check_calibration(self, name):
        data = self.check_page(name)
        self.check_statement(data)
        self.check_kinematics()
        self.check_errors(data["result"])
        self.check_budget(data["result"])
        return data

    def check_errors(self, result):
        """Points and means, each nominal, calibrated and by the URDF alone."""
        rows = {row[0]: row[1:] for row in self.rows_of("accuracy table.accuracy")}
        errors = result["position_error"]
        for title, key in [("Fitted", "train"), ("Test", "test"), ("Left out", "leave_one_out")]:
            pair = errors.get(key, {})
            for name, of in [(title + " points", pair), (title + " means", pair["means"])] if "means" in pair else [(title, pair)]:
                for when, statistics in [("nominal", of.get("before")), ("calibrated", of.get("after")), ("URDF alone", of.get("exported_urdf"))]:
                    expected = statistics and [short_number(statistics[k]) for k in ("rms", "mean", "p95", "max")] + [str(statistics["count"])]
                    self.assertEqual(rows.get(f"{name}, {when}"), expected)

    def check_budget(self, result):
        """Root sums of squares over the axes, and over the parts."""
        noise, predicted = result["noise"], result["predicted_accuracy"]
        rows = {row[0]: row[2] for row in self.rows_of("accuracy table.budget")}
        parts = [math.hypot(*noise["independent"]), math.hypot(*noise["common"]), math.sqrt(3) * math.hypot(noise["misfit"], noise["target_misfit"])]
        if predicted["measured"] and noise["model"] == "parts":
            parts += [predicted["unseen"]["rms"], predicted["budget"]["of_assumptions"]]
            total = math.hypot(*parts)
            self.assertEqual(list(rows.values()), [short_number(value) if value else "0.000" for value in [*parts, total, predicted["budget"]["coverage_factor"] * total]])

    def test_calibration_of_the_demo(self):
        data = self.check_calibration("demo.html")
        self.assertEqual(self.js("return document.querySelector('#verdict .headline').textContent"), "To be trusted")
        test_rms = data["result"]["position_error"]["test"]["after"]["rms"]
        self.assertEqual(self.rows_of("verdict table.requirements"), [["test.rms ≤ 0.1 mm", f"{test_rms * 1e3:.6g} mm", "met"]])
        asked = data["result"]["predicted_accuracy"]["asked"]
        rows = self.rows_of("accuracy table.asked")
        self.assertEqual(len(rows), 18)
        for i, point in enumerate(asked):
            nominal, position = point["position_nominal"], point["position"]
            self.assertIn(f"{point['configuration']}, target {point['target']}", rows[3 * i][0])
            for row, place in zip(rows[3 * i:], [nominal, position, [a - b for a, b in zip(position, nominal)]]):
                self.assertEqual(row[1:4], [signed(value * 1e3, 3) for value in place])
            self.assertEqual(rows[3 * i + 1][4:], [short_number(point["sigma"]), short_number(point["radius_95"]), "outside" if point["outside"] else ""])
        for parameter in data["result"]["parameters"]:
            if not parameter["name"].startswith("base.") and parameter["joint"]:
                self.assertIn(parameter["name"], self.js("return document.getElementById('parameters').innerText"))
        self.assertEqual(self.js("return document.querySelector('#next .command code').textContent"), data["plan_command"])

    def test_a_click_on_a_residual_chooses_its_configuration(self):
        from selenium.webdriver.common.action_chains import ActionChains
        self.open("demo.html")
        view_before = self.js("return document.getElementById('view').toDataURL()")
        plot = self.js("""const s = document.querySelectorAll('#residuals figure svg')[0]; s.scrollIntoView({block: 'center'});
          return s;""")
        place = self.js("""const s = arguments[0]; const m = s.querySelector('.dots.after').getAttribute('d').match(/M([\\d.]+) ([\\d.]+)/g)[40].match(/[\\d.]+/g).map(Number);
          const b = s.getBoundingClientRect(); const f = b.width / s.viewBox.baseVal.width; return [m[0] * f - b.width / 2, m[1] * f - b.height / 2];""", plot)
        chains = ActionChains(self.browser)
        chains.move_to_element_with_offset(plot, round(place[0]), round(place[1])).perform()
        hint = self.js("return document.getElementById('tip').innerText")
        self.assertRegex(hint, r"Configuration \S+, target [ABC]")
        named = hint.split(",")[0].replace("Configuration ", "").strip()
        ActionChains(self.browser).click().perform()
        self.assertEqual(self.js("return document.body.dataset.configuration"), named)
        self.assertNotEqual(named, self.js("return kdlcal.data.measured.configurations[0].name"))
        self.assertEqual(self.js("return kdlcalView.joints()"), self.js("return kdlcal.data.measured.configurations.find((c) => c.name === arguments[0]).joint_values", named))
        self.assertNotEqual(self.js("return document.getElementById('view').toDataURL()"), view_before)
        chosen = self.js("return Array.from(document.querySelectorAll('#robot tr.selected'), (r) => r.cells[0].textContent)")
        self.assertEqual(chosen, [named] * 3)
        self.assertIn(named, self.js("return document.querySelector('.chosen').innerText"))

    def test_slider_keys_and_layers_change_the_picture(self):
        from selenium.webdriver.common.by import By
        from selenium.webdriver.common.keys import Keys
        self.open("demo.html")
        picture = lambda: self.js("return document.getElementById('view').toDataURL()")
        seen = [picture()]

        def changed():
            seen.append(picture())
            self.assertNotIn(seen[-1], seen[:-1])

        self.browser.find_element(By.ID, "exaggeration").send_keys(Keys.ARROW_RIGHT * 6)
        self.assertIn("errors ×", self.js("return document.querySelector('output').textContent"))
        changed()
        view = self.browser.find_element(By.ID, "view")
        for keys in [Keys.ARROW_LEFT * 3, "+", Keys.SHIFT + Keys.ARROW_UP + Keys.NULL, "n"]:
            view.send_keys(keys)
            changed()
        self.browser.find_element(By.CSS_SELECTOR, "[data-layer=robot]").click()
        changed()
        self.browser.find_element(By.CSS_SELECTOR, "[data-layer=cells]").click()
        changed()

    def test_arrows_show_the_errors_that_the_result_holds(self):
        self.open("demo.html")
        data = self.data()
        held_out = {(p["configuration"], p["target"]): p for p in data["result"]["held_out_points"]}
        arrows = self.js("""const base = kdlcal.data.robot.base;
          return kdlcalView.scene.points.map((p, i) => [kdlcal.points[i].configuration, kdlcal.points[i].target, kdlcal.points[i].test,
            p.arrows.map((a) => [a.kind, Math.hypot(...a.vector)]),
            p.arrows.map((a) => [0, 1, 2].map((r) => base[4 * r] * a.vector[0] + base[4 * r + 1] * a.vector[1] + base[4 * r + 2] * a.vector[2]))]);""")
        self.assertEqual(len(held_out), 90)
        squares = {"before": 0.0, "after": 0.0, "held": 0.0}
        for configuration, target, test, kinds, in_device in arrows:
            self.assertEqual([kind for kind, _ in kinds], ["before", "after"] + ([] if test else ["held"]))
            if not test:
                for kind, size in kinds:
                    squares[kind] += size**2
                point = held_out[configuration, target]
                self.assertAlmostEqual(kinds[2][1], point["distance"], delta=1e-12)
                for found, expected in zip(in_device[2], point["residual"]):
                    self.assertAlmostEqual(found, expected, delta=1e-12)
        self.assertGreater(squares["before"], squares["held"])
        self.assertGreater(squares["held"], squares["after"])

    def test_keys_walk_through_a_chart(self):
        from selenium.webdriver.common.action_chains import ActionChains
        from selenium.webdriver.common.keys import Keys
        self.open("demo.html")
        press = lambda keys: ActionChains(self.browser).send_keys(keys).perform()
        hint = lambda: self.js("return document.getElementById('tip').hidden ? null : document.getElementById('tip').innerText")
        self.js("const s = document.querySelectorAll('#residuals figure svg')[0]; s.scrollIntoView({block: 'center'}); s.focus();")
        self.assertIsNone(hint())
        press(Keys.END)
        last = hint()
        press(Keys.HOME + Keys.ARROW_LEFT)
        first = hint()
        seen = []
        for key in [Keys.ARROW_RIGHT] * 3 + [Keys.END, Keys.HOME, Keys.ARROW_LEFT]:
            press(key)
            seen.append(hint())
            self.assertRegex(seen[-1], r"^Configuration \S+, target [ABC]")
        self.assertEqual(len({first, *seen[:4]}), 5)
        self.assertEqual(seen[3:], [last, first, first])
        press(Keys.END + Keys.ENTER)
        named = seen[3].split(",")[0].replace("Configuration ", "")
        self.assertEqual(self.js("return document.body.dataset.configuration"), named)
        self.assertEqual(hint(), seen[3])
        press(Keys.TAB)
        self.assertIsNone(hint())

    def test_what_was_required_and_missed_comes_first(self):
        kdlcal(self.path, "calibrate", "--measurements", "demo.csv", "--require", "leave_one_out.rms<1um,rank>3", "--result", "missed.json",
               "--report", "missed.html", expected=(1,))
        self.check_calibration("missed.html")
        self.assertEqual(self.js("return document.querySelector('#verdict .headline').textContent"), "Not as required")
        result = self.data()["result"]
        left_out = result["position_error"]["leave_one_out"]["after"]["rms"]
        self.assertEqual(self.rows_of("verdict table.requirements"), [["leave_one_out.rms < 1 um", f"{left_out * 1e6:.6g} um", "not met"],
                                                                      ["rank > 3", str(result["rank"]), "met"]])
        kdlcal(self.path, "report", "--result", "missed.json", "--output", "again.html")
        self.open("again.html")
        self.assertEqual(self.js("return document.querySelector('#verdict .headline').textContent"), "Not as required")

    def test_a_row_of_the_table_chooses_and_so_does_the_picture(self):
        self.open("demo.html")
        self.js("document.querySelector('#robot details').open = true; document.querySelector('#robot tbody tr:nth-child(7) button').click()")
        self.assertEqual(self.js("return document.querySelector('#robot tbody tr:nth-child(7)').className.includes('selected')"), True)
        named = self.js("return document.querySelector('#robot tbody tr:nth-child(7)').cells[0].textContent")
        self.assertEqual(self.js("return document.body.dataset.configuration"), named)
        self.js("""const v = kdlcalView; const other = v.at.find(([, , p]) => p.c !== kdlcal.selected.c && p.choose); const b = v.canvas.getBoundingClientRect();
          for (const type of ['pointerdown', 'pointerup']) v.canvas.dispatchEvent(new PointerEvent(type, {pointerId: 1, clientX: b.left + other[0], clientY: b.top + other[1], bubbles: true}));""")
        self.assertNotEqual(self.js("return document.body.dataset.configuration"), named)

    def test_print_has_lines_to_sign_and_a_picture_of_half_a_page(self):
        self.open("demo.html")
        shown = "return document.querySelector('.signature').innerText.split(/\\s+/)"
        self.assertEqual(self.js("return document.querySelector('.signature').clientHeight"), 0)
        self.browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
        self.assertEqual(self.js(shown), ["Date", "Name", "Signature"])
        self.assertLess(self.js("return document.getElementById('view').clientHeight"), 400)

    def test_numbers_can_be_saved(self):
        self.open("demo.html")
        saved = self.js("""let text = null; const real = URL.createObjectURL; window.Saved = [];
          URL.createObjectURL = (blob) => { Saved.push(blob); return real.call(URL, blob); };
          HTMLAnchorElement.prototype.click = function () {};
          document.querySelector('.save').click(); return Saved.length;""")
        self.assertEqual(saved, 1)
        text = self.browser.execute_async_script("const done = arguments[0]; Saved[0].text().then(done);")
        self.assertEqual(json.loads(text), self.data())

    def test_hostile_names_are_text(self):
        lines = (self.path / "demo.csv").read_text().splitlines()
        names = dict(zip("ABC", HOSTILE))
        header = lines[0].split(",")
        column = header.index("target")
        quoted = lambda text: '"' + text.replace('"', '""') + '"'
        out = [lines[0]]
        for line in lines[1:]:
            if line.startswith("#"):
                continue
            fields = line.split(",")
            fields[column] = quoted(names[fields[column]])
            fields[header.index("configuration")] = quoted(HOSTILE[5] + " " + fields[header.index("configuration")] + HOSTILE[3])
            out.append(",".join(fields))
        (self.path / "hostile.csv").write_text("\n".join(out) + "\n")
        robot = urdf().read_text().replace("joint_1", "&lt;script&gt;document.title='no'&lt;/script&gt;").replace("link_2", HOSTILE[4])
        (self.path / "hostile.urdf").write_text(robot)
        csv = (self.path / "hostile.csv").read_text().replace("joint_1[", quoted("<script>document.title='no'</script>[")[:-1], 1)
        csv = csv.replace("'no'</script>[rad]", "'no'</script>[rad]\"", 1)
        (self.path / "hostile.csv").write_text(csv)
        kdlcal(self.path, "calibrate", "--urdf", "hostile.urdf", "--measurements", "hostile.csv", "--report", "hostile.html",
               "--note", "<b>serial</b>=" + HOSTILE[1], "--note", "operator=" + HOSTILE[4], expected=(0, 1))
        self.check_page("hostile.html")
        self.check_kinematics()
        self.assertNotEqual(self.js("return document.title"), "no")
        self.assertEqual(self.js("return document.querySelectorAll('main script, main img, main b, header img').length"), 0)
        text = self.js("return document.body.textContent")
        for name in [*names.values(), HOSTILE[5], "<script>document.title='no'</script>"[:20]]:
            self.assertIn(name[:18], text)
        self.assertIn(HOSTILE[1], self.js("return document.getElementById('provenance').textContent"))

    def test_fit_that_is_not_determined(self):
        simulated(self.path, "deficient.csv", "--configurations", "25", "--joint-ranges", "-90:90,-75:60,-90:90,10:10,-120:120,-180:180")
        for more, status, headline in [([], 0, "To be trusted where it was measured"), (["--iterations", "1"], 1, "Not to be trusted")]:
            kdlcal(self.path, "calibrate", "--measurements", "deficient.csv", "--report", "deficient.html", "--force", *more, expected=(status,))
            data = self.check_calibration("deficient.html")["result"]
            self.assertEqual(self.js("return document.querySelector('#verdict .headline').textContent"), headline)
            for doubt in data["doubts"] + [data[name] for name in ["reservation"] if name in data]:
                self.assertIn(doubt["message"], self.js("return document.getElementById('verdict').textContent"))

    def test_seven_joints_with_a_linear_axis(self):
        (self.path / "rail.urdf").write_text(on_a_rail())
        simulated(self.path, "rail.csv", "--urdf", "rail.urdf", "--configurations", "40")
        kdlcal(self.path, "calibrate", "--urdf", "rail.urdf", "--measurements", "rail.csv", "--report", "rail.html", expected=(0, 1))
        data = self.check_calibration("rail.html")
        self.assertEqual(len(data["robot"]["joints"]), 7)
        self.assertRegex(self.rows_of("verdict")[0][1], r"^−?[\d.]+ to [\d.]+ mm$")

    def test_page_from_a_result_alone_says_what_is_missing(self):
        kdlcal(self.path, "report", "--result", "demo.json", "--output", "alone.html")
        data = self.check_page("alone.html")
        self.check_statement(data)
        for section, why in [("robot", "robot"), ("residuals", "robot")]:
            self.assertIn(data["missing"][why], self.js("return document.getElementById(arguments[0]).innerText", section))

    def test_printed_by_kdlcal(self):
        for paper, size in [("a4", (595, 842)), ("letter", (612, 792))]:
            kdlcal(self.path, "report", "--result", "demo.json", "--measurements", "demo.csv", "--pdf", paper + ".pdf", "--paper", paper)
            printed = (self.path / (paper + ".pdf")).read_bytes()
            boxes = [tuple(round(float(v)) for v in box.split()[2:]) for box in re.findall(rb"/MediaBox \[([^\]]*)\]", printed)]
            self.assertGreater(len(boxes), 3)
            self.assertEqual(set(boxes), {size})

    def test_paper_has_every_list_open_and_the_signature_last(self):
        self.open("demo.html")
        self.js("dispatchEvent(new Event('beforeprint'))")
        self.assertEqual(self.js("return document.querySelectorAll('details:not([open])').length"), 0)
        foot = self.js("return Array.from(document.querySelectorAll('head style'), (s) => s.textContent).join()")
        self.assertRegex(foot, r"@bottom-left \{ content: \"Calibration report, [^\"]*serial R1\"")
        self.assertIn("counter(page)", foot)
        self.assertEqual(self.js("return Array.from(document.querySelectorAll('#end .inner > *')).pop().className"), "signature")
        self.js("dispatchEvent(new Event('afterprint'))")
        self.assertGreater(self.js("return document.querySelectorAll('details:not([open])').length"), 0)

    def test_validation(self):
        kdlcal(self.path, "validate", "--urdf", "demo.urdf", "--measurements", "demo.csv", "--report", "validation.html",
               "--require", "all.max<1um", expected=(1,))
        data = self.check_page("validation.html", "validation")
        errors = data["result"]["position_error"]["all"]
        limit = errors["max"] * errors["rms_upper_95"] / errors["rms"]
        self.assertEqual(self.rows_of("verdict table.requirements"),
                         [["all.max < 1 um", f"{limit * 1e6:.6g} um (upper 95 % limit)", "not met"]])
        self.check_kinematics()
        self.assertEqual(self.rows_of("accuracy")[0][1], short_number(data["result"]["position_error"]["all"]["rms"]))

    def test_comparison(self):
        kdlcal(self.path, "simulate", "--noise", "3e-5", "--seed", "2", "--length-sigma", "0.001", "--output", "later.csv")
        kdlcal(self.path, "calibrate", "--measurements", "later.csv", "--effects", "none", "--result", "later.json")
        kdlcal(self.path, "compare", "demo.json", "later.json", "--report", "comparison.html")
        data = self.check_page("comparison.html", "comparison")["result"]
        self.assertEqual(self.js("return document.querySelector('.headline').textContent"), "The robot has changed")
        shown = {row[0].split(",")[0]: row for row in self.rows_of("parameters")}
        for parameter in data["parameters"]:
            row = shown[parameter["name"]]
            factor, decimals = (1e3, 4) if parameter["unit"] == "m" else (180 / math.pi, 5)
            for cell, key in [(2, "change"), (3, "std")]:
                self.assertAlmostEqual(float(row[cell].replace("−", "-")), parameter[key] * factor, delta=0.6 * 10**-decimals)

    def test_compensation(self):
        names = [f"joint_{j}[rad]" for j in range(1, 7)]
        rows = [[0.01 * k, 0.1, -0.3, 0.4, 0.002 * k - 0.5, 0.6] for k in range(400)]
        (self.path / "program.csv").write_text("\n".join(",".join(map(str, row)) for row in [names, *rows]) + "\n")
        kdlcal(self.path, "compensate", "--result", "demo.json", "--joints", "program.csv", "--output", "commands.csv",
               "--report", "compensation.html", "--note", "payload=60 kg", expected=(1,))
        data = self.check_page("compensation.html", "compensation")
        result = data["result"]
        self.assertEqual(len(data["points"]), 400)
        self.assertAlmostEqual(max(point["correction"] for point in data["points"]), result["largest_correction"])
        self.assertEqual([int(row[1]) for row in self.rows_of("verdict")], list(result["status"].values()))
        self.assertEqual(len(self.rows_of("bounded")), min(200, 400 - result["status"]["exact"]))
        self.assertIn("not '60 kg'", data["warnings"][0])

    def test_plan(self):
        kdlcal(self.path, "plan", "--configurations", "15", "--candidates", "400", "--workspace", "200", "--starts", "2", "--report", "plan.html",
               "--joint-convention", pathlib.Path(ARGUMENTS.urdf_dir) / "fanuc_r2000ic_165f_pendant.json", "--output", "plan.csv")
        data = self.check_page("plan.html", "plan")
        lines = [line.split(",") for line in (self.path / "plan.csv").read_text().splitlines() if ",A," in line]
        for row, line in zip(self.rows_of("robot"), lines, strict=True):
            self.assertEqual(row[0], line[0])
            for shown, written in zip(row[1:], line[2:]):
                self.assertAlmostEqual(float(shown.replace("−", "-")), float(written), delta=0.0051)
        self.assertEqual(self.rows_of("accuracy")[0][1], short_number(data["result"]["sigma"]["plan"]["mean"]))

    def test_monte_carlo(self):
        kdlcal(self.path, "simulate", "--configurations", "20", "--noise", "3e-5", "--monte-carlo", "20", "--report", "monte_carlo.html")
        data = self.check_page("monte_carlo.html", "monte_carlo")
        self.assertEqual(self.rows_of("accuracy")[0][1], short_number(data["result"]["held_out_error"]["all"]["rms"]))

    def test_two_step(self):
        kdlcal(self.path, "simulate", "--joint-ranges", "published", "--two-step", "12", "--report", "two_step.html", expected=(0, 1))
        data = self.check_page("two_step.html", "two_step")
        self.assertEqual(len(self.rows_of("truth")), len(data["result"]["parameters"]))

    def real(self, *way):
        if not ARGUMENTS.data:
            self.skipTest("no real measurements")
        return pathlib.Path(ARGUMENTS.data).joinpath(*way)

    def test_the_real_arm(self):
        measured = self.real("r2000ic_165f_tracker", "measurements.csv")
        kdlcal(self.path, "calibrate", "--measurements", measured, "--joint-convention", pathlib.Path(ARGUMENTS.urdf_dir) / "fanuc_r2000ic_165f_serial.json",
               "--prior", "auto", "--effects", "auto", "--report", "real.html", "--output", "real.urdf")
        data = self.check_calibration("real.html")
        self.assertGreater(len(data["effects"]), 0)
        self.assertIn("gravity", self.js("return document.getElementById('effects').innerText"))
        with measured.open() as file:
            first = next(csv.DictReader(line for line in file if not line.startswith("#")))
        shown = self.js("return document.querySelector('.chosen').textContent")
        for joint in range(1, 7):
            value = next(float(first[column]) for column in first if column.startswith(f"J{joint}"))
            self.assertIn(f"J{joint} {signed(math.degrees(value), 2)} °", shown)
        rows = self.rows_of("enter table.enter")
        for row, offset in zip(rows, data["result"]["joint_offsets"]["joints"]):
            expected = ["–", "", "–", "–", "–", "leave it: base or targets take it up"]
            if offset["measurable"]:
                half = math.degrees((offset["interval_95"][1] - offset["interval_95"][0]) / 2)
                add = math.degrees(offset["add"])
                alone = signed(math.degrees(offset["add_if_only_these"]), 5)
                is_shown = abs(add) > half  # that it is not zero
                expected = [signed(add, 3) if is_shown else "–", "°", signed(add, 5), f"± {half:.5f}", alone,
                            "" if is_shown else "may be zero: enter nothing"]
                self.assertEqual(f"{offset['joint']}," in self.js("return document.querySelector('#enter code').textContent"), is_shown)
            self.assertEqual(row, [offset["joint"], *expected])
        self.assertIn("You need not enter anything", self.js("return document.getElementById('enter').textContent"))
        # The controller's world is at the height of J2, 0.67 m above the base link.
        region = data["measured"]["region"]
        heights = [p["measured"] for p in data["measured"]["points"]]
        base = data["robot"]["base"]
        in_base = [sum(base[4 * i + 2] * (p[i] - base[4 * i + 3]) for i in range(3)) for p in heights]
        self.assertAlmostEqual(region["lower"][2], min(in_base) - 0.67, delta=1e-9)
        self.assertIn("the controller's world frame", self.js("return document.getElementById('verdict').textContent"))
        kdlcal(self.path, "validate", "--urdf", "real.urdf", "--measurements", measured, "--joint-convention",
               pathlib.Path(ARGUMENTS.urdf_dir) / "fanuc_r2000ic_165f_serial.json", "--report", "validated.html")
        errors = self.check_page("validated.html", "validation")["result"]["position_error"]["train"]
        rows = {row[0]: row[1:] for row in self.rows_of("accuracy table.accuracy")}
        for name, statistics in [("Train points", errors), ("Train means", errors["means"])]:
            self.assertEqual(rows[name], [short_number(statistics[k]) for k in ("rms", "mean", "p95", "max")] + [str(statistics["count"])])

    def test_what_is_left_after_an_entry(self):
        """Nothing that differs from zero is left to enter; the robot was as it was."""
        pendant = pathlib.Path(ARGUMENTS.urdf_dir) / "fanuc_r2000ic_165f_pendant.json"
        simulated(self.path, "p.csv", "--joint-convention", pendant, "--configurations", "25")
        kdlcal(self.path, "calibrate", "--measurements", "p.csv", "--joint-convention", pendant, "--effects", "none", "--result", "p.json", "--report", "p.html")
        data = self.check_calibration("p.html")
        lines = ["joint,added,unit"] + [f"{o['joint']},{o['add']!r},rad" for o in data["result"]["joint_offsets"]["joints"] if o["measurable"]]
        self.assertIn("as the robot is", self.js("return document.getElementById('verdict').textContent"))
        (self.path / "entered.csv").write_text("\n".join(lines) + "\n")
        kdlcal(self.path, "apply", "--result", "p.json", "--joint-convention", pendant, "--mastering-entered", "entered.csv", "--output", "entered.json")
        kdlcal(self.path, "report", "--result", "entered.json", "--output", "entered.html")
        self.check_page("entered.html", "calibration")
        text = self.js("return document.getElementById('enter').textContent")
        self.assertIn("Already entered: J2, J3, J4, J5", text)
        self.assertIn("Nothing needs to be entered.", text)
        self.assertIn("as the robot was", self.js("return document.getElementById('verdict').textContent"))

    def test_an_arm_whose_bearings_give_way(self):
        simulated(self.path, "tilted.csv", "--configurations", "70", "--effects", "transverse", "--effect-sigma", "0.0003")
        kdlcal(self.path, "calibrate", "--measurements", "tilted.csv", "--effects", "transverse", "--report", "tilted.html", expected=(0, 1))
        data = self.check_calibration("tilted.html")
        self.assertEqual(len(data["measured"]["configurations"][0]["effective"]), 18)
        self.assertIn("across its axis", self.js("return document.getElementById('effects').innerText"))

    def test_poses_of_the_ur10(self):
        folder = self.real("ur10_tracker_poses")
        kdlcal(self.path, "calibrate", "--urdf", folder / "ur10.urdf", "--measurements", folder / "measurements.csv", "--report", "ur10.html", expected=(0, 1))
        self.check_calibration("ur10.html")


def main():
    global ARGUMENTS
    parser = argparse.ArgumentParser()
    parser.add_argument("--kdlcal", required=True)
    parser.add_argument("--urdf-dir", required=True)
    parser.add_argument("--data", default="")
    parser.add_argument("tests", nargs="*")
    ARGUMENTS = parser.parse_args()
    try:
        browser.close(browser.driver())
    except browser.Skipped as reason:
        print(f"The pages are not tested in a browser: {reason}.")
        return SKIPPED
    result = unittest.main(module=__name__, argv=[sys.argv[0], "-v", *ARGUMENTS.tests], exit=False).result
    return 0 if result.wasSuccessful() else 1


if __name__ == "__main__":
    sys.exit(main())
