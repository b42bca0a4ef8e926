//! `farfield factors` on files of View3D: closed forms, what lies on bases, tables, refusals.

use std::fs;
use std::process::{Command, Output};

const BINARY: &str = env!("CARGO_BIN_EXE_farfield");

/// Runs the program on a file of View3D, with the output of this name, and returns what it writes.
fn run(text: &str, out: &str, arguments: &[&str]) -> (Output, String) {
    let folder = tempfile::tempdir().expect("a folder");
    fs::write(folder.path().join("room.vs3"), text).expect("written");
    let output = Command::new(BINARY)
        .current_dir(folder.path())
        .args(["factors", "--scene", "room.vs3", "--out", out])
        .args(arguments)
        .output()
        .expect("the program runs");
    let written = fs::read_to_string(folder.path().join(out)).unwrap_or_default();
    (output, written)
}

/// The table of View3D in numbers, line by line, without the header.
fn table(text: &str) -> Vec<Vec<f64>> {
    let (output, written) = run(text, "room.txt", &[]);
    assert!(output.status.success(), "{output:?}");
    let lines = written.lines().skip(1);
    lines
        .map(|line| line.split(' ').map(|word| word.parse().expect("a number")).collect())
        .collect()
}

fn close(found: f64, expected: f64, what: &str) {
    assert!((found - expected).abs() < 1e-4, "{what}: {found}, expected {expected}");
}

const CUBE: &str = "T cube\nC encl=1\nF 3\n\
    V 1 0 0 0\nV 2 1 0 0\nV 3 1 1 0\nV 4 0 1 0\nV 5 0 0 1\nV 6 1 0 1\nV 7 1 1 1\nV 8 0 1 1\n\
    S 1  1 2 3 4  0 0 0.5 low\nS 2  1 4 8 5  0 0 0.5 west\nS 3  1 5 6 2  0 0 0.5 south\n\
    S 4  7 6 5 8  0 0 0.5 high\nS 5  7 3 2 6  0 0 0.5 east\nS 6  7 8 4 3  0 0 0.5 north\nEnd\n";
/// Factors of the cube: of two opposite faces, and of two that meet.
const OPPOSITE: f64 = 0.199_824_896;
const BESIDE: f64 = 0.200_043_776;

#[test]
fn a_cube_has_its_closed_forms_in_the_table_of_view3d() {
    let (output, written) = run(CUBE, "room.txt", &[]);
    assert!(output.status.success(), "{output:?}");
    assert!(
        written.starts_with("View3D 3.3 0 1 0 6\n1 1 1 1 1 1\n0.000000 0.200044 "),
        "{written}"
    );
    let lines = table(CUBE);
    assert_eq!(lines.len(), 8);
    for (i, line) in lines[1..7].iter().enumerate() {
        for (j, found) in line.iter().enumerate() {
            let opposite = i % 3 == j % 3;
            let expected = match (i == j, opposite) {
                (true, _) => 0.0,
                (_, true) => OPPOSITE,
                _ => BESIDE,
            };
            assert!((found - expected).abs() < 1e-6, "{i} {j}");
        }
    }
    assert_eq!(lines[7], [0.5; 6]);
}

#[test]
fn a_blocker_in_a_corner_of_a_pair_hides_a_quarter() {
    let pair = "F 3\nV 1 0 0 0\nV 2 1 0 0\nV 3 1 1 0\nV 4 0 1 0\nV 5 0 0 1\nV 6 1 0 1\nV 7 1 1 1\n\
        V 8 0 1 1\nV 9 0 0 .5\nV 10 .5 0 .5\nV 11 .5 .5 .5\nV 12 0 .5 .5\n\
        S 1 1 2 3 4 0 0 .5 low\nS 2 7 6 5 8 0 0 .5 high\nS 3 9 10 11 12 0 0 .5 between\nEnd\n";
    let lines = table(pair);
    close(lines[1][1], 0.149_868_671_8, "low to high");
    close(lines[3][1], 0.415_253_283_6, "blocker to high");
    close(lines[2][2], 0.25 * 0.415_253_283_6, "high to blocker");
    assert_eq!(lines[1][2], 0.0);
    // As an obstruction it hides as much, and has no row.
    let hidden = table(&pair.replace("S 3", "O 3"));
    assert_eq!((hidden.len(), hidden[1].len()), (4, 2));
    close(hidden[1][1], 0.149_868_671_8, "past an obstruction");
}

