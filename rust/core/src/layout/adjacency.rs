//! Which triangle lies across which edge: the combinatorics that all stages of the layout walk on.
//!
//! Corner `i` of a triangle is its `i`-th vertex, side `i` the edge opposite that vertex: it runs from corner
//! `i + 1` to corner `i + 2`, with the triangle on its left.

use thiserror::Error;

/// Why triangles are not the mesh of a domain.
#[derive(Debug, Error, Clone, PartialEq, Eq)]
pub enum AdjacencyError {
    /// A triangle names a vertex that does not exist.
    #[error("triangle {face} names vertex {vertex}, which does not exist")]
    UnknownVertex {
        /// The triangle.
        face: usize,
        /// The vertex it names.
        vertex: usize,
    },
    /// More than two triangles share an edge, or two triangles of opposite sense do.
    #[error("the triangles at the edge {edge:?} do not have one sense, or are more than two")]
    EdgeNotManifold {
        /// End points of the edge.
        edge: [usize; 2],
    },
    /// The triangles of a vertex are no single fan: the domain touches itself there.
    #[error("the triangles at vertex {vertex} are not one fan")]
    VertexNotManifold {
        /// The vertex.
        vertex: usize,
    },
}

/// A place of a triangle: its corner `index`, or the side opposite that corner.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Place {
    /// The triangle.
    pub face: usize,
    /// Which of its corners or sides.
    pub index: usize,
}

/// Edges of a triangulated domain and what they join.
#[derive(Debug, Clone)]
pub struct Adjacency {
    /// End points of every edge, the smaller one first, in lexicographic order.
    pub edges: Vec<[usize; 2]>,
    /// The edge on side `i` of every triangle.
    pub face_edges: Vec<[usize; 3]>,
    /// The side where every edge occurs first.
    pub edge_sides: Vec<Place>,
    /// The other side, `None` on the outline.
    pub edge_twins: Vec<Option<Place>>,
    /// The neighbour across side `i` of every triangle, as the side that it shows.
    pub neighbours: Vec<[Option<Place>; 3]>,
    /// Whether a vertex lies on the outline.
    pub on_outline: Vec<bool>,
    /// Where the ring of every vertex starts; `None` for vertices without triangles.
    fans: Vec<Option<Place>>,
}

impl Adjacency {
    /// Adjacency of counter-clockwise triangles over `vertices` points.
    pub fn new(vertices: usize, triangles: &[[usize; 3]]) -> Result<Self, AdjacencyError> {
        for (face, triangle) in triangles.iter().enumerate() {
            if let Some(&vertex) = triangle.iter().find(|&&v| v >= vertices) {
                return Err(AdjacencyError::UnknownVertex { face, vertex });
            }
        }
        let mut sides: Vec<([usize; 2], Place)> = Vec::with_capacity(3 * triangles.len());
        for (face, t) in triangles.iter().enumerate() {
            for index in 0..3 {
                let (a, b) = (t[(index + 1) % 3], t[(index + 2) % 3]);
                sides.push(([a.min(b), a.max(b)], Place { face, index }));
            }
        }
        sides.sort_unstable();
        let mut mesh = Self {
            edges: Vec::with_capacity(sides.len() / 2 + vertices),
            face_edges: vec![[0; 3]; triangles.len()],
            edge_sides: Vec::new(),
            edge_twins: Vec::new(),
            neighbours: vec![[None; 3]; triangles.len()],
            on_outline: vec![false; vertices],
            fans: vec![None; vertices],
        };
        for group in sides.chunk_by(|a, b| a.0 == b.0) {
            let (edge, side) = group[0];
            let start = |p: Place| triangles[p.face][(p.index + 1) % 3];
            let twin = group.get(1).map(|g| g.1);
            if group.len() > 2 || twin.is_some_and(|t| start(t) == start(side)) {
                return Err(AdjacencyError::EdgeNotManifold { edge });
            }
            for place in std::iter::once(side).chain(twin) {
                mesh.face_edges[place.face][place.index] = mesh.edges.len();
            }
            match twin {
                Some(twin) => {
                    mesh.neighbours[side.face][side.index] = Some(twin);
                    mesh.neighbours[twin.face][twin.index] = Some(side);
                }
                None => edge.iter().for_each(|&v| mesh.on_outline[v] = true),
            }
            mesh.edges.push(edge);
            mesh.edge_sides.push(side);
            mesh.edge_twins.push(twin);
        }
        mesh.start_fans(triangles)?;
        Ok(mesh)
    }

