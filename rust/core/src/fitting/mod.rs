//! Boundary sides of patches fitted to the target's outline.

pub mod boundary_fit;
pub mod side_fit;