/// An L-shaped room, floor and ceiling of three pieces each (Pinney and Bean, 1988).
const ROOM: &str = "T an L\nC encl=1 emit=0\nF 3\n\
    V 1 0 3 3\nV 2 1 3 3\nV 3 0 3 0\nV 4 1 3 0\nV 5 0 1 0\nV 6 1 1 0\nV 7 3 1 0\nV 8 0 0 0\n\
    V 9 1 0 0\nV 10 3 0 0\nV 11 0 0 3\nV 12 1 0 3\nV 13 3 0 3\nV 14 0 1 3\nV 15 1 1 3\nV 16 3 1 3\n\
    S 1 11 13 10 8 0 0 .9 a\nS 2 10 13 16 7 0 0 .9 b\nS 3 6 7 16 15 0 0 .9 c\n\
    S 4 4 6 15 2 0 0 .9 d\nS 5 3 4 2 1 0 0 .9 e\nS 6 8 3 1 11 0 0 .9 f\n\
    S 7 11 14 15 12 0 0 .9 top\nS 8 8 9 6 5 0 0 .9 floor\nS 9 1 2 15 14 0 7 .9 top-b\n\
    S 10 15 16 13 12 0 7 .9 top-c\nS 11 5 6 4 3 0 8 .9 floor-b\nS 12 9 10 7 6 0 8 .9 floor-c\nEnd\n";

#[test]
fn the_room_like_an_l_has_its_closed_forms_and_closed_rows() {
    let lines = table(ROOM);
    assert_eq!(lines[0], [9.0, 3.0, 6.0, 6.0, 3.0, 9.0, 5.0, 5.0]);
    for (from, to, expected) in [
        (1, 3, 0.378_092_898),
        (1, 2, 0.113_154_414),
        (5, 4, 0.318_996_701),
        (5, 6, 0.339_463_243),
        (3, 2, 0.159_498_351),
        (4, 6, 0.567_139_347),
        (2, 5, 0.0),
        (3, 5, 0.0),
    ] {
        close(lines[from][to - 1], expected, &format!("{from} to {to}"));
    }
    for (row, line) in lines[1..9].iter().enumerate() {
        close(line.iter().sum(), 1.0, &format!("row {row}"));
    }
}

#[test]
fn factors_with_reflection_are_those_that_view3d_publishes() {
    let lines = table(&ROOM.replace("emit=0", "emit=1"));
    // The first and the seventh row of its own table, to the six digits that it has.
    let published =
        [0.030130, 0.099217, 0.314246, 0.032590, 0.030812, 0.159007, 0.116999, 0.116999];
    for (found, expected) in lines[1].iter().zip(published) {
        assert!((found - expected).abs() < 1e-4, "{found} {expected}");
    }
    assert!((lines[7][6] - 0.010933).abs() < 1e-4 && (lines[7][7] - 0.088622).abs() < 1e-4);
}

