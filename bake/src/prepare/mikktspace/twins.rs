//! Pairs of half-edges along which triangles meet.

use super::{NONE, flag};

/// Longest list of edges of one vertex that is searched without sorting.
const SHORT: usize = 24;

/// Half-edges of sound triangles by the smaller class of their ends, in the order of the triangles.
///
/// Half-edge `h` runs from corner `h` to the next of its triangle.
pub(super) struct Edges {
    /// Where the run of each class starts in `entries`, plus the end.
    pub(super) starts: Vec<u32>,
    pub(super) entries: Vec<Edge>,
}

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Edge {
    /// The larger class.
    pub(super) other: u32,
    /// Half-edge, doubled, plus 1 where it runs from the larger class to the smaller.
    code: u32,
}

impl Edge {
    /// `falling` says that the half-edge runs towards the implied class.
    pub(super) fn directed(half: u32, other: u32, falling: bool) -> Self {
        Self {
            other,
            code: half * 2 + u32::from(falling),
        }
    }

    #[inline(always)]
    pub(super) fn half(self) -> u32 {
        self.code >> 1
    }

    /// Whether the two half-edges join the same classes in opposite directions.
    #[inline(always)]
    pub(super) fn pairs_with(self, other: Self) -> bool {
        self.other == other.other && (self.code ^ other.code) & 1 == 1
    }
}

/// Number of the corner after `corner` in its triangle.
#[inline(always)]
pub(super) fn after(corner: u32) -> u32 {
    if corner % 3 == 2 {
        corner - 2
    } else {
        corner + 1
    }
}

/// Number of the corner before `corner` in its triangle.
#[inline(always)]
pub(super) fn before(corner: u32) -> u32 {
    if corner.is_multiple_of(3) {
        corner + 2
    } else {
        corner - 1
    }
}

impl Edges {
    /// Collects the edges by a counting sort.
    pub(super) fn new(classes: &[u32], count: usize, flags: &[u8]) -> Self {
        let mut starts = vec![0u32; count + 2];
        for_each_edge(classes, flags, |least, _| starts[least as usize + 2] += 1);
        for class in 2..starts.len() {
            starts[class] += starts[class - 1];
        }
        let total = starts[count + 1] as usize;
        let mut entries = vec![Edge::default(); total];
        // Filling moves each start to the next one's place, which is why the counts lie one further.
        for_each_edge(classes, flags, |least, edge| {
            let place = &mut starts[least as usize + 1];
            entries[*place as usize] = edge;
            *place += 1;
        });
        starts.pop();
        Self { starts, entries }
    }

    /// Edges whose smaller class is `class`.
    #[inline(always)]
    pub(super) fn of(&self, class: usize) -> &[Edge] {
        &self.entries[self.starts[class] as usize..self.starts[class + 1] as usize]
    }

    /// The opposite half-edge of each half-edge, or [`NONE`].
    ///
    /// Among the half-edges of two classes each takes, in the order of triangles, the first later one that runs
    /// the other way and is still free.
    pub(super) fn pair(&self, corners: usize) -> Vec<u32> {
        let mut twins = vec![NONE; corners];
        let mut sorted = Vec::new();
        for class in 0..self.starts.len() - 1 {
            let edges = self.of(class);
            if edges.len() <= SHORT {
                pair_all(edges, &mut twins);
            } else {
                sorted.clear();
                sorted.extend_from_slice(edges);
                sorted.sort_unstable_by_key(|edge| (edge.other, edge.code));
                for run in sorted.chunk_by(|a, b| a.other == b.other) {
                    pair_run(run, &mut twins);
                }
            }
        }
        twins
    }
}

#[inline(always)]
fn for_each_edge(classes: &[u32], flags: &[u8], mut add: impl FnMut(u32, Edge)) {
    for (triangle, (ends, flags)) in classes.chunks_exact(3).zip(flags).enumerate() {
        if flags & flag::DEGENERATE != 0 {
            continue;
        }
        for vertex in 0..3 {
            let half = (triangle * 3 + vertex) as u32;
            let (a, b) = (ends[vertex], ends[(vertex + 1) % 3]);
            add(a.min(b), Edge::directed(half, a.max(b), a > b));
        }
    }
}

/// Pairs edges of one smaller class; quadratic, for few.
#[inline]
fn pair_all(edges: &[Edge], twins: &mut [u32]) {
    for (at, a) in edges.iter().enumerate() {
        if twins[a.half() as usize] != NONE {
            continue;
        }
        let free = |b: &&Edge| a.pairs_with(**b) && twins[b.half() as usize] == NONE;
        if let Some(b) = edges[at + 1..].iter().find(free) {
            twins[a.half() as usize] = b.half();
            twins[b.half() as usize] = a.half();
        }
    }
}

/// Pairs edges of the same two classes; linear, because the free ones all run one way.
fn pair_run(run: &[Edge], twins: &mut [u32]) {
    let mut oldest = 0;
    for (at, b) in run.iter().enumerate() {
        while oldest < at && twins[run[oldest].half() as usize] != NONE {
            oldest += 1;
        }
        if oldest < at && run[oldest].pairs_with(*b) {
            twins[run[oldest].half() as usize] = b.half();
            twins[b.half() as usize] = run[oldest].half();
        }
    }
}

/// Pairs the edges of `order`, whose ends all share the class `pivot`, as far as equal edges lie side by side.
pub(super) fn pair_adjacent(order: &[Edge], twins: &mut [u32]) {
    for edge in order {
        twins[edge.half() as usize] = NONE;
    }
    for run in order.chunk_by(|a, b| a.other == b.other) {
        pair_run(run, twins);
    }
}
