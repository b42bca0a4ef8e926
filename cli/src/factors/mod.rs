//! `farfield factors`: form factors between whole surfaces, summed over groups.

mod args;
mod failure;
mod groups;
mod matrix;
mod table;

pub(crate) use args::Args;

use std::ffi::OsStr;
use std::io::{self, Write};
use std::path::Path;
use std::process::ExitCode;

use farfield_radiosity::{Occluders, Triangle};
use farfield_scenes::{Output, Scene, SceneError, View3d, load};

use self::args::By;
use self::failure::Failure;
use self::groups::Groups;
use self::matrix::Matrix;
use crate::interrupt::Interrupt;
use crate::progress::Progress;

/// Does what the command line asks for.
pub(crate) fn main(args: &Args) -> ExitCode {
    match run(args) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("farfield factors: {failure}");
            ExitCode::FAILURE
        }
    }
}

fn run(args: &Args) -> Result<(), Failure> {
    let format = args.out.extension().and_then(OsStr::to_str).unwrap_or_default();
    match (format, args.sparse) {
        ("csv", _) | ("npy" | "txt", None) => (),
        ("npy" | "txt", Some(_)) => return Err(Failure::Sparse(args.out.clone())),
        _ => return Err(Failure::Ending(args.out.clone())),
    }
    let folder = args.out.parent().filter(|folder| !folder.as_os_str().is_empty());
    let mut output = Output::new(folder.unwrap_or(Path::new(".")))?;
    output.check(&args.out)?;
    let interrupt = Interrupt::by_ctrl_c("factors")?;
    rayon::ThreadPoolBuilder::new().num_threads(args.threads.into()).build_global()?;
    let (matrix, controls) = factors(args)?;
    interrupt.hold(true);
    output.write_at(&args.out, |file| match (format, args.sparse) {
        ("npy", _) => table::npy(file, &matrix),
        ("txt", _) => table::view3d(file, &matrix, controls),
        (_, Some(least)) => table::sparse(file, &matrix, least),
        _ => table::csv(file, &matrix),
    })?;
    Ok(output.publish()?)
}

/// The factors, and the controls of View3D that they are made for.
fn factors(args: &Args) -> Result<(Matrix, [u32; 3]), Failure> {
    let path = Path::new(&args.scene);
    let is_view3d = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("vs3"));
    let progress = Progress::new(args.quiet);
    let matrix = |groups: Groups, scene: &Scene| {
        let bar = progress.bar("factors");
        Matrix::new(groups, &occluders(scene)?, args.tolerance, bar.shower())
    };
    if is_view3d && args.by.is_none() {
        let found = View3d::read(path)?;
        found.scene.check()?;
        let matrix = matrix(Groups::of_view3d(&found)?, &found.scene)?;
        let reflects = found.controls[2] == 1;
        let matrix = if reflects { matrix.reflecting()? } else { matrix };
        return Ok((between(matrix, args, "surfaces")?, found.controls));
    }
    let scene = load(&args.scene).map_err(|error| match error {
        SceneError::Empty => Failure::NoSurfaces(args.scene.clone()),
        error => Failure::Scene(error),
    })?;
    if let Some(what) = scene.overlaps() {
        drop(writeln!(io::stderr(), "farfield factors: warning: {what}"));
    }
    // Surfaces of meshes have no names of their own.
    let default = if args.between.is_empty() { By::Surface } else { By::Material };
    let by = args.by.unwrap_or(default);
    let kind = match by {
        By::Surface => "surfaces",
        By::Material => "materials",
        By::File => "files",
    };
    let matrix = matrix(Groups::of_scene(&scene, by)?, &scene)?;
    Ok((between(matrix, args, kind)?, [1, u32::from(scene.closed), 0]))
}

/// The factors between what was asked for, of this kind.
fn between(matrix: Matrix, args: &Args, kind: &'static str) -> Result<Matrix, Failure> {
    if args.between.is_empty() {
        return Ok(matrix);
    }
    matrix.between(&args.between).map_err(|name| {
        let mut names: Vec<&str> = matrix.groups.iter().map(|group| &group.name[..]).collect();
        names.dedup();
        let more = names.len().saturating_sub(SHOWN);
        names.truncate(SHOWN);
        let known = names.iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ");
        let known = if more > 0 { format!("{known} and {more} more") } else { known };
        Failure::Unnamed { name, kind, known }
    })
}

/// Names that a refusal lists.
const SHOWN: usize = 12;

/// What hides: all surfaces, in triangles.
fn occluders(scene: &Scene) -> Result<Occluders, farfield_radiosity::Error> {
    let triangles = scene.surfaces.iter().flat_map(|surface| {
        let (corners, face) = (scene.corners(surface), surface.face);
        (2..corners.len())
            .map(move |k| Triangle { vertices: [corners[0], corners[k - 1], corners[k]], face })
    });
    Occluders::new(&triangles.collect::<Vec<_>>())
}
