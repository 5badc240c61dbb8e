use super::super::cross_field::cross_field;
use super::super::test_domains::{Domain, annulus, disk, l_shape, square, twisted};
use super::*;

fn mapped(domain: &Domain, rounds: usize) -> (LayoutMesh, SeamlessMap) {
    let mesh = domain.mesh(0.004);
    let field = cross_field(&mesh, &domain.corners, &[]).unwrap();
    let map = seamless_map(&mesh, &field.theta, &field.index, rounds).unwrap();
    (mesh, map)
}

#[test]
fn a_square_is_mapped_onto_its_like() {
    let (mesh, map) = mapped(&square(), 0);
    assert_eq!((map.folds, map.rounds), (0, 0));
    assert!(map.seam.as_flattened().iter().all(|s| !s));
    for (t, uv) in mesh.triangles.iter().zip(&map.uv) {
        for i in 0..3 {
            let (p, q) = (mesh.points[t[i]], mesh.points[t[(i + 1) % 3]]);
            let (a, b) = (uv[i], uv[(i + 1) % 3]);
            let stretched = (b[0] - a[0]).hypot(b[1] - a[1]) - (q[0] - p[0]).hypot(q[1] - p[1]);
            assert!(stretched.abs() < 1e-9, "{stretched}");
        }
    }
}

#[test]
fn maps_of_known_domains_have_no_folds_and_no_gaps() {
    for domain in [square(), l_shape(), annulus(), disk(), twisted(0.3)] {
        let (mesh, map) = mapped(&domain, 12);
        assert_eq!(map.folds, 0);
        assert!(map.residual < 1e-12, "{}", map.residual);
        assert_eq!(mesh.triangles.len(), map.uv.len());
    }
}

#[test]
fn images_are_as_large_as_the_domain() {
    for domain in [square(), l_shape(), annulus(), disk()] {
        let (mesh, map) = mapped(&domain, 0);
        let image: f64 = map.uv.iter().map(|t| double_area(t) / 2.0).sum();
        let area: f64 = mesh.geometry.areas.iter().sum();
        assert!((image / area - 1.0).abs() < 0.05, "{image} {area}");
    }
}

#[test]
fn seams_have_one_transition_seen_from_both_sides() {
    let (mesh, map) = mapped(&disk(), 0);
    let mut seams = 0;
    for face in 0..mesh.triangles.len() {
        for index in 0..3 {
            let Some(other) = mesh.adjacency.neighbours[face][index] else { continue };
            let back = map.rotation[other.face][other.index];
            assert_eq!((map.rotation[face][index] + back) % 4, 0);
            assert_eq!(map.seam[face][index], map.seam[other.face][other.index]);
            seams += usize::from(map.seam[face][index] && back % 2 == 1);
        }
    }
    // Every singularity has a quarter turn around it.
    assert!(seams > 0);
}

#[test]
fn an_annulus_closes_up_to_a_translation() {
    let (mesh, map) = mapped(&annulus(), 0);
    let mut translations = Vec::new();
    for face in 0..mesh.triangles.len() {
        for index in 0..3 {
            let Some(other) = mesh.adjacency.neighbours[face][index] else { continue };
            if map.seam[face][index] {
                assert_eq!(map.rotation[face][index], 0);
                let (here, there) =
                    (map.uv[face][(index + 1) % 3], map.uv[other.face][(other.index + 2) % 3]);
                translations.push([there[0] - here[0], there[1] - here[1]].map(f64::abs));
            }
        }
    }
    assert!(translations.len() > 4);
    for t in &translations {
        assert!((t[0] - translations[0][0]).abs() < 1e-12 && (t[1] - translations[0][1]).abs() < 1e-12);
    }
    // Once around the hole in one coordinate, nothing in the other one.
    let [large, small] =
        [translations[0][0].max(translations[0][1]), translations[0][0].min(translations[0][1])];
    assert!(large > 3.0 && small < 1e-12, "{large} {small}");
}

#[test]
fn stiffening_unfolds_what_a_hole_has_twisted() {
    let folded = mapped(&twisted(0.15), 0).1;
    assert!(folded.folds > 0);
    let stiffened = mapped(&twisted(0.15), 12).1;
    assert_eq!(stiffened.folds, 0);
    assert!((1..=4).contains(&stiffened.rounds), "{}", stiffened.rounds);
}

#[test]
fn the_scale_of_a_regular_field_is_constant() {
    let (mesh, _) = mapped(&square(), 0);
    let domain = square();
    let field = cross_field(&mesh, &domain.corners, &[]).unwrap();
    assert!(log_scale(&mesh, &field.index).unwrap().iter().all(|p| p.abs() < 1e-9));
}

#[test]
fn refuses_crosses_of_another_mesh() {
    let mesh = square().mesh(0.01);
    let theta = vec![0.0; mesh.triangles.len() - 1];
    let index = vec![0; mesh.points.len()];
    let error = seamless_map(&mesh, &theta, &index, 0).unwrap_err();
    assert!(matches!(error, SeamlessMapError::Count { what: "crosses", .. }));
}

#[test]
fn refuses_a_mesh_of_nothing() {
    let mesh = LayoutMesh::new(vec![], vec![]).unwrap();
    assert_eq!(seamless_map(&mesh, &[], &[], 0), Err(SeamlessMapError::Degenerate));
}
