//! Galerkin matrices of tensor-product splines on many patches, by sum factorisation.
//!
//! The integrals ∫ Σ_kl C_kl (D_k φ)(D_l ψ) are summed over whole supports, one direction after the other, instead of
//! element by element: every entry of a patch is computed once, in one place, so rows run in parallel without any
//! scattering (Bressan and Takacs 2019, *Sum factorization techniques in isogeometric analysis*,
//! doi:10.1016/j.cma.2019.04.031). The coefficients C are arrays over the quadrature nodes, weights included.

use crate::spline::{basis_on_span, spans};
use rayon::prelude::*;

/// Highest order of derivatives in a form.
pub const MAX_ORDER: usize = 2;

/// Basis functions of one direction at its quadrature nodes, every function on the nodes of its support only.
struct Direction {
    degree: usize,
    nodes: usize,
    /// First node of every function's support and one behind the last.
    support: Vec<[usize; 2]>,
    /// Start of every function's values.
    start: Vec<usize>,
    /// Values of the derivatives of order 0, 1 and 2.
    values: [Vec<f64>; MAX_ORDER + 1],
}

impl Direction {
    /// `nodes` increase and lie inside the spans.
    fn new(knots: &[f64], degree: usize, nodes: &[f64]) -> Self {
        let n = knots.len() - degree - 1;
        let support: Vec<[usize; 2]> = (0..n)
            .map(|a| [knots[a], knots[a + degree + 1]].map(|end| nodes.partition_point(|&t| t < end)))
            .collect();
        let mut start = vec![0];
        for s in &support {
            start.push(start[start.len() - 1] + s[1] - s[0]);
        }
        let mut values: [Vec<f64>; MAX_ORDER + 1] = std::array::from_fn(|_| vec![0.0; start[n]]);
        let mut local = vec![vec![0.0; degree + 1]; MAX_ORDER + 1];
        for span in spans(knots, degree) {
            let [from, to] = [knots[span], knots[span + 1]].map(|end| nodes.partition_point(|&t| t < end));
            for i in from..to {
                derivatives_on_span(knots, degree, span, nodes[i], &mut local);
                for (order, row) in local.iter().enumerate() {
                    for (f, value) in row.iter().enumerate() {
                        let a = span - degree + f;
                        values[order][start[a] + i - support[a][0]] = *value;
                    }
                }
            }
        }
        Self { degree, nodes: nodes.len(), support, start, values }
    }

    fn len(&self) -> usize {
        self.support.len()
    }

    /// Derivative of function `a` on the nodes `from..to` of its support.
    fn values(&self, order: usize, a: usize, [from, to]: [usize; 2]) -> &[f64] {
        let first = self.support[a][0];
        &self.values[order][self.start[a]..][from - first..to - first]
    }

    fn overlap(&self, a: usize, b: usize) -> [usize; 2] {
        let (s, t) = (self.support[a], self.support[b]);
        let from = s[0].max(t[0]);
        [from, s[1].min(t[1]).max(from)]
    }

    /// Functions whose support meets that of `a`, those before `a` left out on demand.
    fn neighbours(&self, a: usize, upper: bool) -> std::ops::Range<usize> {
        let from = if upper { a } else { a.saturating_sub(self.degree) };
        from..(a + self.degree + 1).min(self.len())
    }
}

/// Values, first and second derivatives of the functions that live on a span, at `t` inside it.
fn derivatives_on_span(knots: &[f64], degree: usize, span: usize, t: f64, out: &mut [Vec<f64>]) {
    let [values, first, second] = out else { unreachable!("three orders") };
    basis_on_span(knots, degree, span, t, values, first);
    // A derivative is a difference of derivatives of one degree less, whose knots lack the two end ones.
    let (mut lower, mut slopes) = (vec![0.0; degree], vec![0.0; degree]);
    basis_on_span(&knots[1..knots.len() - 1], degree - 1, span - 1, t, &mut lower, &mut slopes);
    for a in 0..=degree {
        let part = |c: usize, k: usize| slopes[c] / (knots[k] - knots[k - degree]);
        let left = if a > 0 { part(a - 1, span + a) } else { 0.0 };
        let right = if a < degree { part(a, span + a + 1) } else { 0.0 };
        second[a] = degree as f64 * (left - right);
    }
}

/// The spline space on one patch, its quadrature nodes, and the number of every function among all unknowns.
pub struct PatchSpace {
    directions: [Direction; 2],
    indices: Vec<u32>,
}

impl PatchSpace {
    /// `indices` in C order, functions in u slowest; `nodes` increase and lie inside the spans.
    pub fn new(knots: [&[f64]; 2], degrees: [usize; 2], nodes: [&[f64]; 2], indices: Vec<u32>) -> Self {
        let directions = std::array::from_fn(|k| Direction::new(knots[k], degrees[k], nodes[k]));
        Self { directions, indices }
    }

