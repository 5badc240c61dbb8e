use super::*;
use proptest::prelude::*;

fn area(points: &[[f64; 2]], t: &[usize]) -> f64 {
    (0..t.len())
        .map(|i| {
            let (p, q) = (points[t[i]], points[t[(i + 1) % t.len()]]);
            (p[0] * q[1] - p[1] * q[0]) / 2.0
        })
        .sum()
}

const SQUARE: [[f64; 2]; 4] = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];

proptest! {
    #[test]
    fn star_with_hole(radii in prop::collection::vec(0.8..1.5f64, 5..30), hole in 3usize..9,
                      exponent in -140i32..140, refine in any::<bool>()) {
        let scale = 10f64.powi(exponent);
        let circle = |i: usize, n: usize, r: f64| {
            let t = std::f64::consts::TAU * i as f64 / n as f64;
            [scale * r * t.cos(), scale * r * t.sin()]
        };
        let n = radii.len();
        let mut points: Vec<_> = radii.iter().enumerate().map(|(i, &r)| circle(i, n, r)).collect();
        points.extend((0..hole).map(|i| circle(i, hole, 0.2)));
        let loops = [(0..n).collect::<Vec<_>>(), (n..n + hole).rev().collect()];
        let refinement = refine.then_some(Refinement { min_angle: 20.0, max_area: Some(0.05 * scale * scale) });
        let mesh = triangulate(&points, &loops, refinement).unwrap();
        let expected: f64 = loops.iter().map(|l| area(&points, l)).sum();
        let areas: Vec<f64> = mesh.triangles.iter().map(|t| area(&mesh.points, t)).collect();
        prop_assert!(areas.iter().all(|&a| a > 0.0));
        prop_assert!((areas.iter().sum::<f64>() - expected).abs() < 1e-12 * expected);
        prop_assert_eq!(&mesh.points[..points.len()], &points[..]);
        if refine {
            prop_assert!(areas.iter().all(|&a| a <= 0.05 * scale * scale * (1.0 + 1e-9)));
        } else {
            // Euler: one hole.
            prop_assert_eq!(mesh.triangles.len(), points.len());
        }
        prop_assert_eq!(&mesh, &triangulate(&points, &loops, refinement).unwrap());
    }
}

/// A star with long edges around grid points: its edges cross many of the plain triangulation's.
#[test]
fn long_constraints_and_cocircular_points() {
    let outline = [
        [0.0, 0.0],
        [8.0, 3.0],
        [16.0, 0.0],
        [13.0, 8.0],
        [16.0, 16.0],
        [8.0, 13.0],
        [0.0, 16.0],
        [3.0, 8.0],
    ];
    let crown: Vec<usize> = (0..8).collect();
    let mut points = outline.to_vec();
    for (i, j) in (1..64).flat_map(|i| (1..64).map(move |j| (i, j))) {
        let p = [f64::from(i) / 4.0, f64::from(j) / 4.0];
        let edges = (0..8).map(|k| [outline[k], outline[(k + 1) % 8]]);
        // A ray to the right; a point on an edge's line is on neither side and left out.
        let side = |[a, b]: [[f64; 2]; 2]| area(&[p, a, b], &[0, 1, 2]);
        let crossed = edges
            .clone()
            .filter(|&[a, b]| (a[1] > p[1]) != (b[1] > p[1]) && (side([a, b]) > 0.0) == (b[1] > a[1]));
        if crossed.count() % 2 == 1 && edges.clone().all(|e| side(e) != 0.0) {
            points.push(p);
        }
    }
    let mesh = triangulate(&points, std::slice::from_ref(&crown), None).unwrap();
    let total: f64 = mesh.triangles.iter().map(|t| area(&points, t)).sum();
    assert_eq!(total, area(&points, &crown));
    assert_eq!(mesh.triangles.len(), 2 * points.len() - 2 - 8);
    // Quarter-integers: the determinants below are exact.
    for t in &mesh.triangles {
        for (k, opposite) in t.iter().enumerate() {
            let (a, b) = (t[(k + 1) % 3], t[(k + 2) % 3]);
            let beyond = mesh.triangles.iter().find_map(|u| {
                let at = (0..3).find(|&i| u[i] == b && u[(i + 1) % 3] == a)?;
                Some(u[(at + 2) % 3])
            });
            let Some(beyond) = beyond else {
                assert!(a < 8 && b < 8, "an edge of the boundary is no constraint");
                continue;
            };
            let [p, q, r] = [a, b, *opposite].map(|v| {
                let d = [points[v][0] - points[beyond][0], points[v][1] - points[beyond][1]];
                [d[0], d[1], d[0] * d[0] + d[1] * d[1]]
            });
            let determinant = p[0] * (q[1] * r[2] - q[2] * r[1]) - p[1] * (q[0] * r[2] - q[2] * r[0])
                + p[2] * (q[0] * r[1] - q[1] * r[0]);
            assert!(determinant <= 0.0, "{beyond} lies in the circle of {t:?}");
        }
    }
}