#[test]
fn what_lies_on_a_base_takes_its_place_covers_it_or_takes_it_away() {
    // A quarter of the floor of the cube, and the rest of it.
    let quarter = |line: &str| {
        let more =
            format!("V 9 .5 0 0\nV 10 .5 .5 0\nV 11 0 .5 0\nS 1 1 2 3 4 0 0 0.5 low\n{line}");
        CUBE.replace("S 1  1 2 3 4  0 0 0.5 low\n", &more)
    };
    let sub = table(&quarter("S 7 1 9 10 11 1 0 .3 window\n"));
    assert_eq!(sub[0], [0.75, 0.25, 1.0, 1.0, 1.0, 1.0, 1.0]);
    let high = 4;
    close(0.75 * sub[1][high] + 0.25 * sub[2][high], OPPOSITE, "both parts");
    assert_eq!((sub[1][1], sub[8][1]), (0.0, 0.3));
    // All quarters of the floor see as much of the ceiling, but not of the walls.
    close(sub[2][high], OPPOSITE, "a quarter");
    assert!(sub[2][2] > BESIDE + 0.05 && sub[1][2] < BESIDE - 0.01, "{sub:?}");
    close(sub[1].iter().sum(), 1.0, "the rest of the floor");
    close(sub[2].iter().sum(), 1.0, "a quarter");

    let null = table(&quarter("N 7 11 10 9 1 1 0 .3 hole\n"));
    assert_eq!(null[0], [0.75, 1.0, 1.0, 1.0, 1.0, 1.0]);
    close(null[1][3], sub[1][high], "the floor around a hole");

    let mask = table(&quarter("M 7 11 10 9 1 1 0 .3 rug\n"));
    assert_eq!(mask[0], [1.0, 0.25, 1.0, 1.0, 1.0, 1.0, 1.0]);
    assert_eq!(mask[2], [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    close(mask[1][1], 0.25, "the floor to its rug");
    close(mask[1][high], 0.75 * sub[1][high], "the floor past its rug");
    close(mask[1].iter().sum(), 1.0, "the floor with a rug");
}

#[test]
fn tables_come_in_csv_and_refusals_name_lines() {
    let (output, written) = run(CUBE, "room.csv", &[]);
    assert!(output.status.success(), "{output:?}");
    assert!(
        written
            .starts_with("name,area,emissivity,low,west,south,high,east,north,rest\nlow,1,0.5,0")
    );
    let (_, sparse) = run(CUBE, "room.csv", &["--sparse", "0.1999"]);
    assert_eq!(sparse.lines().count(), 1 + 6 * 4);
    // Walls of one name count together, and the rest is the rest.
    let walls = ["west", "south", "east", "north"];
    let named = walls.iter().fold(CUBE.to_owned(), |text, wall| text.replace(wall, "wall"));
    let (output, some) = run(&named, "room.csv", &["--between", "wall", "low", "--quiet"]);
    assert!(output.status.success() && output.stderr.is_empty(), "{output:?}");
    let rows: Vec<Vec<f64>> = some
        .lines()
        .skip(1)
        .map(|line| line.split(',').skip(1).map(|word| word.parse().expect("a number")).collect())
        .collect();
    assert!(some.starts_with("name,area,emissivity,wall,low,rest\nwall,4,0.5,"), "{some}");
    close(rows[0][2], OPPOSITE + 2.0 * BESIDE, "walls to walls");
    close(rows[0][3], BESIDE, "walls to the floor");
    close(rows[1][2], 4.0 * BESIDE, "the floor to walls");
    close(rows[1][4], OPPOSITE, "the floor to the ceiling");
    // All faces are different materials of one file.
    let (output, file) = run(CUBE, "room.csv", &["--by", "file"]);
    assert!(file.starts_with("name,area,emissivity,room.vs3,rest\nroom.vs3,6,0.5,"), "{output:?}");
    let own: f64 =
        file.lines().nth(1).and_then(|l| l.split(',').nth(3)?.parse().ok()).expect("one");
    assert!((own - 1.0).abs() < 1e-6);
    for (text, out, more, expected) in [
        (
            CUBE.replace("End\n", ""),
            "a.txt",
            &[][..],
            "room.vs3, line 17: expected a line that begins",
        ),
        (
            CUBE.replace("3 1 1 0", "3 1 1 0 5"),
            "a.txt",
            &[],
            "room.vs3, line 6: expected a number and",
        ),
        ("F 3\nEnd\n".to_owned(), "a.txt", &[], "room.vs3: expected surfaces, found none"),
        (
            CUBE.to_owned(),
            "a.csv",
            &["--between", "low", "roof"],
            "expected names of surfaces, of which there are `low`, `west`, `south`, `high`, `east`, \
             `north`; found `roof`",
        ),
        (CUBE.replace("V 3", "V 2"), "a.txt", &[], "room.vs3, line 6: expected a new vertex"),
        (CUBE.to_owned(), "a.vtk", &[], "a.vtk: expected a file that ends in .csv, .npy or .txt"),
        (CUBE.to_owned(), "a.npy", &["--sparse", "0.1"], "expected a file that ends in .csv for"),
        (CUBE.replace("S ", "O "), "a.txt", &["--tolerance", "2"], "between 0 and 1"),
    ] {
        let (output, written) = run(&text, out, more);
        let message = String::from_utf8_lossy(&output.stderr);
        assert!(!output.status.success() && message.contains(expected), "{message}");
        assert_eq!(written, "");
    }
}
