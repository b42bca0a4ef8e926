//! Fast multipole sums for any kernel.
//!
//! `farfield` computes
//!
//! ```text
//! u(x_i) = Σ_j K(x_i, y_j) q_j
//! ```
//!
//! over N points in O(N) instead of O(N²), for any kernel K that is smooth away from its diagonal. A
//! formula is enough:
//!
//! ```
//! use farfield::{Fmm, direct, from_fn, relative_l2_error};
//! use glam::DVec3;
//!
//! let points: Vec<DVec3> = (1..1000).map(|i| (DVec3::new(0.2, 0.3, 0.5) * f64::from(i * i)).fract()).collect();
//! let charges = vec![1.0; points.len()];
//!
//! let kernel = from_fn(|x: DVec3, y: DVec3| (-x.distance(y)).exp());
//! let fmm = Fmm::builder(kernel).tolerance(1e-6).build(&points, &points)?;
//! let potentials = fmm.apply(&charges)?;
//!
//! assert!(relative_l2_error(&potentials, &direct(&kernel, &points, &charges, &points)) < 1e-6);
//! # Ok::<(), farfield::Error>(())
//! ```
//!
//! # What to implement
//!
//! | you have | you write |
//! |---|---|
//! | a formula | a closure for [`from_fn`] |
//! | a formula and attributes on the points (normals, areas, …) | [`Kernel`], one method; [`PointKernel`], three short ones, for the black-box [`Interpolation`] |
//! | an analytic expansion | [`Expansion`]: P2M, M2M, M2L, L2L, L2P; held to its laws by [`conformance::check`] |
//! | pairs that must not count (occlusion, exclusions) | [`Mask`], two methods |
//!
//! # What to expect
//!
//! [`Fmm`] is a plan: built once from the points, applied to any number of charges. Results have the
//! same bits for any number of threads. Input that can't be summed gets an [`Error`] that names it.
//! [`direct`] is the reference for everything.

// Each module imports only from those above it.
mod dispatch_level;
mod estimate;
mod error;
mod products;
mod dense;
mod real;
mod random;
mod parallel;
mod double_word;
mod geometry;
mod morton;
mod shape;
mod dispatch;
mod kernel;
mod expansion;
mod pool;
mod chebyshev;
mod probe;
mod interpolation;
mod tree;
mod mask;
mod grouped;
mod offsets;
mod lists;
mod cell_mask;
mod traversal;
mod survey;
mod grove;
mod layout;
mod times;
mod near;
mod plan;
mod passes;
mod judge;
mod sampling;
mod stats;
mod pace;
mod forecast;
mod choice;
mod fmm;
mod builder;
mod certificate;
mod report;
mod exact;
pub mod conformance;

pub use builder::Builder;
pub use certificate::Certificate;
pub use dispatch_level::{DispatchLevel, UnknownDispatchLevel, dispatch};
pub use error::{Error, PointSet};
pub use estimate::Estimate;
pub use expansion::{
    ChargeOf, Expansion, Geometry, Level, LevelFamilies, LevelPairs, OffsetMap, RealOf, SourceOf,
    TargetOf, ValueOf,
};
pub use fmm::Fmm;
pub use geometry::{Cell, Cube, MAX_LEVEL};
pub use interpolation::{Interpolation, MAX_ORDER};
pub use kernel::{FnKernel, Kernel, Outcome, PointKernel, direct, from_fn, relative_l2_error};
pub use mask::{CellView, Coverage, Mask, Unmasked, direct_masked};
pub use plan::Scheme;
pub use real::{Additive, Columns, Linear, Located, Point, Real, Scalar, Vector};
pub use report::{LevelReport, Report};
pub use sampling::Sampling;
pub use stats::Stats;
pub use times::{ApplyTimes, BuildTimes, Phase, Progress};
