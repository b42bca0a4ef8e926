//! Emissions that change with time, from a file.

use std::fs;
use std::path::Path;

use farfield_scenes::{Quantity, STEFAN_BOLTZMANN, Scene};

use super::failure::Failure;
use crate::csv;

/// Emissions of some materials, time by time.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Series {
    /// For each column, the materials that its name stands for, as the scene numbers them.
    pub(crate) columns: Vec<Vec<usize>>,
    /// The times.
    pub(crate) steps: Vec<Step>,
}

/// A time.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Step {
    /// The name that the file has for it.
    pub(crate) time: String,
    /// For each column what its emission is multiplied by: for light that of the scene, for heat that of a black
    /// body with σT⁴ = 1, times ε.
    pub(crate) factors: Vec<f64>,
}

impl Series {
    /// Reads a table, line by line below a header of `time` and names of materials: what emissions are multiplied by,
    /// or temperatures \[K] for heat. Empty lines and those that begin with `#` are passed over.
    ///
    /// # Errors
    /// If the file can't be read, or with the first line that isn't right.
    pub(crate) fn read(path: &Path, scene: &Scene, quantity: Quantity) -> Result<Self, Failure> {
        let unreadable = |source| Failure::Unreadable { path: path.to_owned(), source };
        let text = fs::read_to_string(path).map_err(unreadable)?;
        let wrong = |line: usize, expected: String, found: &str| Failure::Steps {
            path: path.to_owned(),
            line,
            expected,
            found: found.to_owned(),
        };
        let mut lines = csv::lines(&text);
        let (number, header) = lines.next().unwrap_or((1, ""));
        let names: Vec<&str> = header.split(',').map(str::trim).collect();
        if names.len() < 2 || names[0] != "time" {
            let expected = "a header of `time` and names of materials".to_owned();
            return Err(wrong(number, expected, header));
        }
        let mut columns: Vec<Vec<usize>> = Vec::new();
        for name in &names[1..] {
            let materials = members(scene, name);
            if materials.is_empty() || columns.contains(&materials) {
                let expected = format!("materials of the scene, each once: {}", known(scene));
                return Err(wrong(number, expected, name));
            }
            let is_dark = |&k: &usize| scene.materials[k].emission.iter().all(|&e| e == 0.0);
            if quantity == Quantity::Light && materials.iter().all(is_dark) {
                return Err(wrong(number, "materials that emit".to_owned(), name));
            }
            columns.push(materials);
        }
        let mut steps: Vec<Step> = Vec::new();
        for (number, line) in lines {
            let words: Vec<&str> = line.split(',').map(str::trim).collect();
            if words.len() != names.len() {
                let expected = format!("a time and {} numbers", columns.len());
                return Err(wrong(number, expected, line));
            }
            let time = words[0];
            if time.is_empty() || time.contains('"') || steps.iter().any(|step| step.time == time) {
                let expected = "a time without quotes that no other line has".to_owned();
                return Err(wrong(number, expected, time));
            }
            let factor = |word: &&str| {
                let value = word.parse().ok().filter(|value: &f64| *value >= 0.0);
                let factor = value.map(|value| match quantity {
                    Quantity::Light => value,
                    Quantity::Heat => STEFAN_BOLTZMANN * value.powi(4),
                });
                let expected = || match quantity {
                    Quantity::Light => "a factor of 0 or more".to_owned(),
                    Quantity::Heat => "a temperature of 0 kelvin or more".to_owned(),
                };
                let factor = factor.filter(|factor| factor.is_finite());
                factor.ok_or_else(|| wrong(number, expected(), word))
            };
            let factors = words[1..].iter().map(factor).collect::<Result<_, _>>()?;
            steps.push(Step { time: time.to_owned(), factors });
        }
        if steps.is_empty() {
            return Err(wrong(number, "a line for each time below the header".to_owned(), "none"));
        }
        Ok(Self { columns, steps })
    }
}

/// The materials with that name.
fn members(scene: &Scene, name: &str) -> Vec<usize> {
    let named = scene.materials.iter().enumerate().filter(|(_, material)| material.name == name);
    named.map(|(k, _)| k).collect()
}

/// The names of all materials that something is made of.
fn known(scene: &Scene) -> String {
    let mut names: Vec<&str> = scene.materials_in_use().iter().map(|m| m.name.as_str()).collect();
    names.sort_unstable();
    names.dedup();
    names.join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use farfield_scenes::generate;

    fn read(text: &str, quantity: Quantity) -> Result<Series, String> {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("steps.csv");
        fs::write(&path, text).expect("written");
        let scene = generate("cornell").expect("a scene");
        let message =
            |e: Failure| e.to_string().split_once("steps.csv").expect("named").1.to_owned();
        Series::read(&path, &scene, quantity).map_err(message)
    }

    #[test]
    fn times_have_factors_or_temperatures() {
        let light = read("\u{feff}# dimmed\ntime, lamp\n\n8:00,1\n9:00 , 0.5\n", Quantity::Light);
        let light = light.expect("right");
        let scene = generate("cornell").expect("a scene");
        assert_eq!(light.columns, [members(&scene, "lamp")]);
        let step = |time: &str, factor| Step { time: time.to_owned(), factors: vec![factor] };
        assert_eq!(light.steps, [step("8:00", 1.0), step("9:00", 0.5)]);
        let heat = read("time,white,red\n0,300,0\n", Quantity::Heat).expect("right");
        assert_eq!(heat.steps[0].factors, [STEFAN_BOLTZMANN * 300f64.powi(4), 0.0]);
    }

    #[test]
    fn what_is_wrong_is_named_with_its_line() {
        for (text, expected) in [
            ("", ", line 1: expected a header of `time` and names of materials, found ``"),
            (
                "time\n1\n",
                ", line 1: expected a header of `time` and names of materials, found `time`",
            ),
            ("hour,light\n1,1\n", ", line 1: expected a header"),
            ("time,moon\n1,1\n", ", line 1: expected materials of the scene, each once: "),
            ("time,lamp,light\n1,1,1\n", ", line 1: expected materials of the scene, each once"),
            ("time,white\n1,1\n", ", line 1: expected materials that emit, found `white`"),
            (
                "time,lamp\n",
                ", line 1: expected a line for each time below the header, found `none`",
            ),
            ("time,lamp\n1\n", ", line 2: expected a time and 1 numbers, found `1`"),
            ("time,lamp\n\n,1\n", ", line 3: expected a time without quotes"),
            (
                "time,lamp\n1,1\n1,2\n",
                ", line 3: expected a time without quotes that no other line has",
            ),
            ("time,lamp\n1,-1\n", ", line 2: expected a factor of 0 or more, found `-1`"),
            ("time,lamp\n1,NaN\n", ", line 2: expected a factor of 0 or more, found `NaN`"),
            ("time,lamp\n1,inf\n", ", line 2: expected a factor of 0 or more, found `inf`"),
        ] {
            let message = read(text, Quantity::Light).expect_err(text);
            assert!(message.starts_with(expected), "{text:?}: {message}");
        }
        for temperature in ["-1", "1e100", "warm"] {
            let message = read(&format!("time,white\n1,{temperature}\n"), Quantity::Heat);
            let message = message.expect_err("refused");
            assert!(
                message.starts_with(", line 2: expected a temperature of 0 kelvin"),
                "{message}"
            );
        }
    }
}
