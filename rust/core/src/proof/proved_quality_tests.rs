use proptest::prelude::*;

use super::*;

const SIZE: f64 = 1.0 / 9.0;

fn patch(degree: usize, points: Vec<[f64; 2]>, weights: Option<Vec<f64>>) -> SplinePatch {
    let knots = || [vec![0.0; degree + 1], vec![1.0; degree + 1]].concat();
    SplinePatch { degrees: [degree; 2], knots: [knots(), knots()], shape: [degree + 1; 2], points, weights }
}

fn prove(patches: &[SplinePatch], width: f64) -> ProvedQuality {
    prove_quality(patches, &vec![1.0; patches.len()], &vec![vec![]; patches.len()], SIZE, width)
}

/// A square of side 1 whose control points are off by `moves`.
fn wobbly(degree: usize, moves: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let n = degree + 1;
    let place = |k: usize, c: usize| if c == 0 { k / n } else { k % n } as f64 / degree as f64;
    (0..n * n).map(|k| [0, 1].map(|c| place(k, c) + 0.25 * moves[k][c] / degree as f64)).collect()
}

#[test]
fn a_parallelogram_has_the_sine_of_its_angle() {
    for angle in [0.1_f64, 0.7, std::f64::consts::FRAC_PI_2, 2.0] {
        let (c, s) = (angle.cos(), angle.sin());
        let found = prove(&[patch(1, vec![[0.0, 0.0], [c, s], [2.0, 0.0], [2.0 + c, s]], None)], 1e-3);
        let (sine, kappa) = (found.scaled_jacobian, found.condition_number);
        assert!(sine.lower <= s && s <= sine.upper && sine.upper - sine.lower < 1e-13, "{sine:?}");
        assert!(kappa.lower <= 2.5 / s && 2.5 / s <= kappa.upper && kappa.upper - kappa.lower < 1e-12 / s);
        assert_eq!(found.cells, 0);
    }
}

#[test]
fn a_straight_corner_is_settled_at_once_and_may_be_left_out() {
    let straight = patch(1, vec![[0.0, 0.0], [0.0, 1.0], [1.0, 0.0], [0.5, 0.5]], None);
    let found = prove(std::slice::from_ref(&straight), 1e-3);
    let bounds = |b: Bounds| (b.lower, b.upper, b.at.unwrap());
    assert_eq!(bounds(found.scaled_jacobian), (0.0, 0.0, (0, [1.0, 1.0])));
    assert_eq!(bounds(found.condition_number), (f64::INFINITY, f64::INFINITY, (0, [1.0, 1.0])));
    assert!(found.cells < 100);
    for samples in [3.0, 10.0] {
        let size = 1.0 / (samples - 1.0);
        let without = prove_quality(std::slice::from_ref(&straight), &[1.0], &[vec![3]], size, 1e-6);
        // Along the cut d is as on the nearer of its corners: at (1 - size, 1) and its mirror image.
        let (a, b) = ([1.0 - 0.5, -0.5], [-0.5 + 0.5 * size, 1.0 - 0.5 * (1.0 + size) + 0.5 * size]);
        assert!(without.scaled_jacobian.lower > 0.0 && without.condition_number.upper.is_finite());
        assert!(a[0] > 0.0 && b[1] >= 0.0);
    }
}

#[test]
fn a_fold_is_a_negative_value() {
    let folded = patch(1, vec![[0.0, 0.0], [0.0, 1.0], [1.0, 0.0], [0.3, 0.3]], None);
    let found = prove(&[folded], 1e-3);
    assert!(found.scaled_jacobian.lower == -1.0 && found.scaled_jacobian.upper < -0.5);
    assert_eq!(found.scaled_jacobian.at, Some((0, [1.0, 1.0])));
    assert_eq!(found.condition_number.lower, f64::INFINITY);
}

proptest! {
    #[test]
    fn samples_are_within_the_bounds(
        moves in prop::collection::vec([-1.0..1.0f64, -1.0..1.0], 16),
        weights in prop::option::of(prop::collection::vec(0.5..2.0f64, 16)),
        width in prop::sample::select(vec![1e-1, 1e-3, 1e-6]),
    ) {
        let patch = patch(3, wobbly(3, &moves), weights);
        let found = prove(std::slice::from_ref(&patch), width);
        let sampled = crate::spline::quality::measure(&[patch], &[1.0], 40, &[vec![]])[0];
        let (sine, kappa) = (found.scaled_jacobian, found.condition_number);
        let off = 1e-12;
        prop_assert!(sine.lower <= sampled.scaled_jacobian.min + off);
        prop_assert!(kappa.upper >= sampled.condition_number.max * (1.0 - off));
        if sine.upper > 0.0 {
            prop_assert!(sine.lower >= sine.upper * (1.0 - width));
            prop_assert!(kappa.upper * (1.0 - width) <= kappa.lower * (1.0 + off));
            // The value is one: no sample grid of this density is farther above it.
            prop_assert!(sine.upper <= sampled.scaled_jacobian.min + 1e-12 + width * sine.upper);
            prop_assert!(sine.upper >= 2.0 / kappa.upper);
        }
    }

    #[test]
    fn the_patch_with_the_extremum_decides(moves in prop::collection::vec([-1.0..1.0f64, -1.0..1.0], 16)) {
        let all = [patch(1, wobbly(1, &[[0.0; 2]; 4]), None), patch(3, wobbly(3, &moves), None)];
        let (one, both) = (prove(&all[1..], 1e-3), prove(&all, 1e-3));
        prop_assert_eq!(one.scaled_jacobian.upper, both.scaled_jacobian.upper);
        prop_assert_eq!(one.condition_number.lower, both.condition_number.lower);
    }
}
