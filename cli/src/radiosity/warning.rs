//! What may be wrong with a run that went well.

use std::fmt;

use farfield_radiosity::Surroundings;
use farfield_scenes::{Mesh, Scene, SceneError, Sight, fewest_elements};
use serde::Serialize;

use super::args::{Args, QuantityName};
use super::daylight::Received;

/// Something that may be wrong.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub(crate) struct Warning {
    /// What sort of thing.
    pub(crate) kind: WarningKind,
    /// What it is, in a sentence.
    pub(crate) message: String,
}

/// What may be wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum WarningKind {
    /// Nothing emits: there is no solution, only form factors.
    NothingEmits,
    /// Materials without a temperature, where heat is exchanged.
    NoTemperature,
    /// The sky or the sun is given, and nothing of it reaches the scene.
    NoDaylight,
    /// A file or a material that is named and isn't there.
    Missing,
    /// Surfaces that lie upon each other, so that they count twice.
    Overlap,
    /// What may have been meant otherwise.
    Ambiguous,
    /// The scene has more surfaces than elements were asked for.
    FewElements,
    /// A scene that is said to be closed, and that light leaves.
    Leak,
    /// Rows of form factors that had to change by more than a few per cent.
    Closure,
    /// Light that bounces about so often that errors of form factors add up.
    Level,
    /// No surface sees the front of another.
    NothingSeen,
    /// Elements of a closed room that exchange nothing.
    DarkRow,
    /// Lamps that lie within bodies, or between bodies that touch.
    BuriedLamp,
    /// Elements that are too large for the tolerance.
    MissedTolerance,
}

/// The share of light that may leave a closed scene, since rays pass between surfaces that hardly touch.
const LEAK: f64 = 1e-3;
/// The change of form factors by closing that goes without saying.
const CLOSURE: f64 = 0.05;
/// The error of all light together that goes without saying.
const LEVEL: f64 = 0.05;
/// The fewest surfaces that enclose a room.
const FEWEST_WALLS: usize = 4;
/// Rows of a closed room that sum to less exchange nothing.
const DARK: f64 = 0.01;

impl Warning {
    fn new(kind: WarningKind, message: String) -> Self {
        Self { kind, message }
    }

    /// That nothing emits and no light comes from outside, if so.
    pub(crate) fn of_darkness(args: &Args, scene: &Scene) -> Option<Self> {
        let materials = scene.materials_in_use();
        let emits = match args.quantity {
            QuantityName::Light => materials.iter().any(|m| m.emission.iter().any(|&e| e > 0.0)),
            QuantityName::Heat => materials.iter().any(|m| m.temperature.is_some_and(|t| t > 0.0)),
        };
        let message = match args.quantity {
            QuantityName::Light => {
                "nothing in the scene emits light: expected a material with an emission, by `Ke` in a \
                 material file, by `emissiveFactor` in glTF, or by `emission` in a description (.toml), \
                 which may hold a mesh file"
            }
            QuantityName::Heat => {
                "nothing in the scene has a temperature: expected `temperature` of a material in a \
                 description (.toml), which may hold a mesh file"
            }
        };
        (!emits && !args.is_outdoors())
            .then(|| Self::new(WarningKind::NothingEmits, message.to_owned()))
    }

    /// What is wrong with a scene, and with how many elements it is to have, before anything is summed;
    /// `found` is how many it will have at first.
    ///
    /// # Errors
    /// Those of [`fewest_elements`].
    pub(crate) fn of_scene(
        args: &Args,
        scene: &Scene,
        found: usize,
    ) -> Result<Vec<Self>, SceneError> {
        let mut warnings: Vec<Self> = Self::of_darkness(args, scene).into_iter().collect();
        if args.quantity == QuantityName::Heat && warnings.is_empty() {
            let materials = scene.materials_in_use();
            let without = materials.iter().filter(|material| material.temperature.is_none());
            let names: Vec<_> = without.map(|material| format!("`{}`", material.name)).collect();
            if !names.is_empty() {
                let names = names.join(", ");
                let message = format!("without a temperature, taken for 0 K: {names}");
                warnings.push(Self::new(WarningKind::NoTemperature, message));
            }
        }
        let missing = scene.missing.iter();
        warnings.extend(missing.map(|what| Self::new(WarningKind::Missing, what.clone())));
        let doubts = scene.doubts.iter();
        warnings.extend(doubts.map(|what| Self::new(WarningKind::Ambiguous, what.clone())));
        warnings.extend(scene.overlaps().map(|what| Self::new(WarningKind::Overlap, what)));
        let asked = args.element_count();
        if found > asked {
            let enough = fewest_elements(scene)?;
            let message = format!(
                "{asked} elements are too few for the scene, which takes {found} at least: {enough} \
                 would do"
            );
            warnings.push(Self::new(WarningKind::FewElements, message));
        }
        Ok(warnings)
    }

    /// That nothing from outside reaches any element, if so.
    pub(crate) fn of_daylight(received: &Received) -> Option<Self> {
        let message = "nothing from outside reaches the scene";
        received.is_dark().then(|| Self::new(WarningKind::NoDaylight, message.to_owned()))
    }

