use proptest::prelude::*;

use super::*;
use crate::spline::{basis_on_span, spans};

fn bezier(points: &[[f64; 2]]) -> SplineCurve {
    let p = points.len() - 1;
    let knots = [vec![0.0; p + 1], vec![1.0; p + 1]].concat();
    SplineCurve { degree: p, knots, points: points.to_vec(), weights: None }
}

fn at(curve: &SplineCurve, t: f64) -> [f64; 2] {
    let p = curve.degree;
    let k = *spans(&curve.knots, p).iter().rev().find(|&&k| curve.knots[k] <= t).unwrap();
    let (mut v, mut d) = (vec![0.0; p + 1], vec![0.0; p + 1]);
    basis_on_span(&curve.knots, p, k, t, &mut v, &mut d);
    let w = |a: usize| v[a] * curve.weights.as_ref().map_or(1.0, |w| w[k - p + a]);
    let total: f64 = (0..=p).map(w).sum();
    [0, 1].map(|c| (0..=p).map(|a| w(a) * curve.points[k - p + a][c]).sum::<f64>() / total)
}

/// A closed chain of cubic Bézier curves, their end points `ends`, inner control points off by `inner`.
fn chain(ends: &[[f64; 2]], inner: &[[f64; 4]]) -> Vec<SplineCurve> {
    let n = ends.len();
    (0..n)
        .map(|i| {
            let (a, b, d) = (ends[i], ends[(i + 1) % n], inner[i]);
            let mix = |s: f64, c: usize| a[c] * (1.0 - s) + b[c] * s;
            bezier(&[
                a,
                [mix(0.33, 0) + d[0], mix(0.33, 1) + d[1]],
                [mix(0.67, 0) + d[2], mix(0.67, 1) + d[3]],
                b,
            ])
        })
        .collect()
}

fn polygon(n: usize, radius: f64, centre: [f64; 2], clockwise: bool) -> Vec<SplineCurve> {
    let point = |i: usize| {
        let angle = (i % n) as f64 / n as f64 * std::f64::consts::TAU * if clockwise { -1.0 } else { 1.0 };
        [centre[0] + radius * angle.cos(), centre[1] + radius * angle.sin()]
    };
    (0..n).map(|i| bezier(&[point(i), point(i + 1)])).collect()
}

/// A quarter of the unit circle about `centre`, turned by `quarter` right angles.
fn arc(centre: [f64; 2], radius: f64, quarter: i32) -> SplineCurve {
    let turn = |x: f64, y: f64| match quarter.rem_euclid(4) {
        0 => [x, y],
        1 => [-y, x],
        2 => [-x, -y],
        _ => [y, -x],
    };
    let points = [turn(1.0, 0.0), turn(1.0, 1.0), turn(0.0, 1.0)]
        .map(|p| [centre[0] + radius * p[0], centre[1] + radius * p[1]]);
    SplineCurve { weights: Some(vec![1.0, 0.5f64.sqrt(), 1.0]), ..bezier(&points) }
}

/// Crossings of the sampled polygons, brute force.
fn sampled_crossings(loops: &[Vec<SplineCurve>], n: usize) -> usize {
    let polygons: Vec<Vec<[f64; 2]>> = loops
        .iter()
        .map(|l| l.iter().flat_map(|c| (0..n).map(|i| at(c, i as f64 / n as f64))).collect())
        .collect();
    let side =
        |a: [f64; 2], b: [f64; 2], p: [f64; 2]| (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]);
    let segments: Vec<(usize, usize, [f64; 2], [f64; 2])> = polygons
        .iter()
        .enumerate()
        .flat_map(|(k, p)| (0..p.len()).map(move |i| (k, i, p[i], p[(i + 1) % p.len()])))
        .collect();
    // Rounding makes sides of collinear segments non-zero; true crossings of this size are far above.
    let opposite = |x: f64, y: f64| x * y < 0.0 && x.abs().min(y.abs()) > 1e-15;
    let mut count = 0;
    for (x, &(k, i, a, b)) in segments.iter().enumerate() {
        for &(m, j, c, d) in &segments[x + 1..] {
            let near = k == m && (i.abs_diff(j) <= 1 || i.abs_diff(j) == polygons[k].len() - 1);
            if !near && opposite(side(a, b, c), side(a, b, d)) && opposite(side(c, d, a), side(c, d, b)) {
                count += 1;
            }
        }
    }
    count
}

fn check_against_samples(loops: &[Vec<SplineCurve>]) -> Result<(), TestCaseError> {
    let proof = check_loops(loops);
    for m in &proof.meetings {
        prop_assert!(m.kind == MeetingKind::Crossing, "generic loops are decided: {m:?}");
        let (a, b) =
            (at(&loops[m.a.loop_index][m.a.curve], m.a.t), at(&loops[m.b.loop_index][m.b.curve], m.b.t));
        prop_assert!((a[0] - b[0]).hypot(a[1] - b[1]) < 1e-8, "{m:?} is no crossing: {a:?} {b:?}");
    }
    prop_assert!(!proof.meetings.is_empty() || sampled_crossings(loops, 150) == 0);
    Ok(())
}

