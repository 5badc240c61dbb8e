//! Stage C: a map (u, v) of the domain whose isolines follow a cross field.
//!
//! The crosses are scaled by exp(φ) first, with L φ = Ω − K: Ω is the curvature that the indices concentrate in vertices,
//! K that of the domain (none inside, the turn of the outline on it). φ and θ are conjugate where the field is harmonic,
//! so that exp(φ)(cos θ, sin θ) is nearly a gradient and the map nearly conformal (the same two linear equations as in
//! Jezdimirović et al., *Integrable cross-field generation based on imposed singularity configuration*, 2021).
//!
//! Then the mesh is cut open along paths from singularities to the outline and between its loops, crosses are turned to
//! agree everywhere but across the cut, and the map minimises
//! Σ_f A_f w_f exp(−2φ_f) (‖∇u − X_f‖² + ‖∇v − J X_f‖²), under constraints that hold exactly: across the cut
//! uv′ = Rʳ uv + t with one translation t for every smooth piece of the cut, and one of u and v is constant along the
//! outline between corners (Bommes, Zimmer, Kobbelt: *Mixed-integer quadrangulation*, ACM Trans. Graph. 28, 2009, without
//! the integers). The constraints are eliminated, see `elimination`. Where the map folds, weights w grow (local
//! stiffening, ibid.) and the map is solved anew.

use thiserror::Error;

use super::adjacency::{Adjacency, Place};
use super::cross_field::{jumps, quarters};
use super::cut::{Cut, Piece};
use super::elimination::Elimination;
use super::mesh::LayoutMesh;
use super::pattern::Pattern;
use crate::numeric::sparse::{Cholesky, SparseError};

/// Why there is no seamless map.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum SeamlessMapError {
    /// One cross a triangle and one index a vertex are needed.
    #[error("{found} {what} for {expected} {of}")]
    Count {
        /// What was counted.
        what: &'static str,
        /// How many came.
        found: usize,
        /// Of what there must be as many.
        of: &'static str,
        /// How many of them there are.
        expected: usize,
    },
    /// Crosses on both sides of one piece of the cut turn by different quarters.
    #[error("the field is torn along the cut at edge {edge}")]
    Torn {
        /// The edge.
        edge: usize,
    },
    /// Constraints leave nothing but a map into a point or a line.
    #[error("the map is degenerate: all of the domain comes to lie on a line")]
    Degenerate,
    /// A linear system cannot be solved.
    #[error(transparent)]
    Sparse(#[from] SparseError),
}

/// Map of a domain that is continuous but for seams.
#[derive(Debug, Clone, PartialEq)]
pub struct SeamlessMap {
    /// Images of the corners of every triangle; all of them together have the domain's area, folds apart.
    pub uv: Vec<[[f64; 2]; 3]>,
    /// Quarter turns r to the neighbour across every side: uv′ = Rʳ uv + t.
    pub rotation: Vec<[i64; 3]>,
    /// Whether the cut runs along a side.
    pub seam: Vec<[bool; 3]>,
    /// Triangles whose image is not counter-clockwise.
    pub folds: usize,
    /// Largest violation of a constraint, in parts of the image's diameter.
    pub residual: f64,
    /// Rounds of stiffening.
    pub rounds: usize,
}

// Weights of triangles that fold, that touch one, and that touch one of those, in a round.
const STIFFENING: [f64; 3] = [8.0, 4.0, 2.0];