    /// Number of functions along u and v.
    pub fn shape(&self) -> [usize; 2] {
        [self.directions[0].len(), self.directions[1].len()]
    }

    /// Number of nodes along u and v.
    pub fn nodes(&self) -> [usize; 2] {
        [self.directions[0].nodes, self.directions[1].nodes]
    }

    /// Call `visit(first, second)` with the unknowns of every pair of functions that meet, one order of each pair.
    fn for_each_pair(&self, mut visit: impl FnMut(u32, u32, bool)) {
        let [u, v] = &self.directions;
        for a in 0..u.len() {
            for a2 in u.neighbours(a, true) {
                for b in 0..v.len() {
                    for b2 in v.neighbours(b, a == a2) {
                        let first = self.indices[a * v.len() + b];
                        visit(first, self.indices[a2 * v.len() + b2], (a, b) == (a2, b2));
                    }
                }
            }
        }
    }

    /// Entries of function `a` in u with those from `a` on, in the order of `for_each_pair`.
    fn row(&self, a: usize, form: &Form, coefficients: &[f64]) -> Vec<f64> {
        let [u, v] = &self.directions;
        let plane = u.nodes * v.nodes;
        let mut out = vec![];
        let mut sums = vec![0.0; form.channels.len() * v.nodes];
        let mut weighted = vec![0.0; (MAX_ORDER + 1) * v.nodes];
        for a2 in u.neighbours(a, true) {
            let over = u.overlap(a, a2);
            sums.fill(0.0);
            for term in &form.terms {
                let (first, second) = (u.values(term.orders[0], a, over), u.values(term.orders[1], a2, over));
                let into = &mut sums[term.channel * v.nodes..][..v.nodes];
                for (k, i) in (over[0]..over[1]).enumerate() {
                    let factor = first[k] * second[k];
                    let from = &coefficients[term.pair * plane + i * v.nodes..][..v.nodes];
                    into.iter_mut().zip(from).for_each(|(s, c)| *s += factor * c);
                }
            }
            for b in 0..v.len() {
                let support = v.support[b];
                form.weigh(v, b, &sums, &mut weighted);
                for b2 in v.neighbours(b, a == a2) {
                    let over = v.overlap(b, b2);
                    let mut entry = 0.0;
                    for &order in &form.orders {
                        let w = &weighted[order * v.nodes..][over[0] - support[0]..over[1] - support[0]];
                        entry += dot(v.values(order, b2, over), w);
                    }
                    out.push(entry);
                }
            }
        }
        out
    }
}

fn dot(x: &[f64], y: &[f64]) -> f64 {
    x.iter().zip(y).map(|(x, y)| x * y).sum()
}

/// One product of derivatives in a form: what is summed over u, and where to.
struct Term {
    /// Which coefficient array.
    pair: usize,
    /// Orders in u of the two functions.
    orders: [usize; 2],
    channel: usize,
}

/// A symmetric form Σ_kl C_kl (D_k φ)(D_l ψ), sorted by what happens in either direction.
struct Form {
    terms: Vec<Term>,
    /// Orders in v of the two functions, one channel each.
    channels: Vec<[usize; 2]>,
    /// Orders in v of the second function.
    orders: Vec<usize>,
}

impl Form {
    /// `kinds[k]` are the orders in u and v of D_k.
    fn new(kinds: &[[usize; 2]]) -> Self {
        let mut form = Self { terms: vec![], channels: vec![], orders: vec![] };
        let mut pair = 0;
        for (k, first) in kinds.iter().enumerate() {
            for (l, second) in kinds.iter().enumerate().skip(k) {
                form.push(pair, *first, *second);
                if l > k {
                    form.push(pair, *second, *first);
                }
                pair += 1;
            }
        }
        form.orders = form.channels.iter().map(|c| c[1]).collect();
        form.orders.sort_unstable();
        form.orders.dedup();
        form
    }

    fn push(&mut self, pair: usize, first: [usize; 2], second: [usize; 2]) {
        let across = [first[1], second[1]];
        let channel = self.channels.iter().position(|c| *c == across).unwrap_or_else(|| {
            self.channels.push(across);
            self.channels.len() - 1
        });
        self.terms.push(Term { pair, orders: [first[0], second[0]], channel });
    }

    /// `out[order]` = Σ over channels with that second order of the first function's derivative times the sums.
    fn weigh(&self, v: &Direction, b: usize, sums: &[f64], out: &mut [f64]) {
        let [from, to] = v.support[b];
        for &order in &self.orders {
            let into = &mut out[order * v.nodes..][..to - from];
            into.fill(0.0);
            for (channel, c) in self.channels.iter().enumerate().filter(|(_, c)| c[1] == order) {
                let sums = &sums[channel * v.nodes..][from..to];
                let values = v.values(c[0], b, [from, to]);
                into.iter_mut().zip(sums.iter().zip(values)).for_each(|(x, (s, w))| *x += s * w);
            }
        }
    }
}