fn pairs(n: usize) -> impl Strategy<Value = Vec<[f64; 2]>> {
    proptest::collection::vec(proptest::array::uniform2(-1.0..1.0), n)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]
    #[test]
    fn wild_loops_agree_with_samples(ends in pairs(4), inner in proptest::collection::vec(proptest::array::uniform4(-0.3..0.3), 4)) {
        check_against_samples(&[chain(&ends, &inner)])?;
    }

    #[test]
    fn tame_loops_agree_with_samples(radii in proptest::collection::vec(0.4f64..1.0, 6), inner in proptest::collection::vec(proptest::array::uniform4(-0.15..0.15), 6), hole in 0.05..0.5) {
        let ends: Vec<[f64; 2]> = radii.iter().enumerate().map(|(i, r)| {
            let (s, c) = (i as f64 * std::f64::consts::TAU / 6.0).sin_cos();
            [r * c, r * s]
        }).collect();
        let loops = [chain(&ends, &inner), polygon(7, hole, [0.05, -0.02], true)];
        check_against_samples(&loops)?;
        let proof = check_loops(&loops);
        if proof.meetings.is_empty() {
            prop_assert_eq!(proof.orientation, vec![1, -1]);
            prop_assert_eq!(proof.around, vec![Some(vec![]), Some(vec![0])]);
        }
    }
}

#[test]
fn circles_of_quarter_arcs() {
    let circle = |c, r| (0..4).map(|q| arc(c, r, q)).collect::<Vec<_>>();
    let apart =
        check_loops(&[circle([0.0, 0.0], 2.0), circle([0.5, 0.0], 1.0), circle([0.5, 0.0], 0.999_999)]);
    assert!(apart.meetings.is_empty(), "{:?}", apart.meetings);
    assert_eq!(apart.orientation, vec![1, 1, 1]);
    assert_eq!(apart.around, vec![Some(vec![]), Some(vec![0]), Some(vec![0, 1])]);
    let crossing = check_loops(&[circle([0.0, 0.0], 1.0), circle([1.0, 0.3], 1.0)]);
    assert_eq!(crossing.meetings.len(), 2);
    assert!(crossing.meetings.iter().all(|m| m.kind == MeetingKind::Crossing));
    let touching = check_loops(&[circle([0.0, 0.0], 1.0), circle([2.0, 0.0], 1.0)]);
    assert!(!touching.meetings.is_empty());
    assert!(touching.meetings.iter().all(|m| m.kind == MeetingKind::Near));
    assert!((touching.meetings[0].point[0] - 1.0).abs() < 1e-6);
}

#[test]
fn crossings_at_joints_and_middles_are_found() {
    // A figure eight of straight lines that cross in the middle of both, and one that crosses at a joint.
    let line = |a, b| bezier(&[a, b]);
    let p = [[0.0, 0.0], [2.0, 2.0], [2.0, 0.0], [0.0, 2.0], [1.0, 1.0]];
    let eight = vec![line(p[0], p[1]), line(p[1], p[2]), line(p[2], p[3]), line(p[3], p[0])];
    let joint =
        vec![line(p[0], p[4]), line(p[4], p[1]), line(p[1], p[2]), line(p[2], p[3]), line(p[3], p[0])];
    for curves in [eight, joint] {
        let proof = check_loops(&[curves]);
        assert_eq!(proof.meetings.len(), 1, "{:?}", proof.meetings);
        assert_eq!(proof.meetings[0].kind, MeetingKind::Crossing);
        assert!(proof.meetings[0].point.iter().all(|x| (x - 1.0).abs() < 1e-8));
    }
}

#[test]
fn cusps_and_coincident_lines_stay_undecided() {
    let line = |a, b| bezier(&[a, b]);
    let spike = vec![
        line([0.0, 0.0], [1.0, 0.0]),
        line([1.0, 0.0], [0.5, 0.0]),
        line([0.5, 0.0], [0.0, 1.0]),
        line([0.0, 1.0], [0.0, 0.0]),
    ];
    let proof = check_loops(&[spike]);
    assert!(proof.meetings.iter().any(|m| m.kind == MeetingKind::Cusp));
    assert!(proof.meetings.iter().all(|m| m.kind != MeetingKind::Crossing));
}

#[test]
fn thousands_of_curves_close_together_are_separated() {
    let proof = check_loops(&[polygon(8000, 1.0, [0.0, 0.0], false), polygon(8000, 0.999, [0.0, 0.0], true)]);
    assert!(proof.meetings.is_empty());
    assert_eq!(proof.orientation, vec![1, -1]);
    assert_eq!(proof.arcs, 16_000);
}

