//! Where strips' matrices go: the sparsity of the Hessian over the free points, and over the coordinates of a basis.

use crate::numeric::sparse::{CooMatrix, CscMatrix, NOWHERE, congruence, upper_triangle};
use crate::optimizer::elements::{Elements, Strip};
use crate::optimizer::strip_kernel::Buffers;

/// How the block of functions f, g goes to that of their points r, s; only r ≤ s is stored.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Ordered = 0,
    /// r > s: the block's transpose.
    Swapped = 1,
    /// f = g.
    Diagonal = 2,
    /// r = s for different functions: the block and its transpose.
    Glued = 3,
}

/// Sparsity of the Hessian of points with two components, and where every pair of functions goes.
pub(crate) struct Assembly {
    /// Free index of every shared point.
    pub free_of: Vec<u32>,
    /// Per point: `columns[s]..columns[s + 1]` of `neighbours`, the free points r ≤ s it shares a span with.
    pub columns: Vec<usize>,
    pub neighbours: Vec<u32>,
    /// Column offsets and row indices of the upper triangle, x and y interleaved.
    pub offsets: Vec<usize>,
    pub rows: Vec<usize>,
    /// Per strip, in the order of [`Buffers::rows`]: index among the neighbours.
    targets: Vec<Vec<u32>>,
    /// Per strip and function: free index.
    free: Vec<Vec<u32>>,
}

/// Pairs of functions (f, g) of a strip in the order of its rows, each once, with their place there.
fn for_each_pair(elements: &Elements, s: usize, mut visit: impl FnMut(usize, usize, usize)) {
    let (strip, nodes) = (&elements.strips[s], &elements.nodes[s]);
    let (u, v) = (&elements.axes[nodes.u], &elements.axes[nodes.v]);
    let [n_u, n_v] = strip.shape;
    let width = 2 * u.n - 1;
    for j in 0..n_v {
        for dj in (0..v.n.min(n_v - j)).filter(|dj| v.overlap(j, j + dj)) {
            for i in 0..n_u {
                for di in 0..width {
                    let (other, back) = (i + di + 1, u.n);
                    if other < back || other - back >= n_u || (dj == 0 && other - back < i) {
                        continue;
                    }
                    let other = other - back;
                    if u.overlap(i, other) {
                        let place = ((j * v.n + dj) * n_u + i) * width + di;
                        visit(j * n_u + i, (j + dj) * n_u + other, place);
                    }
                }
            }
        }
    }
}

impl Assembly {
    pub fn new(elements: &Elements, n_points: usize, free: &[usize]) -> Self {
        let mut free_of = vec![NOWHERE; n_points];
        for (i, &p) in free.iter().enumerate() {
            free_of[p] = i as u32;
        }
        let n = free.len();
        let local: Vec<Vec<u32>> =
            elements.strips.iter().map(|s| s.points.iter().map(|&p| free_of[p as usize]).collect()).collect();
        let mut lists: Vec<Vec<u32>> = vec![vec![]; n];
        for (s, local) in local.iter().enumerate() {
            for_each_pair(elements, s, |f, g, _| {
                let (r, s) = (local[f].min(local[g]), local[f].max(local[g]));
                if s != NOWHERE {
                    lists[s as usize].push(r);
                }
            });
        }
        let (mut columns, mut neighbours) = (vec![0], vec![]);
        for list in &mut lists {
            list.sort_unstable();
            list.dedup();
            neighbours.extend_from_slice(list);
            columns.push(neighbours.len());
        }
        drop(lists);
        let (mut offsets, mut rows) = (vec![0], Vec::with_capacity(4 * neighbours.len()));
        for s in 0..n {
            for component in 0..2 {
                for &r in &neighbours[columns[s]..columns[s + 1]] {
                    rows.push(2 * r as usize);
                    if (r as usize) < s || component == 1 {
                        rows.push(2 * r as usize + 1);
                    }
                }
                offsets.push(rows.len());
            }
        }
        let targets = local.iter().enumerate().map(|(s, local)| {
            let (strip, nodes) = (&elements.strips[s], &elements.nodes[s]);
            let (u, v) = (&elements.axes[nodes.u], &elements.axes[nodes.v]);
            let mut out = vec![NOWHERE; strip.shape[1] * v.n * strip.shape[0] * (2 * u.n - 1)];
            for_each_pair(elements, s, |f, g, place| {
                let (r, s) = (local[f].min(local[g]), local[f].max(local[g]));
                if s != NOWHERE {
                    let list = &neighbours[columns[s as usize]..columns[s as usize + 1]];
                    let at = list.binary_search(&r).expect("pair is in the pattern") as u32;
                    let kind = match (f == g, local[f].cmp(&local[g])) {
                        (true, _) => Kind::Diagonal,
                        (_, std::cmp::Ordering::Less) => Kind::Ordered,
                        (_, std::cmp::Ordering::Greater) => Kind::Swapped,
                        (_, std::cmp::Ordering::Equal) => Kind::Glued,
                    };
                    out[place] = at * 4 + kind as u32;
                }
            });
            out
        });
        let targets = targets.collect();
        Self { free_of, columns, neighbours, offsets, rows, targets, free: local }
    }

