use std::collections::BTreeMap;

use proptest::prelude::*;

use super::*;
use crate::layout::adjacency::Adjacency;

/// A mapped mesh that owns its arrays.
#[derive(Debug, Clone)]
struct Domain {
    points: Vec<[f64; 2]>,
    triangles: Vec<[usize; 3]>,
    uv: Vec<[[f64; 2]; 3]>,
    rotation: Vec<[u8; 3]>,
    index: Vec<i64>,
    next: Vec<usize>,
    loops: Vec<usize>,
    corner: Vec<bool>,
}

fn turned(quarters: u8, p: [f64; 2]) -> [f64; 2] {
    match quarters % 4 {
        0 => p,
        1 => [-p[1], p[0]],
        2 => [-p[0], -p[1]],
        _ => [p[1], -p[0]],
    }
}

impl Domain {
    /// Squares of four corners each, in the plane and in the map. Outline vertices are numbered first; their number of
    /// quads and the inner indices follow from the squares.
    fn new(points: &[[f64; 2]], squares: &[[usize; 4]], chart: impl Fn(usize) -> [[f64; 2]; 4]) -> Self {
        let halves =
            |i: usize| if i.is_multiple_of(2) { [[0, 1, 2], [0, 2, 3]] } else { [[0, 1, 3], [1, 2, 3]] };
        let all = squares.iter().enumerate();
        let raw: Vec<[usize; 3]> =
            all.clone().flat_map(|(i, s)| halves(i).map(|h| h.map(|j| s[j]))).collect();
        let outline = Adjacency::new(points.len(), &raw).unwrap().on_outline;
        let mut order: Vec<usize> = (0..points.len()).collect();
        order.sort_by_key(|&v| !outline[v]);
        let mut number = vec![0; points.len()];
        order.iter().enumerate().for_each(|(new, &old)| number[old] = new);
        let triangles: Vec<[usize; 3]> = raw.iter().map(|t| t.map(|v| number[v])).collect();
        let adjacency = Adjacency::new(points.len(), &triangles).unwrap();
        let b = outline.iter().filter(|&&o| o).count();
        let quads = squares.iter().flatten().fold(vec![0_i64; points.len()], |mut count, &v| {
            count[number[v]] += 1;
            count
        });
        let next: Vec<usize> = (0..b)
            .map(|v| adjacency.ring(v).next().map(|c| triangles[c.face][(c.index + 1) % 3]).unwrap())
            .collect();
        let mut loops = vec![usize::MAX; b];
        for first in 0..b {
            let index = loops.iter().filter(|&&l| l != usize::MAX).max().map_or(0, |l| l + 1);
            let mut v = first;
            while loops[v] == usize::MAX {
                loops[v] = index;
                v = next[v];
            }
        }
        let uv: Vec<[[f64; 2]; 3]> =
            (0..squares.len()).flat_map(|i| halves(i).map(|h| h.map(|j| chart(i)[j]))).collect();
        let mut domain = Self {
            points: order.iter().map(|&v| points[v]).collect(),
            rotation: vec![[0; 3]; triangles.len()],
            index: (0..points.len()).map(|v| if v < b { quads[v] } else { 4 - quads[v] }).collect(),
            corner: vec![false; b],
            triangles,
            uv,
            next,
            loops,
        };
        domain.measure_rotations();
        domain
    }

    /// Unit squares of the plane with the identity as the map.
    fn of_cells(cells: &[[i64; 2]]) -> Self {
        let mut numbers: BTreeMap<[i64; 2], usize> = BTreeMap::new();
        let corners = |c: [i64; 2]| [[0, 0], [1, 0], [1, 1], [0, 1]].map(|d| [c[0] + d[0], c[1] + d[1]]);
        for c in cells.iter().flat_map(|&c| corners(c)) {
            let new = numbers.len();
            numbers.entry(c).or_insert(new);
        }
        let mut points = vec![[0.0; 2]; numbers.len()];
        numbers.iter().for_each(|(c, &i)| points[i] = c.map(|x| x as f64));
        let squares: Vec<[usize; 4]> = cells.iter().map(|&c| corners(c).map(|p| numbers[&p])).collect();
        Self::new(&points, &squares, |i| squares[i].map(|v| points[v]))
    }

