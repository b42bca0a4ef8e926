//! `farfield-mpi sum` on ranks that are threads: the same files as one rank writes, or none.

use std::path::{Path, PathBuf};

use farfield_mpi::on_threads;
use farfield_mpi::program::{Failure, run};
use farfield_testing::clouds::Random;
use ndarray_npy::npy::header::{Header, Layout};
use ndarray_npy::{ReadableElement, WritableElement};

/// Writes an array of so many rows and columns.
fn save(path: &Path, shape: &[usize], layout: Layout, numbers: &[f64]) {
    let header = Header { type_descriptor: f64::type_descriptor(), layout, shape: shape.to_vec() };
    let mut bytes = header.to_bytes().expect("a header");
    bytes.extend(numbers.iter().flat_map(|number| number.to_le_bytes()));
    std::fs::write(path, bytes).expect("written");
}

fn load(path: &Path) -> (Vec<usize>, Vec<f64>) {
    let mut file = std::fs::File::open(path).expect("a file");
    let header = Header::from_reader(&mut file).expect("an array");
    let len = header.shape.iter().product();
    let numbers = f64::read_to_end_exact_vec(file, &header.type_descriptor, len).expect("numbers");
    (header.shape, numbers)
}

/// A folder with points, and charges of one number and of three.
struct Files {
    folder: tempfile::TempDir,
}

impl Files {
    fn new(points: usize) -> Self {
        let files = Self { folder: tempfile::tempdir().expect("a folder") };
        let mut rng = Random::new(7);
        let mut numbers =
            |count: usize| (0..count).map(|_| rng.between(-1.0, 1.0)).collect::<Vec<f64>>();
        save(&files.path("p.npy"), &[points, 3], Layout::Standard, &numbers(3 * points));
        save(&files.path("q.npy"), &[points], Layout::Standard, &numbers(points));
        save(&files.path("f.npy"), &[points, 3], Layout::Fortran, &numbers(3 * points));
        files
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn names(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.folder.path()).expect("a folder");
        let name = |entry: std::io::Result<std::fs::DirEntry>| {
            entry.expect("an entry").file_name().to_string_lossy().into_owned()
        };
        let mut names: Vec<String> = entries.map(name).collect();
        names.sort();
        names
    }

    /// What so many ranks say to a command line.
    fn say(&self, size: usize, line: &str) -> Result<String, Failure> {
        let file = |word: &str| {
            let is_file =
                word.ends_with(".npy") || word.ends_with(".json") || word.ends_with(".csv");
            if is_file { self.path(word).to_string_lossy().into_owned() } else { word.to_owned() }
        };
        let words: Vec<String> = line.split_whitespace().map(file).collect();
        let words = || ["farfield-mpi", "sum"].into_iter().map(str::to_owned).chain(words.clone());
        let all = on_threads(size, |ranks| run(ranks, words()));
        assert!(all.iter().all(|said| said.is_err() == all[0].is_err()));
        all.into_iter().next().expect("a rank")
    }
}

const CHARGES: &str = "--points p.npy --charges q.npy --out u.npy";

#[test]
fn files_have_the_same_bits_for_any_number_of_ranks() {
    let files = Files::new(5000);
    for (line, width) in [
        (format!("{CHARGES} --kernel exp(-k*r)/r --param k=2 --tolerance 1e-5"), 1),
        (format!("{CHARGES} --kernel gaussian --gradient --tolerance 1e-4"), 4),
        (
            "--points p.npy --charges f.npy --out u.npy --kernel stokeslet --tolerance 1e-4".into(),
            3,
        ),
    ] {
        let results = [1, 3, 4].map(|size| {
            let said = files.say(size, &line).expect(&line);
            let report: serde_json::Value = serde_json::from_str(&said).expect("JSON");
            assert_eq!(
                (report["ranks"].as_u64(), report["points"].as_u64()),
                (Some(size as u64), Some(5000))
            );
            assert!(report["relative_l2_error"].as_f64() <= report["tolerance"].as_f64(), "{said}");
            assert_eq!(report["gradient_relative_l2_error"].is_null(), width != 4);
            assert_eq!(report["words_sent"] == 0, size == 1);
            let (shape, values) = load(&files.path("u.npy"));
            assert_eq!(shape, if width == 1 { vec![5000] } else { vec![5000, width] });
            values.into_iter().map(f64::to_bits).collect::<Vec<_>>()
        });
        assert!(results[0] == results[1] && results[0] == results[2], "{line}");
        assert_eq!(files.names(), ["f.npy", "p.npy", "q.npy", "u.npy"]);
    }
}

