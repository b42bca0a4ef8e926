//! The laws that every kernel and expansion must obey, as callable checks, and two kernels on which
//! every operator is exact.
//!
//! A new implementation is tested by calling [`check`] with samples of its points and charges:
//!
//! ```
//! use farfield::conformance::{Samples, check};
//! use farfield::{Interpolation, from_fn};
//! use glam::DVec3;
//!
//! let kernel = from_fn(|x: DVec3, y: DVec3| 1.0 / x.distance(y));
//! let samples = Samples { source: |p, _| p, target: |p, _| p, charge: |i| 1.0 + i as f64 };
//! check(Interpolation::new(kernel).order(6), &samples, 1e-3)?;
//! # Ok::<(), farfield::conformance::Violation>(())
//! ```

mod cell_pair;
mod exact;
mod laws;
mod samples;
mod violation;

pub use exact::{Counting, RankOne};
pub use laws::{check, check_kernel};
pub use samples::Samples;
pub use violation::Violation;