    /// Quarter turns from the edges that triangles share.
    fn measure_rotations(&mut self) {
        let adjacency = Adjacency::new(self.points.len(), &self.triangles).unwrap();
        for face in 0..self.triangles.len() {
            for i in 0..3 {
                let Some(twin) = adjacency.neighbours[face][i] else { continue };
                let edge = |f: usize, a: usize, b: usize| {
                    let (p, q) = (self.uv[f][a % 3], self.uv[f][b % 3]);
                    [q[0] - p[0], q[1] - p[1]]
                };
                let (here, there) =
                    (edge(face, i + 1, i + 2), edge(twin.face, twin.index + 2, twin.index + 1));
                let close = |r: &u8| {
                    let t = turned(*r, here);
                    (t[0] - there[0]).abs() + (t[1] - there[1]).abs() < 1e-6
                };
                self.rotation[face][i] = (0..4).find(close).expect("the squares fit");
            }
        }
    }

    /// The same map in charts that are turned and moved, every triangle on its own.
    fn with_turned_charts(mut self, seed: u64) -> Self {
        let mut state = seed;
        for t in &mut self.uv {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            let (quarters, shift) = ((state >> 40) as u8 % 4, (state >> 50) as f64 / 7.0);
            *t = t.map(|p| turned(quarters, p)).map(|p| [p[0] + shift, p[1] - 2.0 * shift]);
        }
        self.measure_rotations();
        self
    }

    /// The map with its vertices moved, and the outline's sides on lines still.
    fn moved(mut self, noise: f64, seed: u64) -> Self {
        let mut state = seed;
        let mut moves = vec![[0.0; 2]; self.points.len()];
        for x in moves.as_flattened_mut() {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            *x = noise * ((state >> 33) as f64 / 2.0_f64.powi(30) - 1.0);
        }
        // Loops start in different places: once around from a corner, then every side has its own line.
        for first in (0..self.next.len()).filter(|&v| self.index[v] != 2) {
            let mut v = first;
            while v == first || self.index[v] == 2 {
                let axis = usize::from(self.points[v][0] != self.points[self.next[v]][0]);
                moves[self.next[v]][axis] = moves[v][axis];
                v = self.next[v];
            }
        }
        for (t, uv) in self.triangles.iter().zip(&mut self.uv) {
            *uv = [0, 1, 2].map(|i| [0, 1].map(|j| uv[i][j] + moves[t[i]][j]));
        }
        self
    }

    fn mapped(&self) -> MappedMesh<'_> {
        MappedMesh {
            points: &self.points,
            triangles: &self.triangles,
            uv: &self.uv,
            rotation: &self.rotation,
            index: &self.index,
            next: &self.next,
            loops: &self.loops,
            corner: &self.corner,
        }
    }

    fn t_mesh(&self) -> Result<TMesh, TMeshError> {
        TMesh::new(self.mapped())
    }
}

/// A block of cells.
fn block(x: std::ops::Range<i64>, y: std::ops::Range<i64>) -> Vec<[i64; 2]> {
    y.flat_map(|j| x.clone().map(move |i| [i, j])).collect()
}

/// `valence` squares of two by two cells around a point.
fn star(valence: usize) -> Domain {
    let mut points = vec![[0.0; 2]];
    let mut squares = Vec::new();
    let mut charts = Vec::new();
    let angle = std::f64::consts::TAU / valence as f64;
    let mut numbers: BTreeMap<(usize, usize, usize), usize> = BTreeMap::new();
    for k in 0..valence {
        for (i, j) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let mut place = |i: usize, j: usize| {
                // The second axis of one square is the first of the next.
                let key = if i == 0 { ((k + 1) % valence, j, 0) } else { (k, i, j) };
                if key.1 == 0 && key.2 == 0 {
                    return 0;
                }
                *numbers.entry(key).or_insert_with(|| {
                    let (a, b) = (angle * key.0 as f64, angle * (key.0 + 1) as f64);
                    let (s, t) = (key.1 as f64, key.2 as f64);
                    points.push([s * a.cos() + t * b.cos(), s * a.sin() + t * b.sin()]);
                    points.len() - 1
                })
            };
            squares.push([place(i, j), place(i + 1, j), place(i + 1, j + 1), place(i, j + 1)]);
            let (x, y) = (i as f64, j as f64);
            charts.push([[x, y], [x + 1.0, y], [x + 1.0, y + 1.0], [x, y + 1.0]]);
        }
    }
    Domain::new(&points, &squares, |i| charts[i])
}

