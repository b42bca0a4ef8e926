//! One farfield sum over many ranks: processes on machines that MPI connects, or threads that stand for them.

mod borders;
mod builder;
mod cells;
mod collective;
mod error;
mod fmm;
mod key;
mod moments;
mod needed;
mod places;
mod points;
mod sort;
mod threads;
mod transport;
mod whole;
mod words;
#[cfg(feature = "mpi")]
mod world;
#[cfg(feature = "program")]
pub mod program;

pub use builder::Builder;
pub use error::Error;
pub use fmm::{DistributedFmm, PartStats};
pub use threads::{ThreadTransport, on_threads};
pub use transport::{Transport, TransportError, Volume};
#[cfg(feature = "mpi")]
pub use world::MpiTransport;
