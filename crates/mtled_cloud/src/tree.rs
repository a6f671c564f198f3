//! Boxes in a tree: which of many small bodies is nearest to a point, and which may hold it.

use crate::vector::Point;

/// Most items of a leaf.
const LEAF: usize = 4;
/// Deepest tree: each level halves the items.
const DEPTH: usize = 64;

/// A box that holds the items of a branch or a leaf.
#[derive(Clone, Debug, PartialEq)]
struct Node {
    low: Point,
    high: Point,
    /// Of a leaf its first item, of a branch its second child; the first one comes next.
    at: u32,
    /// Items of a leaf, 0 in a branch.
    count: u32,
}

/// A tree of boxes, halved along the longest side of the middles.
#[derive(Clone, Debug, PartialEq, Default)]
pub(crate) struct Tree {
    nodes: Vec<Node>,
    items: Vec<u32>,
}

impl Tree {
    /// Of items by the corners of their boxes.
    pub(crate) fn new(boxes: &[[Point; 2]]) -> Self {
        let mut tree = Self { nodes: Vec::new(), items: (0..boxes.len() as u32).collect() };
        if !boxes.is_empty() {
            tree.branch(boxes, 0, boxes.len());
        }
        tree
    }

    /// The same with other numbers for its items.
    pub(crate) fn renamed(mut self, names: &[u32]) -> Self {
        self.items.iter_mut().for_each(|i| *i = names[*i as usize]);
        self
    }

    fn branch(&mut self, boxes: &[[Point; 2]], first: usize, last: usize) {
        let items = &mut self.items[first..last];
        let all = |k: usize, end: usize, pick: fn(f64, f64) -> f64, start: f64| {
            items.iter().map(|&i| boxes[i as usize][end][k]).fold(start, pick)
        };
        let low = [0, 1, 2].map(|k| all(k, 0, f64::min, f64::INFINITY));
        let high = [0, 1, 2].map(|k| all(k, 1, f64::max, f64::NEG_INFINITY));
        let here = self.nodes.len();
        let leaf = last - first <= LEAF;
        self.nodes.push(Node { low, high, at: first as u32, count: if leaf { (last - first) as u32 } else { 0 } });
        if leaf {
            return;
        }
        let longest = (0..3).fold(0, |best, k| if high[k] - low[k] > high[best] - low[best] { k } else { best });
        let middle = |i: &u32| boxes[*i as usize][0][longest] + boxes[*i as usize][1][longest];
        items.sort_unstable_by(|a, b| middle(a).total_cmp(&middle(b)).then(a.cmp(b)));
        let half = first.midpoint(last);
        self.branch(boxes, first, half);
        self.nodes[here].at = self.nodes.len() as u32;
        self.branch(boxes, half, last);
    }

    /// The item of least squared distance, which `squared` measures for one; `None` where all are further than `reach`.
    pub(crate) fn nearest(&self, p: Point, reach: f64, squared: impl Fn(u32) -> f64) -> Option<(u32, f64)> {
        let mut best: Option<(u32, f64)> = None;
        let most = reach * reach;
        let mut open = [(0_u32, 0.0); DEPTH];
        let mut left = usize::from(!self.nodes.is_empty());
        while left > 0 {
            left -= 1;
            let (at, lower) = open[left];
            if lower > most || best.is_some_and(|(_, d)| lower >= d) {
                continue;
            }
            let node = &self.nodes[at as usize];
            for &item in &self.items[node.at as usize..][..node.count as usize] {
                let d = squared(item);
                if best.map_or(d <= most, |(i, least)| d < least || (d == least && item < i)) {
                    best = Some((item, d));
                }
            }
            if node.count == 0 {
                let mut children = [at + 1, node.at].map(|c| (c, self.nodes[c as usize].squared(p)));
                if children[0].1 < children[1].1 {
                    children.swap(0, 1);
                }
                open[left..left + 2].copy_from_slice(&children);
                left += 2;
            }
        }
        best
    }

    /// The first item that `holds` among those whose box is no further from p than this.
    pub(crate) fn find(&self, p: Point, reach: f64, holds: impl Fn(u32) -> bool) -> Option<u32> {
        let mut open = [0_u32; DEPTH];
        let mut left = usize::from(!self.nodes.is_empty());
        while left > 0 {
            left -= 1;
            let at = open[left];
            let node = &self.nodes[at as usize];
            if node.squared(p) > reach * reach {
                continue;
            }
            let held = self.items[node.at as usize..][..node.count as usize].iter().find(|i| holds(**i));
            if held.is_some() {
                return held.copied();
            }
            if node.count == 0 {
                (open[left], open[left + 1]) = (node.at, at + 1);
                left += 2;
            }
        }
        None
    }
}

impl Node {
    /// Squared distance of a point from the box.
    fn squared(&self, p: Point) -> f64 {
        (0..3).map(|k| (self.low[k] - p[k]).max(p[k] - self.high[k]).max(0.0).powi(2)).sum()
    }
}
