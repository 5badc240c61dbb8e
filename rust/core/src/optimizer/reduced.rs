//! Unknowns that a null-space basis leaves: the congruence `Zᵀ H Z`, block by block.

use crate::numeric::sparse::CscMatrix;
use crate::optimizer::blocks::BlockPattern;

/// How a block of H counts for one of `Zᵀ H Z`.
#[derive(Clone, Copy)]
enum Sense {
    Plain = 0,
    Transposed = 1,
    /// For a block on the diagonal: with its transpose.
    Both = 2,
}

/// A block of H, times two values of `Z`, that counts for a block of `Zᵀ H Z`.
#[derive(Clone, Copy, Default)]
struct Term {
    /// Column and row of the block; then, its place among the blocks.
    column: u32,
    to: u32,
    /// Four times the block of H, and the sense.
    from: u32,
    factors: (u32, u32),
}

/// Coordinates z with `x_free = x_p + Z z` instead of the free points themselves.
pub(crate) struct Reduced {
    /// `Z`, free points × reduced unknowns, for one component.
    pub z: CscMatrix<f64>,
    pub pattern: BlockPattern,
    /// Sorted by the block that they count for.
    terms: Vec<Term>,
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
    /// Pattern of `Zᵀ H Z` for a matrix H on `full`, and the linear map between the values.
    pub fn new(z: CscMatrix<f64>, full: &BlockPattern) -> Self {
        let mut entries: Vec<Vec<(u32, u32)>> = vec![vec![]; z.nrows()];
        for (k, (i, j, _)) in z.triplet_iter().enumerate() {
            entries[i].push((j as u32, k as u32));
        }
        let n = z.ncols();
        let mut terms: Vec<Term> = Vec::with_capacity(full.blocks());
        for s in 0..full.points() {
            for k in full.columns[s]..full.columns[s + 1] {
                let r = full.rows[k] as usize;
                for &(p, wp) in &entries[r] {
                    for &(q, wq) in &entries[s] {
                        let sense = match p.cmp(&q) {
                            std::cmp::Ordering::Less => Sense::Plain,
                            // A block on the diagonal of H comes in both orders of p and q.
                            std::cmp::Ordering::Greater if r == s => continue,
                            std::cmp::Ordering::Greater => Sense::Transposed,
                            std::cmp::Ordering::Equal if r == s => Sense::Plain,
                            std::cmp::Ordering::Equal => Sense::Both,
                        };
                        let from = 4 * k as u32 + sense as u32;
                        terms.push(Term { column: p.max(q), to: p.min(q), from, factors: (wp, wq) });
                    }
                }
            }
        }
        drop(entries);
        // Stable, so terms of a block stay in the order of `from`.
        let by_row = distributed(&terms, n, |t| t.to);
        drop(terms);
        let mut terms = distributed(&by_row, n, |t| t.column);
        drop(by_row);
        let (mut columns, mut rows) = (vec![0; n + 1], vec![]);
        let mut last = None;
        for term in &mut terms {
            if last != Some((term.column, term.to)) {
                last = Some((term.column, term.to));
                rows.push(term.to);
                columns[term.column as usize + 1] += 1;
            }
            term.to = rows.len() as u32 - 1;
        }
        for c in 0..n {
            columns[c + 1] += columns[c];
        }
        Self { z, pattern: BlockPattern { columns, rows }, terms }
    }

    /// Other values of `Z` in the same pattern.
    pub fn set_values(&mut self, values: &[f64]) {
        self.z.values_mut().copy_from_slice(values);
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
    pub fn congruence(&self, full: &[f64], out: &mut Vec<f64>) {
        out.clear();
        out.resize(4 * self.pattern.blocks(), 0.0);
        let z = self.z.values();
        for &Term { to, from, factors: (p, q), .. } in &self.terms {
            let w = z[p as usize] * z[q as usize];
            let b: &[f64; 4] = full[(from & !3) as usize..].first_chunk().expect("four values a block");
            let b = match from % 4 {
                0 => *b,
                1 => [b[0], b[2], b[1], b[3]],
                _ => [2.0 * b[0], b[1] + b[2], b[1] + b[2], 2.0 * b[3]],
            };
            let out: &mut [f64; 4] = out[4 * to as usize..].first_chunk_mut().expect("four values a block");
            for k in 0..4 {
                out[k] += w * b[k];
            }
        }
    }

    /// Values of `Zᵀ K Z` from those of a matrix with one number for every block.
    pub fn scalar_congruence(&self, full: &[f64]) -> Vec<f64> {
        let (z, mut out) = (self.z.values(), vec![0.0; self.pattern.blocks()]);
        for &Term { to, from, factors: (p, q), .. } in &self.terms {
            let twice = if from % 4 == Sense::Both as u32 { 2.0 } else { 1.0 };
            out[to as usize] += twice * z[p as usize] * z[q as usize] * full[from as usize / 4];
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::sparse::CooMatrix;
    use crate::optimizer::blocks::tests::banded;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn is_the_congruence_of_the_matrix_in_full(
            n in 2usize..10, width in 0usize..4, seed in prop::collection::vec(-1.0..1.0, 41), wide in 0usize..4,
        ) {
            let (pattern, values, full) = banded(n, width, &seed);
            let m = n - 1;
            let mut coo = CooMatrix::new(n, m);
            for i in 0..n {
                // Every coordinate moves a point of its own, and some move several.
                for j in 0..m {
                    if i == j || (i * 7 + j * 3) % 5 < wide {
                        coo.push(i, j, seed[(i * m + j) % 41]);
                    }
                }
            }
            let z = CscMatrix::from(&coo);
            let dense = |i: usize, j: usize| z.get_entry(i, j).map_or(0.0, |e| e.into_value());
            let reduced = Reduced::new(z.clone(), &pattern);
            let mut found = vec![];
            reduced.congruence(&values, &mut found);
            let entry = |i: usize, j: usize| -> f64 {
                let sum = |r: usize| (0..n).map(|s| full[2 * r + i % 2][2 * s + j % 2] * dense(s, j / 2)).sum::<f64>();
                (0..n).map(|r| dense(r, i / 2) * sum(r)).sum()
            };
            for q in 0..m {
                for k in reduced.pattern.columns[q]..reduced.pattern.columns[q + 1] {
                    let p = reduced.pattern.rows[k] as usize;
                    for at in 0..4 {
                        let expected = entry(2 * p + at / 2, 2 * q + at % 2);
                        prop_assert!((found[4 * k + at] - expected).abs() < 1e-10);
                    }
                }
            }
            // All of it: no entry is missing.
            let norm: f64 = (0..2 * m).flat_map(|j| (0..=j).map(move |i| (i, j))).map(|(i, j)| entry(i, j).abs()).sum();
            let mut columns = vec![];
            reduced.pattern.by_columns(&found, &mut columns);
            prop_assert!((columns.iter().map(|v| v.abs()).sum::<f64>() - norm).abs() < 1e-9);
            // A multiple of the identity in every block is a scalar matrix.
            let scalar: Vec<f64> = values.iter().step_by(4).copied().collect();
            let blocks: Vec<f64> = scalar.iter().flat_map(|&v| [v, 0.0, 0.0, v]).collect();
            reduced.congruence(&blocks, &mut found);
            for (a, b) in reduced.scalar_congruence(&scalar).iter().zip(found.iter().step_by(4)) {
                prop_assert!((a - b).abs() < 1e-12);
            }
        }
    }
}
