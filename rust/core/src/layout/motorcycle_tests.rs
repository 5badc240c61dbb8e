use super::*;
use crate::layout::charts::MappedMesh;

#[test]
fn a_trace_that_is_too_long_is_an_error() {
    // A strip of squares; a corner at one end of a side sends a trace across, through two triangles.
    let points = [[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0], [0.0, 1.0]];
    let triangles = [[0, 1, 4], [0, 4, 5], [1, 2, 4], [2, 3, 4]];
    let uv = triangles.map(|t| t.map(|v| points[v]));
    let charts = Charts::new(MappedMesh {
        points: &points,
        triangles: &triangles,
        uv: &uv,
        rotation: &[[0; 3]; 4],
        index: &[1, 2, 1, 1, 2, 1],
        next: &[1, 2, 3, 4, 5, 0],
        loops: &[0; 6],
        corner: &[true; 6],
    })
    .unwrap();
    let mut tracer = Tracer::new(&charts);
    tracer.most_steps = 1;
    tracer.launch(1).unwrap();
    let error = TraceError::Endless { vertex: 1, point: [1.0, 0.0], steps: 1 };
    assert_eq!(tracer.run().unwrap_err(), error);
    // The two meet half-way where they are let.
    let graph = trace(&charts).unwrap();
    let joins: Vec<&Node> = graph.nodes.iter().filter(|n| n.kind == NodeKind::Join).collect();
    assert_eq!(joins.len(), 1);
    assert_eq!(joins[0].point, [1.0, 0.5]);
}
