//! Proofs that hold in spite of rounding: patches are injective, loops are simple and disjoint.

mod determinant_cell;
mod hull;
pub mod injectivity;
mod loop_arcs;
mod patch_determinant;
pub mod simple_loops;
mod winding;
