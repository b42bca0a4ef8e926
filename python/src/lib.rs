//! The native part of the Python package `farfield`: plans and sums over contiguous arrays. Shapes and types are the
//! business of `farfield/__init__.py`.

mod exceptions;
mod interrupt;
mod threads;
mod radiosity;

use std::path::PathBuf;

use farfield::{Error, OperatorStore, Point, Real, StoreError, Vector, Watch};
use farfield_formula::{Coincident, Derivatives, Options, Precision, READY, Ready, TextFormula};
use numpy::{Element, PyArray1, PyReadonlyArray1};
use pyo3::exceptions::PyOSError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::exceptions::{InputError, KernelError, exception};
use crate::radiosity::Room;
use crate::threads::Threads;

/// A kernel by name or text, with what holds where points coincide: a number, "skip", "formula", or `None` for what the
/// kernel is known for.
#[pyclass(frozen)]
struct Kernel(TextFormula);

#[pymethods]
impl Kernel {
    #[new]
    fn new(
        name_or_text: &str,
        parameters: Vec<(String, f64)>,
        coincident: Option<&str>,
        value: f64,
    ) -> PyResult<Self> {
        let parameters: Vec<_> = parameters.iter().map(|(name, x)| (name.as_str(), *x)).collect();
        let kernel = Ready::or_text(name_or_text, &parameters)
            .map_err(|error| KernelError::new_err(error.to_string()))?;
        Ok(Self(match coincident {
            None => kernel,
            Some("skip") => kernel.coincident(Coincident::Skip),
            Some("formula") => kernel.coincident(Coincident::Formula),
            Some(_) => kernel.coincident(Coincident::Value(value)),
        }))
    }

    /// Numbers of a value and of a charge.
    #[getter]
    fn shape(&self) -> (usize, usize) {
        (self.0.rows(), self.0.columns())
    }
}

/// A kernel with a name: name, description, formula, parameters with their values.
type Named = (&'static str, &'static str, &'static str, Vec<(&'static str, f64)>);

/// All kernels with a name.
#[pyfunction]
fn kernels() -> Vec<Named> {
    let one = |ready: &Ready| {
        let parameters = ready.parameters.iter().map(|p| (p.name, p.default)).collect();
        (ready.name, ready.about, ready.text, parameters)
    };
    READY.iter().map(one).collect()
}

/// A plan in one precision, and the threads it runs on.
struct Planned<T: Precision> {
    plan: farfield_formula::Plan<T>,
    threads: Threads,
}

impl<T: Precision + Element> Planned<T> {
    fn new(
        py: Python<'_>,
        kernel: &TextFormula,
        sources: &[T],
        targets: &[T],
        options: &Options,
        threads: Option<usize>,
    ) -> PyResult<Self> {
        let threads = Threads::new(threads)?;
        let pairs = sources.len() / 3 * (targets.len() / 3);
        let plan = threads.run(py, pairs, |watch| {
            let (sources, targets) = (points(sources), points(targets));
            farfield_formula::Plan::watched(kernel, &sources, &targets, options, watch)
        })?;
        let plan = plan.map_err(exception)?;
        Ok(Self { plan, threads })
    }

    /// Does work with the plan.
    fn run<R: Send>(
        &self,
        py: Python<'_>,
        columns: usize,
        work: impl FnOnce(&farfield_formula::Plan<T>, &Watch) -> Result<R, Error> + Send,
    ) -> PyResult<R> {
        let pairs = self.plan.sources() * self.plan.targets() * columns;
        self.threads.run(py, pairs, |watch| work(&self.plan, watch))?.map_err(exception)
    }

    fn transposed(&self, py: Python<'_>) -> PyResult<Self> {
        let plan = self.run(py, 1, |plan, watch| plan.transposed(watch))?;
        Ok(Self { plan, threads: Threads::new(self.threads.count)? })
    }
}

fn points<T: Real>(coordinates: &[T]) -> Vec<Point<T>> {
    let point = |p: &[T; 3]| Point::<T>::from_array(*p);
    coordinates.as_chunks::<3>().0.iter().map(point).collect()
}

