//! Piecewise linear finite elements on a triangle mesh: gradients of the hat functions and the cotan Laplacian.
//!
//! Convention: L = Σ_f area_f G_fᵀ G_f, so L_ij = −(cot α + cot β)/2 for the two angles opposite the edge ij, and
//! the Dirichlet energy ½ Σ_f area_f ‖∇u‖² is ½ uᵀ L u = ¼ Σ_edges (cot α + cot β)(u_i − u_j)², each edge counted
//! once (the factor of Xu et al. 2023, Eq. 9, holds for w = cot α + cot β).

use thiserror::Error;

use crate::numeric::sparse::{CooMatrix, CscMatrix, SparseError};

/// Why a mesh cannot carry the computation.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum MeshError {
    /// A face is inverted or has no area.
    #[error("face {face} has the signed area {area:e}; faces must be counter-clockwise and not degenerate")]
    DegenerateFace {
        /// The face.
        face: usize,
        /// Its signed area.
        area: f64,
    },
    /// A face or the list of fixed vertices names a vertex that does not exist.
    #[error("there is no vertex {vertex}")]
    UnknownVertex {
        /// Its index.
        vertex: usize,
    },
    /// A vertex is connected to no fixed vertex, so its position is not determined.
    #[error("vertex {vertex} is connected to no fixed vertex")]
    Floating {
        /// Its index.
        vertex: usize,
    },
    /// The null-space basis does not have one row for each free vertex.
    #[error("the null-space basis has {rows} rows for {free} free vertices")]
    NullSpaceShape {
        /// Rows of the basis.
        rows: usize,
        /// Free vertices of the mesh.
        free: usize,
    },
    /// The linear system cannot be solved.
    #[error(transparent)]
    Sparse(#[from] SparseError),
}

/// Areas of the faces and gradients of their hat functions.
#[derive(Debug, Clone, PartialEq)]
pub struct FaceGeometry {
    /// Area of every face.
    pub areas: Vec<f64>,
    /// `gradients[f][i]` is the gradient of the hat function of corner `i` on face `f`.
    pub gradients: Vec<[[f64; 2]; 3]>,
}

/// Below this ratio of twice the area to the squared longest edge the sign of a triangle's area is rounding.
pub const DEGENERATE: f64 = 1e-15;

impl FaceGeometry {
    /// Compute them; the faces must be counter-clockwise.
    pub fn new(points: &[[f64; 2]], triangles: &[[usize; 3]]) -> Result<Self, MeshError> {
        let mut areas = Vec::with_capacity(triangles.len());
        let mut gradients = Vec::with_capacity(triangles.len());
        for (face, t) in triangles.iter().enumerate() {
            if let Some(&vertex) = t.iter().find(|&&v| v >= points.len()) {
                return Err(MeshError::UnknownVertex { vertex });
            }
            let corner = t.map(|v| points[v]);
            let edge = [0, 1, 2].map(|i: usize| {
                let (p, q) = (corner[(i + 1) % 3], corner[(i + 2) % 3]);
                [q[0] - p[0], q[1] - p[1]]
            });
            let double = edge[2][0] * -edge[1][1] + edge[2][1] * edge[1][0];
            let longest = edge.iter().map(|e| e[0] * e[0] + e[1] * e[1]).fold(0.0, f64::max);
            if double.is_nan() || double <= DEGENERATE * longest {
                return Err(MeshError::DegenerateFace { face, area: double / 2.0 });
            }
            areas.push(double / 2.0);
            gradients.push(edge.map(|e| [-e[1] / double, e[0] / double]));
        }
        Ok(Self { areas, gradients })
    }

    /// Jacobian (row-major) on face `face`, with corners `t`, of the piecewise linear map with vertex values `u`.
    #[inline]
    pub fn jacobian(&self, face: usize, t: [usize; 3], u: &[[f64; 2]]) -> [f64; 4] {
        let g = &self.gradients[face];
        let mut j = [0.0; 4];
        for i in 0..3 {
            let value = u[t[i]];
            for c in 0..2 {
                j[2 * c] += value[c] * g[i][0];
                j[2 * c + 1] += value[c] * g[i][1];
            }
        }
        j
    }

    /// The Laplacian restricted to the vertices with a `number`, which become its rows and columns.
    pub fn stiffness(
        &self,
        triangles: &[[usize; 3]],
        size: usize,
        number: impl Fn(usize) -> Option<usize>,
    ) -> CscMatrix<f64> {
        let (mut rows, mut columns, mut values) = (Vec::new(), Vec::new(), Vec::new());
        for (face, t) in triangles.iter().enumerate() {
            let g = &self.gradients[face];
            let numbered = t.map(&number);
            for i in 0..3 {
                for j in 0..3 {
                    if let (Some(row), Some(column)) = (numbered[i], numbered[j]) {
                        rows.push(row);
                        columns.push(column);
                        values.push(self.areas[face] * (g[i][0] * g[j][0] + g[i][1] * g[j][1]));
                    }
                }
            }
        }
        let coo =
            CooMatrix::try_from_triplets(size, size, rows, columns, values).expect("numbers are below size");
        CscMatrix::from(&coo)
    }
}

/// The cotan Laplacian of a mesh, in full (both triangles).
pub fn cotan_laplacian(points: &[[f64; 2]], triangles: &[[usize; 3]]) -> Result<CscMatrix<f64>, MeshError> {
    Ok(FaceGeometry::new(points, triangles)?.stiffness(triangles, points.len(), Some))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn cotangents_of_one_triangle(x in 0.1..5.0f64, y in 0.1..5.0f64, dx in -3.0..3.0f64) {
            let points = [[0.0, 0.0], [x, 0.0], [dx, y]];
            let l = cotan_laplacian(&points, &[[0, 1, 2]]).unwrap();
            let cot = |p: [f64; 2], q: [f64; 2], r: [f64; 2]| {
                let (a, b) = ([q[0] - p[0], q[1] - p[1]], [r[0] - p[0], r[1] - p[1]]);
                (a[0] * b[0] + a[1] * b[1]) / (a[0] * b[1] - a[1] * b[0])
            };
            for (i, j, k) in [(0, 1, 2), (1, 2, 0), (2, 0, 1)] {
                let entry = l.get_entry(i, j).unwrap().into_value();
                let expected = -cot(points[k], points[i], points[j]) / 2.0;
                prop_assert!((entry - expected).abs() < 1e-9 * (1.0 + expected.abs()));
            }
        }
    }

    #[test]
    fn names_the_bad_face() {
        let points = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [2.0, 0.0]];
        let inverted = cotan_laplacian(&points, &[[0, 1, 2], [0, 2, 1]]);
        assert_eq!(inverted.unwrap_err(), MeshError::DegenerateFace { face: 1, area: -0.5 });
        assert!(matches!(
            cotan_laplacian(&points, &[[0, 1, 3]]),
            Err(MeshError::DegenerateFace { face: 0, .. })
        ));
        assert_eq!(
            cotan_laplacian(&points, &[[0, 1, 7]]).unwrap_err(),
            MeshError::UnknownVertex { vertex: 7 }
        );
    }
}
