//! From candidates to a lattice: a seed, its neighbours, and growth by prediction.

use std::collections::HashMap;

use hydroline_rigs::BoardPattern;

use super::candidates::Candidate;
use super::image::Plane;

/// Index of a node in a lattice whose origin is arbitrary.
pub(super) type Index = [i32; 2];

/// A node of a growing lattice.
#[derive(Debug, Clone, Copy)]
struct Grown {
    index: Index,
    candidate: usize,
    /// To the next node along both directions \[px\].
    steps: [[f64; 2]; 2],
}

/// A lattice while it grows. Tables instead of maps, used again for every seed: some hundred
/// lattices are begun in a frame without a board.
#[derive(Debug, Clone)]
struct Growth {
    nodes: Vec<Grown>,
    /// Cells and candidates of all nodes ever put, those that pruning took as well.
    occupied: Vec<(usize, usize)>,
    /// Candidate + 1 by index, 0 = none.
    cells: Vec<u32>,
    taken: Vec<bool>,
    /// Farthest index from the seed.
    widest: i32,
    /// More nodes than this are no board.
    most: usize,
}

impl Growth {
    fn new(most: [u32; 2], candidates: usize) -> Self {
        let widest = most[0].max(most[1]) as i32;
        // One more all round: neighbours of the outermost are asked for.
        let side = (2 * widest + 3) as usize;
        Growth {
            nodes: Vec::new(),
            occupied: Vec::new(),
            cells: vec![0; side * side],
            taken: vec![false; candidates],
            widest,
            most: 2 * (most[0] * most[1]) as usize,
        }
    }

    fn cell(&self, index: Index) -> usize {
        let side = 2 * self.widest + 3;
        ((index[1] + self.widest + 1) * side + index[0] + self.widest + 1) as usize
    }

    fn at(&self, index: Index) -> Option<usize> {
        (self.cells[self.cell(index)] as usize).checked_sub(1)
    }

    fn put(&mut self, index: Index, candidate: usize, steps: [[f64; 2]; 2]) {
        let cell = self.cell(index);
        self.cells[cell] = candidate as u32 + 1;
        self.taken[candidate] = true;
        self.occupied.push((cell, candidate));
        self.nodes.push(Grown {
            index,
            candidate,
            steps,
        });
    }

    /// Begun anew: what earlier nodes occupy is free again. Most lattices end at a few nodes, and
    /// the tables are large.
    fn clear(&mut self) {
        for n in self.occupied.drain(..) {
            self.cells[n.0] = 0;
            self.taken[n.1] = false;
        }
        self.nodes.clear();
    }

    fn extent(&self) -> [u32; 2] {
        [0, 1].map(|k| {
            let low = self.nodes.iter().map(|n| n.index[k]).min().unwrap_or(0);
            let high = self.nodes.iter().map(|n| n.index[k]).max().unwrap_or(-1);
            (high - low + 1) as u32
        })
    }
}

/// Candidates by lattice index.
#[derive(Debug, Clone, Default)]
pub(super) struct Lattice {
    pub nodes: HashMap<Index, usize>,
}

impl Lattice {
    /// Smallest and largest index in both directions.
    pub fn bounds(&self) -> (Index, Index) {
        let mut low = [i32::MAX; 2];
        let mut high = [i32::MIN; 2];
        for index in self.nodes.keys() {
            for k in 0..2 {
                low[k] = low[k].min(index[k]);
                high[k] = high[k].max(index[k]);
            }
        }
        (low, high)
    }

    /// Nodes along both directions.
    pub fn extent(&self) -> [u32; 2] {
        if self.nodes.is_empty() {
            return [0, 0];
        }
        let (low, high) = self.bounds();
        [0, 1].map(|k| (high[k] - low[k] + 1) as u32)
    }
}

/// Buckets for neighbour queries.
pub(super) struct Field<'a> {
    pub candidates: &'a [Candidate],
    plane: &'a Plane,
    pattern: BoardPattern,
    buckets: Vec<Vec<u32>>,
    columns: usize,
    rows: usize,
}

const BUCKET_PX: f64 = 16.0;

impl<'a> Field<'a> {
    pub fn new(
        candidates: &'a [Candidate],
        plane: &'a Plane,
        pattern: BoardPattern,
        unused: impl Fn(usize) -> bool,
    ) -> Self {
        let k = plane.reduction as f64;
        let columns = (plane.width as f64 * k / BUCKET_PX) as usize + 1;
        let rows = (plane.height as f64 * k / BUCKET_PX) as usize + 1;
        let mut buckets = vec![Vec::new(); columns * rows];
        for (n, c) in candidates.iter().enumerate() {
            if unused(n) {
                let x = ((c.position[0] / BUCKET_PX).max(0.0) as usize).min(columns - 1);
                let y = ((c.position[1] / BUCKET_PX).max(0.0) as usize).min(rows - 1);
                buckets[y * columns + x].push(n as u32);
            }
        }
        Field {
            candidates,
            plane,
            pattern,
            buckets,
            columns,
            rows,
        }
    }

