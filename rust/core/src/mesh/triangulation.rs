//! Constrained Delaunay triangulation of polygonal domains with holes, optionally with Steiner refinement.
//!
//! The triangulation is that of `spade`, whose predicates are exact. This file checks what `spade` would panic on
//! or change silently (crossing constraints, duplicate points, constraints through a point), removes the exterior
//! and the holes, and puts the result into an order that does not depend on the library's internals.

use std::collections::VecDeque;

use crate::mesh::insertion_order::insertion_order;
use crate::mesh::refinement::{Cdt, Limits, refine_unsplit};
use spade::handles::FixedVertexHandle;
use spade::{AngleLimit, InsertionError, Point2, RefinementParameters, Triangulation};
use thiserror::Error;

/// Why there is no valid triangulation. All indices refer to the input points.
#[derive(Debug, Error, Clone, PartialEq, Eq)]
pub enum TriangulationError {
    /// A coordinate is NaN or infinite.
    #[error("point {point} is not finite")]
    NotFinite {
        /// The point.
        point: usize,
    },
    /// Two points coincide.
    #[error("points {a} and {b} coincide")]
    DuplicatePoints {
        /// The first of them.
        a: usize,
        /// The second.
        b: usize,
    },
    /// A loop has fewer than three points.
    #[error("loop {index} has only {length} points")]
    ShortLoop {
        /// The loop.
        index: usize,
        /// Its number of points.
        length: usize,
    },
    /// A loop names a point that does not exist.
    #[error("loop {index} names point {point}, which does not exist")]
    UnknownPoint {
        /// The loop.
        index: usize,
        /// The point's index.
        point: usize,
    },
    /// A point occurs twice in the loops: they touch.
    #[error("the loops pass through point {point} twice")]
    RepeatedPoint {
        /// The point.
        point: usize,
    },
    /// Two constraint edges cross.
    #[error("the polygon edges {a:?} and {b:?} cross")]
    CrossingConstraints {
        /// End points of one edge.
        a: [usize; 2],
        /// End points of the other.
        b: [usize; 2],
    },
    /// A point lies on a constraint edge without being its end.
    #[error("point {point} lies on the polygon edge {edge:?}")]
    PointOnConstraint {
        /// The point.
        point: usize,
        /// End points of the edge.
        edge: [usize; 2],
    },
    /// The domain is not on the left of a loop: wrong sense, or not nested as outer loop and holes.
    #[error("the domain is not on the left of loop {index} (outer loops counter-clockwise, holes clockwise)")]
    WrongOrientation {
        /// The loop.
        index: usize,
    },
    /// A point lies outside the domain.
    #[error("point {point} lies outside the polygon")]
    PointOutside {
        /// The point.
        point: usize,
    },
    /// The refinement did not end within the allowed number of Steiner points.
    #[error(
        "the refinement did not end within {limit} Steiner points; ask for larger triangles or smaller angles"
    )]
    RefinementIncomplete {
        /// That number.
        limit: usize,
    },
}

/// Steiner refinement: split until all triangles respect both limits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Refinement {
    /// Smallest angle in degrees. The algorithm ends for certain up to about 20.7, in practice up to 30.
    pub min_angle: f64,
    /// Largest area of a triangle.
    pub max_area: Option<f64>,
}

/// A triangulated domain.
#[derive(Debug, Clone, PartialEq)]
pub struct Mesh {
    /// The input points in their order, then Steiner points.
    pub points: Vec<[f64; 2]>,
    /// Counter-clockwise triangles, each starting with its smallest index, in lexicographic order.
    pub triangles: Vec<[usize; 3]>,
}

/// Triangulate the domain on the left of `loops`, which are closed polygons given as indices into `points`.
///
/// Every point must lie in the domain and every polygon edge becomes an edge of the triangulation (a chain of
/// edges when it is split by refinement).
pub fn triangulate(
    points: &[[f64; 2]],
    loops: &[Vec<usize>],
    refinement: Option<Refinement>,
) -> Result<Mesh, TriangulationError> {
    let (mut net, mut interior, scale) = constrained(points, loops, &[])?;
    if let Some(limits) = refinement {
        refine(&mut net.cdt, limits, scale)?;
        interior = net.interior();
    }
    Ok(extract(&net.cdt, interior.triangles, points, scale))
}

