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

/// The longest step, on either side.
const LONGEST: usize = 6;

/// Stands for an infinite cost of passing over a node.
const FORBIDDEN: f64 = 1e6;

/// Costs in single precision that differ by less than this, relatively and absolutely, are compared in double: far above
/// the rounding of some hundred sums.
const CLOSE: (f64, f64) = (1e-4, 1e-6);

/// A scan gives a thread this many starts at least: waking it takes as long as a few of them.
const STARTS_A_THREAD: usize = 16;

/// Target nodes that are worked out together: a few vectors, so that sums of one need not wait for those of another.
const BLOCK: usize = 16;

/// What a matching costs but for how unlike nodes are. Positions have one entry more than nodes: the first node a full
/// turn later.
pub struct MatchingProblem {
    /// Increasing positions of the source's nodes, from 0 to 1.
    pub source: Vec<f64>,
    /// Increasing positions of the target's nodes, from 0 to 1.
    pub target: Vec<f64>,
    /// Row-major costs of matching nodes that are counted once: corners, forbidden pairs (infinite).
    pub point_cost: Vec<f64>,
    /// Costs of passing over each source node.
    pub source_skip: Vec<f64>,
    /// Costs of passing over each target node.
    pub target_skip: Vec<f64>,
    /// Weight of the stretch (r - 1)²/r, r the ratio of lengths, for each unit of length.
    pub stretch: f64,
    /// How far, in parts of the loop, a path may stray from equal positions.
    pub band: f64,
}

/// A problem with what all its matchings share.
pub struct Matcher {
    problem: MatchingProblem,
    /// Costs of passing over all source nodes before each.
    source_passed: Vec<f64>,
    /// Target nodes from [`LONGEST`] before the first to a block after the second turn: every start finds its turn here.
    nodes: Vec<usize>,
    /// Their positions, counted on past a turn.
    at: Vec<f64>,
    single: [TargetStep<f32>; STEPS.len()],
    double: [TargetStep<f64>; STEPS.len()],
}

/// The precision of path costs.
trait Number:
    Copy + PartialOrd + Send + Sync + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + 'static
{
    const INFINITE: Self;
    fn of(x: f64) -> Self;
    fn steps(matcher: &Matcher) -> &[TargetStep<Self>];
}

impl Number for f32 {
    const INFINITE: Self = Self::INFINITY;
    #[inline(always)]
    fn of(x: f64) -> Self {
        x as Self
    }
    #[inline(always)]
    fn steps(matcher: &Matcher) -> &[TargetStep<Self>] {
        &matcher.single
    }
}

impl Number for f64 {
    const INFINITE: Self = Self::INFINITY;
    #[inline(always)]
    fn of(x: f64) -> Self {
        x
    }
    #[inline(always)]
    fn steps(matcher: &Matcher) -> &[TargetStep<Self>] {
        &matcher.double
    }
}

/// What a kind of step costs by the target alone, indexed by its last node as in [`Matcher::nodes`].
struct TargetStep<T> {
    length: Vec<T>,
    /// One over the length.
    inverse: Vec<T>,
    skipped: Vec<T>,
}

impl<T: Number> TargetStep<T> {
    fn new(at: &[f64], passed: &[f64], b: usize) -> Self {
        // The first nodes end no step.
        let length = |j: usize| if j < b { 1.0 } else { at[j] - at[j - b] };
        Self {
            length: (0..at.len()).map(|j| T::of(length(j))).collect(),
            inverse: (0..at.len()).map(|j| T::of(1.0 / length(j))).collect(),
            skipped: (0..at.len())
                .map(|j| T::of(if j < b { 0.0 } else { passed[j] - passed[j - b + 1] }))
                .collect(),
        }
    }
}

/// What a kind of step costs by the source alone, and the weight of stretch over its length.
#[derive(Clone, Copy)]
struct SourceStep<T> {
    length: T,
    stretch: T,
    skipped: T,
}

impl<T: Number> SourceStep<T> {
    /// Cost of a path whose cost before the step is given; `costs` are
    /// quarters of those of both node pairs.
    #[inline(always)]
    fn total(&self, before: T, costs: T, length: T, inverse: T, skipped: T) -> T {
        let change = length - self.length;
        let density = costs + change * change * (self.stretch * inverse);
        before + (self.skipped + skipped) + (self.length + length) * density
    }
}

/// Costs of the cheapest paths to pairs of nodes. Rows have [`LONGEST`] infinite entries before the first node and a
/// block of them after the last, so that steps need no check.
struct Paths<T> {
    best: Vec<T>,
    total: T,
}

/// Paths to find, compiled for the vector units at hand.
struct Rows<'a, T> {
    matcher: &'a Matcher,
    /// See [`Matcher::unrolled`].
    cost: &'a [T],
    start: usize,
    depth: usize,
    limit: T,
}

