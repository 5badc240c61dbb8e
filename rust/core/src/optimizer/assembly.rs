//! Where strips' matrices go: the sparsity of the Hessian over the free points.

use crate::numeric::sparse::NOWHERE;
use crate::optimizer::blocks::BlockPattern;
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
    /// Per point s the free points r ≤ s it shares a span with.
    pub pattern: BlockPattern,
    /// Per strip, in the order of [`Buffers::rows`]: index among the rows of the pattern's column.
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

/// The free points that share spans, from the free index of every strip's functions.
fn pattern_of(elements: &Elements, local: &[Vec<u32>], n: usize) -> BlockPattern {
    let for_each = |visit: &mut dyn FnMut(u32, u32)| {
        (0..n as u32).for_each(|s| visit(s, s));
        for (s, local) in local.iter().enumerate() {
            for_each_pair(elements, s, |f, g, _| {
                let (r, s) = (local[f].min(local[g]), local[f].max(local[g]));
                if s != NOWHERE {
                    visit(r, s);
                }
            });
        }
    };
    // Counted first, as lists that grow would take several times the memory.
    let mut starts = vec![0; n + 1];
    for_each(&mut |_, s| starts[s as usize + 1] += 1);
    (0..n).for_each(|s| starts[s + 1] += starts[s]);
    let (mut all, mut next) = (vec![0; starts[n]], starts.clone());
    for_each(&mut |r, s| {
        all[next[s as usize]] = r;
        next[s as usize] += 1;
    });
    let (mut columns, mut rows) = (vec![0], vec![]);
    for s in 0..n {
        let list = &mut all[starts[s]..starts[s + 1]];
        list.sort_unstable();
        rows.extend(list.chunk_by(|a, b| a == b).map(|same| same[0]));
        columns.push(rows.len());
    }
    rows.shrink_to_fit();
    BlockPattern { columns, rows }
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
        let pattern = pattern_of(elements, &local, n);
        let targets = local.iter().enumerate().map(|(s, local)| {
            let (strip, nodes) = (&elements.strips[s], &elements.nodes[s]);
            let (u, v) = (&elements.axes[nodes.u], &elements.axes[nodes.v]);
            let mut out = vec![NOWHERE; strip.shape[1] * v.n * strip.shape[0] * (2 * u.n - 1)];
            for_each_pair(elements, s, |f, g, place| {
                let (r, s) = (local[f].min(local[g]), local[f].max(local[g]));
                if s != NOWHERE {
                    let list = &pattern.rows[pattern.columns[s as usize]..pattern.columns[s as usize + 1]];
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
        Self { free_of, pattern, targets, free: local }
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

    /// Add a strip's matrix to the values of the blocks.
    pub fn scatter(&self, s: usize, elements: &Elements, buffers: &Buffers, values: &mut [f64]) {
        self.for_each_target(s, &elements.strips[s], elements, |place, column, at, kind| {
            let block: &[f64; 4] = buffers.rows[4 * place..].first_chunk().expect("four components");
            let [xx, mut xy, mut yx, yy] = *block;
            let first = 4 * (self.pattern.columns[column as usize] + at as usize);
            let to: &mut [f64; 4] = values[first..].first_chunk_mut().expect("four values a block");
            let mut twice = 1.0;
            if kind == Kind::Swapped as u32 {
                (xy, yx) = (yx, xy);
            } else if kind == Kind::Glued as u32 {
                (xy, yx, twice) = (xy + yx, xy + yx, 2.0);
            }
            *to = [to[0] + twice * xx, to[1] + xy, to[2] + yx, to[3] + twice * yy];
        });
    }

    /// Add a strip's scalar matrix to the values, one for every block.
    pub fn scatter_scalar(&self, s: usize, elements: &Elements, buffers: &Buffers, values: &mut [f64]) {
        self.for_each_target(s, &elements.strips[s], elements, |place, column, at, kind| {
            let twice = if kind == Kind::Glued as u32 { 2.0 } else { 1.0 };
            values[self.pattern.columns[column as usize] + at as usize] += twice * buffers.rows[place];
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
