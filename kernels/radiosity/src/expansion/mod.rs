//! The radiosity kernel, its near field in registers and its expansion in sixteen moments.

mod near_field;
mod irradiance;
mod moments;
mod sixteen_moment;

pub use irradiance::Irradiance;
pub use sixteen_moment::SixteenMoment;
