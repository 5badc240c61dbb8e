//! Delaunay refinement that splits no constraint edge (Chew: *Guaranteed-quality triangular meshes*, 1989).
//!
//! Circumcentres or off-centres of bad triangles are inserted, unless they lie in the diametral circle of a constraint edge. Bad are
//! triangles whose circumradius exceeds their shortest edge, and a little more, so that no edge ever becomes shorter than the
//! shortest one at hand: the refinement ends. `spade`'s own refinement cannot tell the domain from its outside where
//! constraint edges end inside it.

use std::collections::VecDeque;

use robust::{Coord, incircle};
use spade::handles::{
    DirectedEdgeHandle, FixedDirectedEdgeHandle, FixedFaceHandle, FixedVertexHandle, InnerTag,
};
use spade::{CdtEdge, Point2, PositionInTriangulation, Triangulation, mitigate_underflow};

use crate::mesh::triangulation::Cdt;

type Edge<'a> = DirectedEdgeHandle<'a, Point2<f64>, (), CdtEdge<()>, ()>;
type Face = FixedFaceHandle<InnerTag>;

/// Triangles are split until all of them respect both limits, or cannot.
pub(crate) struct Limits {
    /// Largest ratio of circumradius to shortest edge, at least 1: 1/(2 sin α) for angles of at least α.
    pub ratio: f64,
    /// Largest area.
    pub area: f64,
    /// Area below which a triangle is left as it is, whatever its shape.
    pub noise: f64,
}

/// A little nearer than where the angle is the smallest one wanted, so that rounding does not make it smaller.
const OFF_CENTRE: f64 = 0.95;

/// Refine the faces that are `inside`, which constraint edges separate from those outside.
///
/// `number` gives the caller's numbers of the vertices. Triangles are taken in an order of these numbers, so that a domain
/// gets the same points wherever it lies.
pub(crate) fn refine_unsplit(
    cdt: &mut Cdt,
    inside: &[bool],
    number: impl Fn(FixedVertexHandle) -> usize,
    limits: &Limits,
) {
    let mut inside = inside.to_vec();
    let mut first: Vec<([usize; 3], Face)> = cdt
        .inner_faces()
        .filter(|f| inside[f.index()])
        .map(|f| {
            let mut key = f.vertices().map(|v| number(v.fix()));
            key.sort_unstable();
            (key, f.fix())
        })
        .collect();
    first.sort_unstable_by_key(|f| f.0);
    let mut queue: VecDeque<Face> = first.into_iter().map(|f| f.1).collect();
    let mut cavity = Vec::new();
    while let Some(face) = queue.pop_front() {
        let Some(centre) = centre_of_bad(cdt, face, limits) else { continue };
        let hint = cdt.face(face).vertices()[0].fix();
        if !starts(cdt, &inside, centre, hint, &mut cavity) || encroaches(cdt, &mut cavity, centre) {
            continue;
        }
        let Ok(vertex) = cdt.insert_with_hint(centre, hint) else { continue };
        inside.resize(cdt.num_all_faces(), false);
        // All triangles that changed are at the new vertex.
        let mut changed: Vec<(usize, Face)> = cdt
            .vertex(vertex)
            .out_edges()
            .filter_map(|edge| Some((number(edge.to().fix()), edge.face().fix().as_inner()?)))
            .collect();
        changed.sort_unstable_by_key(|c| c.0);
        for (_, face) in changed {
            inside[face.index()] = true;
            queue.push_back(face);
        }
    }
}

/// Sides of the triangles that hold a point; false if these are not in the domain, or it is no new point.
fn starts(
    cdt: &Cdt,
    inside: &[bool],
    point: Point2<f64>,
    hint: FixedVertexHandle,
    sides: &mut Vec<FixedDirectedEdgeHandle>,
) -> bool {
    sides.clear();
    match cdt.locate_with_hint(point, hint) {
        PositionInTriangulation::OnFace(face) => {
            sides.extend(cdt.face(face).adjacent_edges().map(|e| e.fix()));
            inside[face.index()]
        }
        PositionInTriangulation::OnEdge(edge) => {
            let edge = cdt.directed_edge(edge);
            for edge in [edge, edge.rev()] {
                sides.extend([edge.next().fix(), edge.prev().fix()]);
            }
            inside[edge.face().index()] && !edge.as_undirected().is_constraint_edge()
        }
        _ => false,
    }
}

