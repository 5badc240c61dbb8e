//! Delaunay refinement that splits no constraint edge (Chew: *Guaranteed-quality triangular meshes*, 1989).
//!
//! Circumcentres or off-centres of bad triangles are inserted, unless they lie in the diametral circle of a constraint
//! edge. Bad are triangles whose circumradius exceeds their shortest edge, and a little more, so that no edge ever becomes
//! shorter than the shortest one at hand: the refinement ends. `spade`'s own refinement cannot tell the domain from its
//! outside where constraint edges end inside it.

use std::collections::VecDeque;

use robust::{Coord, incircle};
use spade::handles::{
    DirectedEdgeHandle, FixedDirectedEdgeHandle, FixedFaceHandle, FixedVertexHandle, InnerTag,
};
use spade::{
    CdtEdge, ConstrainedDelaunayTriangulation, Point2, PositionInTriangulation, Triangulation,
    mitigate_underflow,
};

pub(crate) type Cdt = ConstrainedDelaunayTriangulation<Point2<f64>>;
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

/// A number of at most 5·10⁻⁸, and another one for every `k`: by how much points are moved, in parts of an edge.
///
/// Domains with an axis of symmetry are full of quads in a circle, and so is what refinement makes of them. Without a
/// motion rounding would decide between their diagonals, and otherwise again where the domain lies in another direction.
pub(crate) fn decision(k: usize) -> f64 {
    // Steele, Lea, Flood: SplitMix, 2014. What is linear in the number would keep the symmetry of straight sides.
    let mut z = (k as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    1e-7 * ((z ^ (z >> 31)) as f64 / u64::MAX as f64 - 0.5)
}

/// Refine the faces that are `inside`, which constraint edges separate from those outside.
///
/// `number` gives the caller's numbers of the vertices. Triangles are taken in an order of these numbers, so that a
/// domain gets the same points wherever it lies.
pub(crate) fn refine_unsplit(
    cdt: &mut Cdt,
    inside: &[bool],
    number: impl Fn(FixedVertexHandle) -> usize,
    limits: &Limits,
) {
    let mut inside = inside.to_vec();
    // A face may have become another triangle when its turn comes.
    let key = |cdt: &Cdt, face: Face| {
        let mut key = cdt.face(face).vertices().map(|v| number(v.fix()));
        key.sort_unstable();
        key
    };
    let mut first: Vec<([usize; 3], Face)> =
        cdt.fixed_inner_faces().filter(|f| inside[f.index()]).map(|f| (key(cdt, f), f)).collect();
    first.sort_unstable_by_key(|f| f.0);
    let mut queue = VecDeque::from(first);
    let mut cavity = Vec::new();
    while let Some((triangle, face)) = queue.pop_front() {
        if key(cdt, face) != triangle {
            continue;
        }
        let Some(centre) = centre_of_bad(cdt, face, limits) else { continue };
        let hint = cdt.face(face).vertices()[0].fix();
        if !starts(cdt, &inside, centre, hint, &mut cavity) || encroaches(cdt, &mut cavity, centre) {
            continue;
        }
        let Ok(vertex) = cdt.insert_with_hint(centre, hint) else { continue };
        inside.resize(cdt.num_all_faces(), false);
        // All triangles that changed are at the new vertex.
        let faces = cdt.vertex(vertex).out_edges().filter_map(|edge| edge.face().fix().as_inner());
        let mut changed: Vec<([usize; 3], Face)> = faces.map(|f| (key(cdt, f), f)).collect();
        changed.sort_unstable_by_key(|c| c.0);
        changed.iter().for_each(|(_, face)| inside[face.index()] = true);
        queue.extend(changed);
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
/// On the bisector of its shortest edge, at the circumcentre or nearer if the angle over that edge is then no smaller
/// than wanted (Üngör: *Off-centers*, 2004). Circumcentres of flat triangles lie far off, often beyond another
/// constraint edge.
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
    let (along, across) = (part + decision(2 * cdt.num_vertices()), decision(2 * cdt.num_vertices() + 1));
    let place = [middle.x + along * dx - across * dy, middle.y + along * dy + across * dx];
    Some(mitigate_underflow(Point2::new(place[0], place[1])))
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
