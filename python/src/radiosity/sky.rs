//! What faces see of the sky.

use farfield::Watch;
use farfield::glam::DVec3;
use farfield_radiosity::{Daylight, Sky, Surroundings};
use farfield_scenes::{Mesh, Scene, Sight};
use rayon::prelude::*;

use super::{Failure, check, faces_of};

/// For each face what it sees of the sky, which is uniform or overcast, and of the ground around, by so many rays; NaN for
/// faces that were dropped.
pub(super) fn daylight(
    scene: &Scene,
    faces: usize,
    (zenith, overcast): (DVec3, bool),
    rays: usize,
    watch: &Watch,
) -> Result<Vec<[f64; 2]>, Failure> {
    let sky = if overcast { Sky::overcast(zenith) } else { Sky::uniform(zenith) }?;
    let mesh = Mesh::with_cuts(scene, &vec![[1, 1]; scene.surfaces.len()])?;
    let sight = Sight::new(scene, &mesh)?;
    // No rays of its own: the daylight sends as many as it is asked for.
    let around = Surroundings::new(&mesh.elements, sight.occluders(), 1);
    let of = |element| {
        let stopped = watch.is_stopped();
        if stopped { Daylight::default() } else { around.daylight(element, &sky, rays) }
    };
    let found: Vec<Daylight> = (0..mesh.elements.len()).into_par_iter().map(of).collect();
    check(watch)?;
    let (mut sums, mut areas) = (vec![[0.0; 2]; faces], vec![0.0; faces]);
    for ((found, element), &surface) in found.iter().zip(&mesh.elements).zip(&mesh.origin) {
        let (face, area) = (faces_of(scene)[surface as usize] as usize, element.surfel().area);
        sums[face][0] += area * found.sky;
        sums[face][1] += area * found.ground;
        areas[face] += area;
    }
    let mean = |(sums, area): ([f64; 2], f64)| {
        sums.map(|sum| if area > 0.0 { sum / area } else { f64::NAN })
    };
    Ok(sums.into_iter().zip(areas).map(mean).collect())
}
