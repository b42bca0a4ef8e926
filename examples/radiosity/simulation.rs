//! A run: from a scene to its solution, picture and files.

use std::fs::File;
use std::io::{BufWriter, Write};

use farfield_radiosity::{
    Closure, Corrections, Enclosure, Occluders, PairCounts, RadiosityOperator, Surfel, Visibility,
    Zones,
};

use crate::Failure;
use crate::args::{Args, ExpansionName, QuantityName, SchemeName, SolverName, VisibilityName};
use crate::balance::{RowSums, energy_residual};
use crate::check::Check;
use crate::factors;
use crate::fields::Fields;
use crate::gather::{Gather, Method};
use crate::mesh::{Cuts, Mesh, even_cuts};
use crate::output::{Output, OutputError};
use crate::picture::{self, Picture, SIZE};
use crate::progress::Progress;
use crate::refine::Refinement;
use crate::report::{Pairs, Report, peak_memory_bytes};
use crate::scene::Scene;
use crate::solve::Exchange;
use crate::surfaces::Surfaces;

/// Elements at which the gathered light is held against direct summation.
const SAMPLES: usize = 1000;
/// The most that a form factor may have to change for a row to sum to 1.
const MOST_CLOSURE: f64 = 0.5;
/// Elements of the first mesh beyond one per surface where the tolerance decides; meshes at most.
const FIRST_ELEMENTS: usize = 2000;
const MOST_MESHES: usize = 6;
/// The least form factor that a table lists, in units of the tolerance.
const LISTED: f64 = 1e-3;

