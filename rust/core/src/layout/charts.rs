//! A triangle mesh with a seamless map: every triangle is a chart, neighbouring charts differ by quarter turns and
//! translations, and axis directions are carried from one to the next.

use std::f64::consts::FRAC_PI_2;

use super::adjacency::{Adjacency, AdjacencyError, Place};
use thiserror::Error;

/// A quarter turn count of an axis direction: 0 is +u, 1 is +v, 2 is −u, 3 is −v.
pub type Direction = u8;

/// Coordinate along a direction.
pub fn forward(direction: Direction, p: [f64; 2]) -> f64 {
    match direction % 4 {
        0 => p[0],
        1 => p[1],
        2 => -p[0],
        _ => -p[1],
    }
}

/// Coordinate along the direction a quarter turn to the left.
pub fn leftward(direction: Direction, p: [f64; 2]) -> f64 {
    forward(direction + 1, p)
}

/// Why arrays are not a mapped mesh.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum ChartError {
    /// The triangles are no domain.
    #[error(transparent)]
    Adjacency(#[from] AdjacencyError),
    /// Two arrays do not fit.
    #[error("{found} {what} for {expected}")]
    Size {
        /// What is counted.
        what: &'static str,
        /// How many there must be.
        expected: usize,
        /// How many there are.
        found: usize,
    },
    /// A coordinate is NaN or infinite.
    #[error("triangle {face} has coordinates that are not finite")]
    NotFinite {
        /// The triangle.
        face: usize,
    },
    /// The next vertex of the outline is not at the end of an outline edge, or lies on another loop.
    #[error("vertex {vertex} of the outline is not followed by vertex {next} on its loop")]
    Outline {
        /// The vertex.
        vertex: usize,
        /// The one that should follow.
        next: usize,
    },
    /// The vertices of one loop are not one cycle, or a number of a loop is left out.
    #[error("loop {index} of the outline is not one closed polygon")]
    Loop {
        /// The loop.
        index: usize,
    },
    /// The directions at a vertex are not those that its index promises; the map folds there.
    #[error("vertex {vertex} at {point:?} sends {found} traces where its index wants {wanted}")]
    TraceCount {
        /// The vertex.
        vertex: usize,
        /// Its place.
        point: [f64; 2],
        /// Axis directions strictly inside the domain.
        found: i64,
        /// Their number by the index.
        wanted: i64,
    },
}

/// What the T-mesh is made of, all arrays plain.
#[derive(Debug, Clone, Copy)]
pub struct MappedMesh<'a> {
    /// Vertices; the first are those of the outline.
    pub points: &'a [[f64; 2]],
    /// Counter-clockwise triangles.
    pub triangles: &'a [[usize; 3]],
    /// The map at the corners of every triangle.
    pub uv: &'a [[[f64; 2]; 3]],
    /// Quarter turns r across every side: uv of the neighbour = Rʳ uv + t.
    pub rotation: &'a [[u8; 3]],
    /// Inside 4 − valence, on the outline the number of quads.
    pub index: &'a [i64],
    /// The next vertex of the outline, the domain on the left.
    pub next: &'a [usize],
    /// Loop of every vertex of the outline.
    pub loops: &'a [usize],
    /// Whether a vertex of the outline is a corner.
    pub corner: &'a [bool],
}

/// The mesh with its adjacency and the loops of its outline.
#[derive(Debug, Clone)]
pub struct Charts<'a> {
    /// The arrays.
    pub mesh: MappedMesh<'a>,
    /// Neighbours of the triangles.
    pub adjacency: Adjacency,
    /// Vertices of every loop from its smallest one on.
    pub loops: Vec<Vec<usize>>,
    /// Rank of every vertex of the outline in its loop.
    pub rank: Vec<usize>,
    /// Traces nearer to each other than this are on one line.
    pub tolerance: f64,
    /// Vertices nearer to a trace than this are on its line.
    pub touch: f64,
    /// Lengths of paths that differ by less are equal.
    pub instant: f64,
}

/// Traces nearer than this fraction of the median edge are on one line. Those that are in the exact map were apart by
/// 1e-11 of an edge at most, by rounding; those that only come near each other by discretisation by 8e-7 at least (200
/// domains: glyphs, parts, random outlines).
const TOLERANCE: f64 = 1e-8;

/// Less than half of that: two traces on whose lines one vertex lies, and which may pass it on different sides, must be
/// on one line themselves.
const TOUCH: f64 = 0.4 * TOLERANCE;

