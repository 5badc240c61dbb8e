//! The numerical core of patchtransfer: pure Rust, no Python.
//!
//! One file per published method or data structure; `rust/py` only converts.

pub mod barrier;
pub mod elements;
pub mod optimizer;
pub mod quadrature;
mod arcs;
pub mod bernstein;
pub mod injectivity;
pub mod simple_loops;
pub mod laplacian;
pub mod local_global;
pub mod sparse;
pub mod spline;
pub mod ssvd;
pub mod triangulation;
