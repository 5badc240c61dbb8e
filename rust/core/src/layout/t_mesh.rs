//! T-mesh of a seamless map: its motorcycle graph and outline cut the domain into faces that are rectangles in the
//! map, meeting in T-junctions.
//!
//! Half-arc 2a runs along arc a, half-arc 2a + 1 back. Around a node the outgoing half-arcs are known in their order from
//! how the node came about, without comparing angles: a vertex from the fan of its triangles, a junction from the side
//! on which its trace came in.

use super::charts::{ChartError, Charts, MappedMesh};
use super::graph::{MotorcycleGraph, Node, NodeKind};
use super::motorcycle::{self, TraceError};
use thiserror::Error;

/// Part of an outline's edge that hits stay away from its ends: more than rounding of ranks up to fifty thousand, far
/// less than anybody sees.
const NEAR_VERTEX: f64 = 1e-11;

/// Why there is no T-mesh.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum TMeshError {
    /// The traces cannot be laid.
    #[error(transparent)]
    Trace(#[from] TraceError),
    /// A face is no rectangle.
    #[error("the face at {point:?} has {corners} corners instead of four")]
    FaceCorners {
        /// Number of its corners.
        corners: usize,
        /// A node of the face.
        point: [f64; 2],
    },
    /// A half-arc is in no face or in two, or the outside of the domain is in one.
    #[error("the half-arc {half} at {point:?} is not in exactly one face")]
    HalfArc {
        /// The half-arc.
        half: usize,
        /// Where it starts.
        point: [f64; 2],
    },
    /// V − E + F is not that of the domain: some face is not simply connected, or arcs cross.
    #[error("the T-mesh has Euler's number {found}, the domain {expected}")]
    Euler {
        /// That of the T-mesh.
        found: i64,
        /// That of the domain.
        expected: i64,
    },
}

impl From<ChartError> for TMeshError {
    fn from(error: ChartError) -> Self {
        Self::Trace(error.into())
    }
}

/// A piece of a trace or of the outline.
#[derive(Debug, Clone, PartialEq)]
pub struct Arc {
    /// From and to.
    pub nodes: [usize; 2],
    /// Its polyline in the plane.
    pub points: Vec<[f64; 2]>,
    /// Length in the map from its start to every point of the polyline.
    pub places: Vec<f64>,
    /// Loop of the outline and positions on it; the second may exceed the loop's number of vertices.
    pub outline: Option<(usize, [f64; 2])>,
}

/// The outgoing half-arc that follows counter-clockwise, and the quarter turns between: 0 outside the domain, 2 on the
/// flat side of a junction.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sector {
    /// The next half-arc.
    pub next: usize,
    /// The quarter turns.
    pub quarters: u8,
}

/// Nodes, arcs and rectangular faces.
#[derive(Debug, Clone, PartialEq)]
pub struct TMesh {
    /// The nodes.
    pub nodes: Vec<Node>,
    /// Loop and position of nodes on the outline: rank of the vertex before plus the fraction of the edge.
    pub positions: Vec<Option<(usize, f64)>>,
    /// The arcs.
    pub arcs: Vec<Arc>,
    /// Half-arcs of the four sides of every face, counter-clockwise.
    pub faces: Vec<[Vec<usize>; 4]>,
    /// The sector on the left of every outgoing half-arc.
    pub sectors: Vec<Sector>,
}

impl TMesh {
    /// The T-mesh of a mapped mesh.
    pub fn new(mesh: MappedMesh<'_>) -> Result<Self, TMeshError> {
        let charts = Charts::new(mesh)?;
        let graph = motorcycle::trace(&charts)?;
        let mut rings = vec![Ring::default(); graph.nodes.len()];
        let mut arcs = trace_arcs(&graph, &mut rings);
        let positions = graph.nodes.iter().map(|node| position(&charts, node)).collect::<Vec<_>>();
        outline_arcs(&charts, &graph.nodes, &positions, &mut arcs, &mut rings);
        let sectors = sectors(&graph.nodes, &rings, 2 * arcs.len());
        let mut mesh = Self { nodes: graph.nodes, positions, arcs, faces: Vec::new(), sectors };
        mesh.faces = mesh.walk_faces()?;
        let found = mesh.nodes.len() as i64 - mesh.arcs.len() as i64 + mesh.faces.len() as i64;
        let expected = charts.adjacency.euler();
        if found == expected { Ok(mesh) } else { Err(TMeshError::Euler { found, expected }) }
    }

