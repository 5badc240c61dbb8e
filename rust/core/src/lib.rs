//! The numerical core of patchtransfer: pure Rust, no Python.
//!
//! One file per published method or data structure; `rust/py` only converts.

mod arcs;
pub mod bernstein;
pub mod injectivity;
pub mod simple_loops;
pub mod sparse;
pub mod spline;
