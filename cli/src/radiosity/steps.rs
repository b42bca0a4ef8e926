//! Solutions for emissions that change with time.

use std::io::{self, Write};
use std::iter;

use farfield_radiosity::Surfel;
use farfield_scenes::{Mesh, Optics, Output, Quantity, Scene};

use super::args::Args;
use super::failure::Failure;
use super::negative::Negative;
use super::series::Series;
use super::solve::Exchange;
use crate::csv::quoted;
use crate::interrupt::Interrupt;
use crate::progress::Progress;

/// The file that has them.
pub(crate) const STEPS: &str = "steps.csv";

/// What is lit, and how it is solved for.
pub(crate) struct Lit<'a, const BANDS: usize> {
    pub(crate) args: &'a Args,
    pub(crate) scene: &'a Scene,
    pub(crate) mesh: &'a Mesh,
    pub(crate) bands: usize,
    pub(crate) exchange: &'a Exchange<'a, BANDS>,
    /// What arrives at each element from outside of the scene, if anything.
    pub(crate) daylight: &'a [f64],
}

/// Means over the area of a material, band by band.
#[derive(Clone, Debug, Default, PartialEq)]
struct Means {
    /// Of the radiosity B, and of the irradiance H.
    light: [Vec<f64>; 2],
}

impl<const BANDS: usize> Lit<'_, BANDS> {
    /// Writes what each material sends and receives at each time. Light adds up: what each column of the series emits is
    /// solved for once, and all that doesn't change once. Returns whether it was solved to the end; nothing is
    /// written otherwise.
    ///
    /// # Errors
    /// Those of the solver, and those of the system.
    pub(crate) fn write(
        &self,
        series: &Series,
        output: &mut Output,
        progress: &Progress,
        interrupt: &Interrupt,
    ) -> Result<bool, Failure> {
        let Some(parts) = self.parts(series, progress, interrupt)? else { return Ok(false) };
        output.write(STEPS, |file| self.table(file, series, &parts))?;
        Ok(true)
    }

    /// The means of each material by what doesn't change, then by a unit of each column; none if told to end.
    fn parts(
        &self,
        series: &Series,
        progress: &Progress,
        interrupt: &Interrupt,
    ) -> Result<Option<Vec<Vec<Means>>>, Failure> {
        let mut parts =
            vec![vec![Means::default(); self.scene.materials.len()]; 1 + series.columns.len()];
        for first in (0..self.bands).step_by(BANDS) {
            for (part, means) in parts.iter_mut().enumerate() {
                let optics = self.optics(series, part, first);
                let mut light = [0, 1].map(|_| vec![[0.0; BANDS]; optics.emission.len()]);
                if optics.emission.iter().flatten().any(|&e| e > 0.0) {
                    let (solver, tolerance) = (self.args.solver, self.args.sum_tolerance());
                    let solved =
                        self.exchange.solve(&optics, solver, tolerance, progress, interrupt);
                    let placed = |error| Failure::placed(error, self.scene, self.mesh);
                    let mut solution = solved.map_err(placed)?;
                    if solution.interrupted {
                        return Ok(None);
                    }
                    let irradiance = &mut solution.irradiance;
                    Negative::default().take(irradiance, self.exchange.surfels, tolerance)?;
                    light = [solution.radiosity, solution.irradiance];
                }
                if part == 0 {
                    let arriving = light[1].iter_mut().zip(self.daylight);
                    arriving.for_each(|(h, outside)| h.iter_mut().for_each(|h| *h += outside));
                }
                self.add_means(&light, first, means);
            }
        }
        Ok(Some(parts))
    }

    /// What emits and reflects: all but the columns of the series, or a unit of one of these.
    fn optics(&self, series: &Series, part: usize, first: usize) -> Optics<BANDS> {
        let Self { scene, mesh, bands, .. } = *self;
        let quantity: Quantity = self.args.quantity.into();
        let mut optics = Optics::new(scene, mesh, quantity, bands, first);
        let column_of = |material: u32| {
            series.columns.iter().position(|column| column.contains(&(material as usize)))
        };
        for (i, &material) in mesh.material.iter().enumerate() {
            let own = column_of(material).map_or(0, |column| column + 1);
            let reflectance = optics.reflectance[i];
            let emission = &mut optics.emission[i];
            if own != part {
                *emission = [0.0; BANDS];
            } else if own > 0 && quantity == Quantity::Heat {
                let emissivity =
                    |k: usize| if first + k < bands { 1.0 - reflectance[k] } else { 0.0 };
                *emission = std::array::from_fn(emissivity);
            }
        }
        if part == 0 { optics.lit_by(self.daylight) } else { optics }
    }

    /// Adds the means of some bands to those of each material.
    fn add_means(&self, light: &[Vec<[f64; BANDS]>; 2], first: usize, means: &mut [Means]) {
        let areas = self.areas();
        for k in first..(first + BANDS).min(self.bands) {
            for (of, light) in light.iter().enumerate() {
                let mut sums = vec![0.0; means.len()];
                let elements = self.exchange.surfels.iter().zip(&self.mesh.material).zip(light);
                for ((surfel, &material), light) in elements {
                    sums[material as usize] += surfel.area * light[k - first];
                }
                for ((means, sum), &area) in means.iter_mut().zip(sums).zip(&areas) {
                    means.light[of].push(if area > 0.0 { sum / area } else { 0.0 });
                }
            }
        }
    }

    /// A line for each time and each material that something is made of.
    fn table(
        &self,
        file: &mut impl Write,
        series: &Series,
        parts: &[Vec<Means>],
    ) -> io::Result<()> {
        let bands = (0..self.bands).map(|k| format!(",B_{k},H_{k}"));
        writeln!(file, "time,material,area{}", bands.collect::<String>())?;
        let areas = self.areas();
        for step in &series.steps {
            for (material, &area) in areas.iter().enumerate().filter(|(_, area)| **area > 0.0) {
                let name = quoted(&self.scene.materials[material].name);
                write!(file, "{},{name},{area:?}", quoted(&step.time))?;
                for k in 0..self.bands {
                    for of in 0..2 {
                        let factors = iter::once(&1.0).chain(&step.factors);
                        let each = parts.iter().zip(factors);
                        let each = each.map(|(means, f)| f * means[material].light[of][k]);
                        write!(file, ",{:?}", each.sum::<f64>())?;
                    }
                }
                writeln!(file)?;
            }
        }
        Ok(())
    }

    /// The area of each material.
    fn areas(&self) -> Vec<f64> {
        let mut areas = vec![0.0; self.scene.materials.len()];
        let all = self.exchange.surfels.iter().zip(&self.mesh.material);
        all.for_each(|(surfel, &material): (&Surfel, _)| areas[material as usize] += surfel.area);
        areas
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::radiosity::fixture::exchanging;
    use clap::Parser;
    use farfield_radiosity::Enclosure;
    use farfield_scenes::STEFAN_BOLTZMANN;

    use super::super::series::Step;

    fn step(time: &str, factors: Vec<f64>) -> Step {
        Step { time: time.to_owned(), factors }
    }

    /// The lines of the table, split at commas.
    fn lines<const BANDS: usize>(lit: &Lit<'_, BANDS>, series: &Series) -> Vec<Vec<String>> {
        let (progress, interrupt) = (Progress::new(true), Interrupt::default());
        let parts = lit.parts(series, &progress, &interrupt).expect("solved").expect("to the end");
        let mut text = Vec::new();
        lit.table(&mut text, series, &parts).expect("written");
        let text = String::from_utf8(text).expect("text");
        text.lines().map(|line| line.split(',').map(str::to_owned).collect()).collect()
    }

    fn numbers(words: &[String]) -> Vec<f64> {
        words.iter().map(|word| word.parse().expect("a number")).collect()
    }

    #[test]
    fn dimmed_lamps_below_a_steady_sky_light_what_they_would_by_themselves() {
        let args = Args::parse_from(["radiosity", "--tolerance", "1e-4"]);
        exchanging::<3>("cornell", 400, None, |scene, mesh, exchange| {
            let daylight: Vec<f64> = (0..mesh.elements.len()).map(|i| (i % 5) as f64).collect();
            let lit = Lit { args: &args, scene, mesh, bands: 3, exchange, daylight: &daylight };
            let is_lamp = |k: &usize| scene.materials[*k].emission.iter().any(|&e| e > 0.0);
            let columns = vec![(0..scene.materials.len()).filter(is_lamp).collect::<Vec<_>>()];
            let steps = vec![step("day", vec![0.0]), step("dusk", vec![0.25])];
            let found = lines(&lit, &Series { columns, steps });
            assert_eq!(found[0].join(","), "time,material,area,B_0,H_0,B_1,H_1,B_2,H_2");
            let materials = scene.materials_in_use().len();
            assert_eq!(found.len(), 1 + 2 * materials);

            let mut dimmed = scene.clone();
            dimmed.materials.iter_mut().flat_map(|m| &mut m.emission).for_each(|e| *e *= 0.25);
            let optics = Optics::<3>::new(&dimmed, mesh, Quantity::Light, 3, 0).lit_by(&daylight);
            let (progress, interrupt) = (Progress::new(true), Interrupt::default());
            let solved = exchange.solve(&optics, args.solver, 1e-4, &progress, &interrupt);
            let solved = solved.expect("converges");
            let used = (0..scene.materials.len()).filter(|&k| lit.areas()[k] > 0.0);
            for (line, k) in found[1 + materials..].iter().zip(used) {
                assert_eq!(line[..2], ["dusk".to_owned(), scene.materials[k].name.clone()]);
                let (mut area, mut sums) = (0.0, vec![0.0; 6]);
                for (i, surfel) in exchange.surfels.iter().enumerate() {
                    if mesh.material[i] as usize == k {
                        area += surfel.area;
                        for band in 0..3 {
                            sums[2 * band] += surfel.area * solved.radiosity[i][band];
                            let arrives = solved.irradiance[i][band] + daylight[i];
                            sums[2 * band + 1] += surfel.area * arrives;
                        }
                    }
                }
                let numbers = numbers(&line[2..]);
                assert!((numbers[0] / area - 1.0).abs() < 1e-12);
                for (found, sum) in numbers[1..].iter().zip(sums) {
                    assert!((found * area / sum - 1.0).abs() < 1e-4, "{line:?}");
                }
            }
        });
    }

    #[test]
    fn what_is_as_warm_everywhere_radiates_as_if_it_were_black() {
        let args = Args::parse_from(["radiosity", "--quantity", "heat", "--tolerance", "1e-4"]);
        let closed = Some(Enclosure::Closed);
        exchanging::<1>("furnace", 200, closed, |scene, mesh, exchange| {
            let lit = Lit { args: &args, scene, mesh, bands: 1, exchange, daylight: &[] };
            let columns = vec![(0..scene.materials.len()).collect::<Vec<_>>()];
            let black = |t: f64| STEFAN_BOLTZMANN * t.powi(4);
            let steps = [0.0, 300.0, 1000.0].map(|t| step("t", vec![black(t)])).to_vec();
            let found = lines(&lit, &Series { columns, steps });
            let per_step = (found.len() - 1) / 3;
            for (line, k) in found[1..].iter().zip(0..) {
                let expected = black([0.0, 300.0, 1000.0][k / per_step]);
                for found in &numbers(&line[3..]) {
                    assert!((found - expected).abs() <= 1e-4 * expected, "{line:?}");
                }
            }
        });
    }
}
