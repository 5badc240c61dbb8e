//! The numerical core of patchtransfer: pure Rust, no Python.
//!
//! One file per published method or data structure; `rust/py` only converts.

mod arcs;
mod assembly;
mod axis;
pub mod barrier;
pub mod bernstein;
pub mod boundary_fit;
mod budget;
pub mod closest_point;
mod coarse;
pub mod dense;
pub mod distortion_descent;
pub mod elements;
mod evaluation;
pub mod galerkin;
pub mod injectivity;
pub mod inner_distance;
mod insertion_order;
mod kernel;
mod lanes;
pub mod laplacian;
pub mod layout;
pub mod local_global;
pub mod matching;
mod newton;
pub mod optimizer;
mod ordering;
pub mod outline;
pub mod quadrature;
pub mod quality;
mod quasi_newton;
pub mod sampled_basis;
pub mod side_fit;
pub mod simple_loops;
pub mod sparse;
pub mod spline;
pub mod ssvd;
pub mod thin_plate;
mod triangle_sign;
pub mod triangulation;
mod tridiagonal;
