use super::*;
use crate::numeric::sparse::CooMatrix;
use crate::optimizer::systems::Accuracy;
use crate::spline::SplinePatch;
use proptest::prelude::*;

const SETTINGS: Settings = Settings { lambda: 0.3, max_steps: 200, tolerance: 1e-8 };

/// Two bicubic patches of `spans`² spans side by side, bent: model, free points and the start.
fn bent_pair(spans: usize) -> (Model, Vec<usize>, Vec<[f64; 2]>) {
    let inner = (1..spans).map(|k| k as f64 + 0.2 * (k as f64).sin());
    let end = spans as f64;
    let knots: Vec<f64> = [0.0; 4].into_iter().chain(inner).chain([end; 4]).collect();
    let (n, columns) = (spans + 3, 2 * spans + 5);
    let greville: Vec<f64> = (0..n).map(|i| knots[i + 1..i + 4].iter().sum::<f64>() / (3.0 * end)).collect();
    // The second patch is mirrored in u and its knots with it, so that its sense differs.
    let mirrored: Vec<f64> = knots.iter().rev().map(|t| end - t).collect();
    let place = |k: usize, i: usize| if k == 0 { i } else { columns - 1 - i };
    let column: Vec<f64> =
        (0..columns).map(|c| if c < n { greville[c] } else { 2.0 - greville[columns - 1 - c] }).collect();
    let reference: Vec<SplinePatch> = (0..2)
        .map(|k| SplinePatch {
            degrees: [3, 3],
            knots: [knots.clone(), if k == 0 { knots.clone() } else { mirrored.clone() }],
            shape: [n, n],
            points: (0..n * n)
                .map(|p| [column[place(k, p / n)], greville[if k == 0 { p % n } else { n - 1 - p % n }]])
                .collect(),
            weights: None,
        })
        .collect();
    let indices: Vec<Vec<u32>> = (0..2)
        .map(|k| {
            let at = |p: usize| place(k, p / n) * n + if k == 0 { p % n } else { n - 1 - p % n };
            (0..n * n).map(|p| at(p) as u32).collect()
        })
        .collect();
    let mut x = vec![[0.0; 2]; columns * n];
    for (patch, index) in reference.iter().zip(&indices) {
        for (&[u, v], &i) in patch.points.iter().zip(index) {
            let (sin, cos) = (0.9 * u).sin_cos();
            x[i as usize] = [(1.0 + v) * sin, (1.0 + v) * cos];
        }
    }
    let inside = |p: &usize| (1..columns - 1).contains(&(p / n)) && (1..n - 1).contains(&(p % n));
    let free: Vec<usize> = (0..columns * n).filter(inside).collect();
    let n_points = columns * n;
    let model = Model { reference, indices, n_points, nodes_per_degree: 2, extra: vec![], excluded: vec![] };
    (model, free, x)
}

fn on_threads<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(work)
}

fn solve(z: Option<CscMatrix<f64>>, threads: usize) -> Outcome {
    let (model, free, mut x) = bent_pair(3);
    // A folded start.
    for &p in &free {
        x[p] = [0.9 - x[p][0], x[p][1]];
    }
    let mut optimizer = SplineOptimizer::new(model, free, z).unwrap();
    on_threads(threads, || optimizer.minimise(&x, SETTINGS, |_| ControlFlow::Continue(())).unwrap())
}

/// The same problem without coarser spaces and with all nodes.
fn plainly(optimizer: &mut SplineOptimizer, x: &[[f64; 2]]) -> Outcome {
    optimizer.coarser.clear();
    optimizer.problem.evaluator.elements.hessian_nodes = None;
    optimizer.minimise(x, SETTINGS, |_| ControlFlow::Continue(())).unwrap()
}

