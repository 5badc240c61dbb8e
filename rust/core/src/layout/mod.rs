//! Quadrilateral layouts of a domain from its outline alone: mesh, cross field, seamless map, T-mesh.

pub mod adjacency;
