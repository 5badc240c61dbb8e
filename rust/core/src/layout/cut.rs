//! The cut that opens a mesh for a map, and crosses that agree everywhere but across it.
//!
//! Triangles are joined along a spanning tree of their neighbourhoods; the other edges, less the dangling ends at
//! regular vertices, are the cut: paths that join singularities, holes and the outline and leave one disk.

use std::collections::VecDeque;

use super::adjacency::{Adjacency, Place};

/// A path of cut edges with one transition.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Piece {
    /// Quarter turns r from the left to the right: uv_right = Rʳ uv_left + t.
    pub quarters: i64,
    /// Its edges as the sides (left, right) of triangles; the left ones run along the path.
    pub edges: Vec<(Place, Place)>,
}

/// A mesh cut open, with crosses combed.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Cut {
    /// Quarter turns that make the crosses of neighbours agree.
    pub turns: Vec<i64>,
    /// Sides along the cut.
    pub seam: Vec<[bool; 3]>,
    /// r of uv′ = Rʳ uv + t to the neighbour across every side, 0 to 3.
    pub rotation: Vec<[i64; 3]>,
    /// The cut's pieces, between singularities, branchings and the outline.
    pub pieces: Vec<Piece>,
    /// Class of every corner: corners of one vertex that the cut does not separate share one.
    pub class: Vec<[usize; 3]>,
    /// Number of classes.
    pub classes: usize,
}

impl Cut {
    /// Cut a mesh with the jumps of a cross field and its indices; fails with the edge where the crosses of one piece
    /// do not have one transition.
    pub(super) fn new(
        adjacency: &Adjacency,
        triangles: &[[usize; 3]],
        jumps: &[[i64; 3]],
        index: &[i64],
    ) -> Result<Self, usize> {
        let mut open: Vec<bool> = (0..adjacency.edges.len()).map(|e| !adjacency.is_outline_edge(e)).collect();
        walk(adjacency, |edge, new| {
            if new {
                open[edge] = false;
            }
            new
        });
        let passable = |v: usize| !adjacency.on_outline[v] && index[v] == 0;
        let mut ends = Ends::new(adjacency, &open);
        ends.prune(adjacency, &mut open, passable);
        let seam: Vec<[bool; 3]> = adjacency.face_edges.iter().map(|e| e.map(|e| open[e])).collect();
        let turns = comb(adjacency, &seam, jumps);
        let mut rotation = vec![[0; 3]; triangles.len()];
        let transition = |side: Place, twin: Place| {
            // The neighbour's frame is turned by this, so its coordinates of the same vector are turned back.
            -(jumps[side.face][side.index] + turns[twin.face] - turns[side.face])
        };
        for (face, neighbours) in adjacency.neighbours.iter().enumerate() {
            for (index, twin) in neighbours.iter().enumerate() {
                if let Some(twin) = twin {
                    rotation[face][index] = transition(Place { face, index }, *twin).rem_euclid(4);
                }
            }
        }
        for (e, (side, twin)) in adjacency.edge_sides.iter().zip(&adjacency.edge_twins).enumerate() {
            if !open[e] && twin.is_some() && rotation[side.face][side.index] != 0 {
                return Err(e);
            }
        }
        let pieces = ends.pieces(adjacency, triangles, &open, passable, &rotation)?;
        let (class, classes) = classes(adjacency, triangles, &seam);
        Ok(Self { turns, seam, rotation, pieces, class, classes })
    }
}

/// Breadth first over triangles: `enter(edge, new)` says whether to go across an edge to a triangle, `new` or not.
fn walk(adjacency: &Adjacency, mut enter: impl FnMut(usize, bool) -> bool) {
    let mut seen = vec![false; adjacency.n_faces()];
    let mut queue = VecDeque::from([0]);
    seen[0] = true;
    while let Some(face) = queue.pop_front() {
        for index in 0..3 {
            let Some(other) = adjacency.neighbours[face][index] else { continue };
            if enter(adjacency.face_edges[face][index], !seen[other.face]) && !seen[other.face] {
                seen[other.face] = true;
                queue.push_back(other.face);
            }
        }
    }
}

