//! Maps of triangle meshes with bounded conformal distortion, by local–global alternation.
//!
//! Minimises E(u) = Σ_f area_f dist²(J_f(u), H_f), H_f being the matrices with 1 ≤ σ₁/σ₂ ≤ k_f, over piecewise
//! linear maps with fixed vertices and linear constraints (Xu et al. 2023, Eq. 15–18; the area weights, which the
//! paper omits, make the energy independent of the meshing and the global step a Poisson problem). The local step
//! projects every Jacobian; the global step solves with the cotan Laplacian, factorized once.
//!
//! Constraints enter through a basis Z of the admissible displacements of the free vertices. Only displacements
//! are solved for, so the caller's initial map carries both boundary values and the particular solution.

use rayon::prelude::*;

use crate::mesh::laplacian::{FaceGeometry, MeshError};
use crate::numeric::sparse::{Cholesky, CscMatrix, congruence, upper_triangle};
use crate::numeric::ssvd;

// Sums are formed per chunk and added in order, so results do not depend on the number of threads. Small enough that the
// meshes of control points (300 to 1500 faces on the samples) are split.
const CHUNK: usize = 256;

/// What happened in [`LocalGlobal::iterate`].
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Report {
    /// Number of faces with det J ≤ 0: of the initial map, then after every step.
    pub flips: Vec<usize>,
    /// E(u) at the same moments; never increases.
    pub energy: Vec<f64>,
    /// Number of global steps taken.
    pub steps: usize,
}

struct NullSpace {
    columns: CscMatrix<f64>,
    /// The transpose, whose columns are the rows of Z.
    rows: CscMatrix<f64>,
}

/// A mesh with its fixed vertices and constraints, ready for any number of solves.
pub struct LocalGlobal {
    triangles: Vec<[usize; 3]>,
    geometry: FaceGeometry,
    n_vertices: usize,
    free: Vec<usize>,
    offsets: Vec<usize>,
    incidences: Vec<u32>,
    null_space: Option<NullSpace>,
    cholesky: Cholesky,
    loads: Vec<[[f64; 2]; 3]>,
    forces: Vec<[f64; 2]>,
    reduced: Vec<f64>,
}

impl LocalGlobal {
    /// Prepare a mesh: counter-clockwise faces, indices of fixed vertices (any order), and the basis Z
    /// (free vertices in increasing order × n_z, full column rank); `None` is the identity.
    pub fn new(
        points: &[[f64; 2]],
        triangles: &[[usize; 3]],
        fixed: &[usize],
        null_space: Option<CscMatrix<f64>>,
    ) -> Result<Self, MeshError> {
        let geometry = FaceGeometry::new(points, triangles)?;
        let n = points.len();
        let mut is_fixed = vec![false; n];
        for &vertex in fixed {
            *is_fixed.get_mut(vertex).ok_or(MeshError::UnknownVertex { vertex })? = true;
        }
        check_connected(triangles, &is_fixed)?;
        let free: Vec<usize> = (0..n).filter(|&v| !is_fixed[v]).collect();
        let mut number = vec![None; n];
        for (i, &v) in free.iter().enumerate() {
            number[v] = Some(i);
        }
        let stiffness = geometry.stiffness(triangles, free.len(), |v| number[v]);
        let null_space = match null_space {
            Some(z) if z.nrows() != free.len() => {
                return Err(MeshError::NullSpaceShape { rows: z.nrows(), free: free.len() });
            }
            z => z.map(|columns| NullSpace { rows: columns.transpose(), columns }),
        };
        let upper = match &null_space {
            None => upper_triangle(&stiffness),
            Some(z) => upper_triangle(&congruence(&stiffness, &z.columns)),
        };
        let mut cholesky = Cholesky::analyse(upper.col_offsets(), upper.row_indices(), None)?;
        cholesky.factorize(upper.values())?;
        let (offsets, incidences) = incidence_lists(triangles, &number, free.len());
        Ok(Self {
            loads: vec![[[0.0; 2]; 3]; triangles.len()],
            forces: vec![[0.0; 2]; free.len()],
            reduced: vec![0.0; 2 * upper.ncols()],
            triangles: triangles.to_vec(),
            geometry,
            n_vertices: n,
            free,
            offsets,
            incidences,
            null_space,
            cholesky,
        })
    }

    /// Number of faces.
    pub fn n_faces(&self) -> usize {
        self.triangles.len()
    }