/// Times that differ by less are equal: above rounding, too.
const INSTANT: f64 = 0.25 * TOLERANCE;

impl<'a> Charts<'a> {
    /// Check the arrays and connect them.
    pub fn new(mesh: MappedMesh<'a>) -> Result<Self, ChartError> {
        let (n, m, b) = (mesh.points.len(), mesh.triangles.len(), mesh.next.len());
        let sizes = [
            ("triangles of the map", mesh.uv.len(), m),
            ("triangles of rotations", mesh.rotation.len(), m),
            ("indices of vertices", mesh.index.len(), n),
            ("loops of outline vertices", mesh.loops.len(), b),
            ("corner flags", mesh.corner.len(), b),
            ("outline vertices among the points", b.min(n), b),
        ];
        if let Some(&(what, found, expected)) = sizes.iter().find(|s| s.1 != s.2) {
            return Err(ChartError::Size { what, expected, found });
        }
        let adjacency = Adjacency::new(n, mesh.triangles)?;
        let finite = |p: &[f64; 2]| p[0].is_finite() && p[1].is_finite();
        let sound = |f: usize| {
            mesh.uv[f].iter().all(finite) && mesh.triangles[f].iter().all(|&v| finite(&mesh.points[v]))
        };
        if let Some(face) = (0..m).find(|&f| !sound(f)) {
            return Err(ChartError::NotFinite { face });
        }
        let (loops, rank) = loops_of(&mesh, &adjacency)?;
        let mut edges: Vec<f64> =
            mesh.uv.iter().map(|t| (t[1][0] - t[0][0]).hypot(t[1][1] - t[0][1])).collect();
        edges.sort_unstable_by(f64::total_cmp);
        let edge = edges.get(m / 2).copied().unwrap_or(0.0);
        let [tolerance, touch, instant] = [TOLERANCE, TOUCH, INSTANT].map(|x| x * edge);
        Ok(Self { mesh, adjacency, loops, rank, tolerance, touch, instant })
    }

    /// The vertex at a corner.
    pub fn vertex(&self, corner: Place) -> usize {
        self.mesh.triangles[corner.face][corner.index]
    }

    /// The map at a corner.
    pub fn uv(&self, corner: Place) -> [f64; 2] {
        self.mesh.uv[corner.face][corner.index]
    }

    /// Whether traces start at a vertex: a singularity, a corner, or an outline vertex that is not smooth in the map.
    pub fn is_critical(&self, vertex: usize) -> bool {
        if vertex < self.mesh.next.len() {
            self.mesh.corner[vertex] || self.mesh.index[vertex] != 2
        } else {
            self.mesh.index[vertex] != 0
        }
    }

    /// Loops, the longest first: the outer one, whose trace reaches the most others.
    pub fn loops_by_length(&self) -> Vec<usize> {
        let p = self.mesh.points;
        let length = |index: usize| -> f64 {
            self.loops[index].iter().map(|&v| distance(p[v], p[self.mesh.next[v]])).sum()
        };
        let mut order: Vec<(f64, usize)> = (0..self.loops.len()).map(|i| (length(i), i)).collect();
        order.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        order.into_iter().map(|(_, i)| i).collect()
    }

    /// The vertex of a loop farthest from the domain's centroid, which does not depend on where the loop starts, nor on
    /// the axes of the plane. On a symmetric domain it lies on an axis, or its images are as good.
    pub fn remotest(&self, index: usize) -> usize {
        let (p, polygon) = (self.mesh.points, &self.loops[index]);
        let (mut center, mut area) = ([0.0; 2], 0.0);
        for t in self.mesh.triangles {
            let [a, b, c] = t.map(|v| p[v]);
            let double = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
            area += 3.0 * double;
            (0..2).for_each(|i| center[i] += double * (a[i] + b[i] + c[i]));
        }
        let center = center.map(|x| x / area);
        let far = polygon.iter().map(|&v| distance(p[v], center)).fold(0.0, f64::max);
        // The first of those that are as far but for rounding.
        *polygon.iter().find(|&&v| distance(p[v], center) >= far * (1.0 - 1e-9)).unwrap_or(&polygon[0])
    }