/// Where to put a point into a triangle that is too large or too thin, if it is.
///
/// On the bisector of its shortest edge, at the circumcentre or nearer if the angle over that edge is then no smaller than
/// wanted (Üngör: *Off-centers*, 2004). Circumcentres of flat triangles lie far off, often beyond another constraint edge.
fn centre_of_bad(cdt: &Cdt, face: Face, limits: &Limits) -> Option<Point2<f64>> {
    let face = cdt.face(face);
    let area = face.area();
    let (centre, radius2) = face.circumcircle();
    let edges = face.adjacent_edges();
    let shortest = edges.into_iter().min_by(|a, b| a.length_2().total_cmp(&b.length_2()))?;
    let thin = radius2 > limits.ratio * limits.ratio * shortest.length_2() && area > limits.noise;
    if area <= limits.area && !thin {
        return None;
    }
    let [a, b] = shortest.positions();
    let middle = Point2::new((a.x + b.x) / 2.0, (a.y + b.y) / 2.0);
    let (dx, dy) = (centre.x - middle.x, centre.y - middle.y);
    let height = dx.hypot(dy);
    // Half the edge over tan(α/2), with sin α = 1/(2 ratio).
    let furthest = OFF_CENTRE
        * shortest.length_2().sqrt()
        * (limits.ratio + (limits.ratio * limits.ratio - 0.25).sqrt());
    let part = if height > furthest { furthest / height } else { 1.0 };
    Some(mitigate_underflow(Point2::new(middle.x + part * dx, middle.y + part * dy)))
}

/// Whether a point would lie in the diametral circle of a constraint edge that it sees, if it were inserted where the
/// `cavity` starts.
fn encroaches(cdt: &Cdt, cavity: &mut Vec<FixedDirectedEdgeHandle>, point: Point2<f64>) -> bool {
    while let Some(edge) = cavity.pop() {
        let edge = cdt.directed_edge(edge);
        if edge.as_undirected().is_constraint_edge() {
            let [a, b] = edge.positions();
            // The angle at the point is not acute.
            if (a.x - point.x) * (b.x - point.x) + (a.y - point.y) * (b.y - point.y) <= 0.0 {
                return true;
            }
        } else if sees(edge, point) {
            let beyond = edge.rev();
            cavity.extend([beyond.next().fix(), beyond.prev().fix()]);
        }
    }
    false
}

/// Whether a point on the left of an edge lies in the circumcircle of the triangle beyond it.
fn sees(edge: Edge<'_>, point: Point2<f64>) -> bool {
    let Some(opposite) = edge.rev().opposite_position() else { return false };
    let [a, b] = edge.positions();
    let coordinates = |p: Point2<f64>| Coord { x: p.x, y: p.y };
    incircle(coordinates(b), coordinates(a), coordinates(opposite), coordinates(point)) > 0.0
}

#[cfg(test)]
mod tests {
    use crate::mesh::triangulation::{Refinement, TriangulationError, triangulate_unsplit};

    fn area([a, b, c]: [[f64; 2]; 3]) -> f64 {
        ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])) / 2.0
    }

    #[test]
    fn walls_that_end_inside_are_kept_and_hide_nothing() {
        let square: Vec<[f64; 2]> = crate::layout::test_domains::square().points;
        let n = square.len();
        let points = [&square[..], &[[0.5, 0.4], [0.5, 0.6]]].concat();
        let limits = Refinement { min_angle: 28.0, max_area: Some(0.002) };
        let mesh = triangulate_unsplit(&points, &[(0..n).collect()], &[[n, n + 1], [4, n]], limits).unwrap();
        let corners = |t: &[usize; 3]| t.map(|v| mesh.points[v]);
        assert!(mesh.triangles.iter().all(|t| area(corners(t)) <= 0.002));
        assert!((mesh.triangles.iter().map(|t| area(corners(t))).sum::<f64>() - 1.0).abs() < 1e-12);
        for wall in [[n, n + 1], [4, n]] {
            assert_eq!(mesh.triangles.iter().filter(|t| wall.iter().all(|v| t.contains(v))).count(), 2);
        }
    }

    #[test]
    fn flat_triangles_at_the_outline_are_mended() {
        // A strip with a slightly bent side: circumcentres of triangles along it lie beyond the other side.
        let mut points: Vec<[f64; 2]> =
            (0..=20).map(|i| [i as f64 / 20.0, -1e-3 * (1.0 - (i as f64 / 10.0 - 1.0).powi(2))]).collect();
        points.extend((0..=20).map(|i| [1.0 - i as f64 / 20.0, 0.4]));
        let limits = Refinement { min_angle: 28.0, max_area: None };
        let mesh = triangulate_unsplit(&points, &[(0..points.len()).collect()], &[], limits).unwrap();
        let ears = mesh.triangles.iter().filter(|t| t[2] < 21 && t[1] < 21 && t[0] < 21).count();
        assert_eq!(ears, 0);
    }

    #[test]
    fn says_where_a_wall_leaves_the_domain() {
        let points = crate::layout::test_domains::l_shape().points;
        let limits = Refinement { min_angle: 28.0, max_area: None };
        // From one arm of the L to the other one, through the notch.
        let error = triangulate_unsplit(&points, &[(0..48).collect()], &[[20, 36]], limits).unwrap_err();
        assert!(matches!(error, TriangulationError::CrossingConstraints { .. }), "{error}");
    }
}
