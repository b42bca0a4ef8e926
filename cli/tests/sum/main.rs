//! `farfield sum` as its users meet it: files in, files out, exit codes and messages.

mod formulas;
mod interrupted;
mod refusals;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use farfield::relative_l2_error;
use farfield_testing::clouds::Random;
use glam::{DVec3, Vec3Swizzles};
use ndarray::{Array1, Array2};
use ndarray_npy::{read_npy, write_npy};
use serde_json::Value;
use tempfile::TempDir;

const KERNELS: [(&str, f64); 4] = [
    ("inverse-distance", -1.0),
    ("inverse-square", -2.0),
    ("inverse-fourth", -4.0),
    ("squared-distance", 2.0),
];
const SCHEMES: [&str; 3] = ["fmm", "treecode", "direct"];

/// A folder with points and charges in it.
struct Folder {
    folder: TempDir,
    points: Vec<DVec3>,
    charges: Vec<f64>,
}

impl Folder {
    /// `points.npy` and `charges.npy` with `n` points in two clusters.
    fn new(n: usize) -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let mut random = Random::new(1);
        let points: Vec<_> = (0..n)
            .map(|i| if i % 4 == 0 { random.in_cube() * 0.1 + 2.0 } else { random.in_cube() })
            .collect();
        let charges: Vec<_> = (0..n).map(|_| random.between(-0.3, 0.7)).collect();
        write_points(&folder.path().join("points.npy"), &points);
        write_npy(folder.path().join("charges.npy"), &Array1::from(charges.clone())).unwrap();
        Self { folder, points, charges }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn write(&self, name: &str, content: impl AsRef<[u8]>) {
        fs::write(self.path(name), content).unwrap();
    }

    /// Runs `sum` in this folder with the given flags.
    fn sum(&self, flags: &str) -> Output {
        Command::new(BINARY)
            .arg("sum")
            .current_dir(self.folder.path())
            .args(flags.split_whitespace())
            .output()
            .expect("the program runs")
    }

    /// Runs `sum` on the folder's own points, insists on success, and returns the rows of `out`.
    fn rows(&self, out: &str, flags: &str) -> Vec<Vec<f64>> {
        succeed(&self.sum(&format!("{OWN} --out {out} {flags}")));
        rows(&self.path(out))
    }

    /// The names of all files.
    fn names(&self) -> Vec<String> {
        let entries = fs::read_dir(self.folder.path()).unwrap();
        let mut names: Vec<_> =
            entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }
}

const BINARY: &str = env!("CARGO_BIN_EXE_farfield");
const OWN: &str = "--points points.npy --charges charges.npy";

#[test]
fn every_kernel_and_scheme_meets_its_tolerance() {
    let folder = Folder::new(2000);
    for (kernel, power) in KERNELS {
        let exact = potentials(power, &folder, &folder.points);
        for scheme in SCHEMES {
            let flags = format!("--kernel {kernel} --scheme {scheme} --tolerance 1e-4");
            let values = folder.rows("values.npy", &flags).concat();
            let error = relative_l2_error(&values, &exact);
            assert!(error <= 1e-4, "{kernel} by {scheme}: error {error:e}");
        }
    }
}

#[test]
fn gradients_meet_the_tolerance_too() {
    let folder = Folder::new(2000);
    for (kernel, power) in KERNELS {
        let potentials = potentials(power, &folder, &folder.points);
        let gradients = gradients(power, &folder, &folder.points);
        for scheme in SCHEMES {
            let flags = format!("--kernel {kernel} --scheme {scheme} --gradient --tolerance 1e-4");
            let rows = folder.rows("values.npy", &flags);
            let values: Vec<_> = rows.iter().map(|row| row[0]).collect();
            let slopes: Vec<_> = rows.iter().map(|r| DVec3::new(r[1], r[2], r[3])).collect();
            let error = relative_l2_error(&values, &potentials);
            assert!(error <= 1e-4, "{kernel} by {scheme}: error {error:e} of the potential");
            let error = relative_l2_error(&slopes, &gradients);
            assert!(error <= 1e-4, "{kernel} by {scheme}: error {error:e} of the gradient");
        }
    }
}

#[test]
fn a_higher_order_is_more_accurate_and_a_low_one_is_no_failure() {
    let folder = Folder::new(3000);
    let exact = potentials(-1.0, &folder, &folder.points);
    let error = |order: usize| {
        let flags = format!("--kernel inverse-distance --order {order} --leaf-size 20");
        relative_l2_error(&folder.rows("values.npy", &flags).concat(), &exact)
    };
    let (low, high) = (error(1), error(8));
    assert!(low > 1e-4 && high < 1e-2 * low, "errors {low:e} and {high:e}");
}

#[test]
fn targets_may_be_other_points() {
    let folder = Folder::new(2000);
    let targets: Vec<_> = folder.points.iter().take(1500).map(|p| p.yzx() * 1.2 - 0.1).collect();
    write_points(&folder.path("targets.npy"), &targets);
    let exact = potentials(-1.0, &folder, &targets);
    let values = folder.rows("values.npy", "--targets targets.npy --kernel inverse-distance");
    assert_eq!(values.len(), targets.len());
    assert!(relative_l2_error(&values.concat(), &exact) <= 1e-6);
}

