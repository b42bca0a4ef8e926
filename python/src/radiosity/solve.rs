//! The radiosity equation, on elements as small as the tolerance takes.

use std::ops::ControlFlow;

use farfield::{Fmm, Watch};
use farfield_radiosity::{
    Error, Irradiance, RadiosityOperator, Stop, Surfel, Surroundings, Visibility,
    conjugate_gradients,
};
use farfield_scenes::{
    Mesh, Optics, Quantity, Refinement, Scene, Sight, even_cuts, with_lamps_cut,
};

use super::{Failure, check, faces_of};

/// Elements of the first mesh beyond one per surface; meshes at most.
const FIRST_ELEMENTS: usize = 2000;
const MOST_MESHES: usize = 6;
/// What the residual may be, in units of the tolerance, and iterations at most.
const RESIDUAL: f64 = 1e-2;
const MOST_ITERATIONS: usize = 2000;
/// Points per leaf: pairs cost little, since it is remembered whether they see each other.
const LEAF_SIZE: usize = 128;
/// Rays in all that tell where the light of elements goes, and from each element at least and at most.
const ALL_RAYS: usize = 1 << 18;
const LEAST_RAYS: usize = 4;
const MOST_RAYS: usize = 512;
/// The most that a form factor may have to change for a row to sum to 1.
const MOST_CLOSURE: f64 = 0.5;

/// The light of faces: the means over their elements, and 0 for those that were dropped.
pub(super) struct Found {
    /// Radiosity and irradiance of each face, band by band.
    pub(super) radiosity: Vec<f64>,
    pub(super) irradiance: Vec<f64>,
    /// The sum of the form factors of each face to all others.
    pub(super) row_sums: Vec<f64>,
    pub(super) areas: Vec<f64>,
    pub(super) elements: usize,
    pub(super) iterations: usize,
    pub(super) residual: f64,
    /// The relative l2 error of one constant per element, if it is known.
    pub(super) element_error: Option<f64>,
    /// How far rows of form factors are off, in the root mean square.
    pub(super) factor_error: f64,
    /// How often light is reflected, on average, where some of it leaves the scene.
    pub(super) reflections: f64,
}

/// The light in a scene, on at most so many elements unless it has more surfaces.
pub(super) fn solve(
    scene: &Scene,
    faces: usize,
    most: usize,
    tolerance: f64,
    watch: &Watch,
) -> Result<Found, Failure> {
    let scene = scene.clone().cut_where_surfaces_meet();
    let finer = |cuts| with_lamps_cut(&scene, Quantity::Light, cuts, most);
    let mut cuts = finer(even_cuts(&scene, most.min(scene.surfaces.len() + FIRST_ELEMENTS))?);
    let mut meshes = 1;
    loop {
        let mesh = Mesh::with_cuts(&scene, &cuts)?;
        let lit = if scene.bands() == 1 {
            Lit::new::<1>(&scene, &mesh, tolerance, watch)
        } else {
            Lit::new::<3>(&scene, &mesh, tolerance, watch)
        }?;
        let mut next = Refinement::new(&scene, &mesh, &lit.irradiance, tolerance, most);
        next.cuts = finer(next.cuts);
        let is_fine = next.error.is_some_and(|error| error <= tolerance);
        if is_fine || meshes == MOST_MESHES || next.cuts == cuts {
            return Ok(lit.over_faces(&scene, &mesh, faces, next.error));
        }
        cuts = next.cuts;
        meshes += 1;
    }
}

/// The light of all elements of one mesh.
struct Lit {
    bands: usize,
    radiosity: Vec<f64>,
    irradiance: Vec<f64>,
    row_sums: Vec<f64>,
    iterations: usize,
    residual: f64,
    factor_error: f64,
    reflections: f64,
}

