//! Criterion benches of the core's kernels: `cargo bench -p patchtransfer-core`.
use criterion::{Criterion, criterion_group, criterion_main};
use patchtransfer_core::spline::bezier_extract;

fn extraction(c: &mut Criterion) {
    let knots: Vec<f64> = [0.0; 3].into_iter().chain((0..=100).map(f64::from)).chain([100.0; 3]).collect();
    let points: Vec<[f64; 2]> = (0..103).map(|i| [f64::from(i), f64::from(i * i % 17)]).collect();
    c.bench_function("bezier_extract/100 cubic spans", |b| b.iter(|| bezier_extract(&knots, 3, &points)));
}

criterion_group!(benches, extraction);
criterion_main!(benches);
