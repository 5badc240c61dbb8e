//! Criterion benches of the core's kernels: `cargo bench -p patchtransfer-core`.
use criterion::{Criterion, criterion_group, criterion_main};
use patchtransfer_core::location::Locator;
use patchtransfer_core::mesh::local_global::LocalGlobal;
use patchtransfer_core::mesh::triangulation::triangulate;
use patchtransfer_core::numeric::ssvd;
use patchtransfer_core::optimizer::{Model, Settings, SplineOptimizer};
use patchtransfer_core::proof::injectivity::{Limits, certify_patch};
use patchtransfer_core::spline::scattered::TensorSpline;
use patchtransfer_core::spline::{SplinePatch, bezier_extract};
use std::ops::ControlFlow;

fn extraction(c: &mut Criterion) {
    let knots: Vec<f64> = [0.0; 3].into_iter().chain((0..=100).map(f64::from)).chain([100.0; 3]).collect();
    let points: Vec<[f64; 2]> = (0..103).map(|i| [f64::from(i), f64::from(i * i % 17)]).collect();
    c.bench_function("bezier_extract/100 cubic spans", |b| b.iter(|| bezier_extract(&knots, 3, &points)));
}

/// Reused buffers on both sides: page faults of fresh ones would cost more than either kernel.
fn projection(c: &mut Criterion) {
    let n = 1_000_000;
    let j: Vec<[f64; 4]> =
        (0..n).map(|i| [0, 1, 2, 3].map(|c| f64::sin(f64::from(4 * i + c) * 1.7))).collect();
    let k = vec![3.0; j.len()];
    let mut out = vec![[0.0; 4]; j.len()];
    c.bench_function("memcpy/1e6 matrices", |b| b.iter(|| out.copy_from_slice(std::hint::black_box(&j))));
    c.bench_function("ssvd::project_all/1e6 faces", |b| b.iter(|| ssvd::project_all(&j, &k, &mut out)));
}

/// A square of (n + 1)² vertices, unstructured by a shift of the interior ones.
fn square(n: usize) -> (Vec<[f64; 2]>, Vec<usize>) {
    let h = 1.0 / n as f64;
    let inner = |c: usize| c > 0 && c < n;
    let points = (0..=n)
        .flat_map(|i| (0..=n).map(move |j| (i, j)))
        .map(|(i, j)| {
            let shift = if inner(i) && inner(j) { 0.3 * h } else { 0.0 };
            let phase = (i * 131 + j * 17) as f64;
            [i as f64 * h + shift * phase.sin(), j as f64 * h + shift * (1.3 * phase).cos()]
        })
        .collect();
    let at = |i: usize, j: usize| i * (n + 1) + j;
    let south = (0..n).map(|i| at(i, 0));
    let east = (0..n).map(|j| at(n, j));
    let north = (0..n).map(|i| at(n - i, n));
    let west = (0..n).map(|j| at(0, n - j));
    (points, south.chain(east).chain(north).chain(west).collect())
}

fn mesh(c: &mut Criterion) {
    let (points, rim) = square(315);
    let loops = [rim];
    c.bench_function("triangulate/1e5 points", |b| b.iter(|| triangulate(&points, &loops, None).unwrap()));
    let mesh = triangulate(&points, &loops, None).unwrap();
    let mut solver = LocalGlobal::new(&points, &mesh.triangles, &loops[0], None).unwrap();
    let k = vec![1.2; mesh.triangles.len()];
    let bend = |p: &[f64; 2]| [p[0], p[1] * (1.0 + 4.0 * (p[0] * 9.0).sin())];
    let start: Vec<[f64; 2]> = points.iter().map(bend).collect();
    assert!(solver.iterate(&mut start.clone(), &k, 5, 0.0, || true).steps == 5);
    let mut u = start.clone();
    c.bench_function("local-global/1e5 vertices, one step", |b| {
        b.iter(|| {
            u.copy_from_slice(&start);
            solver.iterate(&mut u, &k, 1, 0.0, || true)
        });
    });
}

fn certificate(c: &mut Criterion) {
    let n = 100;
    let knots: Vec<f64> =
        [0.0; 3].into_iter().chain((0..=n).map(f64::from)).chain([f64::from(n); 3]).collect();
    let m = n as usize + 3;
    let points = (0..m * m).map(|k| ((k / m) as f64, (k % m) as f64));
    let points = points.map(|(u, v)| [u + (0.1 * v).sin(), v + (0.1 * u).cos()]).collect();
    let patch =
        SplinePatch { degrees: [3, 3], knots: [knots.clone(), knots], shape: [m, m], points, weights: None };
    c.bench_function("certify_patch/10000 bicubic spans", |b| {
        b.iter(|| certify_patch(&patch, 1.0, &Limits::default()))
    });
}