/// The same with further edges in the domain's inside, `walls`; no edge of a loop and no wall is split.
///
/// Triangles that could only be improved by splitting such an edge stay as they are, and so do those of less than 10⁻¹³
/// of the bounding box. The smallest angle must be 30 degrees at most.
pub fn triangulate_unsplit(
    points: &[[f64; 2]],
    loops: &[Vec<usize>],
    walls: &[[usize; 2]],
    limits: Refinement,
) -> Result<Mesh, TriangulationError> {
    let (mut net, interior, scale) = constrained(points, loops, walls)?;
    let limits = Limits {
        ratio: 0.5 / limits.min_angle.to_radians().sin(),
        area: limits.max_area.map_or(f64::INFINITY, |area| area * scale * scale),
        noise: NOISE * box_area(&net.cdt),
    };
    let number = |v: FixedVertexHandle| net.points.get(v.index()).copied().unwrap_or(v.index());
    refine_unsplit(&mut net.cdt, &interior.faces, number, &limits);
    Ok(extract(&net.cdt, net.interior().triangles, points, scale))
}

/// The triangulation without refinement, what is inside, and what its coordinates were multiplied by.
fn constrained(
    points: &[[f64; 2]],
    loops: &[Vec<usize>],
    walls: &[[usize; 2]],
) -> Result<(Net, Interior, f64), TriangulationError> {
    check_points(points)?;
    let mut edges = check_loops(points.len(), loops)?;
    edges.extend(walls);
    // A power of two, so that scaling is exact and the exact predicates judge the caller's own coordinates.
    let largest = points.iter().flatten().fold(0.0_f64, |m, x| m.max(x.abs()));
    let scale =
        if largest > 0.0 { 2.0_f64.powi(-(largest.log2().floor() as i32).clamp(-1000, 1000)) } else { 1.0 };
    let scaled = points
        .iter()
        .map(|p| spade::mitigate_underflow(Point2::new(p[0] * scale, p[1] * scale)))
        .collect::<Vec<_>>();
    let mut net = Net::delaunay(&scaled, insertion_order(points))?;
    net.constrain(&edges)?;
    net.check_constraints(&edges, points)?;
    let interior = net.interior();
    net.check_nesting(loops, &interior.faces)?;
    check_usage(&interior.triangles, points.len())?;
    Ok((net, interior, scale))
}

/// A triangulation whose vertices come in the order of their insertion.
struct Net {
    cdt: Cdt,
    /// The vertex of every input point.
    vertices: Vec<FixedVertexHandle>,
    /// The input point of every vertex; Steiner points have the numbers of their vertices.
    points: Vec<usize>,
}

impl Net {
    /// The Delaunay triangulation of points that are inserted in this order.
    ///
    /// `spade`'s bulk load inserts them by their distance from the middle: as fast where they are spread evenly, but three
    /// times slower on the nets of multi-patches.
    fn delaunay(points: &[Point2<f64>], order: Vec<usize>) -> Result<Self, TriangulationError> {
        let mut cdt = Cdt::with_capacity(points.len(), 3 * points.len(), 2 * points.len());
        let mut vertices = vec![FixedVertexHandle::from_index(0); points.len()];
        let mut last = None;
        for &point in &order {
            let inserted = match last {
                Some(hint) => cdt.insert_with_hint(points[point], hint),
                None => cdt.insert(points[point]),
            };
            vertices[point] = inserted.map_err(rejected)?;
            last = Some(vertices[point]);
        }
        // A point that coincides with another one gets its vertex.
        if cdt.num_vertices() == points.len() {
            Ok(Self { cdt, vertices, points: order })
        } else {
            Err(duplicates(points))
        }
    }

    fn point(&self, vertex: FixedVertexHandle) -> usize {
        let index = vertex.index();
        self.points.get(index).copied().unwrap_or(index)
    }

    fn constrain(&mut self, edges: &[[usize; 2]]) -> Result<(), TriangulationError> {
        for &edge in edges {
            let [from, to] = edge.map(|point| self.vertices[point]);
            if self.cdt.try_add_constraint(from, to).is_empty() {
                let crossed = self
                    .cdt
                    .get_conflicting_edges_between_vertices(from, to)
                    .map(|e| [e.from().fix(), e.to().fix()].map(|v| self.point(v)))
                    .next()
                    .unwrap_or(edge);
                return Err(TriangulationError::CrossingConstraints { a: edge, b: crossed });
            }
        }
        Ok(())
    }

