use std::ops::{Add, Div, Mul, Sub};

use proptest::prelude::*;

use super::*;
use crate::spline::bernstein::BoundedBernstein;
use crate::spline::spans;

/// Double-double arithmetic, about 32 digits: the second route to det J.
#[derive(Clone, Copy, Debug)]
struct Dd(f64, f64);

fn two_sum(a: f64, b: f64) -> Dd {
    let s = a + b;
    let c = s - a;
    Dd(s, (a - (s - c)) + (b - c))
}

impl Add for Dd {
    type Output = Self;
    fn add(self, o: Self) -> Self {
        let Dd(s, e) = two_sum(self.0, o.0);
        two_sum(s, e + self.1 + o.1)
    }
}

impl Sub for Dd {
    type Output = Self;
    fn sub(self, o: Self) -> Self {
        self + Dd(-o.0, -o.1)
    }
}

impl Mul for Dd {
    type Output = Self;
    fn mul(self, o: Self) -> Self {
        let p = self.0 * o.0;
        two_sum(p, self.0.mul_add(o.0, -p) + self.0 * o.1 + self.1 * o.0)
    }
}

impl Div for Dd {
    type Output = Self;
    fn div(self, o: Self) -> Self {
        let q = Dd(self.0 / o.0, 0.0);
        let q = q + Dd((self - q * o).0 / o.0, 0.0);
        q + Dd((self - q * o).0 / o.0, 0.0)
    }
}

fn dd(x: f64) -> Dd {
    Dd(x, 0.0)
}

/// Basis functions of `degree` on span `k` by the Cox–de Boor recursion.
fn basis(knots: &[f64], degree: usize, k: usize, t: Dd) -> Vec<Dd> {
    let mut values = vec![dd(1.0)];
    for d in 1..=degree {
        let mut next = vec![dd(0.0); d + 1];
        for a in 0..d {
            let (lo, hi) = (dd(knots[k + a + 1 - d]), dd(knots[k + a + 1]));
            next[a] = next[a] + (hi - t) / (hi - lo) * values[a];
            next[a + 1] = next[a + 1] + (t - lo) / (hi - lo) * values[a];
        }
        values = next;
    }
    values
}

/// Values and derivatives of the basis functions on span `k`.
fn jets(knots: &[f64], p: usize, k: usize, t: Dd) -> [Vec<Dd>; 2] {
    let lower = basis(knots, p - 1, k, t);
    let slope = |a: usize| {
        let part = |a: usize| lower[a] * dd(p as f64) / (dd(knots[k + a + 1]) - dd(knots[k + a + 1 - p]));
        match a {
            0 => dd(0.0) - part(0),
            _ if a == p => part(p - 1),
            _ => part(a - 1) - part(a),
        }
    };
    [basis(knots, p, k, t), (0..=p).map(slope).collect()]
}

/// W³ det J (det J of a polynomial patch) of the scaled patch at a point of a span pair.
fn exact(jacobian: &PatchDeterminant<'_>, at: [usize; 2], u: Dd, v: Dd) -> Dd {
    let patch = jacobian.patch;
    let k: [usize; 2] = std::array::from_fn(|d| spans(&patch.knots[d], patch.degrees[d])[at[d]]);
    let [p, q] = patch.degrees;
    let (bu, bv) = (jets(&patch.knots[0], p, k[0], u), jets(&patch.knots[1], q, k[1], v));
    let sum = |du: usize, dv: usize| -> [Dd; 3] {
        let mut total = [dd(0.0); 3];
        for a in 0..=p {
            for b in 0..=q {
                let i = (k[0] - p + a) * patch.shape[1] + k[1] - q + b;
                let w = dd(jacobian.weights.get(i).copied().unwrap_or(1.0));
                let n = bu[du][a] * bv[dv][b] * w;
                let h = [n * dd(jacobian.points[i][0]), n * dd(jacobian.points[i][1]), n];
                total = [0, 1, 2].map(|c| total[c] + h[c]);
            }
        }
        total
    };
    let ([x, y, w], [xu, yu, wu], [xv, yv, wv]) = (sum(0, 0), sum(1, 0), sum(0, 1));
    if jacobian.weights.is_empty() {
        return xu * yv - yu * xv;
    }
    x * (yu * wv - wu * yv) + y * (wu * xv - xu * wv) + w * (xu * yv - yu * xv)
}