/// A ring of squares that a translation closes; its loops have no corner.
fn ring(around: usize, across: usize) -> Domain {
    let number = |i: usize, j: usize| j * around + i % around;
    let points: Vec<[f64; 2]> = (0..(across + 1) * around)
        .map(|v| {
            let (angle, r) =
                (-std::f64::consts::TAU * (v % around) as f64 / around as f64, 1.0 + (v / around) as f64);
            [r * angle.cos(), r * angle.sin()]
        })
        .collect();
    let cells: Vec<(usize, usize)> = (0..around * across).map(|c| (c % around, c / around)).collect();
    let squares: Vec<[usize; 4]> = cells
        .iter()
        .map(|&(i, j)| [number(i, j), number(i + 1, j), number(i + 1, j + 1), number(i, j + 1)])
        .collect();
    Domain::new(&points, &squares, |c| {
        let (x, y) = (cells[c].0 as f64, cells[c].1 as f64);
        [[x, y], [x + 1.0, y], [x + 1.0, y + 1.0], [x, y + 1.0]]
    })
}

/// Nodes, arcs, faces and joins.
fn counts(mesh: &TMesh) -> [usize; 4] {
    let joins = mesh.nodes.iter().filter(|n| n.kind == NodeKind::Join).count();
    [mesh.nodes.len(), mesh.arcs.len(), mesh.faces.len(), joins]
}

/// Area in the map, and that opposite sides are equally long.
fn area(mesh: &TMesh) -> f64 {
    let length =
        |side: &[usize]| -> f64 { side.iter().map(|&h| mesh.arcs[h / 2].places.last().unwrap()).sum() };
    mesh.faces
        .iter()
        .map(|sides| {
            let l = [0, 1, 2, 3].map(|i| length(&sides[i]));
            assert!((l[0] - l[2]).abs() < 1e-6 && (l[1] - l[3]).abs() < 1e-6, "{l:?}");
            l[0] * l[1]
        })
        .sum()
}

/// Width and height of every face, sorted.
fn sizes(mesh: &TMesh) -> Vec<[i64; 2]> {
    let length =
        |side: &[usize]| -> f64 { side.iter().map(|&h| mesh.arcs[h / 2].places.last().unwrap()).sum() };
    let mut sizes: Vec<[i64; 2]> = mesh
        .faces
        .iter()
        .map(|sides| {
            let size = [0, 1].map(|i| (2.0 * length(&sides[i])).round() as i64);
            [size[0].min(size[1]), size[0].max(size[1])]
        })
        .collect();
    sizes.sort_unstable();
    sizes
}

/// The T-mesh of a domain, which must not depend on how the charts are turned.
///
/// A trace that comes where two others meet ends on either: an arc without length is on this side or that of it.
fn sound(domain: &Domain) -> TMesh {
    let mesh = domain.t_mesh().unwrap();
    let cells = domain.triangles.len() as f64 / 2.0;
    assert!((area(&mesh) - cells).abs() < 1e-6);
    for seed in 1..4 {
        let other = domain.clone().with_turned_charts(seed).t_mesh().unwrap();
        assert_eq!(counts(&other), counts(&mesh));
        assert_eq!(sizes(&other), sizes(&mesh));
    }
    mesh
}

#[test]
fn a_square_is_one_face() {
    let mesh = sound(&Domain::of_cells(&block(0..3, 0..3)));
    assert_eq!(counts(&mesh), [4, 4, 1, 0]);
    assert!(mesh.faces[0].iter().all(|side| side.len() == 1));
    assert_eq!(mesh.arcs[0].points.len(), 4);
    assert_eq!(mesh.arcs[0].places, [0.0, 1.0, 2.0, 3.0]);
}

#[test]
fn an_l_has_two_traces_from_its_reflex_corner() {
    let mut cells = block(0..4, 0..2);
    cells.extend(block(0..2, 2..4));
    assert_eq!(counts(&sound(&Domain::of_cells(&cells))), [8, 10, 3, 0]);
}

#[test]
fn the_traces_of_a_plus_meet_in_pairs() {
    let mut cells = block(0..3, 1..2);
    cells.extend([[1, 0], [1, 2]]);
    let mesh = sound(&Domain::of_cells(&cells));
    assert_eq!(counts(&mesh), [16, 20, 5, 4]);
    for (node, quarters) in mesh.sectors.iter().enumerate().map(|(h, s)| (mesh.origin(h), s.quarters)) {
        if mesh.nodes[node].kind == NodeKind::Join {
            assert_eq!(quarters, 2);
        }
    }
}