impl<T: Number> Vectorizable for Rows<'_, T> {
    type Output = Paths<T>;

    // Nothing is fused, so that every machine finds the same bits.
    #[inline(always)]
    fn run<const FUSED: bool>(self) -> Paths<T> {
        self.matcher.all_rows(self.cost, self.start, self.depth, self.limit)
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

/// A block of entries from `first` on.
#[inline(always)]
fn block<T>(values: &[T], first: usize) -> &[T; BLOCK] {
    values[first..].first_chunk().expect("rows are padded")
}

impl Matcher {
    /// Prepare a problem.
    pub fn new(problem: MatchingProblem) -> Self {
        let (n, m) = (problem.source.len() - 1, problem.target.len() - 1);
        // So many turns before the first that no node has a negative number.
        let turns = LONGEST.div_ceil(m);
        let numbers = || turns * m - LONGEST..(turns + 2) * m + BLOCK;
        let at: Vec<f64> = numbers().map(|k| problem.target[k % m] + (k / m) as f64 - turns as f64).collect();
        let sums = passed(numbers().map(|k| problem.target_skip[k % m]));
        Self {
            source_passed: passed((0..=n).map(|i| problem.source_skip[i % n])),
            nodes: numbers().map(|k| k % m).collect(),
            single: STEPS.map(|(_, b)| TargetStep::new(&at, &sums, b)),
            double: STEPS.map(|(_, b)| TargetStep::new(&at, &sums, b)),
            at,
            problem,
        }
    }

    /// Numbers of source and target nodes.
    pub fn size(&self) -> (usize, usize) {
        (self.problem.source.len() - 1, self.problem.target.len() - 1)
    }

    /// The cheapest path from source node 0 and any of the target nodes `starts` once round, the first of equally cheap
    /// ones, and its cost: pairs of node numbers, the target's counted on past a turn. The last pair closes the loop.
    /// None when every path is forbidden. `cost` has row-major costs of matching nodes for each unit of length.
    pub fn solve(&self, cost: &[f64], starts: &[usize]) -> Option<(f64, Vec<[usize; 2]>)> {
        let (rough, limit) = self.compared(cost, starts);
        let cost = self.unrolled::<f64>(cost);
        let mut best: Option<(f64, Vec<[usize; 2]>)> = None;
        for (&start, rough) in starts.iter().zip(rough) {
            if rough <= limit
                && let Some(found) = self.solve_from(&cost, start, limit)
                && best.as_ref().is_none_or(|best| found.0 < best.0)
            {
                best = Some(found);
            }
        }
        best
    }

    /// Cost of the cheapest path from every one of the `starts`, in single precision; infinite where all are forbidden.
    pub fn scan(&self, cost: &[f64], starts: &[usize]) -> Vec<f64> {
        let cost = self.unrolled(cost);
        starts.par_chunks(STARTS_A_THREAD).flat_map_iter(|part| self.costs(&cost, part)).collect()
    }

    /// Costs from the starts in single precision, where they may be the least ones, and what the least cost in double
    /// precision cannot exceed.
    fn compared(&self, cost: &[f64], starts: &[usize]) -> (Vec<f64>, f64) {
        let (mut found, mut limit) = (vec![0.0; starts.len()], FORBIDDEN);
        if starts.len() > 1 {
            let cost = self.unrolled(cost);
            let middle = starts.len() / 2;
            let mut order: Vec<usize> = (0..starts.len()).collect();
            // The best of neighbours is likely the middle one: most paths from the others end early then.
            order.sort_by_key(|k| k.abs_diff(middle));
            for k in order {
                found[k] = f64::from(self.paths(&cost, starts[k], LONGEST + 1, limit as f32).total);
                limit = limit.min(found[k] * (1.0 + CLOSE.0) + CLOSE.1);
            }
        }
        (found, limit)
    }

    fn costs(&self, cost: &[f32], starts: &[usize]) -> Vec<f64> {
        let total = |&start| f64::from(self.paths(cost, start, LONGEST + 1, FORBIDDEN as f32).total);
        starts.iter().map(total).map(|cost| if cost >= FORBIDDEN { f64::INFINITY } else { cost }).collect()
    }

    /// Quarters of the costs, with a column for each of the nodes.
    fn unrolled<T: Number>(&self, cost: &[f64]) -> Vec<T> {
        let (n, m) = self.size();
        assert_eq!(cost.len(), n * m, "one cost a pair of nodes");
        let mut out = Vec::with_capacity(n * self.nodes.len());
        for row in cost.chunks_exact(m) {
            out.extend(self.nodes.iter().map(|&j| T::of(0.25 * row[j])));
        }
        out
    }

    /// The cheapest path from a start, if it costs less than `limit`.
    fn solve_from(&self, cost: &[f64], start: usize, limit: f64) -> Option<(f64, Vec<[usize; 2]>)> {
        let (n, m) = self.size();
        let paths = self.paths(cost, start, n + 1, limit);
        if paths.total >= limit {
            return None;
        }
        let (mut i, mut j) = (n, m);
        let mut path = vec![[i, start + j]];
        while i > 0 {
            let (a, b) = self.last_step(cost, &paths, start, i, j);
            (i, j) = (i - a, j - b);
            path.push([i, start + j]);
        }
        path.reverse();
        Some((paths.total, path))
    }

    /// The source's part of a step to node `i`.
    #[inline(always)]
    fn source_step<T: Number>(&self, i: usize, a: usize) -> SourceStep<T> {
        let length = self.problem.source[i] - self.problem.source[i - a];
        SourceStep {
            length: T::of(length),
            stretch: T::of(0.5 * self.problem.stretch / length),
            skipped: T::of(self.source_passed[i] - self.source_passed[i - a + 1]),
        }
    }

    /// Paths from a start that cost less than `limit`; nothing costs less than 0, so that none of these comes from one
    /// that does not. The last `depth` rows are kept.
    fn paths<T: Number>(&self, cost: &[T], start: usize, depth: usize, limit: T) -> Paths<T> {
        vectorized(Rows { matcher: self, cost, start, depth, limit })
    }

    #[inline(always)]
    fn all_rows<T: Number>(&self, cost: &[T], start: usize, depth: usize, limit: T) -> Paths<T> {
        let (n, m) = self.size();
        let (columns, stride) = (self.nodes.len(), row_length(m));
        let point = |i: usize, j: usize| T::of(self.problem.point_cost[i * m + self.nodes[start + j]]);
        let mut paths = Paths { best: vec![T::INFINITE; depth * stride], total: T::INFINITE };
        paths.best[LONGEST] = point(0, LONGEST);
        // Where rows are finite, as entries: the first one and the one after the last.
        let mut finite = vec![[LONGEST, LONGEST + 1]];
        let mut row = vec![T::INFINITE; stride];
        for i in 1..=n {
            let [low, high] = self.within_band(start, i);
            row.fill(T::INFINITE);
            let steps: [SourceStep<T>; STEPS.len()] =
                std::array::from_fn(|k| self.source_step(i, STEPS[k].0.min(i)));
            for first in (low..high).step_by(BLOCK) {
                let mut least = [T::INFINITE; BLOCK];
                let here = block(cost, i % n * columns + start + first);
                for ((&(a, b), source), step) in STEPS.iter().zip(&steps).zip(T::steps(self)) {
                    if a > i || finite[i - a][0] + b >= first + BLOCK || finite[i - a][1] + b <= first {
                        continue;
                    }
                    let before = block(&paths.best, (i - a) % depth * stride + first - b);
                    let there = block(cost, (i - a) * columns + start + first - b);
                    let [length, inverse, skipped] = [&step.length, &step.inverse, &step.skipped]
                        .map(|values| block(values, start + first));
                    for j in 0..BLOCK {
                        let total =
                            source.total(before[j], here[j] + there[j], length[j], inverse[j], skipped[j]);
                        least[j] = if total < least[j] { total } else { least[j] };
                    }
                }
                row[first..][..BLOCK].copy_from_slice(&least);
            }
            row[high..].fill(T::INFINITE);
            if i < n {
                (low..high).for_each(|j| row[j] = row[j] + point(i, j));
            }
            let allowed = |j: &usize| row[*j] < limit;
            let from = (low..high).find(allowed).unwrap_or(high);
            finite.push([from, (from..high).rfind(allowed).map_or(from, |j| j + 1)]);
            paths.best[i % depth * stride..][..stride].copy_from_slice(&row);
        }
        paths.total = row[LONGEST + m];
        paths
    }

    /// Entries of a row, for paths from a start, that source node `i` may be matched to: the first one and the one after
    /// the last.
    fn within_band(&self, start: usize, i: usize) -> [usize; 2] {
        let (n, m) = self.size();
        // Only the closing pair may meet the first source node again.
        if i == n {
            return [LONGEST + m, LONGEST + m + 1];
        }
        let (at, here, band) = (&self.at[start..], self.problem.source[i], self.problem.band);
        let (first, last) = (LONGEST + 1, LONGEST + m);
        let low = at[first..last].partition_point(|t| t - at[LONGEST] < here - band);
        let high = at[first..last].partition_point(|t| t - at[LONGEST] <= here + band);
        [first + low, first + high.max(low)]
    }

    /// The last step of the cheapest path to a pair of nodes.
    fn last_step(
        &self,
        cost: &[f64],
        paths: &Paths<f64>,
        start: usize,
        i: usize,
        j: usize,
    ) -> (usize, usize) {
        let ((n, m), columns, j) = (self.size(), self.nodes.len(), j + LONGEST);
        let (mut low, mut last) = (f64::INFINITY, STEPS[0]);
        for (&(a, b), step) in STEPS.iter().zip(&self.double) {
            if a > i {
                continue;
            }
            let costs = cost[i % n * columns + start + j] + cost[(i - a) * columns + start + j - b];
            let before = paths.best[(i - a) * row_length(m) + j - b];
            let (length, inverse) = (step.length[start + j], step.inverse[start + j]);
            let total = self.source_step(i, a).total(before, costs, length, inverse, step.skipped[start + j]);
            if total < low {
                (low, last) = (total, (a, b));
            }
        }
        last
    }
}

/// Length of a row of path costs with `m` target nodes.
fn row_length(m: usize) -> usize {
    LONGEST + m + 1 + BLOCK
}

#[cfg(test)]
#[path = "matching_tests.rs"]
mod tests;