fn value(polynomial: &BoundedBernstein, s: Dd, t: Dd) -> Dd {
    let casteljau = |mut c: Vec<Dd>, x: Dd| {
        while c.len() > 1 {
            c = c.windows(2).map(|w| w[0] * (dd(1.0) - x) + w[1] * x).collect();
        }
        c[0]
    };
    let rows = polynomial.coefs.chunks(polynomial.degrees[1] + 1);
    casteljau(rows.map(|r| casteljau(r.iter().map(|&c| dd(c)).collect(), t)).collect(), s)
}

fn knot_vector(degree: usize, inner: &[(u32, usize)]) -> Vec<f64> {
    let mut inner: Vec<_> = inner.to_vec();
    inner.sort_unstable();
    inner.dedup_by_key(|x| x.0);
    let mut knots = vec![0.0; degree + 1];
    for (x, m) in inner {
        knots.extend(vec![f64::from(x) / 10.0; m.min(degree)]);
    }
    knots.extend(vec![1.0; degree + 1]);
    knots
}

fn random_patch(rational: bool) -> impl Strategy<Value = SplinePatch> {
    let inner = || proptest::collection::vec((1u32..10, 1usize..4), 0..4);
    let numbers = proptest::collection::vec((-1.0..1.0, -1.0..1.0, 0.2..3.0), 256);
    (1usize..4, 1usize..4, inner(), inner(), numbers, prop_oneof![Just(0.0), Just(1e3)], -20i32..20).prop_map(
        move |(p, q, iu, iv, numbers, offset, exponent)| {
            let knots = [knot_vector(p, &iu), knot_vector(q, &iv)];
            let shape = [knots[0].len() - p - 1, knots[1].len() - q - 1];
            let numbers = &numbers[..shape[0] * shape[1]];
            let scale = 2f64.powi(exponent);
            let points = numbers.iter().map(|n| [scale * (n.0 + offset), scale * (n.1 - offset)]).collect();
            let weights = rational.then(|| numbers.iter().map(|n| n.2).collect());
            SplinePatch { degrees: [p, q], knots, shape, points, weights }
        },
    )
}

fn check_bound(patch: &SplinePatch, s: f64, t: f64) -> Result<(), TestCaseError> {
    let jacobian = PatchDeterminant::new(patch);
    for i in 0..jacobian.spans(0) {
        for j in 0..jacobian.spans(1) {
            let work = jacobian.piece([i, j], 1.0);
            let lerp = |e: [f64; 2], x: f64| dd(e[0]) + (dd(e[1]) - dd(e[0])) * dd(x);
            let (eu, ev) = (jacobian.values[0].ends[i], jacobian.values[1].ends[j]);
            let check = |det: &BoundedBernstein, s: f64, t: f64, sub: [f64; 2]| {
                let true_value = exact(&jacobian, [i, j], lerp(eu, sub[0]), lerp(ev, sub[1]));
                let off = (value(det, dd(s), dd(t)) - true_value).0.abs();
                prop_assert!(off <= det.err, "off by {off:e}, bound {:e}", det.err);
                Ok(())
            };
            check(&work.det, s, t, [s, t])?;
            // s/2 and 1/2 + t/2 are exact, or round far below the bound's slack.
            check(&work.halve()[1].det, s, t, [0.5 * s, 0.5 + 0.5 * t])?;
            check(&work.halve()[1].halve()[2].det, s, t, [0.25 + 0.25 * s, 0.5 + 0.25 * t])?;
        }
    }
    Ok(())
}

proptest! {
    #[test]
    fn polynomial_det_lies_within_its_bound(patch in random_patch(false), s in 0u32..=64, t in 0u32..=64) {
        check_bound(&patch, f64::from(s) / 64.0, f64::from(t) / 64.0)?;
    }

    #[test]
    fn rational_det_lies_within_its_bound(patch in random_patch(true), s in 0u32..=64, t in 0u32..=64) {
        check_bound(&patch, f64::from(s) / 64.0, f64::from(t) / 64.0)?;
    }

    #[test]
    fn constant_weights_change_nothing(patch in random_patch(false), w in 0.1..10.0) {
        let rational = SplinePatch { weights: Some(vec![w; patch.points.len()]), ..patch.clone() };
        let limits = Limits { max_depth: 6, max_cells: 2000 };
        let (a, b) = (certify_patch(&patch, 1.0, &limits), certify_patch(&rational, 1.0, &limits));
        let folds = |p: &PatchProof| p.cells.first().map(|c| c.kind == CellKind::Folded);
        prop_assert_eq!(folds(&a), folds(&b));
    }
}

