//! Daylight by `farfield daylight` and `farfield radiosity`: closed forms of a yard beside a wall, and refusals.

use std::fs;
use std::process::{Command, Output};

const BINARY: &str = env!("CARGO_BIN_EXE_farfield");

/// A yard of 2 by 2, and a wall of height 2 along its south, which faces it.
const YARD: &str = "mtllib yard.mtl\n\
    v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nv -1 -1 2\nv 1 -1 2\n\
    usemtl yard\nf 1 2 3 4\nusemtl wall\nf 2 1 5 6\n";
const MATERIALS: &str = "newmtl yard\nKd 0.2 0.2 0.2\nnewmtl wall\nKd 0.5 0.5 0.5\n";

/// Runs the program beside a file of the sun's positions, and returns the table that it writes.
fn run(suns: &str, arguments: &[&'static str]) -> (Output, String) {
    let folder = tempfile::tempdir().expect("a folder");
    for (name, text) in [("yard.obj", YARD), ("yard.mtl", MATERIALS), ("suns.csv", suns)] {
        fs::write(folder.path().join(name), text).expect("written");
    }
    let output = Command::new(BINARY)
        .current_dir(folder.path())
        .args(["daylight", "--scene", "yard.obj", "--out", "found.csv", "--quiet"])
        .args(upwards(arguments))
        .args(arguments)
        .output()
        .expect("the program runs");
    (output, fs::read_to_string(folder.path().join("found.csv")).unwrap_or_default())
}

/// The means over the elements of a material, by area: `sky`, `ground` and the columns behind them.
fn means(table: &str, material: &str) -> Vec<f64> {
    let (mut sums, mut area) = (Vec::new(), 0.0);
    for line in table.lines().skip(1) {
        let cells: Vec<&str> = line.split(',').collect();
        if cells[7] == material {
            let numbers = cells[6..].iter().filter_map(|cell| cell.parse::<f64>().ok());
            let numbers: Vec<f64> = numbers.collect();
            sums.resize(numbers.len() - 1, 0.0);
            sums.iter_mut().zip(&numbers[1..]).for_each(|(sum, x)| *sum += numbers[0] * x);
            area += numbers[0];
        }
    }
    sums.into_iter().map(|sum| sum / area).collect()
}

fn close(found: f64, expected: f64, what: &str) {
    assert!((found - expected).abs() < 5e-3, "{what}: {found}, expected {expected}");
}

/// The yard is flat on x and y, unless it is said otherwise.
fn upwards(arguments: &[&'static str]) -> &'static [&'static str] {
    if arguments.contains(&"--zenith") { &[] } else { &["--zenith", "0,0,1"] }
}

const SUNS: &str = "# of a day\ntime,azimuth,elevation\nlow,180,30\n\nhigh, 180, 80\nnorth,0,30\n\
    west,-90,30\nnight,180,-5\n";

#[test]
fn a_yard_beside_a_wall_receives_what_closed_forms_say() {
    let (output, table) = run(SUNS, &["--elements", "2000", "--sun", "suns.csv"]);
    assert!(output.status.success(), "{output:?}");
    let header = "x,y,z,nx,ny,nz,area,material,sky,ground,sun_low,sun_high,sun_north,sun_west,\
        sun_night\n";
    assert!(table.starts_with(header), "{table:.200}");
    // Squares that meet at a right angle: 0.200044 of what leaves one arrives at the other.
    const BETWEEN: f64 = 0.200_043_776;
    let yard = means(&table, "yard");
    close(yard[0], 1.0 - BETWEEN, "sky above the yard");
    close(yard[1], 0.0, "ground below the yard");
    let (sin, cos) = 30f64.to_radians().sin_cos();
    close(yard[2], 0.0, "in the shadow of the wall");
    let (high, along) = 80f64.to_radians().sin_cos();
    close(yard[3], (1.0 - along / high) * high, "beyond a short shadow");
    close(yard[4], sin, "sun before the wall");
    close(yard[5], sin, "sun along the wall");
    assert_eq!(yard[6], 0.0);
    let wall = means(&table, "wall");
    close(wall[0], 0.5, "sky before the wall");
    close(wall[1], 0.5 - BETWEEN, "ground before the wall, beside the yard");
    assert_eq!(wall[2..4], [0.0; 2], "sun behind the wall");
    close(wall[4], cos, "sun before the wall");

    let (output, table) = run(SUNS, &["--elements", "500", "--sky-model", "overcast"]);
    assert!(output.status.success(), "{output:?}");
    // Half the sky's cosine, and 2 sin γ of it: 3/(7π) (π/2 + 4/3).
    close(means(&table, "wall")[0], 0.396_176, "overcast sky before a wall");
}

#[test]
fn other_axes_and_other_numbers_of_threads_change_nothing() {
    let all = |arguments: &[&'static str]| {
        let (output, table) = run(SUNS, arguments);
        assert!(output.status.success(), "{output:?}");
        table
    };
    let plain = ["--elements", "100", "--sun", "suns.csv", "--rays", "64"];
    let found = all(&plain);
    assert_eq!(all(&[&plain[..], &["--threads", "1"]].concat()), found);
    let same = [&plain[..], &["--zenith", "0,0,7", "--north", "0,2,1"]].concat();
    assert_eq!(all(&same), found);
    let turned = [&plain[..], &["--north", "0,-1,0"]].concat();
    assert!(means(&all(&turned), "yard")[2] > 0.4, "the wall is in the north now");
}

#[test]
fn what_is_wrong_is_named() {
    let refused = |suns: &str, arguments: &[&'static str], expected: &str| {
        let (output, table) = run(suns, arguments);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success() && table.is_empty(), "{message}");
        assert!(message.contains(expected), "{message}");
    };
    let with = ["--sun", "suns.csv"];
    refused("", &with, "suns.csv, line 1: expected a header time,azimuth,elevation");
    refused("azimuth,elevation\n", &with, "line 1: expected a header");
    let headed = |line: &str| format!("time,azimuth,elevation\n{line}\n");
    refused(&headed("9,1"), &with, "line 2: expected a time, an azimuth and an elevation");
    refused(&headed("9,1,91"), &with, "expected an elevation from -90 to 90 degrees, found `91`");
    refused(&headed("9,x,1"), &with, "expected an azimuth");
    refused(&headed("9,NaN,1"), &with, "expected an azimuth");
    refused(&headed("9,1,1\n9,2,2"), &with, "line 3: expected a time without quotes");
    refused(SUNS, &["--sun", "none.csv"], "none.csv: ");
    refused(SUNS, &["--north", "0,0,-1"], "--north [0.0, 0.0, -1.0]: expected a direction");
    refused(SUNS, &["--zenith", "0,0"], "expected three finite numbers");
    refused(SUNS, &["--rays", "0"], "--rays");
}

/// Solves the yard with these materials, and returns what is printed, the report, and the mean irradiances of yard and
/// wall.
fn solve(materials: &str, arguments: &[&'static str]) -> (Output, String, [f64; 2]) {
    let folder = tempfile::tempdir().expect("a folder");
    for (name, text) in [("yard.obj", YARD), ("yard.mtl", materials)] {
        fs::write(folder.path().join(name), text).expect("written");
    }
    let is_outdoors = arguments.contains(&"--sky") || arguments.contains(&"--sun");
    let fixed = ["--scene", "yard.obj", "--elements", "800", "--no-picture", "--bands", "1"];
    let output = Command::new(BINARY)
        .current_dir(folder.path())
        .args(["radiosity", "--out", "found", "--quiet"])
        .args(fixed)
        .args(if is_outdoors { upwards(arguments) } else { &[] })
        .args(arguments)
        .output()
        .expect("the program runs");
    let read = |name: &str| fs::read_to_string(folder.path().join("found").join(name));
    let table = read("elements.csv").unwrap_or_default();
    (output, read("report.json").unwrap_or_default(), means_of(&table))
}

/// The mean irradiances of yard and wall in a table of elements.
fn means_of(table: &str) -> [f64; 2] {
    let (mut sums, mut areas) = ([0.0; 2], [0.0; 2]);
    for line in table.lines().skip(1) {
        let cells: Vec<f64> = line.split(',').map(|cell| cell.parse().expect("a number")).collect();
        // The wall faces along the second axis.
        let k = usize::from(cells[4] > 0.5);
        sums[k] += cells[6] * cells[11];
        areas[k] += cells[6];
    }
    [sums[0] / areas[0], sums[1] / areas[1]]
}

#[test]
fn light_from_outside_is_reflected_as_that_of_lamps() {
    let solved = |materials: &str, arguments: &[&'static str]| {
        let (output, report, means) = solve(materials, arguments);
        assert!(output.status.success(), "{output:?}");
        (report, means)
    };
    let black = "newmtl yard\nKd 0 0 0\nnewmtl wall\nKd 0 0 0\n";
    let (sin, cos) = 30f64.to_radians().sin_cos();
    let (report, [yard, wall]) = solved(black, &["--sky", "100", "--sun", "0,30,1000"]);
    close(yard / 100.0, 0.8 + 10.0 * sin, "sky and sun on a black yard");
    close(wall / 100.0, 0.5 + 10.0 * cos, "sky and sun on a black wall");
    let key = report.split("\"daylight\": ").nth(1).and_then(|rest| rest.split(',').next());
    let power: f64 = key.expect("a key").parse().expect("a number");
    close(power / (4.0 * (yard + wall)), 1.0, "the power that arrives");
    assert!(report.contains("\"elevation\": 30.0") && report.contains("\"zenith\""), "{report}");
    let (_, [yard, wall]) = solved(black, &["--sky", "100", "--ground", "0.5"]);
    close(yard / 100.0, 0.8, "no ground above the yard");
    close(wall / 100.0, 0.5 + 0.5 * 0.3, "the sky and what the ground reflects of it");

    let reflecting = "newmtl yard\nKd 0.5 0.5 0.5\nnewmtl wall\nKd 0 0 0\n";
    let shining = "newmtl yard\nKd 0.5 0.5 0.5\nKe 250 250 250\nnewmtl wall\nKd 0 0 0\n";
    let (_, lit) = solved(reflecting, &["--sun", "0,30,1000"]);
    let (report, lamp) = solved(shining, &[]);
    assert!(report.contains("\"daylight\": null"), "{report}");
    assert!(lamp[1] > 49.0, "{lamp:?}");
    close((lit[1] - 1000.0 * cos) / lamp[1], 1.0, "what the yard passes on to the wall");
    close(lit[0] / 500.0, 1.0, "the wall is black");
    let (report, night) = solved(shining, &["--sun", "0,-5,1000"]);
    assert!(night == lamp && report.contains("\"kind\": \"no-daylight\""), "{report}");
    let (_, both) = solved(shining, &["--sun", "0,30,1000"]);
    close((both[1] - 1000.0 * cos) / lamp[1], 2.0, "of a lamp and of the sun");
}

#[test]
fn light_from_outside_that_does_not_arrive_or_is_none_is_refused() {
    let refused = |arguments: &[&'static str], expected: &str| {
        let (output, report, _) = solve(MATERIALS, arguments);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success() && report.is_empty(), "{message}");
        assert!(message.contains(expected), "{message}");
    };
    refused(&["--sun", "0,-5,1000"], "nothing from outside reaches the scene");
    refused(&["--sky", "0"], "nothing from outside reaches the scene");
    refused(&["--sky", "1", "--visibility", "none"], "expected --visibility exact or fractional");
    refused(&["--sky", "1", "--north", "0,0,1"], "--north [0.0, 0.0, 1.0]: expected a direction");
    refused(&["--ambient", "300"], "says nothing about light: expected --quantity heat");
    refused(&["--quantity", "heat", "--ambient", "0"], "nothing from outside reaches the scene");
    refused(&["--quantity", "heat", "--ambient", "3", "--ground", "1"], "without --sky or --sun");
    refused(&[], "nothing in the scene emits light");
    let (output, report, _) = solve("newmtl yard\nKe 1 1 1\nnewmtl wall\n", &["--ground", "0.2"]);
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!output.status.success() && report.is_empty(), "{message}");
    assert!(message.contains("--ground, --sky-model, --zenith and --north"), "{message}");
}

/// The yard and the wall at temperatures of their own, and how much they reflect.
fn warm_yard(reflectance: f64, [yard, wall]: [f64; 2]) -> String {
    format!(
        "mesh = []\n[[quad]]\nmaterial = \"yard\"\ncorners = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]\n\
         [[quad]]\nmaterial = \"wall\"\ncorners = [[1, -1, 0], [-1, -1, 0], [-1, -1, 2], [1, -1, 2]]\n\
         [materials.yard]\nreflectance = [{reflectance}]\ntemperature = {yard}\n\
         [materials.wall]\nreflectance = [{reflectance}]\ntemperature = {wall}\n"
    )
}

#[test]
fn surroundings_as_warm_as_the_scene_take_nothing_from_it() {
    let black = |kelvin: f64| 5.670_374_419e-8 * kelvin.powi(4);
    let solved = |scene: String, ambient: &str| {
        let folder = tempfile::tempdir().expect("a folder");
        fs::write(folder.path().join("yard.toml"), scene).expect("written");
        let output = Command::new(BINARY)
            .current_dir(folder.path())
            .args(["radiosity", "--scene", "yard.toml", "--quantity", "heat", "--quiet"])
            .args(["--elements", "800", "--no-picture", "--out", "found", "--ambient", ambient])
            .output()
            .expect("the program runs");
        assert!(output.status.success(), "{output:?}");
        means_of(&fs::read_to_string(folder.path().join("found/elements.csv")).expect("a table"))
    };
    let [yard, wall] = solved(warm_yard(0.5, [300.0; 2]), "300");
    close(yard / black(300.0), 1.0, "an even glow on the yard");
    close(wall / black(300.0), 1.0, "and on the wall");
    // The cold wall sees .2 of the hot yard, and of the surroundings the rest.
    let [_, wall] = solved(warm_yard(0.0, [400.0, 0.0]), "300");
    close(wall / black(300.0), 0.8 + 0.2 * (4.0f64 / 3.0).powi(4), "a cold wall");
}