    /// Call `visit(place, s, index of r in the list of s, kind)` for the pairs of a strip that count.
    #[inline(always)]
    fn for_each_target(
        &self,
        s: usize,
        strip: &Strip,
        elements: &Elements,
        mut visit: impl FnMut(usize, u32, u32, u32),
    ) {
        let nodes = &elements.nodes[s];
        let (n, m) = (elements.axes[nodes.v].n, elements.axes[nodes.u].n);
        let (free, targets, width, [n_u, n_v]) = (&self.free[s], &self.targets[s], 2 * m - 1, strip.shape);
        for j in 0..n_v {
            for dj in 0..n.min(n_v - j) {
                let base = (j * n + dj) * n_u * width;
                for i in 0..n_u {
                    let f = free[j * n_u + i];
                    if f == NOWHERE {
                        continue;
                    }
                    let (from, to) = (i.saturating_sub(m - 1), (i + m).min(n_u));
                    let place = base + i * width + from + m - 1 - i;
                    let list = &targets[place..place + to - from];
                    let others = &free[(j + dj) * n_u + from..(j + dj) * n_u + to];
                    for (k, (&target, &g)) in list.iter().zip(others).enumerate() {
                        if target != NOWHERE {
                            visit(place + k, f.max(g), target / 4, target % 4);
                        }
                    }
                }
            }
        }
    }

    /// Add a strip's matrix to the values of the upper triangle.
    pub fn scatter(&self, s: usize, elements: &Elements, buffers: &Buffers, values: &mut [f64]) {
        self.for_each_target(s, &elements.strips[s], elements, |place, column, at, kind| {
            let block: &[f64; 4] = buffers.rows[4 * place..].first_chunk().expect("four components");
            let [xx, mut xy, mut yx, yy] = *block;
            let column = 2 * column as usize;
            let first = self.offsets[column] + 2 * at as usize;
            let second = self.offsets[column + 1] + 2 * at as usize;
            let mut twice = 1.0;
            if kind == Kind::Swapped as u32 {
                (xy, yx) = (yx, xy);
            } else if kind == Kind::Glued as u32 {
                (xy, twice) = (xy + yx, 2.0);
            }
            values[first] += twice * xx;
            values[second] += xy;
            values[second + 1] += twice * yy;
            if kind < Kind::Diagonal as u32 {
                values[first + 1] += yx;
            }
        });
    }

    /// Add a strip's scalar matrix to the values of the upper triangle over the points ([`Self::columns`]).
    pub fn scatter_scalar(&self, s: usize, elements: &Elements, buffers: &Buffers, values: &mut [f64]) {
        self.for_each_target(s, &elements.strips[s], elements, |place, column, at, kind| {
            let twice = if kind == Kind::Glued as u32 { 2.0 } else { 1.0 };
            values[self.columns[column as usize] + at as usize] += twice * buffers.rows[place];
        });
    }

    /// Add a strip's gradient.
    pub fn scatter_gradient(&self, s: usize, buffers: &Buffers, gradient: &mut [f64]) {
        for (&f, g) in self.free[s].iter().zip(&buffers.gradient) {
            if f != NOWHERE {
                gradient[2 * f as usize] += g[0];
                gradient[2 * f as usize + 1] += g[1];
            }
        }
    }
}

/// Unknowns of the linear systems: the free points themselves, or coordinates z with `x_free = x_p + Z z`.
pub(crate) struct Reduced {
    /// `Z`, free points × reduced unknowns, for one component.
    pub z: CscMatrix<f64>,
    /// `value[to] += weight * full[from]`, sorted by `to`, turns the values of H into those of `Zᵀ H Z`.
    pub map: Vec<(u32, u32, f64)>,
    /// The two values of `Z` whose product the weight is, in the order of `map`.
    factors: Vec<(u32, u32)>,
    /// Number of values of `Zᵀ H Z`.
    pub values: usize,
}

/// A value of H, times two values of `Z`, that counts for an entry of `Zᵀ H Z`.
#[derive(Clone, Copy, Default)]
struct Term {
    row: u32,
    column: u32,
    from: u32,
    factors: (u32, u32),
}