#[test]
fn coarser_spaces_and_threads_lead_to_the_same_map() {
    let (model, free, x) = bent_pair(28);
    assert!(free.len() >= COARSE_FROM);
    let run = |threads: usize| {
        let mut optimizer = SplineOptimizer::new(model.clone(), free.clone(), None).unwrap();
        let harmonic = optimizer.harmonic(&x).unwrap();
        let solve = || optimizer.minimise(&harmonic, SETTINGS, |_| ControlFlow::Continue(()));
        let found = on_threads(threads, solve).unwrap();
        (optimizer, harmonic, found)
    };
    let (mut optimizer, harmonic, found) = run(1);
    assert!(optimizer.coarser.len() >= 2);
    assert_eq!(found.stop, Stop::Converged);
    assert_eq!(run(3).2.points, found.points);
    let plain = plainly(&mut optimizer, &harmonic);
    assert!(plain.steps.len() > found.steps.len());
    assert!((plain.energy - found.energy).abs() < 1e-8 * plain.energy);
    for (a, b) in plain.points.iter().zip(&found.points) {
        assert!((a[0] - b[0]).abs() + (a[1] - b[1]).abs() < 1e-3);
    }
}

#[test]
fn folds_of_a_large_model_open_in_the_coarser_spaces() {
    let (model, free, mut x) = bent_pair(24);
    for &p in &free {
        x[p] = [0.9 - x[p][0], x[p][1]];
    }
    let mut optimizer = SplineOptimizer::new(model, free, None).unwrap();
    let mut all = 0;
    let count = |_: &Step| {
        all += 1;
        ControlFlow::Continue(())
    };
    let found = optimizer.minimise(&x, SETTINGS, count).unwrap();
    assert!(found.stop == Stop::Converged && found.min_det > 0.0, "{:?}", found.stop);
    // The observer sees the steps in coarser spaces, where most folds open.
    assert!(found.steps.len() < all, "{} of {all}", found.steps.len());
}

