//! A run: from a scene to its solution, on meshes as fine as the tolerance takes.

use std::cell::Cell;
use std::io::{self, Write};

use farfield_radiosity::{Error, Occluders, RadiosityOperator, Surfel, Surroundings, Visibility};
use farfield_scenes::{
    Cuts, Fields, Mesh, Optics, Output, Refinement, Scene, Sight, even_cuts, with_lamps_cut,
};

use super::args::{Args, ExpansionName, QuantityName, SchemeName, SolverName, VisibilityName};
use super::balance::{RowSums, energy_residual, reflections};
use super::check::Check;
use super::closing;
use super::daylight::{Received, daylight};
use super::delivery::{Solved, check_names, deliver, write_factors};
use super::failure::Failure;
use super::figures::Figures;
use super::gather::{Ending, Gather, Method};
use super::negative::Negative;
use super::report::{Pairs, Report};
use super::series::Series;
use super::solve::Exchange;
use super::steps::Lit;
use super::warning::Warning;
use crate::interrupt::Interrupt;
use crate::progress::Progress;

/// Elements at which the gathered light is held against direct summation.
const SAMPLES: usize = 1000;
/// Rays in all that tell where the light of elements goes, and from each element at least and at most.
const ALL_RAYS: usize = 1 << 18;
const LEAST_RAYS: usize = 4;
const MOST_RAYS: usize = 512;
/// Elements of the first mesh beyond one per surface where the tolerance decides; meshes at most.
const FIRST_ELEMENTS: usize = 2000;
const MOST_MESHES: usize = 6;
/// By which factor an error may exceed the tolerance for rounded cuts to be what is wrong, and how much
/// closer they are made then.
const NEARLY: f64 = 2.0;
const CLOSER: f64 = 0.95;

/// Solves a scene and writes everything about it; once `interrupt`ed, what there is.
///
/// # Errors
/// If the scene can't be cut into elements, the equation not be solved, or a file not be written; if the
/// sums turn out less accurate than asked for, if nothing emits and no form factors are asked for, or if
/// there are warnings and these are to be errors.
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
    if args.is_outdoors() && args.visibility == VisibilityName::None {
        return Err(Failure::Unhidden);
    }
    let steps = args.steps.as_deref();
    let series = steps.map(|path| Series::read(path, scene, args.quantity.into())).transpose()?;
    let dark = Warning::of_darkness(args, scene);
    let is_dark = dark.is_some();
    if let Some(dark) = dark.filter(|_| args.form_factors.is_none() && series.is_none()) {
        return Err(Failure::Dark(dark));
    }
    check_names(args, &output)?;
    let progress = Progress::new(args.quiet);
    let tolerance = args.sum_tolerance();
    let first = if args.is_adaptive() {
        (scene.surfaces.len() + FIRST_ELEMENTS).min(args.element_count())
    } else {
        args.element_count()
    };
    let most = args.element_count();
    // A number of elements is about what is meant; at most so many are, with a tolerance.
    let limit = if args.is_adaptive() { most } else { most + most / 10 };
    let finer = |cuts| with_lamps_cut(scene, args.quantity.into(), cuts, limit);
    let mut cuts = finer(even_cuts(scene, first)?);
    let mut mesh = Mesh::with_cuts(scene, &cuts)?;
    let warnings = Warning::of_scene(args, scene, mesh.elements.len())?;
    Failure::of_warnings(args.strict, &warnings)?;
    let mut meshes = 1;
    // What cuts are made for, which come in whole numbers.
    let aim = Cell::new(tolerance);
    let mut latest: Option<(Mesh, Solved)> = None;
    let (mesh, solved) = loop {
        let last = meshes == MOST_MESHES || !args.is_adaptive();
        let (series, progress) = (series.as_ref(), &progress);
        let run = Run { args, scene, bands, series, mesh: &mesh, is_dark, progress, interrupt };
        let refined = |fields: &Fields| {
            let field = &fields.irradiance;
            let mut next = Refinement::new(scene, &mesh, field, aim.get(), most);
            if let Some(error) = next.error
                && (tolerance..NEARLY * tolerance).contains(&error)
            {
                aim.set(aim.get() * CLOSER * tolerance / error);
                next = Refinement::new(scene, &mesh, field, aim.get(), most);
            }
            next.cuts = finer(next.cuts);
            let goes_on = !last && next.cuts != cuts;
            (next, goes_on)
        };
        match run.solve::<BANDS>(&mut output, &mut latest, &refined)? {
            Outcome::TooCoarse(next, solved) => {
                if !args.quiet {
                    let again = solved.too_coarse(mesh.elements.len());
                    drop(writeln!(io::stderr(), "farfield radiosity: {again}"));
                }
                let finer = Mesh::with_cuts(scene, &next)?;
                latest = Some((std::mem::replace(&mut mesh, finer), solved));
                cuts = next;
                meshes += 1;
            }
            Outcome::Done(solved) => break (mesh, solved),
            Outcome::Kept(mesh, solved) => break (mesh, solved),
        }
    };
    let report = deliver(args, scene, &mesh, solved, warnings, &progress, &mut output)?;
    output.publish()?;
    Ok(report)
}

