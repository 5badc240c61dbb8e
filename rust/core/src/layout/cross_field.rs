//! Stage B: a smooth field of crosses along the outline, and where it is singular.
//!
//! A cross of angle θ is the number u = exp(4iθ). On the outline it is aligned with the edges; inside it is
//! smoothed by the method of Merriman, Bence and Osher as Viertel and Osting (*An approach to quad meshing based on
//! harmonic cross-valued maps and the Ginzburg–Landau theory*, SIAM J. Sci. Comput. 41, 2019) use it: diffuse for a
//! time τ, normalise, repeat. Unknowns sit on the *edges* (Crouzeix–Raviart elements, as in Beaufort et al.,
//! *Computing cross fields: a PDE approach based on the Ginzburg–Landau theory*, 2017): an edge has one direction
//! even where a vertex, a corner, has two.
//!
//! At a corner of angle α with k quads the cross turns evenly with the polar angle φ: θ = θ₀ + φ (α − k·90°)/α.
//!
//! The jump across an edge is the whole number of quarter turns between neighbouring crosses. The *index* of an inner
//! vertex is minus the sum of the jumps around it, that is 4 less its valence; for a vertex of the outline the number
//! of quads k comes from the interior angle and the turn of the crosses. Then
//! Σ_inner (4 − valence) + Σ_outline (2 − k) = 4χ, whatever the crosses are (Gauss–Bonnet).

use std::f64::consts::FRAC_PI_2;

use thiserror::Error;

use super::adjacency::Place;
use super::mesh::{Corner, LayoutMesh};
use super::pattern::Pattern;
use crate::numeric::sparse::{Cholesky, SparseError};

/// Why there is no cross field.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum CrossFieldError {
    /// A corner is no vertex of the outline.
    #[error("corner {vertex} is not on the outline")]
    CornerInside {
        /// The vertex.
        vertex: usize,
    },
    /// An isometry does not name one edge for every edge of the mesh.
    #[error("isometry {isometry} of the outline must name one of {edges} edges for each of them")]
    Isometry {
        /// The isometry.
        isometry: usize,
        /// Number of edges.
        edges: usize,
    },
    /// The indices do not add up.
    #[error("the indices add up to {found} instead of 4 x Euler number = {expected}")]
    GaussBonnet {
        /// Their sum.
        found: i64,
        /// 4χ.
        expected: i64,
    },
    /// A linear system cannot be solved.
    #[error(transparent)]
    Sparse(#[from] SparseError),
}

/// A cross on every triangle.
#[derive(Debug, Clone, PartialEq)]
pub struct CrossField {
    /// Angle of one of the four arms.
    pub theta: Vec<f64>,
    /// Inside 4 − valence; on the outline the number of quads.
    pub index: Vec<i64>,
}

/// An isometry g of the outline acting on crosses: (g u)(e) = phase · u(source[e]), or of its conjugate.
#[derive(Debug, Clone, PartialEq)]
pub struct Isometry {
    /// The edge that comes to lie on every edge.
    pub source: Vec<usize>,
    /// exp(4iω) of a rotation by ω, exp(8iβ) of a reflection in a line of direction β.
    pub phase: [f64; 2],
    /// Whether it is a reflection.
    pub conjugate: bool,
}

// Diffusion times in parts of the domain's area, and the root mean square change of u that ends the steps of each: the
// first ones find where singularities go, the last one their place. One singularity that moves by a triangle makes 0.02.
const TIMES: [(f64, f64); 3] = [(2e-2, 1e-2), (5e-3, 5e-3), (1e-3, 1e-3)];
/// Steps a diffusion time at most; only singularities that creep along a valley take more.
const STEPS: usize = 60;

