use super::*;

/// A quarter of a ring as a biquadratic NURBS with `spans` spans a direction, radii 1 and 2; exact circles.
fn ring(quarters: std::ops::Range<i32>) -> Vec<SplinePatch> {
    quarters
        .map(|q| {
            let turn = |p: [f64; 2]| match q.rem_euclid(4) {
                0 => p,
                1 => [-p[1], p[0]],
                2 => [-p[0], -p[1]],
                _ => [p[1], -p[0]],
            };
            let corner = [[1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
            let points = [1.0, 2.0].iter().flat_map(|r| corner.map(|p| turn(p.map(|x| x * r)))).collect();
            let half = 0.5_f64.sqrt();
            SplinePatch {
                degrees: [1, 2],
                knots: [vec![0.0, 0.0, 1.0, 1.0], vec![3.0, 3.0, 3.0, 4.0, 4.0, 4.0]],
                shape: [2, 3],
                points,
                weights: Some(vec![1.0, half, 1.0, 1.0, half, 1.0]),
            }
        })
        .collect()
}

/// `n`² bicubic spans, bent by `size`, on the square [0, n]².
fn bent(n: usize, size: f64) -> SplinePatch {
    let knots: Vec<f64> =
        [0.0; 3].into_iter().chain((0..=n).map(|i| i as f64)).chain([n as f64; 3]).collect();
    let m = n + 3;
    let at: Vec<f64> = (0..m).map(|i| knots[i + 1..i + 4].iter().sum::<f64>() / 3.0).collect();
    let points = (0..m * m).map(|k| [at[k / m], at[k % m]]);
    let points = points.map(|[u, v]| [u + size * (1.3 * v).sin(), v + size * (1.1 * u).cos()]).collect();
    SplinePatch { degrees: [3, 3], knots: [knots.clone(), knots], shape: [m, m], points, weights: None }
}

/// Point of a patch, by the whole basis.
fn value(patch: &SplinePatch, at: [f64; 2]) -> [f64; 2] {
    let along = |d: usize| {
        let n = patch.shape[d];
        let unit: Vec<f64> = (0..n * n).map(|k| f64::from(u8::from(k / n == k % n))).collect();
        crate::spline::evaluate(&patch.knots[d], patch.degrees[d], &unit, n, &[at[d]], 0)
    };
    let (u, v, mut sum) = (along(0), along(1), [0.0; 3]);
    for (k, p) in patch.points.iter().enumerate() {
        let b = u[k / patch.shape[1]] * v[k % patch.shape[1]] * patch.weights.as_ref().map_or(1.0, |w| w[k]);
        sum = [sum[0] + b * p[0], sum[1] + b * p[1], sum[2] + b];
    }
    [sum[0] / sum[2], sum[1] / sum[2]]
}

fn grid(patch: &SplinePatch, n: usize) -> Vec<[f64; 2]> {
    let along = |d: usize| {
        let (first, last) = (patch.knots[d][0], patch.knots[d][patch.knots[d].len() - 1]);
        (0..=n).map(move |i| first + (last - first) * i as f64 / n as f64)
    };
    along(0).flat_map(|u| along(1).map(move |v| [u, v])).collect()
}

#[test]
fn points_of_a_patch_are_found_where_they_are() {
    for patch in [bent(1, 0.3), bent(4, 0.5), bent(9, 0.6), ring(0..1).remove(0)] {
        let at = grid(&patch, 37);
        let points: Vec<[f64; 2]> = at.iter().map(|&at| value(&patch, at)).collect();
        let found = Locator::new(std::slice::from_ref(&patch)).locate(&points, 0.0);
        for (at, found) in at.iter().zip(found) {
            let place = found.unwrap_or_else(|| panic!("{at:?} is not found"));
            assert!((0..2).all(|d| (place.at[d] - at[d]).abs() < 1e-12), "{at:?} is found at {:?}", place.at);
        }
    }
}

#[test]
fn points_of_an_interface_belong_to_the_first_patch() {
    let patches = ring(0..4);
    let locator = Locator::new(&patches);
    for (k, patch) in patches.iter().enumerate() {
        for i in 0..=64 {
            let u = f64::from(i) / 64.0;
            let ends = [3.0, 4.0].map(|v| value(patch, [u, v]));
            let first = if k == 0 { [0, 0] } else { [k - 1, k % 3] };
            let found = locator.locate(&ends, 0.0).into_iter().map(|p| p.unwrap().patch).collect::<Vec<_>>();
            assert_eq!(found, first, "patch {k}, u = {u}");
        }
    }
}

#[test]
fn points_outside_have_no_place_but_the_nearest_within_the_tolerance() {
    let locator = Locator::new(&ring(0..4));
    for i in 0..200 {
        let angle = f64::from(i) * 0.0314159;
        for (radius, distance) in
            [(0.9, 0.1), (2.25, 0.25), (1.0 - 1e-9, 1e-9), (2.0 + 1e-13, 1e-13), (0.0, 1.0)]
        {
            let x = [radius * angle.cos(), radius * angle.sin()];
            assert_eq!(locator.locate(&[x], 0.5 * distance), [None]);
            let place = locator.locate(&[x], 1.5 * distance)[0].expect("within the tolerance");
            let y = value(&ring(0..4)[place.patch], place.at);
            let away = (x[0] - y[0]).hypot(x[1] - y[1]);
            assert!((away - distance).abs() < 1e-6 * distance + 1e-15, "{radius}: {away}");
        }
    }
}

#[test]
fn units_and_corners_without_an_angle_make_no_difference() {
    // The corner at the end of u and v is straight: det J vanishes there.
    let flat = [[0.0, 0.0], [0.0, 1.0], [1.0, 0.0], [0.5, 0.5]];
    // det J vanishes to second order at the start: B = (u², v²).
    let square = |k: usize| [f64::from(u8::from(k / 3 == 2)), f64::from(u8::from(k % 3 == 2))];
    for unit in [1.0, 1e-150, 1e150] {
        let scaled = |p: [f64; 2]| p.map(|x| x * unit);
        let linear = SplinePatch {
            degrees: [1, 1],
            knots: [vec![0.0, 0.0, 1.0, 1.0], vec![0.0, 0.0, 1.0, 1.0]],
            shape: [2, 2],
            points: flat.map(scaled).into(),
            weights: None,
        };
        let knots = || vec![0.0, 0.0, 0.0, 1.0, 1.0, 1.0];
        let quadratic = SplinePatch {
            degrees: [2, 2],
            knots: [knots(), knots()],
            shape: [3, 3],
            points: (0..9).map(|k| scaled(square(k))).collect(),
            weights: None,
        };
        for patch in [linear, quadratic] {
            let points: Vec<[f64; 2]> = grid(&patch, 64).iter().map(|&at| value(&patch, at)).collect();
            for (x, place) in
                points.iter().zip(Locator::new(std::slice::from_ref(&patch)).locate(&points, 0.0))
            {
                let y = value(&patch, place.unwrap_or_else(|| panic!("{x:?} is not found")).at);
                assert!((0..2).all(|c| (x[c] - y[c]).abs() < 1e-13 * unit));
            }
        }
    }
}