    /// Number of vertices.
    pub fn n_vertices(&self) -> usize {
        self.n_vertices
    }

    /// Jacobians of a map, row-major.
    pub fn jacobians(&self, u: &[[f64; 2]]) -> Vec<[f64; 4]> {
        let faces = self.triangles.par_iter().enumerate().with_min_len(CHUNK);
        faces.map(|(f, &t)| self.geometry.jacobian(f, t, u)).collect()
    }

    /// Signed singular values (σ₁, σ₂) of a map on every face.
    pub fn singular_values(&self, u: &[[f64; 2]]) -> Vec<[f64; 2]> {
        self.jacobians(u).into_iter().map(ssvd::signed_singular_values).collect()
    }

    /// Number of faces with det J ≤ 0.
    pub fn flips(&self, u: &[[f64; 2]]) -> usize {
        self.jacobians(u).into_iter().filter(|&j| is_flip(j)).count()
    }

    /// Move the free vertices to the minimum of the Dirichlet energy: the harmonic map under the constraints.
    pub fn harmonic(&mut self, u: &mut [[f64; 2]]) {
        self.local_step(u, |_, _| [0.0; 4]);
        self.global_step(u);
    }

    /// Alternate local and global steps until no face is flipped, `iterations` steps are done, the energy falls
    /// by less than the fraction `tolerance` in a step, or `proceed` (asked before each step) says no.
    ///
    /// `k` holds the bound of every face, finite and at least 1.
    pub fn iterate(
        &mut self,
        u: &mut [[f64; 2]],
        k: &[f64],
        iterations: usize,
        tolerance: f64,
        mut proceed: impl FnMut() -> bool,
    ) -> Report {
        assert_eq!(k.len(), self.n_faces(), "one bound for each face");
        let mut report = Report::default();
        let mut previous = f64::INFINITY;
        loop {
            let (energy, flips) = self.local_step(u, |face, j| ssvd::project(j, k[face]));
            report.energy.push(energy);
            report.flips.push(flips);
            let stalled = report.steps > 0 && previous - energy <= tolerance * previous;
            if flips == 0 || stalled || report.steps == iterations || !proceed() {
                return report;
            }
            previous = energy;
            self.global_step(u);
            report.steps += 1;
        }
    }

    /// Energy and flips of `u`; leaves in `loads` the forces of every face on its corners.
    fn local_step(
        &mut self,
        u: &[[f64; 2]],
        project: impl Fn(usize, [f64; 4]) -> [f64; 4] + Sync,
    ) -> (f64, usize) {
        assert_eq!(u.len(), self.n_vertices, "one position for each vertex");
        let (triangles, geometry) = (&self.triangles, &self.geometry);
        let partial: Vec<(f64, usize)> = self
            .loads
            .par_chunks_mut(CHUNK)
            .enumerate()
            .map(|(chunk, loads)| {
                let (mut energy, mut flips) = (0.0, 0);
                for (i, load) in loads.iter_mut().enumerate() {
                    let face = chunk * CHUNK + i;
                    let j = geometry.jacobian(face, triangles[face], u);
                    let h = project(face, j);
                    let area = geometry.areas[face];
                    let d = [h[0] - j[0], h[1] - j[1], h[2] - j[2], h[3] - j[3]];
                    energy += area * (d[0] * d[0] + d[1] * d[1] + d[2] * d[2] + d[3] * d[3]);
                    flips += usize::from(is_flip(j));
                    *load = geometry.gradients[face]
                        .map(|g| [area * (d[0] * g[0] + d[1] * g[1]), area * (d[2] * g[0] + d[3] * g[1])]);
                }
                (energy, flips)
            })
            .collect();
        partial.iter().fold((0.0, 0), |(e, n), p| (e + p.0, n + p.1))
    }