#[test]
fn traces_from_both_sides_end_on_one_that_has_passed() {
    // Two notches face each other across a strip that a third, deeper one cuts first.
    let mut cells = block(0..11, 0..3);
    cells.extend(block(1..4, 3..6));
    cells.extend(block(6..9, 3..4));
    let mesh = sound(&Domain::of_cells(&cells));
    assert_eq!(mesh.faces.len(), 1 + 8 - counts(&mesh)[3]);
}

#[test]
fn singularities_send_as_many_traces_as_their_valence() {
    for valence in [3, 5, 6] {
        let domain = star(valence);
        let mesh = sound(&domain);
        assert_eq!(counts(&mesh), [1 + 2 * valence, 3 * valence, valence, 0]);
        let smallest = domain.next.iter().enumerate().filter(|&(v, _)| domain.index[v] == 1).count();
        assert_eq!(smallest, valence);
    }
}

#[test]
fn a_loop_without_a_node_gets_one_trace() {
    let domain = ring(8, 2);
    let mesh = sound(&domain);
    assert_eq!(counts(&mesh), [2, 3, 1, 0]);
    let intervals: Vec<[f64; 2]> = mesh.arcs.iter().filter_map(|a| a.outline.map(|o| o.1)).collect();
    assert!(intervals.iter().all(|i| (i[1] - i[0] - 8.0).abs() < 1e-12));
}

#[test]
fn a_trace_around_a_hole_meets_that_which_goes_the_other_way() {
    // A notch in the outer loop of a ring: its reflex corners send traces around both ways.
    let n = 8;
    let whole = ring(n, 3);
    let squares: Vec<usize> = (0..3 * n).filter(|&c| c != 2 * n).collect();
    let number = |i: usize, j: usize| j * n + i % n;
    let corners = |c: usize| {
        let (i, j) = (c % n, c / n);
        [number(i, j), number(i + 1, j), number(i + 1, j + 1), number(i, j + 1)]
    };
    let points: Vec<[f64; 2]> = (0..4 * n)
        .map(|v| {
            let (angle, r) = (-std::f64::consts::TAU * (v % n) as f64 / n as f64, 1.0 + (v / n) as f64);
            [r * angle.cos(), r * angle.sin()]
        })
        .collect();
    assert_eq!(points.len(), whole.points.len());
    let list: Vec<[usize; 4]> = squares.iter().map(|&c| corners(c)).collect();
    let domain = Domain::new(&points, &list, |k| {
        let (x, y) = ((squares[k] % n) as f64, (squares[k] / n) as f64);
        [[x, y], [x + 1.0, y], [x + 1.0, y + 1.0], [x, y + 1.0]]
    });
    let mesh = sound(&domain);
    assert_eq!(counts(&mesh)[3], 1);
    assert_eq!(mesh.faces.len(), 3);
}

#[test]
fn a_wrong_index_is_named() {
    let mut domain = Domain::of_cells(&block(0..2, 0..2));
    domain.index[8] = 1;
    match domain.t_mesh().unwrap_err() {
        TMeshError::Trace(TraceError::Chart(ChartError::TraceCount {
            vertex: 8,
            found: 4,
            wanted: 3,
            point,
        })) => {
            assert_eq!(point, [1.0, 1.0]);
        }
        other => panic!("{other}"),
    }
    let mut star = star(3);
    let center = star.points.iter().position(|p| *p == [0.0, 0.0]).unwrap();
    star.index[center] = 0;
    assert!(matches!(star.t_mesh(), Err(TMeshError::FaceCorners { corners: 3, .. })));
}

#[test]
fn arrays_that_do_not_fit_are_refused() {
    let good = Domain::of_cells(&block(0..2, 0..1));
    let chart = |d: &Domain| match d.t_mesh().unwrap_err() {
        TMeshError::Trace(TraceError::Chart(error)) => error,
        other => panic!("{other}"),
    };
    let mut bad = good.clone();
    bad.index.pop();
    assert_eq!(chart(&bad), ChartError::Size { what: "indices of vertices", expected: 6, found: 5 });
    let mut bad = good.clone();
    bad.uv[2][1][0] = f64::NAN;
    assert_eq!(chart(&bad), ChartError::NotFinite { face: 2 });
    let mut bad = good.clone();
    bad.next.swap(0, 1);
    assert!(matches!(chart(&bad), ChartError::Outline { .. }));
    let mut bad = good.clone();
    bad.loops.fill(1);
    assert_eq!(chart(&bad), ChartError::Loop { index: 0 });
    let mut bad = ring(5, 1);
    bad.loops.fill(0);
    assert_eq!(chart(&bad), ChartError::Loop { index: 0 });
}

