//! Proofs that hold in spite of rounding: patches are injective, loops are simple and disjoint.

pub mod bounded_ratio;
mod determinant_cell;
pub mod dilatation;
mod hull;
pub mod injectivity;
mod loop_arcs;
mod patch_determinant;
pub mod proved_quality;
pub mod simple_loops;
mod winding;