/// The map of a cross field with its indices, stiffened up to `rounds` times until nothing folds.
pub fn seamless_map(
    mesh: &LayoutMesh,
    theta: &[f64],
    index: &[i64],
    rounds: usize,
) -> Result<SeamlessMap, SeamlessMapError> {
    let count = |what, found, of, expected| {
        if found == expected { Ok(()) } else { Err(SeamlessMapError::Count { what, found, of, expected }) }
    };
    count("crosses", theta.len(), "triangles", mesh.triangles.len())?;
    count("indices", index.len(), "vertices", mesh.points.len())?;
    if mesh.triangles.is_empty() {
        return Err(SeamlessMapError::Degenerate);
    }
    let scale = log_scale(mesh, index)?;
    let cut = Cut::new(&mesh.adjacency, &mesh.triangles, &jumps(mesh, theta), index)
        .map_err(|edge| SeamlessMapError::Torn { edge })?;
    let mut fit = Fit::new(mesh, theta, &cut, &scale)?;
    let mut weight = vec![1.0; mesh.triangles.len()];
    let mut round = 0;
    loop {
        let uv = fit.solve(&weight)?;
        let folded: Vec<bool> = uv.iter().map(|t| double_area(t) <= 0.0).collect();
        let folds = folded.iter().filter(|&&f| f).count();
        if folds == 0 || round == rounds {
            let residual = residual(mesh, &cut, &fit.level, &uv)?;
            let (rotation, seam) = (cut.rotation, cut.seam);
            return Ok(SeamlessMap { uv, rotation, seam, folds, residual, rounds: round });
        }
        stiffen(&mesh.adjacency, &mesh.triangles, folded, &mut weight);
        round += 1;
    }
}

fn double_area([a, b, c]: &[[f64; 2]; 3]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// Logarithm of the conformal scale at the vertices: the image has the area of the domain.
fn log_scale(mesh: &LayoutMesh, index: &[i64]) -> Result<Vec<f64>, SparseError> {
    use std::f64::consts::{FRAC_PI_2, PI};
    let n = mesh.points.len();
    let mut curvature: Vec<f64> = (0..n)
        .map(|v| {
            if mesh.adjacency.on_outline[v] {
                let angle: f64 = mesh.adjacency.ring(v).map(|corner| mesh.angle(corner)).sum();
                (2 - index[v]) as f64 * FRAC_PI_2 - (PI - angle)
            } else {
                index[v] as f64 * FRAC_PI_2
            }
        })
        .collect();
    // The sum is zero by Gauss–Bonnet; rounding is spread evenly.
    let mean = curvature.iter().sum::<f64>() / n as f64;
    curvature.iter_mut().for_each(|c| *c -= mean);
    // φ is determined up to a constant: 0 at the first vertex.
    let matrix = mesh.geometry.stiffness(&mesh.triangles, n - 1, |v| v.checked_sub(1));
    let upper = crate::numeric::sparse::upper_triangle(&matrix);
    let mut factor = Cholesky::analyse(upper.col_offsets(), upper.row_indices(), None)?;
    factor.factorize(upper.values())?;
    let mut phi = curvature;
    factor.solve(&mut phi[1..]);
    phi[0] = 0.0;
    let largest = phi.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    phi.iter_mut().for_each(|p| *p -= largest);
    let areas = &mesh.geometry.areas;
    let image: f64 =
        mesh.triangles.iter().zip(areas).map(|(t, area)| area * (2.0 * mean_of(t, &phi)).exp()).sum();
    let shift = 0.5 * (areas.iter().sum::<f64>() / image).ln();
    phi.iter_mut().for_each(|p| *p += shift);
    Ok(phi)
}

fn mean_of(t: &[usize; 3], values: &[f64]) -> f64 {
    (values[t[0]] + values[t[1]] + values[t[2]]) / 3.0
}

/// Multiply the weights of triangles at folds, and of two rings around them.
fn stiffen(adjacency: &Adjacency, triangles: &[[usize; 3]], folded: Vec<bool>, weight: &mut [f64]) {
    let grow = |set: &[bool]| {
        let mut touched = vec![false; adjacency.n_vertices()];
        triangles
            .iter()
            .zip(set)
            .filter(|s| *s.1)
            .for_each(|(t, _)| t.iter().for_each(|&v| touched[v] = true));
        triangles.iter().map(|t| t.iter().any(|&v| touched[v])).collect::<Vec<bool>>()
    };
    let ring = grow(&folded);
    let second = grow(&ring);
    for (face, w) in weight.iter_mut().enumerate() {
        let level = [folded[face], ring[face], second[face]].iter().position(|&b| b);
        *w *= level.map_or(1.0, |l| STIFFENING[l]);
    }
}

/// The least-squares problem with its constraints eliminated; weights of triangles change from round to round.
struct Fit<'a> {
    mesh: &'a LayoutMesh,
    /// Class of every corner: corners that the cut does not separate share one.
    class: &'a [[usize; 3]],
    classes: usize,
    /// Coordinates u, then coordinates v of all classes, by free variables.
    combinations: Vec<Vec<(usize, f64)>>,
    free: usize,
    /// Wanted gradient of u on every triangle; that of v is a quarter turn ahead.
    frame: Vec<[f64; 2]>,
    /// Area and conformal weight.
    base: Vec<f64>,
    /// Entries of the matrix: where, of which triangle, how much for a unit weight.
    entries: Vec<(usize, usize, f64)>,
    values: Vec<f64>,
    factor: Cholesky,
    /// For every side on the outline, the coordinate that is constant along it.
    level: Vec<(Place, usize)>,
}

