use super::*;
use crate::distortion::HessianKind;
use crate::numeric::sparse::CooMatrix;
use crate::spline::SplinePatch;

mod iterative;

const SETTINGS: Settings = Settings { lambda: 0.3, power: 1, max_steps: 200, tolerance: 1e-8, scale: None };

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
    let (mut seen, at) = (0, Parameters { scale: 1.0, eps: 1e-3, lambda: 0.3, power: 1 });
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

/// A minimum, its optimizer, and a wave of its fixed points.
fn at_minimum(z: Option<CscMatrix<f64>>) -> (SplineOptimizer, Field, Field) {
    let (model, free, x) = bent_pair(3);
    let mut wave: Field = (0..x.len()).map(|k| [(0.7 * k as f64).sin(), (1.3 * k as f64).cos()]).collect();
    free.iter().for_each(|&p| wave[p] = [0.0; 2]);
    let mut optimizer = SplineOptimizer::new(model, free, z).unwrap();
    let settings = Settings { tolerance: 1e-14, ..SETTINGS };
    let found = optimizer.minimise(&x, settings, |_| ControlFlow::Continue(())).unwrap();
    assert_eq!(found.stop, Stop::Converged);
    (optimizer, found.points, wave)
}

fn plus(x: &[[f64; 2]], step: f64, d: &[[f64; 2]]) -> Field {
    x.iter().zip(d).map(|(x, d)| [x[0] + step * d[0], x[1] + step * d[1]]).collect()
}

fn dot(a: &[[f64; 2]], b: &[[f64; 2]]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a[0] * b[0] + a[1] * b[1]).sum()
}

#[test]
fn the_product_is_the_derivative_of_the_gradient() {
    let (mut optimizer, x, wave) = at_minimum(None);
    optimizer.linearise(&x, SETTINGS.lambda, HessianKind::Exact, None).unwrap();
    let product = optimizer.product(&wave);
    // At fixed scale: the gradient's own is that of the map it is asked for.
    let (step, place) = (1e-5, optimizer.linearised.as_ref().unwrap().at);
    let mut gradient = |t: f64| optimizer.problem.evaluator.gradient_everywhere(&plus(&x, t, &wave), place).1;
    let (up, down) = (gradient(step), gradient(-step));
    let largest = product.iter().flatten().fold(0.0_f64, |m, v| m.max(v.abs()));
    for (p, g) in product.iter().enumerate() {
        for c in 0..2 {
            let difference = (up[p][c] - down[p][c]) / (2.0 * step);
            assert!((difference - g[c]).abs() < 1e-6 * largest, "{p} {c}");
        }
    }
}

#[test]
fn forces_are_answered_symmetrically_and_undone_by_the_hessian() {
    let n = bent_pair(3).1.len();
    let mut z = CooMatrix::new(n, n - 1);
    // The last two free points move together.
    (0..n).for_each(|i| z.push(i, i.min(n - 2), 1.0));
    for z in [None, Some(CscMatrix::from(&z))] {
        let (mut optimizer, x, wave) = at_minimum(z);
        optimizer.linearise(&x, SETTINGS.lambda, HessianKind::Exact, None).unwrap();
        let other = plus(&wave, 1.0, &x);
        let answers = optimizer.respond(&[x.clone(), other.clone()]);
        assert!((dot(&answers[0], &other) - dot(&x, &answers[1])).abs() < 1e-10 * dot(&answers[0], &x));
        // respond(H v) = v for motions of the unknowns.
        let back = optimizer.product(&answers[0]);
        for (a, b) in optimizer.respond(&[back])[0].iter().zip(&answers[0]) {
            assert!((a[0] - b[0]).abs() + (a[1] - b[1]).abs() < 1e-9);
        }
    }
}

#[test]
fn motions_tell_the_energy_of_the_minima_they_lead_to() {
    let (mut optimizer, x, wave) = at_minimum(None);
    optimizer.linearise(&x, SETTINGS.lambda, HessianKind::Exact, None).unwrap();
    let place = optimizer.linearised.as_ref().unwrap().at;
    let Motions { fields, slopes, hessian } = optimizer.motions(vec![wave]);
    // The minimum at fixed scale, for the boundary moved by a step: by Newton's method, the factorization kept.
    let mut least = |step: f64| {
        let mut moved = plus(&x, step, &fields[0]);
        for _ in 0..20 {
            let (_, gradient) = optimizer.problem.evaluator.gradient_everywhere(&moved, place);
            let correction = optimizer.respond(&[gradient]);
            moved = plus(&moved, -1.0, &correction[0]);
        }
        optimizer.problem.evaluator.energy(&moved, place).energy
    };
    let step = 2e-4;
    let (up, here, down) = (least(step), least(0.0), least(-step));
    assert!(((up - down) / (2.0 * step) - slopes[0]).abs() < 1e-5 * slopes[0].abs());
    let second = (up - 2.0 * here + down) / (step * step);
    assert!((second - hessian[0]).abs() < 1e-4 * hessian[0].abs(), "{second} {}", hessian[0]);
}

