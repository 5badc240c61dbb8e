use proptest::prelude::*;

use super::super::test_domains::{Domain, annulus, circle, disk, l_shape, polygon, square, twisted};
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
    // Half a disk above the x-axis, and its mirror image below.
    let mut outline = polygon(&[[-1.0, 0.0], [1.0, 0.0]], 20)[..20].to_vec();
    outline.extend(&circle([0.0, 0.0], 1.0, 60, false)[..30]);
    let half = Domain::new(&[outline], &[]).mesh(0.01);
    let n = half.points.len();
    // Vertices 0 to 19 and 20, the arc's first one, lie on the axis; so does the other end, vertex 0.
    let mirrored: Vec<usize> = (0..n).map(|v| if v <= 20 { v } else { n + v - 21 }).collect();
    let points =
        [&half.points[..], &half.points[21..].iter().map(|[x, y]| [*x, -y]).collect::<Vec<_>>()].concat();
    let triangles = half.triangles.iter().flat_map(|&[a, b, c]| [[a, b, c], [a, c, b].map(|v| mirrored[v])]);
    let mesh = LayoutMesh::new(points, triangles.collect()).unwrap();
    let mirror = |v: usize| match v {
        _ if v <= 20 => v,
        _ if v < n => n + v - 21,
        _ => v + 21 - n,
    };
    let edges = &mesh.adjacency.edges;
    let source = edges
        .iter()
        .map(|e| {
            let [a, b] = e.map(mirror);
            edges.binary_search(&[a.min(b), a.max(b)]).unwrap()
        })
        .collect();
    // exp(8iβ) for a line of direction β = 0.
    let isometry = Isometry { source, phase: [1.0, 0.0], conjugate: true };
    let field = cross_field(&mesh, &[], &[isometry]).unwrap();
    assert_eq!(field.index.iter().filter(|&&i| i == 1).count(), 4);
    for v in 0..mesh.points.len() {
        assert_eq!(field.index[v], field.index[mirror(v)]);
    }
}

#[test]
fn refuses_corners_inside() {
    let mesh = square().mesh(0.01);
    let vertex = mesh.points.len() - 1;
    let error = cross_field(&mesh, &[Corner { vertex, quads: 1 }], &[]).unwrap_err();
    assert_eq!(error, CrossFieldError::CornerInside { vertex });
}

#[test]
fn refuses_indices_that_do_not_add_up() {
    let mesh = annulus().mesh(0.01);
    let theta = vec![f64::NAN; mesh.triangles.len()];
    assert!(matches!(indices(&mesh, &theta), Err(CrossFieldError::GaussBonnet { expected: 0, .. })));
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
