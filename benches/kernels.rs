//! Criterion benches of the core's kernels: `cargo bench -p patchtransfer-core`.
use criterion::{Criterion, criterion_group, criterion_main};
use patchtransfer_core::injectivity::{Limits, certify_patch};
use patchtransfer_core::spline::{SplinePatch, bezier_extract};

fn extraction(c: &mut Criterion) {
    let knots: Vec<f64> = [0.0; 3].into_iter().chain((0..=100).map(f64::from)).chain([100.0; 3]).collect();
    let points: Vec<[f64; 2]> = (0..103).map(|i| [f64::from(i), f64::from(i * i % 17)]).collect();
    c.bench_function("bezier_extract/100 cubic spans", |b| b.iter(|| bezier_extract(&knots, 3, &points)));
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

criterion_group!(benches, extraction, certificate);
criterion_main!(benches);
