//! A run: from a scene to its solution, picture and files.

use std::fs::File;
use std::io::{BufWriter, Write};

use farfield_radiosity::{Closure, Occluders, RadiosityOperator, Surfel, Surroundings, Visibility};
use farfield_scenes::{
    Cuts, Fields, Mesh, Optics, Output, OutputError, Picture, Refinement, Scene, Sight, Table,
    direct_light_by_pixel, even_cuts,
};

use super::args::{Args, ExpansionName, QuantityName, SchemeName, SolverName, VisibilityName};
use super::balance::{RowSums, energy_residual};
use super::check::Check;
use super::failure::Failure;
use super::figures::Figures;
use super::gather::{Gather, Method};
use super::interrupt::Interrupt;
use super::negative::Negative;
use super::progress::Progress;
use super::report::{Pairs, Report};
use super::solve::Exchange;
use super::{exr, factors, npy};

/// Elements at which the gathered light is held against direct summation.
const SAMPLES: usize = 1000;
/// The most that a form factor may have to change for a row to sum to 1.
const MOST_CLOSURE: f64 = 0.5;
/// Rays in all that tell where the light of elements goes, and from each element at least and at most.
const ALL_RAYS: usize = 1 << 18;
const LEAST_RAYS: usize = 4;
const MOST_RAYS: usize = 512;
/// Elements of the first mesh beyond one per surface where the tolerance decides; meshes at most.
const FIRST_ELEMENTS: usize = 2000;
const MOST_MESHES: usize = 6;
/// What a table of form factors may leave out of each row, in units of the tolerance.
const LISTED: f64 = 1e-2;

/// Solves a scene and writes everything about it; once `interrupt`ed, what there is.
///
/// # Errors
/// If the scene can't be cut into elements, the equation not be solved, or a file not be written; if the
/// sums turn out less accurate than asked for.
pub(crate) fn run<const BANDS: usize>(
    args: &Args,
    scene: &Scene,
    bands: usize,
    mut output: Output,
    interrupt: &Interrupt,
) -> Result<Report, Failure> {
    if args.visibility == VisibilityName::Fractional
        && (args.scheme != SchemeName::Fmm || args.expansion != ExpansionName::Interpolation)
    {
        return Err(Failure::Unweighed);
    }
    let progress = Progress::new(args.quiet);
    let tolerance = args.sum_tolerance();
    let first = if args.is_adaptive() {
        (scene.surfaces.len() + FIRST_ELEMENTS).min(args.element_count())
    } else {
        args.element_count()
    };
    let mut cuts = even_cuts(scene, first)?;
    let mut meshes = 1;
    loop {
        let mesh = Mesh::with_cuts(scene, &cuts)?;
        let last = meshes == MOST_MESHES || !args.is_adaptive();
        let run = Run { args, scene, bands, mesh: &mesh, progress: &progress, interrupt };
        let refined = |fields: &Fields| {
            let field = &fields.irradiance;
            let most = args.element_count();
            Refinement::new(scene, &mesh, field, tolerance, most)
        };
        match run.solve::<BANDS>(&mut output, last, &refined)? {
            Outcome::Done(report) => {
                output.publish()?;
                return Ok(*report);
            }
            Outcome::TooCoarse(next) => {
                interrupt.hold(false);
                cuts = next;
            }
        }
        meshes += 1;
    }
}

/// What came of solving on one mesh.
enum Outcome {
    /// Everything is written.
    Done(Box<Report>),
    /// The elements are too large: what to cut surfaces into instead.
    TooCoarse(Vec<Cuts>),
}

/// One mesh, and what to do with it.
struct Run<'a> {
    args: &'a Args,
    scene: &'a Scene,
    bands: usize,
    mesh: &'a Mesh,
    progress: &'a Progress,
    interrupt: &'a Interrupt,
}

