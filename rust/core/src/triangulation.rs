//! Constrained Delaunay triangulation of polygonal domains with holes, optionally with Steiner refinement.
//!
//! The triangulation is that of `spade`, whose predicates are exact. This file checks what `spade` would panic on
//! or change silently (crossing constraints, duplicate points, constraints through a point), removes the exterior
//! and the holes, and puts the result into an order that does not depend on the library's internals.

use std::collections::VecDeque;

use spade::handles::FixedVertexHandle;
use spade::{
    AngleLimit, ConstrainedDelaunayTriangulation, InsertionError, Point2, RefinementParameters, Triangulation,
};
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

type Cdt = ConstrainedDelaunayTriangulation<Point2<f64>>;

/// Triangulate the domain on the left of `loops`, which are closed polygons given as indices into `points`.
///
/// Every point must lie in the domain and every polygon edge becomes an edge of the triangulation (a chain of
/// edges when it is split by refinement).
pub fn triangulate(
    points: &[[f64; 2]],
    loops: &[Vec<usize>],
    refinement: Option<Refinement>,
) -> Result<Mesh, TriangulationError> {
    check_points(points)?;
    let edges = check_loops(points.len(), loops)?;
    // A power of two, so that scaling is exact and the exact predicates judge the caller's own coordinates.
    let largest = points.iter().flatten().fold(0.0_f64, |m, x| m.max(x.abs()));
    let scale =
        if largest > 0.0 { 2.0_f64.powi(-(largest.log2().floor() as i32).clamp(-1000, 1000)) } else { 1.0 };
    let scaled = points
        .iter()
        .map(|p| spade::mitigate_underflow(Point2::new(p[0] * scale, p[1] * scale)))
        .collect::<Vec<_>>();
    let mut conflicts = Vec::new();
    let mut cdt = Cdt::try_bulk_load_cdt(scaled, edges.clone(), |e| conflicts.push(e)).map_err(rejected)?;
    assert_eq!(cdt.num_vertices(), points.len(), "duplicates were excluded above");
    if let Some(&[from, to]) = conflicts.iter().min() {
        let crossed = cdt
            .get_conflicting_edges_between_vertices(
                FixedVertexHandle::from_index(from),
                FixedVertexHandle::from_index(to),
            )
            .map(|e| [e.from().index(), e.to().index()])
            .next()
            .unwrap_or([from, to]);
        return Err(TriangulationError::CrossingConstraints { a: [from, to], b: crossed });
    }
    check_constraints(&cdt, &edges, points)?;
    let mut inside = faces_inside(&cdt);
    check_nesting(&cdt, loops, &inside)?;
    check_usage(&cdt, &inside, points.len())?;
    if let Some(limits) = refinement {
        refine(&mut cdt, limits, scale)?;
        inside = faces_inside(&cdt);
    }
    Ok(extract(&cdt, &inside, points, scale))
}

fn rejected(error: InsertionError) -> TriangulationError {
    // Scaling and the check for finite input leave nothing that spade rejects.
    unreachable!("spade rejected a normalised coordinate: {error}")
}