#[test]
fn a_face_beside_a_broken_sector_is_found() {
    let mut mesh = Domain::of_cells(&[[0, 0]]).t_mesh().unwrap();
    mesh.sectors[0].next = 0;
    assert!(matches!(mesh.walk_faces(), Err(TMeshError::HalfArc { .. })));
}

#[test]
fn folded_triangles_do_not_hold_a_trace() {
    // The middle of a block is pulled over its neighbours in the map.
    let mut domain = Domain::of_cells(&[block(0..6, 0..3), block(0..3, 3..6)].concat());
    let inner = (0..domain.points.len()).find(|&v| domain.points[v] == [4.0, 2.0]).unwrap();
    for (t, uv) in domain.triangles.iter().zip(&mut domain.uv) {
        for (v, p) in t.iter().zip(uv) {
            if *v == inner {
                *p = [4.2, 0.6];
            }
        }
    }
    let mesh = domain.t_mesh().unwrap();
    assert_eq!(mesh.faces.len(), 3);
}

/// Random unions of squares that do not touch themselves in a point.
fn union() -> impl Strategy<Value = Vec<[i64; 2]>> {
    let part = (0..7_i64, 0..7_i64, 1..5_i64, 1..5_i64);
    prop::collection::vec(part, 1..8).prop_filter_map("one piece without pinched corners", |parts| {
        let mut cells: Vec<[i64; 2]> =
            parts.iter().flat_map(|&(x, y, w, h)| block(x..x + w, y..y + h)).collect();
        cells.sort_unstable();
        cells.dedup();
        let has = |x: i64, y: i64| cells.binary_search(&[x, y]).is_ok();
        let pinched = |x: i64, y: i64| {
            let around = [has(x, y), has(x - 1, y), has(x - 1, y - 1), has(x, y - 1)];
            around == [true, false, true, false] || around == [false, true, false, true]
        };
        let mut reached = vec![cells[0]];
        let mut i = 0;
        while i < reached.len() {
            let [x, y] = reached[i];
            for next in [[x + 1, y], [x - 1, y], [x, y + 1], [x, y - 1]] {
                if has(next[0], next[1]) && !reached.contains(&next) {
                    reached.push(next);
                }
            }
            i += 1;
        }
        let simple = (0..13).all(|x| (0..13).all(|y| !pinched(x, y)));
        (simple && reached.len() == cells.len()).then_some(cells)
    })
}

proptest! {
    #[test]
    fn unions_of_squares_are_cut_into_rectangles(cells in union()) {
        let domain = Domain::of_cells(&cells);
        let mesh = sound(&domain);
        let traces: i64 = domain.index[..domain.next.len()].iter().filter(|&&k| k != 2).map(|k| k - 1).sum();
        let euler = Adjacency::new(domain.points.len(), &domain.triangles).unwrap().euler();
        // A loop has corners, so every face comes from a trace but for the first, and two that meet make one.
        prop_assert_eq!(mesh.faces.len() as i64, euler + traces - counts(&mesh)[3] as i64);
    }

    #[test]
    fn rounding_of_a_solver_changes_nothing(cells in union(), seed: u64) {
        let domain = Domain::of_cells(&cells);
        let mesh = domain.t_mesh().unwrap();
        for noise in [1e-13, 1e-11, 5e-10] {
            let other = domain.clone().moved(noise, seed).t_mesh().unwrap();
            prop_assert_eq!(counts(&other), counts(&mesh));
            prop_assert_eq!(sizes(&other), sizes(&mesh));
        }
    }

    #[test]
    fn lines_that_nearly_coincide_are_cut_into_rectangles(cells in union(), seed: u64) {
        for noise in [1e-7, 1e-4, 1e-2] {
            let mesh = Domain::of_cells(&cells).moved(noise, seed).t_mesh().unwrap();
            prop_assert!((area(&mesh) - cells.len() as f64).abs() < 1.0);
        }
    }
}
