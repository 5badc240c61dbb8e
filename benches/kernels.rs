//! Criterion benches of the core's kernels: `cargo bench -p patchtransfer-core`.
use criterion::{Criterion, criterion_group, criterion_main};
use patchtransfer_core::fitting::boundary_fit::BoundaryFit;
use patchtransfer_core::fitting::side_fit::{SideData, SideFit};
use patchtransfer_core::location::Locator;
use patchtransfer_core::mesh::closest_point::{MeshTree, Point};
use patchtransfer_core::mesh::distortion_descent::{DistortionDescent, Stop};
use patchtransfer_core::mesh::local_global::LocalGlobal;
use patchtransfer_core::mesh::triangulation::triangulate;
use patchtransfer_core::numeric::quadrature::gauss;
use patchtransfer_core::numeric::ssvd;
use patchtransfer_core::optimizer::{Model, Settings, SplineOptimizer};
use patchtransfer_core::outline::Outline;
use patchtransfer_core::proof::injectivity::{Limits, certify_patch};
use patchtransfer_core::registration::matching::{Matcher, MatchingProblem};
use patchtransfer_core::spline::galerkin::{Galerkin, PatchSpace};
use patchtransfer_core::spline::sampled_basis::SampledBasis;
use patchtransfer_core::spline::scattered::TensorSpline;
use patchtransfer_core::spline::{SplineCurve, SplinePatch, bezier_extract};
use std::f64::consts::TAU;
use std::ops::ControlFlow;

fn extraction(c: &mut Criterion) {
    let knots: Vec<f64> = [0.0; 3].into_iter().chain((0..=100).map(f64::from)).chain([100.0; 3]).collect();
    let points: Vec<[f64; 2]> = (0..103).map(|i| [f64::from(i), f64::from(i * i % 17)]).collect();
    c.bench_function("bezier_extract/100 cubic spans", |b| b.iter(|| bezier_extract(&knots, 3, &points)));
}

