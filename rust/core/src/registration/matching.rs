//! Monotone matching of two closed sequences by dynamic programming.
//!
//! Nodes of the source in order are matched to nodes of the target in order; a path goes once round both. Corners
//! that a step passes over, on either side, cost their salience; so insertions and deletions are allowed.
//!
//! Every step advances on the source, so that a row of the table of path costs depends on the rows before it only and
//! is worked out many nodes at a time. Starts are compared in single precision, what they share made once.

use crate::numeric::lanes::{Vectorizable, vectorized};
use rayon::prelude::*;
use std::ops::{Add, Mul, Sub};

/// Steps in source and target nodes: coprime, so that every slope occurs once.
const STEPS: [(usize, usize); 23] = [
    (1, 1),
    (1, 2),
    (2, 1),
    (1, 3),
    (3, 1),
    (2, 3),
    (3, 2),
    (1, 4),
    (4, 1),
    (3, 4),
    (4, 3),
    (1, 5),
    (5, 1),
    (2, 5),
    (5, 2),
    (3, 5),
    (5, 3),
    (4, 5),
    (5, 4),
    (1, 6),
    (6, 1),
    (5, 6),
    (6, 5),
];

/// The longest step on the source.
const LONGEST: usize = 6;

/// Stands for an infinite cost of passing over a node.
const FORBIDDEN: f64 = 1e6;

/// Costs in single precision that differ by less than this, relatively and absolutely, are compared in double: far above
/// the rounding of some hundred sums.
const CLOSE: (f64, f64) = (1e-4, 1e-6);

/// A scan gives a thread this many starts at least: waking it takes as long as one or two.
const STARTS_A_THREAD: usize = 16;

/// What a matching costs. Positions have one entry more than nodes: the first node a full turn later.
pub struct MatchingProblem<'a> {
    /// Increasing positions of the source's nodes, from 0 to 1.
    pub source: &'a [f64],
    /// Increasing positions of the target's nodes, from 0 to 1.
    pub target: &'a [f64],
    /// Row-major costs of matching nodes for each unit of length.
    pub cost: &'a [f64],
    /// Row-major costs of matching nodes that are counted once: corners, forbidden pairs (infinite).
    pub point_cost: &'a [f64],
    /// Costs of passing over each source node.
    pub source_skip: &'a [f64],
    /// Costs of passing over each target node.
    pub target_skip: &'a [f64],
    /// Weight of the stretch (r - 1)²/r, r the ratio of lengths, for each unit of length.
    pub stretch: f64,
    /// How far, in parts of the loop, a path may stray from equal positions.
    pub band: f64,
}

/// The precision of path costs.
trait Number: Copy + PartialOrd + Send + Sync + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> {
    const INFINITE: Self;
    fn of(x: f64) -> Self;
}

impl Number for f32 {
    const INFINITE: Self = Self::INFINITY;
    #[inline(always)]
    fn of(x: f64) -> Self {
        x as Self
    }
}

impl Number for f64 {
    const INFINITE: Self = Self::INFINITY;
    #[inline(always)]
    fn of(x: f64) -> Self {
        x
    }
}

/// What steps that end at a target node cost whatever the source's nodes.
struct TargetStep<T> {
    length: Vec<T>,
    /// One over the length.
    inverse: Vec<T>,
    skipped: Vec<T>,
}

/// Costs along the target from some node on, for one or several starts.
struct Tables<T> {
    /// Positions, counted on past a turn.
    at: Vec<f64>,
    /// Of every step, indexed by its last node.
    steps: Vec<TargetStep<T>>,
    /// Row-major, one row a source node.
    cost: Vec<T>,
    point_cost: Vec<T>,
    /// Costs of passing over all source nodes before each.
    source_passed: Vec<f64>,
}

/// Costs of the cheapest paths to pairs of nodes, and where in each row they are finite.
struct Paths<T> {
    best: Vec<T>,
    /// First node and the one after the last.
    finite: Vec<[usize; 2]>,
    total: T,
}

/// Paths to find, compiled for the vector units at hand.
struct Rows<'a, T> {
    problem: &'a MatchingProblem<'a>,
    tables: &'a Tables<T>,
    start: usize,
    depth: usize,
}

impl<T: Number> Vectorizable for Rows<'_, T> {
    type Output = Paths<T>;

    // Nothing is fused, so that every machine finds the same bits.
    #[inline(always)]
    fn run<const FUSED: bool>(self) -> Paths<T> {
        self.problem.all_rows(self.tables, self.start, self.depth)
    }
}

/// One step's costs: those of the source's part, and the weight of stretch over its length.
struct SourceStep<T> {
    length: T,
    stretch: T,
    skipped: T,
}

