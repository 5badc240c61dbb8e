//! Delaunay refinement that splits no constraint edge (Chew: *Guaranteed-quality triangular meshes*, 1989).
//!
//! Circumcentres of bad triangles are inserted, unless they lie in the diametral circle of a constraint edge. Bad are
//! triangles whose circumradius exceeds their shortest edge, and a little more, so that no edge ever becomes shorter than the
//! shortest one at hand: the refinement ends. `spade`'s own refinement cannot tell the domain from its outside where
//! constraint edges end inside it.

use std::collections::VecDeque;

use robust::{Coord, incircle};
use spade::handles::{DirectedEdgeHandle, FixedDirectedEdgeHandle, FixedFaceHandle, InnerTag};
use spade::{CdtEdge, Point2, PositionInTriangulation, Triangulation, mitigate_underflow};

use crate::triangulation::Cdt;

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

/// Refine the faces that are `inside`, which constraint edges separate from those outside.
pub(crate) fn refine_unsplit(cdt: &mut Cdt, inside: &[bool], limits: &Limits) {
    let mut inside = inside.to_vec();
    let mut queue: VecDeque<Face> = cdt.fixed_inner_faces().filter(|f| inside[f.index()]).collect();
    let mut cavity = Vec::new();
    while let Some(face) = queue.pop_front() {
        let Some(centre) = centre_of_bad(cdt, face, limits) else { continue };
        let hint = cdt.face(face).vertices()[0].fix();
        cavity.clear();
        match cdt.locate_with_hint(centre, hint) {
            PositionInTriangulation::OnFace(f) if inside[f.index()] => {
                cavity.extend(cdt.face(f).adjacent_edges().map(|e| e.fix()));
            }
            PositionInTriangulation::OnEdge(e) if !cdt.directed_edge(e).is_constraint_edge() => {
                let edge = cdt.directed_edge(e);
                if !inside[edge.face().index()] {
                    continue;
                }
                for edge in [edge, edge.rev()] {
                    cavity.extend([edge.next().fix(), edge.prev().fix()]);
                }
            }
            _ => continue,
        }
        if encroaches(cdt, &mut cavity, centre) {
            continue;
        }
        let Ok(vertex) = cdt.insert_with_hint(centre, hint) else { continue };
        inside.resize(cdt.num_all_faces(), false);
        // All triangles that changed are at the new vertex.
        for edge in cdt.vertex(vertex).out_edges() {
            if let Some(f) = edge.face().fix().as_inner() {
                inside[f.index()] = true;
                queue.push_back(f);
            }
        }
    }
}

/// Circumcentre of a triangle that is too large or too thin.
fn centre_of_bad(cdt: &Cdt, face: Face, limits: &Limits) -> Option<Point2<f64>> {
    let face = cdt.face(face);
    let area = face.area();
    if area <= limits.area {
        let (centre, radius2) = face.circumcircle();
        let shortest2 = face.adjacent_edges().map(|e| e.length_2()).into_iter().fold(f64::INFINITY, f64::min);
        let thin = radius2 > limits.ratio * limits.ratio * shortest2;
        return (thin && area > limits.noise).then(|| mitigate_underflow(centre));
    }
    Some(mitigate_underflow(face.circumcenter()))
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