    /// Corners and axis directions of the traces that leave a vertex, counter-clockwise.
    ///
    /// The fan is unrolled by its angles, so that every direction is found once; one along an edge, to within the
    /// tolerance, belongs to the triangle on the left of the edge.
    pub fn launches(&self, vertex: usize) -> Result<Vec<(Place, Direction)>, ChartError> {
        let on_outline = vertex < self.mesh.next.len();
        let index = self.mesh.index[vertex];
        let wanted = if on_outline { index - 1 } else { 4 - index };
        let fan: Vec<Spoke> = self.adjacency.ring(vertex).map(|corner| self.spoke(corner)).collect();
        // A fan that folds over is missed only where it should send traces.
        let total: f64 = fan.iter().map(|s| s.wedge).sum();
        let found = ((total / FRAC_PI_2).round() as i64 - i64::from(on_outline)).max(0);
        let wrong = ChartError::TraceCount { vertex, point: self.mesh.points[vertex], found, wanted };
        if found != wanted || (wanted == 0 && !on_outline) {
            return Err(wrong);
        }
        // The first axis at or after the first edge; the outline itself is no trace.
        let quarters = fan[0].angle / FRAC_PI_2;
        let nearest = quarters.round();
        let aligned = on_outline || ((nearest - quarters) * FRAC_PI_2 * fan[0].length).abs() <= self.touch;
        let axis = if aligned { nearest } else { quarters.ceil() } + f64::from(on_outline);
        let mut targets = (0..wanted).map(|i| (axis - quarters + i as f64) * FRAC_PI_2).peekable();
        let mut launches = Vec::new();
        let mut turned = 0.0;
        for (i, spoke) in fan.iter().enumerate() {
            let end = turned + spoke.wedge;
            let last = fan[(i + 1) % fan.len()].length.max(f64::MIN_POSITIVE);
            while let Some(&target) = targets.peek() {
                let final_wedge = on_outline && i + 1 == fan.len();
                if !final_wedge && (end - target) * last <= self.touch {
                    break;
                }
                let direction = ((spoke.angle + target - turned) / FRAC_PI_2).round() as i64;
                launches.push((spoke.corner, direction.rem_euclid(4) as Direction));
                targets.next();
            }
            turned = end;
        }
        if launches.len() as i64 != wanted { Err(wrong) } else { Ok(launches) }
    }

    fn spoke(&self, corner: Place) -> Spoke {
        let at = |i: usize| self.uv(Place { face: corner.face, index: (corner.index + i) % 3 });
        let to = |p: [f64; 2]| [p[0] - at(0)[0], p[1] - at(0)[1]];
        let (a, b) = (to(at(1)), to(at(2)));
        Spoke {
            corner,
            angle: a[1].atan2(a[0]),
            wedge: (a[0] * b[1] - a[1] * b[0]).atan2(a[0] * b[0] + a[1] * b[1]),
            length: a[0].hypot(a[1]),
        }
    }
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// A triangle at a vertex: the edge with which it begins, and its angle.
struct Spoke {
    corner: Place,
    angle: f64,
    wedge: f64,
    length: f64,
}

type Loops = (Vec<Vec<usize>>, Vec<usize>);

fn loops_of(mesh: &MappedMesh<'_>, adjacency: &Adjacency) -> Result<Loops, ChartError> {
    let b = mesh.next.len();
    for vertex in 0..adjacency.n_vertices() {
        let next = mesh.next.get(vertex).copied();
        let outgoing = adjacency
            .ring(vertex)
            .next()
            .filter(|_| adjacency.on_outline[vertex])
            .map(|corner| mesh.triangles[corner.face][(corner.index + 1) % 3]);
        if next != outgoing || next.is_some_and(|w| w >= b || mesh.loops[vertex] != mesh.loops[w]) {
            return Err(ChartError::Outline { vertex, next: next.or(outgoing).unwrap_or(vertex) });
        }
    }
    let count = mesh.loops.iter().max().map_or(0, |&l| l.saturating_add(1));
    if count > b {
        return Err(ChartError::Loop { index: count - 1 });
    }
    let (mut loops, mut rank) = (vec![Vec::new(); count], vec![usize::MAX; b]);
    for first in 0..b {
        if rank[first] != usize::MAX {
            continue;
        }
        let polygon = &mut loops[mesh.loops[first]];
        if !polygon.is_empty() {
            return Err(ChartError::Loop { index: mesh.loops[first] });
        }
        let mut vertex = first;
        while rank[vertex] == usize::MAX {
            rank[vertex] = polygon.len();
            polygon.push(vertex);
            vertex = mesh.next[vertex];
        }
    }
    match loops.iter().position(Vec::is_empty) {
        Some(index) => Err(ChartError::Loop { index }),
        None => Ok((loops, rank)),
    }
}