    /// `spade` splits a constraint at points that lie on it exactly; a domain whose boundary does that is refused.
    fn check_constraints(&self, edges: &[[usize; 2]], points: &[[f64; 2]]) -> Result<(), TriangulationError> {
        for &edge in edges {
            let [from, to] = edge.map(|point| self.vertices[point]);
            if !self.cdt.exists_constraint(from, to) {
                let [a, b] = edge.map(|i| points[i]);
                let direction = [b[0] - a[0], b[1] - a[1]];
                // The splitting vertex: the nearest one ahead among the constraint edges out of `from`.
                let along = |p: [f64; 2]| (p[0] - a[0]) * direction[0] + (p[1] - a[1]) * direction[1];
                let across =
                    |p: [f64; 2]| ((p[1] - a[1]) * direction[0] - (p[0] - a[0]) * direction[1]).abs();
                let point = self
                    .cdt
                    .vertex(from)
                    .out_edges()
                    .filter(|e| e.as_undirected().is_constraint_edge())
                    .map(|e| self.point(e.to().fix()))
                    .filter(|&v| along(points[v]) > 0.0)
                    .min_by(|&v, &w| {
                        let slope = |v: usize| across(points[v]) / along(points[v]);
                        slope(v).total_cmp(&slope(w))
                    })
                    .unwrap_or(edge[1]);
                return Err(TriangulationError::PointOnConstraint { point, edge });
            }
        }
        Ok(())
    }

    /// Faces at odd depth, the depth being the least number of constraints between a face and infinity.
    ///
    /// They are flooded depth by depth. Corners are noted on the way, as the edges of a face are at hand then: reading
    /// them again in another order costs as much as the flood.
    fn interior(&self) -> Interior {
        let cdt = &self.cdt;
        let mut seen = vec![false; cdt.num_all_faces()];
        let mut faces = seen.clone();
        let mut triangles = Vec::with_capacity(cdt.num_inner_faces());
        seen[cdt.outer_face().index()] = true;
        // An edge of every face to be entered, at this depth and at the next.
        let (mut here, mut deeper) = (VecDeque::new(), VecDeque::new());
        for edge in cdt.convex_hull() {
            let edge = if edge.is_outer_edge() { edge.rev() } else { edge };
            let list = if edge.as_undirected().is_constraint_edge() { &mut deeper } else { &mut here };
            list.push_back(edge.fix());
        }
        let mut odd = false;
        loop {
            while let Some(entry) = here.pop_front() {
                let edge = cdt.directed_edge(entry);
                let face = edge.face().index();
                if std::mem::replace(&mut seen[face], true) {
                    continue;
                }
                let (next, prev) = (edge.next(), edge.prev());
                if odd {
                    faces[face] = true;
                    triangles.push([edge, next, prev].map(|e| self.point(e.from().fix())));
                }
                for side in [next, prev] {
                    let beyond = side.rev();
                    if !seen[beyond.face().index()] {
                        let list =
                            if side.as_undirected().is_constraint_edge() { &mut deeper } else { &mut here };
                        list.push_back(beyond.fix());
                    }
                }
            }
            if deeper.is_empty() {
                return Interior { faces, triangles };
            }
            std::mem::swap(&mut here, &mut deeper);
            odd = !odd;
        }
    }

    fn check_nesting(&self, loops: &[Vec<usize>], inside: &[bool]) -> Result<(), TriangulationError> {
        for (index, polygon) in loops.iter().enumerate() {
            let [a, b] = [polygon[0], polygon[1]].map(|point| self.vertices[point]);
            let edge = self.cdt.get_edge_from_neighbors(a, b).expect("constraints are edges");
            if !inside[edge.face().index()] || inside[edge.rev().face().index()] {
                return Err(TriangulationError::WrongOrientation { index });
            }
        }
        Ok(())
    }
}

/// What is left of a triangulation without the exterior and the holes.
struct Interior {
    /// For every face, whether it belongs to the domain.
    faces: Vec<bool>,
    /// The vertices of those that do.
    triangles: Vec<[usize; 3]>,
}

/// The first two points that coincide, of points some of which do.
fn duplicates(points: &[Point2<f64>]) -> TriangulationError {
    let key = |i: usize| (points[i].x, points[i].y);
    let mut order: Vec<usize> = (0..points.len()).collect();
    order.sort_by(|&i, &j| key(i).partial_cmp(&key(j)).expect("finite").then(i.cmp(&j)));
    let twice = order.windows(2).find(|w| key(w[0]) == key(w[1])).expect("two points coincide");
    TriangulationError::DuplicatePoints { a: twice[0], b: twice[1] }
}

fn rejected(error: InsertionError) -> TriangulationError {
    // Scaling and the check for finite input leave nothing that spade rejects.
    unreachable!("spade rejected a normalised coordinate: {error}")
}