/// A bicubic square of n² spans, bent; from the harmonic map to the optimum.
fn optimisation(c: &mut Criterion) {
    for n in [12_u32, 40, 80] {
        let size = n as usize + 3;
        let knots: Vec<f64> =
            [0.0; 3].into_iter().chain((0..=n).map(f64::from)).chain([f64::from(n); 3]).collect();
        let greville: Vec<f64> =
            (0..size).map(|i| knots[i + 1..i + 4].iter().sum::<f64>() / 3.0 / f64::from(n)).collect();
        let at = |k: usize| [greville[k / size], greville[k % size]];
        let points: Vec<[f64; 2]> = (0..size * size).map(at).collect();
        let inner = |i: usize| i > 0 && i + 1 < size;
        let free: Vec<usize> = (0..size * size).filter(|k| inner(k / size) && inner(k % size)).collect();
        let bent: Vec<[f64; 2]> =
            points.iter().map(|[x, y]| [(0.5 + y) * x.sin(), (0.5 + y) * x.cos()]).collect();
        let patch = SplinePatch {
            degrees: [3, 3],
            knots: [knots.clone(), knots],
            shape: [size, size],
            points,
            weights: None,
        };
        let indices = vec![(0..(size * size) as u32).collect()];
        let model = Model {
            reference: vec![patch],
            indices,
            n_points: size * size,
            nodes_per_degree: 2,
            extra: vec![],
            excluded: vec![],
        };
        let name = |stage: &str| format!("spline optimiser, {stage}/{} unknown points", free.len());
        c.bench_function(&name("setup"), |b| {
            b.iter(|| SplineOptimizer::new(model.clone(), free.clone(), None).unwrap())
        });
        let mut optimizer = SplineOptimizer::new(model, free.clone(), None).unwrap();
        let start = optimizer.harmonic(&bent).unwrap();
        c.bench_function(&name("harmonic map, Laplacian kept"), |b| {
            b.iter(|| optimizer.harmonic(&bent).unwrap())
        });
        let settings = Settings { lambda: 0.3, max_steps: 200, tolerance: 1e-8, scale: None };
        let one = Settings { max_steps: 1, ..settings };
        c.bench_function(&name("coarser spaces and one step"), |b| {
            b.iter(|| optimizer.minimise(&start, one, |_| ControlFlow::Continue(())).unwrap())
        });
        c.bench_function(&name("to the optimum"), |b| {
            b.iter(|| optimizer.minimise(&start, settings, |_| ControlFlow::Continue(())).unwrap())
        });
    }
}

/// 1e5 points of 30 bent bicubic patches: evaluated, and found again. What counts is the ratio.
fn location(c: &mut Criterion) {
    let knots = vec![0.0, 0.0, 0.0, 0.0, 0.5, 1.0, 1.0, 1.0, 1.0];
    let greville: Vec<f64> = (0..5).map(|i| knots[i + 1..i + 4].iter().sum::<f64>() / 3.0).collect();
    let patch = |k: usize| {
        let at = |i: usize| [(k / 6) as f64 + greville[i / 5], (k % 6) as f64 + greville[i % 5]];
        let bent = |[x, y]: [f64; 2]| [x + 0.3 * (1.3 * y).sin(), y + 0.3 * (1.1 * x).cos()];
        SplinePatch {
            degrees: [3, 3],
            knots: [knots.clone(), knots.clone()],
            shape: [5, 5],
            points: (0..25).map(|i| bent(at(i))).collect(),
            weights: None,
        }
    };
    let patches: Vec<SplinePatch> = (0..30).map(patch).collect();
    let n = 100_000 / patches.len();
    let parameter = |k: usize| 0.5 + 0.5 * (k as f64 * 1.7).sin();
    let (u, v): (Vec<f64>, Vec<f64>) = (0..n).map(|k| (parameter(k), parameter(3 * k + 1))).unzip();
    let evaluated = || -> Vec<f64> {
        let values = |p: &SplinePatch| {
            let [ku, kv] = &p.knots;
            let coefficients = p.points.as_flattened();
            TensorSpline { degrees: p.degrees, knots: [ku, kv], coefficients, width: 2 }.at_points(
                &u,
                &v,
                [0, 0],
            )
        };
        patches.iter().flat_map(values).collect()
    };
    let points: Vec<[f64; 2]> = evaluated().chunks_exact(2).map(|x| [x[0], x[1]]).collect();
    let locator = Locator::new(&patches);
    assert!(locator.locate(&points, 0.0).iter().all(Option::is_some));
    c.bench_function("evaluate/1e5 points, 30 bicubic patches", |b| b.iter(evaluated));
    c.bench_function("locate/1e5 points, 30 bicubic patches, setup", |b| b.iter(|| Locator::new(&patches)));
    c.bench_function("locate/1e5 points, 30 bicubic patches", |b| b.iter(|| locator.locate(&points, 0.0)));
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(20);
    targets = extraction, projection, mesh, certificate, optimisation, location
}
criterion_main!(benches);
