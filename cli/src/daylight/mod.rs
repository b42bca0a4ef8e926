//! `farfield daylight`: what sky, ground and sun give each element of a scene.

mod args;
mod failure;
mod suns;

pub(crate) use args::Args;

use std::io::{self, Write};
use std::path::Path;
use std::process::ExitCode;
use std::sync::atomic::{AtomicUsize, Ordering};

use farfield_radiosity::{Daylight, Surroundings};
use farfield_scenes::{Mesh, Output, Scene, SceneError, Sight, load};
use rayon::prelude::*;

use self::failure::Failure;
use self::suns::Sun;
use crate::csv::quoted;
use crate::interrupt::Interrupt;
use crate::progress::Progress;

/// Does what the command line asks for.
pub(crate) fn main(args: &Args) -> ExitCode {
    match run(args) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("farfield daylight: {failure}");
            ExitCode::FAILURE
        }
    }
}

fn run(args: &Args) -> Result<(), Failure> {
    if !args.out.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("csv")) {
        return Err(Failure::Ending(args.out.clone()));
    }
    let folder = args.out.parent().filter(|folder| !folder.as_os_str().is_empty());
    let mut output = Output::new(folder.unwrap_or(Path::new(".")))?;
    output.check(&args.out)?;
    let interrupt = Interrupt::by_ctrl_c("daylight")?;
    rayon::ThreadPoolBuilder::new().num_threads(args.threads.into()).build_global()?;

    let scene = load(&args.scene).map_err(|error| match error {
        SceneError::Empty => Failure::NoSurfaces(args.scene.clone()),
        error => Failure::Scene(error),
    })?;
    // Into the elements that `farfield radiosity` has.
    let scene = scene.cut_where_surfaces_meet();
    let compass = args.outdoors.compass(&scene)?;
    let suns = args.sun.as_ref().map(|path| suns::read(path, &compass)).transpose()?;
    for what in scene.missing.iter().chain(&scene.doubts).chain(&scene.overlaps()) {
        drop(writeln!(io::stderr(), "farfield daylight: warning: {what}"));
    }
    let mesh = Mesh::new(&scene, args.elements as usize)?;
    let received = received(args, &scene, &mesh, suns.unwrap_or_default())?;
    interrupt.hold(true);
    output.write_at(&args.out, |file| table(file, &scene, &mesh, &received))?;
    Ok(output.publish()?)
}

/// What all elements receive.
struct Received {
    daylight: Vec<Daylight>,
    /// For each position of the sun its name, and the beam on every element.
    suns: Vec<(String, Vec<f64>)>,
}

fn received(args: &Args, scene: &Scene, mesh: &Mesh, suns: Vec<Sun>) -> Result<Received, Failure> {
    let progress = Progress::new(args.quiet);
    let sky = args.outdoors.sky(scene)?;
    let (count, rays) = (mesh.elements.len(), args.rays as usize);
    let sight = Sight::new(scene, mesh)?;
    // No rays of its own: the daylight sends as many as it is asked for.
    let around = Surroundings::new(&mesh.elements, sight.occluders(), 1);
    let bar = progress.bar("sky");
    let (show, done) = (bar.shower(), AtomicUsize::new(0));
    let of_element = |element| {
        let found = around.daylight(element, &sky, rays);
        show(done.fetch_add(1, Ordering::Relaxed) as f64 / count as f64);
        found
    };
    let daylight = (0..count).into_par_iter().map(of_element).collect();
    drop(bar);
    let bar = progress.bar("sun");
    let (show, positions) = (bar.shower(), suns.len());
    let beam = |(k, Sun { time, direction }): (usize, Sun)| {
        show(k as f64 / positions as f64);
        let below = || Ok(vec![0.0; count]);
        let beam = direction.map_or_else(below, |to_sun| around.sunlight(to_sun, rays))?;
        Ok((time, beam))
    };
    let suns = suns.into_iter().enumerate().map(beam).collect::<Result<_, Failure>>()?;
    Ok(Received { daylight, suns })
}

/// A line for each element.
fn table(file: &mut impl Write, scene: &Scene, mesh: &Mesh, received: &Received) -> io::Result<()> {
    let Received { daylight, suns } = received;
    write!(file, "x,y,z,nx,ny,nz,area,material,sky,ground")?;
    suns.iter().try_for_each(|(time, _)| write!(file, ",sun_{time}"))?;
    writeln!(file)?;
    for (i, (element, daylight)) in mesh.elements.iter().zip(daylight).enumerate() {
        let surfel = element.surfel();
        for x in surfel.position.to_array().into_iter().chain(surfel.normal.to_array()) {
            write!(file, "{x},")?;
        }
        let name = quoted(&scene.materials[mesh.material[i] as usize].name);
        let Daylight { sky, ground } = daylight;
        write!(file, "{},{name},{sky:.6},{ground:.6}", surfel.area)?;
        suns.iter().try_for_each(|(_, beam)| write!(file, ",{:.6}", beam[i]))?;
        writeln!(file)?;
    }
    Ok(())
}
