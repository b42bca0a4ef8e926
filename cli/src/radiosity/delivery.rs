//! What a run writes: pictures, everything about the elements, form factors, the report.

use std::io::Write;
use std::path::Path;

use farfield_radiosity::{Occluders, Surroundings};
use farfield_scenes::{
    ByPixel, Colours, Fields, Mesh, Output, OutputError, Page, Picture, Scene, Shading, Sight,
    Table, is_same_file, png_uri,
};

use super::args::{Args, QuantityName, VisibilityName};
use super::failure::Failure;
use super::figures::Figures;
use super::report::Report;
use super::report_page::{self, Exhibits};
use super::solve::{Exchange, RESIDUAL};
use super::steps::STEPS;
use super::warning::Warning;
use super::{exr, factors, npy};
use crate::interrupt::Interrupt;
use crate::progress::Progress;

/// All files that a run may write to its folder.
const FILES: [&str; 11] = [
    "radiosity.png",
    "radiosity.exr",
    "elements.ply",
    "elements.glb",
    "elements.vtu",
    "elements.csv",
    "elements.npy",
    "scene.html",
    "report.json",
    "report.html",
    STEPS,
];
/// What a table of form factors may leave out of each row, in units of the tolerance.
const LISTED: f64 = 1e-2;
/// Elements that a page may have to be shown by a browser without delay.
const MOST_SHOWN: usize = 500_000;

/// A solution on one mesh.
pub(crate) struct Solved {
    /// The solution; zeros where nothing emits.
    pub(crate) fields: Fields,
    /// What was measured.
    pub(crate) figures: Figures,
    /// What a picture gathers pixel by pixel, if anything.
    pub(crate) by_pixel: Option<ByPixel>,
    /// What may be wrong with it.
    pub(crate) warnings: Vec<Warning>,
    /// Whether [`STEPS`] is written.
    pub(crate) has_steps: bool,
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

/// Checks that no file of a run takes the place of another, nor of the times that it reads.
///
/// # Errors
/// [`Failure::Taken`], and where the form factors can't be written.
pub(crate) fn check_names(args: &Args, output: &Output) -> Result<(), Failure> {
    let is_taken = |path: &Path| FILES.iter().any(|name| is_same_file(path, &args.out.join(name)));
    let taken = |flag, path: &Path| Err(Failure::Taken { flag, path: path.to_owned() });
    if let Some(path) = args.steps.as_deref().filter(|path| is_taken(path)) {
        return taken("--steps", path);
    }
    let Some(path) = args.form_factors.as_deref() else { return Ok(()) };
    output.check(path)?;
    let is_read = args.steps.as_deref().is_some_and(|steps| is_same_file(path, steps));
    if is_read || is_taken(path) { taken("--form-factors", path) } else { Ok(()) }
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
    let Solved { fields, figures, by_pixel, warnings: own, has_steps } = solved;
    let is_solved = figures.residual.is_some();
    let sight = if args.no_picture { None } else { Some(Sight::new(scene, mesh)?) };
    // Without a solution there is no light to be seen, but form factors are.
    let picture = match &sight {
        Some(sight) if is_solved => {
            Some(picture(args, sight, &fields, by_pixel.as_ref(), progress)?)
        }
        _ => None,
    };
    let colours = match &picture {
        Some(picture) => picture.colours.clone(),
        None => Colours::of_elements(&fields, args.quantity.into()),
    };
    let bar = progress.spinner("shading");
    let shading = match &sight {
        Some(sight) if is_solved => Shading::smooth(sight, &fields, &colours)?,
        _ => Shading::constant(mesh, &fields, &colours)?,
    };
    drop(bar);
    warnings.extend(own);
    let size = [fields.bands, mesh.elements.len()];
    let mut report = figures.report(args, &scene.repairs, warnings, size, progress);
    report.repairs.extend(picture.iter().filter_map(|picture| picture.repair.clone()));
    let bar = progress.spinner("writing");
    let shown = Shown { scene, mesh, fields: &fields, shading: &shading, colours: &colours };
    report.files = write(&shown, picture.as_ref(), output)?;
    if let Some(sight) = sight.as_ref().filter(|_| mesh.elements.len() <= MOST_SHOWN) {
        let title = Path::new(&args.scene).file_name().unwrap_or_default().to_string_lossy();
        let page = Page {
            title: &title,
            quantity: args.quantity.into(),
            is_solved,
            sight,
            fields: &fields,
            shading: &shading,
            colours: &colours,
        };
        output.page("scene.html", &page)?;
        report.files.push("scene.html");
    }
    drop(bar);
    report.phases = progress.seconds();
    report.files.extend(has_steps.then_some(STEPS));
    report.files.extend(["report.json", "report.html"]);
    output.write("report.json", |file| {
        serde_json::to_writer_pretty(&mut *file, &report)?;
        writeln!(file)
    })?;
    output.write("report.html", |file| {
        let picture = picture.as_ref().map(|picture| png_uri(picture.size, &picture.codes));
        let (picture, row_sums) = (picture.transpose()?, &fields.row_sums[..]);
        let goal = RESIDUAL * args.sum_tolerance();
        report_page::write(file, &report, &Exhibits { picture, row_sums, goal })
    })?;
    Ok(report)
}

/// The picture of a solution.
fn picture(
    args: &Args,
    sight: &Sight<'_>,
    fields: &Fields,
    by_pixel: Option<&ByPixel>,
    progress: &Progress,
) -> Result<Picture, Failure> {
    let bar = progress.bar("rendering");
    let size = args.size.unwrap_or(Picture::SIZE);
    Ok(match args.quantity {
        QuantityName::Light => {
            let nothing = Occluders::new(&[])?;
            let casts = args.visibility != VisibilityName::None;
            let shadows = if casts { sight.occluders() } else { &nothing };
            Picture::of_light(sight, fields, shadows, by_pixel, size, bar.shower())?
        }
        QuantityName::Heat => Picture::of_heat(sight, fields, size, bar.shower())?,
    })
}

/// A solution as it is shown.
struct Shown<'a> {
    scene: &'a Scene,
    mesh: &'a Mesh,
    fields: &'a Fields,
    shading: &'a Shading,
    colours: &'a Colours,
}

/// Writes the picture, if any, and everything about the elements; returns the names of the files.
fn write(
    shown: &Shown<'_>,
    picture: Option<&Picture>,
    output: &mut Output,
) -> Result<Vec<&'static str>, OutputError> {
    let &Shown { scene, mesh, fields, shading, colours } = shown;
    let mut files = Vec::new();
    if let Some(picture) = picture {
        output.png("radiosity.png", picture.size, &picture.codes)?;
        let write_exr = |file: &mut _| exr::write(file, picture.size, &picture.values);
        output.write("radiosity.exr", write_exr)?;
        files.extend(["radiosity.png", "radiosity.exr"]);
    }
    output.ply_mesh("elements.ply", mesh, fields, &colours.codes(fields))?;
    output.glb("elements.glb", scene, mesh, fields, shading, colours)?;
    output.vtu("elements.vtu", mesh, fields)?;
    output.csv("elements.csv", mesh, fields)?;
    output.write("elements.npy", |file| npy::write(file, &Table::new(mesh, fields)?))?;
    files.extend(["elements.ply", "elements.glb", "elements.vtu", "elements.csv", "elements.npy"]);
    Ok(files)
}
