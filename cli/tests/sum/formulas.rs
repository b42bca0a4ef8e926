//! Kernels by name and by formula.

use std::process::Command;

use farfield::glam::DVec3;
use farfield::relative_l2_error;

use super::{BINARY, Folder, OWN, fail, rows, succeed};

/// Σ_j f(x − y_j) q_j without coincident pairs.
fn sums(folder: &Folder, f: impl Fn(DVec3) -> f64) -> Vec<f64> {
    let pair = |x: DVec3, y: DVec3| if x == y { 0.0 } else { f(x - y) };
    let terms = |x: &DVec3| -> f64 {
        folder.points.iter().zip(&folder.charges).map(|(y, q)| pair(*x, *y) * q).sum()
    };
    folder.points.iter().map(terms).collect()
}

#[test]
fn formulas_and_names_are_summed() {
    let folder = Folder::new(3000);
    let yukawa = sums(&folder, |d| (-2.0 * d.length()).exp() / d.length());
    for kernel in ["exp(-k*r)/r", "yukawa"] {
        let flags = format!("--kernel {kernel} --param k=2 --tolerance 1e-5");
        let found = folder.rows("values.npy", &flags);
        let found: Vec<f64> = found.iter().map(|row| row[0]).collect();
        let error = relative_l2_error(&found, &yukawa);
        assert!(error < 1e-5, "{kernel}: {error:e}");
    }
    // The diagonal counts if it shall.
    let gaussian = sums(&folder, |d| (-d.length_squared()).exp());
    let with = folder.rows("values.npy", "--kernel exp(-r2) --coincident formula");
    let without = folder.rows("values.npy", "--kernel exp(-r2)");
    for (i, gaussian) in gaussian.iter().enumerate() {
        assert!((without[i][0] - gaussian).abs() < 1e-3);
        assert!((with[i][0] - without[i][0] - folder.charges[i]).abs() < 1e-3);
    }
}

#[test]
fn tensors_take_as_many_columns_as_they_have() {
    let folder = Folder::new(300);
    let charges: String = folder.charges.iter().map(|q| format!("{q:e},1,{:e}\n", -q)).collect();
    folder.write("vectors.csv", charges);
    let flags = "--points points.npy --charges vectors.csv --kernel biot_savart --gradient --out values.csv";
    succeed(&folder.sum(flags));
    let header = std::fs::read_to_string(folder.path("values.csv")).unwrap();
    assert!(header.starts_with("u1,u2,u3,u1_x,u2_x,u3_x,u1_y,"), "{}", &header[..60]);
    let found = rows(&folder.path("values.csv"));
    for (x, found) in folder.points.iter().zip(found) {
        let terms = folder.points.iter().zip(&folder.charges).filter(|(y, _)| *y != x);
        let term = |(y, q): (&DVec3, &f64)| {
            let d = *x - *y;
            DVec3::new(*q, 1.0, -q).cross(d) / (4.0 * std::f64::consts::PI * d.length().powi(3))
        };
        let exact: DVec3 = terms.map(term).sum();
        let error = (DVec3::from_slice(&found[..3]) - exact).length();
        assert!(found.len() == 12 && error < 1e-6 * (1.0 + exact.length()), "{error:e}");
    }
    let flags = format!("{OWN} --kernel stokeslet --out values.npy");
    assert!(fail(&folder.sum(&flags)).contains("shape [300]: expected"), "{flags}");
}

#[test]
fn what_is_wrong_with_a_formula_is_pointed_at() {
    let folder = Folder::new(4);
    let output = folder.sum(&format!("{OWN} --kernel exp(-k*r)/q --param k=2"));
    let message = String::from_utf8(output.stderr).unwrap();
    let lines: Vec<_> = message.lines().collect();
    assert!(!output.status.success() && lines.len() == 3, "{message}");
    assert!(lines[0].starts_with("error: --kernel: the name \"q\" is unknown"), "{message}");
    assert_eq!(lines[1].find('q'), lines[2].find('^'), "{message}");
    for (flags, words) in [
        ("--kernel stokslet", "stokeslet perhaps"),
        ("--kernel 1/r --order 4", "--order with --kernel 1/r"),
        ("--kernel inverse-distance --param k=2", "--param with --kernel inverse-distance"),
        ("--kernel 1/r --param k", "such as k=2"),
        ("--kernel 1/r --coincident nan", "expected skip, formula or a finite number"),
    ] {
        let message = fail(&folder.sum(&format!("{OWN} {flags}")));
        assert!(message.contains(words), "{message}");
    }
}

#[test]
fn all_ready_kernels_are_listed() {
    let output = Command::new(BINARY).arg("kernels").output().unwrap();
    succeed(&output);
    let list = String::from_utf8(output.stdout).unwrap();
    for ready in farfield_formula::READY {
        assert!(list.lines().any(|line| line == ready.name), "{} is not in:\n{list}", ready.name);
    }
}

#[test]
fn second_derivatives_follow_the_gradients() {
    let folder = Folder::new(400);
    let flags = format!(
        "{OWN} --kernel laplace --hessian --tolerance 1e-7 --out values.csv --report report.json"
    );
    succeed(&folder.sum(&flags));
    let header = std::fs::read_to_string(folder.path("values.csv")).unwrap();
    let columns = "potential,gradient_x,gradient_y,gradient_z,hessian_xx,hessian_xy,hessian_xz,hessian_yy,\
                   hessian_yz,hessian_zz\n";
    assert!(header.starts_with(columns), "{}", &header[..200]);
    let found = rows(&folder.path("values.csv"));
    let exact = sums(&folder, |d| {
        let r = d.length();
        3.0 * d.x * d.y / r.powi(5)
    });
    let mixed: Vec<f64> = found.iter().map(|row| row[5]).collect();
    assert!(relative_l2_error(&mixed, &exact) < 1e-6);
    let report = std::fs::read_to_string(folder.path("report.json")).unwrap();
    assert!(report.contains("\"hessian_relative_l2_error\""), "{report}");
    let refused = format!("{OWN} --kernel inverse-distance --hessian");
    assert!(fail(&folder.sum(&refused)).contains("--hessian with --kernel inverse-distance"));
}

#[test]
fn operators_of_one_run_serve_the_next() {
    let folder = Folder::new(4000);
    let flags = "--kernel exp(-k*r)/r --param k=2 --tolerance 1e-3 --repeat 30 --operators found";
    let few = "--kernel yukawa --tolerance 1e-3 --operators found/none --targets targets.csv";
    folder.write("targets.csv", "0,0,0\n");
    succeed(&folder.sum(&format!("{OWN} {few}")));
    let files = |name: &str| {
        let entries =
            std::fs::read_dir(folder.path(name)).unwrap().map(|entry| entry.unwrap().path());
        entries.filter(|path| path.is_file()).collect::<Vec<_>>()
    };
    assert!(files("found/none").is_empty(), "one target needs no operators");
    let first = folder.rows("first.npy", flags);
    let saved = files("found");
    assert_eq!(saved.len(), 1, "{saved:?}");
    assert_eq!(folder.rows("second.npy", flags), first);
    assert_eq!(files("found"), saved, "nothing new was found");
    let mut bytes = std::fs::read(&saved[0]).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    std::fs::write(&saved[0], bytes).unwrap();
    let message = fail(&folder.sum(&format!("{OWN} {flags}")));
    assert!(message.contains("--operators: ") && message.contains("is damaged"), "{message}");
    let message = fail(&folder.sum(&format!("{OWN} --kernel 1/r --operators points.npy")));
    assert!(message.contains("--operators: points.npy"), "{message}");
}
