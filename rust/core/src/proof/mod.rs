//! Proofs that hold in spite of rounding: patches are injective, loops are simple and disjoint.

pub mod injectivity;
mod loop_arcs;
pub mod simple_loops;