#[test]
fn single_precision_gives_single_precision_numbers() {
    let folder = Folder::new(3000);
    let exact = potentials(-1.0, &folder, &folder.points);
    let flags = "--kernel inverse-distance --precision f32 --tolerance 1e-4 --out values.npy";
    succeed(&folder.sum(&format!("{OWN} {flags}")));
    let values: Array1<f32> = read_npy(folder.path("values.npy")).unwrap();
    let values: Vec<_> = values.iter().map(|&v| f64::from(v)).collect();
    assert!(relative_l2_error(&values, &exact) <= 1e-4);
}

#[test]
fn all_file_formats_give_the_same_bits() {
    let mut folder = Folder::new(1000);
    let single: Vec<_> = folder.points.iter().map(|p| p.as_vec3()).collect();
    folder.points = single.iter().map(|p| p.as_dvec3()).collect();
    write_points(&folder.path("points.npy"), &folder.points);
    let array = Array2::from_shape_fn((single.len(), 3), |(i, k)| single[i][k]);
    write_npy(folder.path("f4.npy"), &array).unwrap();
    let transposed = Array2::from_shape_fn((3, single.len()), |(k, i)| single[i][k]);
    write_npy(folder.path("fortran.npy"), &transposed.reversed_axes()).unwrap();
    let lines: String =
        folder.points.iter().map(|p| format!("{}, {:e},{}\n\n", p.x, p.y, p.z)).collect();
    folder.write("plain.csv", &lines);
    folder.write("header.csv", format!("\u{feff}x, y, z\r\n{}", lines.replace('\n', "\r\n")));
    let charges: String = folder.charges.iter().map(|q| format!("{q}\n")).collect();
    folder.write("charges.csv", charges);

    // Leaves of a given size, since every process measures for itself which are best.
    let kernel = "--kernel inverse-square --gradient --leaf-size 40";
    let expected = folder.rows("values.npy", kernel);
    assert!(folder.rows("values.csv", kernel) == expected, "CSV written: bits differ");
    for (points, charges) in [
        ("f4.npy", "charges.npy"),
        ("fortran.npy", "charges.csv"),
        ("plain.csv", "charges.npy"),
        ("header.csv", "charges.csv"),
    ] {
        let flags = format!("--points {points} --charges {charges} {kernel} --out other.npy");
        succeed(&folder.sum(&flags));
        let bits_agree = rows(&folder.path("other.npy")) == expected;
        assert!(bits_agree, "{points}, {charges}: bits differ");
    }
}

#[test]
fn the_number_of_threads_changes_no_bit() {
    let folder = Folder::new(3000);
    for scheme in SCHEMES {
        let bytes = [1, 2, 4].map(|threads| {
            let flags = format!(
                "{OWN} --kernel inverse-distance --gradient --scheme {scheme} --leaf-size 20 \
                 --order 5 --threads {threads} --repeat 2 --out values.npy"
            );
            succeed(&folder.sum(&flags));
            fs::read(folder.path("values.npy")).unwrap()
        });
        assert!(bytes[0] == bytes[1] && bytes[0] == bytes[2], "{scheme}: bits differ");
    }
}

#[test]
fn the_report_tells_what_was_measured() {
    let folder = Folder::new(3000);
    let flags = "--kernel inverse-fourth --tolerance 1e-3 --gradient --threads 2 --repeat 3 \
                 --leaf-size 25 --report report.json";
    let values = folder.rows("values.npy", flags);
    let report = report(&folder.path("report.json"));
    assert_eq!(report["points"], 3000);
    assert_eq!(report["targets"], 3000);
    assert_eq!(report["kernel"], "inverse-fourth");
    assert_eq!(report["scheme"], "fmm");
    assert_eq!(report["precision"], "f64");
    assert_eq!(report["threads"], 2);
    assert_eq!(report["repeat"], 3);
    assert_eq!(report["tolerance"], 1e-3);
    assert_eq!(report["gradient"], true);
    assert_eq!(report["leaf_size"], 25);
    assert_eq!(report["sampled_targets"], 1000);
    for count in ["order", "terms_per_cell", "cells", "depth"] {
        assert!(report[count].as_u64().is_some_and(|n| n > 0), "{count}: {}", report[count]);
    }
    for time in ["plan_s", "apply_s"] {
        assert!(report[time].as_f64().is_some_and(|t| t > 0.0), "{time}: {}", report[time]);
    }
    if cfg!(target_os = "linux") {
        assert!(report["peak_memory_bytes"].as_u64().is_some_and(|b| b > 1_000_000));
    }

    // The error reported is that of every third target.
    let exact = potentials(-4.0, &folder, &folder.points);
    let third = |v: Vec<f64>| v.into_iter().step_by(3).collect::<Vec<_>>();
    let potentials = values.iter().map(|row| row[0]).collect();
    let error = relative_l2_error(&third(potentials), &third(exact));
    let reported = report["relative_l2_error"].as_f64().unwrap();
    assert!(error > 1e-13 && (reported / error - 1.0).abs() < 1e-3, "{reported:e}, {error:e}");
}