impl<'a> Fit<'a> {
    fn new(
        mesh: &'a LayoutMesh,
        theta: &[f64],
        cut: &'a Cut,
        scale: &[f64],
    ) -> Result<Self, SeamlessMapError> {
        let combed: Vec<f64> =
            theta.iter().zip(&cut.turns).map(|(t, &q)| t + q as f64 * std::f64::consts::FRAC_PI_2).collect();
        let level = levels(mesh, &combed);
        let (combinations, free) = constrain(cut, &level);
        if free == 0 {
            return Err(SeamlessMapError::Degenerate);
        }
        let mean: Vec<f64> = mesh.triangles.iter().map(|t| mean_of(t, scale)).collect();
        let frame = combed.iter().zip(&mean).map(|(t, s)| [s.exp() * t.cos(), s.exp() * t.sin()]).collect();
        let base = mesh.geometry.areas.iter().zip(&mean).map(|(area, s)| area * (-2.0 * s).exp()).collect();
        let (entries, pattern) = normal_equations(mesh, cut, &combinations, free);
        let factor = Cholesky::analyse(&pattern.offsets, &pattern.rows, None)?;
        let values = vec![0.0; pattern.rows.len()];
        Ok(Self {
            mesh,
            class: &cut.class,
            classes: cut.classes,
            combinations,
            free,
            frame,
            base,
            entries,
            values,
            factor,
            level,
        })
    }

    fn solve(&mut self, weight: &[f64]) -> Result<Vec<[[f64; 2]; 3]>, SparseError> {
        let weight: Vec<f64> = weight.iter().zip(&self.base).map(|(w, b)| w * b).collect();
        self.values.fill(0.0);
        for &(place, face, value) in &self.entries {
            self.values[place] += weight[face] * value;
        }
        let mut y = vec![0.0; self.free];
        for (face, class) in self.class.iter().enumerate() {
            let [c, s] = self.frame[face];
            for i in 0..3 {
                let g = self.mesh.geometry.gradients[face][i];
                let wanted = [g[0] * c + g[1] * s, g[1] * c - g[0] * s];
                for (offset, value) in [(0, wanted[0]), (self.classes, wanted[1])] {
                    for &(row, a) in &self.combinations[offset + class[i]] {
                        y[row] += weight[face] * value * a;
                    }
                }
            }
        }
        self.factor.factorize(&self.values)?;
        self.factor.solve(&mut y);
        let x: Vec<f64> =
            self.combinations.iter().map(|row| row.iter().map(|&(v, c)| c * y[v]).sum()).collect();
        Ok(self.class.iter().map(|class| class.map(|c| [x[c], x[self.classes + c]])).collect())
    }
}

/// What every triangle adds to the normal equations, (place, triangle, amount for a unit weight), and their pattern.
fn normal_equations(
    mesh: &LayoutMesh,
    cut: &Cut,
    combinations: &[Vec<(usize, f64)>],
    free: usize,
) -> (Vec<(usize, usize, f64)>, Pattern) {
    let (mut places, mut amounts) = (Vec::with_capacity(14 * cut.class.len()), Vec::new());
    for (face, class) in cut.class.iter().enumerate() {
        let g = &mesh.geometry.gradients[face];
        for i in 0..3 {
            for j in 0..3 {
                let value = g[i][0] * g[j][0] + g[i][1] * g[j][1];
                for offset in [0, cut.classes] {
                    for &(row, a) in &combinations[offset + class[i]] {
                        for &(column, b) in &combinations[offset + class[j]] {
                            if row <= column {
                                places.push((column, row));
                                amounts.push((face, value * a * b));
                            }
                        }
                    }
                }
            }
        }
    }
    let pattern = Pattern::new(free, &places);
    let entries = pattern.place.iter().zip(amounts).map(|(&p, (face, value))| (p, face, value)).collect();
    (entries, pattern)
}

