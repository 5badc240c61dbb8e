//! Conjugate gradients in place of factorizations.

use super::*;
use crate::optimizer::systems::Accuracy;
use proptest::prelude::*;

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
        let at = Parameters { scale: 1.0, eps: 1e-2, lambda: 0.3, power: 1 };
        let pattern = &problem.assembly.pattern;
        let mut values = vec![0.0; 4 * pattern.blocks()];
        problem.evaluator.hessian(&x, at, HessianKind::Projected, &problem.assembly, &mut values);
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
