//! Stage A: a triangulation of the domain that is fine enough at corners to carry a cross field.
//!
//! Constrained Delaunay with refinement (Ruppert 1995, Chew 1993) that leaves the outline's edges whole. At a corner
//! of angle α that k quads fill, the cross turns by α − k·90° from one side to the other, all of it within the
//! triangles at that corner, so *spokes* divide the corner into wedges in which it turns little.

use std::f64::consts::{FRAC_PI_2, TAU};

use thiserror::Error;

use super::adjacency::{Adjacency, AdjacencyError, Place};
use crate::mesh::laplacian::{FaceGeometry, MeshError};
use crate::mesh::refinement::decision;
use crate::mesh::triangulation::{Refinement, TriangulationError, triangulate_unsplit};

/// Why a domain has no mesh.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum LayoutMeshError {
    /// The outline is no outline, or the refinement does not end.
    #[error(transparent)]
    Triangulation(#[from] TriangulationError),
    /// The triangles are no mesh of one domain.
    #[error(transparent)]
    Adjacency(#[from] AdjacencyError),
    /// A triangle is degenerate or inverted.
    #[error(transparent)]
    Geometry(#[from] MeshError),
    /// A corner is no node of the outline.
    #[error("corner {vertex} is not on the outline")]
    CornerInside {
        /// The vertex.
        vertex: usize,
    },
    /// The domain is not one piece with as many holes as there are further loops.
    #[error("the mesh has Euler number {found}, but one piece with {holes} holes has {expected}")]
    Euler {
        /// V − E + F of the mesh.
        found: i64,
        /// 1 − holes.
        expected: i64,
        /// Loops less one.
        holes: usize,
    },
}

/// A corner of the outline and the number of quads that shall meet there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Corner {
    /// Its vertex.
    pub vertex: usize,
    /// Quads in the corner, at least 1.
    pub quads: usize,
}

/// A triangulated domain with its combinatorics and geometry.
#[derive(Debug, Clone)]
pub struct LayoutMesh {
    /// Nodes of the outline in the given order, then ends of spokes, then Steiner points.
    pub points: Vec<[f64; 2]>,
    /// Counter-clockwise triangles.
    pub triangles: Vec<[usize; 3]>,
    /// Who neighbours whom.
    pub adjacency: Adjacency,
    /// Areas and gradients of hat functions.
    pub geometry: FaceGeometry,
}

// In practice Delaunay refinement ends up to about 30 degrees; the last degrees cost many points.
const MIN_ANGLE: f64 = 28.0;
/// A cross may turn by less than 45° from a triangle to the next one; a wedge leaves the field's own turn its share.
const TURN_A_WEDGE: f64 = 25.0;
/// Widest wedge in degrees: half of it is the angle between a triangle's own cross and its side.
const WIDEST_WEDGE: f64 = 50.0;
/// Length of spokes in steps of the outline, so that triangles in the wedges are about as large as those beyond.
const SPOKE: f64 = 0.8;
/// Spokes of two corners that face each other must not meet.
const HALF_WAY: f64 = 0.45;
/// A count that is a whole number but for rounding is that number.
const ROUNDING: f64 = 1e-9;

impl LayoutMesh {
    /// Mesh of the domain on the left of `loops`, indices into `points`, with triangles of at most `max_area`.
    pub fn generate(
        points: &[[f64; 2]],
        loops: &[Vec<usize>],
        corners: &[Corner],
        max_area: f64,
    ) -> Result<Self, LayoutMeshError> {
        let (ends, spokes) = spokes(points, loops, corners)?;
        let all = [points, &ends].concat();
        let limits = Refinement { min_angle: MIN_ANGLE, max_area: Some(max_area) };
        let frame = Frame::new(points, loops);
        let moved = perturbed(all.iter().map(|&p| frame.local(p)).collect(), loops);
        let limits = Refinement { max_area: Some(max_area / (frame.length * frame.length)), ..limits };
        let mesh = triangulate_unsplit(&moved, loops, &spokes, limits)?;
        let inner = mesh.points[all.len()..].iter().map(|&p| frame.global(p));
        let mesh = Self::new(all.iter().copied().chain(inner).collect(), mesh.triangles)?;
        let (found, expected) = (mesh.adjacency.euler(), 2 - loops.len() as i64);
        if found != expected {
            return Err(LayoutMeshError::Euler { found, expected, holes: loops.len().saturating_sub(1) });
        }
        Ok(mesh)
    }

    /// A mesh from its points and triangles.
    pub fn new(points: Vec<[f64; 2]>, triangles: Vec<[usize; 3]>) -> Result<Self, LayoutMeshError> {
        let adjacency = Adjacency::new(points.len(), &triangles)?;
        let geometry = FaceGeometry::new(&points, &triangles)?;
        Ok(Self { points, triangles, adjacency, geometry })
    }

    /// Vector along side `index` of a triangle, which lies on its left.
    pub fn side(&self, place: Place) -> [f64; 2] {
        let t = self.triangles[place.face];
        let (a, b) = (self.points[t[(place.index + 1) % 3]], self.points[t[(place.index + 2) % 3]]);
        [b[0] - a[0], b[1] - a[1]]
    }

    /// Interior angle of a triangle at a corner.
    pub fn angle(&self, place: Place) -> f64 {
        let (after, before) =
            (self.side(after(place)), self.side(Place { index: (place.index + 1) % 3, ..place }));
        turn(after, [-before[0], -before[1]])
    }
}

/// Points moved by less than matters, see [`decision`].
fn perturbed(points: Vec<[f64; 2]>, loops: &[Vec<usize>]) -> Vec<[f64; 2]> {
    let step = loops
        .iter()
        .flat_map(|l| l.iter().zip(l.iter().cycle().skip(1)))
        .filter_map(|(&a, &b)| Some((points.get(a)?, points.get(b)?)))
        .map(|(a, b)| length([b[0] - a[0], b[1] - a[1]]))
        .fold(f64::INFINITY, f64::min);
    if !step.is_finite() {
        return points;
    }
    let shift = |k: usize| step * decision(k);
    points.iter().enumerate().map(|(i, p)| [p[0] + shift(2 * i + 1), p[1] + shift(2 * i + 2)]).collect()
}

/// Coordinates along the first edge of the outline, which it is about as large as 1 in: a domain gets the same mesh
/// wherever it lies and however large it is, but for rounding.
struct Frame {
    origin: [f64; 2],
    axis: [f64; 2],
    length: f64,
}

impl Frame {
    fn new(points: &[[f64; 2]], loops: &[Vec<usize>]) -> Self {
        let (origin, next) = match loops.first().map(|l| &l[..]) {
            Some([a, b, ..]) => (points[*a], points[*b]),
            _ => ([0.0; 2], [1.0, 0.0]),
        };
        let from = |p: [f64; 2]| [p[0] - origin[0], p[1] - origin[1]];
        let size = points.iter().map(|&p| length(from(p))).fold(0.0, f64::max);
        let axis = from(next);
        let step = length(axis);
        if !(step > 0.0 && size.is_finite()) {
            // The triangulation says what is wrong.
            return Self { origin: [0.0; 2], axis: [1.0, 0.0], length: 1.0 };
        }
        Self { origin, axis: axis.map(|x| x / step), length: size }
    }

    fn local(&self, p: [f64; 2]) -> [f64; 2] {
        let [x, y] = [p[0] - self.origin[0], p[1] - self.origin[1]];
        let [c, s] = self.axis;
        [(c * x + s * y) / self.length, (c * y - s * x) / self.length]
    }

    fn global(&self, p: [f64; 2]) -> [f64; 2] {
        let [x, y] = p.map(|x| x * self.length);
        let [c, s] = self.axis;
        [self.origin[0] + c * x - s * y, self.origin[1] + s * x + c * y]
    }
}

/// The side that leaves a corner counter-clockwise.
fn after(corner: Place) -> Place {
    Place { index: (corner.index + 2) % 3, ..corner }
}

/// Angle from one vector to another one, in (−π, π].
fn turn(from: [f64; 2], to: [f64; 2]) -> f64 {
    (from[0] * to[1] - from[1] * to[0]).atan2(from[0] * to[0] + from[1] * to[1])
}

type Spokes = (Vec<[f64; 2]>, Vec<[usize; 2]>);

/// Ends of the spokes at all corners, and the edges that they are.
fn spokes(points: &[[f64; 2]], loops: &[Vec<usize>], corners: &[Corner]) -> Result<Spokes, LayoutMeshError> {
    let mut neighbours = vec![None; points.len()];
    for polygon in loops {
        for (i, &vertex) in polygon.iter().enumerate() {
            if vertex >= points.len() {
                // The triangulation says which loop it is.
                return Ok((Vec::new(), Vec::new()));
            }
            let n = polygon.len();
            neighbours[vertex] = Some([polygon[(i + n - 1) % n], polygon[(i + 1) % n]]);
        }
    }
    let (mut ends, mut edges) = (Vec::new(), Vec::new());
    for &Corner { vertex, quads } in corners {
        let Some(Some([previous, next])) = neighbours.get(vertex) else {
            return Err(LayoutMeshError::CornerInside { vertex });
        };
        let at = points[vertex];
        let to = |v: usize| [points[v][0] - at[0], points[v][1] - at[1]];
        let (first, last) = (to(*next), to(*previous));
        let angle = turn(first, last).rem_euclid(TAU);
        let wedges = wedges(angle, quads);
        let radius =
            (SPOKE * length(first).min(length(last))).min(HALF_WAY * clearance(points, &neighbours, vertex));
        let start = first[1].atan2(first[0]);
        for i in 1..wedges {
            let (sin, cos) = (start + angle * i as f64 / wedges as f64).sin_cos();
            edges.push([vertex, points.len() + ends.len()]);
            ends.push([at[0] + radius * cos, at[1] + radius * sin]);
        }
    }
    Ok((ends, edges))
}

fn wedges(angle: f64, quads: usize) -> usize {
    let count = |x: f64| (x - ROUNDING).ceil().max(0.0) as usize;
    let turned = (angle - quads as f64 * FRAC_PI_2).abs().to_degrees();
    2.max(count(turned / TURN_A_WEDGE) + 1).max(count(angle.to_degrees() / WIDEST_WEDGE))
}

fn length(v: [f64; 2]) -> f64 {
    v[0].hypot(v[1])
}

/// Distance of a node from the outline but the two edges on either side of it.
fn clearance(points: &[[f64; 2]], neighbours: &[Option<[usize; 2]>], vertex: usize) -> f64 {
    let [previous, next] = neighbours[vertex].expect("a node of the outline");
    let before = neighbours[previous].expect("a node of the outline")[0];
    let p = points[vertex];
    let mut nearest = f64::INFINITY;
    for (start, ends) in neighbours.iter().enumerate() {
        let Some([_, end]) = *ends else { continue };
        if [before, previous, vertex, next].contains(&start) {
            continue;
        }
        let (a, b) = (points[start], points[end]);
        let (edge, offset) = ([b[0] - a[0], b[1] - a[1]], [p[0] - a[0], p[1] - a[1]]);
        let along = (offset[0] * edge[0] + offset[1] * edge[1]) / (edge[0] * edge[0] + edge[1] * edge[1]);
        let t = along.clamp(0.0, 1.0);
        nearest = nearest.min(length([offset[0] - t * edge[0], offset[1] - t * edge[1]]));
    }
    nearest
}

#[cfg(test)]
#[path = "mesh_tests.rs"]
mod tests;