#[test]
fn islands_in_holes() {
    let square = |c: f64| [[-c, -c], [c, -c], [c, c], [-c, c]];
    let points: Vec<[f64; 2]> = (1..=4).rev().flat_map(|c| square(f64::from(c))).collect();
    let loops: Vec<Vec<usize>> = (0..4)
        .map(|k| {
            let corners = 4 * k..4 * k + 4;
            if k % 2 == 0 { corners.collect() } else { corners.rev().collect() }
        })
        .collect();
    let mesh = triangulate(&points, &loops, None).unwrap();
    assert_eq!(mesh.triangles.iter().map(|t| area(&points, t)).sum::<f64>(), 64.0 - 36.0 + 16.0 - 4.0);
}

#[test]
fn reports_what_is_wrong() {
    use TriangulationError::*;
    let with = |extra: &[[f64; 2]], loops: &[Vec<usize>]| {
        let mut points = SQUARE.to_vec();
        points.extend(extra);
        triangulate(&points, loops, None).unwrap_err()
    };
    let outer = vec![0, 1, 2, 3];
    let crossing = with(&[], &[vec![0, 2, 1, 3]]);
    assert!(matches!(crossing, CrossingConstraints { a, b } if a != b), "{crossing:?}");
    assert_eq!(with(&[[2.0, 0.5]], std::slice::from_ref(&outer)), PointOutside { point: 4 });
    assert_eq!(with(&[[0.0, -0.0]], std::slice::from_ref(&outer)), DuplicatePoints { a: 0, b: 4 });
    // Apart by less than the exact predicates can hold.
    assert_eq!(
        with(&[[0.5, 0.0], [0.5, 1e-50]], std::slice::from_ref(&outer)),
        DuplicatePoints { a: 4, b: 5 }
    );
    assert_eq!(
        with(&[[0.5, 0.0]], std::slice::from_ref(&outer)),
        PointOnConstraint { point: 4, edge: [0, 1] }
    );
    assert_eq!(with(&[[f64::NAN, 0.0]], std::slice::from_ref(&outer)), NotFinite { point: 4 });
    assert_eq!(with(&[], &[vec![3, 2, 1, 0]]), WrongOrientation { index: 0 });
    assert_eq!(with(&[], &[vec![0, 1]]), ShortLoop { index: 0, length: 2 });
    assert_eq!(with(&[], &[vec![0, 1, 9]]), UnknownPoint { index: 0, point: 9 });
    assert_eq!(with(&[], &[vec![0, 1, 2, 0]]), RepeatedPoint { point: 0 });
    let inner = [[0.4, 0.4], [0.6, 0.4], [0.5, 0.6]];
    assert_eq!(with(&inner, &[outer, vec![4, 5, 6]]), WrongOrientation { index: 1 });
}
