//! What hides one point from another: triangles, their hierarchy, rays one by one and in packets, and
//! certificates for whole groups. Nothing here knows of fast sums.

mod bounds;
mod facet;
mod wall;
mod node;
mod boxes;
mod occluders;
mod position;
mod shapes;
mod sights;
mod shaft;
mod packet;
mod pairs;
mod segments;

pub(crate) use bounds::Bounds;
pub(crate) use facet::Facet;
pub use occluders::{Hit, Occluders};
pub(crate) use packet::LANES;
pub(crate) use pairs::{AllPairs, SomePairs};
pub(crate) use position::position;
pub(crate) use shaft::Shaft;
pub(crate) use shapes::Shape;
pub use sights::Segment;
pub(crate) use sights::{Sights, about};

#[cfg(test)]
pub(crate) use occluders::tests::triangles;