/// The smoothest cross field along the outline with the wanted quads at corners.
///
/// With isometries, the field is averaged over them in every step; together with the identity they must be a group.
pub fn cross_field(
    mesh: &LayoutMesh,
    corners: &[Corner],
    isometries: &[Isometry],
) -> Result<CrossField, CrossFieldError> {
    let edges = mesh.adjacency.edges.len();
    let whole = |g: &Isometry| g.source.len() == edges && g.source.iter().all(|&e| e < edges);
    if let Some(isometry) = isometries.iter().position(|g| !whole(g)) {
        return Err(CrossFieldError::Isometry { isometry, edges });
    }
    let aligned = Aligned::new(mesh, corners)?;
    let u = smooth(mesh, &aligned.edges, isometries)?;
    let theta: Vec<f64> = (0..mesh.triangles.len())
        .map(|face| {
            aligned.faces[face].unwrap_or_else(|| {
                let sum = mesh.adjacency.face_edges[face].iter().fold([0.0; 2], |s, &e| add(s, u[e]));
                sum[1].atan2(sum[0]) / 4.0
            })
        })
        .collect();
    let index = indices(mesh, &theta)?;
    Ok(CrossField { theta, index })
}

/// Quarter turns from every triangle's cross to its neighbour's, across each of its sides.
pub fn jumps(mesh: &LayoutMesh, theta: &[f64]) -> Vec<[i64; 3]> {
    let mut jumps = vec![[0; 3]; theta.len()];
    let adjacency = &mesh.adjacency;
    for (side, twin) in adjacency.edge_sides.iter().zip(&adjacency.edge_twins) {
        if let Some(twin) = twin {
            let turns = quarters(theta[twin.face] - theta[side.face]);
            jumps[side.face][side.index] = turns;
            jumps[twin.face][twin.index] = -turns;
        }
    }
    jumps
}

/// Indices of all vertices; their sum is checked.
pub fn indices(mesh: &LayoutMesh, theta: &[f64]) -> Result<Vec<i64>, CrossFieldError> {
    let adjacency = &mesh.adjacency;
    let jumps = jumps(mesh, theta);
    // A ring goes on across side i + 1 of the triangle whose corner i it is at.
    let across = |corner: Place| jumps[corner.face][(corner.index + 1) % 3];
    let mut index = Vec::with_capacity(mesh.points.len());
    for vertex in 0..mesh.points.len() {
        let around: i64 = adjacency.ring(vertex).map(across).sum();
        if adjacency.on_outline[vertex] {
            index.push(quads(mesh, theta, vertex, around));
        } else {
            index.push(-around);
        }
    }
    let used = |v: usize| adjacency.ring(v).next().is_some();
    let share = |v: usize| if adjacency.on_outline[v] { 2 - index[v] } else { index[v] };
    let found: i64 = (0..index.len()).filter(|&v| used(v)).map(share).sum();
    let expected = 4 * adjacency.euler();
    if found != expected {
        return Err(CrossFieldError::GaussBonnet { found, expected });
    }
    Ok(index)
}

/// Number of quads at a vertex of the outline, from the jumps `around` it.
fn quads(mesh: &LayoutMesh, theta: &[f64], vertex: usize, around: i64) -> i64 {
    let ring: Vec<Place> = mesh.adjacency.ring(vertex).collect();
    let (first, last) = (ring[0], ring[ring.len() - 1]);
    let angle: f64 = ring.iter().map(|&corner| mesh.angle(corner)).sum();
    let first_side = direction(mesh.side(Place { index: (first.index + 2) % 3, ..first }));
    let last_side = direction(mesh.side(Place { index: (last.index + 1) % 3, ..last }));
    // From the first side to the first cross, through the ring, and from the last cross to the last side.
    let turned = remainder(theta[first.face] - first_side)
        + (theta[last.face] - theta[first.face] - around as f64 * FRAC_PI_2)
        + remainder(last_side - theta[last.face]);
    // A whole number but for rounding: the angle between the sides is what the crosses turn, up to quarter turns.
    ((angle - turned) / FRAC_PI_2).round() as i64
}

fn direction(v: [f64; 2]) -> f64 {
    v[1].atan2(v[0])
}

/// The nearest whole number of quarter turns.
pub(super) fn quarters(angle: f64) -> i64 {
    (angle / FRAC_PI_2).round() as i64
}

/// What is left of an angle without its quarter turns.
fn remainder(angle: f64) -> f64 {
    angle - FRAC_PI_2 * quarters(angle) as f64
}

/// Crosses that are known: along the outline and in the triangles at corners.
struct Aligned {
    edges: Vec<Option<f64>>,
    faces: Vec<Option<f64>>,
}

