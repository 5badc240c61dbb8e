//! Quadrilateral layouts of a domain from its outline alone: mesh, cross field, seamless map, T-mesh.

pub mod adjacency;
pub mod charts;
mod chord;
pub mod cross_field;
mod cut;
mod elimination;
pub mod graph;
pub mod mesh;
pub mod motorcycle;
mod pattern;
mod schedule;
pub mod seamless_map;
pub mod t_mesh;
#[cfg(test)]
pub(crate) mod test_domains;
