use proptest::prelude::*;

use super::super::test_domains::{Domain, annulus, disk, l_shape, polygon, square, twisted};
use super::*;

fn field(domain: &Domain) -> (LayoutMesh, CrossField) {
    let mesh = domain.mesh(0.004);
    let field = cross_field(&mesh, &domain.corners, &[]).unwrap();
    (mesh, field)
}

/// Indices of singularities, sorted, and whether the outline has the wanted quads everywhere.
fn found(domain: &Domain) -> (Vec<i64>, bool) {
    let (_, field) = field(domain);
    let n = domain.points.len();
    let mut wanted = vec![2; n];
    domain.corners.iter().for_each(|c| wanted[c.vertex] = c.quads as i64);
    let mut singular: Vec<i64> = field.index[n..].iter().copied().filter(|&i| i != 0).collect();
    singular.sort_unstable();
    (singular, field.index[..n] == wanted)
}

#[test]
fn indices_of_known_domains() {
    assert_eq!(found(&square()), (vec![], true));
    assert_eq!(found(&l_shape()), (vec![], true));
    assert_eq!(found(&annulus()), (vec![], true));
    assert_eq!(found(&disk()), (vec![1; 4], true));
    assert_eq!(found(&twisted(0.3)), (vec![], true));
    let triangle = [[0.0, 0.0], [1.0, 0.0], [0.5, 0.8]];
    assert_eq!(
        found(&Domain::new(&[polygon(&triangle, 16)], &[(0, 0, 1), (0, 16, 1), (0, 32, 1)])),
        (vec![1], true)
    );
}

#[test]
fn crosses_of_a_square_are_parallel_to_it() {
    let (_, field) = field(&square());
    assert!(field.theta.iter().all(|&t| remainder(t).abs() < 1e-9));
}

#[test]
fn indices_do_not_depend_on_direction_and_size() {
    for domain in [l_shape(), disk(), twisted(0.3)] {
        let index = field(&domain).1.index;
        for (angle, scale) in [(37.0_f64.to_radians(), 1.0), (0.0, 1e-3), (1.0, 1e3)] {
            let mesh = domain.turned(angle, scale).mesh(0.004 * scale * scale);
            assert_eq!(cross_field(&mesh, &domain.corners, &[]).unwrap().index, index);
        }
    }
}

#[test]
fn a_group_of_nothing_but_the_identity_changes_nothing() {
    let domain = l_shape();
    let (mesh, alone) = field(&domain);
    let identity = |edges| Isometry { source: (0..edges).collect(), phase: [1.0, 0.0], conjugate: false };
    let edges = mesh.adjacency.edges.len();
    let averaged = cross_field(&mesh, &domain.corners, &[identity(edges)]).unwrap();
    assert_eq!(averaged.index, alone.index);
    assert!(averaged.theta.iter().zip(&alone.theta).all(|(a, b)| remainder(a - b).abs() < 1e-3));
    let error = cross_field(&mesh, &domain.corners, &[identity(edges), identity(edges - 1)]).unwrap_err();
    assert_eq!(error, CrossFieldError::Isometry { isometry: 1, edges });
}

#[test]
fn a_reflection_and_its_mirror_image_agree() {
    // The mesh is mirrored in the diagonal x = y by hand: vertices of a grid.
    let n = 9;
    let points: Vec<[f64; 2]> = (0..n * n).map(|k| [(k / n) as f64, (k % n) as f64]).collect();
    let at = |i: usize, j: usize| i * n + j;
    let triangles: Vec<[usize; 3]> = (0..n - 1)
        .flat_map(|i| (0..n - 1).map(move |j| (i, j)))
        .flat_map(|(i, j)| {
            let (a, b, c, d) = (at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
            [[a, b, c], [a, c, d]]
        })
        .collect();
    let mesh = LayoutMesh::new(points, triangles).unwrap();
    let edges = &mesh.adjacency.edges;
    let mirrored = |v: usize| at(v % n, v / n);
    let source = edges
        .iter()
        .map(|e| {
            let [a, b] = e.map(mirrored);
            edges.binary_search(&[a.min(b), a.max(b)]).unwrap()
        })
        .collect();
    // exp(8iβ) for β = 45°.
    let mirror = Isometry { source, phase: [1.0, 0.0], conjugate: true };
    let three = [at(0, 0), at(n - 1, 0), at(0, n - 1)].map(|vertex| Corner { vertex, quads: 1 });
    let far = Corner { vertex: at(n - 1, n - 1), quads: 2 };
    let corners = [three.as_slice(), &[far]].concat();
    let field = cross_field(&mesh, &corners, &[mirror]).unwrap();
    for v in 0..n * n {
        assert_eq!(field.index[v], field.index[mirrored(v)]);
    }
    assert_eq!(field.index[at(n - 1, n - 1)], 2);
}

#[test]
fn refuses_corners_inside() {
    let mesh = square().mesh(0.01);
    let vertex = mesh.points.len() - 1;
    let error = cross_field(&mesh, &[Corner { vertex, quads: 1 }], &[]).unwrap_err();
    assert_eq!(error, CrossFieldError::CornerInside { vertex });
}

#[test]
fn refuses_crosses_that_leave_the_outline() {
    let (mesh, mut field) = field(&square());
    let face = mesh.adjacency.ring(4).next().unwrap().face;
    field.theta[face] += 0.3;
    assert!(matches!(indices(&mesh, &field.theta), Err(CrossFieldError::NotAligned { .. })));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(20))]
    /// Whatever the crosses inside are.
    #[test]
    fn gauss_bonnet_is_an_identity(seeds in prop::collection::vec(-10.0_f64..10.0, 50)) {
        let domain = annulus();
        let mesh = domain.mesh(0.02);
        let mut theta = cross_field(&mesh, &domain.corners, &[]).unwrap().theta;
        for (face, t) in theta.iter_mut().enumerate() {
            if mesh.adjacency.neighbours[face].iter().all(Option::is_some) {
                *t += seeds[face % seeds.len()] * (1.0 + face as f64).sqrt();
            }
        }
        let index = indices(&mesh, &theta).unwrap();
        let n = domain.points.len();
        let sum: i64 = index[..n].iter().map(|k| 2 - k).sum::<i64>() + index[n..].iter().sum::<i64>();
        prop_assert_eq!(sum, 0);
        prop_assert!(index.iter().any(|&i| i < 0));
    }
}