macro_rules! plan {
    ($name:ident, $real:ty) => {
        /// A plan over flat arrays in one precision.
        #[pyclass(frozen)]
        struct $name(Planned<$real>);

        #[pymethods]
        impl $name {
            #[new]
            #[expect(clippy::too_many_arguments, reason = "called by one line of Python")]
            fn new(
                py: Python<'_>,
                kernel: PyRef<'_, Kernel>,
                sources: PyReadonlyArray1<'_, $real>,
                targets: PyReadonlyArray1<'_, $real>,
                tolerance: f64,
                derivatives: usize,
                applications: usize,
                columns: usize,
                threads: Option<usize>,
            ) -> PyResult<Self> {
                let mut options = Options::default();
                options.tolerance = tolerance;
                options.derivatives = match derivatives {
                    0 => Derivatives::None,
                    1 => Derivatives::Gradient,
                    _ => Derivatives::Hessian,
                };
                options.applications = applications;
                options.columns = columns;
                // Copies: another thread of Python might write to the arrays meanwhile.
                let (sources, targets) =
                    (sources.as_slice()?.to_vec(), targets.as_slice()?.to_vec());
                let kernel = kernel.0.clone();
                Ok(Self(Planned::new(py, &kernel, &sources, &targets, &options, threads)?))
            }

            /// The sums for flat charges of so many right-hand sides.
            fn apply<'py>(
                &self,
                py: Python<'py>,
                charges: PyReadonlyArray1<'_, $real>,
                columns: usize,
            ) -> PyResult<Bound<'py, PyArray1<$real>>> {
                let charges = charges.as_slice()?.to_vec();
                let sums = |plan: &farfield_formula::Plan<$real>, watch: &Watch| {
                    plan.apply_columns(&charges, columns, watch)
                };
                Ok(PyArray1::from_vec(py, self.0.run(py, columns, sums)?))
            }

            /// The plan for the transposed matrix.
            fn transposed(&self, py: Python<'_>) -> PyResult<Self> {
                Ok(Self(self.0.transposed(py)?))
            }

            /// How far the sums are from the exact ones.
            fn certificate<'py>(
                &self,
                py: Python<'py>,
                charges: PyReadonlyArray1<'_, $real>,
            ) -> PyResult<Bound<'py, PyDict>> {
                let charges = charges.as_slice()?.to_vec();
                let (_, found) =
                    self.0.run(py, 1, |plan, watch| plan.apply_certified(&charges, watch))?;
                let certificate = PyDict::new(py);
                certificate.set_item("relative_l2", found.relative_l2)?;
                certificate.set_item("estimate", found.estimate)?;
                certificate.set_item("confidence", found.confidence)?;
                certificate.set_item("samples", found.samples)?;
                certificate.set_item("condition", found.condition)?;
                Ok(certificate)
            }

            /// What the plan consists of.
            fn report<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
                let found = self.0.plan.report();
                let report = PyDict::new(py);
                report.set_item("scheme", found.stats.scheme.to_string())?;
                report.set_item("fallback", found.stats.fallback.clone())?;
                report.set_item("sources", found.stats.sources)?;
                report.set_item("targets", found.stats.targets)?;
                report.set_item("cells", found.stats.cells)?;
                report.set_item("depth", found.stats.depth)?;
                report.set_item("leaf_size", found.stats.leaf_size)?;
                report.set_item("expansion_pairs", found.stats.expansion_pairs)?;
                report.set_item("direct_pairs", found.stats.direct_pairs)?;
                report.set_item("left_out_pairs", found.stats.left_out_pairs)?;
                report.set_item("bytes", found.stats.plan_bytes() + found.stats.workspace_bytes)?;
                report.set_item("text", found.to_string())?;
                Ok(report)
            }
        }
    };
}

plan!(PlanF64, f64);
plan!(PlanF32, f32);

/// Reads sets of operators from a folder for later plans; returns how many it found.
#[pyfunction]
fn load_operators(py: Python<'_>, folder: PathBuf) -> PyResult<usize> {
    py.detach(|| OperatorStore::of_process().load(&folder)).map_err(store_exception)
}

/// Writes the sets of operators of all plans so far to a folder; returns how many of them it now has.
#[pyfunction]
fn save_operators(py: Python<'_>, folder: PathBuf) -> PyResult<usize> {
    py.detach(|| OperatorStore::of_process().save(&folder)).map_err(store_exception)
}

fn store_exception(error: StoreError) -> PyErr {
    match error {
        StoreError::Io { .. } => PyOSError::new_err(error.to_string()),
        _ => InputError::new_err(error.to_string()),
    }
}

/// The module `farfield._native`.
#[pymodule]
fn _native(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Kernel>()?;
    module.add_class::<PlanF64>()?;
    module.add_class::<PlanF32>()?;
    module.add_class::<Room>()?;
    module.add_function(wrap_pyfunction!(load_operators, module)?)?;
    module.add_function(wrap_pyfunction!(save_operators, module)?)?;
    module.add_function(wrap_pyfunction!(kernels, module)?)
}