#[test]
fn another_minimisation_ends_what_was_linearised() {
    let (mut optimizer, x, _) = at_minimum(None);
    optimizer.linearise(&x, SETTINGS.lambda, HessianKind::Exact, None).unwrap();
    assert!(optimizer.is_linearised());
    optimizer.minimise(&x, SETTINGS, |_| ControlFlow::Continue(())).unwrap();
    assert!(!optimizer.is_linearised());
}

#[test]
fn corrections_reach_rounding_at_the_given_scale() {
    let (mut optimizer, x, wave) = at_minimum(None);
    // Near a minimum at another scale: its own energy has another.
    let scale = 1.02 * optimizer.scale_to_mean(&x);
    let settings = Settings { tolerance: 1e-6, scale: Some(scale), ..SETTINGS };
    let rough = optimizer.minimise(&x, settings, |_| ControlFlow::Continue(())).unwrap().points;
    optimizer.linearise(&rough, SETTINGS.lambda, HessianKind::Exact, Some(scale)).unwrap();
    let before = optimizer.settle(0);
    assert_eq!(before.points, rough);
    let settled = optimizer.settle(6);
    assert!(settled.residual < 1e-13 && settled.residual < 1e-4 * before.residual, "{}", settled.residual);
    assert!(settled.energy <= before.energy + 1e-14 && settled.min_det > 0.0);
    // Products are at the corrected map, and elsewhere where they are asked for.
    let here = optimizer.product(&wave);
    optimizer.look_from(rough);
    let there = optimizer.product(&wave);
    assert!(here != there);
    optimizer.linearise(&settled.points, SETTINGS.lambda, HessianKind::Exact, Some(scale)).unwrap();
    assert_eq!(optimizer.product(&wave), here);
}

/// The bent pair with weights: of both patches, or (`mixed`) of the second inside only, whose sides then fit.
fn weighted_pair(mixed: bool) -> (Model, Vec<usize>, Vec<[f64; 2]>) {
    let (mut model, free, x) = bent_pair(3);
    let [n, m] = model.reference[1].shape;
    let inside = |p: usize| (1..n - 1).contains(&(p / m)) && (1..m - 1).contains(&(p % m));
    for k in usize::from(mixed)..2 {
        // By the shared point, so that both sides of the interface agree.
        let weight = |(p, i): (usize, &u32)| {
            if mixed && !inside(p) { 1.0 } else { 1.0 + 0.5 * (1.9 * f64::from(*i)).sin() }
        };
        model.reference[k].weights = Some(model.indices[k].iter().enumerate().map(weight).collect());
    }
    (model, free, x)
}

#[test]
fn equal_weights_change_nothing() {
    let (plain, free, x) = bent_pair(3);
    let mut weighted = plain.clone();
    for patch in &mut weighted.reference {
        patch.weights = Some(vec![0.3; patch.points.len()]);
    }
    let solve = |model: Model| {
        let mut optimizer = SplineOptimizer::new(model, free.clone(), None).unwrap();
        let harmonic = optimizer.harmonic(&x).unwrap();
        let found = optimizer.minimise(&harmonic, SETTINGS, |_| ControlFlow::Continue(())).unwrap();
        assert_eq!(found.stop, Stop::Converged);
        (harmonic, found)
    };
    let (a, b) = (solve(plain), solve(weighted));
    assert!((a.1.energy - b.1.energy).abs() < 1e-14);
    for (p, q) in a.0.iter().chain(&a.1.points).zip(b.0.iter().chain(&b.1.points)) {
        assert!((p[0] - q[0]).abs() + (p[1] - q[1]).abs() < 1e-13, "{p:?} {q:?}");
    }
}