    /// The node where a half-arc starts.
    pub fn origin(&self, half: usize) -> usize {
        self.arcs[half / 2].nodes[half % 2]
    }

    fn is_outside(&self, half: usize) -> bool {
        half % 2 == 1 && self.arcs[half / 2].outline.is_some()
    }

    /// Faces lie on the left of their half-arcs.
    fn walk_faces(&self) -> Result<Vec<[Vec<usize>; 4]>, TMeshError> {
        let halves = self.sectors.len();
        let at = |half: usize| self.nodes[self.origin(half)].point;
        let mut previous = vec![usize::MAX; halves];
        for (half, sector) in self.sectors.iter().enumerate() {
            if sector.next >= halves || previous[sector.next] != usize::MAX {
                return Err(TMeshError::HalfArc { half, point: at(half) });
            }
            previous[sector.next] = half;
        }
        let mut seen = vec![false; halves];
        let mut faces = Vec::new();
        for start in (0..halves).filter(|&h| !self.is_outside(h)) {
            if seen[start] {
                continue;
            }
            let mut around = Vec::new();
            let mut half = start;
            while !seen[half] {
                if self.is_outside(half) {
                    return Err(TMeshError::HalfArc { half, point: at(half) });
                }
                seen[half] = true;
                let next = previous[half ^ 1];
                around.push((half, self.sectors[next].quarters == 1));
                half = next;
            }
            if half != start {
                return Err(TMeshError::HalfArc { half, point: at(half) });
            }
            faces.push(
                sides(around).map_err(|corners| TMeshError::FaceCorners { corners, point: at(start) })?,
            );
        }
        Ok(faces)
    }
}

/// Half-arcs of a face, each with whether a corner follows, as four sides; or the number of corners.
fn sides(mut around: Vec<(usize, bool)>) -> Result<[Vec<usize>; 4], usize> {
    let corners = around.iter().filter(|h| h.1).count();
    let Some(last) = around.iter().rposition(|h| h.1).filter(|_| corners == 4) else { return Err(corners) };
    let after_corner = (last + 1) % around.len();
    around.rotate_left(after_corner);
    let mut sides: [Vec<usize>; 4] = Default::default();
    let mut side = 0;
    for (half, corner) in around {
        sides[side].push(half);
        side += usize::from(corner);
    }
    Ok(sides)
}

/// Outgoing half-arcs of a node by how it came about: along the outline or the trace that goes on, back along it, and
/// those of traces that start or end here.
#[derive(Debug, Clone, Default)]
struct Ring {
    ahead: Option<usize>,
    back: Option<usize>,
    others: Vec<usize>,
}

/// Arcs of the traces.
fn trace_arcs(graph: &MotorcycleGraph, rings: &mut [Ring]) -> Vec<Arc> {
    let mut arcs = Vec::new();
    for trace in &graph.traces {
        let mut from = (0.0, trace.origin);
        rings[trace.origin].others.push(2 * arcs.len());
        for (i, stop) in trace.stops.iter().enumerate() {
            let half = 2 * arcs.len();
            let (mut points, mut places) = (vec![graph.nodes[from.1].point], vec![0.0]);
            let between = trace.crossings.iter().filter(|c| from.0 < c.0 && c.0 < stop.length);
            for (length, point) in between.chain([&(stop.length, graph.nodes[stop.node].point)]) {
                points.push(*point);
                places.push(length - from.0);
            }
            arcs.push(Arc { nodes: [from.1, stop.node], points, places, outline: None });
            if i + 1 < trace.stops.len() {
                rings[stop.node].back = Some(half + 1);
                rings[stop.node].ahead = Some(half + 2);
            } else {
                rings[stop.node].others.push(half + 1);
            }
            from = (stop.length, stop.node);
        }
    }
    arcs
}

/// Loop and position of a node on the outline.
fn position(charts: &Charts<'_>, node: &Node) -> Option<(usize, f64)> {
    let (vertex, fraction) = match node.kind {
        NodeKind::Vertex(vertex) => (vertex, 0.0),
        NodeKind::Hit { vertex, fraction } => (vertex, fraction),
        NodeKind::Junction { .. } | NodeKind::Join => return None,
    };
    let index = *charts.mesh.loops.get(vertex)?;
    Some((index, charts.rank[vertex] as f64 + fraction))
}