    /// Displace the free vertices by Z (ZᵀLZ)⁻¹ Zᵀ times the gathered forces.
    fn global_step(&mut self, u: &mut [[f64; 2]]) {
        let (offsets, incidences) = (&self.offsets, &self.incidences);
        let loads = self.loads.as_flattened();
        self.forces.par_iter_mut().enumerate().with_min_len(CHUNK).for_each(|(i, force)| {
            *force = [0.0; 2];
            for &corner in &incidences[offsets[i]..offsets[i + 1]] {
                let load = loads[corner as usize];
                force[0] += load[0];
                force[1] += load[1];
            }
        });
        let forces = &self.forces;
        let size = self.reduced.len() / 2;
        if size == 0 {
            return;
        }
        let (x, y) = self.reduced.split_at_mut(size);
        let components = x.par_iter_mut().zip(y.par_iter_mut()).enumerate().with_min_len(CHUNK);
        match &self.null_space {
            None => components.for_each(|(i, (x, y))| [*x, *y] = forces[i]),
            Some(z) => components.for_each(|(i, (x, y))| {
                let column = z.columns.col(i);
                [*x, *y] = [0.0; 2];
                for (&row, &value) in column.row_indices().iter().zip(column.values()) {
                    *x += value * forces[row][0];
                    *y += value * forces[row][1];
                }
            }),
        }
        // Both at once, column by column in any case, so that the bits do not depend on the threads.
        let (x, y) = self.reduced.split_at_mut(size);
        rayon::join(|| self.cholesky.solve(x), || self.cholesky.solve(y));
        for (i, &v) in self.free.iter().enumerate() {
            match &self.null_space {
                None => {
                    u[v][0] += x[i];
                    u[v][1] += y[i];
                }
                Some(z) => {
                    let row = z.rows.col(i);
                    for (&column, &value) in row.row_indices().iter().zip(row.values()) {
                        u[v][0] += value * x[column];
                        u[v][1] += value * y[column];
                    }
                }
            }
        }
    }
}

fn is_flip(j: [f64; 4]) -> bool {
    let det = j[0] * j[3] - j[1] * j[2];
    det.is_nan() || det <= 0.0
}

/// Every vertex must be connected to a fixed one, or the Laplacian is singular.
fn check_connected(triangles: &[[usize; 3]], is_fixed: &[bool]) -> Result<(), MeshError> {
    fn root(parent: &mut [usize], mut v: usize) -> usize {
        while parent[v] != v {
            parent[v] = parent[parent[v]];
            v = parent[v];
        }
        v
    }
    let mut parent: Vec<usize> = (0..is_fixed.len()).collect();
    for t in triangles {
        for v in [t[1], t[2]] {
            let (a, b) = (root(&mut parent, t[0]), root(&mut parent, v));
            parent[a.max(b)] = a.min(b);
        }
    }
    let mut anchored = vec![false; is_fixed.len()];
    for v in (0..is_fixed.len()).filter(|&v| is_fixed[v]) {
        anchored[root(&mut parent, v)] = true;
    }
    match (0..is_fixed.len()).find(|&v| !anchored[root(&mut parent, v)]) {
        Some(vertex) => Err(MeshError::Floating { vertex }),
        None => Ok(()),
    }
}