#[test]
fn a_stop_in_the_coarser_spaces_keeps_what_they_gave() {
    let (model, free, x) = bent_pair(24);
    let mut optimizer = SplineOptimizer::new(model, free, None).unwrap();
    let start = optimizer.harmonic(&x).unwrap();
    let (mut seen, at) = (0, Parameters { scale: 1.0, eps: 1e-3, lambda: 0.3 });
    let stop_at_the_fourth = |_: &Step| {
        seen += 1;
        if seen < 4 { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
    };
    let found = optimizer.minimise(&start, SETTINGS, stop_at_the_fourth).unwrap();
    assert_eq!((found.stop, found.steps.len(), seen), (Stop::Interrupted, 0, 4));
    let [before, after] =
        [&start, &found.points].map(|points| optimizer.problem.evaluator.energy(points, at).energy);
    assert!(after < before, "{before} {after}");
}

#[test]
fn prolongation_keeps_the_map() {
    let (model, free, _) = bent_pair(24);
    let optimizer = SplineOptimizer::new(model.clone(), free, None).unwrap();
    let space = &optimizer.coarser[0].0;
    // Random movements of the coarse points, evaluated on both levels.
    let c: Vec<[f64; 2]> =
        (0..space.n_points).map(|k| [(1.7 * k as f64).sin(), (2.3 * k as f64).cos()]).collect();
    let fine = space.prolong(&c, &model.indices, model.n_points);
    for (k, patch) in model.reference.iter().enumerate() {
        let value = |knots: &[Vec<f64>; 2], index: &[u32], x: &[[f64; 2]], t: [f64; 2]| {
            let basis = [0, 1].map(|a| {
                let span = crate::optimizer::axis::span_of(
                    &knots[a],
                    &crate::spline::spans(&knots[a], 3),
                    t[a],
                    false,
                );
                crate::optimizer::axis::Sampling::new(&knots[a], 3, &[(t[a], span)])
            });
            let n_v = knots[1].len() - 4;
            let mut sum = [0.0; 2];
            for a in 0..4 {
                for b in 0..4 {
                    let p = x[index[(basis[0].first[0] + a) * n_v + basis[1].first[0] + b] as usize];
                    let w = basis[0].values[a] * basis[1].values[b];
                    sum = [sum[0] + w * p[0], sum[1] + w * p[1]];
                }
            }
            sum
        };
        for s in 0..40 {
            let t = [24.0 * (f64::from(s) * 0.37).fract(), 24.0 * (f64::from(s) * 0.71).fract()];
            let coarse = value(&space.knots[k], &space.indices[k], &c, t);
            let same = value(&patch.knots, &model.indices[k], &fine, t);
            assert!((coarse[0] - same[0]).abs() + (coarse[1] - same[1]).abs() < 1e-12);
        }
    }
}

#[test]
fn folds_open_and_the_bits_do_not_depend_on_the_threads() {
    let one = solve(None, 1);
    assert!(one.steps[0].min_det < 0.0 && one.min_det > 0.0 && one.stop == Stop::Converged);
    for threads in [2, 3] {
        assert_eq!(one.points, solve(None, threads).points);
    }
}

#[test]
fn a_scaled_permutation_as_basis_changes_nothing_but_rounding() {
    let n = bent_pair(3).1.len();
    let mut z = CooMatrix::new(n, n);
    (0..n).for_each(|i| z.push(i, n - 1 - i, 1.0 + i as f64 / n as f64));
    let (plain, scaled) = (solve(None, 1), solve(Some(CscMatrix::from(&z)), 1));
    assert!((plain.energy - scaled.energy).abs() < 1e-10);
    for (a, b) in plain.points.iter().zip(&scaled.points) {
        assert!((a[0] - b[0]).abs() + (a[1] - b[1]).abs() < 1e-6);
    }
}

#[test]
fn the_observer_can_stop_it() {
    let (model, free, x) = bent_pair(3);
    let mut optimizer = SplineOptimizer::new(model, free, None).unwrap();
    let stopped = optimizer.minimise(&x, SETTINGS, |_| ControlFlow::Break(())).unwrap();
    assert_eq!((stopped.stop, stopped.steps.len(), stopped.points), (Stop::Interrupted, 1, x));
}

#[test]
fn a_rough_solution_leaves_the_finest_space_out() {
    let (model, free, x) = bent_pair(28);
    let mut optimizer = SplineOptimizer::new(model, free, None).unwrap();
    let harmonic = optimizer.harmonic(&x).unwrap();
    let mut solve = |tolerance: f64, x: &[[f64; 2]]| {
        let settings = Settings { tolerance, ..SETTINGS };
        optimizer.minimise(x, settings, |_| ControlFlow::Continue(())).unwrap()
    };
    let (fine, rough) = (solve(1e-8, &harmonic), solve(1e-4, &harmonic));
    assert!(!fine.steps.is_empty() && rough.steps.is_empty());
    assert!(rough.stop == Stop::Converged && rough.min_det > 0.0);
    assert!((rough.energy - fine.energy).abs() < 1e-4 * fine.energy);
}

#[test]
fn a_rough_solution_of_a_folded_start_has_no_folds() {
    let (model, free, mut x) = bent_pair(24);
    for &p in &free {
        x[p] = [0.9 - x[p][0], x[p][1]];
    }
    let mut optimizer = SplineOptimizer::new(model, free, None).unwrap();
    let settings = Settings { tolerance: 1e-4, ..SETTINGS };
    let rough = optimizer.minimise(&x, settings, |_| ControlFlow::Continue(())).unwrap();
    assert!(rough.stop == Stop::Converged && rough.min_det > 0.0);
}

#[test]
fn determinants_are_those_of_the_map_asked_for() {
    let (model, free, x) = bent_pair(3);
    let mut optimizer = SplineOptimizer::new(model, free.clone(), None).unwrap();
    let mut folded = x.clone();
    free.iter().for_each(|&p| folded[p] = [0.9 - x[p][0], x[p][1]]);
    let first = optimizer.determinants(&x);
    assert!(first.0 > 0.0 && optimizer.determinants(&folded).0 < 0.0);
    assert_eq!((optimizer.determinants(&x), optimizer.determinants(&x)), (first, first));
}

/// The optimizer with conjugate gradients at every size.
fn iterative(mut optimizer: SplineOptimizer) -> SplineOptimizer {
    let coarser = optimizer.coarser.iter_mut().map(|(_, problem)| problem);
    for problem in coarser.chain([&mut optimizer.problem]) {
        let pattern = problem.reduced.as_ref().map_or(&problem.assembly.pattern, |r| &r.pattern);
        problem.systems = Systems::new(pattern, None, true).unwrap();
    }
    optimizer
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    /// Whatever the map: Newton's step to the accuracy asked for, and the factorization's own where that is too much.
    #[test]
    fn steps_by_conjugate_gradients_are_those_of_the_factorization(
        spans in 2usize..6, moves in prop::collection::vec(-0.02..0.02, 24),
    ) {
        let (model, free, mut x) = bent_pair(spans);
        for (k, &p) in free.iter().enumerate() {
            x[p] = [x[p][0] + moves[k % 24], x[p][1] + moves[(k + 7) % 24]];
        }
        let mut optimizer = SplineOptimizer::new(model, free.clone(), None).unwrap();
        let problem = &mut optimizer.problem;
        let at = Parameters { scale: 1.0, eps: 1e-2, lambda: 0.3 };
        let pattern = &problem.assembly.pattern;
        let mut values = vec![0.0; 4 * pattern.blocks()];
        let kind = crate::distortion::HessianKind::Projected;
        problem.evaluator.hessian(&x, at, kind, &problem.assembly, &mut values);
        let right: Vec<f64> = (0..2 * free.len()).map(|i| (1.0 + 0.7 * i as f64).sin()).collect();
        let mut solve = |iterative: bool, energy: f64, tolerance: f64| {
            let mut systems = Systems::new(pattern, None, iterative).unwrap();
            let mut x = right.clone();
            systems.prepare(pattern, &mut values, true).unwrap();
            systems.solve(pattern, &mut values, &mut x, Accuracy { energy, tolerance }).unwrap();
            x
        };
        let exact = solve(false, 1.0, 0.0);
        let fall: f64 = exact.iter().zip(&right).map(|(x, b)| x * b).sum();
        // The fall of the model that a rough solution misses is the square of its error.
        let rough = solve(true, fall, 1e-3);
        let missed = 1.0 - rough.iter().zip(&right).map(|(x, b)| x * b).sum::<f64>() / fall;
        prop_assert!(missed > -1e-9 && missed < 2e-2, "{}", missed);
        prop_assert_eq!(&solve(true, f64::INFINITY, 0.0), &exact);
    }
}

#[test]
fn conjugate_gradients_lead_to_the_same_map_on_any_number_of_threads() {
    let (model, free, x) = bent_pair(28);
    let run = |threads: usize| {
        let mut optimizer = iterative(SplineOptimizer::new(model.clone(), free.clone(), None).unwrap());
        let harmonic = optimizer.harmonic(&x).unwrap();
        let solve = || optimizer.minimise(&harmonic, SETTINGS, |_| ControlFlow::Continue(()));
        let found = on_threads(threads, solve).unwrap();
        (harmonic, found)
    };
    let (harmonic, found) = run(1);
    assert!(found.stop == Stop::Converged && found.min_det > 0.0);
    assert_eq!(run(2).1.points, found.points);
    let mut direct = SplineOptimizer::new(model.clone(), free.clone(), None).unwrap();
    for (a, b) in direct.harmonic(&x).unwrap().iter().zip(&harmonic) {
        assert!((a[0] - b[0]).abs() + (a[1] - b[1]).abs() < 1e-8);
    }
    let same = direct.minimise(&harmonic, SETTINGS, |_| ControlFlow::Continue(())).unwrap();
    assert!((same.energy - found.energy).abs() < 1e-8 * same.energy);
}

#[test]
fn conjugate_gradients_open_folds_under_rows_as_well() {
    let (model, free, start) = bent_pair(6);
    let mut x = start;
    for &p in &free {
        x[p] = [0.9 - x[p][0], x[p][1]];
    }
    let n = free.len();
    let mut z = CooMatrix::new(n, n);
    (0..n).for_each(|i| z.push(i, n - 1 - i, 1.0 + i as f64 / n as f64));
    for basis in [None, Some(CscMatrix::from(&z))] {
        let new = || SplineOptimizer::new(model.clone(), free.clone(), basis.clone()).unwrap();
        let solve = |mut o: SplineOptimizer| o.minimise(&x, SETTINGS, |_| ControlFlow::Continue(())).unwrap();
        let (direct, found) = (solve(new()), solve(iterative(new())));
        assert!(found.stop == Stop::Converged && found.min_det > 0.0, "{:?}", found.stop);
        assert!((found.energy - direct.energy).abs() < 1e-7 * direct.energy);
    }
}
