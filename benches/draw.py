#!/usr/bin/env python3
"""Draws the charts of the benchmark programs from the CSV files that they leave in a folder.

    pip install matplotlib
    python3 benches/draw.py FOLDER

Reads those of speed_*.csv, contract.csv, terms.csv, visibility.csv and scaling.csv that the folder holds, and
writes each chart beside them as SVG. The measurements of other libraries, peers.csv of benches/peers,
are added to the charts of speed if that file is in the folder too.
"""

import csv
import sys
from pathlib import Path

COLOURS = [
    "#0b6e99", "#c8553d", "#4f772d", "#7b4b94", "#b8860b", "#e377c2", "#17becf", "#8c564b", "#d62728",
    "#7fb800", "#1f4fff", "#ff9f1c", "#00a878", "#a30059", "#9aa0a6", "#5d2e8c", "#2f4b26", "#000000",
]
GREY = "#444444"
DASHES = ["-", "--", ":", "-.", (0, (5, 1, 1, 1, 1, 1)), (0, (1, 3))]

# How charts call the kernels of the CSV files; other names stand for themselves.
KERNELS = {
    "1/r4": "1/r⁴", "r2": "r²", "r3": "r³", "radiosity": "radiosity tensor", "yukawa": "Yukawa",
    "gaussian": "Gaussian", "log": "log r", "helmholtz": "exp(ikr)/r", "anisotropic": "anisotropic 1/r",
    "matern": "Matérn 5/2", "r-log-r": "r log r", "inverse-quadratic": "1/(1 + r²)",
    "anisotropic-gaussian": "anisotropic Gaussian", "stokeslet": "Stokeslet",
}
# How charts call the ways to sum, and other libraries, each with its colour.
WAYS = {
    "interpolation": ("FMM, interpolation", 0), "harmonic": ("FMM, harmonics", 1),
    "sixteen-moments": ("FMM, 16 moments", 2), "interpolation-treecode": ("treecode, interpolation", 3),
    "harmonic-treecode": ("treecode, harmonics", 4), "separable": ("separable sum", 8),
    "ferreus": ("ferreus_bbfmm", 5), "fmm3dpy": ("fmm3dpy", 7),
}
EXPANSIONS = {
    "harmonics": "solid harmonics", "sixteenmoments": "16 moments in harmonics",
    "nodes": "Chebyshev nodes, n³ per field", "compressed": "interpolation, compressed to rank",
}


def main(folder):
    for file in sorted(folder.glob("speed_*.csv")):
        speed(folder, file.stem.removeprefix("speed_"), read(file))
    for name, draw in [("contract", contract), ("terms", terms), ("visibility", visibility), ("scaling", scaling)]:
        file = folder / f"{name}.csv"
        if file.exists():
            draw(folder, read(file))


def read(file):
    """The rows of a CSV file, numbers as numbers, empty fields as None."""

    def value(text):
        try:
            return float(text)
        except ValueError:
            return text or None

    with open(file, newline="", encoding="utf-8") as lines:
        rows = []
        for number, row in enumerate(csv.DictReader(lines), 2):
            if None in row or None in row.values():
                sys.exit(f"{file}:{number}: not as many fields as the header has")
            rows.append({key: value(text) for key, text in row.items()})
        return rows


def speed(folder, cloud, rows):
    """Error against time per point: a chart of applications and one of first plans."""
    rivals = folder / "peers.csv"
    rivals = [row for row in read(rivals) if row["who"] != "farfield"] if rivals.exists() else []
    name, n = rows[0]["cloud"], rows[0]["n"]
    rivals = [row for row in rivals if (row["cloud"], row["n"]) == (name, n)]
    for time, column, what in [
        ("apply", "apply", "from charges to values"),
        ("plan", "first_plan", "first plan, operators included"),
    ]:
        chart = Chart(
            unique(label(row) for row in rows),
            f"Error and time, {name}, N = {power(n)}: {what};\ntowards the lower left is better",
            "relative l2 error, measured",
            f"μs per point, {time}",
        )
        for axes, kernel in zip(chart.panels, unique(row["kernel"] for row in rows)):
            # Errors below 3e-15 are rounding, in which no way is better than another.
            lines, missed = {}, []
            for row in (row for row in rows if row["kernel"] == kernel and row["error"] is not None):
                point = (max(row["error"], 3e-15), 1e6 * row[column] / n)
                if point[1] > 0:
                    lines.setdefault((row["way"], row["precision"]), []).append(point)
                    missed += [point] * (row["outcome"] == "missed")
            if kernel == "1/r":
                for row in (row for row in rivals if row[time] > 0):
                    lines.setdefault((row["who"], None), []).append((row["error"], 1e6 * row[time] / n))
            for (way, precision), points in lines.items():
                dashes = {"f64": "-", "f32": "--", None: "-."}[precision]
                if way == "direct":
                    # A line across: direct sums judge all others, and have no error to compare.
                    axes.axhline(points[0][1], color=GREY, ls=dashes, lw=1, label=f"direct sum, {precision}")
                    continue
                way, colour = WAYS[way]
                size = 6 if way == "separable sum" else 3.5
                text = f"{way}, {precision}" if precision else way
                chart.line(axes, points, text, COLOURS[colour], dashes, size=size)
            chart.rings(axes, front([p for (way, _), line in lines.items() if way != "direct" for p in line]))
            chart.crosses(axes, missed)
        chart.save(folder / f"speed_{time}_{cloud}")


