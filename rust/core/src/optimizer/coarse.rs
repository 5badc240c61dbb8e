//! Coarser spline spaces inside a multi-patch's own: every second knot left out, interfaces still conforming.
//!
//! Knots need not be uniform. Whether a knot stays is decided once for all directions that are glued to each other
//! through opposite sides, so that both sides of every interface keep the same knots.

use crate::numeric::sparse::NOWHERE;
use std::collections::HashMap;

/// A coarser space and its embedding.
pub(crate) struct Coarse {
    pub knots: Vec<[Vec<f64>; 2]>,
    /// Per patch, function (i, j) at `[i * n_v + j]`.
    pub indices: Vec<Vec<u32>>,
    pub n_points: usize,
    /// Points that move only points free on the finer level.
    pub free: Vec<usize>,
    embeddings: Vec<[Embedding; 2]>,
}

/// Coarse functions in one direction as combinations of the fine ones.
struct Embedding {
    /// Functions of the coarse space.
    coarse: usize,
    /// First coarse function and its successors' coefficients, for every fine function.
    rows: Vec<(usize, Vec<f64>)>,
}

/// A side of a patch: its points along the direction it runs in.
struct Side {
    patch: usize,
    /// Direction it runs in.
    axis: usize,
    points: Vec<u32>,
    /// Whether the canonical order of its points is the reverse.
    flipped: bool,
}

fn count(knots: &[f64], degree: usize) -> usize {
    knots.len() - degree - 1
}

/// Position of function `t` of `n` along a side of a patch's net.
fn on_side(shape: [usize; 2], axis: usize, end: usize, t: usize) -> usize {
    let across = end * (shape[1 - axis] - 1);
    if axis == 0 { t * shape[1] + across } else { across * shape[1] + t }
}

fn shape_of(knots: &[Vec<f64>; 2], degrees: [usize; 2]) -> [usize; 2] {
    [count(&knots[0], degrees[0]), count(&knots[1], degrees[1])]
}

/// The next coarser space, or `None` if nothing can be left out (or the patches are glued in an unusual way).
pub(crate) fn coarsen(
    knots: &[[Vec<f64>; 2]],
    degrees: &[[usize; 2]],
    indices: &[Vec<u32>],
    free_of: &[u32],
) -> Option<Coarse> {
    let sides = sides_of(knots, degrees, indices)?;
    let classes = Classes::of(knots.len(), &sides);
    let mut coarse = vec![[vec![], vec![]]; knots.len()];
    let mut fewer = false;
    for (k, pair) in knots.iter().enumerate() {
        for axis in 0..2 {
            coarse[k][axis] = classes.thinned(&pair[axis], 2 * k + axis);
            fewer |= coarse[k][axis].len() < pair[axis].len();
        }
    }
    if !fewer {
        return None;
    }
    let embeddings =
        knots.iter().zip(&coarse).zip(degrees).map(|((fine, coarse), degrees)| {
            [0, 1].map(|a| Embedding::new(&coarse[a], &fine[a], degrees[a]))
        });
    let embeddings = embeddings.collect();
    let (indices, free, n_points) = number(&coarse, knots, degrees, indices, free_of, &sides)?;
    Some(Coarse { knots: coarse, indices, n_points, free, embeddings })
}

fn sides_of(knots: &[[Vec<f64>; 2]], degrees: &[[usize; 2]], indices: &[Vec<u32>]) -> Option<Vec<Side>> {
    let mut out = vec![];
    for (k, index) in indices.iter().enumerate() {
        let shape = shape_of(&knots[k], degrees[k]);
        for axis in 0..2 {
            for end in 0..2 {
                let points: Vec<u32> =
                    (0..shape[axis]).map(|t| index[on_side(shape, axis, end, t)]).collect();
                let flipped = points.iter().rev().lt(points.iter());
                // A side that reads the same both ways cannot be told from its reverse.
                if points.iter().rev().eq(points.iter()) {
                    return None;
                }
                out.push(Side { patch: k, axis, points, flipped });
            }
        }
    }
    Some(out)
}

impl Side {
    fn key(&self) -> Vec<u32> {
        let mut key = self.points.clone();
        if self.flipped {
            key.reverse();
        }
        key
    }
}

/// Directions (2 * patch + axis) glued to each other, each with its sense relative to the first of its class.
struct Classes {
    parent: Vec<(usize, bool)>,
    /// Classes glued to their own reverse.
    both_ways: Vec<bool>,
}

impl Classes {
    fn of(patches: usize, sides: &[Side]) -> Self {
        let mut out = Self { parent: (0..2 * patches).map(|d| (d, false)).collect(), both_ways: vec![] };
        out.both_ways = vec![false; 2 * patches];
        let mut seen: HashMap<Vec<u32>, (usize, bool)> = HashMap::new();
        for side in sides {
            let here = (2 * side.patch + side.axis, side.flipped);
            if let Some(&(other, flipped)) = seen.get(&side.key()) {
                out.join(here.0, other, here.1 != flipped);
            } else {
                seen.insert(side.key(), here);
            }
        }
        out
    }

    fn root(&self, mut d: usize) -> (usize, bool) {
        let mut flipped = false;
        while self.parent[d].0 != d {
            flipped ^= self.parent[d].1;
            d = self.parent[d].0;
        }
        (d, flipped)
    }

    fn join(&mut self, a: usize, b: usize, flipped: bool) {
        let ((ra, fa), (rb, fb)) = (self.root(a), self.root(b));
        let relative = fa ^ fb ^ flipped;
        if ra == rb {
            self.both_ways[ra] |= relative;
        } else {
            self.parent[ra] = (rb, relative);
            self.both_ways[rb] |= self.both_ways[ra];
        }
    }

