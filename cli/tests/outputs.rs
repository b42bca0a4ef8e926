//! What `farfield radiosity` writes for other programs: glTF, pages, reports.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

/// Runs the program on a scene for little time, its output in the folder `out` of this one.
fn run(folder: &Path, scene: &str) -> Output {
    Command::new(env!("CARGO_BIN_EXE_farfield"))
        .current_dir(folder)
        .args(["radiosity", "--elements", "200", "--no-picture", "--out", "out", "--scene", scene])
        .output()
        .expect("the program runs")
}

/// Runs the program on a description, which must go well.
fn run_on(name: &str, description: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    fs::write(folder.path().join(name), description).expect("written");
    let output = run(folder.path(), name);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    folder
}

/// The numbers of a column of the table of elements.
fn column(folder: &Path, name: &str) -> Vec<f64> {
    let table = fs::read_to_string(folder.join("out/elements.csv")).expect("written");
    let mut lines = table.lines();
    let place = lines.next().and_then(|names| names.split(',').position(|found| found == name));
    let place = place.expect(name);
    lines.map(|line| line.split(',').nth(place).expect(name).parse().expect("a number")).collect()
}

#[test]
fn the_gltf_of_a_solution_is_a_scene_again() {
    let first = run_on("a.toml", "generator = \"furnace\"\n");
    let glb = first.path().join("out/elements.glb");
    let again = format!(
        "closed = true\n[[mesh]]\nfile = {:?}\nmaterial = \"w\"\n[materials.w]\n\
         reflectance = [0.75]\nemission = [1.0]\n",
        glb.to_string_lossy()
    );
    let second = run_on("b.toml", &again);
    let [one, other] = [&first, &second].map(|folder| column(folder.path(), "area"));
    let [one, other] = [one, other].map(|areas| areas.iter().sum::<f64>());
    assert!((one / other - 1.0).abs() < 1e-6, "{one} {other}");
    // In a furnace all surfaces have the radiosity E / (1 - rho).
    let radiosities = column(second.path(), "B_0");
    assert!(radiosities.len() >= 150);
    assert!(radiosities.iter().all(|b| (b / 4.0 - 1.0).abs() < 1e-3), "{radiosities:?}");
    // By itself it is white, and emits nothing.
    for (scene, expected) in [
        (glb.to_string_lossy().as_ref(), "nothing in the scene emits light"),
        ("c.gltf", "neither surfaces nor points"),
    ] {
        let empty = "{\"asset\": {\"version\": \"2.0\"}}";
        fs::write(second.path().join("c.gltf"), empty).expect("written");
        let message = String::from_utf8_lossy(&run(second.path(), scene).stderr).into_owned();
        assert!(message.contains(expected), "{message}");
    }
}

#[test]
fn reports_are_pages_in_which_names_are_nothing_but_names() {
    let folder = run_on("a<b>&.toml", "generator = \"furnace\"\n");
    let out = folder.path().join("out");
    let page = fs::read_to_string(out.join("report.html")).expect("written");
    assert!(page.contains("<h1>a&lt;b&gt;&amp;.toml</h1>") && !page.contains("a<b>"), "{page}");
    for chart in ["<h2>Convergence</h2><svg", "<h2>Sums of form factors</h2><svg"] {
        assert!(page.contains(chart), "{chart}");
    }
    // The last residual of the curve is that of the solution, below a hundredth of the tolerance.
    let report = fs::read_to_string(out.join("report.json")).expect("written");
    let report: serde_json::Value = serde_json::from_str(&report).expect("JSON");
    let curve = report["residuals"][0].as_array().expect("a list");
    let last = curve.last().and_then(|step| step[1].as_f64()).expect("a residual");
    assert!(last <= 1e-4 && report["residual"].as_f64() == Some(last), "{report}");
}
