//! Triangle meshes of a domain and maps of them.

pub mod closest_point;
pub mod distortion_descent;
mod insertion_order;
pub mod laplacian;
pub mod local_global;
pub(crate) mod refinement;
pub mod triangulation;