impl Run<'_> {
    fn solve<const BANDS: usize>(
        &self,
        output: &mut Output,
        last: bool,
        refined: &dyn Fn(&Fields) -> Refinement,
    ) -> Result<Outcome, Failure> {
        let Self { args, scene, bands, mesh, progress, interrupt } = *self;
        let tolerance = args.sum_tolerance();
        let elements = &mesh.elements;
        let surfels: Vec<Surfel> = elements.iter().map(|element| *element.surfel()).collect();
        let area: f64 = surfels.iter().map(|surfel| surfel.area).sum();
        let sight = Sight::new(scene, mesh)?;
        let nothing = Occluders::new(&[])?;
        let shadows =
            if args.visibility == VisibilityName::None { &nothing } else { sight.occluders() };
        let mut visibility = Visibility::of_elements(shadows, elements);
        if args.visibility == VisibilityName::Fractional {
            let optics = Optics::<1>::new(scene, mesh, args.quantity.into(), 1, 0);
            let brightness = optics.brightness(&surfels).ok_or(match args.quantity {
                QuantityName::Light => Failure::Dark("emits light"),
                QuantityName::Heat => Failure::Dark("has a temperature"),
            })?;
            visibility = visibility.fractional(tolerance, brightness)?;
        }

        let bar = progress.bar("planning");
        let method = Method { scheme: args.scheme, expansion: args.expansion, tolerance };
        let show = bar.shower();
        let gather =
            Gather::<BANDS>::plan(&surfels, &visibility, method, &|done| show(done.fraction))?;
        drop(bar);
        let counts = visibility.counts();
        let pairs = Pairs::new(gather.stats(), &counts);
        let bar = progress.spinner("near pairs");
        let corrections = visibility.corrections(elements, tolerance)?;
        let zones = corrections.zones();
        drop(bar);

        let bar = progress.spinner("closing");
        let mut operator = RadiosityOperator::new(elements, |b| gather.apply(b), corrections)?;
        let row_sums = operator.row_sums()?;
        let rays = (ALL_RAYS / elements.len().max(1)).clamp(LEAST_RAYS, MOST_RAYS);
        let around = Surroundings::new(elements, sight.occluders(), rays);
        let parts =
            if scene.closed { around.closed_parts().to_vec() } else { vec![None; elements.len()] };
        let row_error = around.row_error(&row_sums);
        // Light that passes through everything closes nothing.
        let closure = if args.visibility == VisibilityName::None {
            Closure::default()
        } else {
            operator.close_parts(parts.clone(), MOST_CLOSURE)?
        };
        let closed_sums = operator.row_sums()?;
        let reciprocity_error = operator.reciprocity_error()?;
        drop(bar);

        let pairwise = Visibility::of_elements(shadows, elements);
        let exchange = Exchange { surfels: &surfels, operator: &operator, visibility: &pairwise };
        let count = elements.len();
        let zeros = || vec![0.0; count * bands];
        let mut fields = Fields {
            bands,
            radiosity: zeros(),
            emission: zeros(),
            irradiance: zeros(),
            row_sums: row_sums.clone(),
        };
        let (mut iterations, mut interrupted) = (0, false);
        let (mut residual, mut energy, mut error) = (0.0f64, 0.0f64, 0.0f64);
        let mut check = None;
        let mut negative = Negative::default();
        interrupt.hold(true);
        for first in (0..bands).step_by(BANDS) {
            let optics = Optics::<BANDS>::new(scene, mesh, args.quantity.into(), bands, first);
            let mut solution =
                exchange.solve(&optics, args.solver, tolerance, progress, interrupt)?;
            if !solution.interrupted {
                negative.take(&mut solution.irradiance, &surfels, tolerance)?;
            }
            iterations += solution.iterations;
            interrupted |= solution.interrupted;
            residual = residual.max(solution.residual);
            energy = energy.max(energy_residual(&surfels, &optics, &solution, &closed_sums)?);
            for k in first..(first + BANDS).min(bands) {
                for i in 0..count {
                    fields.radiosity[i * bands + k] = solution.radiosity[i][k - first];
                    fields.emission[i * bands + k] = optics.emission[i][k - first];
                    fields.irradiance[i * bands + k] = solution.irradiance[i][k - first];
                }
            }
            let _bar = progress.spinner("checking");
            let gathered = operator.apply(&solution.radiosity)?;
            let radiosity = &solution.radiosity;
            let found = Check::new(&exchange, &pairwise, radiosity, &gathered, SAMPLES);
            error = error.max(found.relative_l2_error);
            check.get_or_insert(found);
        }
        let refinement = refined(&fields);
        let few = count < args.element_count() * 9 / 10;
        let too_coarse = !last && refinement.error > tolerance && few;
        if too_coarse && !interrupt.is_asked() {
            return Ok(Outcome::TooCoarse(refinement.cuts));
        }
        interrupted |= too_coarse;
        let check = check.expect("there is a band");
        let accurate = error <= tolerance;
        if !(accurate || interrupted) {
            let sampled = check.sampled;
            return Err(Failure::Inaccurate { error, sampled, tolerance });
        }

        let indirect = || {
            let mut field = zeros();
            for first in (0..bands).step_by(BANDS) {
                let reflected: Vec<[f64; BANDS]> = (0..count)
                    .map(|i| {
                        std::array::from_fn(|k| {
                            let at = i * bands + first + k;
                            let reflected = || fields.radiosity[at] - fields.emission[at];
                            if first + k < bands { reflected() } else { 0.0 }
                        })
                    })
                    .collect();
                for (i, h) in operator.apply(&reflected)?.iter().enumerate() {
                    for k in first..(first + BANDS).min(bands) {
                        field[i * bands + k] = h[k - first];
                    }
                }
            }
            Ok::<_, farfield_radiosity::Error>(field)
        };
        let picture = match args.quantity {
            QuantityName::Light => {
                let indirect = direct_light_by_pixel(scene).then(indirect).transpose()?;
                let bar = progress.bar("rendering");
                let (show, indirect) = (bar.shower(), indirect.as_deref());
                Picture::of_light(&sight, &fields, shadows, indirect, show)?
            }
            QuantityName::Heat => {
                let bar = progress.bar("rendering");
                Picture::of_heat(&sight, &fields, bar.shower())?
            }
        };

        if let Some(path) = &args.form_factors
            && !interrupted
        {
            let bar = progress.bar("form factors");
            let failed = |source| OutputError::new(path, source);
            let mut file = BufWriter::new(File::create(path).map_err(failed)?);
            let report = |done| {
                bar.show(done);
                interrupt.flow()
            };
            let rows = factors::write(&mut file, &exchange, &around, LISTED * tolerance, report)
                .and_then(|rows| file.flush().map(|()| rows))
                .map_err(failed)?;
            interrupted = rows < count;
        }

        // Each iteration gathers once; Southwell's shots, pair by pair as they are, weigh as one.
        let sums = if args.solver == SolverName::Southwell { 1 } else { iterations };
        let uncertainty = visibility.uncertainty(area);
        let figures = Figures {
            pairs,
            counts,
            zones,
            row_sums: RowSums::new(elements, &row_sums, &parts),
            row_error,
            seen: around.mean(),
            negative,
            reciprocity_error,
            closure,
            uncertainty,
            iterations,
            residual,
            interrupted,
            energy,
            error,
            check,
            sums,
            element_error: refinement.error,
        };
        let mut report = figures.report(args, &scene.repairs, [bands, count], progress);
        report.repairs.extend(picture.repair.clone());
        report.files = self.write(output, &picture, &fields)?;
        report.phases = progress.seconds();
        output.write("report.json", |file| {
            serde_json::to_writer_pretty(&mut *file, &report)?;
            writeln!(file)
        })?;
        report.files.push("report.json");
        Ok(Outcome::Done(Box::new(report)))
    }

    fn write(
        &self,
        output: &mut Output,
        picture: &Picture,
        fields: &Fields,
    ) -> Result<Vec<&'static str>, OutputError> {
        let _bar = self.progress.spinner("writing");
        output.png("radiosity.png", Picture::SIZE, &picture.codes)?;
        output.write("radiosity.exr", |file| exr::write(file, Picture::SIZE, &picture.values))?;
        output.ply_mesh("elements.ply", self.mesh, fields, &picture.elements)?;
        output.vtu("elements.vtu", self.mesh, fields)?;
        output.csv("elements.csv", self.mesh, fields)?;
        output.write("elements.npy", |file| npy::write(file, &Table::new(self.mesh, fields)?))?;
        Ok(vec![
            "radiosity.png",
            "radiosity.exr",
            "elements.ply",
            "elements.vtu",
            "elements.csv",
            "elements.npy",
        ])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;
    use farfield_scenes::generate;
    use std::fs;

    #[test]
    fn an_interrupted_run_writes_what_it_has_and_lists_repairs() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = |name: &str| folder.path().join(name).to_string_lossy().into_owned();
        let mut scene = generate("cornell").expect("a scene");
        let inside_of_a_block = glam::DVec3::new(186.0, 80.0, 168.0);
        scene.camera.as_mut().expect("published").eye = inside_of_a_block;
        let (out, table) = (path("out"), path("table.csv"));
        let args = ["--quiet", "--tolerance", "0.01", "--out", &out, "--form-factors", &table];
        let args = Args::parse_from(["radiosity"].into_iter().chain(args));
        let interrupt = Interrupt::default();
        interrupt.ask();
        let output = Output::new(&args.out).expect("writable");
        let report = run::<3>(&args, &scene, 3, output, &interrupt).expect("no failure");
        assert!(report.interrupted && report.residual > 0.01 && report.iterations == 1);
        assert!(
            report.elements <= scene.surfaces.len() + FIRST_ELEMENTS && report.element_error > 0.01
        );
        assert_eq!(report.files.len(), 7);
        let repair = "camera that saw backs of surfaces, replaced by one outside";
        assert_eq!(report.repairs, [repair]);
        assert!(report.files.iter().all(|name| args.out.join(name).exists()));
        assert!(!fs::exists(&table).expect("known"), "its rows would take as long as ever");
        let text = fs::read_to_string(args.out.join("report.json")).expect("written");
        assert!(text.contains("\"interrupted\": true"), "{text}");
    }
}