    /// That light leaves a scene that is said to be closed, if so.
    pub(crate) fn of_leaks(scene: &Scene, mesh: &Mesh, around: &Surroundings<'_>) -> Option<Self> {
        let sky = around.mean().sky;
        if !scene.closed || sky <= LEAK {
            return None;
        }
        let seen = |&i: &usize, &j: &usize| around.seen(i).sky.total_cmp(&around.seen(j).sky);
        let most = (0..mesh.elements.len()).max_by(seen)?;
        let message = format!(
            "{:.1} % of the light leaves a scene that is said to be closed, most of all that of {}: what \
             loses light is taken to be open",
            100.0 * sky,
            mesh.describe(scene, most)
        );
        Some(Self::new(WarningKind::Leak, message))
    }

    /// That no element sees another, if so: below the sky, a body may well be alone, and so may surfaces that are too few
    /// for a room.
    pub(crate) fn of_isolation(args: &Args, scene: &Scene, row_sums: &[f64]) -> Option<Self> {
        let message = "no surface sees the front of another, so nothing is exchanged: a room has to look inwards";
        let isolated =
            scene.surfaces.len() >= FEWEST_WALLS && row_sums.iter().all(|&sum| sum == 0.0);
        (isolated && !args.is_outdoors())
            .then(|| Self::new(WarningKind::NothingSeen, message.to_owned()))
    }

    /// What is wrong with an exchange of which rows summed to `row_sums`, and were changed by these
    /// `factors` to be closed.
    pub(crate) fn of_exchange(
        scene: &Scene,
        mesh: &Mesh,
        sight: &Sight<'_>,
        row_sums: &[f64],
        factors: impl Fn(usize) -> f64,
    ) -> Vec<Self> {
        let mut warnings = Vec::new();
        // What is left out, buried in bodies, has no row to close.
        let takes_part = |element: usize| factors(element) > 0.0;
        let change = |element: usize| {
            if takes_part(element) { factors(element).powi(2) - 1.0 } else { 0.0 }
        };
        let worst = (0..row_sums.len())
            .max_by(|&i, &j| change(i).abs().total_cmp(&change(j).abs()))
            .filter(|&element| change(element).abs() > CLOSURE);
        if let Some(element) = worst {
            let message = format!(
                "form factors were changed by up to {:+.1} % to close their rows, most of all those of {}: \
                 elements are too coarse, or surfaces are missing or turned the wrong way",
                100.0 * change(element),
                mesh.describe(scene, element)
            );
            warnings.push(Self::new(WarningKind::Closure, message));
        }
        let is_dark = |&element: &usize| {
            let surfel = mesh.elements[element].surfel();
            // What a solid stands on has nothing to see.
            row_sums[element] < DARK
                && takes_part(element)
                && !sight.is_buried(surfel.position, surfel.normal)
        };
        let is_lost = |&element: &usize| {
            let material = &scene.materials[mesh.material[element] as usize];
            !takes_part(element) && material.emission.iter().any(|&e| e > 0.0)
        };
        let lost: Vec<_> = (0..row_sums.len()).filter(is_lost).collect();
        if let Some(&first) = lost.first() {
            let message = format!(
                "lamps that see backs of surfaces only, within bodies or between them, light nothing: {} \
                 elements, first of them {}",
                lost.len(),
                mesh.describe(scene, first)
            );
            warnings.push(Self::new(WarningKind::BuriedLamp, message));
        }
        if scene.closed {
            let dark: Vec<_> = (0..row_sums.len()).filter(is_dark).collect();
            if let Some(&first) = dark.first() {
                let message = format!(
                    "elements of a closed room that see nothing of it: {}, first of them {}",
                    dark.len(),
                    mesh.describe(scene, first)
                );
                warnings.push(Self::new(WarningKind::DarkRow, message));
            }
        }
        warnings
    }

    /// That it isn't known well how bright parts are that light leaves, where it is reflected so many times before, on
    /// average, and rows of form factors are off by so much: at each reflection light is made or lost.
    pub(crate) fn of_level(reflections: f64, row_error: f64) -> Option<Self> {
        let off = reflections * row_error;
        let by =
            if off < 1.0 { format!("{:.0} %", 100.0 * off) } else { "100 % or more".to_owned() };
        let message = format!(
            "light is reflected {reflections:.1} times before it is absorbed or leaves, and form factors are off by \
             {row_error:.1e} each time: all of it may be off by {by}; more elements do better"
        );
        (off > LEVEL).then(|| Self::new(WarningKind::Level, message))
    }