/// Arcs of the outline, from each of its nodes to the next one.
fn outline_arcs(
    charts: &Charts<'_>,
    nodes: &[Node],
    positions: &[Option<(usize, f64)>],
    arcs: &mut Vec<Arc>,
    rings: &mut [Ring],
) {
    for (index, polygon) in charts.loops.iter().enumerate() {
        // A hit at the very end of an edge comes before the vertex there, one at its start after it.
        let place = |i: usize| match nodes[i].kind {
            NodeKind::Vertex(v) => (charts.rank[v], -1.0),
            NodeKind::Hit { vertex, fraction } => (charts.rank[vertex], fraction),
            NodeKind::Junction { .. } | NodeKind::Join => {
                unreachable!("nodes of the outline have a position")
            }
        };
        let mut on: Vec<usize> =
            (0..nodes.len()).filter(|&i| positions[i].is_some_and(|(l, _)| l == index)).collect();
        on.sort_by(|&a, &b| {
            let (a, b) = (place(a), place(b));
            a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))
        });
        let lengths: Vec<f64> = polygon.iter().map(|&v| outline_edge(charts, v)).collect();
        for (i, &from) in on.iter().enumerate() {
            let to = on[(i + 1) % on.len()];
            let (start, mut end) = (inside_edge(place(from)), inside_edge(place(to)));
            if i + 1 == on.len() {
                end.0 += polygon.len();
            }
            let (mut points, mut places) = (vec![nodes[from].point], vec![0.0]);
            let mut length = -start.1 * lengths[start.0];
            for k in start.0 + 1..=end.0 {
                length += lengths[(k - 1) % polygon.len()];
                if k < end.0 || end.1 > 0.0 {
                    points.push(charts.mesh.points[polygon[k % polygon.len()]]);
                    places.push(length);
                }
            }
            points.push(nodes[to].point);
            places.push(length + end.1 * lengths[end.0 % polygon.len()]);
            let half = 2 * arcs.len();
            rings[from].ahead = Some(half);
            rings[to].back = Some(half + 1);
            let interval = [start.0 as f64 + start.1, end.0 as f64 + end.1];
            arcs.push(Arc { nodes: [from, to], points, places, outline: Some((index, interval)) });
        }
    }
}

/// A place on an edge of the outline, rank of its vertex and fraction, that stays on the edge as a sum of the two.
///
/// The fraction of a hit that all but reaches a vertex would be lost in the sum, and with it which side of the vertex
/// the hit is on.
fn inside_edge((rank, fraction): (usize, f64)) -> (usize, f64) {
    (rank, if fraction < 0.0 { 0.0 } else { fraction.clamp(NEAR_VERTEX, 1.0 - NEAR_VERTEX) })
}

/// Length in the map of the outline's edge after a vertex.
fn outline_edge(charts: &Charts<'_>, vertex: usize) -> f64 {
    charts.adjacency.ring(vertex).next().map_or(0.0, |corner| {
        let uv = charts.mesh.uv[corner.face];
        let (a, b) = (uv[corner.index], uv[(corner.index + 1) % 3]);
        (b[0] - a[0]).hypot(b[1] - a[1])
    })
}

/// Sectors of all half-arcs; one that is left out keeps a successor that does not exist.
fn sectors(nodes: &[Node], rings: &[Ring], halves: usize) -> Vec<Sector> {
    let mut sectors = vec![Sector { next: usize::MAX, quarters: 0 }; halves];
    for (node, ring) in nodes.iter().zip(rings) {
        let bar = |half: Option<usize>| half.into_iter();
        let mut around: Vec<usize> = Vec::with_capacity(ring.others.len() + 2);
        // Counter-clockwise from the way ahead.
        let flat = match node.kind {
            NodeKind::Junction { from_left: false } => {
                around.extend(bar(ring.ahead).chain(bar(ring.back)).chain(ring.others.iter().copied()));
                Some((0, 2))
            }
            kind => {
                around.extend(bar(ring.ahead).chain(ring.others.iter().copied()).chain(bar(ring.back)));
                match kind {
                    NodeKind::Junction { .. } => Some((2, 2)),
                    // Behind the outline.
                    _ if ring.ahead.is_some() => Some((around.len() - 1, 0)),
                    _ => None,
                }
            }
        };
        for (i, &half) in around.iter().enumerate() {
            let straight = if node.kind == NodeKind::Join { 2 } else { 1 };
            let quarters = flat.filter(|f| f.0 == i).map_or(straight, |f| f.1);
            sectors[half] = Sector { next: around[(i + 1) % around.len()], quarters };
        }
    }
    sectors
}

#[cfg(test)]
#[path = "t_mesh_tests.rs"]
mod tests;