/// For every free vertex the corners (3 face + corner) that touch it, by increasing face.
fn incidence_lists(
    triangles: &[[usize; 3]],
    number: &[Option<usize>],
    n_free: usize,
) -> (Vec<usize>, Vec<u32>) {
    let mut offsets = vec![0; n_free + 1];
    for i in triangles.as_flattened().iter().filter_map(|&v| number[v]) {
        offsets[i + 1] += 1;
    }
    for i in 0..n_free {
        offsets[i + 1] += offsets[i];
    }
    let mut next = offsets.clone();
    let mut incidences = vec![0; offsets[n_free]];
    for (corner, &v) in triangles.as_flattened().iter().enumerate() {
        if let Some(i) = number[v] {
            incidences[next[i]] = u32::try_from(corner).expect("fewer than 1.4e9 faces");
            next[i] += 1;
        }
    }
    (offsets, incidences)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::sparse::CooMatrix;

    /// (n + 1)² grid on the unit square and its boundary vertices.
    fn grid(n: usize) -> (Vec<[f64; 2]>, Vec<[usize; 3]>, Vec<usize>) {
        let at = |i: usize, j: usize| i * (n + 1) + j;
        let points = (0..(n + 1) * (n + 1))
            .map(|v| [(v / (n + 1)) as f64 / n as f64, (v % (n + 1)) as f64 / n as f64])
            .collect();
        let mut triangles = Vec::new();
        for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
            triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
            triangles.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
        }
        let rim = |v: &usize| [v / (n + 1), v % (n + 1)].iter().any(|&c| c == 0 || c == n);
        (points, triangles, (0..(n + 1) * (n + 1)).filter(rim).collect())
    }

    /// Interior vertices thrown about by a deterministic noise as large as the square.
    fn shuffled(points: &[[f64; 2]], fixed: &[usize], amplitude: f64) -> Vec<[f64; 2]> {
        let mut u = points.to_vec();
        for v in (0..u.len()).filter(|v| fixed.binary_search(v).is_err()) {
            u[v][0] += amplitude * (12.9898 * v as f64).sin();
            u[v][1] += amplitude * (78.233 * v as f64).cos();
        }
        u
    }

    #[test]
    fn removes_folds_with_monotone_energy() {
        let (points, triangles, fixed) = grid(20);
        let mut u = shuffled(&points, &fixed, 0.3);
        let mut solver = LocalGlobal::new(&points, &triangles, &fixed, None).unwrap();
        let initial = solver.flips(&u);
        assert!(initial > 100);
        let k = vec![3.0; triangles.len()];
        let report = solver.iterate(&mut u, &k, 500, 0.0, || true);
        assert_eq!(report.flips[0], initial);
        assert_eq!(report.flips.last(), Some(&0));
        assert_eq!(report.flips.len(), report.steps + 1);
        assert!(report.energy.windows(2).all(|w| w[1] <= w[0] * (1.0 + 1e-12)));
        assert_eq!(solver.flips(&u), 0);
        for &v in &fixed {
            assert_eq!(u[v], points[v]);
        }
    }

    #[test]
    fn same_bits_for_any_number_of_threads() {
        let (points, triangles, fixed) = grid(60);
        assert!(triangles.len() > 3 * CHUNK);
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let mut solver = LocalGlobal::new(&points, &triangles, &fixed, None).unwrap();
                let mut u = shuffled(&points, &fixed, 0.5);
                let report = solver.iterate(&mut u, &vec![2.0; triangles.len()], 25, 0.0, || true);
                solver.harmonic(&mut u);
                (report, u)
            })
        };
        let (one, two) = (run(1), run(2));
        assert!(one.0.steps > 3);
        assert_eq!(one, two);
        assert_eq!(one, run(3));
    }

    #[test]
    fn stops_when_told() {
        let (points, triangles, fixed) = grid(10);
        let mut u = shuffled(&points, &fixed, 0.5);
        let mut solver = LocalGlobal::new(&points, &triangles, &fixed, None).unwrap();
        let k = vec![1.5; triangles.len()];
        let before = u.clone();
        assert_eq!(solver.iterate(&mut u, &k, 10, 0.0, || false).steps, 0);
        assert_eq!(u, before);
        assert_eq!(solver.iterate(&mut u, &k, 2, 0.0, || true).steps, 2);
        // Any decrease counts as a stall.
        assert_eq!(solver.iterate(&mut u, &k, 10, 1.0, || true).steps, 1);
    }

    #[test]
    fn null_space_ties_vertices() {
        let (points, triangles, fixed) = grid(8);
        let free: Vec<usize> = (0..points.len()).filter(|v| fixed.binary_search(v).is_err()).collect();
        // Vertices 0 and 1 of the free ones move together.
        let mut z = CooMatrix::new(free.len(), free.len() - 1);
        for i in 0..free.len() {
            z.push(i, i.saturating_sub(1), 1.0);
        }
        let mut solver = LocalGlobal::new(&points, &triangles, &fixed, Some(CscMatrix::from(&z))).unwrap();
        let mut u = shuffled(&points, &fixed, 0.3);
        let gap = |u: &[[f64; 2]]| [u[free[1]][0] - u[free[0]][0], u[free[1]][1] - u[free[0]][1]];
        let before = gap(&u);
        solver.harmonic(&mut u);
        let after = gap(&u);
        assert!((0..2).all(|c| (after[c] - before[c]).abs() < 1e-14));
        // Stationary in every admissible direction: another solve does not move it.
        let still = u.clone();
        solver.harmonic(&mut u);
        assert!(u.iter().zip(&still).all(|(a, b)| (0..2).all(|c| (a[c] - b[c]).abs() < 1e-14)));
    }

    #[test]
    fn refuses_bad_meshes() {
        let (points, triangles, fixed) = grid(3);
        let error = |fixed: &[usize], z| LocalGlobal::new(&points, &triangles, fixed, z).err().unwrap();
        assert_eq!(error(&[], None), MeshError::Floating { vertex: 0 });
        assert_eq!(error(&[99], None), MeshError::UnknownVertex { vertex: 99 });
        let z = CscMatrix::identity(3);
        assert_eq!(error(&fixed, Some(z)), MeshError::NullSpaceShape { rows: 3, free: 4 });
    }
}