    /// That elements are too large for a tolerance, if they are: by their error, if it is known.
    pub(crate) fn of_elements(count: usize, error: Option<f64>, tolerance: f64) -> Option<Self> {
        let found = match error {
            Some(error) if error <= tolerance => return None,
            Some(error) => format!("off by {error:.1e}"),
            None => "off by an unknown error".to_owned(),
        };
        let message = format!(
            "the tolerance of {tolerance:e} is missed: constants on {count} elements are {found}"
        );
        Some(Self::new(WarningKind::MissedTolerance, message))
    }
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.message.fmt(f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;
    use farfield_scenes::generate;

    fn args(more: &str) -> Args {
        Args::parse_from(["radiosity"].into_iter().chain(more.split_whitespace()))
    }

    fn kinds(more: &str, scene: &Scene, found: usize) -> Vec<WarningKind> {
        let warnings = Warning::of_scene(&args(more), scene, found).expect("a scene");
        warnings.iter().map(|warning| warning.kind).collect()
    }

    #[test]
    fn what_is_wrong_with_a_scene_is_told_by_kind() {
        let mut scene = generate("cornell").expect("a scene");
        assert!(kinds("--elements 1000", &scene, 990).is_empty());
        assert_eq!(kinds("--quantity heat", &scene, 990), [WarningKind::NothingEmits]);
        scene.materials[0].temperature = Some(0.0);
        assert_eq!(kinds("--quantity heat", &scene, 990), [WarningKind::NothingEmits]);
        scene.materials[0].temperature = Some(300.0);
        assert_eq!(kinds("--quantity heat", &scene, 990), [WarningKind::NoTemperature]);
        let warnings = Warning::of_scene(&args("--quantity heat"), &scene, 9).expect("a scene");
        let message = warnings[0].to_string();
        assert!(message.contains("`red`, `green`") && !message.contains("`white`"), "{message}");
        scene.missing.push("material file `a.mtl` not found".to_owned());
        for material in &mut scene.materials {
            material.emission = vec![0.0; 3];
        }
        let found = kinds("--elements 1000", &scene, 1200);
        let expected = [WarningKind::NothingEmits, WarningKind::Missing, WarningKind::FewElements];
        assert_eq!(found, expected);
        // A lamp that nothing is made of lights nothing.
        let lamp = farfield_scenes::Material::rgb("lamp", [0.0; 3], [1.0; 3]);
        scene.materials.push(lamp);
        assert!(Warning::of_darkness(&Args::parse_from(["radiosity"]), &scene).is_some());
    }

    #[test]
    fn rows_that_were_closed_by_much_or_are_empty_are_told_by_their_surface() {
        let scene = generate("furnace").expect("a scene");
        let mesh = Mesh::new(&scene, 600).expect("a mesh");
        let sight = Sight::new(&scene, &mesh).expect("finite");
        let count = mesh.elements.len();
        let of = |scene: &Scene, sums: &[f64], factors: &[f64]| {
            let warnings = Warning::of_exchange(scene, &mesh, &sight, sums, |k| factors[k]);
            warnings.into_iter().map(|w| (w.kind, w.message)).collect::<Vec<_>>()
        };
        let (mut sums, mut factors) = (vec![1.0; count], vec![1.01; count]);
        assert!(of(&scene, &sums, &factors).is_empty());
        factors[count / 2] = 0.9;
        sums[count - 1] = 0.0;
        let found = of(&scene, &sums, &factors);
        assert_eq!(
            found.iter().map(|w| w.0).collect::<Vec<_>>(),
            [WarningKind::Closure, WarningKind::DarkRow]
        );
        let whose = |element: usize| mesh.describe(&scene, element);
        assert!(found[0].1.contains("-19.0 %") && found[0].1.contains(&whose(count / 2)));
        assert!(
            found[1].1.contains(": 1, first of them ") && found[1].1.contains(&whose(count - 1))
        );
        factors[count / 2] = 1.0;
        let open = Scene { closed: false, ..scene.clone() };
        assert!(of(&open, &sums, &factors).is_empty());
        // All walls of a furnace glow.
        (sums[count / 3], factors[count / 3]) = (0.0, 0.0);
        let found = of(&open, &sums, &factors);
        assert_eq!(found.len(), 1);
        assert_eq!(found[0].0, WarningKind::BuriedLamp);
        assert!(found[0].1.contains(": 1 elements") && found[0].1.contains(&whose(count / 3)));
    }

    #[test]
    fn many_reflections_by_factors_that_are_off_are_warned_of() {
        assert_eq!(Warning::of_level(4.0, 0.01), None);
        assert_eq!(Warning::of_level(1000.0, 1e-5), None);
        let said = Warning::of_level(50.0, 0.003).expect("too many").to_string();
        assert!(said.contains("reflected 50.0 times") && said.contains("off by 15 %"), "{said}");
        let said = Warning::of_level(1e4, 0.003).expect("too many").to_string();
        assert!(said.contains("off by 100 % or more"), "{said}");
    }

    #[test]
    fn a_tolerance_is_missed_by_a_larger_or_an_unknown_error() {
        assert_eq!(Warning::of_elements(9, Some(0.01), 0.01), None);
        let missed = |error| Warning::of_elements(9, error, 0.01).expect("missed").to_string();
        assert!(missed(Some(0.02)).contains("off by 2.0e-2"));
        assert!(missed(None).contains("off by an unknown error"));
    }
}
