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
pub struct Problem<'a> {
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

impl Problem<'_> {
    fn size(&self) -> (usize, usize) {
        (self.source.len() - 1, self.target.len() - 1)
    }

    /// Cheapest path from (source node 0, target node `start`) once round, and its cost: pairs of node numbers, the
    /// target's counted on past a turn. The last pair closes the loop. None when every path is forbidden.
    pub fn solve(&self, start: usize) -> Option<(f64, Vec<[usize; 2]>)> {
        let (n, m) = self.size();
        let width = m + 1;
        let node = |j: usize| (start + j) % m;
        let at: Vec<f64> = (0..=m)
            .map(|j| {
                self.target[node(j)]
                    + if start + j >= m { 1.0 } else { 0.0 }
                    + if start + j >= 2 * m { 1.0 } else { 0.0 }
            })
            .collect();
        let passed = |skip: &[f64], size: usize, first: usize| {
            let mut sum = vec![0.0; size + 2];
            for k in 0..=size {
                // Large, but finite: differences of sums must stay numbers.
                sum[k + 1] = sum[k] + skip[(first + k) % size].min(FORBIDDEN);
            }
            sum
        };
        let (skip_s, skip_t) = (passed(self.source_skip, n, 0), passed(self.target_skip, m, start));
        let mut best = vec![f64::INFINITY; (n + 1) * width];
        let mut from = vec![u8::MAX; (n + 1) * width];
        best[0] = self.point_cost[node(0)];
        for i in 1..=n {
            let here = (i % n) * m;
            for j in 1..=m {
                let point = if i == n { 0.0 } else { self.point_cost[here + node(j)] };
                if (self.source[i] - (at[j] - at[0])).abs() > self.band {
                    continue;
                }
                // Only the closing pair may meet the first source node again.
                if point == f64::INFINITY || (i == n) != (j == m) {
                    continue;
                }
                let cost = self.cost[here + node(j)];
                let (mut low, mut step) = (f64::INFINITY, u8::MAX);
                for (k, &(a, b)) in STEPS.iter().enumerate() {
                    if a > i || b > j {
                        continue;
                    }
                    let (p, q) = (i - a, j - b);
                    let before = best[p * width + q];
                    if before >= low {
                        continue;
                    }
                    let (ds, dt) = (self.source[i] - self.source[p], at[j] - at[q]);
                    let stretch = self.stretch * (dt - ds) * (dt - ds) * (ds + dt) / (ds * dt);
                    let along = (cost + self.cost[(p % n) * m + node(q)]) * (ds + dt) / 4.0;
                    let skipped = skip_s[i] - skip_s[p + 1] + skip_t[j] - skip_t[q + 1];
                    let total = before + along + stretch / 2.0 + skipped;
                    if total < low {
                        (low, step) = (total, k as u8);
                    }
                }
                best[i * width + j] = low + point;
                from[i * width + j] = step;
            }
        }
        let total = best[n * width + m];
        if total >= FORBIDDEN {
            return None;
        }
        let (mut i, mut j) = (n, m);
        let mut path = vec![[i, start + j]];
        while i > 0 {
            let (a, b) = STEPS[from[i * width + j] as usize];
            (i, j) = (i - a, j - b);
            path.push([i, start + j]);
        }
        path.reverse();
        Some((total, path))
    }

    /// Cost of the cheapest path from every one of the `starts`, infinite where all are forbidden.
    pub fn scan(&self, starts: &[usize]) -> Vec<f64> {
        starts.par_iter().map(|&start| self.solve(start).map_or(f64::INFINITY, |(cost, _)| cost)).collect()
    }
}