def front(points):
    """The points (x, y) of which no other has a smaller x without a larger y."""
    best, least = [], float("inf")
    for point in sorted(points):
        if point[1] < least:
            best.append(point)
            least = point[1]
    return best


def contract(folder, rows):
    """The error asked for against the error delivered."""
    for row in rows:
        way = ", harmonics" if row["way"] == "harmonic" else ""
        row["line"] = label(row) + way
    clouds = unique((row["cloud"], row["n"]) for row in rows)
    chart = Chart(
        [f"{cloud}, N = {power(n)}" for cloud, n in clouds],
        "What is asked for, and what is delivered: every point should lie below the line",
        "relative l2 error asked for",
        "relative l2 error delivered, all targets",
    )
    ends = [min(row["asked"] for row in rows), max(row["asked"] for row in rows)]
    # Errors below 1e-16 are those of the direct sum.
    place = lambda row: (row["asked"], max(row["delivered"], 1e-16))
    for axes, cloud in zip(chart.panels, clouds):
        own = [row for row in rows if (row["cloud"], row["n"]) == cloud and row["delivered"] is not None]
        chart.line(axes, [(x, x) for x in ends], "as asked", GREY, "-", 1.8, 0)
        chart.line(axes, [(x, x / 30) for x in ends], "30 times more accurate than asked", GREY, ":", 1.8, 0)
        for number, line in enumerate(unique(row["line"] for row in rows)):
            points = [place(row) for row in own if row["line"] == line]
            chart.line(axes, points, line, COLOURS[number % len(COLOURS)], "-", 0.7, 3)
        chart.crosses(axes, [place(row) for row in own if row["outcome"] == "missed"])
    chart.save(folder / "contract")


def terms(folder, rows):
    """Terms of a cell against the error of its far field, and the least that any method needs."""
    kernels = unique(row["kernel"] for row in rows)
    chart = Chart(
        kernels,
        "Terms per cell and the error of its far field over all 316 offsets",
        "terms per cell",
        "relative Frobenius error",
    )
    for axes, kernel in zip(chart.panels, kernels):
        points = lambda name: [
            (row["terms_per_cell"], row["error"])
            for row in rows
            if (row["kernel"], row["expansion"]) == (kernel, name)
        ]
        chart.line(axes, points("bound"), "least of any method (SVD)", GREY, "--", 1.8, 0)
        for number, (name, text) in enumerate(EXPANSIONS.items()):
            chart.line(axes, points(name), text, COLOURS[number], "-")
    chart.save(folder / "terms")


def visibility(folder, rows):
    """Rays per element, and seconds, against the number of elements."""
    ways = unique(row["visibility"] for row in rows)
    points = lambda way, column: [(row["elements"], row[column]) for row in rows if row["visibility"] == way]
    tolerance = power(rows[0]["tolerance"])
    chart = Chart([""], f"Rays per element in a room with two blocks, tolerance {tolerance}", "elements", "rays per element")
    for number, way in enumerate(ways):
        chart.line(chart.panels[0], points(way, "rays_per_element"), way, COLOURS[number], "-")
    first, *_ = start = points(ways[0], "rays_per_element")
    guide = [(n, first[1] * (n / first[0]) ** 0.5) for n, _ in start]
    chart.line(chart.panels[0], guide, "∝ √N", GREY, ":", size=0)
    chart.save(folder / "visibility_rays")

    chart = Chart([""], f"Seconds in a room with two blocks, three bands, tolerance {tolerance}", "elements", "seconds")
    for number, way in enumerate(ways):
        for column, what, dashes in [("plan_s", "plan", "-"), ("apply_s", "gather", "--")]:
            chart.line(chart.panels[0], points(way, column), f"{way}, {what}", COLOURS[number], dashes)
    chart.line(chart.panels[0], points(ways[0], "direct_s"), "direct, one gather", GREY, ":")
    chart.save(folder / "visibility_seconds")