/// Solves a scene and writes everything about it.
///
/// # Errors
/// If the scene can't be cut into elements, the equation not be solved, or a file not be written; if the
/// sums turn out less accurate than asked for.
pub(crate) fn run<const BANDS: usize>(
    args: &Args,
    scene: &Scene,
    bands: usize,
    mut output: Output,
) -> Result<Report, Failure> {
    if args.visibility == VisibilityName::Fractional
        && (args.scheme != SchemeName::Fmm || args.expansion != ExpansionName::Interpolation)
    {
        return Err(Failure::Unweighed);
    }
    let progress = Progress::new(args.quiet);
    let tolerance = args.sum_tolerance();
    let first = match args.is_adaptive() {
        true => (scene.surfaces.len() + FIRST_ELEMENTS).min(args.element_count()),
        false => args.element_count(),
    };
    let mut cuts = even_cuts(scene, first)?;
    let mut meshes = 1;
    loop {
        let mesh = Mesh::with_cuts(scene, &cuts)?;
        let last = meshes == MOST_MESHES || !args.is_adaptive();
        let run = Run { args, scene, bands, mesh: &mesh, progress: &progress };
        let refined = |fields: &Fields| {
            let field = &fields.irradiance;
            let most = args.element_count();
            Refinement::new(scene, &mesh, &cuts, field, tolerance, most)
        };
        match run.solve::<BANDS>(&mut output, last, &refined)? {
            Outcome::Done(report) => {
                output.publish()?;
                return Ok(*report);
            }
            Outcome::TooCoarse(next) => cuts = next,
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
}

impl Run<'_> {
    fn solve<const BANDS: usize>(
        &self,
        output: &mut Output,
        last: bool,
        refined: &dyn Fn(&Fields) -> Refinement,
    ) -> Result<Outcome, Failure> {
        let Self { args, scene, bands, mesh, progress } = *self;
        let tolerance = args.sum_tolerance();
        let elements = &mesh.elements;
        let surfels: Vec<Surfel> = elements.iter().map(|element| *element.surfel()).collect();
        let area: f64 = surfels.iter().map(|surfel| surfel.area).sum();
        let walls = Occluders::new(&mesh.triangles)?;
        let nothing = Occluders::new(&[])?;
        let shadows = if args.visibility == VisibilityName::None { &nothing } else { &walls };
        let mut visibility = Visibility::new(shadows);
        if args.visibility == VisibilityName::Fractional {
            visibility = visibility.fractional(tolerance, self.brightness(&surfels, area)?)?;
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
        let corrections = Corrections::new(elements, shadows, tolerance)?;
        let zones = corrections.zones();
        drop(bar);

        let bar = progress.spinner("closing");
        let mut operator = RadiosityOperator::new(elements, |b| gather.apply(b), corrections)?;
        let row_sums = operator.row_sums()?;
        let enclosure = if scene.closed { Enclosure::Closed } else { Enclosure::Open };
        let closure = match args.visibility {
            // Light that passes through everything closes nothing.
            VisibilityName::None => Closure::default(),
            _ => operator.close(enclosure, MOST_CLOSURE)?,
        };
        let closed_sums = operator.row_sums()?;
        let reciprocity_error = operator.reciprocity_error()?;
        drop(bar);

        let pairwise = Visibility::new(shadows);
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
        let (mut iterations, mut energy, mut error) = (0, 0.0f64, 0.0f64);
        let mut check = None;
        for first in (0..bands).step_by(BANDS) {
            let surfaces = Surfaces::<BANDS>::new(scene, mesh, args.quantity, bands, first);
            let solution = exchange.solve(&surfaces, args.solver, tolerance, progress)?;
            iterations += solution.iterations;
            energy = energy.max(energy_residual(&surfels, &surfaces, &solution, &closed_sums)?);
            for k in first..(first + BANDS).min(bands) {
                for i in 0..count {
                    fields.radiosity[i * bands + k] = solution.radiosity[i][k - first];
                    fields.emission[i * bands + k] = surfaces.emission[i][k - first];
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
        if !last && refinement.error > tolerance && count < args.element_count() * 9 / 10 {
            return Ok(Outcome::TooCoarse(refinement.cuts));
        }
        let check = check.expect("there is a band");
        let accurate = error <= tolerance;
        if !accurate {
            let sampled = check.sampled;
            return Err(Failure::Inaccurate { error, sampled, tolerance });
        }

        let indirect = || {
            let mut field = zeros();
            for first in (0..bands).step_by(BANDS) {
                let reflected: Vec<[f64; BANDS]> = (0..count)
                    .map(|i| {
                        std::array::from_fn(|k| match first + k < bands {
                            true => {
                                let at = i * bands + first + k;
                                fields.radiosity[at] - fields.emission[at]
                            }
                            false => 0.0,
                        })
                    })
                    .collect();
                for (i, h) in operator.apply(&reflected)?.iter().enumerate() {
                    for k in first..(first + BANDS).min(bands) {
                        field[i * bands + k] = h[k - first];
                    }
                }
            }
            Ok(field)
        };
        let picture =
            picture::take(scene, mesh, &fields, shadows, args.quantity, &indirect, progress)?;

        if let Some(path) = &args.form_factors {
            let bar = progress.bar("form factors");
            let failed = |source| OutputError::new(path, source);
            let mut file = BufWriter::new(File::create(path).map_err(failed)?);
            factors::write(&mut file, &exchange, LISTED * tolerance, |done| bar.show(done))
                .and_then(|()| file.flush())
                .map_err(failed)?;
        }

        // Each iteration gathers once; Southwell's shots, pair by pair as they are, weigh as one.
        let sums = if args.solver == SolverName::Southwell { 1 } else { iterations };
        let uncertainty = visibility.uncertainty(area);
        let figures = Figures {
            pairs,
            counts,
            zones,
            row_sums: RowSums::new(elements, &row_sums, scene.closed),
            reciprocity_error,
            closure,
            uncertainty,
            iterations,
            energy,
            error,
            check,
            sums,
            element_error: refinement.error,
        };
        let mut report = self.report(&figures);
        report.files = self.write(output, &picture, &fields)?;
        report.phases = progress.seconds();
        output.json("report.json", &report)?;
        report.files.push("report.json");
        Ok(Outcome::Done(Box::new(report)))
    }

    /// How much brighter than the mean each face may be, for what samples may leave out.
    fn brightness(&self, surfels: &[Surfel], area: f64) -> Result<Vec<f64>, Failure> {
        let surfaces = Surfaces::<1>::new(self.scene, self.mesh, self.args.quantity, 1, 0);
        let mut brightness: Vec<f64> = Vec::new();
        let (mut emitted, mut absorbed) = (0.0, 0.0);
        for ((surfel, e), rho) in surfels.iter().zip(&surfaces.emission).zip(&surfaces.reflectance)
        {
            emitted += surfel.area * e[0];
            absorbed += surfel.area * (1.0 - rho[0]);
            let face = surfel.face as usize;
            if surfel.face != Surfel::<f64>::NO_FACE && e[0] > 0.0 {
                brightness.resize(brightness.len().max(face + 1), 0.0);
                brightness[face] = brightness[face].max(e[0]);
            }
        }
        // All light that is emitted is absorbed in the end: that is what it takes on average.
        let mean = emitted / absorbed.max(1e-3 * area);
        if mean <= 0.0 {
            return Err(Failure::Dark(match self.args.quantity {
                QuantityName::Light => "emits light",
                QuantityName::Heat => "has a temperature",
            }));
        }
        Ok(brightness.into_iter().map(|e| (e / mean).max(1.0)).collect())
    }

    fn write(
        &self,
        output: &mut Output,
        picture: &Picture,
        fields: &Fields,
    ) -> Result<Vec<&'static str>, OutputError> {
        let _bar = self.progress.spinner("writing");
        output.png("radiosity.png", SIZE, &picture.codes)?;
        output.exr("radiosity.exr", SIZE, &picture.values)?;
        output.ply_mesh("elements.ply", self.mesh, fields, &picture.elements)?;
        output.vtu("elements.vtu", self.mesh, fields)?;
        output.csv("elements.csv", self.mesh, fields)?;
        output.npy("elements.npy", self.mesh, fields)?;
        Ok(vec![
            "radiosity.png",
            "radiosity.exr",
            "elements.ply",
            "elements.vtu",
            "elements.csv",
            "elements.npy",
        ])
    }

    fn report(&self, figures: &Figures) -> Report {
        let Self { args, scene, bands, mesh, progress } = *self;
        let seconds = progress.seconds();
        let of = |phases: &[&str]| phases.iter().filter_map(|phase| seconds.get(phase)).sum();
        let Figures { check, .. } = figures;
        Report {
            scene: args.scene.clone(),
            scheme: args.scheme,
            expansion: args.expansion,
            solver: args.solver,
            quantity: args.quantity,
            bands,
            visibility: args.visibility,
            occlusion: args.visibility != VisibilityName::None,
            threads: rayon::current_num_threads(),
            tolerance: args.sum_tolerance(),
            elements: mesh.elements.len(),
            surfels: mesh.elements.len(),
            element_error: figures.element_error,
            adaptive: args.is_adaptive(),
            pairs: figures.pairs,
            rays: figures.counts.rays,
            near_pairs: figures.zones.into(),
            visibility_uncertainty: figures.uncertainty,
            row_sum: figures.row_sums,
            reciprocity_error: figures.reciprocity_error,
            closure_correction: figures.closure.largest,
            closure_rms: figures.closure.rms,
            plan_s: of(&["planning", "near pairs"]),
            solve_s: of(&["solving"]),
            direct_s: check.visibility_s + figures.sums as f64 * check.sum_s,
            iterations: figures.iterations,
            energy_residual: figures.energy,
            relative_l2_error: figures.error,
            sampled_surfels: check.sampled,
            peak_memory_bytes: peak_memory_bytes(),
            phases: seconds,
            repairs: scene.repairs.clone(),
            files: Vec::new(),
        }
    }
}

/// What a run on one mesh measured.
struct Figures {
    pairs: Pairs,
    counts: PairCounts,
    zones: Zones,
    row_sums: RowSums,
    reciprocity_error: f64,
    closure: Closure,
    uncertainty: f64,
    iterations: usize,
    energy: f64,
    error: f64,
    check: Check,
    /// Sums over all pairs that the solution took.
    sums: usize,
    element_error: f64,
}