/// Faces of the samples' meshes, the smallest and the largest, and of one where memory counts.
///
/// Reused buffers on both sides: page faults of fresh ones would cost more than either kernel.
fn projection(c: &mut Criterion) {
    for n in [300, 1_450] {
        let j: Vec<[f64; 4]> =
            (0..n).map(|i| [0, 1, 2, 3].map(|c| f64::sin(f64::from(4 * i + c) * 1.7))).collect();
        let (k, mut out) = (vec![3.0; j.len()], vec![[0.0; 4]; j.len()]);
        // From inside, as the solvers call it: entering the threads' pool takes longer than the work.
        c.bench_function(&format!("ssvd::project_all/{n} faces"), |b| {
            rayon::scope(|_| b.iter(|| ssvd::project_all(&j, &k, &mut out)));
        });
    }
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

/// Steps on a mesh of a sample's size, and what the paper's method does besides on one.
fn sample_sized_mesh(c: &mut Criterion) {
    let (points, rim) = square(24);
    let loops = [rim];
    let mesh = triangulate(&points, &loops, None).unwrap();
    let n = mesh.triangles.len();
    let bend = |p: &[f64; 2]| [(1.0 + p[1]) * (1.2 * p[0]).sin(), (1.0 + p[1]) * (1.2 * p[0]).cos()];
    let mut solver = LocalGlobal::new(&points, &mesh.triangles, &loops[0], None).unwrap();
    let folded: Vec<[f64; 2]> =
        points.iter().map(|p| [p[0], p[1] * (1.0 + 4.0 * (p[0] * 9.0).sin())]).collect();
    let k = vec![1.2; n];
    let mut u = folded.clone();
    c.bench_function(&format!("local-global/{n} faces, one step"), |b| {
        b.iter(|| {
            u.copy_from_slice(&folded);
            solver.iterate(&mut u, &k, 1, 0.0, || true)
        });
    });
    c.bench_function(&format!("local-global/{n} faces, fifty steps"), |b| {
        b.iter(|| {
            u.copy_from_slice(&folded);
            rayon::scope(|_| solver.iterate(&mut u, &k, 50, 0.0, || true))
        });
    });
    let mut harmonic: Vec<[f64; 2]> = points.iter().map(bend).collect();
    solver.harmonic(&mut harmonic);
    c.bench_function(&format!("distortion descent/{n} faces, setup"), |b| {
        b.iter(|| DistortionDescent::new(&points, &mesh.triangles, &loops[0], None).unwrap());
    });
    let mut descent = DistortionDescent::new(&points, &mesh.triangles, &loops[0], None).unwrap();
    assert_eq!(descent.minimise(&mut harmonic.clone(), 100, 1e-12, || true).stop, Stop::Converged);
    c.bench_function(&format!("distortion descent/{n} faces, to the minimum"), |b| {
        b.iter(|| descent.minimise(&mut harmonic.clone(), 100, 1e-12, || true));
    });
}

/// Vertices of a mesh with their images, found again on it when the images have moved a little.
fn closest_points(c: &mut Criterion) {
    for n in [24, 100] {
        let (points, rim) = square(n);
        let mesh = triangulate(&points, &[rim], None).unwrap();
        let stacked = |shift: f64| -> Vec<Point> {
            points.iter().map(|&[x, y]| [x, y, x + 0.1 * (5.0 * y + shift).sin(), y + shift]).collect()
        };
        let (vertices, queries) = (stacked(0.0), stacked(0.01));
        let name = |what: &str| format!("closest point/{} vertices, {what}", points.len());
        c.bench_function(&name("tree"), |b| b.iter(|| MeshTree::new(&vertices, &mesh.triangles)));
        let tree = MeshTree::new(&vertices, &mesh.triangles);
        c.bench_function(&name("all vertices"), |b| b.iter(|| tree.closest_all(&queries)));
    }
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
        let settings = Settings { lambda: 0.3, power: 1, max_steps: 200, tolerance: 1e-8, scale: None };
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

/// Values of all B-splines of a knot vector at `t`, by the recursion.
fn basis(knots: &[f64], degree: usize, t: f64) -> Vec<f64> {
    let last = knots.len() - degree - 2;
    let inside = |i: usize| knots[i] <= t && (t < knots[i + 1] || (i == last && t == knots[i + 1]));
    let mut values: Vec<f64> = (0..knots.len() - 1).map(|i| f64::from(u8::from(inside(i)))).collect();
    for p in 1..=degree {
        let share =
            |i: usize, x: f64| if knots[i + p] > knots[i] { x / (knots[i + p] - knots[i]) } else { 0.0 };
        values = (0..values.len() - 1)
            .map(|i| share(i, t - knots[i]) * values[i] + share(i + 1, knots[i + p + 1] - t) * values[i + 1])
            .collect();
    }
    values
}

/// A circle in 64 sides of seven control points, each fitted in ten iterations, as a boundary is.
fn boundary_fit(c: &mut Criterion) {
    let (sides, samples) = (64, 43);
    let knots: Vec<f64> = [0.0; 3].into_iter().chain([0.0, 1.0, 2.0, 3.0, 4.0]).chain([4.0; 3]).collect();
    let arc = |k: usize| {
        // A quarter of a circle to some 3e-4.
        let at = |t: f64, r: f64| [r * t.cos(), r * t.sin()];
        let (a, b) = (TAU / 4.0 * k as f64, TAU / 4.0 * (k + 1) as f64);
        let (p, q) = (at(a, 1.0), at(b, 1.0));
        let h = 0.5523;
        let points = vec![p, [p[0] - h * p[1], p[1] + h * p[0]], [q[0] + h * q[1], q[1] - h * q[0]], q];
        SplineCurve { degree: 3, knots: vec![0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0], points, weights: None }
    };
    let outline = Outline::new(&(0..4).map(arc).collect::<Vec<_>>());
    let values: Vec<f64> =
        (0..samples).flat_map(|k| basis(&knots, 3, 4.0 * f64::from(k) / f64::from(samples - 1))).collect();
    let bases = [SampledBasis::new(7, &values)];
    let side = |k: usize| {
        let step = outline.length() / sides as f64;
        let ends = [k, k + 1].map(|k| k as f64 * step);
        let lengths: Vec<f64> = (0..samples)
            .map(|i| ends[0] + step * (f64::from(i) / f64::from(samples - 1)).powf(1.2))
            .collect();
        let at = outline.evaluate(&ends, false);
        let data = SideData {
            basis: 0,
            outline: 0,
            lengths,
            ends: [[at[0][0], at[0][1]], [at[1][0], at[1][1]]],
            tangents: [[at[0][2], at[0][3]], [at[1][2], at[1][3]]],
            legs: [step / 12.0; 2],
            stray: [f64::INFINITY; 2],
        };
        SideFit::new(data, &bases[0], 1e-4, 1e-2, 0.3)
    };
    let fresh: Vec<SideFit> = (0..sides).map(side).collect();
    let joints: Vec<[usize; 2]> = (0..sides).map(|k| [(k + sides - 1) % sides, k]).collect();
    let fitted = || {
        let mut sides = fresh.clone();
        let mut fit = BoundaryFit::new(vec![&outline], &bases, &mut sides, &joints);
        fit.start();
        for _ in 0..10 {
            fit.linearise(false);
            fit.solve();
        }
        fit.errors(true).into_iter().fold(0.0, f64::max)
    };
    assert!(fitted() < 1e-3);
    c.bench_function("boundary fit/64 sides, ten iterations", |b| b.iter(fitted));
}

/// Two closed sequences of nodes, a wave and the same elsewhere: all starts, then the path of the best.
fn matching(c: &mut Criterion) {
    for n in [64_u32, 160] {
        let wave = |k: u32| {
            (TAU * f64::from(k) / f64::from(n)).sin() + (3.0 * TAU * f64::from(k) / f64::from(n)).cos()
        };
        let positions: Vec<f64> = (0..=n).map(|k| f64::from(k) / f64::from(n)).collect();
        let cost: Vec<f64> =
            (0..n).flat_map(|i| (0..n).map(move |j| (wave(i) - wave(j + n / 3)).powi(2))).collect();
        let matcher = Matcher::new(MatchingProblem {
            source: positions.clone(),
            target: positions,
            point_cost: vec![0.0; cost.len()],
            source_skip: vec![0.1; n as usize],
            target_skip: vec![0.1; n as usize],
            stretch: 0.1,
            band: 1.0,
        });
        let starts: Vec<usize> = (0..n as usize).collect();
        c.bench_function(&format!("matching/{n} nodes, all starts compared"), |b| {
            b.iter(|| matcher.scan(&cost, &starts));
        });
        assert!(matcher.solve(&cost, &starts).unwrap().0 < 1e-9 + 0.1);
        c.bench_function(&format!("matching/{n} nodes, the best path"), |b| {
            b.iter(|| matcher.solve(&cost, &starts));
        });
    }
}

/// Stiffness matrix of Poisson's equation on 16 patches of 20² bicubic spans, four by four nodes a span.
fn poisson(c: &mut Criterion) {
    let (side, n) = (4_usize, 20_u32);
    let knots: Vec<f64> =
        [0.0; 3].into_iter().chain((0..=n).map(f64::from)).chain([f64::from(n); 3]).collect();
    let (x, _) = gauss(4);
    let nodes: Vec<f64> = (0..n).flat_map(|s| x.iter().map(move |x| f64::from(s) + 0.5 + 0.5 * x)).collect();
    // Neighbours share the functions of their common side.
    let (own, along) = (n as usize + 3, side * (n as usize + 2) + 1);
    let number = |patch: usize, k: usize| {
        let at = [patch / side * (own - 1) + k / own, patch % side * (own - 1) + k % own];
        (at[0] * along + at[1]) as u32
    };
    let spaces = || -> Vec<PatchSpace> {
        let space = |patch: usize| {
            let indices = (0..own * own).map(|k| number(patch, k)).collect();
            PatchSpace::new([&knots, &knots], [3, 3], [&nodes, &nodes], indices)
        };
        (0..side * side).map(space).collect()
    };
    let plane = nodes.len() * nodes.len();
    let coefficients: Vec<f64> = [1.0, 0.1, 1.2]
        .into_iter()
        .flat_map(|c| (0..plane).map(move |k| c + 0.05 * (k as f64).sin()))
        .collect();
    let all = vec![&coefficients[..]; side * side];
    c.bench_function("Poisson/16 patches of 400 bicubic spans, pattern", |b| {
        b.iter(|| Galerkin::new(spaces(), along * along));
    });
    let galerkin = Galerkin::new(spaces(), along * along);
    assert!(galerkin.assemble(&[[1, 0], [0, 1]], &all).iter().all(|v| v.is_finite()));
    c.bench_function("Poisson/16 patches of 400 bicubic spans, assembly", |b| {
        b.iter(|| galerkin.assemble(&[[1, 0], [0, 1]], &all));
    });
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(20);
    targets = extraction, projection, mesh, sample_sized_mesh, closest_points, certificate, optimisation, location, boundary_fit,
        matching, poisson
}
criterion_main!(benches);
