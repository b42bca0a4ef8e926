#!/usr/bin/env python3
"""Tests of draw.py: python3 benches/test_draw.py"""

import importlib.util
import tempfile
import unittest
from pathlib import Path

import draw

WITH_MATPLOTLIB = unittest.skipUnless(importlib.util.find_spec("matplotlib"), "matplotlib is not installed")


class Reading(unittest.TestCase):
    def read(self, text):
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "rows.csv"
            file.write_text(text, encoding="utf-8")
            return draw.read(file)

    def test_fields_are_numbers_names_or_missing(self):
        rows = self.read("cloud,n,who,error,plan\ncube,1000,ferreus,2e-4,\n")
        self.assertEqual(rows, [{"cloud": "cube", "n": 1000.0, "who": "ferreus", "error": 2e-4, "plan": None}])

    def test_a_row_of_another_length_is_named(self):
        for row in ["cube,few", "cube,1,2,3"]:
            with self.assertRaisesRegex(SystemExit, r"rows\.csv:3: .* fields"):
                self.read(f"cloud,n,error\ncube,1,2\n{row}\n")


class Front(unittest.TestCase):
    def test_the_front_is_what_nothing_beats_in_both(self):
        points = [(1e-3, 2.0), (1e-6, 5.0), (1e-4, 6.0), (1e-1, 1.0), (1e-3, 3.0)]
        self.assertEqual(draw.front(points), [(1e-6, 5.0), (1e-3, 2.0), (1e-1, 1.0)])
        self.assertEqual(draw.front([]), [])


@WITH_MATPLOTLIB
class Charts(unittest.TestCase):
    def test_a_label_of_several_panels_is_in_the_key_once(self):
        chart = draw.Chart(["first", "second"], "title", "x", "y")
        for axes in chart.panels:
            chart.rings(axes, [(1, 1)])
            chart.line(axes, [(1, 1), (10, 10)], "line", "black", "-")
        self.assertEqual(list(chart.entries()), ["line", "none better in both"])

    def test_axes_enclose_the_points_of_all_panels(self):
        chart = draw.Chart(["first", "second"], "title", "x", "y")
        chart.line(chart.panels[0], [(0.3, 700.0)], "line", "black", "-")
        chart.line(chart.panels[1], [(20.0, 2.0)], "line", "black", "-")
        for axes in chart.panels:
            for (low, high), (least, greatest) in [(axes.get_xlim(), (0.3, 20.0)), (axes.get_ylim(), (2.0, 700.0))]:
                self.assertTrue(low <= least and greatest <= high)

    def test_every_kind_of_file_becomes_its_charts(self):
        files = {
            "speed_cube_1e5": "n,cloud,kernel,precision,way,asked,outcome,error,first_plan,plan,apply\n"
            "100000,cube,1/r,f64,direct,,kept,0.000e0,0,0,2.3\n"
            "100000,cube,1/r,f64,interpolation,1e-3,missed,2e-3,0.05,0.02,0.07\n"
            "100000,cube,1/r,f64,interpolation,1e-9,unreachable,,,,\n",
            "peers": "cloud,n,asked,threads,who,knob,error,plan,apply\n"
            "cube,100000,1e-3,2,farfield,1e-3,1e-4,0.1,0.2\n"
            "cube,100000,1e-3,2,ferreus,4e0,2e-4,0.3,0.4\n",
            "contract": "n,cloud,kernel,way,asked,outcome,delivered\n"
            "2000,cube,1/r,harmonic,1e-2,kept,1.158e-3\n2000,cube,1/r,harmonic,1e-9,unreachable,\n",
            "scaling": "n,cloud,kernel,precision,tolerance,threads,outcome,plan,apply\n"
            "1000,cube,1/r,f64,1e-3,2,passed,0.1,0.2\n2000,cube,1/r,f64,1e-3,2,passed,0.2,0.4\n",
        }
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            for file, text in files.items():
                (folder / f"{file}.csv").write_text(text, encoding="utf-8")
            draw.main(folder)
            charts = {file.stem: file.read_text(encoding="utf-8") for file in folder.glob("*.svg")}
        self.assertEqual(
            sorted(charts), ["1-over-r-f64-2", "contract", "speed_apply_cube_1e5", "speed_plan_cube_1e5"]
        )
        for label in ["direct sum, f64", "FMM, interpolation, f64", "ferreus_bbfmm", "none better in both"]:
            self.assertEqual(charts["speed_apply_cube_1e5"].count(f">{label}<"), 1, label)
        self.assertNotIn("direct sum", charts["speed_plan_cube_1e5"])
        self.assertIn(">1/r, harmonics<", charts["contract"])
        self.assertIn(">cube, 1e-3<", charts["1-over-r-f64-2"])


if __name__ == "__main__":
    unittest.main()
