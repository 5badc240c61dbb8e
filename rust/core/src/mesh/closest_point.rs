//! Closest points on a triangle mesh in ℝ⁴, by a tree of bounding boxes.
//!
//! The mesh method stacks a vertex and its image into one point of ℝ⁴ (Ezuz, Solomon, Ben-Chen 2019: the rows of
//! a precise map are closest points in such coordinates). Triangles may be degenerate there.

use rayon::prelude::*;

/// A point of ℝ⁴.
pub type Point = [f64; 4];

/// The point of a mesh that is closest to a query.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Foot {
    /// The triangle; of several equally close ones the first.
    pub triangle: usize,
    /// Barycentric coordinates in it: none negative, their sum is 1 within rounding.
    pub weights: [f64; 3],
    /// Squared distance.
    pub distance2: f64,
}

const LEAF: usize = 4;
const CHUNK: usize = 64;

struct Node {
    low: Point,
    high: Point,
    /// A leaf's range in `order`, or the number of the second child; the first one follows its parent.
    start: u32,
    count: u32,
}

/// A triangle mesh prepared for closest-point queries.
pub struct MeshTree<'a> {
    vertices: &'a [Point],
    triangles: &'a [[usize; 3]],
    order: Vec<u32>,
    nodes: Vec<Node>,
}

impl<'a> MeshTree<'a> {
    /// Prepare a mesh of at least one triangle; indices must be valid and coordinates finite.
    pub fn new(vertices: &'a [Point], triangles: &'a [[usize; 3]]) -> Self {
        assert!(!triangles.is_empty(), "a mesh without triangles has no closest points");
        let mut order: Vec<u32> =
            (0..u32::try_from(triangles.len()).expect("fewer than 4e9 faces")).collect();
        let mut tree = Self { vertices, triangles, order: Vec::new(), nodes: Vec::new() };
        // Three times the centres: what decides is their order.
        let centres: Vec<Point> = triangles
            .iter()
            .map(|t| std::array::from_fn(|c| t.iter().map(|&v| vertices[v][c]).sum()))
            .collect();
        tree.split(&mut order, 0, &centres);
        tree.order = order;
        tree
    }

    fn split(&mut self, order: &mut [u32], start: usize, centres: &[Point]) {
        let (mut low, mut high) = ([f64::INFINITY; 4], [f64::NEG_INFINITY; 4]);
        for &v in order.iter().flat_map(|&t| &self.triangles[t as usize]) {
            for c in 0..4 {
                low[c] = low[c].min(self.vertices[v][c]);
                high[c] = high[c].max(self.vertices[v][c]);
            }
        }
        let number = self.nodes.len();
        self.nodes.push(Node { low, high, start: start as u32, count: order.len() as u32 });
        if order.len() <= LEAF {
            return;
        }
        let axis =
            (0..4).max_by(|&a, &b| (high[a] - low[a]).total_cmp(&(high[b] - low[b]))).expect("four axes");
        let middle = order.len() / 2;
        let centre = |t: u32| centres[t as usize][axis];
        order.select_nth_unstable_by(middle, |&a, &b| centre(a).total_cmp(&centre(b)).then(a.cmp(&b)));
        let (first, second) = order.split_at_mut(middle);
        self.split(first, start, centres);
        self.nodes[number].count = 0;
        self.nodes[number].start = self.nodes.len() as u32;
        self.split(second, start + middle, centres);
    }

    /// The closest point to `query`.
    pub fn closest(&self, query: Point) -> Foot {
        let mut best = Foot { triangle: usize::MAX, weights: [0.0; 3], distance2: f64::INFINITY };
        let distance2 = |n: u32| box_distance2(&self.nodes[n as usize], query);
        let mut stack = Vec::with_capacity(32);
        stack.push((0_u32, distance2(0)));
        while let Some((number, least)) = stack.pop() {
            // Not at equality: of equally close triangles the first is wanted.
            if least > best.distance2 {
                continue;
            }
            let node = &self.nodes[number as usize];
            if node.count == 0 {
                let (first, second) = (number + 1, node.start);
                let (first, second) = ((first, distance2(first)), (second, distance2(second)));
                // The nearer child is looked at first.
                stack.extend(if first.1 <= second.1 { [second, first] } else { [first, second] });
                continue;
            }
            let range = node.start as usize..(node.start + node.count) as usize;
            for &t in &self.order[range] {
                let triangle = t as usize;
                let (weights, distance2) = foot(query, self.triangles[triangle].map(|v| self.vertices[v]));
                if distance2 < best.distance2 || (distance2 == best.distance2 && triangle < best.triangle) {
                    best = Foot { triangle, weights, distance2 };
                }
            }
        }
        best
    }

