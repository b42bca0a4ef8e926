//! Light between the faces of a mesh: solved for, as form factors, and what they see of the sky.

mod factors;
mod sky;
mod solve;

use std::collections::HashMap;

use farfield::Watch;
use farfield::glam::DVec3;
use farfield_radiosity::Error;
use farfield_scenes::{Material, Scene, SceneError};
use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::exceptions::{InputError, SumError, exception};
use crate::threads::Threads;

/// A mesh whose faces exchange light, in flat arrays.
#[pyclass(frozen)]
pub(crate) struct Room {
    scene: Scene,
    /// How many faces there are, those that were dropped included.
    faces: usize,
    threads: Threads,
}

#[pymethods]
impl Room {
    /// `sizes` has the number of corners of each face, `optics` for each face its reflectances, then its emissions, of
    /// as many bands.
    #[new]
    fn new(
        vertices: PyReadonlyArray1<'_, f64>,
        corners: PyReadonlyArray1<'_, u32>,
        sizes: PyReadonlyArray1<'_, u32>,
        optics: PyReadonlyArray1<'_, f64>,
        bands: usize,
        threads: Option<usize>,
    ) -> PyResult<Self> {
        let vertices = vertices.as_slice()?.as_chunks::<3>().0.iter().map(|&p| p.into());
        let vertices: Vec<DVec3> = vertices.collect();
        let (mut rest, sizes) = (corners.as_slice()?, sizes.as_slice()?);
        let (materials, of_face) = materials(optics.as_slice()?, bands);
        let faces = sizes.iter().zip(of_face).map(|(&size, material)| {
            let (corners, others) = rest.split_at((size as usize).min(rest.len()));
            rest = others;
            (corners, material)
        });
        let scene = Scene::from_faces(&vertices, faces, materials).map_err(refusal)?;
        Ok(Self { scene, faces: sizes.len(), threads: Threads::new(threads)? })
    }

    /// What was mended, and what may be meant otherwise, one sentence each.
    fn notes(&self) -> Vec<String> {
        let Scene { repairs, doubts, .. } = &self.scene;
        repairs.iter().chain(doubts).cloned().chain(self.scene.overlaps()).collect()
    }

    /// The radiosity equation, solved on at most so many elements.
    fn solve<'py>(
        &self,
        py: Python<'py>,
        elements: usize,
        tolerance: f64,
    ) -> PyResult<Bound<'py, PyDict>> {
        let work = |watch: &_| solve::solve(&self.scene, self.faces, elements, tolerance, watch);
        let found = self.threads.run(py, usize::MAX, work)?.map_err(Failure::exception)?;
        let solution = PyDict::new(py);
        solution.set_item("radiosity", PyArray1::from_vec(py, found.radiosity))?;
        solution.set_item("irradiance", PyArray1::from_vec(py, found.irradiance))?;
        solution.set_item("row_sums", PyArray1::from_vec(py, found.row_sums))?;
        solution.set_item("areas", PyArray1::from_vec(py, found.areas))?;
        solution.set_item("elements", found.elements)?;
        solution.set_item("iterations", found.iterations)?;
        solution.set_item("residual", found.residual)?;
        solution.set_item("element_error", found.element_error)?;
        solution.set_item("factor_error", found.factor_error)?;
        solution.set_item("reflections", found.reflections)?;
        Ok(solution)
    }

    /// Form factors that are not 0: rows, columns, values.
    fn form_factors<'py>(&self, py: Python<'py>, tolerance: f64) -> PyResult<Triples<'py>> {
        let work = |watch: &_| factors::factors(&self.scene, self.faces, tolerance, watch);
        let found = self.threads.run(py, usize::MAX, work)?.map_err(Failure::exception)?;
        let (rows, (columns, values)) =
            found.into_iter().map(|(i, j, factor)| (i, (j, factor))).unzip();
        let rows = PyArray1::from_vec(py, rows);
        Ok((rows, PyArray1::from_vec(py, columns), PyArray1::from_vec(py, values)))
    }

    /// For each face what it sees of the sky, and of the ground around.
    fn daylight<'py>(
        &self,
        py: Python<'py>,
        zenith: [f64; 3],
        overcast: bool,
        rays: usize,
    ) -> PyResult<(Numbers<'py>, Numbers<'py>)> {
        let work = |watch: &_| {
            sky::daylight(&self.scene, self.faces, (zenith.into(), overcast), rays, watch)
        };
        let found = self.threads.run(py, usize::MAX, work)?.map_err(Failure::exception)?;
        let (sky, ground) = found.into_iter().map(|[sky, ground]| (sky, ground)).unzip();
        Ok((PyArray1::from_vec(py, sky), PyArray1::from_vec(py, ground)))
    }
}

type Numbers<'py> = Bound<'py, PyArray1<f64>>;
type Indices<'py> = Bound<'py, PyArray1<u32>>;

/// Rows, columns and values.
type Triples<'py> = (Indices<'py>, Indices<'py>, Numbers<'py>);

/// Materials of which no two are alike, and which of them each face has.
fn materials(optics: &[f64], bands: usize) -> (Vec<Material>, Vec<usize>) {
    let (mut materials, mut known) = (Vec::new(), HashMap::new());
    let faces = optics.chunks(2 * bands.max(1)).enumerate().map(|(face, numbers)| {
        let bits: Vec<u64> = numbers.iter().map(|number| number.to_bits()).collect();
        *known.entry(bits).or_insert_with(|| {
            let (reflectance, emission) = numbers.split_at(bands);
            materials.push(Material {
                name: format!("that of face {face}"),
                reflectance: reflectance.to_vec(),
                emission: emission.to_vec(),
                ..Material::grey()
            });
            materials.len() - 1
        })
    });
    let of_face = faces.collect();
    (materials, of_face)
}

/// The face that each surface of a scene is of.
fn faces_of(scene: &Scene) -> &[u32] {
    scene.parts.first().map_or(&[], |part| &part.numbers)
}

/// That work goes on.
fn check(watch: &Watch) -> Result<(), Failure> {
    if watch.is_stopped() { Err(farfield::Error::Stopped.into()) } else { Ok(()) }
}

/// Why there is no result.
enum Failure {
    Scene(SceneError),
    Exchange(Error),
    /// Light further below zero than the tolerance explains: where, and how far in units of the root mean square.
    BelowZero {
        face: u32,
        found: f64,
    },
}

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        Self::Exchange(error)
    }
}

impl From<farfield::Error> for Failure {
    fn from(error: farfield::Error) -> Self {
        Self::Exchange(error.into())
    }
}

impl From<SceneError> for Failure {
    fn from(error: SceneError) -> Self {
        Self::Scene(error)
    }
}

impl Failure {
    /// The exception that says it.
    fn exception(self) -> PyErr {
        match self {
            Self::Scene(error) => refusal(error),
            Self::Exchange(Error::Sum(error)) => exception(error),
            Self::Exchange(
                error @ (Error::NotConverged { .. }
                | Error::Stagnated { .. }
                | Error::Diverged { .. }
                | Error::NotPositiveDefinite { .. }),
            ) => SumError::new_err(error.to_string()),
            Self::Exchange(error) => InputError::new_err(error.to_string()),
            Self::BelowZero { face, found } => SumError::new_err(format!(
                "the irradiance of face {face} is {found:.1e} times the root mean square: expected 0 or more; more \
                 elements do better"
            )),
        }
    }
}

/// What a scene is refused for.
fn refusal(error: SceneError) -> PyErr {
    InputError::new_err(error.to_string())
}