/// Quarter turns of all triangles such that crosses agree across all edges but seams.
fn comb(adjacency: &Adjacency, seam: &[[bool; 3]], jumps: &[[i64; 3]]) -> Vec<i64> {
    let mut turns = vec![None; seam.len()];
    turns[0] = Some(0);
    let mut queue = VecDeque::from([(0, 0)]);
    while let Some((face, own)) = queue.pop_front() {
        for index in 0..3 {
            let Some(other) = adjacency.neighbours[face][index] else { continue };
            if !seam[face][index] && turns[other.face].is_none() {
                let theirs = own - jumps[face][index];
                turns[other.face] = Some(theirs);
                queue.push_back((other.face, theirs));
            }
        }
    }
    turns.into_iter().map(|t| t.unwrap_or(0)).collect()
}

/// How many cut edges end at every vertex, and which one where there is one.
struct Ends {
    count: Vec<usize>,
    /// Exclusive or of their numbers.
    which: Vec<usize>,
}

impl Ends {
    fn new(adjacency: &Adjacency, open: &[bool]) -> Self {
        let mut ends =
            Self { count: vec![0; adjacency.n_vertices()], which: vec![0; adjacency.n_vertices()] };
        for e in (0..open.len()).filter(|&e| open[e]) {
            for v in adjacency.edges[e] {
                ends.count[v] += 1;
                ends.which[v] ^= e;
            }
        }
        ends
    }

    /// Close edges that end at vertices a map can pass.
    fn prune(&mut self, adjacency: &Adjacency, open: &mut [bool], passable: impl Fn(usize) -> bool) {
        let mut stack: Vec<usize> =
            (0..self.count.len()).filter(|&v| self.count[v] == 1 && passable(v)).collect();
        while let Some(v) = stack.pop() {
            if self.count[v] != 1 {
                continue;
            }
            let edge = self.which[v];
            open[edge] = false;
            for w in adjacency.edges[edge] {
                self.count[w] -= 1;
                self.which[w] ^= edge;
                if self.count[w] == 1 && passable(w) {
                    stack.push(w);
                }
            }
        }
    }

    /// Paths between vertices that are not passed straight on.
    fn pieces(
        &self,
        adjacency: &Adjacency,
        triangles: &[[usize; 3]],
        open: &[bool],
        passable: impl Fn(usize) -> bool,
        rotation: &[[i64; 3]],
    ) -> Result<Vec<Piece>, usize> {
        let straight = |v: usize| self.count[v] == 2 && passable(v);
        let mut taken: Vec<bool> = open.iter().map(|o| !o).collect();
        let mut pieces = Vec::new();
        // Paths from their ends first; circles, without an end, from any edge.
        let from_end = |e: &usize| adjacency.edges[*e].iter().any(|&v| !straight(v));
        let all = 0..open.len();
        for start in all.clone().filter(from_end).chain(all) {
            if taken[start] {
                continue;
            }
            let [a, b] = adjacency.edges[start];
            let (mut edge, mut from) = (start, if straight(a) && !straight(b) { b } else { a });
            let mut piece: Option<Piece> = None;
            loop {
                taken[edge] = true;
                let (left, right) = sides_along(adjacency, triangles, edge, from);
                let quarters = rotation[left.face][left.index];
                let piece = piece.get_or_insert(Piece { quarters, edges: Vec::new() });
                if piece.quarters != quarters {
                    return Err(edge);
                }
                piece.edges.push((left, right));
                let [a, b] = adjacency.edges[edge];
                from ^= a ^ b;
                edge ^= self.which[from];
                if !straight(from) || taken[edge] {
                    break;
                }
            }
            pieces.extend(piece);
        }
        Ok(pieces)
    }
}