/// Symmetric matrices over the unknowns of many patches: the pattern, and where every pair of functions goes.
pub struct Galerkin {
    patches: Vec<PatchSpace>,
    offsets: Vec<usize>,
    rows: Vec<usize>,
    /// Per patch and pair: the position among the values.
    targets: Vec<Vec<u32>>,
    /// Per patch: pairs of different functions with one unknown (a patch glued to itself), which count twice.
    doubled: Vec<Vec<u32>>,
}

impl Galerkin {
    /// Find the pattern; `n` is the number of unknowns.
    pub fn new(patches: Vec<PatchSpace>, n: usize) -> Self {
        let mut columns: Vec<Vec<u32>> = vec![vec![]; n];
        for patch in &patches {
            patch.for_each_pair(|f, g, _| columns[f.max(g) as usize].push(f.min(g)));
        }
        columns.par_iter_mut().for_each(|column| {
            column.sort_unstable();
            column.dedup();
        });
        let mut offsets = vec![0];
        for column in &columns {
            offsets.push(offsets[offsets.len() - 1] + column.len());
        }
        let (targets, doubled) = patches
            .par_iter()
            .map(|patch| {
                let (mut targets, mut doubled) = (vec![], vec![]);
                patch.for_each_pair(|f, g, same| {
                    let (row, column) = (f.min(g), f.max(g) as usize);
                    let at = columns[column].binary_search(&row).expect("pair is in the pattern");
                    if f == g && !same {
                        doubled.push(targets.len() as u32);
                    }
                    targets.push((offsets[column] + at) as u32);
                });
                (targets, doubled)
            })
            .unzip();
        let rows = columns.into_iter().flatten().map(|r| r as usize).collect();
        Self { patches, offsets, rows, targets, doubled }
    }

    /// The patches.
    pub fn patches(&self) -> &[PatchSpace] {
        &self.patches
    }

    /// Column offsets and row indices of the upper triangle.
    pub fn pattern(&self) -> (&[usize], &[usize]) {
        (&self.offsets, &self.rows)
    }

