//! What a run writes: pictures, everything about the elements, form factors, the report.

use std::io::Write;

use farfield_radiosity::{Occluders, Surroundings};
use farfield_scenes::{Fields, Mesh, Output, OutputError, Picture, Scene, Sight, Table};

use super::args::{Args, QuantityName, VisibilityName};
use super::failure::Failure;
use super::figures::Figures;
use super::report::Report;
use super::solve::Exchange;
use super::warning::Warning;
use super::{exr, factors, npy};
use crate::interrupt::Interrupt;
use crate::progress::Progress;

/// What a table of form factors may leave out of each row, in units of the tolerance.
const LISTED: f64 = 1e-2;

/// A solution on one mesh.
pub(crate) struct Solved {
    /// The solution; zeros where nothing emits.
    pub(crate) fields: Fields,
    /// What was measured.
    pub(crate) figures: Figures,
    /// The irradiance of all light but what comes straight from lamps, where a picture needs it.
    pub(crate) indirect: Option<Vec<f64>>,
    /// What may be wrong with it.
    pub(crate) warnings: Vec<Warning>,
}

impl Solved {
    /// That it takes smaller elements than these.
    pub(crate) fn too_coarse(&self, elements: usize) -> String {
        let by = match self.figures.element_error {
            Some(error) => format!("off by {error:.1e}"),
            None => "off by an unknown error".to_owned(),
        };
        format!("constants on {elements} elements are {by}: once more with smaller ones")
    }
}

/// Writes the form factors, if they are asked for. Returns whether the table is whole.
pub(crate) fn write_factors<const BANDS: usize>(
    args: &Args,
    exchange: &Exchange<'_, BANDS>,
    around: &Surroundings<'_>,
    interrupt: &Interrupt,
    progress: &Progress,
    output: &mut Output,
) -> Result<bool, Failure> {
    let Some(path) = &args.form_factors else { return Ok(true) };
    let bar = progress.bar("form factors");
    let report = |done| {
        bar.show(done);
        interrupt.flow()
    };
    let mut rows = 0;
    output.write_at(path, |file| {
        rows = factors::write(file, exchange, around, LISTED * args.sum_tolerance(), report)?;
        Ok(())
    })?;
    Ok(rows == exchange.surfels.len())
}

/// Writes all other files about a solution, with the `warnings` of its scene before its own; returns the
/// report.
///
/// # Errors
/// If there is no picture, or a file can't be written.
pub(crate) fn deliver(
    args: &Args,
    scene: &Scene,
    mesh: &Mesh,
    solved: Solved,
    mut warnings: Vec<Warning>,
    progress: &Progress,
    output: &mut Output,
) -> Result<Report, Failure> {
    let Solved { fields, figures, indirect, warnings: own } = solved;
    // Without a solution there is nothing to be seen.
    let picture = if args.no_picture || figures.residual.is_none() {
        None
    } else {
        Some(picture(args, scene, mesh, &fields, indirect.as_deref(), progress)?)
    };
    warnings.extend(own);
    let size = [fields.bands, mesh.elements.len()];
    let mut report = figures.report(args, &scene.repairs, warnings, size, progress);
    report.repairs.extend(picture.iter().filter_map(|picture| picture.repair.clone()));
    let bar = progress.spinner("writing");
    report.files = write(args, mesh, &fields, picture.as_ref(), output)?;
    drop(bar);
    report.phases = progress.seconds();
    output.write("report.json", |file| {
        serde_json::to_writer_pretty(&mut *file, &report)?;
        writeln!(file)
    })?;
    report.files.push("report.json");
    Ok(report)
}

/// The picture of a solution.
fn picture(
    args: &Args,
    scene: &Scene,
    mesh: &Mesh,
    fields: &Fields,
    indirect: Option<&[f64]>,
    progress: &Progress,
) -> Result<Picture, Failure> {
    let bar = progress.bar("rendering");
    let sight = Sight::new(scene, mesh)?;
    let size = args.size.unwrap_or(Picture::SIZE);
    Ok(match args.quantity {
        QuantityName::Light => {
            let nothing = Occluders::new(&[])?;
            let casts = args.visibility != VisibilityName::None;
            let shadows = if casts { sight.occluders() } else { &nothing };
            Picture::of_light(&sight, fields, shadows, indirect, size, bar.shower())?
        }
        QuantityName::Heat => Picture::of_heat(&sight, fields, size, bar.shower())?,
    })
}

/// Writes the picture, if any, and everything about the elements; returns the names of the files.
fn write(
    args: &Args,
    mesh: &Mesh,
    fields: &Fields,
    picture: Option<&Picture>,
    output: &mut Output,
) -> Result<Vec<&'static str>, OutputError> {
    let mut files = Vec::new();
    let alone;
    let colours = match picture {
        Some(picture) => {
            output.png("radiosity.png", picture.size, &picture.codes)?;
            let write_exr = |file: &mut _| exr::write(file, picture.size, &picture.values);
            output.write("radiosity.exr", write_exr)?;
            files.extend(["radiosity.png", "radiosity.exr"]);
            &picture.elements
        }
        None => {
            alone = Picture::elements_alone(fields, args.quantity.into());
            &alone
        }
    };
    output.ply_mesh("elements.ply", mesh, fields, colours)?;
    output.vtu("elements.vtu", mesh, fields)?;
    output.csv("elements.csv", mesh, fields)?;
    output.write("elements.npy", |file| npy::write(file, &Table::new(mesh, fields)?))?;
    files.extend(["elements.ply", "elements.vtu", "elements.csv", "elements.npy"]);
    Ok(files)
}
