//! The numerical core of patchtransfer: pure Rust, no Python.
//!
//! One file per published method or data structure; `rust/py` only converts.

mod arcs;
mod assembly;
pub mod barrier;
pub mod bernstein;
pub mod elements;
pub mod injectivity;
pub mod inner_distance;
pub mod laplacian;
pub mod local_global;
pub mod matching;
pub mod optimizer;
pub mod outline;
pub mod quadrature;
pub mod simple_loops;
pub mod sparse;
pub mod spline;
pub mod ssvd;
pub mod triangulation;
