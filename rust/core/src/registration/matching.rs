//! Monotone matching of two closed sequences by dynamic programming.
//!
//! Nodes of the source in order are matched to nodes of the target in order; a path goes once round both. Corners
//! that a step passes over, on either side, cost their salience; so insertions and deletions are allowed.

use rayon::prelude::*;

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

/// Stands for an infinite cost of passing over a node.
const FORBIDDEN: f64 = 1e6;

/// What a matching costs. Positions and saliences have one entry more than nodes: the first node a full turn later.
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

/// Both sequences once round, the target from some start.
struct Turn {
    /// Positions of the target's nodes, counted on past a turn.
    at: Vec<f64>,
    /// Their numbers.
    nodes: Vec<usize>,
    /// Costs of passing over all nodes before each.
    source_passed: Vec<f64>,
    target_passed: Vec<f64>,
}

impl MatchingProblem<'_> {
    fn size(&self) -> (usize, usize) {
        (self.source.len() - 1, self.target.len() - 1)
    }

    /// Cheapest path from (source node 0, target node `start`) once round, and its cost: pairs of node numbers, the
    /// target's counted on past a turn. The last pair closes the loop. None when every path is forbidden.
    pub fn solve(&self, start: usize) -> Option<(f64, Vec<[usize; 2]>)> {
        let (n, m) = self.size();
        let (cost, steps) = self.cheapest(&self.turn(start));
        if cost >= FORBIDDEN {
            return None;
        }
        let (mut i, mut j) = (n, m);
        let mut path = vec![[i, start + j]];
        while i > 0 {
            let (a, b) = STEPS[steps[i * (m + 1) + j] as usize];
            (i, j) = (i - a, j - b);
            path.push([i, start + j]);
        }
        path.reverse();
        Some((cost, path))
    }

    /// The sequences once round, the target from `start`.
    fn turn(&self, start: usize) -> Turn {
        let (n, m) = self.size();
        let at = |j: usize| {
            self.target[(start + j) % m]
                + if start + j >= m { 1.0 } else { 0.0 }
                + if start + j >= 2 * m { 1.0 } else { 0.0 }
        };
        let passed = |skip: &[f64], size: usize, first: usize| {
            let mut sum = vec![0.0; size + 2];
            for k in 0..=size {
                // Large, but finite: differences of sums must stay numbers.
                sum[k + 1] = sum[k] + skip[(first + k) % size].min(FORBIDDEN);
            }
            sum
        };
        Turn {
            at: (0..=m).map(at).collect(),
            nodes: (0..=m).map(|j| (start + j) % m).collect(),
            source_passed: passed(self.source_skip, n, 0),
            target_passed: passed(self.target_skip, m, start),
        }
    }

    /// Cost of the cheapest path once round, and the last step, as index into [`STEPS`], of the cheapest path to every
    /// pair of nodes.
    fn cheapest(&self, turn: &Turn) -> (f64, Vec<u8>) {
        let (n, m) = self.size();
        let width = m + 1;
        let mut best = vec![f64::INFINITY; (n + 1) * width];
        let mut steps = vec![u8::MAX; (n + 1) * width];
        best[0] = self.point_cost[turn.nodes[0]];
        for i in 1..=n {
            let here = (i % n) * m;
            for j in 1..=m {
                let point = if i == n { 0.0 } else { self.point_cost[here + turn.nodes[j]] };
                if (self.source[i] - (turn.at[j] - turn.at[0])).abs() > self.band {
                    continue;
                }
                // Only the closing pair may meet the first source node again.
                if point == f64::INFINITY || (i == n) != (j == m) {
                    continue;
                }
                let (low, step) = self.cheapest_step(turn, &best, i, j);
                best[i * width + j] = low + point;
                steps[i * width + j] = step;
            }
        }
        (best[n * width + m], steps)
    }

    /// Cost of the cheapest path to a pair of nodes, what the pair itself costs left out, and its last step.
    #[inline]
    fn cheapest_step(&self, turn: &Turn, best: &[f64], i: usize, j: usize) -> (f64, u8) {
        let ((n, m), Turn { at, nodes, source_passed, target_passed }) = (self.size(), turn);
        let cost = self.cost[(i % n) * m + nodes[j]];
        let (mut low, mut step) = (f64::INFINITY, u8::MAX);
        for (k, &(a, b)) in STEPS.iter().enumerate() {
            if a > i || b > j {
                continue;
            }
            let (p, q) = (i - a, j - b);
            let before = best[p * (m + 1) + q];
            if before >= low {
                continue;
            }
            let (ds, dt) = (self.source[i] - self.source[p], at[j] - at[q]);
            let stretch = self.stretch * (dt - ds) * (dt - ds) * (ds + dt) / (ds * dt);
            let along = (cost + self.cost[(p % n) * m + nodes[q]]) * (ds + dt) / 4.0;
            let skipped = source_passed[i] - source_passed[p + 1] + target_passed[j] - target_passed[q + 1];
            let total = before + along + stretch / 2.0 + skipped;
            if total < low {
                (low, step) = (total, k as u8);
            }
        }
        (low, step)
    }

    /// Cost of the cheapest path from every one of the `starts`, infinite where all are forbidden.
    pub fn scan(&self, starts: &[usize]) -> Vec<f64> {
        starts.par_iter().map(|&start| self.solve(start).map_or(f64::INFINITY, |(cost, _)| cost)).collect()
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
            prop_assert_eq!(problem.scan(&[start])[0], cost);
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