fn square(points: impl Fn(f64, f64) -> [f64; 2], n: usize) -> SplinePatch {
    let mut knots = vec![0.0; 2];
    knots.extend((0..=n).map(|i| i as f64 / n as f64));
    knots.extend([1.0; 2]);
    let m = n + 2;
    let grid = (0..m * m).map(|k| points((k / m) as f64 / (m - 1) as f64, (k % m) as f64 / (m - 1) as f64));
    SplinePatch {
        degrees: [2, 2],
        knots: [knots.clone(), knots],
        shape: [m, m],
        points: grid.collect(),
        weights: None,
    }
}

#[test]
fn bounds_are_small() {
    let jacobian_of = square(|u, v| [u + 0.1 * (3.0 * v).sin(), v], 4);
    let jacobian = PatchDeterminant::new(&jacobian_of);
    let det = jacobian.piece([1, 2], 1.0).det;
    assert!(det.err < 2e-13 * det.magnitude(), "{:e}", det.err / det.magnitude());
}

#[test]
fn threads_do_not_change_the_result() {
    let bump = |u: f64, v: f64| [u + 0.16 * (9.0 * v).sin(), v + 0.11 * (8.0 * u).cos()];
    let patches: Vec<_> = (4..12).map(|n| square(bump, n)).collect();
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| certify_patches(&patches, &[1.0; 8], &Limits::default()))
    };
    assert_eq!(run(1), run(4));
}

#[test]
fn a_collapsed_patch_ends_undecided_within_the_budget() {
    let proof = certify_patch(&square(|u, v| [u + v, u + v], 3), 1.0, &Limits::default());
    assert!(!proof.cells.is_empty() && proof.cells.iter().all(|c| c.kind == CellKind::Undecided));
    assert!(proof.subdivisions < 60_000 && proof.cells.len() <= REPORTED);
}

#[test]
fn a_corner_below_straight_is_not_degenerate() {
    let corner = |x: f64| SplinePatch {
        degrees: [1, 1],
        knots: [vec![0.0, 0.0, 1.0, 1.0], vec![0.0, 0.0, 1.0, 1.0]],
        shape: [2, 2],
        points: vec![[x, x], [0.0, 1.0], [1.0, 0.0], [1.0, 1.0]],
        weights: None,
    };
    let kind =
        |x: f64| certify_patch(&corner(x), 1.0, &Limits::default()).cells.first().map(|c| (c.kind, c.value));
    assert_eq!(kind(0.5), Some((CellKind::Degenerate, 0.0)));
    assert!(matches!(kind(0.5f64.next_up()), Some((CellKind::BelowRounding, x)) if x < 0.0));
    assert!(matches!(kind(0.5f64.next_down()), Some((CellKind::Degenerate, x)) if x >= 0.0));
    assert_eq!(kind(0.25), None);
    assert_eq!(kind(0.75).unwrap().0, CellKind::Folded);
}

#[test]
fn numbers_without_bounds_prove_nothing() {
    // Overflow and knots of any size: never a proof by accident, and never a hang.
    for scale in [1e-320, 1e-200, 1e150, 1e300] {
        for range in [1e-320, 1e-200, 1.0, 1e200, 1e308] {
            let mut patch = square(|u, v| [u, v], 3);
            patch.points.iter_mut().flatten().for_each(|x| *x *= scale);
            patch.knots.iter_mut().flatten().for_each(|t| *t *= range);
            if patch.knots[0].windows(4).skip(2).any(|w| w[0] == w[2]) {
                continue;
            }
            let proof = certify_patch(&patch, 1.0, &Limits { max_depth: 4, ..Limits::default() });
            assert!(proof.cells.iter().all(|c| c.kind != CellKind::Folded), "{scale:e} {range:e}");
            let mut folded = patch.clone();
            folded.points.swap(6, 8);
            let proof = certify_patch(&folded, 1.0, &Limits { max_depth: 4, ..Limits::default() });
            assert!(!proof.cells.is_empty(), "{scale:e} {range:e}");
        }
    }
}