impl Lit {
    fn new<const BANDS: usize>(
        scene: &Scene,
        mesh: &Mesh,
        tolerance: f64,
        watch: &Watch,
    ) -> Result<Self, Failure> {
        let elements = &mesh.elements;
        let surfels: Vec<Surfel> = elements.iter().map(|element| *element.surfel()).collect();
        let sight = Sight::new(scene, mesh)?;
        let visibility = Visibility::of_elements(sight.occluders(), elements);
        let kernel = Irradiance::<f64, [f64; BANDS]>::clamped();
        let builder = Fmm::builder(kernel).tolerance(tolerance).mask(&visibility).watch(watch);
        let fmm = builder.leaf_size(LEAF_SIZE).build(&surfels, &surfels)?;
        let corrections = visibility.corrections(elements, tolerance)?;
        let gather = |b: &[[f64; BANDS]]| fmm.apply_watched(b, watch);
        let mut operator = RadiosityOperator::new(elements, gather, corrections)?;
        let rays = (ALL_RAYS / elements.len().max(1)).clamp(LEAST_RAYS, MOST_RAYS);
        let around = Surroundings::new(elements, sight.occluders(), rays);
        operator.leave_out(around.buried())?;
        let row_sums = operator.row_sums()?;
        let factor_error = around.row_error(&row_sums);
        let parts = close(&mut operator, scene, &around)?;

        let bands = scene.bands();
        let zeros = || vec![0.0; elements.len() * bands];
        let (radiosity, irradiance) = (zeros(), zeros());
        let mut lit = Self {
            bands,
            radiosity,
            irradiance,
            row_sums,
            iterations: 0,
            residual: 0.0,
            factor_error,
            reflections: 0.0,
        };
        for first in (0..bands).step_by(BANDS) {
            let optics = Optics::<BANDS>::new(scene, mesh, Quantity::Light, bands, first);
            let balance = operator.balance(&optics.emission, &optics.reflectance)?;
            let stop = Stop { tolerance: RESIDUAL * tolerance, max_iterations: MOST_ITERATIONS };
            let going = |_, _| {
                if watch.is_stopped() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
            };
            let reflectance = &optics.reflectance[..];
            let apply = |b: &[[f64; BANDS]]| balance.apply(b);
            let found = balance.solve(reflectance, |emission| {
                conjugate_gradients(&surfels, emission, reflectance, stop, apply, going)
            })?;
            check(watch)?;
            lit.iterations += found.iterations;
            lit.residual = lit.residual.max(found.residual);
            let open =
                || surfels.iter().zip(&parts).enumerate().filter(|(_, (_, part))| part.is_none());
            for k in 0..BANDS {
                let sum = |light: &[[f64; BANDS]]| -> f64 {
                    open().map(|(i, (surfel, _))| surfel.area * light[i][k]).sum()
                };
                let emitted = sum(&optics.emission);
                let reflected = sum(&found.radiosity) - emitted;
                let reflections = if emitted > 0.0 { reflected / emitted } else { 0.0 };
                lit.reflections = lit.reflections.max(reflections);
            }
            for k in first..(first + BANDS).min(bands) {
                let of_band = |rows: &[[f64; BANDS]], field: &mut [f64]| {
                    let places = field.iter_mut().skip(k).step_by(bands);
                    places.zip(rows).for_each(|(place, row)| *place = row[k - first]);
                };
                of_band(&found.radiosity, &mut lit.radiosity);
                of_band(&found.irradiance, &mut lit.irradiance);
            }
        }
        lit.take_negative(scene, mesh, tolerance)?;
        Ok(lit)
    }

    /// Sets irradiances to 0 that sums, which are off by the tolerance, have left below it.
    fn take_negative(&mut self, scene: &Scene, mesh: &Mesh, tolerance: f64) -> Result<(), Failure> {
        let area = |i: usize| mesh.elements[i].surfel().area;
        let total: f64 = (0..mesh.elements.len()).map(area).sum();
        for band in 0..self.bands {
            let of_band = |i: usize| i * self.bands + band;
            let square = |i: usize| area(i) * self.irradiance[of_band(i)].powi(2);
            let rms = ((0..mesh.elements.len()).map(square).sum::<f64>() / total).sqrt();
            for (i, &surface) in mesh.origin.iter().enumerate() {
                let h = &mut self.irradiance[i * self.bands + band];
                if *h < -tolerance * rms {
                    let face = faces_of(scene)[surface as usize];
                    return Err(Failure::BelowZero { face, found: *h / rms });
                }
                *h = h.max(0.0);
            }
        }
        Ok(())
    }

    fn over_faces(self, scene: &Scene, mesh: &Mesh, faces: usize, error: Option<f64>) -> Found {
        let mut areas = vec![0.0; faces];
        let of: Vec<usize> =
            mesh.origin.iter().map(|&surface| faces_of(scene)[surface as usize] as usize).collect();
        for (&face, element) in of.iter().zip(&mesh.elements) {
            areas[face] += element.surfel().area;
        }
        let mean = |field: &[f64], bands: usize| {
            let mut means = vec![0.0; faces * bands];
            for ((&face, element), row) in of.iter().zip(&mesh.elements).zip(field.chunks(bands)) {
                let share = element.surfel().area / areas[face];
                let means = means[face * bands..][..bands].iter_mut();
                means.zip(row).for_each(|(mean, value)| *mean += share * value);
            }
            means
        };
        Found {
            radiosity: mean(&self.radiosity, self.bands),
            irradiance: mean(&self.irradiance, self.bands),
            row_sums: mean(&self.row_sums, 1),
            areas,
            elements: mesh.elements.len(),
            iterations: self.iterations,
            residual: self.residual,
            element_error: error,
            factor_error: self.factor_error,
            reflections: self.reflections,
        }
    }
}

/// Closes the parts of a scene that no ray leaves, if its mesh has no gaps, and returns which they are; those that can't be
/// closed stay open.
fn close<const BANDS: usize>(
    operator: &mut RadiosityOperator<'_, BANDS>,
    scene: &Scene,
    around: &Surroundings<'_>,
) -> Result<Vec<Option<u32>>, Error> {
    let open = vec![None; around.closed_parts().len()];
    let parts = if scene.watertight { around.closed_parts().to_vec() } else { open.clone() };
    match operator.close_parts(parts.clone(), MOST_CLOSURE) {
        Err(Error::NotClosable { .. } | Error::NotClosed { .. }) if scene.watertight => {
            operator.close_parts(open.clone(), MOST_CLOSURE)?;
            Ok(open)
        }
        closure => closure.map(|_| parts),
    }
}