impl Aligned {
    fn new(mesh: &LayoutMesh, corners: &[Corner]) -> Result<Self, CrossFieldError> {
        let adjacency = &mesh.adjacency;
        let mut known =
            Self { edges: vec![None; adjacency.edges.len()], faces: vec![None; mesh.triangles.len()] };
        for corner in corners {
            known.fan(mesh, *corner)?;
        }
        for edge in (0..adjacency.edges.len()).filter(|&e| adjacency.is_outline_edge(e)) {
            let side = adjacency.edge_sides[edge];
            let angle = direction(mesh.side(side));
            known.edges[edge] = Some(angle);
            known.faces[side.face] = Some(angle);
        }
        Ok(known)
    }

    /// Crosses that turn evenly from a corner's first side to its last one.
    fn fan(&mut self, mesh: &LayoutMesh, corner: Corner) -> Result<(), CrossFieldError> {
        let vertex = corner.vertex;
        if !mesh.adjacency.on_outline.get(vertex).is_some_and(|&b| b) {
            return Err(CrossFieldError::CornerInside { vertex });
        }
        let ring: Vec<Place> = mesh.adjacency.ring(vertex).collect();
        let angles: Vec<f64> = ring.iter().map(|&place| mesh.angle(place)).collect();
        let whole: f64 = angles.iter().sum();
        let rate = (whole - corner.quads as f64 * FRAC_PI_2) / whole;
        let start = direction(mesh.side(Place { index: (ring[0].index + 2) % 3, ..ring[0] }));
        let mut polar = 0.0;
        for (place, angle) in ring.iter().zip(angles) {
            self.faces[place.face] = Some(start + rate * (polar + angle / 2.0));
            polar += angle;
            let edge = mesh.adjacency.face_edges[place.face][(place.index + 1) % 3];
            self.edges[edge] = Some(start + rate * polar);
        }
        Ok(())
    }
}

fn add(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] + b[0], a[1] + b[1]]
}

fn unit(u: [f64; 2]) -> [f64; 2] {
    let length = u[0].hypot(u[1]).max(1e-14);
    [u[0] / length, u[1] / length]
}

/// u on all edges by harmonic interpolation, then diffusion and normalisation in turns.
fn smooth(
    mesh: &LayoutMesh,
    known: &[Option<f64>],
    isometries: &[Isometry],
) -> Result<Vec<[f64; 2]>, CrossFieldError> {
    let mut u: Vec<[f64; 2]> = known
        .iter()
        .map(|angle| angle.map_or([0.0; 2], |theta| [(4.0 * theta).cos(), (4.0 * theta).sin()]))
        .collect();
    let mut system = Diffusion::new(mesh, known, &u)?;
    if system.free.is_empty() {
        return Ok(u);
    }
    system.prepare(None)?;
    let mut next = system.solve(&u, None);
    let area: f64 = mesh.geometry.areas.iter().sum();
    system.store(&next, &mut u);
    average(&mut u, isometries, &system.free);
    for (time, change) in TIMES {
        let time = time * area;
        system.prepare(Some(time))?;
        for _ in 0..STEPS {
            system.free.iter().for_each(|&e| u[e] = unit(u[e]));
            next = system.solve(&u, Some(time));
            let moved = system.change(&next, &u);
            system.store(&next, &mut u);
            if !isometries.is_empty() {
                system.free.iter().for_each(|&e| u[e] = unit(u[e]));
                average(&mut u, isometries, &system.free);
            }
            if moved < change {
                break;
            }
        }
    }
    system.free.iter().for_each(|&e| u[e] = unit(u[e]));
    Ok(u)
}

/// The mean over the group, on free edges only.
fn average(u: &mut [[f64; 2]], isometries: &[Isometry], free: &[usize]) {
    if isometries.is_empty() {
        return;
    }
    let before = u.to_vec();
    for &edge in free {
        for g in isometries {
            let [re, im] = before[g.source[edge]];
            let im = if g.conjugate { -im } else { im };
            let [c, s] = g.phase;
            u[edge] = add(u[edge], [c * re - s * im, c * im + s * re]);
        }
        u[edge] = u[edge].map(|x| x / (isometries.len() + 1) as f64);
    }
}