/// The sides to the left and right of an edge that is passed from one of its ends.
fn sides_along(adjacency: &Adjacency, triangles: &[[usize; 3]], edge: usize, from: usize) -> (Place, Place) {
    let side = adjacency.edge_sides[edge];
    let twin = adjacency.edge_twins[edge].expect("a cut edge has two sides");
    if triangles[side.face][(side.index + 1) % 3] == from { (side, twin) } else { (twin, side) }
}

/// Classes of corners around every vertex: a new one after each seam, the last one joined with the first.
fn classes(adjacency: &Adjacency, triangles: &[[usize; 3]], seam: &[[bool; 3]]) -> (Vec<[usize; 3]>, usize) {
    let mut class = vec![[usize::MAX; 3]; triangles.len()];
    let mut count = 0;
    for vertex in 0..adjacency.n_vertices() {
        let ring: Vec<Place> = adjacency.ring(vertex).collect();
        let after = |corner: &Place| seam[corner.face][(corner.index + 1) % 3];
        // Inside, start after a seam, if there is one.
        let first = match adjacency.on_outline[vertex] {
            true => 0,
            false => ring.iter().position(after).map_or(0, |p| p + 1),
        };
        for step in 0..ring.len() {
            let corner = ring[(first + step) % ring.len()];
            class[corner.face][corner.index] = count;
            if after(&corner) && step + 1 < ring.len() {
                count += 1;
            }
        }
        count += usize::from(!ring.is_empty());
    }
    (class, count)
}

#[cfg(test)]
mod tests {
    use super::super::cross_field::{cross_field, jumps};
    use super::super::test_domains::{annulus, disk, square, twisted};
    use super::*;

    #[test]
    fn a_cut_mesh_is_one_disk() {
        for (domain, pieces) in [(square(), 0), (annulus(), 1), (disk(), 4), (twisted(0.3), 1)] {
            let mesh = domain.mesh(0.01);
            let field = cross_field(&mesh, &domain.corners, &[]).unwrap();
            let cut = Cut::new(&mesh.adjacency, &mesh.triangles, &jumps(&mesh, &field.theta), &field.index)
                .unwrap();
            let seams = cut.seam.as_flattened().iter().filter(|s| **s).count();
            assert_eq!(seams, 2 * cut.pieces.iter().map(|p| p.edges.len()).sum::<usize>());
            let edges = mesh.adjacency.edges.len() + seams / 2;
            assert_eq!(cut.classes as i64 - edges as i64 + mesh.triangles.len() as i64, 1);
            assert!(cut.pieces.len() >= pieces);
            // Crosses agree but across the cut.
            let turned: Vec<f64> = field
                .theta
                .iter()
                .zip(&cut.turns)
                .map(|(t, &q)| t + q as f64 * std::f64::consts::FRAC_PI_2)
                .collect();
            for (face, neighbours) in mesh.adjacency.neighbours.iter().enumerate() {
                for (index, other) in neighbours.iter().enumerate() {
                    if let Some(other) = other {
                        let off = turned[other.face] - turned[face];
                        assert!(cut.seam[face][index] || off.abs() < std::f64::consts::FRAC_PI_4 + 1e-9);
                    }
                }
            }
        }
    }

    #[test]
    fn pieces_run_on_from_edge_to_edge() {
        let domain = disk();
        let mesh = domain.mesh(0.01);
        let field = cross_field(&mesh, &domain.corners, &[]).unwrap();
        let cut =
            Cut::new(&mesh.adjacency, &mesh.triangles, &jumps(&mesh, &field.theta), &field.index).unwrap();
        for piece in &cut.pieces {
            for pair in piece.edges.windows(2) {
                let (end, start) = (pair[0].0, pair[1].0);
                let at = |p: Place, k: usize| mesh.triangles[p.face][(p.index + k) % 3];
                assert_eq!(at(end, 2), at(start, 1));
            }
        }
    }
}