    /// Closest points to many queries, in parallel.
    pub fn closest_all(&self, queries: &[Point]) -> Vec<Foot> {
        queries.par_iter().with_min_len(CHUNK).map(|&query| self.closest(query)).collect()
    }
}

fn dot(a: Point, b: Point) -> f64 {
    (0..4).map(|c| a[c] * b[c]).sum()
}

fn minus(a: Point, b: Point) -> Point {
    [0, 1, 2, 3].map(|c| a[c] - b[c])
}

fn box_distance2(node: &Node, q: Point) -> f64 {
    (0..4).map(|c| (node.low[c] - q[c]).max(q[c] - node.high[c]).max(0.0).powi(2)).sum()
}

/// Barycentric coordinates of the point of a triangle closest to `q`, and its squared distance.
fn foot(q: Point, corner: [Point; 3]) -> ([f64; 3], f64) {
    let (e, f, d) = (minus(corner[1], corner[0]), minus(corner[2], corner[0]), minus(q, corner[0]));
    let (ee, ef, ff, de, df) = (dot(e, e), dot(e, f), dot(f, f), dot(d, e), dot(d, f));
    let gram = ee * ff - ef * ef;
    let distance2 = |w: [f64; 3]| {
        let r: Point = std::array::from_fn(|c| q[c] - (0..3).map(|i| w[i] * corner[i][c]).sum::<f64>());
        dot(r, r)
    };
    if gram > 0.0 {
        let (s, t) = ((ff * de - ef * df) / gram, (ee * df - ef * de) / gram);
        let inside = [1.0 - s - t, s, t];
        if inside.iter().all(|&w| w >= 0.0) {
            return (inside, distance2(inside));
        }
    }
    // Otherwise the closest point lies on an edge.
    let mut best = ([1.0, 0.0, 0.0], f64::INFINITY);
    for i in 0..3 {
        let (a, b) = (corner[i], corner[(i + 1) % 3]);
        let along = minus(b, a);
        let length2 = dot(along, along);
        let t = if length2 > 0.0 { (dot(minus(q, a), along) / length2).clamp(0.0, 1.0) } else { 0.0 };
        let mut w = [0.0; 3];
        w[i] = 1.0 - t;
        w[(i + 1) % 3] = t;
        let d = distance2(w);
        if d < best.1 {
            best = (w, d);
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn points(n: usize) -> impl Strategy<Value = Vec<Point>> {
        prop::collection::vec(prop::array::uniform4(-1.0..1.0f64), n)
    }

    proptest! {
        #[test]
        fn equals_the_closest_of_all_triangles(vertices in points(30), queries in points(20),
                                               faces in prop::collection::vec(prop::array::uniform3(0usize..30), 1..80)) {
            let tree = MeshTree::new(&vertices, &faces);
            for (query, found) in queries.iter().zip(tree.closest_all(&queries)) {
                let each: Vec<f64> = faces.iter().map(|t| foot(*query, t.map(|v| vertices[v])).1).collect();
                let least = each.iter().copied().fold(f64::INFINITY, f64::min);
                prop_assert_eq!(found.distance2, least);
                prop_assert_eq!(found.triangle, each.iter().position(|&d| d == least).unwrap());
            }
        }

        #[test]
        fn is_closer_than_any_other_point(corner in prop::array::uniform3(prop::array::uniform4(-1.0..1.0f64)),
                                          query in prop::array::uniform4(-2.0..2.0f64),
                                          others in prop::collection::vec(prop::array::uniform3(0.0..1.0f64), 30)) {
            let (weights, least) = foot(query, corner);
            prop_assert!(weights.iter().all(|&w| w >= 0.0) && (weights.iter().sum::<f64>() - 1.0).abs() < 1e-14);
            for other in others {
                let sum = other.iter().sum::<f64>().max(1e-9);
                let point: Point = std::array::from_fn(|c| (0..3).map(|i| other[i] / sum * corner[i][c]).sum());
                let d = minus(query, point);
                prop_assert!(least <= dot(d, d) + 1e-12);
            }
        }
    }

    #[test]
    fn degenerate_triangles_are_segments_and_points() {
        let p = |x: f64| [x, 0.0, 0.0, 0.0];
        let (weights, distance2) = foot([0.25, 1.0, 0.0, 0.0], [p(0.0), p(1.0), p(0.5)]);
        let at: f64 = weights[1] + 0.5 * weights[2];
        assert!((at - 0.25).abs() < 1e-15 && (distance2 - 1.0).abs() < 1e-15);
        assert_eq!(foot(p(3.0), [p(1.0); 3]), ([1.0, 0.0, 0.0], 4.0));
    }
}