#[test]
fn gradients_and_products_are_derivatives() {
    for (mixed, power) in [(false, 1), (true, 1), (true, 2), (true, 5)] {
        let (model, free, x) = weighted_pair(mixed);
        let wave: Field = (0..x.len()).map(|k| [(0.7 * k as f64).sin(), (1.3 * k as f64).cos()]).collect();
        let mut optimizer = SplineOptimizer::new(model, free, None).unwrap();
        let at = Parameters { scale: 0.8, eps: 1e-3, lambda: 0.3, power };
        let evaluator = &mut optimizer.problem.evaluator;
        let step = 1e-5;
        let (up, down) = (plus(&x, step, &wave), plus(&x, -step, &wave));
        let difference =
            (evaluator.energy(&up, at).energy - evaluator.energy(&down, at).energy) / (2.0 * step);
        let slope = dot(&evaluator.gradient_everywhere(&x, at).1, &wave);
        assert!((difference - slope).abs() < 1e-7 * slope.abs(), "{difference} {slope}");
        let mut product = vec![[0.0; 2]; x.len()];
        evaluator.product(&x, &wave, at, |p, g| product[p] = [product[p][0] + g[0], product[p][1] + g[1]]);
        let [up, down] = [&up, &down].map(|y| evaluator.gradient_everywhere(y, at).1);
        let largest = product.iter().flatten().fold(0.0_f64, |m, v| m.max(v.abs()));
        for (p, g) in product.iter().enumerate() {
            for c in 0..2 {
                let difference = (up[p][c] - down[p][c]) / (2.0 * step);
                assert!((difference - g[c]).abs() < 1e-6 * largest, "{p} {c}: {difference} {}", g[c]);
            }
        }
    }
}

#[test]
fn rational_matrices_are_those_of_products() {
    for mixed in [false, true] {
        let (model, free, x) = weighted_pair(mixed);
        let wave: Field = (0..x.len()).map(|k| [(0.9 * k as f64).sin(), (1.1 * k as f64).cos()]).collect();
        let mut optimizer = SplineOptimizer::new(model, free.clone(), None).unwrap();
        let harmonic = optimizer.harmonic(&x).unwrap();
        // The gradient of the Dirichlet energy vanishes on the harmonic map: its matrix is that of the gradient.
        let NewtonProblem { evaluator, assembly, .. } = &mut optimizer.problem;
        let mut residual = vec![0.0; 2 * free.len()];
        evaluator.dirichlet(&harmonic, assembly, &mut residual);
        assert!(residual.iter().all(|r| r.abs() < 1e-12));
        let settings = Settings { tolerance: 1e-14, ..SETTINGS };
        let found = optimizer.minimise(&harmonic, settings, |_| ControlFlow::Continue(())).unwrap();
        assert_eq!(found.stop, Stop::Converged);
        optimizer.linearise(&found.points, SETTINGS.lambda, HessianKind::Exact, None).unwrap();
        let answer = optimizer.respond(&[wave]).remove(0);
        let back = optimizer.product(&answer);
        for (a, b) in optimizer.respond(&[back])[0].iter().zip(&answer) {
            assert!((a[0] - b[0]).abs() + (a[1] - b[1]).abs() < 1e-9);
        }
    }
}

#[test]
fn a_map_of_lowest_energy_is_its_reference_with_weights_too() {
    let (model, free, _) = weighted_pair(false);
    let mut x = vec![[0.0; 2]; model.n_points];
    for (patch, index) in model.reference.iter().zip(&model.indices) {
        index.iter().zip(&patch.points).for_each(|(&i, &p)| x[i as usize] = p);
    }
    let exact = x.clone();
    free.iter().for_each(|&p| x[p] = [x[p][0] + 0.02 * (p as f64).sin(), x[p][1]]);
    let mut optimizer = SplineOptimizer::new(model, free, None).unwrap();
    let found = optimizer.minimise(&x, SETTINGS, |_| ControlFlow::Continue(())).unwrap();
    assert!((found.energy - 2.6).abs() < 1e-12, "{}", found.energy);
    for (p, q) in found.points.iter().zip(&exact) {
        assert!((p[0] - q[0]).abs() + (p[1] - q[1]).abs() < 1e-6);
    }
}

#[test]
fn powers_lower_the_largest_distortion() {
    let (model, free, x) = bent_pair(6);
    let mut optimizer = SplineOptimizer::new(model, free, None).unwrap();
    let mut points = optimizer.harmonic(&x).unwrap();
    let go_on = |_: &Step| ControlFlow::Continue(());
    let mut last = f64::INFINITY;
    for power in [1, 2, 4, 8, 16] {
        let found = optimizer.minimise(&points, Settings { power, ..SETTINGS }, go_on).unwrap();
        assert!(found.stop == Stop::Converged && found.min_det > 0.0, "{power}: {:?}", found.stop);
        // Newton's method on the true Hessian needs few steps from one power to the next.
        assert!(found.steps.len() < 25, "{power}: {}", found.steps.len());
        // The norm for the largest p nears the largest distortion: minima for larger powers have a smaller one.
        let scale = optimizer.scale_to_mean(&found.points);
        let at = Parameters { scale, eps: EPS_FEASIBLE, lambda: SETTINGS.lambda, power: MAX_POWER };
        let largest = optimizer.problem.evaluator.energy(&found.points, at).energy;
        assert!(largest <= last * (1.0 + 1e-9), "{power}: {largest} {last}");
        (last, points) = (largest, found.points);
    }
}