fn check_points(points: &[[f64; 2]]) -> Result<(), TriangulationError> {
    if let Some(point) = points.iter().position(|p| !p.iter().all(|x| x.is_finite())) {
        return Err(TriangulationError::NotFinite { point });
    }
    // Adding zero makes -0.0 and 0.0 the same. Sorting plain numbers takes a third of the time of sorting indices.
    let key = |p: &[f64; 2]| u128::from((p[0] + 0.0).to_bits()) << 64 | u128::from((p[1] + 0.0).to_bits());
    let mut keys: Vec<u128> = points.iter().map(key).collect();
    keys.sort_unstable();
    if keys.windows(2).all(|w| w[0] != w[1]) {
        return Ok(());
    }
    let mut order: Vec<usize> = (0..points.len()).collect();
    order.sort_by(|&i, &j| points[i].partial_cmp(&points[j]).expect("finite").then(i.cmp(&j)));
    let twice = order.windows(2).find(|w| points[w[0]] == points[w[1]]).expect("two keys are equal");
    Err(TriangulationError::DuplicatePoints { a: twice[0], b: twice[1] })
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

/// `spade` splits a constraint at points that lie on it exactly; a domain whose boundary does that is refused.
fn check_constraints(cdt: &Cdt, edges: &[[usize; 2]], points: &[[f64; 2]]) -> Result<(), TriangulationError> {
    for &edge in edges {
        let [from, to] = edge.map(FixedVertexHandle::from_index);
        if !cdt.exists_constraint(from, to) {
            let [a, b] = edge.map(|i| points[i]);
            let direction = [b[0] - a[0], b[1] - a[1]];
            // The splitting vertex: the nearest one ahead among the constraint edges out of `from`.
            let along = |p: [f64; 2]| (p[0] - a[0]) * direction[0] + (p[1] - a[1]) * direction[1];
            let across = |p: [f64; 2]| ((p[1] - a[1]) * direction[0] - (p[0] - a[0]) * direction[1]).abs();
            let point = cdt
                .vertex(from)
                .out_edges()
                .filter(|e| e.as_undirected().is_constraint_edge())
                .map(|e| e.to().index())
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
fn faces_inside(cdt: &Cdt) -> Vec<bool> {
    let mut depth = vec![u32::MAX; cdt.num_all_faces()];
    depth[cdt.outer_face().index()] = 0;
    // Edges as seen from a face already reached.
    let mut queue: VecDeque<_> = cdt
        .convex_hull()
        .map(|edge| if edge.is_outer_edge() { edge.fix() } else { edge.rev().fix() })
        .collect();
    while let Some(edge) = queue.pop_front() {
        let edge = cdt.directed_edge(edge);
        let constraint = edge.as_undirected().is_constraint_edge();
        let level = depth[edge.face().index()] + u32::from(constraint);
        let beyond = edge.rev();
        if level < depth[beyond.face().index()] {
            depth[beyond.face().index()] = level;
            for next in [beyond.next(), beyond.prev()] {
                let constraint = next.as_undirected().is_constraint_edge();
                if level + u32::from(constraint) >= depth[next.rev().face().index()] {
                    continue;
                }
                // Faces without a constraint in between come first, so depths are final when they spread.
                if constraint {
                    queue.push_back(next.fix());
                } else {
                    queue.push_front(next.fix());
                }
            }
        }
    }
    depth.into_iter().map(|d| d % 2 == 1).collect()
}

fn check_nesting(cdt: &Cdt, loops: &[Vec<usize>], inside: &[bool]) -> Result<(), TriangulationError> {
    for (index, polygon) in loops.iter().enumerate() {
        let [a, b] = [polygon[0], polygon[1]].map(FixedVertexHandle::from_index);
        let edge = cdt.get_edge_from_neighbors(a, b).expect("constraints are edges");
        if !inside[edge.face().index()] || inside[edge.rev().face().index()] {
            return Err(TriangulationError::WrongOrientation { index });
        }
    }
    Ok(())
}

fn check_usage(cdt: &Cdt, inside: &[bool], n: usize) -> Result<(), TriangulationError> {
    let mut used = vec![false; n];
    for face in cdt.inner_faces().filter(|f| inside[f.index()]) {
        for vertex in face.vertices() {
            used[vertex.index()] = true;
        }
    }
    match used.iter().position(|u| !u) {
        Some(point) => Err(TriangulationError::PointOutside { point }),
        None => Ok(()),
    }
}

fn refine(cdt: &mut Cdt, limits: Refinement, scale: f64) -> Result<(), TriangulationError> {
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for vertex in cdt.vertices() {
        let p = [vertex.position().x, vertex.position().y];
        for c in 0..2 {
            low[c] = low[c].min(p[c]);
            high[c] = high[c].max(p[c]);
        }
    }
    let area = (high[0] - low[0]) * (high[1] - low[1]);
    let mut limit = 1000 + 20 * cdt.num_vertices();
    let mut parameters = RefinementParameters::new()
        .exclude_outer_faces(true)
        .with_angle_limit(AngleLimit::from_deg(limits.min_angle))
        // Circumcentres of slivers at rounding level are noise.
        .with_min_required_area(1e-13 * area);
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

fn extract(cdt: &Cdt, inside: &[bool], input: &[[f64; 2]], scale: f64) -> Mesh {
    let mut triangles: Vec<[usize; 3]> = cdt
        .inner_faces()
        .filter(|f| inside[f.index()])
        .map(|f| {
            let mut t = f.vertices().map(|v| v.index());
            let first = (0..3).min_by_key(|&i| t[i]).expect("three corners");
            t.rotate_left(first);
            t
        })
        .collect();
    // Refinement may leave Steiner points in the exterior; drop them and close the gaps.
    let mut number = vec![usize::MAX; cdt.num_vertices()];
    for &v in triangles.iter().flatten() {
        number[v] = v;
    }
    let mut points = input.to_vec();
    for vertex in cdt.vertices().skip(input.len()) {
        if number[vertex.index()] != usize::MAX {
            number[vertex.index()] = points.len();
            let p = vertex.position();
            points.push([p.x / scale, p.y / scale]);
        }
    }
    for v in triangles.iter_mut().flatten() {
        *v = number[*v];
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
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn area(points: &[[f64; 2]], t: &[usize]) -> f64 {
        (0..t.len())
            .map(|i| {
                let (p, q) = (points[t[i]], points[t[(i + 1) % t.len()]]);
                (p[0] * q[1] - p[1] * q[0]) / 2.0
            })
            .sum()
    }

    const SQUARE: [[f64; 2]; 4] = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];

    proptest! {
        #[test]
        fn star_with_hole(radii in prop::collection::vec(0.8..1.5f64, 5..30), hole in 3usize..9,
                          exponent in -140i32..140, refine in any::<bool>()) {
            let scale = 10f64.powi(exponent);
            let circle = |i: usize, n: usize, r: f64| {
                let t = std::f64::consts::TAU * i as f64 / n as f64;
                [scale * r * t.cos(), scale * r * t.sin()]
            };
            let n = radii.len();
            let mut points: Vec<_> = radii.iter().enumerate().map(|(i, &r)| circle(i, n, r)).collect();
            points.extend((0..hole).map(|i| circle(i, hole, 0.2)));
            let loops = [(0..n).collect::<Vec<_>>(), (n..n + hole).rev().collect()];
            let refinement = refine.then_some(Refinement { min_angle: 20.0, max_area: Some(0.05 * scale * scale) });
            let mesh = triangulate(&points, &loops, refinement).unwrap();
            let expected: f64 = loops.iter().map(|l| area(&points, l)).sum();
            let areas: Vec<f64> = mesh.triangles.iter().map(|t| area(&mesh.points, t)).collect();
            prop_assert!(areas.iter().all(|&a| a > 0.0));
            prop_assert!((areas.iter().sum::<f64>() - expected).abs() < 1e-12 * expected);
            prop_assert_eq!(&mesh.points[..points.len()], &points[..]);
            if refine {
                prop_assert!(areas.iter().all(|&a| a <= 0.05 * scale * scale * (1.0 + 1e-9)));
            } else {
                // Euler: one hole.
                prop_assert_eq!(mesh.triangles.len(), points.len());
            }
            prop_assert_eq!(&mesh, &triangulate(&points, &loops, refinement).unwrap());
        }
    }

    #[test]
    fn reports_what_is_wrong() {
        use TriangulationError::*;
        let with = |extra: &[[f64; 2]], loops: &[Vec<usize>]| {
            let mut points = SQUARE.to_vec();
            points.extend(extra);
            triangulate(&points, loops, None).unwrap_err()
        };
        let outer = vec![0, 1, 2, 3];
        let crossing = with(&[], &[vec![0, 2, 1, 3]]);
        assert!(matches!(crossing, CrossingConstraints { a, b } if a != b), "{crossing:?}");
        assert_eq!(with(&[[2.0, 0.5]], std::slice::from_ref(&outer)), PointOutside { point: 4 });
        assert_eq!(with(&[[0.0, -0.0]], std::slice::from_ref(&outer)), DuplicatePoints { a: 0, b: 4 });
        assert_eq!(
            with(&[[0.5, 0.0]], std::slice::from_ref(&outer)),
            PointOnConstraint { point: 4, edge: [0, 1] }
        );
        assert_eq!(with(&[[f64::NAN, 0.0]], std::slice::from_ref(&outer)), NotFinite { point: 4 });
        assert_eq!(with(&[], &[vec![3, 2, 1, 0]]), WrongOrientation { index: 0 });
        assert_eq!(with(&[], &[vec![0, 1]]), ShortLoop { index: 0, length: 2 });
        assert_eq!(with(&[], &[vec![0, 1, 9]]), UnknownPoint { index: 0, point: 9 });
        assert_eq!(with(&[], &[vec![0, 1, 2, 0]]), RepeatedPoint { point: 0 });
        let inner = [[0.4, 0.4], [0.6, 0.4], [0.5, 0.6]];
        assert_eq!(with(&inner, &[outer, vec![4, 5, 6]]), WrongOrientation { index: 1 });
    }
}