def scaling(folder, rows):
    """Seconds against the number of points: a chart for each kernel, precision and number of threads."""
    rows = [row for row in rows if row["outcome"] == "passed"]
    key = lambda row: (row["kernel"], row["precision"], row["threads"])
    clouds, tolerances = unique(row["cloud"] for row in rows), sorted({row["tolerance"] for row in rows})
    for kernel, precision, threads in unique(map(key, rows)):
        own = [row for row in rows if key(row) == (kernel, precision, threads)]
        title = f"{KERNELS.get(kernel, kernel)}, {precision}, threads: {threads:.0f}"
        chart = Chart(["apply", "plan"], title, "points", "seconds")
        for axes, time in zip(chart.panels, ["apply", "plan"]):
            for cloud in clouds:
                for tolerance in tolerances:
                    points = [(r["n"], r[time]) for r in own if (r["cloud"], r["tolerance"]) == (cloud, tolerance)]
                    colour = COLOURS[tolerances.index(tolerance) % len(COLOURS)]
                    dashes = DASHES[clouds.index(cloud) % len(DASHES)]
                    chart.line(axes, sorted(points), f"{cloud}, {power(tolerance)}", colour, dashes)
        chart.save(folder / f"{kernel.replace('/', '-over-')}-{precision}-{threads:.0f}")


class Chart:
    """Panels with the same logarithmic axes, in rows of up to three, and one key for all."""

    def __init__(self, titles, title, x, y):
        import matplotlib

        matplotlib.use("svg")
        # Text stays text, and the same rows make the same file.
        matplotlib.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "farfield", "font.size": 9})
        from matplotlib import pyplot

        columns = min(len(titles), 3)
        rows = -(-len(titles) // columns)
        width, height = [(6.4, 4.6), (4.6, 4.2), (3.5, 3.1)][columns - 1]
        self.figure, grid = pyplot.subplots(
            rows, columns, sharex=True, sharey=True, squeeze=False, layout="constrained",
            figsize=(columns * width, rows * height + 1.2),
        )
        self.figure.suptitle(title, fontsize=10)
        self.panels = list(grid.flat)
        for axes in self.panels[len(titles):]:
            axes.remove()
        self.panels = self.panels[: len(titles)]
        for number, (axes, title) in enumerate(zip(self.panels, titles)):
            axes.set(xscale="log", yscale="log")
            axes.set_title(title, loc="left", fontsize=9)
            axes.grid(color="#dddddd", lw=0.6)
            axes.minorticks_off()
            axes.tick_params(labelbottom=True, labelleft=True)
            if number % columns == 0:
                axes.set_ylabel(y)
            if number + columns >= len(titles):
                axes.set_xlabel(x)

    def line(self, axes, points, label, colour, dashes, width=1.3, size=3.5):
        if points:
            x, y = zip(*points)
            axes.plot(x, y, color=colour, ls=dashes, lw=width, marker="o", ms=size, label=label)

    def rings(self, axes, points):
        """Marks what no other point beats in both."""
        self._marks(axes, points, "none better in both", marker="o", ms=8, mfc="none", mec="#111111", mew=0.9)

    def crosses(self, axes, points):
        """Marks errors above what was asked for."""
        self._marks(axes, points, "missed what was asked", marker="x", ms=8, mec="#d00000", mew=1.8)

    def _marks(self, axes, points, label, **style):
        # In the key even if there are none: it says what the chart would show.
        x, y = zip(*points) if points else ((), ())
        axes.plot(x, y, ls="none", label=label, **style)

    def entries(self):
        """The lines by their labels, each label once, marks last."""
        entries = {}
        for axes in self.panels:
            for line, label in zip(*axes.get_legend_handles_labels()):
                entries.setdefault(label, line)
        return dict(sorted(entries.items(), key=lambda entry: entry[1].get_linestyle() == "None"))

    def save(self, path):
        from matplotlib import pyplot

        entries = self.entries()
        self.figure.legend(
            entries.values(), entries.keys(), loc="outside lower center", ncols=max(2, min(len(self.panels), 3) + 1),
            frameon=False, fontsize=8, handlelength=3.5,
        )
        self.figure.savefig(f"{path}.svg", metadata={"Date": None})
        pyplot.close(self.figure)
        print(f"wrote {path}.svg")


def label(row):
    return KERNELS.get(row["kernel"], row["kernel"])


def unique(values):
    return list(dict.fromkeys(values))


def power(number):
    """A number as 1e5 or 1e-3."""
    mantissa, exponent = f"{number:e}".split("e")
    return f"{float(mantissa):g}e{int(exponent)}"


if __name__ == "__main__":
    if len(sys.argv) != 2 or not Path(sys.argv[1]).is_dir():
        sys.exit(__doc__)
    main(Path(sys.argv[1]))
