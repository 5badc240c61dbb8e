//! Quadrilateral layouts of a domain from its outline alone: mesh, cross field, seamless map, T-mesh.

pub mod adjacency;
pub mod charts;
mod chord;
pub mod graph;
pub mod motorcycle;
mod schedule;
pub mod t_mesh;