/// (M + τK) u = M u' + τ b on the free edges, or K u = b; M is lumped and all matrices share one pattern.
struct Diffusion {
    free: Vec<usize>,
    mass: Vec<f64>,
    stiffness: Vec<f64>,
    diagonal: Vec<usize>,
    /// −K u over the known edges.
    source: Vec<[f64; 2]>,
    factor: Cholesky,
}

impl Diffusion {
    fn new(mesh: &LayoutMesh, known: &[Option<f64>], u: &[[f64; 2]]) -> Result<Self, SparseError> {
        let free: Vec<usize> = (0..known.len()).filter(|&e| known[e].is_none()).collect();
        let mut number = vec![usize::MAX; known.len()];
        free.iter().enumerate().for_each(|(i, &e)| number[e] = i);
        let mut mass = vec![0.0; free.len()];
        let mut source = vec![[0.0; 2]; free.len()];
        let (mut places, mut values) = (Vec::with_capacity(6 * mesh.triangles.len()), Vec::new());
        for (face, edges) in mesh.adjacency.face_edges.iter().enumerate() {
            let (area, gradients) = (mesh.geometry.areas[face], &mesh.geometry.gradients[face]);
            for i in 0..3 {
                let row = number[edges[i]];
                if row == usize::MAX {
                    continue;
                }
                mass[row] += area / 3.0;
                for j in 0..3 {
                    // The function of side i is 1 − 2λ_i: its gradient is −2 times that of the hat function.
                    let (g, h) = (gradients[i], gradients[j]);
                    let value = 4.0 * area * (g[0] * h[0] + g[1] * h[1]);
                    let column = number[edges[j]];
                    if column == usize::MAX {
                        source[row] = add(source[row], u[edges[j]].map(|x| -value * x));
                    } else if row <= column {
                        places.push((column, row));
                        values.push(value);
                    }
                }
            }
        }
        let pattern = Pattern::new(free.len(), &places);
        let mut stiffness = vec![0.0; pattern.rows.len()];
        pattern.place.iter().zip(&values).for_each(|(&p, v)| stiffness[p] += v);
        let factor = Cholesky::analyse(&pattern.offsets, &pattern.rows, None)?;
        let diagonal = factor.diagonal();
        Ok(Self { free, mass, stiffness, diagonal, source, factor })
    }

    fn prepare(&mut self, time: Option<f64>) -> Result<(), SparseError> {
        let Some(time) = time else { return self.factor.factorize(&self.stiffness) };
        let mut values: Vec<f64> = self.stiffness.iter().map(|k| time * k).collect();
        self.diagonal.iter().zip(&self.mass).for_each(|(&i, m)| values[i] += m);
        self.factor.factorize(&values)
    }

    /// Real parts, then imaginary parts.
    fn solve(&self, u: &[[f64; 2]], time: Option<f64>) -> Vec<f64> {
        let n = self.free.len();
        let mut x = vec![0.0; 2 * n];
        for (i, &edge) in self.free.iter().enumerate() {
            for c in 0..2 {
                x[c * n + i] = match time {
                    None => self.source[i][c],
                    Some(time) => self.mass[i] * u[edge][c] + time * self.source[i][c],
                };
            }
        }
        self.factor.solve(&mut x);
        x
    }

    fn store(&self, x: &[f64], u: &mut [[f64; 2]]) {
        let n = self.free.len();
        self.free.iter().enumerate().for_each(|(i, &edge)| u[edge] = [x[i], x[n + i]]);
    }

    /// Root mean square change of the normalised values.
    fn change(&self, x: &[f64], u: &[[f64; 2]]) -> f64 {
        let n = self.free.len();
        let (mut sum, mut whole) = (0.0, 0.0);
        for (i, &edge) in self.free.iter().enumerate() {
            let new = unit([x[i], x[n + i]]);
            sum += self.mass[i] * ((new[0] - u[edge][0]).powi(2) + (new[1] - u[edge][1]).powi(2));
            whole += self.mass[i];
        }
        (sum / whole).sqrt()
    }
}

#[cfg(test)]
#[path = "cross_field_tests.rs"]
mod tests;
