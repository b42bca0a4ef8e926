//! Radiosity on `farfield`: the exchange of diffuse light, or of radiant heat, between surfels.
//!
//! B(x) = E(x) + ρ(x) H(x),   H(x) = Σ_y V(x, y) K(x, y) A_y B(y)
//!
//! B radiosity, E emitted exitance and H irradiance \[W/m²\], one column per band; ρ diffuse
//! reflectance; A area \[m²\]; V visibility, 0 or 1; K the kernel of [`Irradiance`].
//!
//! ```
//! use farfield::Fmm;
//! use farfield_radiosity::{Irradiance, Occluders, Stop, Visibility, furnace, jacobi};
//!
//! let room = furnace(6);
//! let occluders = Occluders::new(&room.triangles)?;
//! let kernel = Irradiance::<f64, [f64; 3]>::clamped();
//! let mask = Visibility::new(&occluders);
//! let fmm = Fmm::builder(kernel).mask(&mask).order(4).build(&room.surfels, &room.surfels)?;
//!
//! let lamp = [17.0, 12.0, 4.0];
//! let emission: Vec<_> =
//!     room.surfels.iter().map(|s| if s.face == 5 { lamp } else { [0.0; 3] }).collect();
//! let reflectance = vec![[0.6, 0.5, 0.4]; room.surfels.len()];
//! let stop = Stop::default();
//! let solution = jacobi(&emission, &reflectance, stop, |b| fmm.apply(b), |_, _| ())?;
//! assert!(solution.residual <= stop.tolerance);
//! # Ok::<(), farfield_radiosity::Error>(())
//! ```

// Each module imports only from those above it.
mod error;
mod numbers;
mod elements;
mod occlusion;
mod surroundings;
mod form_factors;
mod expansion;
mod masks;
mod operator;
mod solvers;

pub use elements::{
    Element, Patch, Projections, Scene, Surfel, Triangle, check_emission, check_reflectance,
    check_surfels, furnace, quad_pieces, quad_surfels, quad_triangles, sphere_interior, two_rooms,
};
pub use error::Error;
pub use expansion::{Irradiance, SixteenMoment};
pub use form_factors::{Corrections, Zones, exchange_area, visible_exchange_area};
pub use masks::{Facing, PairCounts, Visibility};
pub use occlusion::{Hit, Occluders, Segment};
pub use operator::{Balance, Closure, Enclosure, RadiosityOperator};
pub use solvers::{
    EnergyBalance, Report, Solution, Stop, bicgstab, conjugate_gradients, energy_balance, jacobi,
    southwell,
};
pub use surroundings::{Daylight, Seen, Sky, Surroundings};