    /// Values of the upper triangle of the form Σ_kl C_kl (D_k φ)(D_l ψ).
    ///
    /// `kinds[k]` are the orders in u and v of D_k. `coefficients[patch]` holds C_kl for k <= l, one after the other,
    /// at the nodes in C order.
    pub fn assemble(&self, kinds: &[[usize; 2]], coefficients: &[&[f64]]) -> Vec<f64> {
        let form = Form::new(kinds);
        let tasks: Vec<(usize, usize)> = self
            .patches
            .iter()
            .enumerate()
            .flat_map(|(k, patch)| (0..patch.shape()[0]).map(move |a| (k, a)))
            .collect();
        let rows: Vec<Vec<f64>> =
            tasks.par_iter().map(|&(k, a)| self.patches[k].row(a, &form, coefficients[k])).collect();
        let mut values = vec![0.0; self.rows.len()];
        let mut rows = rows.into_iter();
        for (k, patch) in self.patches.iter().enumerate() {
            let entries = rows.by_ref().take(patch.shape()[0]).flatten();
            let mut doubled = self.doubled[k].iter().peekable();
            for (i, (entry, &target)) in entries.zip(&self.targets[k]).enumerate() {
                let twice = doubled.next_if(|&&d| d as usize == i).is_some();
                values[target as usize] += if twice { 2.0 * entry } else { entry };
            }
        }
        values
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::quadrature::gauss;
    use proptest::prelude::*;

    fn nodes(knots: &[f64], degree: usize, m: usize) -> (Vec<f64>, Vec<f64>) {
        let (x, w) = gauss(m);
        let (mut nodes, mut weights) = (vec![], vec![]);
        for s in spans(knots, degree) {
            let (a, b) = (knots[s], knots[s + 1]);
            nodes.extend(x.iter().map(|x| 0.5 * (a + b + (b - a) * x)));
            weights.extend(w.iter().map(|w| 0.5 * (b - a) * w));
        }
        (nodes, weights)
    }

    fn clamped(degree: usize, steps: &[(f64, usize)]) -> Vec<f64> {
        let (mut knots, mut t) = (vec![0.0; degree + 1], 0.0);
        for (i, &(h, multiplicity)) in steps.iter().enumerate() {
            t += h;
            let last = i + 1 == steps.len();
            knots.extend(std::iter::repeat_n(t, if last { degree + 1 } else { multiplicity.min(degree) }));
        }
        knots
    }

    /// Dense values of every function's derivative at every node.
    fn dense(d: &Direction, order: usize) -> Vec<Vec<f64>> {
        let mut out = vec![vec![0.0; d.nodes]; d.len()];
        for (a, row) in out.iter_mut().enumerate() {
            let [from, to] = d.support[a];
            row[from..to].copy_from_slice(d.values(order, a, [from, to]));
        }
        out
    }

    fn steps() -> impl Strategy<Value = Vec<(f64, usize)>> {
        prop::collection::vec((0.2..2.0_f64, 1usize..4), 1..4)
    }

    proptest! {
        #[test]
        fn agrees_with_the_plain_sum(p in 1usize..5, q in 1usize..4, u in steps(), v in steps(), seed in 0.0..6.0_f64) {
            let (ku, kv) = (clamped(p, &u), clamped(q, &v));
            let ((tu, _), (tv, _)) = (nodes(&ku, p, 3), nodes(&kv, q, 2));
            let count = (ku.len() - p - 1) * (kv.len() - q - 1);
            let patch = PatchSpace::new([&ku, &kv], [p, q], [&tu, &tv], (0..count as u32).collect());
            let kinds = [[2, 0], [1, 1], [0, 1], [0, 0]];
            let plane = tu.len() * tv.len();
            let c: Vec<f64> = (0..10 * plane).map(|i| (seed + 1.7 * i as f64).sin()).collect();
            let tables: Vec<[Vec<Vec<f64>>; 2]> = kinds.iter()
                .map(|k| [dense(&patch.directions[0], k[0]), dense(&patch.directions[1], k[1])]).collect();
            let galerkin = Galerkin::new(vec![patch], count);
            let values = galerkin.assemble(&kinds, &[&c]);
            let n_v = kv.len() - q - 1;
            let (offsets, rows) = galerkin.pattern();
            for column in 0..count {
                for at in offsets[column]..offsets[column + 1] {
                    let row = rows[at];
                    let (mut sum, mut size, mut pair) = (0.0_f64, 0.0_f64, 0);
                    for k in 0..kinds.len() {
                        for l in k..kinds.len() {
                            for i in 0..tu.len() {
                                for j in 0..tv.len() {
                                    let d = |m: usize, f: usize| tables[m][0][f / n_v][i] * tables[m][1][f % n_v][j];
                                    let mut both = d(k, row) * d(l, column);
                                    if l > k { both += d(l, row) * d(k, column); }
                                    sum += both * c[pair * plane + i * tv.len() + j];
                                    size += both.abs();
                                }
                            }
                            pair += 1;
                        }
                    }
                    prop_assert!((values[at] - sum).abs() <= 1e-12 * (1.0 + size), "{} for {}", values[at], sum);
                }
            }
        }

        #[test]
        fn second_derivatives_are_slopes_of_the_first(p in 1usize..6, u in steps(), x in 0.05..0.95_f64) {
            let knots = clamped(p, &u);
            let h = 1e-6;
            for span in spans(&knots, p) {
                let t = knots[span] + x * (knots[span + 1] - knots[span]);
                let at = |t: f64| {
                    let mut out = vec![vec![0.0; p + 1]; 3];
                    derivatives_on_span(&knots, p, span, t, &mut out);
                    out
                };
                let (middle, before, after) = (at(t), at(t - h), at(t + h));
                for a in 0..=p {
                    let slope = (after[1][a] - before[1][a]) / (2.0 * h);
                    prop_assert!((slope - middle[2][a]).abs() < 1e-4 * (1.0 + slope.abs()));
                }
            }
        }
    }

    /// A patch glued to itself: the mass matrix still sums to the area.
    #[test]
    fn pairs_with_one_unknown_count_twice() {
        let knots = clamped(2, &[(0.5, 1), (0.5, 1)]);
        let (t, w) = nodes(&knots, 2, 3);
        let n = knots.len() - 3;
        let indices = (0..n * n).map(|k| ((k / n) % (n - 1) * n + k % n) as u32).collect();
        let patch = PatchSpace::new([&knots, &knots], [2, 2], [&t, &t], indices);
        let weights: Vec<f64> = w.iter().flat_map(|x| w.iter().map(move |y| x * y)).collect();
        let galerkin = Galerkin::new(vec![patch], n * (n - 1));
        let values = galerkin.assemble(&[[0, 0]], &[&weights]);
        let (offsets, rows) = galerkin.pattern();
        let mut sum = 0.0;
        for column in 0..offsets.len() - 1 {
            for at in offsets[column]..offsets[column + 1] {
                sum += if rows[at] == column { values[at] } else { 2.0 * values[at] };
            }
        }
        assert!((sum - 1.0).abs() < 1e-14, "{sum}");
    }
}
