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

mod asked;
mod bicgstab;
mod bounds;
mod bvh;
mod conjugate;
mod contour;
mod corrections;
mod cut;
mod element;
mod error;
mod exchange;
mod facet;
mod facing;
mod kernel;
mod near_field;
mod neighbours;
mod operator;
mod packet;
mod patch;
mod quadrature;
mod residual;
mod rounding;
mod sampling;
mod scene;
mod shaft;
mod sixteen_moment;
mod solve;
mod surfel;
mod tally;
mod visibility;
mod wall;
mod watch;

pub use bicgstab::bicgstab;
pub use bvh::{Hit, Occluders};
pub use conjugate::conjugate_gradients;
pub use corrections::{Corrections, Zones};
pub use element::Element;
pub use error::Error;
pub use exchange::exchange_area;
pub use facet::Triangle;
pub use facing::Facing;
pub use kernel::Irradiance;
pub use operator::{Closure, Enclosure, RadiosityOperator};
pub use patch::Patch;
pub use scene::{
    Scene, furnace, quad_pieces, quad_surfels, quad_triangles, sphere_interior, two_rooms,
};
pub use sixteen_moment::SixteenMoment;
pub use solve::{EnergyBalance, Solution, Stop, energy_balance, jacobi, southwell};
pub use surfel::{Projections, Surfel, check_emission, check_reflectance, check_surfels};
pub use visibility::{PairCounts, Visibility};
pub use watch::Report;