/// What came of solving on one mesh.
enum Outcome {
    /// It is solved, and the form factors are written.
    Done(Solved),
    /// It is solved, but the elements are too large: what to cut surfaces into instead.
    TooCoarse(Vec<Cuts>, Solved),
    /// It was told to end before it was solved: what there is of an earlier mesh.
    Kept(Mesh, Solved),
}

/// One mesh, and what to do with it.
struct Run<'a> {
    args: &'a Args,
    scene: &'a Scene,
    bands: usize,
    /// Emissions that change with time, if there are any.
    series: Option<&'a Series>,
    mesh: &'a Mesh,
    /// Whether nothing emits.
    is_dark: bool,
    progress: &'a Progress,
    interrupt: &'a Interrupt,
}

impl Run<'_> {
    /// Solves on the mesh, unless it is told to end before and there is a solution to be kept. `refined`
    /// says what the tolerance asks for instead, and whether that may be tried.
    fn solve<const BANDS: usize>(
        &self,
        output: &mut Output,
        kept: &mut Option<(Mesh, Solved)>,
        refined: &dyn Fn(&Fields) -> (Refinement, bool),
    ) -> Result<Outcome, Failure> {
        let Self { args, scene, bands, series, mesh, is_dark, progress, interrupt } = *self;
        let tolerance = args.sum_tolerance();
        let elements = &mesh.elements;
        let surfels: Vec<Surfel> = elements.iter().map(|element| *element.surfel()).collect();
        let area: f64 = surfels.iter().map(|surfel| surfel.area).sum();
        let sight = Sight::new(scene, mesh)?;
        let nothing = Occluders::new(&[])?;
        let shadows =
            if args.visibility == VisibilityName::None { &nothing } else { sight.occluders() };
        let received = daylight(args, scene, mesh, sight.occluders(), progress)?;
        let daylight = received.as_ref().map(Received::total);
        let mut visibility = Visibility::of_elements(shadows, elements);
        if args.visibility == VisibilityName::Fractional {
            let optics = Optics::<1>::new(scene, mesh, args.quantity.into(), 1, 0)
                .lit_by(daylight.as_deref().unwrap_or_default());
            // Where nothing emits, form factors are all that counts, and all alike.
            let brightness = optics.brightness(&surfels).unwrap_or_default();
            visibility = visibility.fractional(tolerance, brightness)?;
        }

        let bar = progress.bar("planning");
        let method = Method { scheme: args.scheme, expansion: args.expansion, tolerance };
        let show = bar.shower();
        let keeps = kept.is_some();
        let mask = Ending { visibility: &visibility, ends: &|| keeps && interrupt.is_asked() };
        let gather = Gather::<BANDS>::plan(&surfels, mask, method, &|done| show(done.fraction));
        drop(bar);
        if let Some((mesh, solved)) = self.ended(kept) {
            return Ok(Outcome::Kept(mesh, solved));
        }
        let gather = gather?;
        let counts = visibility.counts();
        let pairs = Pairs::new(gather.stats(), &counts);
        let bar = progress.spinner("near pairs");
        let corrections = visibility.corrections(elements, tolerance)?;
        let zones = corrections.zones();
        drop(bar);
        if let Some((mesh, solved)) = self.ended(kept) {
            return Ok(Outcome::Kept(mesh, solved));
        }

        let bar = progress.spinner("closing");
        let mut operator = RadiosityOperator::new(elements, |b| gather.apply(b), corrections)?;
        let rays = (ALL_RAYS / elements.len().max(1)).clamp(LEAST_RAYS, MOST_RAYS);
        let around = Surroundings::new(elements, sight.occluders(), rays);
        let passes = args.visibility == VisibilityName::None;
        (!passes).then(|| operator.leave_out(around.buried())).transpose()?;
        let row_sums = operator.row_sums()?;
        let row_error = around.row_error(&row_sums);
        let closed = closing::close(&mut operator, scene, &around, passes);
        let (parts, closure) = closed.map_err(|error| Failure::placed(error, scene, mesh))?;
        let closed_sums = operator.row_sums()?;
        let reciprocity_error = operator.reciprocity_error()?;
        drop(bar);
        let mut warnings =
            Warning::of_exchange(scene, mesh, &sight, &row_sums, |k| operator.scaling(k));
        warnings.extend(Warning::of_isolation(args, scene, &row_sums));
        warnings.extend(Warning::of_leaks(scene, mesh, &around));
        warnings.extend(received.as_ref().and_then(Warning::of_daylight));

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
        let (mut residual, mut energy) = (0.0f64, 0.0f64);
        let (mut error, mut check) = (None::<f64>, None);
        let mut checked = |radiosity: &[[f64; BANDS]]| {
            let _bar = progress.spinner("checking");
            let gathered = operator.apply(radiosity)?;
            let found = Check::new(&exchange, &pairwise, radiosity, &gathered, SAMPLES);
            if !found.is_dark {
                error = Some(error.unwrap_or(0.0).max(found.relative_l2_error));
            }
            check.get_or_insert(found);
            Ok::<_, Error>(())
        };
        let (mut negative, mut bounces) = (Negative::default(), 0.0f64);
        interrupt.hold(true);
        if is_dark {
            checked(&vec![[1.0; BANDS]; count])?;
        }
        for first in (0..if is_dark { 0 } else { bands }).step_by(BANDS) {
            let own = Optics::<BANDS>::new(scene, mesh, args.quantity.into(), bands, first);
            let optics = own.clone().lit_by(daylight.as_deref().unwrap_or_default());
            let solution = exchange.solve(&optics, args.solver, tolerance, progress, interrupt);
            let mut solution = solution.map_err(|error| Failure::placed(error, scene, mesh))?;
            if !solution.interrupted {
                negative.take(&mut solution.irradiance, &surfels, tolerance)?;
            }
            bounces = bounces.max(reflections(&surfels, &optics, &solution.irradiance, &parts));
            iterations += solution.iterations;
            interrupted |= solution.interrupted;
            residual = residual.max(solution.residual);
            energy = energy.max(energy_residual(&surfels, &optics, &solution, &closed_sums)?);
            for k in first..(first + BANDS).min(bands) {
                for i in 0..count {
                    fields.radiosity[i * bands + k] = solution.radiosity[i][k - first];
                    let from_outside = daylight.as_ref().map_or(0.0, |daylight| daylight[i]);
                    fields.emission[i * bands + k] = own.emission[i][k - first];
                    fields.irradiance[i * bands + k] =
                        solution.irradiance[i][k - first] + from_outside;
                }
            }
            checked(&solution.radiosity)?;
        }
        if interrupted && let Some((mesh, solved)) = self.ended(kept) {
            return Ok(Outcome::Kept(mesh, solved));
        }
        let (refinement, may_be_finer) = refined(&fields);
        let few = count < args.element_count() * 9 / 10;
        let coarse = refinement.error.is_none_or(|error| error > tolerance);
        let too_coarse = !is_dark && may_be_finer && coarse && few;
        let goes_on = too_coarse && !interrupt.is_asked();
        interrupted |= too_coarse && !goes_on;
        let check = check.expect("there is a band");
        if let Some(error) = error
            && !(error <= tolerance || interrupted || goes_on)
        {
            let sampled = check.sampled;
            return Err(Failure::Inaccurate { error, sampled, tolerance });
        }

        let arrived =
            |h: &Vec<f64>| h.iter().zip(&surfels).map(|(h, surfel)| h * surfel.area).sum();
        let power = daylight.as_ref().map(arrived);
        let origin = received.as_ref().map(|received| received.origin);
        let is_shown = args.quantity == QuantityName::Light && !(args.no_picture || is_dark);
        let by_pixel = is_shown.then(|| exchange.by_pixel(scene, &fields, received));
        let by_pixel = by_pixel.transpose()?.flatten();

        // Each iteration gathers once; Southwell's shots, pair by pair as they are, weigh as one.
        let sums = if args.solver == SolverName::Southwell { 1 } else { iterations };
        let solves = !is_dark;
        let figures = Figures {
            pairs,
            counts,
            zones,
            row_sums: RowSums::new(elements, &row_sums, &parts),
            row_error,
            seen: around.mean(),
            daylight: power,
            outdoors: origin,
            negative,
            reciprocity_error,
            closure,
            uncertainty: visibility.uncertainty(area),
            iterations,
            residual: solves.then_some(residual),
            residuals: progress.take_residuals(),
            interrupted,
            energy: solves.then_some(energy),
            error: error.filter(|_| solves),
            factor_error: error.filter(|_| is_dark),
            check,
            sums,
            element_error: refinement.error,
        };
        // What passes through everything was not to be what rays say.
        warnings.extend(Warning::of_level(bounces, row_error).filter(|_| !passes));
        let mut solved = Solved { fields, figures, by_pixel, warnings, has_steps: false };
        if goes_on {
            return Ok(Outcome::TooCoarse(refinement.cuts, solved));
        }
        if args.is_adaptive() && solves && !interrupted {
            let missed = Warning::of_elements(count, refinement.error, tolerance);
            solved.warnings.extend(missed);
        }
        Failure::of_warnings(args.strict, &solved.warnings)?;
        if !interrupted {
            let mut whole = write_factors(args, &exchange, &around, interrupt, progress, output)?;
            if let Some(series) = series {
                let daylight = daylight.as_deref().unwrap_or_default();
                let lit = Lit { args, scene, mesh, bands, exchange: &exchange, daylight };
                solved.has_steps = lit.write(series, output, progress, interrupt)?;
                whole &= solved.has_steps;
            }
            solved.figures.interrupted = !whole;
        }
        Ok(Outcome::Done(solved))
    }

    /// What is kept, if the run is asked to end.
    fn ended(&self, kept: &mut Option<(Mesh, Solved)>) -> Option<(Mesh, Solved)> {
        let (mesh, mut solved) = kept.take_if(|_| self.interrupt.is_asked())?;
        solved.figures.interrupted = true;
        Some((mesh, solved))
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
        assert!(report.interrupted && report.residual > Some(0.01) && report.iterations == 1);
        assert!(
            report.elements <= scene.surfaces.len() + FIRST_ELEMENTS
                && report.element_error > Some(0.01)
        );
        assert_eq!(report.files.len(), 10);
        let repair = "camera that saw backs of surfaces, replaced by one outside";
        assert_eq!(report.repairs, [repair]);
        assert!(report.files.iter().all(|name| args.out.join(name).exists()));
        assert!(!fs::exists(&table).expect("known"), "its rows would take as long as ever");
        let text = fs::read_to_string(args.out.join("report.json")).expect("written");
        assert!(text.contains("\"interrupted\": true"), "{text}");
    }
}
