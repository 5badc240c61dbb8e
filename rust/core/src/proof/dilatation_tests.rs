use proptest::prelude::*;

use super::*;

fn patch(degree: usize, points: Vec<[f64; 2]>, weights: Option<Vec<f64>>) -> SplinePatch {
    let knots = || [vec![0.0; degree + 1], vec![1.0; degree + 1]].concat();
    SplinePatch { degrees: [degree; 2], knots: [knots(), knots()], shape: [degree + 1; 2], points, weights }
}

fn compared(s: &SplinePatch, t: &SplinePatch) -> Comparison {
    let one = std::slice::from_ref;
    compare(one(s), one(t), [&[1.0], &[1.0]], 1e-3)
}

/// Control points of a patch of degree 2 or more about the unit square, moved by `moves`.
fn wobbly(degree: usize, moves: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let n = degree + 1;
    let place = |k: usize, c: usize| if c == 0 { k / n } else { k % n } as f64 / degree as f64;
    (0..n * n).map(|k| [0, 1].map(|c| place(k, c) + 0.15 * moves[k][c] / degree as f64)).collect()
}

fn moves() -> impl Strategy<Value = Vec<[f64; 2]>> {
    prop::collection::vec([-1.0..1.0f64, -1.0..1.0], 9)
}

fn weights() -> impl Strategy<Value = Option<Vec<f64>>> {
    prop::option::of(prop::collection::vec(0.7..1.4f64, 9))
}

/// Degree 2 control points of (x + iy)² on [1, 2] x [0, 1], which is conformal, and of the square itself.
fn square_and_its_square() -> [SplinePatch; 2] {
    let blossom = |a: [f64; 2], b: [f64; 2]| [a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]];
    let ends = |k: usize| [[0.0, 0.0], [0.0, 1.0], [1.0, 1.0]][k];
    let grid = (0..3).flat_map(|i| (0..3).map(move |j| (ends(i), ends(j))));
    // The blossom of z² in u and v apart: the mean over both ways to pair their arguments.
    let squared = grid
        .clone()
        .map(|(u, v)| {
            let z = |a: f64, b: f64| [1.0 + a, b];
            let (one, two) = (blossom(z(u[0], v[0]), z(u[1], v[1])), blossom(z(u[0], v[1]), z(u[1], v[0])));
            [0.5 * (one[0] + two[0]), 0.5 * (one[1] + two[1])]
        })
        .collect();
    let plain = grid.map(|(u, v)| [1.0 + 0.5 * (u[0] + u[1]), 0.5 * (v[0] + v[1])]).collect();
    [patch(2, plain, None), patch(2, squared, None)]
}

#[test]
fn a_conformal_map_has_no_dilatation_but_sizes() {
    let [s, t] = square_and_its_square();
    let found = compared(&s, &t);
    assert!(found.log_dilatation.upper < 1e-12, "{:?}", found.log_dilatation);
    // |2z|² runs from 4 to 20.
    let wanted = [4.0_f64.ln(), 20.0_f64.ln()];
    for (bounds, value) in found.size.iter().zip(wanted) {
        assert!(bounds.lower <= value && value <= bounds.upper && bounds.upper - bounds.lower < 2e-3);
    }
    assert_eq!(found.samples.len(), 25);
    assert!(found.samples.iter().all(|d| *d < 1e-12));
}

#[test]
fn a_stretch_is_its_factor_squared_in_all_units() {
    for scale in [1.0, 1e-150, 1e150] {
        let square = |x: f64, y: f64| patch(1, vec![[0.0, 0.0], [0.0, y], [x, 0.0], [x, y]], None);
        let found = compared(&square(2.0, 1.0), &square(2.6 * scale, scale / 1.3));
        let wanted = 2.0 * 1.3_f64.ln();
        let bounds = found.log_dilatation;
        assert!(bounds.lower <= wanted && wanted <= bounds.upper && bounds.upper - bounds.lower < 1e-13);
        assert!((found.size[0].lower - 2.0 * scale.ln()).abs() < 1e-9);
        assert!((found.samples[7] - wanted).abs() < 1e-13);
        assert_eq!(found.cells, 0);
    }
}

proptest! {
    #[test]
    fn samples_are_below_and_the_value_is_taken(a in moves(), b in moves(), v in weights(), w in weights()) {
        let (s, t) = (patch(2, wobbly(2, &a), v), patch(2, wobbly(2, &b), w));
        let found = compared(&s, &t);
        let bounds = found.log_dilatation;
        let largest = found.samples.iter().copied().fold(0.0, f64::max);
        prop_assert!(largest <= bounds.upper + 1e-12);
        prop_assert!(bounds.lower <= bounds.upper && bounds.lower + 1.1e-3 >= bounds.upper);
        prop_assert!(found.size[0].lower <= found.size[1].upper);
        // The other way round it is the same, and sizes are the reciprocal ones.
        let back = compared(&t, &s);
        prop_assert!(back.log_dilatation.lower <= bounds.upper && bounds.lower <= back.log_dilatation.upper);
        prop_assert!((back.size[0].lower + found.size[1].upper).abs() < 1e-9);
    }

    #[test]
    fn turning_the_plane_over_changes_nothing(a in moves(), b in moves()) {
        let (s, t) = (patch(2, wobbly(2, &a), None), patch(2, wobbly(2, &b), None));
        let mirrored = patch(2, t.points.iter().map(|p| [-p[0], p[1]]).collect(), None);
        let one = std::slice::from_ref;
        let found = compare(one(&s), one(&mirrored), [&[1.0], &[-1.0]], 1e-3);
        let wanted = compared(&s, &t);
        prop_assert!((found.log_dilatation.upper - wanted.log_dilatation.upper).abs() < 1e-12);
        prop_assert!((found.size[1].upper - wanted.size[1].upper).abs() < 1e-12);
    }

    #[test]
    fn a_similar_shape_is_at_distance_zero(a in moves(), w in weights(), angle in 0.0..7.0f64) {
        let s = patch(2, wobbly(2, &a), w);
        let (c, k) = (3.0 * angle.cos(), 3.0 * angle.sin());
        let t = SplinePatch {
            points: s.points.iter().map(|[x, y]| [c * x - k * y + 5.0, k * x + c * y - 1.0]).collect(),
            ..s.clone()
        };
        let found = compared(&s, &t);
        // Products of rational tangents have twice the degree, and as many more roundings.
        let rounding = if s.weights.is_some() { 2e-11 } else { 1e-12 };
        prop_assert!(found.log_dilatation.upper < rounding, "{:?}", found.log_dilatation);
        prop_assert!((found.size[1].upper - found.size[0].lower) < 2.1e-3);
    }
}