fn check_points(points: &[[f64; 2]]) -> Result<(), TriangulationError> {
    if let Some(point) = points.iter().position(|p| !p.iter().all(|x| x.is_finite())) {
        return Err(TriangulationError::NotFinite { point });
    }
    Ok(())
}

fn check_loops(n: usize, loops: &[Vec<usize>]) -> Result<Vec<[usize; 2]>, TriangulationError> {
    let mut seen = vec![false; n];
    let mut edges = Vec::new();
    for (index, polygon) in loops.iter().enumerate() {
        if polygon.len() < 3 {
            return Err(TriangulationError::ShortLoop { index, length: polygon.len() });
        }
        for (i, &point) in polygon.iter().enumerate() {
            if point >= n {
                return Err(TriangulationError::UnknownPoint { index, point });
            }
            if std::mem::replace(&mut seen[point], true) {
                return Err(TriangulationError::RepeatedPoint { point });
            }
            edges.push([point, polygon[(i + 1) % polygon.len()]]);
        }
    }
    Ok(edges)
}

fn check_usage(triangles: &[[usize; 3]], n: usize) -> Result<(), TriangulationError> {
    let mut used = vec![false; n];
    for &vertex in triangles.as_flattened() {
        used[vertex] = true;
    }
    match used.iter().position(|u| !u) {
        Some(point) => Err(TriangulationError::PointOutside { point }),
        None => Ok(()),
    }
}

/// Circumcentres of slivers at rounding level, in parts of the bounding box, are noise.
const NOISE: f64 = 1e-13;

fn box_area(cdt: &Cdt) -> f64 {
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for vertex in cdt.vertices() {
        let p = [vertex.position().x, vertex.position().y];
        for c in 0..2 {
            low[c] = low[c].min(p[c]);
            high[c] = high[c].max(p[c]);
        }
    }
    (high[0] - low[0]) * (high[1] - low[1])
}

fn refine(cdt: &mut Cdt, limits: Refinement, scale: f64) -> Result<(), TriangulationError> {
    let area = box_area(cdt);
    let mut limit = 1000 + 20 * cdt.num_vertices();
    let mut parameters = RefinementParameters::new()
        .exclude_outer_faces(true)
        .with_angle_limit(AngleLimit::from_deg(limits.min_angle))
        .with_min_required_area(NOISE * area);
    if let Some(max_area) = limits.max_area {
        let scaled = max_area * scale * scale;
        limit += (8.0 * area / scaled).min(1e8) as usize;
        parameters = parameters.with_max_allowed_area(scaled);
    }
    if cdt.refine(parameters.with_max_additional_vertices(limit)).refinement_complete {
        Ok(())
    } else {
        Err(TriangulationError::RefinementIncomplete { limit })
    }
}

fn extract(cdt: &Cdt, mut triangles: Vec<[usize; 3]>, input: &[[f64; 2]], scale: f64) -> Mesh {
    let mut points = input.to_vec();
    if cdt.num_vertices() > input.len() {
        // Refinement may leave Steiner points in the exterior; drop them and close the gaps.
        let mut number = vec![usize::MAX; cdt.num_vertices()];
        for &v in triangles.as_flattened() {
            number[v] = v;
        }
        for vertex in cdt.vertices().skip(input.len()) {
            if number[vertex.index()] != usize::MAX {
                number[vertex.index()] = points.len();
                let p = vertex.position();
                points.push([p.x / scale, p.y / scale]);
            }
        }
        for v in triangles.as_flattened_mut() {
            *v = number[*v];
        }
    }
    for t in &mut triangles {
        let first = (0..3).min_by_key(|&i| t[i]).expect("three corners");
        t.rotate_left(first);
    }
    Mesh { triangles: sorted(&triangles, points.len()), points }
}

/// Triangles in lexicographic order, by counting those of every first corner: there are few of one.
fn sorted(triangles: &[[usize; 3]], n: usize) -> Vec<[usize; 3]> {
    let mut next = vec![0; n + 1];
    for t in triangles {
        next[t[0] + 1] += 1;
    }
    for v in 0..n {
        next[v + 1] += next[v];
    }
    let mut out = vec![[0; 3]; triangles.len()];
    for &t in triangles {
        out[next[t[0]]] = t;
        next[t[0]] += 1;
    }
    // `next` now holds where every group ends.
    let mut start = 0;
    for &end in &next[..n] {
        out[start..end].sort_unstable();
        start = end;
    }
    out
}

#[cfg(test)]
#[path = "triangulation_tests.rs"]
mod tests;
