//! Fast multipole sums for any kernel.
//!
//! `farfield` computes
//!
//! ```text
//! u(x_i) = Σ_j K(x_i, y_j) q_j
//! ```
//!
//! over N points in O(N) instead of O(N²), for any kernel K that is smooth away from its diagonal, to the
//! tolerance asked for. A formula is enough:
//!
//! ```
//! use farfield::glam::DVec3;
//! use farfield::{Fmm, direct, formula, relative_l2_error};
//!
//! let points: Vec<DVec3> = (1..1000).map(|i| (DVec3::new(0.2, 0.3, 0.5) * f64::from(i * i)).fract()).collect();
//! let charges = vec![1.0; points.len()];
//!
//! let kernel = formula!(|d| (-d.length()).exp());
//! let fmm = Fmm::builder(&kernel).tolerance(1e-6).build(&points, &points)?;
//! let potentials = fmm.apply(&charges)?;
//!
//! assert!(relative_l2_error(&potentials, &direct(&kernel, &points, &charges, &points)?) < 1e-6);
//! # Ok::<(), farfield::Error>(())
//! ```
//!
//! # What to write
//!
//! | you have | you write |
//! |---|---|
//! | a formula | [`formula!`], a [`Formula`], or a closure for [`from_fn`] |
//! | a formula, and you want derivatives of the sum | [`FormulaKernel::gradient`], [`FormulaKernel::hessian`], [`FnKernel::gradient`] |
//! | attributes on the points (normals, areas, …) | [`Kernel`]: the formula, what a source sends, what a target makes of it |
//! | an analytic expansion | [`Expansion`]: P2M, M2M, M2L, L2L, L2P; held to its laws by [`conformance::check`] |
//! | points that move | nothing more: [`Fmm::update`] |
//! | points that are repeated along one, two or three axes | their periods: [`Builder::periodic`] |
//! | near interactions of your own (boundary elements) | the sums over [`Fmm::near_pairs`] |
//! | pairs that must not count (occlusion, exclusions) | [`Mask`]: what holds between two cells, and for one pair |
//!
//! The [`guide`] explains the method and each of these, step by step.
//!
//! Features: `ndarray` takes rows of arrays as points (`rows_as_points`), `serde` serialises reports.
//!
//! # What to expect
//!
//! [`Fmm`] is a plan: built once from the points, applied to any number of charges. Results have the
//! same bits for any number of threads. Input that can't be summed gets an [`Error`] that names it.
//! [`direct`] is the reference for everything.

// Each folder imports only from those above it.
mod dispatch_level;
mod error;
mod parallel;
mod linalg;
mod numbers;
mod octree;
mod kernel;
mod expansion;
mod interaction;
mod interpolation;
mod plan;
mod periodic;
mod certificate;
pub mod conformance;
pub mod guide;

pub use certificate::Certificate;
pub use certificate::sampling::Sampling;
pub use dispatch_level::{DispatchLevel, UnknownDispatchLevel, dispatch};
pub use error::{Error, PointSet};
pub use expansion::admissibility::Admissibility;
pub use expansion::costs::Costs;
pub use expansion::geometry::{Geometry, Level, Strength};
pub use expansion::level_cells::{LevelFamilies, LevelPairs};
pub use expansion::offset_map::OffsetMap;
pub use expansion::weights::Weights;
pub use expansion::{ChargeOf, Expansion, RealOf, SourceOf, TargetOf, ValueOf};
pub use interpolation::black_box::Interpolation;
pub use interpolation::store::OperatorStore;
pub use interpolation::store_error::StoreError;
pub use interpolation::tuning::MAX_ORDER;
pub use kernel::closure::{FnGradient, FnKernel, from_fn};
pub use kernel::derivatives::{Derivatives, WithHessian};
pub use kernel::direct::{direct, direct_watched, relative_l2_error};
pub use kernel::formula::{Difference, Form, Formula, FormulaEntry, Positions};
pub use kernel::formula_kernel::{FormulaGradient, FormulaKernel, from_formula};
pub use kernel::mask::{CellView, Coverage, Mask, Unmasked, direct_masked};
pub use kernel::ordinary::OrdinaryDistances;
pub use kernel::traits::{Kernel, Outcome};
pub use kernel::with_gradient::WithGradient;
pub use numbers::extended::Extended;
pub use numbers::math;
pub use numbers::number::{Coordinates, Number};
#[cfg(feature = "ndarray")]
pub use numbers::rows::rows_as_points;
pub use numbers::traits::{Located, Movable, Numbers, Point, Real, Scalar, Vector};
pub use octree::geometry::{Cell, Cube, MAX_LEVEL};
pub use parallel::watch::{Phase, Progress, Watch};
pub use periodic::builder::{Periodic, PeriodicBuilder};
pub use plan::Scheme;
pub use plan::builder::Builder;
pub use plan::estimate::Estimate;
pub use plan::fmm::Fmm;
pub use plan::near_pairs::NearBlock;
pub use plan::part::{Part, PartCell, PartLists, PartMoments};
pub use plan::report::{LevelReport, Report};
pub use plan::stats::Stats;
pub use plan::times::{ApplyTimes, BuildTimes};
pub use {glam, num_complex};
