//! Quadrilateral layouts of a domain from its outline alone: mesh, cross field, seamless map, T-mesh.

pub mod adjacency;
pub mod charts;
mod chord;
pub mod graph;
pub mod motorcycle;
mod schedule;
pub mod t_mesh;
pub mod cross_field;
mod cut;
mod elimination;
pub mod mesh;
mod pattern;
pub mod seamless_map;
#[cfg(test)]
mod test_domains;
