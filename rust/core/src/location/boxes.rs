//! A tree of axis-parallel boxes in the plane: which hold a point, and which are near it.

use std::ops::Range;

/// An axis-parallel box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Rectangle {
    pub low: [f64; 2],
    pub high: [f64; 2],
}

impl Rectangle {
    /// The least one around points, grown by `pad`.
    pub fn around<'a>(points: impl IntoIterator<Item = &'a [f64; 2]>, pad: f64) -> Self {
        let mut out = Self { low: [f64::INFINITY; 2], high: [f64::NEG_INFINITY; 2] };
        for p in points {
            for c in 0..2 {
                out.low[c] = out.low[c].min(p[c]);
                out.high[c] = out.high[c].max(p[c]);
            }
        }
        Self { low: out.low.map(|x| x - pad), high: out.high.map(|x| x + pad) }
    }

    #[inline]
    pub fn contains(&self, x: [f64; 2]) -> bool {
        (0..2).all(|c| self.low[c] <= x[c] && x[c] <= self.high[c])
    }

    /// Distance to a point, 0 inside.
    pub fn distance(&self, x: [f64; 2]) -> f64 {
        let [dx, dy] = [0, 1].map(|c| (self.low[c] - x[c]).max(x[c] - self.high[c]).max(0.0));
        dx.hypot(dy)
    }
}

/// Boxes in a leaf: one more test of a box costs less than one more level.
const LEAF: usize = 2;

/// More levels than halving any number of boxes takes.
const DEPTH: usize = 64;

struct Node {
    bounds: Rectangle,
    /// A leaf's range in `order`, or with count 0 the number of the second child; the first one follows its parent.
    start: u32,
    count: u32,
}

/// Boxes prepared for queries.
pub(super) struct BoxTree {
    order: Vec<u32>,
    /// In that order.
    boxes: Vec<Rectangle>,
    nodes: Vec<Node>,
}

impl BoxTree {
    /// Prepare at least one box.
    pub fn new(boxes: &[Rectangle]) -> Self {
        let count = u32::try_from(boxes.len()).expect("fewer than 4e9 boxes");
        let mut order: Vec<u32> = (0..count).collect();
        let mut nodes = Vec::with_capacity(boxes.len());
        split(boxes, &mut order, 0, &mut nodes);
        let boxes = order.iter().map(|&i| boxes[i as usize]).collect();
        Self { order, boxes, nodes }
    }

    /// Call `visit` with the numbers of all boxes that contain `x`.
    pub fn containing(&self, x: [f64; 2], mut visit: impl FnMut(usize)) {
        let (mut stack, mut height) = ([0_u32; DEPTH], 1);
        while height > 0 {
            height -= 1;
            let number = stack[height];
            let node = &self.nodes[number as usize];
            if !node.bounds.contains(x) {
                continue;
            }
            if node.count == 0 {
                stack[height] = node.start;
                stack[height + 1] = number + 1;
                height += 2;
                continue;
            }
            for k in node.range() {
                if self.boxes[k].contains(x) {
                    visit(self.order[k] as usize);
                }
            }
        }
    }

    /// Call `visit` with the numbers of boxes nearer to `x` than `limit`, which it may lower; near boxes tend to come first.
    pub fn nearest(&self, x: [f64; 2], mut limit: f64, mut visit: impl FnMut(usize, &mut f64)) {
        let mut stack = vec![0_u32];
        while let Some(number) = stack.pop() {
            let node = &self.nodes[number as usize];
            if node.bounds.distance(x) > limit {
                continue;
            }
            if node.count == 0 {
                let (first, second) = (number + 1, node.start);
                let away = |n: u32| self.nodes[n as usize].bounds.distance(x);
                stack.extend(if away(first) <= away(second) { [second, first] } else { [first, second] });
                continue;
            }
            for k in node.range() {
                if self.boxes[k].distance(x) <= limit {
                    visit(self.order[k] as usize, &mut limit);
                }
            }
        }
    }
}

impl Node {
    fn range(&self) -> Range<usize> {
        self.start as usize..(self.start + self.count) as usize
    }
}

fn split(boxes: &[Rectangle], order: &mut [u32], start: usize, nodes: &mut Vec<Node>) {
    let all = || order.iter().map(|&i| &boxes[i as usize]);
    let bounds = Rectangle::around(all().flat_map(|b| [&b.low, &b.high]), 0.0);
    let number = nodes.len();
    nodes.push(Node { bounds, start: start as u32, count: order.len() as u32 });
    if order.len() <= LEAF {
        return;
    }
    let axis = usize::from(bounds.high[1] - bounds.low[1] > bounds.high[0] - bounds.low[0]);
    let middle = order.len() / 2;
    let centre = |i: u32| boxes[i as usize].low[axis] + boxes[i as usize].high[axis];
    order.select_nth_unstable_by(middle, |&a, &b| centre(a).total_cmp(&centre(b)).then(a.cmp(&b)));
    let (first, second) = order.split_at_mut(middle);
    split(boxes, first, start, nodes);
    nodes[number].count = 0;
    nodes[number].start = nodes.len() as u32;
    split(boxes, second, start + middle, nodes);
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn finds_what_a_look_at_every_box_finds(
            corners in prop::collection::vec((-1.0..1.0f64, -1.0..1.0f64, 0.0..0.5f64, 0.0..0.5f64), 1..60),
            x in prop::array::uniform2(-1.5..1.5f64), limit in 0.0..1.0f64,
        ) {
            let boxes: Vec<Rectangle> =
                corners.iter().map(|&(x, y, w, h)| Rectangle { low: [x, y], high: [x + w, y + h] }).collect();
            let tree = BoxTree::new(&boxes);
            let sorted = |mut found: Vec<usize>| { found.sort_unstable(); found };
            let each = |wanted: &dyn Fn(&Rectangle) -> bool| (0..boxes.len()).filter(|&i| wanted(&boxes[i])).collect::<Vec<_>>();
            let mut found = vec![];
            tree.containing(x, |i| found.push(i));
            prop_assert_eq!(sorted(found), each(&|b| b.contains(x)));
            let mut found = vec![];
            tree.nearest(x, limit, |i, _| found.push(i));
            prop_assert_eq!(sorted(found), each(&|b| b.distance(x) <= limit));
            let mut least = f64::INFINITY;
            tree.nearest(x, f64::INFINITY, |i, limit| { *limit = limit.min(boxes[i].distance(x)); least = *limit; });
            prop_assert_eq!(least, boxes.iter().map(|b| b.distance(x)).fold(f64::INFINITY, f64::min));
        }
    }
}