    /// A ring starts after the outline, or at the triangle of the smallest number.
    fn start_fans(&mut self, triangles: &[[usize; 3]]) -> Result<(), AdjacencyError> {
        let mut corners = vec![0_usize; self.fans.len()];
        for (face, t) in triangles.iter().enumerate() {
            for (index, &v) in t.iter().enumerate() {
                corners[v] += 1;
                let after_outline = self.neighbours[face][(index + 2) % 3].is_none();
                if after_outline || (self.fans[v].is_none() && !self.on_outline[v]) {
                    self.fans[v] = Some(Place { face, index });
                }
            }
        }
        match (0..corners.len()).find(|&v| self.ring(v).count() != corners[v]) {
            Some(vertex) => Err(AdjacencyError::VertexNotManifold { vertex }),
            None => Ok(()),
        }
    }

    /// Number of triangles.
    pub fn n_faces(&self) -> usize {
        self.face_edges.len()
    }

    /// Number of vertices.
    pub fn n_vertices(&self) -> usize {
        self.on_outline.len()
    }

    /// Whether an edge lies on the outline.
    pub fn is_outline_edge(&self, edge: usize) -> bool {
        self.edge_twins[edge].is_none()
    }

    /// Corners at a vertex, counter-clockwise; on the outline from its outgoing edge to its incoming one.
    ///
    /// The same corners come as often as there are triangles at the vertex: an inner ring is not closed by its first.
    pub fn ring(&self, vertex: usize) -> impl Iterator<Item = Place> + '_ {
        let first = self.fans[vertex];
        std::iter::successors(first, move |&corner| self.next_corner(corner).filter(|&c| Some(c) != first))
    }

    /// The next corner counter-clockwise at the same vertex; `None` at the outline.
    pub fn next_corner(&self, corner: Place) -> Option<Place> {
        self.neighbours[corner.face][(corner.index + 1) % 3]
            .map(|side| Place { face: side.face, index: (side.index + 1) % 3 })
    }

    /// Euler's number V − E + F of the vertices that triangles use.
    pub fn euler(&self) -> i64 {
        let used = self.fans.iter().flatten().count();
        used as i64 - self.edges.len() as i64 + self.n_faces() as i64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square about a middle point.
    const FAN: [[usize; 3]; 4] = [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]];

    fn faces(mesh: &Adjacency, vertex: usize) -> Vec<usize> {
        mesh.ring(vertex).map(|p| p.face).collect()
    }

    #[test]
    fn rings_are_counter_clockwise_and_start_at_the_outline() {
        let mesh = Adjacency::new(5, &FAN).unwrap();
        assert_eq!(faces(&mesh, 4), [0, 1, 2, 3]);
        assert_eq!(faces(&mesh, 0), [0, 3]);
        assert_eq!(faces(&mesh, 1), [1, 0]);
        assert_eq!(mesh.on_outline, [true, true, true, true, false]);
        assert_eq!(mesh.euler(), 1);
    }

    #[test]
    fn neighbours_share_an_edge() {
        let mesh = Adjacency::new(5, &FAN).unwrap();
        for face in 0..4 {
            for index in 0..3 {
                let edge = mesh.face_edges[face][index];
                let ends = mesh.edges[edge];
                assert!(!ends.contains(&FAN[face][index]));
                match mesh.neighbours[face][index] {
                    None => assert!(mesh.is_outline_edge(edge)),
                    Some(other) => {
                        assert_eq!(mesh.face_edges[other.face][other.index], edge);
                        assert_eq!(mesh.neighbours[other.face][other.index], Some(Place { face, index }));
                    }
                }
            }
        }
    }

    #[test]
    fn refuses_what_is_no_domain() {
        let unknown = AdjacencyError::UnknownVertex { face: 0, vertex: 2 };
        assert_eq!(Adjacency::new(2, &[[0, 1, 2]]).unwrap_err(), unknown);
        let sense = AdjacencyError::EdgeNotManifold { edge: [0, 1] };
        assert_eq!(Adjacency::new(4, &[[0, 1, 2], [0, 1, 3]]).unwrap_err(), sense);
        let bow = AdjacencyError::VertexNotManifold { vertex: 0 };
        assert_eq!(Adjacency::new(5, &[[0, 1, 2], [0, 3, 4]]).unwrap_err(), bow);
    }

    #[test]
    fn an_annulus_has_euler_number_zero() {
        // Two squares, one in the other: vertices 0-3 outside, 4-7 inside.
        let triangles: Vec<[usize; 3]> = (0..4)
            .flat_map(|i| {
                let j = (i + 1) % 4;
                [[i, j, i + 4], [j, j + 4, i + 4]]
            })
            .collect();
        let mesh = Adjacency::new(8, &triangles).unwrap();
        assert_eq!(mesh.euler(), 0);
        assert!(mesh.on_outline.iter().all(|&b| b));
    }
}
