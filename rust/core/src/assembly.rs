//! Where element matrices go: the sparsity of the Hessian over the free points, and over the coordinates of a basis.

use crate::elements::Elements;
use crate::sparse::CscMatrix;

/// Index of fixed points, and of pairs of functions with one: nothing to add.
pub(crate) const NOWHERE: u32 = u32::MAX;

/// Sparsity of the Hessian of points with two components, and where every pair of functions goes.
pub(crate) struct Assembly {
    /// Free index of every shared point.
    pub free_of: Vec<u32>,
    /// Column offsets and row indices of the upper triangle, x and y interleaved.
    pub offsets: Vec<usize>,
    pub rows: Vec<usize>,
    /// Per element and pair of functions: position of the 2x2 block's first entry.
    targets: Vec<u32>,
    /// Start of every element's targets.
    starts: Vec<usize>,
    /// Length of the first of the two columns of every free point.
    column: Vec<u32>,
}

impl Assembly {
    pub fn new(elements: &Elements, n_points: usize, free: &[usize]) -> Self {
        let mut free_of = vec![NOWHERE; n_points];
        for (i, &p) in free.iter().enumerate() {
            free_of[p] = i as u32;
        }
        let n = free.len();
        let mut neighbours: Vec<Vec<u32>> = vec![vec![]; n];
        for e in 0..elements.len() {
            let local: Vec<u32> = elements.points_of(e).iter().map(|&p| free_of[p as usize]).collect();
            for &s in local.iter().filter(|&&s| s != NOWHERE) {
                neighbours[s as usize].extend(local.iter().filter(|&&r| r <= s));
            }
        }
        let (mut offsets, mut rows, mut column) = (vec![0], vec![], vec![]);
        for (s, list) in neighbours.iter_mut().enumerate() {
            list.sort_unstable();
            list.dedup();
            for component in 0..2 {
                for &r in list.iter() {
                    rows.push(2 * r as usize);
                    if (r as usize) < s || component == 1 {
                        rows.push(2 * r as usize + 1);
                    }
                }
                offsets.push(rows.len());
            }
            column.push((offsets[2 * s + 1] - offsets[2 * s]) as u32);
        }
        let (mut targets, mut starts) = (vec![], vec![0]);
        for e in 0..elements.len() {
            let local: Vec<u32> = elements.points_of(e).iter().map(|&p| free_of[p as usize]).collect();
            for &f in &local {
                for &g in &local {
                    let (r, s) = (f.min(g), f.max(g));
                    targets.push(if s == NOWHERE {
                        NOWHERE
                    } else {
                        let at = neighbours[s as usize].binary_search(&r).expect("pair is in the pattern");
                        (offsets[2 * s as usize] + 2 * at) as u32
                    });
                }
            }
            starts.push(targets.len());
        }
        Self { free_of, offsets, rows, targets, starts, column }
    }

    /// Add an element matrix (layout of [`Elements::contract_hessian`]) to the global values.
    pub fn scatter(
        &self,
        e: usize,
        points: &[u32],
        (nu, nv): (usize, usize),
        block: &[f64],
        values: &mut [f64],
    ) {
        let (n, targets) = (nu * nv, &self.targets[self.starts[e]..self.starts[e + 1]]);
        for b in 0..nv {
            for b2 in b..nv {
                let base = (b * nv + b2) * 4 * nu * nu;
                for a in 0..nu {
                    for a2 in if b == b2 { a..nu } else { 0..nu } {
                        let (f, g) = (a * nv + b, a2 * nv + b2);
                        let at = targets[f * n + g];
                        if at == NOWHERE {
                            continue;
                        }
                        let (r, s) = (self.free_of[points[f] as usize], self.free_of[points[g] as usize]);
                        let k = base + a * nu + a2;
                        let [xx, xy, yx, yy] = std::array::from_fn(|cd| block[k + cd * nu * nu]);
                        // The block of (r, s) stands at the larger point's columns; transpose if they are swapped.
                        let (xy, yx) = if r <= s { (xy, yx) } else { (yx, xy) };
                        let (first, second) =
                            (at as usize, at as usize + self.column[r.max(s) as usize] as usize);
                        values[first] += xx;
                        values[second] += xy;
                        values[second + 1] += yy;
                        if r != s {
                            values[first + 1] += yx;
                        }
                    }
                }
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
    /// Number of values of `Zᵀ H Z`.
    pub values: usize,
}

impl Reduced {
    /// Pattern of `Zᵀ H Z` (upper triangle, interleaved) and the linear map between the values.
    pub fn new(z: CscMatrix<f64>, assembly: &Assembly) -> (Self, Vec<usize>, Vec<usize>) {
        let rows_of: Vec<Vec<(usize, f64)>> = {
            let mut rows = vec![vec![]; z.nrows()];
            for (i, j, &w) in z.triplet_iter() {
                rows[i].push((j, w));
            }
            rows
        };
        // Every entry (i, j) of the upper triangle stands for (j, i) too.
        let mut triples: Vec<((usize, usize), u32, f64)> = vec![];
        for column in 0..assembly.offsets.len() - 1 {
            for k in assembly.offsets[column]..assembly.offsets[column + 1] {
                let row = assembly.rows[k];
                for &(p, wp) in &rows_of[row / 2] {
                    for &(q, wq) in &rows_of[column / 2] {
                        let (i, j) = (2 * p + row % 2, 2 * q + column % 2);
                        if i <= j {
                            triples.push(((j, i), k as u32, wp * wq));
                        }
                        if row != column && j <= i {
                            triples.push(((i, j), k as u32, wp * wq));
                        }
                    }
                }
            }
        }
        triples.sort_by_key(|&(key, from, _)| (key, from));
        let (mut offsets, mut rows, mut map) = (vec![0; 2 * z.ncols() + 1], vec![], vec![]);
        let mut last = None;
        for (key, from, w) in triples {
            if last != Some(key) {
                rows.push(key.1);
                offsets[key.0 + 1] += 1;
                last = Some(key);
            }
            map.push((rows.len() as u32 - 1, from, w));
        }
        for c in 0..2 * z.ncols() {
            offsets[c + 1] += offsets[c];
        }
        let values = rows.len();
        (Self { z, map, values }, offsets, rows)
    }
}