/// Sides on the outline with the coordinate, 0 or 1, that is constant along them.
fn levels(mesh: &LayoutMesh, combed: &[f64]) -> Vec<(Place, usize)> {
    let adjacency = &mesh.adjacency;
    (0..adjacency.edges.len())
        .filter(|&e| adjacency.is_outline_edge(e))
        .map(|e| {
            let side = adjacency.edge_sides[e];
            let v = mesh.side(side);
            let along_u = quarters(v[1].atan2(v[0]) - combed[side.face]) % 2 == 0;
            (side, usize::from(along_u))
        })
        .collect()
}

/// Coordinates of all classes as combinations of free variables.
fn constrain(cut: &Cut, level: &[(Place, usize)]) -> (Vec<Vec<(usize, f64)>>, usize) {
    let n = cut.classes;
    let mut elimination = Elimination::new(2 * n, 2 * cut.pieces.len());
    for (piece, Piece { quarters, edges }) in cut.pieces.iter().enumerate() {
        // Rʳ: u' = sign · (u or v), v' likewise.
        let rotation = match quarters.rem_euclid(4) {
            0 => [(0, 1.0), (1, 1.0)],
            1 => [(1, -1.0), (0, 1.0)],
            2 => [(0, -1.0), (1, -1.0)],
            _ => [(1, 1.0), (0, -1.0)],
        };
        for &(left, right) in edges {
            for (a, b) in [(1, 2), (2, 1)] {
                let from = cut.class[left.face][(left.index + a) % 3];
                let to = cut.class[right.face][(right.index + b) % 3];
                for (coordinate, (source, sign)) in rotation.into_iter().enumerate() {
                    let translation = Some((2 * piece + coordinate, 1.0));
                    elimination.tie(coordinate * n + to, sign, source * n + from, translation);
                }
            }
        }
    }
    for &(side, coordinate) in level {
        let [a, b] = [1, 2].map(|k| coordinate * n + cut.class[side.face][(side.index + k) % 3]);
        elimination.tie(a, 1.0, b, None);
    }
    // Where the image lies is free.
    let origin = cut.class[0][0];
    elimination.ground(origin);
    elimination.ground(n + origin);
    elimination.solve()
}

/// Largest violation of a constraint by the map, in parts of its diameter.
fn residual(
    mesh: &LayoutMesh,
    cut: &Cut,
    level: &[(Place, usize)],
    uv: &[[[f64; 2]; 3]],
) -> Result<f64, SeamlessMapError> {
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for p in uv.as_flattened() {
        for c in 0..2 {
            low[c] = low[c].min(p[c]);
            high[c] = high[c].max(p[c]);
        }
    }
    let diameter = (high[0] - low[0]).hypot(high[1] - low[1]);
    if !(diameter > 0.0 && diameter.is_finite()) {
        return Err(SeamlessMapError::Degenerate);
    }
    let along = |place: Place, a: usize, b: usize| {
        let t = &uv[place.face];
        let (p, q) = (t[(place.index + a) % 3], t[(place.index + b) % 3]);
        [q[0] - p[0], q[1] - p[1]]
    };
    let mut worst = 0.0_f64;
    for (face, neighbours) in mesh.adjacency.neighbours.iter().enumerate() {
        for (index, other) in neighbours.iter().enumerate() {
            let Some(other) = other else { continue };
            let [u, v] = along(Place { face, index }, 1, 2);
            let turned = match cut.rotation[face][index] {
                0 => [u, v],
                1 => [-v, u],
                2 => [-u, -v],
                _ => [v, -u],
            };
            let theirs = along(*other, 2, 1);
            worst = worst.max((turned[0] - theirs[0]).abs()).max((turned[1] - theirs[1]).abs());
        }
    }
    for &(side, coordinate) in level {
        worst = worst.max(along(side, 1, 2)[coordinate].abs());
    }
    Ok(worst / diameter)
}

#[cfg(test)]
#[path = "seamless_map_tests.rs"]
mod tests;
