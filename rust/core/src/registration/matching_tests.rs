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
    fn matcher(&self, point_cost: &[f64]) -> Matcher {
        Matcher::new(MatchingProblem {
            source: self.source.clone(),
            target: self.target.clone(),
            point_cost: point_cost.to_vec(),
            source_skip: self.skip[0].clone(),
            target_skip: self.skip[1].clone(),
            stretch: 0.1,
            band: 1.0,
        })
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
        (numbers(n), numbers(m), numbers(n * m), numbers(n), numbers(m)).prop_map(|(a, b, cost, s, t)| Data {
            source: positions(&a),
            target: positions(&b),
            cost,
            skip: [s, t],
        })
    })
}

/// Cost of a path, added up pair by pair.
fn price(p: &MatchingProblem, cost: &[f64], path: &[[usize; 2]]) -> f64 {
    let (n, m) = (p.source.len() - 1, p.target.len() - 1);
    let (at_s, at_t) =
        (|i: usize| p.source[i % n] + (i / n) as f64, |j: usize| p.target[j % m] + (j / m) as f64);
    let node = |[i, j]: [usize; 2]| (i % n) * m + j % m;
    let step = |w: &[[usize; 2]]| {
        let (ds, dt) = (at_s(w[1][0]) - at_s(w[0][0]), at_t(w[1][1]) - at_t(w[0][1]));
        let passed = (w[0][0] + 1..w[1][0]).map(|i| p.source_skip[i % n]).sum::<f64>()
            + (w[0][1] + 1..w[1][1]).map(|j| p.target_skip[j % m]).sum::<f64>();
        (cost[node(w[0])] + cost[node(w[1])]) * (ds + dt) / 4.0
            + p.stretch * (dt / ds - 1.0).powi(2) / (dt / ds) * (ds + dt) / 2.0
            + passed
    };
    path.windows(2).map(step).sum()
}

/// The cheapest continuation of a path to the pair `end`, by trying all.
fn cheapest(p: &MatchingProblem, cost: &[f64], path: &mut Vec<[usize; 2]>, end: [usize; 2]) -> f64 {
    let last = path[path.len() - 1];
    if last == end {
        return price(p, cost, path);
    }
    let mut best = f64::INFINITY;
    for (a, b) in STEPS {
        let next = [last[0] + a, last[1] + b];
        if next == end || (next[0] < end[0] && next[1] < end[1]) {
            path.push(next);
            best = best.min(cheapest(p, cost, path, end));
            path.pop();
        }
    }
    best
}

proptest! {
    #[test]
    fn no_path_is_cheaper(data in data(), start in 0usize..3) {
        let zero = vec![0.0; data.cost.len()];
        let matcher = data.matcher(&zero);
        let (problem, (n, m)) = (&matcher.problem, matcher.size());
        let solve = |start| matcher.solve(&data.cost, &[start]).expect("nothing is forbidden");
        let (cost, path) = solve(start);
        prop_assert_eq!(path[0], [0, start]);
        prop_assert_eq!(path[path.len() - 1], [n, start + m]);
        prop_assert!((price(problem, &data.cost, &path) - cost).abs() < 1e-12);
        let by_trying = cheapest(problem, &data.cost, &mut vec![[0, start]], [n, start + m]);
        prop_assert!((by_trying - cost).abs() < 1e-12);
        prop_assert!((matcher.scan(&data.cost, &[start])[0] - cost).abs() < 1e-5 * (1.0 + cost));
        let all = [0, 1, 2].map(solve);
        let best = all.iter().map(|(cost, _)| *cost).fold(f64::INFINITY, f64::min);
        let first = all.into_iter().find(|(cost, _)| *cost == best);
        prop_assert_eq!(matcher.solve(&data.cost, &[0, 1, 2]), first);
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
        if let Some((_, path)) = data.matcher(&point).solve(&data.cost, &[0]) {
            prop_assert!(path.contains(&[i, j]));
        } else {
            // Steps pass no more than five nodes, and the ratio of nodes is that of a step.
            prop_assert!(i != j || n != m);
        }
    }
}