impl<T: Number> SourceStep<T> {
    /// Cost of a path whose cost before the step is given.
    #[inline(always)]
    fn total(&self, before: T, costs: T, length: T, inverse: T, skipped: T) -> T {
        let change = length - self.length;
        let density = T::of(0.25) * costs + change * change * (self.stretch * inverse);
        before + (self.skipped + skipped) + (self.length + length) * density
    }
}

/// Sums of the costs of passing over the nodes before each.
fn passed(skip: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut sums = vec![0.0];
    // Large, but finite: differences of sums must stay numbers.
    sums.extend(skip.scan(0.0, |sum, x| {
        *sum += x.min(FORBIDDEN);
        Some(*sum)
    }));
    sums
}

impl MatchingProblem<'_> {
    fn size(&self) -> (usize, usize) {
        (self.source.len() - 1, self.target.len() - 1)
    }

    /// Cheapest path from (source node 0, target node `start`) once round, and its cost: pairs of node numbers, the
    /// target's counted on past a turn. The last pair closes the loop. None when every path is forbidden.
    pub fn solve(&self, start: usize) -> Option<(f64, Vec<[usize; 2]>)> {
        let ((n, m), tables) = (self.size(), self.tables::<f64>(start, self.target.len()));
        let paths = self.paths(&tables, 0, n + 1);
        if paths.total >= FORBIDDEN {
            return None;
        }
        let (mut i, mut j) = (n, m);
        let mut path = vec![[i, start + j]];
        while i > 0 {
            let (a, b) = self.last_step(&tables, &paths, i, j);
            (i, j) = (i - a, j - b);
            path.push([i, start + j]);
        }
        path.reverse();
        Some((paths.total, path))
    }

    /// The cheapest of the paths from several starts, the first of equally cheap ones; see [`Self::solve`].
    pub fn solve_best(&self, starts: &[usize]) -> Option<(f64, Vec<[usize; 2]>)> {
        let costs = if starts.len() > 1 { self.costs(starts) } else { vec![0.0; starts.len()] };
        let least = costs.iter().copied().fold(f64::INFINITY, f64::min);
        let mut best: Option<(f64, Vec<[usize; 2]>)> = None;
        for (&start, cost) in starts.iter().zip(costs) {
            if cost <= least * (1.0 + CLOSE.0) + CLOSE.1
                && let Some(found) = self.solve(start)
                && best.as_ref().is_none_or(|best| found.0 < best.0)
            {
                best = Some(found);
            }
        }
        best
    }

    /// Cost of the cheapest path from every one of the `starts`, in single precision; infinite where all are forbidden.
    pub fn scan(&self, starts: &[usize]) -> Vec<f64> {
        starts.par_chunks(STARTS_A_THREAD).flat_map_iter(|part| self.costs(part)).collect()
    }

    fn costs(&self, starts: &[usize]) -> Vec<f64> {
        let tables = self.tables::<f32>(0, 2 * self.size().1);
        let cost = |&start| f64::from(self.paths(&tables, start, LONGEST + 1).total);
        starts.iter().map(cost).map(|cost| if cost >= FORBIDDEN { f64::INFINITY } else { cost }).collect()
    }

    /// Tables of `width` target nodes from `first` on.
    fn tables<T: Number>(&self, first: usize, width: usize) -> Tables<T> {
        let (n, m) = self.size();
        let at: Vec<f64> =
            (first..first + width).map(|j| self.target[j % m] + (j / m) as f64).collect();
        let sums = passed((first..first + width).map(|j| self.target_skip[j % m]));
        let step = |&(_, b): &(usize, usize)| {
            let length = |j: usize| if j < b { 1.0 } else { at[j] - at[j - b] };
            TargetStep {
                length: (0..width).map(|j| T::of(length(j))).collect(),
                inverse: (0..width).map(|j| T::of(1.0 / length(j))).collect(),
                skipped: (0..width).map(|j| T::of(if j < b { 0.0 } else { sums[j] - sums[j - b + 1] })).collect(),
            }
        };
        let unrolled = |values: &[f64]| {
            let mut out = Vec::with_capacity(n * width);
            for row in values.chunks_exact(m) {
                out.extend((first..first + width).map(|j| T::of(row[j % m])));
            }
            out
        };
        Tables {
            steps: STEPS.iter().map(step).collect(),
            cost: unrolled(self.cost),
            point_cost: unrolled(self.point_cost),
            source_passed: passed((0..=n).map(|i| self.source_skip[i % n])),
            at,
        }
    }

    /// The source's part of a step to node `i`.
    #[inline(always)]
    fn source_step<T: Number>(&self, tables: &Tables<T>, i: usize, a: usize) -> SourceStep<T> {
        let length = self.source[i] - self.source[i - a];
        SourceStep {
            length: T::of(length),
            stretch: T::of(0.5 * self.stretch / length),
            skipped: T::of(tables.source_passed[i] - tables.source_passed[i - a + 1]),
        }
    }

    /// Paths from a start, given as an index into the tables. The last `depth` rows are kept.
    fn paths<T: Number>(&self, tables: &Tables<T>, start: usize, depth: usize) -> Paths<T> {
        vectorized(Rows { problem: self, tables, start, depth })
    }

    #[inline(always)]
    fn all_rows<T: Number>(&self, tables: &Tables<T>, start: usize, depth: usize) -> Paths<T> {
        let ((n, m), width) = (self.size(), tables.at.len());
        let mut paths = Paths { best: vec![T::INFINITE; depth * (m + 1)], finite: vec![[0, 1]], total: T::INFINITE };
        paths.best[0] = tables.point_cost[start];
        let mut row = vec![T::INFINITE; m + 1];
        for i in 1..=n {
            let [low, high] = self.within_band(&tables.at[start..], i);
            row.fill(T::INFINITE);
            for (&(a, b), step) in STEPS.iter().zip(&tables.steps) {
                if a > i {
                    continue;
                }
                let [from, to] = paths.finite[i - a];
                let (from, to) = (low.max(from + b), high.min(to + b));
                if from >= to {
                    continue;
                }
                let source = self.source_step(tables, i, a);
                let (size, at) = (to - from, start + from);
                let before = &paths.best[(i - a) % depth * (m + 1) + from - b..][..size];
                let here = &tables.cost[i % n * width + at..][..size];
                let there = &tables.cost[(i - a) % n * width + at - b..][..size];
                let (length, inverse) = (&step.length[at..][..size], &step.inverse[at..][..size]);
                let (skipped, out) = (&step.skipped[at..][..size], &mut row[from..to]);
                for j in 0..size {
                    let total = source.total(before[j], here[j] + there[j], length[j], inverse[j], skipped[j]);
                    out[j] = if total < out[j] { total } else { out[j] };
                }
            }
            if i < n {
                let point = &tables.point_cost[i * width + start..];
                (low..high).for_each(|j| row[j] = row[j] + point[j]);
            }
            let mut finite = [low, high];
            while finite[0] < finite[1] && row[finite[0]] >= T::of(FORBIDDEN) {
                finite[0] += 1;
            }
            while finite[0] < finite[1] && row[finite[1] - 1] >= T::of(FORBIDDEN) {
                finite[1] -= 1;
            }
            paths.finite.push(finite);
            paths.best[i % depth * (m + 1)..][..=m].copy_from_slice(&row);
        }
        paths.total = row[m];
        paths
    }

    /// Target nodes, numbered from the start with positions `at`, that source node `i` may be matched to: the first one
    /// and the one after the last.
    fn within_band(&self, at: &[f64], i: usize) -> [usize; 2] {
        let (n, m) = self.size();
        // Only the closing pair may meet the first source node again.
        if i == n {
            return [m, m + 1];
        }
        let low = at[..m].partition_point(|t| t - at[0] < self.source[i] - self.band).max(1);
        let high = at[..m].partition_point(|t| t - at[0] <= self.source[i] + self.band);
        [low, high.max(low)]
    }

    /// The last step of the cheapest path to a pair of nodes.
    fn last_step(&self, tables: &Tables<f64>, paths: &Paths<f64>, i: usize, j: usize) -> (usize, usize) {
        let ((n, m), width) = (self.size(), tables.at.len());
        let (mut low, mut last) = (f64::INFINITY, STEPS[0]);
        for (&(a, b), step) in STEPS.iter().zip(&tables.steps) {
            if a > i || b > j || !(paths.finite[i - a][0]..paths.finite[i - a][1]).contains(&(j - b)) {
                continue;
            }
            let costs = tables.cost[i % n * width + j] + tables.cost[(i - a) % n * width + j - b];
            let total = self.source_step(tables, i, a).total(
                paths.best[(i - a) * (m + 1) + j - b],
                costs,
                step.length[j],
                step.inverse[j],
                step.skipped[j],
            );
            if total < low {
                (low, last) = (total, (a, b));
            }
        }
        last
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[derive(Debug)]
    struct Data {
        source: Vec<f64>,
        target: Vec<f64>,
        cost: Vec<f64>,
        skip: [Vec<f64>; 2],
    }

    impl Data {
        fn problem<'a>(&'a self, zero: &'a [f64]) -> MatchingProblem<'a> {
            MatchingProblem {
                source: &self.source,
                target: &self.target,
                cost: &self.cost,
                point_cost: zero,
                source_skip: &self.skip[0],
                target_skip: &self.skip[1],
                stretch: 0.1,
                band: 1.0,
            }
        }
    }

    fn positions(gaps: &[f64]) -> Vec<f64> {
        let total: f64 = gaps.iter().sum();
        let mut at = vec![0.0];
        for gap in gaps {
            at.push(at[at.len() - 1] + gap / total);
        }
        at
    }

    fn data() -> impl Strategy<Value = Data> {
        (3usize..6, 3usize..6).prop_flat_map(|(n, m)| {
            let numbers = |k| prop::collection::vec(0.1..1.0, k);
            (numbers(n), numbers(m), numbers(n * m), numbers(n), numbers(m)).prop_map(|(a, b, cost, s, t)| {
                Data { source: positions(&a), target: positions(&b), cost, skip: [s, t] }
            })
        })
    }

    /// Cost of a path, added up pair by pair.
    fn price(p: &MatchingProblem<'_>, path: &[[usize; 2]]) -> f64 {
        let (n, m) = p.size();
        let (at_s, at_t) =
            (|i: usize| p.source[i % n] + (i / n) as f64, |j: usize| p.target[j % m] + (j / m) as f64);
        let node = |[i, j]: [usize; 2]| (i % n) * m + j % m;
        let step = |w: &[[usize; 2]]| {
            let (ds, dt) = (at_s(w[1][0]) - at_s(w[0][0]), at_t(w[1][1]) - at_t(w[0][1]));
            let passed = (w[0][0] + 1..w[1][0]).map(|i| p.source_skip[i % n]).sum::<f64>()
                + (w[0][1] + 1..w[1][1]).map(|j| p.target_skip[j % m]).sum::<f64>();
            (p.cost[node(w[0])] + p.cost[node(w[1])]) * (ds + dt) / 4.0
                + p.stretch * (dt / ds - 1.0).powi(2) / (dt / ds) * (ds + dt) / 2.0
                + passed
        };
        path.windows(2).map(step).sum()
    }

    /// The cheapest continuation of a path to the pair `end`, by trying all.
    fn cheapest(p: &MatchingProblem<'_>, path: &mut Vec<[usize; 2]>, end: [usize; 2]) -> f64 {
        let last = path[path.len() - 1];
        if last == end {
            return price(p, path);
        }
        let mut best = f64::INFINITY;
        for (a, b) in STEPS {
            let next = [last[0] + a, last[1] + b];
            if next == end || (next[0] < end[0] && next[1] < end[1]) {
                path.push(next);
                best = best.min(cheapest(p, path, end));
                path.pop();
            }
        }
        best
    }

    proptest! {
        #[test]
        fn no_path_is_cheaper(data in data(), start in 0usize..3) {
            let zero = vec![0.0; data.cost.len()];
            let problem = data.problem(&zero);
            let (n, m) = problem.size();
            let (cost, path) = problem.solve(start).expect("nothing is forbidden");
            prop_assert_eq!(path[0], [0, start]);
            prop_assert_eq!(path[path.len() - 1], [n, start + m]);
            prop_assert!((price(&problem, &path) - cost).abs() < 1e-12);
            prop_assert!((cheapest(&problem, &mut vec![[0, start]], [n, start + m]) - cost).abs() < 1e-12);
            prop_assert!((problem.scan(&[start])[0] - cost).abs() < 1e-5 * (1.0 + cost));
            let starts = [0, 1, 2];
            let all = starts.map(|start| problem.solve(start).expect("nothing is forbidden"));
            let best = all.iter().map(|(cost, _)| *cost).fold(f64::INFINITY, f64::min);
            prop_assert_eq!(problem.solve_best(&starts), all.into_iter().find(|(cost, _)| *cost == best));
        }

        #[test]
        fn fixed_pairs_are_kept(data in data(), i in 1usize..3, j in 1usize..3) {
            let (n, m) = (data.source.len() - 1, data.target.len() - 1);
            let mut point = vec![0.0; n * m];
            (0..n).for_each(|k| point[k * m + j] = f64::INFINITY);
            (0..m).for_each(|k| point[i * m + k] = f64::INFINITY);
            point[i * m + j] = 0.0;
            let mut data = data;
            data.skip[0][i] = f64::INFINITY;
            data.skip[1][j] = f64::INFINITY;
            if let Some((_, path)) = data.problem(&point).solve(0) {
                prop_assert!(path.contains(&[i, j]));
            } else {
                // Steps pass no more than five nodes, and the ratio of nodes is that of a step.
                prop_assert!(i != j || n != m);
            }
        }
    }
}