    /// Buckets of all candidates within a square around a place.
    fn around(&self, at: [f64; 2], radius: f64) -> impl Iterator<Item = &[u32]> + '_ {
        let cell = |v: f64, n: usize| ((v / BUCKET_PX).max(0.0) as usize).min(n - 1);
        let (x0, x1) = (
            cell(at[0] - radius, self.columns),
            cell(at[0] + radius, self.columns),
        );
        let (y0, y1) = (
            cell(at[1] - radius, self.rows),
            cell(at[1] + radius, self.rows),
        );
        (y0..=y1).flat_map(move |y| {
            self.buckets[y * self.columns + x0..=y * self.columns + x1]
                .iter()
                .map(Vec::as_slice)
        })
    }

    /// Squared distance of a candidate \[px²\]. Not hypot: this is the innermost loop, and nothing
    /// overflows in pixels.
    fn squared(&self, n: u32, at: [f64; 2]) -> f64 {
        let p = self.candidates[n as usize].position;
        (p[0] - at[0]).powi(2) + (p[1] - at[1]).powi(2)
    }

    fn within(&self, at: [f64; 2], radius: f64) -> Vec<(usize, f64)> {
        let mut found = Vec::new();
        for bucket in self.around(at, radius) {
            for &n in bucket {
                let d2 = self.squared(n, at);
                if d2 <= radius * radius {
                    found.push((n as usize, d2.sqrt()));
                }
            }
        }
        found
    }

    pub fn nearest(&self, at: [f64; 2], radius: f64) -> Option<usize> {
        let mut best = (radius * radius, None);
        for bucket in self.around(at, radius) {
            for &n in bucket {
                let d2 = self.squared(n, at);
                if d2 < best.0 || (best.1.is_none() && d2 <= best.0) {
                    best = (d2, Some(n as usize));
                }
            }
        }
        best.1
    }

    /// Whether two candidates may be neighbours `along`, with the other step `across`.
    fn linked(&self, from: usize, to: usize, along: [f64; 2], across: [f64; 2]) -> bool {
        let (a, b) = (&self.candidates[from], &self.candidates[to]);
        match self.pattern {
            // The mixed derivative along the lattice changes sign from corner to corner.
            BoardPattern::Chessboard | BoardPattern::Charuco { .. } => {
                // Where the border of the outer squares meets what is behind the board is a
                // corner too, of half the height and a quarter of the strength.
                mixed(a, along, across) * mixed(b, along, across) < 0.0
                    && ratio(a.strength, b.strength) < 3.0
            }
            BoardPattern::Lines { .. } => {
                // Noise on a line looks like a crossing, a tenth as strong.
                ratio(a.strength, b.strength) < 4.0
                    && self.line_between(a, b, across, &[0.3, 0.4, 0.5, 0.6, 0.7]) >= 3
            }
            // Between two dots is light, and dots are alike.
            BoardPattern::Dots { .. } => {
                ratio(a.strength, b.strength) < 12.0 && {
                    let at = |t: f64| {
                        self.plane.near(
                            a.position[0] + t * (b.position[0] - a.position[0]),
                            a.position[1] + t * (b.position[1] - a.position[1]),
                        )
                    };
                    at(0.5) > at(0.0) + 4.0 && at(0.5) > at(1.0) + 4.0
                }
            }
        }
    }

    /// At how many of some places between two nodes a dark line is seen.
    fn line_between(
        &self,
        a: &Candidate,
        b: &Candidate,
        across: [f64; 2],
        places: &[f64],
    ) -> usize {
        // Far enough to leave the line, near enough to stay in the cell.
        let aside = [0.22 * across[0], 0.22 * across[1]];
        places
            .iter()
            .filter(|&t| {
                let x = a.position[0] + t * (b.position[0] - a.position[0]);
                let y = a.position[1] + t * (b.position[1] - a.position[1]);
                let k = self.plane.reduction as f64;
                // The darkest of three across: coarse positions are good to a pixel.
                let n = length(across[0], across[1]).max(1e-9);
                let d = [k * across[0] / n, k * across[1] / n];
                let middle = self
                    .plane
                    .near(x, y)
                    .min(self.plane.near(x + d[0], y + d[1]))
                    .min(self.plane.near(x - d[0], y - d[1]));
                let left = self.plane.near(x + aside[0], y + aside[1]);
                let right = self.plane.near(x - aside[0], y - aside[1]);
                left - middle > 4.0 && right - middle > 4.0
            })
            .count()
    }

    /// The best lattice of at most `most` nodes along its two directions (either way round).
    pub fn grow_best(&self, most: [u32; 2], enough: usize) -> Lattice {
        const SEEDS: usize = 40;
        // A board shows within its first few seeds; an endless floor of tiles grows large
        // lattices from every one of them, and the frame's time is gone.
        let budget = 12 * (most[0] * most[1]) as usize;
        let mut grown = 0;
        let mut best = Growth::new(most, self.candidates.len());
        let mut growth = best.clone();
        let mut tried = 0;
        // Seeds: every so many of the stronger candidates, not all from one bright corner.
        let mut order: Vec<usize> = self.buckets.iter().flatten().map(|&n| n as usize).collect();
        if order.len() < 9 {
            return Lattice::default();
        }
        order.sort_unstable();
        let half = order.len().div_ceil(2);
        let stride = (half / SEEDS).max(1);
        'seeds: for &seed in order[..half].iter().step_by(stride) {
            tried += 1;
            for (a, b) in self.bases(seed) {
                self.grow(&mut growth, seed, a, b);
                grown += growth.nodes.len();
                self.prune(&mut growth.nodes);
                let [ni, nj] = growth.extent();
                let fits = (ni <= most[0] && nj <= most[1]) || (nj <= most[0] && ni <= most[1]);
                let filled = growth.nodes.len() * 2 >= (ni * nj) as usize;
                if fits && filled && growth.nodes.len() > best.nodes.len() {
                    std::mem::swap(&mut best, &mut growth);
                }
                if best.nodes.len() >= enough {
                    break 'seeds;
                }
            }
            if tried >= SEEDS || grown > budget {
                break;
            }
        }
        Lattice {
            nodes: best.nodes.iter().map(|n| (n.index, n.candidate)).collect(),
        }
    }

    /// Pairs of steps from a seed to neighbours, shortest first.
    fn bases(&self, seed: usize) -> Vec<([f64; 2], [f64; 2])> {
        let at = self.candidates[seed].position;
        let mut near: Vec<(usize, f64)> = Vec::new();
        for radius in [40.0, 80.0, 160.0] {
            near = self.within(at, radius);
            near.retain(|&(n, d)| n != seed && d > 4.0);
            if near.len() >= 8 {
                break;
            }
        }
        near.sort_by(|a, b| a.1.total_cmp(&b.1));
        near.truncate(10);
        let steps: Vec<[f64; 2]> = near
            .iter()
            .map(|&(n, _)| {
                let p = self.candidates[n].position;
                [p[0] - at[0], p[1] - at[1]]
            })
            .collect();
        let mut pairs = Vec::new();
        for (n, &a) in steps.iter().enumerate() {
            for &b in &steps[n + 1..] {
                let cross = a[0] * b[1] - a[1] * b[0];
                let (la, lb) = (length(a[0], a[1]), length(b[0], b[1]));
                // Lattices seen at up to 60° and any roll: angles from 30° to 150°.
                if cross.abs() < 0.5 * la * lb || ratio(la as f32, lb as f32) > 4.0 {
                    continue;
                }
                pairs.push(if cross > 0.0 { (a, b) } else { (b, a) });
            }
        }
        pairs.sort_by(|x, y| {
            let size = |p: &([f64; 2], [f64; 2])| length(p.0[0], p.0[1]) + length(p.1[0], p.1[1]);
            size(x).total_cmp(&size(y))
        });
        pairs.truncate(12);
        pairs
    }

    fn grow(&self, growth: &mut Growth, seed: usize, a: [f64; 2], b: [f64; 2]) {
        growth.clear();
        growth.put([0, 0], seed, [a, b]);
        let mut done = 0;
        while done < growth.nodes.len() {
            let Grown {
                index,
                candidate: from,
                steps: local,
            } = growth.nodes[done];
            done += 1;
            let p = self.candidates[from].position;
            for (axis, sign) in [(0usize, 1i32), (0, -1), (1, 1), (1, -1)] {
                let step = local[axis].map(|v| v * f64::from(sign));
                let across = local[1 - axis];
                let reach = length(step[0], step[1]);
                // One step, or two over a node that something hides.
                for far in [1i32, 2] {
                    let mut next = index;
                    next[axis] += sign * far;
                    if next[axis].abs() > growth.widest || growth.at(next).is_some() {
                        break;
                    }
                    let k = f64::from(far);
                    let at = [p[0] + k * step[0], p[1] + k * step[1]];
                    let radius = (0.22 * k.sqrt() * reach).min(0.35 * length(across[0], across[1]));
                    let Some(to) = self.nearest(at, radius.max(2.5)) else {
                        continue;
                    };
                    if growth.taken[to] {
                        break;
                    }
                    let sound = if far == 1 {
                        self.linked(from, to, step, across)
                    } else {
                        self.skipped(from, to, step, across)
                    };
                    if !sound {
                        continue;
                    }
                    let q = self.candidates[to].position;
                    let mut own = local;
                    own[axis] = [
                        f64::from(sign) * (q[0] - p[0]) / k,
                        f64::from(sign) * (q[1] - p[1]) / k,
                    ];
                    // Known neighbours across correct the other step.
                    for s in [1, -1] {
                        let mut beside = next;
                        beside[1 - axis] += s;
                        if let Some(n) = growth.at(beside) {
                            let r = self.candidates[n].position;
                            own[1 - axis] =
                                [f64::from(s) * (r[0] - q[0]), f64::from(s) * (r[1] - q[1])];
                        }
                    }
                    growth.put(next, to, own);
                    break;
                }
            }
            // Larger than any board of this kind: a texture.
            if growth.nodes.len() > growth.most {
                break;
            }
        }
    }

    /// Takes off outer rows and columns that hold hardly any nodes: a step over a hidden node
    /// may have landed on the board's edge or behind it. And those where a chessboard's outer
    /// squares meet the background: corners of a quarter of the strength.
    fn prune(&self, nodes: &mut Vec<Grown>) {
        loop {
            let before = nodes.len();
            for axis in 0..2 {
                let (mut low, mut high) = (i32::MAX, i32::MIN);
                for n in nodes.iter() {
                    low = low.min(n.index[axis]);
                    high = high.max(n.index[axis]);
                }
                if low > high {
                    return;
                }
                let mut counts = vec![0usize; (high - low + 1) as usize];
                for n in nodes.iter() {
                    counts[(n.index[axis] - low) as usize] += 1;
                }
                let fullest = counts.iter().copied().max().unwrap_or(0);
                for (end, inner) in [(low, low + 1), (high, high - 1)] {
                    let few = counts[(end - low) as usize] * 10 < fullest * 3;
                    let faint = self.pattern.is_chess()
                        && self.median(nodes, axis, end) < 0.45 * self.median(nodes, axis, inner);
                    if few || faint {
                        nodes.retain(|n| n.index[axis] != end);
                    }
                }
            }
            if nodes.len() == before {
                return;
            }
        }
    }

    /// Median strength of a row or column.
    fn median(&self, nodes: &[Grown], axis: usize, at: i32) -> f32 {
        let mut values: Vec<f32> = nodes
            .iter()
            .filter(|n| n.index[axis] == at)
            .map(|n| self.candidates[n.candidate].strength)
            .collect();
        values.sort_by(f32::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or(0.0)
    }

    /// A step of two: as alike as the second neighbour on this board must be.
    fn skipped(&self, from: usize, to: usize, along: [f64; 2], across: [f64; 2]) -> bool {
        let (a, b) = (&self.candidates[from], &self.candidates[to]);
        let alike = ratio(a.strength, b.strength) < 4.0;
        match self.pattern {
            BoardPattern::Chessboard | BoardPattern::Charuco { .. } => {
                alike && mixed(a, along, across) * mixed(b, along, across) > 0.0
            }
            // The line still leaves the one node and reaches the other.
            BoardPattern::Lines { .. } => {
                self.line_between(a, b, across, &[0.12, 0.16, 0.2, 0.8, 0.84, 0.88]) >= 4
            }
            BoardPattern::Dots { .. } => alike,
        }
    }
}

/// aᵀ H b: the mixed second derivative along two steps.
fn mixed(c: &Candidate, a: [f64; 2], b: [f64; 2]) -> f64 {
    let [xx, xy, yy] = c.hessian.map(f64::from);
    a[0] * (xx * b[0] + xy * b[1]) + a[1] * (xy * b[0] + yy * b[1])
}

/// √(x² + y²), without the care that hypot takes of huge numbers.
fn length(x: f64, y: f64) -> f64 {
    (x * x + y * y).sqrt()
}

fn ratio(a: f32, b: f32) -> f32 {
    (a / b).max(b / a)
}