#[test]
fn without_a_report_a_summary_is_printed() {
    let folder = Folder::new(300);
    let output = folder.sum(&format!("{OWN} --kernel inverse-distance"));
    succeed(&output);
    let summary = String::from_utf8(output.stdout).unwrap();
    for word in ["inverse-distance", "300 points", "plan", "apply", "error"] {
        assert!(summary.contains(word), "{word:?} is not in:\n{summary}");
    }
}

#[test]
fn a_missed_tolerance_is_a_failure_with_a_report() {
    let folder = Folder::new(2000);
    let output = folder.sum(&format!(
        "{OWN} --kernel inverse-distance --precision f32 --tolerance 1e-12 \
         --out values.npy --report report.json"
    ));
    let message = fail(&output);
    assert!(message.contains("1e-12"), "{message}");
    let error = report(&folder.path("report.json"))["relative_l2_error"].as_f64().unwrap();
    assert!(error > 1e-12, "{error:e}");
    assert_eq!(folder.names(), ["charges.npy", "points.npy", "report.json"]);
}

#[test]
fn empty_sets_are_valid() {
    let folder = Folder::new(10);
    write_points(&folder.path("none.npy"), &[]);
    folder.write("none.csv", "q\n");
    for kernel in KERNELS.map(|(name, _)| name) {
        let values = folder.rows("values.npy", &format!("--kernel {kernel} --targets none.npy"));
        assert_eq!(values, Vec::<Vec<f64>>::new());
        let flags = format!(
            "--points none.npy --charges none.csv --targets points.npy --kernel {kernel} \
             --gradient --out values.csv"
        );
        succeed(&folder.sum(&flags));
        assert_eq!(rows(&folder.path("values.csv")), vec![vec![0.0; 4]; 10]);
    }
}

#[test]
fn help_explains_every_flag() {
    let output = Command::new(BINARY).args(["sum", "--help"]).output().unwrap();
    succeed(&output);
    let help = String::from_utf8(output.stdout).unwrap();
    for flag in [
        "points",
        "charges",
        "targets",
        "kernel",
        "gradient",
        "order",
        "tolerance",
        "precision",
        "scheme",
        "leaf-size",
        "threads",
        "repeat",
        "out",
        "report",
    ] {
        assert!(help.contains(&format!("--{flag}")), "--{flag} is not in:\n{help}");
    }
}

/// Insists on success without complaints.
fn succeed(output: &Output) {
    let complaints = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && complaints.is_empty(), "{complaints}");
}

/// Insists on failure with one line of explanation, and returns it.
fn fail(output: &Output) -> String {
    let message = String::from_utf8(output.stderr.clone()).unwrap();
    assert!(output.status.code().is_some_and(|code| code == 1 || code == 2), "{output:?}");
    assert_eq!(message.lines().count(), 1, "{message}");
    assert!(message.starts_with("error: "), "{message}");
    message
}

fn report(path: &Path) -> Value {
    serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap()
}

/// The rows of a file of values.
fn rows(path: &Path) -> Vec<Vec<f64>> {
    if path.extension().is_some_and(|e| e == "csv") {
        let text = fs::read_to_string(path).unwrap();
        let row = |line: &str| line.split(',').map(|cell| cell.parse().unwrap()).collect();
        text.lines().skip(1).map(row).collect()
    } else if let Ok(array) = read_npy::<_, Array1<f64>>(path) {
        array.iter().map(|&value| vec![value]).collect()
    } else {
        let array: Array2<f64> = read_npy(path).unwrap();
        assert_eq!(array.ncols(), 4);
        array.rows().into_iter().map(|row| row.to_vec()).collect()
    }
}

/// Σ_j |x − y_j|^power q_j without coincident pairs.
fn potentials(power: f64, sources: &Folder, targets: &[DVec3]) -> Vec<f64> {
    let pair = |x: DVec3, y: DVec3| if x == y { 0.0 } else { x.distance(y).powf(power) };
    let sum = |x: &DVec3| {
        sources.points.iter().zip(&sources.charges).map(|(y, q)| pair(*x, *y) * q).sum()
    };
    targets.iter().map(sum).collect()
}

/// Its gradient, Σ_j power |x − y_j|^(power−2) (x − y_j) q_j.
fn gradients(power: f64, sources: &Folder, targets: &[DVec3]) -> Vec<DVec3> {
    let pair = |d: DVec3| {
        if d == DVec3::ZERO { d } else { d * (power * d.length().powf(power - 2.0)) }
    };
    let sum = |x: &DVec3| {
        sources.points.iter().zip(&sources.charges).map(|(y, q)| pair(*x - *y) * *q).sum()
    };
    targets.iter().map(sum).collect()
}

fn write_points(path: &Path, points: &[DVec3]) {
    let array = Array2::from_shape_fn((points.len(), 3), |(i, k)| points[i][k]);
    write_npy(path, &array).unwrap();
}
