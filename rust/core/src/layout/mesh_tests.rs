use super::super::test_domains::{Domain, annulus, circle, l_shape, polygon, square, twisted};
use super::*;

fn smallest_angle(mesh: &LayoutMesh) -> f64 {
    let corners = (0..mesh.triangles.len()).flat_map(|face| (0..3).map(move |index| Place { face, index }));
    corners.map(|c| mesh.angle(c).to_degrees()).fold(f64::INFINITY, f64::min)
}

#[test]
fn the_outline_keeps_its_edges_and_triangles_keep_the_limits() {
    for (domain, step) in [(square(), 0.125), (l_shape(), 0.25), (annulus(), 0.1)] {
        let limit = 0.9 * step * step;
        let mesh = domain.mesh(limit);
        let outline = (0..mesh.adjacency.edges.len()).filter(|&e| mesh.adjacency.is_outline_edge(e)).count();
        assert_eq!(outline, domain.points.len());
        assert_eq!(&mesh.points[..domain.points.len()], &domain.points[..]);
        // Some triangles at the outline are larger: a point in them would be too near to an edge that stays whole.
        let large = mesh.geometry.areas.iter().filter(|&&a| a > limit).count();
        assert!(10 * large < mesh.triangles.len(), "{large} of {}", mesh.triangles.len());
        assert!(mesh.geometry.areas.iter().all(|&a| a < 1.5 * limit));
        assert!(smallest_angle(&mesh) > 20.0, "{}", smallest_angle(&mesh));
        assert_eq!(mesh.adjacency.euler(), 2 - domain.loops.len() as i64);
    }
}

#[test]
fn spokes_divide_acute_and_reflex_corners() {
    // 20 degrees with one quad turn the cross by 70, a slit's end of 340 with four quads by 20.
    let tip = [20.0_f64.to_radians().cos(), 20.0_f64.to_radians().sin()];
    let domain = Domain::new(&[polygon(&[[0.0, 0.0], [1.0, 0.0], tip], 8)], &[(0, 0, 1)]);
    assert!(domain.mesh(0.01).adjacency.ring(0).count() >= 4);
    let square = [[-2.0, -2.0], [2.0, -2.0], [2.0, 2.0], [-2.0, 2.0]];
    let slit = [[0.0, 0.0], tip, [1.0, 0.0]];
    let domain = Domain::new(&[polygon(&square, 16), polygon(&slit, 8)], &[(1, 0, 4)]);
    assert!(domain.mesh(0.05).adjacency.ring(64).count() >= 7);
}

#[test]
fn the_mesh_depends_neither_on_direction_nor_on_size() {
    for domain in [square(), twisted(0.3), annulus()] {
        let mesh = domain.mesh(0.004);
        for (angle, scale) in [(37.0_f64.to_radians(), 1.0), (0.0, 1e-3), (2.0, 1e3)] {
            assert_eq!(domain.turned(angle, scale).mesh(0.004 * scale * scale).triangles, mesh.triangles);
        }
    }
}

#[test]
fn refuses_what_is_no_domain() {
    let generate = |d: &Domain| LayoutMesh::generate(&d.points, &d.loops, &d.corners, 0.1).unwrap_err();
    let two = Domain::new(&[circle([0.0, 0.0], 1.0, 20, false), circle([5.0, 0.0], 1.0, 20, false)], &[]);
    assert_eq!(generate(&two), LayoutMeshError::Euler { found: 2, expected: 0, holes: 1 });
    let mut corner = square();
    corner.corners[0].vertex = 99;
    assert_eq!(generate(&corner), LayoutMeshError::CornerInside { vertex: 99 });
    let mut unknown = square();
    unknown.loops[0][3] = 99;
    let expected = TriangulationError::UnknownPoint { index: 0, point: 99 };
    assert_eq!(generate(&unknown), LayoutMeshError::Triangulation(expected));
    let bow = Domain::new(&[polygon(&[[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]], 3)], &[]);
    assert!(matches!(
        generate(&bow),
        LayoutMeshError::Triangulation(TriangulationError::CrossingConstraints { .. })
    ));
}