    /// The knots of a direction without every second inner one.
    fn thinned(&self, knots: &[f64], direction: usize) -> Vec<f64> {
        let (root, flipped) = self.root(direction);
        let mut breaks = knots.to_vec();
        breaks.dedup();
        let spans = breaks.len() - 1;
        if self.both_ways[root] && spans % 2 == 1 {
            return knots.to_vec();
        }
        let stays = |x: f64| {
            let at = breaks.partition_point(|&b| b < x);
            let at = if flipped { spans - at } else { at };
            at == 0 || at == spans || at % 2 == 0
        };
        knots.iter().copied().filter(|&x| stays(x)).collect()
    }
}

/// Number the coarse points; `None` if glued sides do not keep the same number of functions.
#[allow(clippy::type_complexity)]
fn number(
    coarse: &[[Vec<f64>; 2]],
    fine: &[[Vec<f64>; 2]],
    degrees: &[[usize; 2]],
    indices: &[Vec<u32>],
    free_of: &[u32],
    sides: &[Side],
) -> Option<(Vec<Vec<u32>>, Vec<usize>, usize)> {
    let is_free = |p: u32| free_of[p as usize] != NOWHERE;
    let (mut corners, mut edges) = (HashMap::<u32, u32>::new(), HashMap::<Vec<u32>, Vec<u32>>::new());
    let (mut out, mut free, mut next) = (vec![], vec![], 0_u32);
    for k in 0..coarse.len() {
        let (shape, before) = (shape_of(&coarse[k], degrees[k]), shape_of(&fine[k], degrees[k]));
        let mut index = vec![NOWHERE; shape[0] * shape[1]];
        let mut give = |is_free: bool| {
            if is_free {
                free.push(next as usize);
            }
            next += 1;
            next - 1
        };
        for at in 0..4 {
            let (t, end) = (at % 2, at / 2);
            let point = indices[k][on_side(before, 0, end, t * (before[0] - 1))];
            let number = *corners.entry(point).or_insert_with(|| give(is_free(point)));
            index[on_side(shape, 0, end, t * (shape[0] - 1))] = number;
        }
        for (s, side) in sides[4 * k..4 * k + 4].iter().enumerate() {
            let n = shape[side.axis];
            let inner = &side.points[1..side.points.len() - 1];
            let numbers = edges.entry(side.key()).or_insert_with(|| {
                let is_free = inner.iter().all(|&p| is_free(p));
                (2..n).map(|_| give(is_free)).collect()
            });
            if numbers.len() + 2 != n {
                return None;
            }
            for t in 1..n - 1 {
                let from = if side.flipped { n - 2 - t } else { t - 1 };
                index[on_side(shape, side.axis, s % 2, t)] = numbers[from];
            }
        }
        for i in 1..shape[0] - 1 {
            for j in 1..shape[1] - 1 {
                index[i * shape[1] + j] = give(true);
            }
        }
        out.push(index);
    }
    Some((out, free, next as usize))
}

impl Embedding {
    /// Knot insertion from the coarse knots to the fine ones by the Oslo algorithm (Cohen, Lyche, Riesenfeld 1980).
    fn new(coarse: &[f64], fine: &[f64], degree: usize) -> Self {
        let n = count(coarse, degree);
        let row = |i: usize| {
            let k = (coarse.partition_point(|&t| t <= fine[i]) - 1).min(n - 1);
            let mut values = vec![0.0; degree + 1];
            values[0] = 1.0;
            for d in 1..=degree {
                let (x, mut carried) = (fine[i + d], 0.0);
                for a in 0..d {
                    let (low, high) = (coarse[k + a + 1 - d], coarse[k + a + 1]);
                    let scaled = values[a] / (high - low);
                    values[a] = carried + (high - x) * scaled;
                    carried = (x - low) * scaled;
                }
                values[d] = carried;
            }
            (k - degree, values)
        };
        Self { coarse: n, rows: (0..count(fine, degree)).map(row).collect() }
    }
}

impl Coarse {
    /// The same movement in the finer space, points numbered by `fine` per patch.
    pub fn prolong(&self, c: &[[f64; 2]], fine: &[Vec<u32>], n_fine: usize) -> Vec<[f64; 2]> {
        let mut out = vec![[0.0; 2]; n_fine];
        for (k, [u, v]) in self.embeddings.iter().enumerate() {
            let mut half = vec![[0.0; 2]; u.rows.len() * v.coarse];
            for (i, (first, weights)) in u.rows.iter().enumerate() {
                for (a, &w) in weights.iter().enumerate().filter(|(_, w)| **w != 0.0) {
                    for j in 0..v.coarse {
                        let from = c[self.indices[k][(first + a) * v.coarse + j] as usize];
                        let to = &mut half[i * v.coarse + j];
                        *to = [to[0] + w * from[0], to[1] + w * from[1]];
                    }
                }
            }
            for i in 0..u.rows.len() {
                for (j, (first, weights)) in v.rows.iter().enumerate() {
                    let mut sum = [0.0; 2];
                    for (b, &w) in weights.iter().enumerate() {
                        let from = half[i * v.coarse + first + b];
                        sum = [sum[0] + w * from[0], sum[1] + w * from[1]];
                    }
                    out[fine[k][i * v.rows.len() + j] as usize] = sum;
                }
            }
        }
        out
    }
}