#[test]
fn values_are_those_of_direct_sums() {
    let files = Files::new(200);
    let line = "--points p.npy --charges f.npy --targets p.npy --kernel [[r,d1,0],[1,r2,d3]] --out u.npy --report r.json";
    assert_eq!(files.say(3, line), Ok(String::new()));
    let (_, p) = load(&files.path("p.npy"));
    let (_, f) = load(&files.path("f.npy"));
    let (shape, u) = load(&files.path("u.npy"));
    assert_eq!(shape, [200, 2]);
    for i in [0, 77, 199] {
        let mut expected = [0.0; 2];
        for j in (0..200).filter(|&j| j != i) {
            let d = [0, 1, 2].map(|k| p[3 * i + k] - p[3 * j + k]);
            let r2: f64 = d.iter().map(|d| d * d).sum();
            // Column by column.
            let [f0, f1, f2] = [f[j], f[200 + j], f[400 + j]];
            expected[0] += r2.sqrt() * f0 + d[0] * f1;
            expected[1] += f0 + r2 * f1 + d[2] * f2;
        }
        for (k, expected) in expected.into_iter().enumerate() {
            assert!((u[2 * i + k] / expected - 1.0).abs() < 1e-10, "{i} {k}");
        }
    }
    let report = std::fs::read_to_string(files.path("r.json")).expect("a report");
    assert!(report.contains("\"sampled_targets\": 200"), "{report}");
}

#[test]
fn what_is_wrong_is_said_by_all_ranks_and_leaves_no_file() {
    let files = Files::new(40);
    let mut bad = vec![1.0; 40];
    bad[33] = f64::NAN;
    save(&files.path("nan.npy"), &[40], Layout::Standard, &bad);
    save(&files.path("short.npy"), &[39], Layout::Standard, &bad[..39]);
    save(&files.path("lying.npy"), &[1 << 60], Layout::Standard, &bad);
    std::fs::write(files.path("text.npy"), "no array").expect("written");
    let before = files.names();
    for (line, expected, code) in [
        (CHARGES.to_owned(), "--kernel <NAME|TEXT>", 2),
        (format!("{CHARGES} --kernel 1/r --tolerance 2"), "expected a number between 0 and 1", 2),
        (format!("{CHARGES} --kernel 1/q"), "q", 1),
        (
            format!("{CHARGES} --kernel stokeslet"),
            "q.npy: an array of shape [40]: expected [N, 3]",
            1,
        ),
        (
            "--points p.npy --charges nan.npy --kernel 1/r".into(),
            "nan.npy: row 33, column 0 is NaN",
            1,
        ),
        ("--points p.npy --charges short.npy --kernel 1/r".into(), "short.npy holds 39 charges", 1),
        (
            "--points p.npy --charges lying.npy --kernel 1/r".into(),
            "lying.npy: 320 bytes of data",
            1,
        ),
        ("--points p.npy --charges text.npy --kernel 1/r".into(), "text.npy: not an npy file", 1),
        ("--points q.npy --charges q.npy --kernel 1/r".into(), "q.npy: an array of shape [40]", 1),
        ("--points none.npy --charges q.npy --kernel 1/r".into(), "none.npy: No such file", 1),
        (
            "--points p.npy --charges q.npy --kernel 1/r --out u.csv".into(),
            "u.csv: expected a file",
            1,
        ),
        ("--points p.npy --charges q.npy --kernel 1/r --out no/u.npy".into(), "No such file", 1),
        (format!("{CHARGES} --kernel sqrt(r-3)"), "", 1),
    ] {
        let failure = files.say(3, &line).expect_err(&line);
        assert!(failure.message.contains(expected) && failure.code == code, "{line}: {failure:?}");
        assert_eq!(files.names(), before, "{line}");
    }
    let help = files.say(2, "--help").expect_err("help");
    assert!(help.code == 0 && help.message.contains("--points"));
}

#[test]
fn ranks_may_have_nothing() {
    for points in [0, 1, 2] {
        let files = Files::new(points);
        files.say(4, &format!("{CHARGES} --kernel 1/r")).expect("summed");
        assert_eq!(load(&files.path("u.npy")).0, [points]);
    }
}