/// Counting sort by a key below `n`, stable: linear in the number of terms, which a sort by comparison is not.
fn distributed(terms: &[Term], n: usize, key: impl Fn(&Term) -> u32) -> Vec<Term> {
    let mut next = vec![0; n + 1];
    terms.iter().for_each(|t| next[key(t) as usize + 1] += 1);
    for k in 0..n {
        next[k + 1] += next[k];
    }
    let mut out = vec![Term::default(); terms.len()];
    for &t in terms {
        let place = &mut next[key(&t) as usize];
        out[*place] = t;
        *place += 1;
    }
    out
}

impl Reduced {
    /// Pattern of `Zᵀ H Z` (upper triangle, interleaved) and the linear map between the values.
    pub fn new(z: CscMatrix<f64>, assembly: &Assembly) -> (Self, Vec<usize>, Vec<usize>) {
        let rows_of: Vec<Vec<(usize, u32)>> = {
            let mut rows = vec![vec![]; z.nrows()];
            for (k, (i, j, _)) in z.triplet_iter().enumerate() {
                rows[i].push((j, k as u32));
            }
            rows
        };
        // Every entry (i, j) of the upper triangle stands for (j, i) too.
        let n = 2 * z.ncols();
        let mut terms: Vec<Term> = Vec::with_capacity(2 * assembly.rows.len());
        for column in 0..assembly.offsets.len() - 1 {
            for k in assembly.offsets[column]..assembly.offsets[column + 1] {
                let row = assembly.rows[k];
                for &(p, wp) in &rows_of[row / 2] {
                    for &(q, wq) in &rows_of[column / 2] {
                        let (i, j) = ((2 * p + row % 2) as u32, (2 * q + column % 2) as u32);
                        let (from, factors) = (k as u32, (wp, wq));
                        if i <= j {
                            terms.push(Term { row: i, column: j, from, factors });
                        }
                        if row != column && j <= i {
                            terms.push(Term { row: j, column: i, from, factors });
                        }
                    }
                }
            }
        }
        // Stable, so terms of an entry stay in the order of `from`.
        let terms = distributed(&distributed(&terms, n, |t| t.row), n, |t| t.column);
        let (mut offsets, mut rows) = (vec![0; n + 1], vec![]);
        let (mut map, mut pairs) = (Vec::with_capacity(terms.len()), Vec::with_capacity(terms.len()));
        let mut last = None;
        for Term { row, column, from, factors } in terms {
            if last != Some((column, row)) {
                rows.push(row as usize);
                offsets[column as usize + 1] += 1;
                last = Some((column, row));
            }
            map.push((rows.len() as u32 - 1, from, 0.0));
            pairs.push(factors);
        }
        for c in 0..n {
            offsets[c + 1] += offsets[c];
        }
        let values = rows.len();
        let mut reduced = Self { z, map, factors: pairs, values };
        reduced.weigh();
        (reduced, offsets, rows)
    }

    /// Other values of `Z` in the same pattern.
    pub fn set_values(&mut self, values: &[f64]) {
        self.z.values_mut().copy_from_slice(values);
        self.weigh();
    }

    fn weigh(&mut self) {
        let z = self.z.values();
        for (entry, &(p, q)) in self.map.iter_mut().zip(&self.factors) {
            entry.2 = z[p as usize] * z[q as usize];
        }
    }

    /// `Zᵀ g` for a gradient over the free points, components interleaved.
    pub fn gather(&self, full: &[f64], out: &mut [f64]) {
        out.fill(0.0);
        for (i, j, &w) in self.z.triplet_iter() {
            for c in 0..2 {
                out[2 * j + c] += w * full[2 * i + c];
            }
        }
    }

    /// Values of `Zᵀ H Z` from those of H.
    pub fn congruence(&self, full: &[f64], out: &mut [f64]) {
        out.fill(0.0);
        for &(to, from, w) in &self.map {
            out[to as usize] += w * full[from as usize];
        }
    }

    /// `Zᵀ K Z` of a scalar matrix over the free points: column offsets, rows and values of the upper triangle.
    pub fn scalar_congruence(
        &self,
        assembly: &Assembly,
        values: &[f64],
    ) -> (Vec<usize>, Vec<usize>, Vec<f64>) {
        let n = self.z.nrows();
        let mut k = CooMatrix::new(n, n);
        for s in 0..n {
            for at in assembly.columns[s]..assembly.columns[s + 1] {
                let r = assembly.neighbours[at] as usize;
                k.push(r, s, values[at]);
                if r != s {
                    k.push(s, r, values[at]);
                }
            }
        }
        let upper = upper_triangle(&congruence(&CscMatrix::from(&k), &self.z));
        (upper.col_offsets().to_vec(), upper.row_indices().to_vec(), upper.values().to_vec())
    }
}