#[test]
fn an_axis_of_subnormals_separates_nothing() {
    // Points that differ by the smallest subnormal give an axis along which all products round to multiples of it.
    let tiny = f64::from_bits(1);
    let hull = |points: &[[f64; 2]]| Hull { points: points.to_vec(), err: 0.0, reach: 1.0 };
    let a = hull(&[[-1.0, -1.0], [1e-307, -1e-307], [1e-307 + tiny, -1e-307 - tiny], [1.0, 1.0]]);
    let b = hull(&[[0.145, -0.005], [0.155, 0.005], [0.0, 0.126]]);
    assert!(!a.separated(&b, &Budget::new(2)));
    assert!(!b.separated(&a, &Budget::new(2)));
}

#[test]
fn nearly_vanishing_slopes_end_at_once() {
    // The first control points agree, but not to the bit: on a part of fixed length the slope is lost in rounding.
    for degree in 3..=9 {
        let mut points = vec![[0.0, 0.0]];
        points.extend((1..degree).map(|i| [1e-17 * i as f64, 1e-17]));
        points.push([1.0, 0.5]);
        let rest = [bezier(&[[1.0, 0.5], [0.0, 1.0]]), bezier(&[[0.0, 1.0], [0.0, 0.0]])];
        let proof = check_loops(&[[vec![bezier(&points)], rest.to_vec()].concat()]);
        assert!(proof.arcs < 500, "degree {degree}: {} arcs", proof.arcs);
        assert!(proof.meetings.iter().all(|m| m.kind != MeetingKind::Crossing));
    }
}

#[test]
fn crossings_are_looked_for_up_to_a_number() {
    let mut seed = 1u64;
    let mut random = || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 11) as f64 / (1u64 << 53) as f64
    };
    let points: Vec<[f64; 2]> = (0..400).map(|_| [random(), random()]).collect();
    let noise = (0..400).map(|i| bezier(&[points[i], points[(i + 1) % 400]])).collect();
    let proof = check_loops(&[noise]);
    let crossings = proof.meetings.iter().filter(|m| m.kind == MeetingKind::Crossing).count();
    assert_eq!(crossings, MAX_CROSSINGS);
}

#[test]
fn a_curve_that_is_retraced_ends_within_its_budget() {
    // There and back through the same thousands of points: nothing can be told apart, and nothing crosses.
    let there: Vec<[f64; 2]> = (0..3000).map(|i| [i as f64 / 3000.0, (i as f64 * 0.01).sin()]).collect();
    let points: Vec<[f64; 2]> = there.iter().chain(there.iter().rev()).copied().collect();
    let n = points.len();
    let curves = (0..n).filter(|&i| points[i] != points[(i + 1) % n]);
    let proof = check_loops(&[curves.map(|i| bezier(&[points[i], points[(i + 1) % n]])).collect()]);
    assert!(!proof.meetings.is_empty());
    assert!(proof.meetings.iter().all(|m| m.kind != MeetingKind::Crossing));
    assert!(proof.arcs < 50_000);
}

#[test]
fn knots_that_nearly_coincide_do_not_part_a_boundary() {
    for gap in [1, 2, 100, 1 << 20, 1 << 40] {
        let second = f64::from_bits(0.3f64.to_bits() + gap);
        let knots = [vec![0.0; 3], vec![0.3, second], vec![1.0; 3]].concat();
        let greville = |i: usize| 0.5 * (knots[i + 1] + knots[i + 2]);
        let side = |a: [f64; 2], b: [f64; 2]| SplineCurve {
            degree: 2,
            knots: knots.clone(),
            points: (0..5).map(|i| [0, 1].map(|d| a[d] + greville(i) * (b[d] - a[d]))).collect(),
            weights: None,
        };
        let ends = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        let proof = check_loops(&[(0..4).map(|i| side(ends[i], ends[(i + 1) % 4])).collect()]);
        assert!(proof.meetings.is_empty(), "gap of {gap} ulps: {:?}", proof.meetings);
        assert_eq!(proof.orientation, vec![1]);
    }
}

#[test]
fn numbers_without_bounds_are_not_called_simple() {
    // Weights that drown all but one: no hull is known, and two squares that overlap are not called apart.
    let square = |x: f64, w: f64| {
        let ends = [[x, 0.0], [x + 1.0, 0.0], [x + 1.0, 1.0], [x, 1.0]];
        (0..4)
            .map(|i| {
                let middle = [0, 1].map(|d| 0.5 * (ends[i][d] + ends[(i + 1) % 4][d]));
                let curve = bezier(&[ends[i], middle, ends[(i + 1) % 4]]);
                SplineCurve { weights: Some(vec![1.0, w, 1.0]), ..curve }
            })
            .collect::<Vec<_>>()
    };
    for w in [1e-300, 1e-17, 1.0, 1e17, 1e300] {
        assert!(!check_loops(&[square(0.0, w), square(0.5, w)]).meetings.is_empty(), "{w:e}");
    }
}
